"""What terms say of each datum, where they measured different places."""

import arviz as az
import numpy as np
import pytest
from numpy.testing import assert_array_equal

import emcee_femu as ef
from emcee_femu.interfaces import Variable
from emcee_femu.measurements import Measurements
from emcee_femu.results.arviz_objects import dataset

PRIOR = ef.GaussianPrior(["k"], [1.0], [0.1], [(0.5, 2.0)])
SHORT = ef.FrequencyTerm([1.01, 2.01], relative_sd=0.02, name="short")
LONG = ef.FrequencyTerm([1.0, 2.0, 3.0, 4.0, 5.0], relative_sd=0.1, name="long")


class Five:
    variables = ef.modal_variables(5, range(5))

    def __call__(self, parameters):
        frequencies = np.sqrt(parameters["k"])[:, None] * np.arange(1.0, 6)
        return ef.ModalSolution(frequencies, np.ones((len(frequencies), 1, 1)) * SHAPES)


SHAPES = np.linalg.qr(np.random.default_rng(0).standard_normal((5, 5)))[0]


def convert(target, nsteps=30):
    runs = ef.run(target, nsteps=nsteps, seed=1)
    return ef.to_inference_data(runs, target, discard=nsteps // 3)


@pytest.mark.parametrize("joint", [False, True])
@pytest.mark.parametrize("terms", [(SHORT, LONG), (LONG, SHORT)])
def test_terms_on_different_numbers_of_modes_stay_apart(terms, joint, tmp_path):
    target = ef.LogPosterior(Five(), terms, PRIOR)
    first, label = "frequency", f"frequency[{terms[1].name}]"
    prefix = "test." if joint else ""
    if joint:
        target = ef.LogPosterior.joint({"test": (Five(), terms)}, PRIOR)
    converted = convert(target)
    converted.to_netcdf(str(tmp_path / "run.nc"))
    for idata in (converted, az.from_netcdf(str(tmp_path / "run.nc"))):
        stored = dataset(idata, "log_likelihood")
        for term, name in zip(terms, (first, label), strict=True):
            m = len(term.measured)
            dim = f"{prefix}mode" + ("" if m == 5 else "[short]")
            observed = dataset(idata, "observed_data")[prefix + name]
            assert_array_equal(observed, term.measured)
            assert stored[prefix + term.name].dims == ("chain", "draw", dim)
            assert stored[dim].values.tolist() == list(range(1, m + 1))
            loo = az.loo(idata, var_name=prefix + term.name)
            assert loo.n_data_points == m
            assert np.isfinite(loo.elpd if hasattr(loo, "elpd") else loo.elpd_loo)
        for group in ("log_likelihood", "posterior_predictive", "observed_data"):
            assert not any(v.isnull().any() for v in dataset(idata, group).values())
        table = ef.predictive_table(idata, target)
        assert np.isfinite(table.column("predicted")).all()
        measured = [*terms[0].measured, *terms[1].measured]
        assert table.column("measured") == measured
        figure = ef.plot_predictive(idata, target)
        assert [len(axes.get_xticks()) for axes in figure.axes] == [
            len(term.measured) for term in terms
        ]
        heading = f"measured mode, its {prefix}{label}"
        assert figure.axes[1].get_xlabel() == heading


def test_a_shape_term_may_compare_fewer_modes_than_are_paired():
    measured = Measurements([1.0, 2.0, 3.0], shapes=SHAPES[:, :3], dofs=range(5))
    model = ef.PairedModel(Five(), measured, candidates=5)
    term = ef.ShapeTerm(SHAPES[:, :2], delta=0.1)
    stored = dataset(convert(ef.LogPosterior(model, term, PRIOR)), "log_likelihood")
    assert stored["shape"].shape[2:] == (2,) and stored["mode"].values.tolist() == [
        1,
        2,
    ]


class Gauge:
    name = "gauge"
    reads = {"w": Variable({"x": [1.0, 2.0]})}

    def __call__(self, parameters, response):
        return -0.5 * ((response["w"] - [1, 2]) ** 2).sum(axis=1) / 0.01


def deflect(parameters):
    return {"w": parameters["k"][:, None] * [1.0, 2.0]}


def gauge_with(attribute, said):
    """Return a finished run and its posterior, whose term then says something else."""
    term = Gauge()
    target = ef.LogPosterior(deflect, term, PRIOR)
    runs = ef.run(target, nsteps=3, seed=1)
    setattr(term, attribute, said if attribute == "observed" else lambda *_: said)
    return runs, target


@pytest.mark.parametrize(
    ("said", "error", "message"),
    [
        ({"z": [1.0, 2.0]}, ValueError, r"expected variables among \['w'\], got 'z'"),
        ({"w": [1.0, 2.0, 3.0]}, ValueError, r"'w' of shape \(.*2,?\), got \(3,\)"),
        ([1.0, 2.0], TypeError, "expected {variable: array}, got list"),
    ],
)
@pytest.mark.parametrize("attribute", ["observed", "pointwise", "replicate"])
def test_what_a_term_says_wrongly_is_named(attribute, said, error, message):
    runs, target = gauge_with(attribute, said)
    with pytest.raises(error, match=f"^terms: {attribute} of 'gauge': .*{message}"):
        ef.to_inference_data(runs, target)


def test_replicates_have_the_label_of_their_own_measurement():
    """The first term measured w, but only the second draws new measurements."""
    first, second = Gauge(), Gauge()
    second.name, both = "second", np.array([1.0, 2.0])
    first.observed, second.observed = {"w": both}, {"w": 2 * both}
    second.replicate = lambda rng, parameters, stored: {"w": stored["w"]}
    idata = convert(ef.LogPosterior(deflect, [first, second], PRIOR))
    assert list(dataset(idata, "posterior_predictive")) == ["w[second]"]
    assert_array_equal(dataset(idata, "observed_data")["w[second]"], 2 * both)


def test_a_term_of_two_variables_keeps_the_densities_of_both():
    runs, target = gauge_with("replicate", None)
    n = runs[0].get_chain().shape[:2]
    both = {"w": np.ones((n[0] * n[1], 2)), "k": 2 * np.ones((n[0] * n[1], 1))}
    term = target.terms[0]
    term.reads = {**Gauge.reads, "k": Variable({"place": ["end"]})}
    term.pointwise = lambda parameters, stored: both
    stored = dataset(ef.to_inference_data(runs, target), "log_likelihood")
    assert {str(name): v.shape[2:] for name, v in stored.items()} == {
        "gauge[w]": (2,),
        "gauge[k]": (1,),
    }
