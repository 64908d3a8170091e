"""A posterior from few solves: what it finds, when it stops, what it refuses."""

import logging
import pickle
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy import stats
from support.few_solves import DATA, DESIGN, PRIOR, SD, Gaussian, bent, posed
from support.pool_problems import forks

import emcee_femu as ef
from emcee_femu.extensions.emulation.emulate import Emulation

SLOW = pytest.mark.slow
GRID = np.stack(np.meshgrid(*[np.linspace(-3.0, 3.0, 241)] * 2), axis=-1).reshape(-1, 2)
ALL = {"seed": 1, "tolerance": 0.0}  # all solves are spent


def linear(x):
    return DESIGN @ x


def square(x):
    return np.array([x[0] ** 2, x[1]])


def broken(x):
    if x[0] > 0.9:
        raise ArithmeticError("no equilibrium")
    return bent(x)


def rippled(x):
    """What no few points can show: waves of a tenth of the spread."""
    return DESIGN @ x + SD * np.sin(60.0 * x[0] + 47.0 * x[1])


def shares(log_p):
    """Return the posterior's shares of grid points."""
    weights = np.exp(log_p - log_p.max())
    return weights / weights.sum()


def exact(function, term, prior, theta):
    """Return the log-posterior of points but for a constant, by the full model."""
    y = np.array([function(row) for row in theta])
    return prior.logpdf(theta) - 0.5 * (((y - term.data) / term.sd) ** 2).sum(axis=1)


def total_variation(close, full):
    return 0.5 * np.abs(shares(close) - shares(full)).sum()


def distance(emulated, function, term=None):
    """Return the total variation between an emulated posterior and the full one."""
    full = exact(function, term or Gaussian(), PRIOR, GRID)
    return total_variation(emulated.posterior(GRID)[:, 0], full)


def sloped(function, jacobian, prior=PRIOR, term=None):
    """Return the posterior of a problem whose model has derivatives."""
    names = prior.names

    def read(p):
        return np.array([p[name] for name in names])

    def differentiate(p):
        slopes = jacobian(read(p))
        return function(read(p)), {"y": dict(zip(names, slopes.T, strict=True))}

    term = Gaussian() if term is None else term
    model = ef.FunctionModel(
        lambda p: function(read(p)), variables=term.reads, jacobian=differentiate
    )
    return ef.LogPosterior(model, term, prior)


def unwrapped(printed):
    """Return the lines of a text, those of a wrapped sentence in one."""
    return str(printed).replace("\n  ", " ")


def bent_slopes(x):
    steep = 0.6 * np.cos(2.0 * x[0]) * np.array([1.0, 0.5, -1.0])
    return DESIGN + np.column_stack([steep, np.zeros(3)])


@pytest.mark.parametrize("derivatives", [pytest.param(False, marks=SLOW), True])
def test_a_conjugate_posterior_is_known_exactly_after_two_batches(derivatives):
    posterior = sloped(linear, lambda x: DESIGN) if derivatives else posed(linear)
    emulated = ef.emulate(posterior, 60, seed=1)
    assert emulated.solves == (3 + 2 if derivatives else 6 + 2 * 2)
    precision = DESIGN.T @ DESIGN / SD**2 + np.eye(2)
    expected = np.linalg.solve(precision, DESIGN.T @ DATA / SD**2)
    weights = shares(emulated.posterior(GRID)[:, 0])
    mean = weights @ GRID
    covariance = (weights * (GRID - mean).T) @ (GRID - mean)
    assert_allclose(mean, expected, atol=1e-3)
    assert_allclose(covariance, np.linalg.inv(precision), atol=1e-4)


@SLOW
def test_both_modes_are_found_with_their_weights():
    """Two modes need 30 solves."""
    term = Gaussian(np.array([1.0, 0.2]), 0.2)
    prior = ef.GaussianPrior(["a", "b"], [0.3, 0.0], 1.0, [(-3.0, 3.0)] * 2)
    emulated = ef.emulate(posed(square, term=term, prior=prior), 30, seed=2)
    full, close = exact(square, term, prior, GRID), emulated.posterior(GRID)[:, 0]
    left = GRID[:, 0] < 0
    assert abs(shares(close)[left].sum() - shares(full)[left].sum()) < 0.01
    assert total_variation(close, full) < 0.03


def support(x):
    """Return frequencies of a beam on a spring that is soft, middling or fixed."""
    fixed = x[-1] / (x[-1] + 1e6)
    e = x[0] if len(x) == 2 else 1.0
    return np.sqrt(e) * np.array([3 + 2 * fixed, 9 + 1.5 * fixed**1.5, 17 + fixed])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("beam", "solves"), [({}, 12), pytest.param({"e": (0.5, 1.5)}, 22, marks=SLOW)]
)
def test_a_spring_over_six_decades_takes_few_solves(beam, solves):
    """The law of logarithms, on a grid; with a second parameter it takes seconds."""
    prior = ef.IndependentPrior(beam | {"k": stats.loguniform(1e3, 1e9)})
    term = Gaussian(np.array([4.0, 9.6, 17.4]), 0.04)
    emulated = ef.emulate(posed(support, term=term, prior=prior), solves, seed=1)
    axes = [np.linspace(0.9, 1.1, 61)] * len(beam) + [np.linspace(3, 9, 241)]
    grid = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, len(beam) + 1)
    theta = np.column_stack([grid[:, :-1], np.clip(10 ** grid[:, -1], 1e3, 1e9)])
    logs = np.log(theta[:, -1])  # of equal steps of them
    full = exact(support, term, prior, theta) + logs
    assert total_variation(emulated.posterior(theta)[:, 0] + logs, full) < 0.03
    # The derivatives are those by the spring, not by its logarithm.
    at = {name: np.array([1.0]) for name in beam} | {"k": np.array([1e6])}
    step = at | {"k": np.array([1e6 + 100.0])}
    slope = emulated.jacobian(at)[1]["y"]["k"]
    change = (emulated(step)["y"] - emulated(at)["y"]) / 100.0
    assert_allclose(slope, change, rtol=1e-3)


@pytest.mark.slow
def test_inferred_errors_are_no_inputs_of_the_emulator_nor_of_its_derivatives():
    def slopes(p):
        return [p["k"] ** 0.5], {"frequency": {"k": np.array([0.5 * p["k"] ** -0.5])}}

    model = ef.FunctionModel(lambda p: [p["k"] ** 0.5], n_modes=1, jacobian=slopes)
    prior = ef.IndependentPrior({"s": stats.halfnorm(scale=0.02), "k": (5.0, 12.0)})
    posterior = ef.LogPosterior(model, ef.FrequencyTerm([3.0], discrepancy="s"), prior)
    emulated = ef.emulate(posterior, 4, **ALL)
    assert emulated.names == ("k",) and "derivatives at 4 points" in unwrapped(emulated)
    k = np.linspace(7.0, 11.0, 5)
    assert_allclose(emulated({"k": k}).frequencies[:, 0], k**0.5, rtol=1e-4)
    theta = prior.sample(np.random.default_rng(1), 50)
    close, full = emulated.posterior(theta)[:, 0], posterior(theta)[:, 0]
    near = full > full.max() - 10
    assert_allclose(close[near], full[near], atol=0.1)


@SLOW
@pytest.mark.parametrize("dofs", [[0, 1, 2], [2, 1]])
def test_modes_that_are_paired_are_emulated_in_units_of_their_errors(dofs):
    """Candidates, each with the error of its measured one; shapes tell the pairs."""
    K = {
        "a": np.diag([1.0, 0, 0]),
        "b": np.array([[1, -1, 0], [-1, 2, -1], [0, -1, 1.0]]),
    }
    model = ef.MatrixModel(np.zeros((3, 3)), np.eye(3), K, n_modes=3, shapes=True)
    true = model({"a": np.array([1.1]), "b": np.array([0.9])})
    chosen = [2, 0]  # in another order than the model's, one of them not measured
    shapes = true.shapes[0][np.ix_(dofs, sorted(chosen))]
    hertz = np.sort(true.frequencies[0, chosen])
    measured = ef.Measurements(hertz, shapes=shapes, dofs=dofs)
    paired = ef.PairedModel(model, measured, candidates=3)
    frequencies = ef.FrequencyTerm(measured, sd=[0.002, 0.02])
    terms = [frequencies, ef.ShapeTerm(measured, delta=[0.1, 0.02])]
    prior = ef.IndependentPrior({"a": (0.5, 2.0), "b": (0.5, 2.0)})
    posterior = ef.LogPosterior(paired, terms, prior)
    emulated = ef.emulate(posterior, 24, seed=1)
    theta = prior.sample(np.random.default_rng(1), 2_000)
    close, full = emulated.posterior(theta)[:, 0], posterior(theta)[:, 0]
    near = full > full.max() - 6
    assert near.sum() > 5
    assert_allclose(close[near], full[near], atol=0.3)
    sent = pickle.loads(pickle.dumps(emulated.posterior))  # to another process
    assert_array_equal(sent(theta), emulated.posterior(theta))


TRUTH = {"E": 1.1, "t": 1.025, "k": 1.16}
SLAB_BOUNDS = [(0.5, 1.5), (0.7, 1.3), (0.15, 2.5)]
SLAB_PRIOR = ef.GaussianPrior([*TRUTH], np.ones(3), [0.13, 0.05, 0.33], SLAB_BOUNDS)


def slab(x):
    """Four frequencies that two of the three parameters' combinations decide."""
    s, b = x[0] * x[1] ** 2, x[2] / x[1]
    return np.sqrt([s * b / (s + b), b, 5 * s + b, 27 * s + b])


def posed_slab(relative_sd):
    data = slab([*TRUTH.values()])
    return posed(slab, term=Gaussian(data, relative_sd * data), prior=SLAB_PRIOR)


def draw_ridge(n, relative_sd):
    """Return draws of that posterior: both combinations are Gaussian, and t is free."""
    rng = np.random.default_rng(1)
    s, b = TRUTH["E"] * TRUTH["t"] ** 2, TRUTH["k"] / TRUTH["t"]
    data, step = slab([s, 1.0, b]), 1e-6
    ahead = [slab([s + step, 1.0, b]), slab([s, 1.0, b + step])]
    slopes = np.array([(moved - data) / step for moved in ahead]) / data
    covariance = np.linalg.inv(slopes @ slopes.T) * relative_sd**2
    t = rng.uniform(0.7, 1.3, 50 * n)
    s, b = rng.multivariate_normal([s, b], covariance, len(t)).T
    ridge = np.stack([s / t**2, t, b * t], axis=1)
    log_p = SLAB_PRIOR.logpdf(ridge) - np.log(t)  # dE dk = t^-2 t ds db
    return ridge[rng.choice(len(t), n, p=shares(log_p))]


@SLOW
def test_a_thin_ridge_is_emulated_right_or_the_history_tells():
    """Few members of a population ever come upon it, and they become copies."""
    emulated, theta = ef.emulate(posed_slab(5e-4), 60, seed=3), draw_ridge(400, 5e-4)
    data = slab([*TRUTH.values()])
    assert emulated.solves < 40
    full = exact(slab, Gaussian(data, 5e-4 * data), SLAB_PRIOR, theta)
    apart = full - emulated.posterior(theta)[:, 0]
    assert apart.std() < 0.2  # as of errors of a tenth of the measurement's
    copies = ef.emulate(posed_slab(1e-6), 20, seed=1)
    assert copies.solves == 20
    assert copies.history.column("predicted error")[-1] > 0.1


SIX_PRIOR = ef.GaussianPrior(
    [f"x{i}" for i in range(6)], np.zeros(6), 1.0, [(-4.0, 4.0)] * 6
)
MIXED, PHASES = np.random.default_rng(7).standard_normal((2, 8, 6)) / np.sqrt(6)
MIXED[:6] += np.eye(6)


def swaying(x):
    return MIXED @ x + 0.3 * np.sin(1.5 * PHASES @ x)


def swaying_slopes(x):
    return MIXED + 0.45 * np.cos(1.5 * PHASES @ x)[:, None] * PHASES


@SLOW
def test_a_sharp_posterior_is_reached_in_stages():
    """A thousand times narrower than its prior; first errors are hundreds of sds."""
    truth = np.array([0.7, -0.5, 1.0, 0.2, -0.9, 0.4])
    term = Gaussian(swaying(truth), 1e-3)
    posterior = sloped(swaying, swaying_slopes, SIX_PRIOR, term)
    emulated = ef.emulate(posterior, 90, seed=1)
    assert emulated.solves < 30
    predicted = emulated.history.column("predicted error")
    assert predicted[0] > 100 and predicted[-1] < 0.5
    assert emulated.history.column("effective draws")[-1] > 50
    steep = swaying_slopes(truth)
    covariance = np.linalg.inv(steep.T @ steep / 1e-6 + np.eye(6))
    assert np.linalg.det(covariance) ** (1 / 12) < 1.2e-3  # a geometric mean
    theta = np.random.default_rng(1).multivariate_normal(truth, covariance, 300)
    full = exact(swaying, term, SIX_PRIOR, theta)
    assert (full - emulated.posterior(theta)[:, 0]).std() < 0.2


@pytest.mark.slow
@pytest.mark.parametrize("function", [np.log, pytest.param(np.array, marks=SLOW)])
def test_logarithms_are_taken_where_they_leave_smaller_errors(function):
    """Of values and derivatives."""
    logs = function is np.log
    bounds, middle = [(1.0, 6.0), (10.0, 60.0)], np.array([3.0, 30.0])
    prior = ef.GaussianPrior(["a", "b"], middle, 0.3 * middle, bounds)
    term = Gaussian(DESIGN @ function([3.6, 27.0]), 0.1 if logs else 1.0)
    posterior = sloped(
        lambda x: DESIGN @ function(x),
        lambda x: DESIGN / x if logs else DESIGN,
        prior,
        term,
    )
    text = unwrapped(ef.emulate(posterior, 6, **ALL))
    assert "derivatives at 6 points" in text
    assert ("logarithms of a, b" in text) == logs


@SLOW
def test_a_parameter_is_seen_by_itself_however_the_draws_lie():
    """They lie along a + b = 0, and part of the response waves along b alone."""

    def waving(x):
        return np.array([x[0] + x[1], 0.3 * np.sin(4.0 * x[1]), 0.1 * x[0]])

    term = Gaussian(np.array([0.0, 0.1, 0.0]), 0.01)
    emulated = ef.emulate(posed(waving, term=term), 24, **ALL)
    theta = PRIOR.sample(np.random.default_rng(1), 300)
    wrong = emulated(dict(zip("ab", theta.T, strict=True)))["y"][:, 1]
    wrong = wrong - [waving(x)[1] for x in theta]
    assert np.sqrt((wrong**2).mean()) < 0.1


@pytest.fixture(scope="module")
def eleven():
    """An emulator that spent eleven solves, and the model that counted them."""
    posterior = posed()
    return ef.emulate(posterior, 11, **ALL), posterior.model


@pytest.mark.slow
def test_it_ends_once_two_true_errors_running_are_within_tolerance():
    """Waves that no few points can show: predicted errors would end it elsewhere."""
    history = ef.emulate(posed(rippled), 16, seed=1, tolerance=0.1).history
    spent = history.column("solves")
    assert spent[-1] == 16
    errors = np.array(history.column("true error")[:-1])
    pairs = np.maximum(errors[:-1], errors[1:])  # of rounds that follow each other
    tolerance = np.median(errors)  # within which half are, and so one alone
    first = int(np.argmax(pairs <= tolerance))
    ended = ef.emulate(posed(rippled), 16, seed=1, tolerance=tolerance)
    assert ended.solves == spent[first + 2]


def test_no_tolerance_spends_all_solves_and_history_tells(eleven):
    emulated, model = eleven
    assert emulated.solves == len(model.solved) == 11
    assert emulated.history.column("solves") == [6, 8, 10, 11]
    assert np.isfinite(emulated.history.column("true error")[:-1]).all()
    assert distance(emulated, bent) < 0.2
    again = pickle.loads(pickle.dumps(emulated))
    theta = PRIOR.sample(np.random.default_rng(1), 5)
    assert_array_equal(again.posterior(theta), emulated.posterior(theta))


@pytest.mark.slow
def test_it_has_settled_if_errors_ended_within_tolerance_and_its_samples_say_so():
    """Not if its solves were spent before, whatever it predicts."""
    short, few = ef.emulate(posed(rippled), 16, seed=1), {"nwalkers": 8, "steps": 10}
    enough = ef.emulate(posed(linear), 60, seed=1)
    spent = ef.emulate(posed(linear), 12, **ALL)  # and no tolerance promises its usual
    assert not short.settled and enough.settled and spent.settled
    for emulated in (short, enough):
        run = ef.run(emulated.posterior, ef.DEMCMove(), **few, ensembles=1, seed=1)
        attributes = ef.to_inference_data(run)["posterior"].attrs
        assert attributes["settled"] == int(emulated.settled)
        own = ef.LogPosterior(emulated, Gaussian(), PRIOR)  # made by a user
        run = ef.run(own, ef.DEMCMove(), **few, ensembles=1, seed=1)
        assert ef.certify(run, posed(), 30, seed=1).settled is emulated.settled


@pytest.mark.slow
def test_failed_solves_are_counted_and_printed(caplog):
    caplog.set_level(logging.CRITICAL, "emcee_femu")
    posterior = posed(broken)
    emulated = ef.emulate(posterior, 12, seed=3, on_failure="reject", max_failures=1.0)
    failed = int((np.array(posterior.model.solved)[:, 0] > 0.9).sum())
    assert emulated.failed_solves == failed > 0
    assert f"{failed} solves failed" in unwrapped(emulated)
    assert ef.emulate(posed(), 9, seed=1).failed_solves == 0


def first_design(starts):
    """Return the six points of a design; the last ends what is not looked at."""
    solved = []

    def ending(x):
        solved.append(x.copy())
        return bent(x) if len(solved) < 6 else 1 / 0

    with pytest.raises(ZeroDivisionError):
        ef.emulate(posed(ending), 8, seed=1, starts=starts)
    return np.array(solved)


def test_the_first_design_spreads_over_the_prior_or_about_a_point_or_is_given(eleven):
    points = [[0.1, 0.2], [0.5, -0.4], [0.6, 0.9], [-0.3, 0.1]]
    first = {"prior": np.array(eleven[1].solved[:6])}
    first |= {"point": first_design([0.5, -0.5]), "given": first_design(points)}
    assert_array_equal(first["given"][:4], points)
    for name, centre, low, high in (
        ("prior", [0.0, 0.0], 1.0, 4.0),
        ("point", [0.5, -0.5], 0.1, 0.8),
    ):
        assert_allclose(first[name][0], centre, atol=0.01)
        assert np.isfinite(PRIOR.logpdf(first[name])).all()
        assert low < np.abs(first[name][:6] - centre).max() < high
    with pytest.raises(ValueError, match="^starts"):  # all on one line
        ef.emulate(posed(), 6, seed=1, starts=[[0.0, x] for x in range(3)])


def half(x):
    if x[0] > 0.6:
        raise ArithmeticError("no equilibrium")
    return bent(x)


@SLOW
def test_failed_solves_are_left_out_and_not_asked_again(caplog):
    """Half of the posterior, about: there the emulator knows least."""
    caplog.set_level(logging.CRITICAL, "emcee_femu")
    posterior, reject = posed(half), {"on_failure": "reject", "max_failures": 1.0}
    emulated = ef.emulate(posterior, 30, **ALL, **reject)
    solved = np.array(posterior.model.solved)
    assert emulated.solves == len(solved) == len(np.unique(solved, axis=0)) == 30
    failed = solved[6:, 0] > 0.6
    assert 0 < failed.sum() <= 7  # of 24; 9 where only failed points are kept away from
    assert failed[-12:].sum() <= 4
    with pytest.raises(ArithmeticError, match="no equilibrium"):
        ef.emulate(posed(broken), 24, seed=3)
    for model, most, match in (
        (lambda x: 1 / 0, 1.0, "0 of 6"),
        (broken, 0.0, "of 6"),
    ):
        changes = {"max_failures": most, "seed": 3, "on_failure": "reject"}
        with pytest.raises(RuntimeError, match=match):
            ef.emulate(posed(model), 24, **changes)


@SLOW
@forks
def test_a_round_is_as_wide_as_the_pool_and_files_go_on(tmp_path):
    """Four emulators, and two with processes."""
    options = ALL | {"backend": str(tmp_path / "run.chain")}
    with ThreadPoolExecutor(5) as executor:
        emulated = ef.emulate(posed(), 16, pool=executor, **options)
        assert emulated.history.column("solves") == [6, 11, 16]
        assert distance(emulated, bent) < 0.05
        again = ef.emulate(posed(), 18, pool=executor, resume=True, **options)
        assert again.history.column("solves") == [6, 11, 16, 18]
    with pytest.raises(ValueError, match="was 5, is 2"):
        ef.emulate(posed(), 16, resume=True, **options)
    posterior = posed()
    with pytest.raises(ValueError, match="10"), ThreadPoolExecutor(10) as ten:
        ef.emulate(posterior, 11, seed=1, pool=ten)
    assert posterior.model.solved == []
    # Workers that a round keeps busy anyway change nothing.
    here, there = (ef.emulate(posed(), 8, seed=4, workers=n) for n in (None, 2))
    theta = PRIOR.sample(np.random.default_rng(1), 5)
    assert here.solves == there.solves
    assert_allclose(there.posterior(theta), here.posterior(theta), rtol=1e-6)


@SLOW
def test_derivatives_save_solves_and_can_be_switched_off():
    """Three emulators."""

    def waves(x):
        return DESIGN @ x + 0.3 * np.sin(4.0 * x[0]) * np.array([1.0, 0.5, -1.0])

    def slopes(x):
        steep = 1.2 * np.cos(4.0 * x[0]) * np.array([1.0, 0.5, -1.0])
        return DESIGN + np.column_stack([steep, np.zeros(3)])

    on, off = (
        ef.emulate(sloped(waves, slopes), 8, **ALL, derivatives=d)
        for d in (True, False)
    )
    assert on.solves == off.solves == 8
    assert 3 * distance(on, waves) < 0.001 < distance(off, waves)
    plain = ef.emulate(posed(waves), 8, **ALL)
    theta = PRIOR.sample(np.random.default_rng(1), 5)
    assert_array_equal(off.posterior(theta), plain.posterior(theta))


@SLOW
def test_points_without_derivatives_are_learned_by_their_values_and_wrong_ones_too():
    """Two emulators of 14 and 24 solves."""

    def refuse(x):
        if x[0] > 0.5:
            raise ValueError("two modes coincide")
        return bent_slopes(x)

    emulated = ef.emulate(sloped(bent, refuse), 14, **ALL)
    known = int(unwrapped(emulated).split("derivatives at ")[1].split()[0])
    assert 3 < known < 14 == emulated.solves
    assert distance(emulated, bent) < 0.01
    wrong = ef.emulate(sloped(bent, lambda x: -bent_slopes(x)), 24, seed=1)
    assert "without derivatives" in unwrapped(wrong)
    assert distance(wrong, bent) < 0.05


def test_what_is_no_derivative_is_an_error():
    def broken_slopes(x):
        raise TypeError("not a derivative")

    with pytest.raises(TypeError, match="not a derivative"):
        ef.emulate(sloped(bent, broken_slopes), 14, seed=1)
    whole = sloped(bent, bent_slopes)
    lacks = ef.FunctionModel(
        whole.model.function,
        variables=whole.model.variables,
        jacobian=lambda p: (bent(np.array([*p.values()])), {}),
    )
    with pytest.raises(TypeError, match="jacobian.*'y'"):
        ef.emulate(ef.LogPosterior(lacks, whole.terms, PRIOR), 14, seed=1)


@SLOW
def test_with_derivatives_a_file_is_gone_on_with_to_the_bit(tmp_path):
    """Three emulators."""
    whole = ef.emulate(sloped(bent, bent_slopes), 7, **ALL)
    options = ALL | {"backend": str(tmp_path / "run.chain")}
    ef.emulate(sloped(bent, bent_slopes), 5, **options)
    options["resume"] = True
    with pytest.raises(ValueError, match="derivatives"):
        ef.emulate(sloped(bent, bent_slopes), 9, derivatives=False, **options)
    with pytest.raises(ValueError, match="y by parameter"):
        ef.emulate(sloped(bent, lambda x: bent_slopes(x) * 1.01), 7, **options)
    again = ef.emulate(sloped(bent, bent_slopes), 7, **options)
    theta = PRIOR.sample(np.random.default_rng(1), 5)
    assert_array_equal(again.posterior(theta), whole.posterior(theta))


def crossed(x):
    """Return two variables, one waving along either parameter."""
    return {"y": [np.sin(2.0 * x[0])], "z": [0.4 * np.sin(3.0 * x[1])]}


class Crossed(ef.likelihoods.term.Term):
    """Independent errors of both."""

    reads = {name: ef.Variable({"point": range(1)}) for name in "yz"}

    def deviations(self, parameters, response):
        r = np.hstack([response["y"] - 0.5, response["z"] + 0.1])
        return r, np.full_like(r, 0.1)


@pytest.mark.slow
def test_a_solve_goes_where_it_lowers_the_expected_error_most(monkeypatch):
    """Second route: processes conditioned on a point more, for each that it may be."""
    chosen, choose = [], Emulation._choose

    def listen(emulation, number, emulator, draws):
        points = choose(emulation, number, emulator, draws)
        chosen.append((emulator, draws, points[0]))
        return points

    monkeypatch.setattr(Emulation, "_choose", listen)
    model = ef.FunctionModel(
        lambda p: crossed([p["a"], p["b"]]), variables=Crossed.reads
    )
    ef.emulate(ef.LogPosterior(model, Crossed(), PRIOR), 24, seed=1, tolerance=0)
    rounds = [given for given in chosen if len(given[0].processes) > 1]
    assert rounds
    for emulator, draws, point in rounds[:3]:
        at = emulator.coordinates(draws.wide)
        traces = [each.covariance.trace() for each in emulator.processes]
        variances = [each.unit_sd(at) ** 2 for each in emulator.processes]
        weights = draws.errors[len(at) :] / np.dot(traces, variances)
        errors = np.zeros(len(at))
        for each, trace in zip(emulator.processes, traces, strict=True):
            values = np.concatenate([each.values, each.values[:1]])
            for i, candidate in enumerate(at):
                points = np.vstack([each.points, candidate])
                more = type(each)(points, values, each.lengths, each.rough)
                errors[i] += trace * (weights @ more.unit_sd(at) ** 2)
        taken = np.flatnonzero((draws.wide == point).all(axis=1))[0]
        assert errors[taken] < errors.min() + 1e-3 * np.ptp(errors)
