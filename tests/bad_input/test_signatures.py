"""Mistakes in the calls that users write most are refused by name, never repaired."""

import sys
from functools import partial

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from scipy import stats

import emcee_femu as ef

HERTZ, SD = np.array([3.0, 9.0]), np.array([0.1, 0.2])
SHAPES = np.array([[1.0, 1.5], [1.6, -0.6], [0.3, 0.8]])
COV, POINT = np.array([[1.0, 30.0], [30.0, 4e3]]), np.array([9.0, 6.0])
K0, M0 = np.diag([9.0, 4.0]), np.array([[2.0, 0.5], [0.5, 1.0]])
K2 = np.array([[1.0, -1.0], [-1.0, 1.0]])
SPRINGS = {"k1": (0, 1, 10.0), "k2": (1, 2, 5.0)}
MODEL = ef.MassSpringModel([1.0, 2.0], SPRINGS)
BOUNDS = np.array([(2.0, 20.0), (1.0, 9.0)])
PRIOR = ef.GaussianPrior(["k1", "k2"], [10.0, 5.0], 2.0, BOUNDS)
TERM = ef.FrequencyTerm(MODEL({}).frequencies[0], relative_sd=0.05)
POSTERIOR = ef.LogPosterior(MODEL, TERM, PRIOR)
START = POSTERIOR.start(8, 1)
RUN = ef.run(POSTERIOR, ef.DEMCMove(), 8, 16, seed=1, ensembles=2)
IDATA = ef.to_inference_data(RUN, POSTERIOR)
MODES = ef.ModalSolution(HERTZ[None] * 1.02, (SHAPES + 0.05)[None])


def always(*values):
    return [lambda _, value=value: value for value in values]


def ending(number):
    return lambda v: np.append(v.flat[:-1], number).reshape(v.shape)


ODD = always("word", np.nan, {"x": None}, object())
FLAG = [*ODD, *always(0, "no", None, [])]
OBJECT = [*ODD, *always(1.5, [])]
ARRAY = [ending(np.nan), ending(np.inf), lambda v: np.ma.masked_equal(v, v.flat[-1])]
ARRAY += [lambda v: v.astype(str), lambda v: v > 0, lambda v: v + 1j, lambda v: v[:0]]
ARRAY += [lambda v: [*v.tolist(), [1.0, [2.0]]], lambda v: v[None, None], *ODD]
POSITIVE = [*ARRAY, np.negative, ending(0.0)]
SQUARE = [*POSITIVE[:-2], *always([[1.0, 0.5], [0.0, 1.0]], np.ones((2, 3)))]
NAMES = [*ODD, set, lambda v: [0, 1]]
NAMES += [lambda v: [*v[:-1], ""], lambda v: [*v[:-1], v[0]]]


def number(low, high=np.inf):
    return [*ODD, *always("1.0", 1j, [1, 2], True, np.inf, low - 1e-3, high + 1e-3)]


def whole(low):
    return [*ODD, *always("1", 1.5, True, [2], low - 1), float]


def mapped(kind):
    """Return the mistakes in the first value of a mapping, and those of a mapping."""
    inside = [lambda v, bend=b: {**v, "k1": bend(v["k1"])} for b in kind]
    return [*ODD, *inside, lambda v: {**v, "k99": v["k1"]}, lambda v: [*v.values()]]


ENDS = [ending(np.nan), lambda v: v[..., ::-1], lambda v: v[:-1], *ODD]
SPRING = always((0, 1), (0.0, 1, 1.0), (0, 9, 1.0), (1, 1, 1.0), (0, 1, -1.0), *"ab")
CALLS = {  # a valid call, and the mistakes of its arguments
    "Measurements": (ef.Measurements, dict(frequencies=HERTZ, shapes=SHAPES, sd=SD),
                     [[*POSITIVE, lambda v: v[::-1]], ARRAY[1:5], POSITIVE[1:]]),
    "MassSpringModel": (ef.MassSpringModel, dict(masses=POINT, springs=SPRINGS),
                        [POSITIVE, mapped(SPRING)[:-2]]),
    "MatrixModel": (partial(ef.MatrixModel, K={"k2": K2}),
                    dict(K0=K0, M0=M0, n_modes=1), [SQUARE, SQUARE, whole(1)]),
    "PairedModel": (lambda **given: ef.PairedModel(
        ef.FunctionModel(lambda p: MODES, n_modes=4),
        ef.Measurements(HERTZ, shapes=SHAPES), **given),
        dict(candidates=3, min_mac=0.5, min_gap=0.02),
        [whole(2), number(0, 1), number(0)]),
    "sd": (ef.FrequencyTerm, dict(measured=HERTZ, sd=SD), [POSITIVE, POSITIVE]),
    "relative_sd": (ef.FrequencyTerm, dict(measured=HERTZ, relative_sd=SD / 4),
                    [POSITIVE, POSITIVE]),
    "covariance": (ef.FrequencyTerm, dict(measured=HERTZ, covariance=COV / 1e4),
                   [POSITIVE, [*SQUARE, *always([[1.0, 2.0], [2.0, 1.0]])]]),
    "delta": (ef.ShapeTerm, dict(measured=SHAPES, delta=SD), [ARRAY[1:], POSITIVE]),
    "DisplacementTerm": (ef.DisplacementTerm, dict(measured=SHAPES.T, sd=SHAPES.T**2),
                         [ARRAY, POSITIVE]),
    "GaussianPrior": (ef.GaussianPrior, dict(names=["k1", "k2"], mean=POINT, sd=SD,
                                             bounds=BOUNDS),
                      [NAMES, ARRAY, POSITIVE, ENDS]),
    "IndependentPrior": (ef.IndependentPrior, dict(
        marginals={"k1": stats.norm(3, 9)}, bounds={"k1": np.array([0.0, 9.0])}),
        [always("word", 1.5, [], {"k1": None}), mapped(ENDS)]),
    "LogPosterior": (ef.LogPosterior, dict(model=MODEL, terms=[TERM], prior=PRIOR),
                     [OBJECT] * 3),
    "theta": (POSTERIOR, dict(theta=POINT), [ARRAY[2:]]),
    "DEMCMove": (ef.DEMCMove, dict(sigma=SD, gamma0=0.5, nsplits=2, mode_jump=0.1),
                 [[*ARRAY[:-4], np.negative], number(0), whole(2), number(0, 1)]),
    "MetropolisMove": (ef.MetropolisMove, dict(sd=SD),
                       [[*POSITIVE[:6], *POSITIVE[7:]]]),
    "a covariance": (ef.MetropolisMove, dict(cov=COV), [SQUARE]),
    "IndependenceMove": (ef.IndependenceMove, dict(
        weights=SD, means=SHAPES[:2], scale_matrices=np.stack([COV, COV]), df=8.0),
        [POSITIVE, ARRAY, POSITIVE[:-2], number(1e-3)]),
    "TemperedMove": (ef.moves.TemperedMove, dict(
        inner=ef.DEMCMove(), betas=np.array([1.0, 0.3, 0.0])),
        [OBJECT, [*ARRAY, lambda v: v[::-1], np.negative]]),
    "HamiltonianMove": (ef.moves.HamiltonianMove, dict(
        metric=COV, steps=2, step_size=0.2), [SQUARE, whole(1), number(1e-3)]),
    "run": (lambda **given: ef.run(POSTERIOR, **given), dict(
        moves=[(ef.DEMCMove(), 1.0)], nwalkers=8, steps=2, ensembles=1, seed=1,
        thin_by=1, starts=START, max_failures=0.1, resume=False, progress=False,
        workers=1),
        [[*OBJECT, *always([(ef.DEMCMove(), -1)])], *[whole(1)] * 3, whole(0), whole(1),
         [*ARRAY[1:-4], lambda v: 99 * v], number(0, 1), FLAG, FLAG[:-2], whole(1)]),
    "find_map": (ef.find_map, dict(posterior=POSTERIOR, starts=1, seed=1, check=0),
                 [OBJECT, whole(1)[1:], whole(0), whole(0)]),
    "anneal": (lambda **given: ef.anneal(POSTERIOR, **given), dict(
        size=40, seed=1), [whole(40), whole(0)]),
    "to_inference_data": (ef.to_inference_data, dict(source=RUN, discard=0, thin=1),
                          [OBJECT, whole(0), whole(1)]),
    "parameter_table": (ef.parameter_table, dict(
        idata=IDATA, var_names=["k1", "k2"]), [OBJECT, NAMES]),
}  # fmt: skip
TIED = {"shapes": "shape_sd", "masses": "springs", "names": "mean", "starts": "initial"}
TIED |= {"frequencies": "shapes", "measured": "sd covariance delta"}
REFUSALS = TypeError, ValueError, RuntimeError
CASES = [(name, i) for name, (_, given, _) in CALLS.items() for i in range(len(given))]


@pytest.mark.parametrize(("name", "position"), CASES)
def test_mistakes_are_refused_by_the_name_of_the_argument(name, position):
    call, valid, kinds = CALLS[name]
    argument = [*valid][position]
    words = argument, *TIED.get(argument, "").split()
    for number_of_it, bend in enumerate(kinds[position]):
        try:
            wrong = bend(valid[argument])
        except (ValueError, TypeError):
            raise AssertionError(f"mistake {number_of_it} cannot be made") from None
        with pytest.raises(REFUSALS) as caught:
            pytest.fail(
                f"{wrong!r} was taken, with {call(**valid | {argument: wrong})}"
            )
        assert any(word in str(caught.value) for word in words), repr(wrong)


ALIKE = {
    "lists": np.ndarray.tolist,
    "by columns": np.asfortranarray,
    "xarray": xr.DataArray,
    "pandas": lambda v: pd.Series(v) if v.ndim == 1 else pd.DataFrame(v),
}
THETA = np.array([POINT, [10.0, 5.0]])
FOUND = {  # a number of all that a call makes of its arrays
    "Measurements": lambda m: [*m.frequencies, *m.shapes.ravel(), *m.sd],
    "MassSpringModel": lambda m: m({}).frequencies,
    "MatrixModel": lambda m: m({"k2": np.ones(1)}).frequencies,
    "covariance": lambda t: t({}, MODES),
    "delta": lambda t: t({}, MODES),
    "DisplacementTerm": lambda t: t({}, {"displacement": SHAPES.T[None] + 0.1}),
    "GaussianPrior": lambda p: p.logpdf(THETA),
    "theta": lambda row: row,
    "a covariance": lambda m: m.cov,
    "HamiltonianMove": lambda m: m.metric,
    "run": lambda r: r[0].get_chain(),
}


@pytest.mark.parametrize("way", ALIKE)
@pytest.mark.parametrize("name", FOUND)
def test_arrays_may_be_written_in_other_ways(name, way):
    call, valid, _ = CALLS[name]
    other = {
        k: ALIKE[way](v) if isinstance(v, np.ndarray) else v for k, v in valid.items()
    }
    expected, found = (FOUND[name](call(**given)) for given in (valid, other))
    np.testing.assert_allclose(found, expected, rtol=1e-12)


def test_whole_numbers_are_taken_as_floats():
    whole_numbers = np.array([[100, 10], [10, 100]], np.int8)
    assert ef.MetropolisMove(cov=whole_numbers).cov.dtype == np.float64


PAPER = ef.paper.mass_spring().posterior


class Emulated:
    posterior = PAPER

    def __call__(self, parameters):  # as an emulated model is called
        return {}


@pytest.mark.parametrize(
    ("call", "error", "cure"),
    [
        (lambda: ef.run(Emulated(), seed=1), TypeError, r"\.posterior"),
        (lambda: ef.run(PAPER, ef.DEMCMove, seed=1), TypeError, r"DEMCMove\(\)"),
        *(
            (partial(call, lambda theta: 0.0), TypeError, "from_function")
            for call in (
                partial(ef.run, seed=1),
                partial(ef.find_map, seed=1),
                partial(ef.anneal, seed=1),
                partial(ef.emulate, seed=1),
                partial(ef.compare_moves, moves={"auto": "auto"}, steps=100, seed=1),
            )
        ),
        (lambda: ef.diagnose(Emulated()), TypeError, r"\.posterior"),
        (lambda: PAPER.model([1.0]), TypeError, "{name"),
        (
            lambda: PAPER.model({"k1": [1.0], "k3": [1.0, 2.0]}),
            ValueError,
            "one length",
        ),
        (lambda: ef.GaussianPrior({"k1": (50, 9)}), TypeError, r"\['k1'\], mean, sd"),
        (lambda: ef.GaussianPrior(["k1"], [50.0]), ValueError, "sd"),
        (
            lambda: ef.MatrixModel("K.mtx", M0, {}, n_modes=1),
            TypeError,
            "read_matrices",
        ),
        (lambda: ef.MatrixModel(None, M0, {}, n_modes=1), TypeError, r"0 \* M0"),
        (lambda: ef.MetropolisMove([[1.0, 0.0], [0.0, 1.0]]), ValueError, "cov="),
        (lambda: ef.report(None, "tower.pdf"), ValueError, "tower.html"),
        (
            lambda: ef.frf.FRFMeasurements.from_uff("a"),
            ImportError,
            r"pip install pyuff",
        ),
    ],
)
def test_the_message_has_the_cure(call, error, cure, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyuff", None)
    with pytest.raises(error, match=cure):
        call()


STOREYS = {"k1": np.diag([1.0, 0.0]), "k2": np.array([[1.0, -1.0], [-1.0, 1.0]])}
LIMITS = [(20, 90), (1, 15)]


@pytest.mark.parametrize(
    ("measured", "bounds", "named"),
    [
        ([0.53, 1.08], None, "bounds"),
        ([0.53, 1.08, 1.4], LIMITS, r"3 modes|got \(\d+, 2\)"),
    ],
)
def test_a_first_mistake_is_named_and_no_page_of_emcee_printed(
    measured, bounds, named, capsys
):
    model = ef.MatrixModel(np.zeros((2, 2)), np.eye(2), STOREYS, n_modes=2)
    with pytest.raises((ValueError, RuntimeError), match=named):
        prior = ef.GaussianPrior(["k1", "k2"], [50, 10], [30, 10], bounds)
        term = ef.FrequencyTerm(measured, relative_sd=0.1)
        ef.run(ef.LogPosterior(model, term, prior), steps=5, ensembles=1, seed=1)
    assert capsys.readouterr() == ("", "")  # emcee would print sixty lines
