"""What terms say of each datum, where they measured different places."""

import arviz as az
import numpy as np
import pytest
from numpy.testing import assert_array_equal
from support.chains import dataset

import emcee_femu as ef

PRIOR = ef.GaussianPrior(["k"], [1.0], [0.1], [(0.5, 2.0)])
SHORT = ef.FrequencyTerm([1.01, 2.01], relative_sd=0.02, name="short")
LONG = ef.FrequencyTerm([1.0, 2.0, 3.0, 4.0, 5.0], relative_sd=0.1, name="long")


class Five:
    variables = ef.modal_variables(5, range(5))

    def __call__(self, parameters):
        frequencies = np.sqrt(parameters["k"])[:, None] * np.arange(1.0, 6)
        return ef.ModalSolution(frequencies, np.ones((len(frequencies), 1, 1)) * SHAPES)


SHAPES = np.linalg.qr(np.random.default_rng(0).standard_normal((5, 5)))[0]


def convert(target, steps=30):
    runs = ef.run(target, ef.DEMCMove(), steps=steps, ensembles=1, seed=1)
    return ef.to_inference_data(runs, target, discard=steps // 3)


@pytest.mark.parametrize(
    ("terms", "joint"), [((SHORT, LONG), False), ((LONG, SHORT), True)]
)
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
            observed = dataset(idata, "observed_data")[prefix + name]
            assert_array_equal(observed, term.measured)
            labels = [f"{prefix}{term.name}[{mode}]" for mode in range(1, m + 1)]
            assert {*labels} <= {*stored["data"].datum.values.tolist()}
        loo = az.loo(idata)
        assert loo.n_data_points == sum(len(term.measured) for term in terms)
        assert np.isfinite(loo.elpd if hasattr(loo, "elpd") else loo.elpd_loo)
        for group in ("log_likelihood", "new_measurement", "observed_data"):
            assert not any(v.isnull().any() for v in dataset(idata, group).values())
        table = ef.predictive_table(idata, target)
        assert np.isfinite(table.column("predicted")).all()
        measured = [*terms[0].measured, *terms[1].measured]
        assert table.column("measured") == measured
        figure = ef.figures.plot_predictive(idata, target)
        assert [len(axes.get_xticks()) for axes in figure.axes] == [
            len(term.measured) for term in terms
        ]
        heading = f"measured mode, its {prefix}{label}"
        assert figure.axes[1].get_xlabel() == heading


def test_a_shape_term_may_compare_fewer_modes_than_are_paired():
    measured = ef.Measurements([1.0, 2.0, 3.0], shapes=SHAPES[:, :3], dofs=range(5))
    model = ef.PairedModel(Five(), measured, candidates=5)
    term = ef.ShapeTerm(SHAPES[:, :2], delta=0.1)
    stored = dataset(convert(ef.LogPosterior(model, term, PRIOR)), "log_likelihood")
    assert stored["shape"].shape[2:] == (2,) and stored["mode"].values.tolist() == [
        1,
        2,
    ]
