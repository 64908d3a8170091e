"""Tables of predictions and pairing: numbers by hand, and laws of the errors."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import stats
from support.chains import by_hand
from support.gradients import Crossing

import emcee_femu as ef

MEASURED = [10.0, 20.0, 40.0]
PRIOR_OF_A = ef.IndependentPrior({"a": stats.norm(1.0, 0.1)})
WIDTH = 2 * stats.norm.ppf(0.975)


def made(frequency, by=None, drawn=None, **paired):
    """Return draws ``(chain, draw, mode)``, and new measurements ``by`` a posterior."""
    shape, groups = frequency.shape[:2], {"response": {"frequency": frequency} | paired}
    drawn = drawn or {"a": np.arange(np.prod(shape), dtype=float)}
    drawn = {name: np.resize(values, shape) for name, values in drawn.items()}
    if by is not None:
        flat = {name: values.ravel() for name, values in drawn.items()}
        stored = {"frequency": frequency.reshape(-1, frequency.shape[2])}
        new = by.terms[-1].replicate(np.random.default_rng(0), flat, stored)
        new = {"frequency": new["frequency"].reshape(*shape, -1)}
        groups["new_measurement"] = new
    measured = {"frequency": ("mode", MEASURED, {"units": "Hz"})}
    return by_hand(drawn, measured=measured, **groups)


def posterior(names=("a",), **error):
    model = ef.FunctionModel(lambda p: MEASURED, n_modes=3)
    priors = {name: stats.halfnorm(scale=1.0) for name in names}
    term = ef.FrequencyTerm(MEASURED, **error)
    return ef.LogPosterior(model, term, ef.IndependentPrior(priors))


def widths(table):
    return np.subtract(table.column("97.5 %"), table.column("2.5 %"))


def test_intervals_of_the_model_alone_are_the_quantiles_of_its_predictions():
    # Uniform grids, of which mean and quantiles are known; a fourth mode is unmeasured.
    grid = np.random.default_rng(0).permutation(np.linspace(0, 1, 1001))
    grid = grid[:1000].reshape(4, 250, 1)
    spread = np.array([1.0, 2.0, 4.0, 8.0])
    table = ef.predictive_table(made(np.array([9.0, 18.1, 40.2, 90.0]) + spread * grid))
    assert table.column("mode") == ["1", "2", "3"]
    assert table.column("measured Hz") == MEASURED
    expected = np.array([9.0, 18.1, 40.2])
    for title, level in (("updated Hz", 0.5), ("2.5 %", 0.025), ("97.5 %", 0.975)):
        values = expected + level * spread[:3]
        assert_allclose(table.column(title), values, rtol=0, atol=0.01)
    assert table.column("in the model's interval") == ["no", "yes", "no"]
    assert "of the model alone" in table.title


def test_a_new_measurement_has_measurement_error_and_discrepancy():
    """Var = var(f) + f_m^2 (R + sigma_d^2), and the quantiles of that Gaussian."""
    rng, n = np.random.default_rng(5), 100_000
    frequency = np.array(MEASURED) + rng.standard_normal((4, n // 4, 3)) * 0.1
    sd = np.array([0.3, 0.2, 0.1])
    with_both = posterior(("a", "sigma"), sd=sd, discrepancy="sigma")
    idata = made(frequency, with_both, {"a": [1.0], "sigma": [0.01]})
    total = np.sqrt(0.1**2 + sd**2 + (0.01 * np.array(MEASURED)) ** 2)
    table = ef.predictive_table(idata, with_both)
    assert_allclose(table.column("sd Hz"), sd, rtol=1e-12)
    assert_allclose(table.column("updated Hz"), MEASURED, rtol=0, atol=0.01)
    assert_allclose(widths(table), WIDTH * total, rtol=0, atol=0.04 * total.max())
    middle = np.add(table.column("97.5 %"), table.column("2.5 %")) / 2
    assert_allclose(middle, MEASURED, rtol=0, atol=0.02 * total.max())


@pytest.mark.filterwarnings("ignore:model. the same response")
def test_each_measurement_of_a_variable_has_its_rows_and_its_own_error():
    errors, usual = {"first": 0.1, "again": 0.01}, posterior(beta=100.0)
    terms = [
        ef.FrequencyTerm(MEASURED, relative_sd=sd, name=name)
        for name, sd in errors.items()
    ]
    target = ef.LogPosterior(usual.model, terms, usual.prior)
    run = ef.run(target, ef.DEMCMove(), 8, 250, seed=1, ensembles=1)
    table = ef.predictive_table(run)
    names = ["frequency"] * 3 + ["frequency[again]"] * 3
    rows = [f"{name}[{i}] Hz" for name, i in zip(names, [1, 2, 3] * 2, strict=True)]
    assert table.column("quantity") == rows
    sd = np.outer(list(errors.values()), MEASURED).ravel()
    assert_allclose(table.column("sd"), sd, rtol=1e-12)
    assert_allclose(widths(table), WIDTH * sd, rtol=0.15)


class Deflection:
    """A user's term: millimetres at two of three points, with an error of 0.1."""

    reads = {"deflection": ef.Variable({"point": [1, 3]}, "mm")}
    observed = {"deflection": np.array([1.0, 2.2])}

    def __call__(self, parameters, response):
        r, sd = self.deviations(parameters, response)
        return -0.5 * ((r / sd) ** 2).sum(axis=1)

    def deviations(self, parameters, response):
        r = response["deflection"][:, :2] - self.observed["deflection"]
        return r, np.full_like(r, 0.1)


class Beam:
    variables = {"deflection": ef.Variable({"point": [1, 3, 2]}, "mm")}

    def __call__(self, parameters):
        return {"deflection": parameters["a"][:, None] * [1.0, 2.0, 1.5]}


def test_other_variables_are_tabulated_where_they_were_measured():
    """A conjugate problem: a has precision 1 + 5 / 0.1^2, and mean 5.4 / 5.01."""
    prior = ef.GaussianPrior(["a"], [0.0], [1.0])
    target = ef.LogPosterior(Beam(), Deflection(), prior)
    run = ef.run(target, ef.DEMCMove(), 20, 1000, seed=1, ensembles=1)
    table = ef.predictive_table(ef.to_inference_data(run, discard=200))
    assert table.column("point") == ["1", "3"]
    mean, sd = 5.4 / 5.01, 501**-0.5
    assert_allclose(table.column("updated mm"), [mean, 2 * mean], rtol=0.004)
    assert_allclose(widths(table), WIDTH * np.array([sd, 2 * sd]), rtol=0.08)
    modal = ef.FunctionModel(lambda p: [10 * p["a"]], n_modes=1)
    term = ef.FrequencyTerm([11.0], relative_sd=0.1)
    tests = {"static": (Beam(), Deflection()), "modal": (modal, term)}
    joint = ef.LogPosterior.joint(tests, ef.GaussianPrior(["a"], [1.0], [0.2]))
    run = ef.run(joint, ef.DEMCMove(), 8, 20, seed=1, ensembles=1)
    table = ef.predictive_table(run)
    places = ["static.deflection[1] mm", "static.deflection[3] mm"]
    assert table.column("quantity") == [*places, "modal.frequency[1] Hz"]
    assert table.column("measured") == [1.0, 2.2, 11.0]


def test_pairing_table_equals_numbers_by_hand():
    """Of ten samples in two chains; the model's fourth mode is no measured one."""
    orders = 6 * [(1, 3, 2)] + 2 * [(1, 2, 3)] + [(3, 1, 2), (1, 3, 4)]
    order = np.random.default_rng(0).permutation(np.array(orders, dtype=float))
    mac = np.full((2, 5, 3), 0.9)
    mac[0, 2] = 0.4, 0.95, 0.45
    mac[1, 3] = 0.85, 0.95, 0.3
    frequency = np.ones((2, 5, 3)) * MEASURED
    idata = made(frequency, mac=mac, model_mode=order.reshape(2, 5, 3))
    table, mac = ef.pairing_table(idata), mac.reshape(10, 3)
    assert table.column("mode") == ["1", "2", "3", "any"]
    assert table.column("model's mode") == ["1", "3", "2", ""]
    # Mode 1: once 3; mode 2: twice 2, once 1; mode 3: twice 3, once 4.
    assert_allclose(table.column("another in %"), [10, 30, 30, 40])
    assert_allclose(table.column("MAC")[:3], mac.mean(axis=0), rtol=1e-12)
    assert_allclose(table.column("MAC 5 %")[:3], np.quantile(mac, 0.05, axis=0))
    assert np.isnan([table.column("MAC")[3], table.column("MAC 5 %")[3]]).all()
    assert_allclose(table.column("MAC < 0.5 in %"), [10, 0, 20, 20])
    # By index is right only in the two samples of ascending order.
    assert_allclose(table.column("wrong by index in %"), [10, 80, 80, 80])
    assert "40 % of 10 samples" in table.title
    predictions, unpaired = ef.predictive_table(idata), made(np.ones((1, 4, 3)))
    for title in ("MAC", "MAC 5 %"):
        assert predictions.column(title) == table.column(title)[:3]
        assert title not in ef.predictive_table(unpaired).columns
    with pytest.raises(ValueError, match="PairedModel"):
        ef.pairing_table(unpaired)


def test_tables_of_a_sampled_paired_model_report_its_crossings():
    measured = ef.Measurements([10.0, 10.1], sd=[0.1, 0.2], shapes=np.eye(2))
    model = ef.PairedModel(Crossing(), measured, candidates=2, min_mac=0.9, min_gap=0.0)
    prior = ef.GaussianPrior(["a", "b"], [10.0, 10.0], [0.5, 1.0], [(5, 15)] * 2)
    target = ef.LogPosterior(model, ef.FrequencyTerm(measured), prior)
    runs = ef.run(target, ef.DEMCMove(), 20, 600, ensembles=1, seed=1)
    idata = ef.to_inference_data(runs, target, discard=100)
    # Both are conjugate, and beyond the bounds is nothing.
    variance = 1 / (prior.sd**-2 + measured.sd**-2)
    mean = variance * (prior.mean / prior.sd**2 + measured.frequencies / measured.sd**2)
    share = 100 * stats.norm.cdf((mean[0] - mean[1]) / variance.sum() ** 0.5)
    table = ef.pairing_table(idata)
    assert table.column("model's mode") == ["1", "2", ""]
    assert_allclose(table.column("another in %"), share, atol=4)
    assert_allclose(table.column("MAC")[:2], 1.0, rtol=1e-12)
    assert_allclose(table.column("MAC < 0.9 in %"), 0.0)
    predictions = ef.predictive_table(idata, target)
    assert_allclose(predictions.column("sd Hz"), [0.1, 0.2], rtol=1e-9)
    total = np.sqrt(variance + measured.sd**2)
    assert_allclose(widths(predictions), WIDTH * total, rtol=0.07)


def test_another_posterior_is_refused():
    idata = made(np.ones((1, 4, 3)))
    with pytest.raises(ValueError, match="posterior.*'b'"):
        ef.predictive_table(idata, posterior(("b",), beta=100.0))


ERRORS = np.array([0.3, 0.2, 0.1])


def own(kind):
    """Return a user's term of frequencies, whose deviations are of one kind."""

    def deviations(parameters, response):
        f = response.frequency  # as of what the model returns, a ModalSolution
        r, sd = f - MEASURED, np.broadcast_to(ERRORS, f.shape)
        if kind == "the other way":
            return -r, sd
        if kind in ("relative", "restored"):
            return r / MEASURED, sd / MEASURED
        if kind == "doubled":
            return 2 * r, 2 * sd
        return r, sd

    def term(parameters, response):
        r, sd = deviations(parameters, response)
        return stats.norm.logpdf(r, 0, sd).sum(axis=1)

    term.reads = {"frequency": ef.Variable({"mode": [1, 2, 3]}, "Hz")}
    term.observed, term.name = {"frequency": np.array(MEASURED)}, "own"
    if kind != "no Gaussian":
        term.deviations = deviations
    if kind == "restored":
        term.restore = lambda r: np.array(MEASURED) * (1 + r)
    return term


@pytest.mark.parametrize("kind", ["plain", "the other way", "restored"])
def test_new_measurements_of_a_users_term_are_the_models_values_with_its_errors(kind):
    f = np.array(MEASURED) + np.linspace(-1, 1, 40_000)[:, None] * [0.5, 0.0, 0.0]
    term = ef.LogPosterior(
        ef.FunctionModel(lambda p: MEASURED, n_modes=3), own(kind), PRIOR_OF_A
    ).terms[0]
    stored, rng = ef.contracts.Stored(frequency=f), np.random.default_rng(3)
    noise = term.replicate(rng, {"a": np.ones(len(f))}, stored)["frequency"] - f
    assert_allclose(noise.mean(axis=0) / ERRORS, 0, rtol=0, atol=0.03)
    assert_allclose(noise.std(axis=0), ERRORS, rtol=0.02)
    assert abs(np.corrcoef(noise[:, 0], f[:, 0])[0, 1]) < 0.03


@pytest.mark.parametrize("small", [1.0, 1e-12])
def test_units_do_not_decide_whether_deviations_are_plain_differences(small):
    term = ef.LogPosterior(
        ef.FunctionModel(lambda p: MEASURED, n_modes=3), own("doubled"), PRIOR_OF_A
    ).terms[0]
    term.observed = {"frequency": small * np.array(MEASURED)}
    kept = term._deviations
    term._deviations = lambda p, r: [
        small * x for x in kept(p, ef.contracts.Stored(frequency=r.frequency / small))
    ]
    stored = ef.contracts.Stored(frequency=small * (np.array(MEASURED)[None] + 0.1))
    assert not term.replicate(np.random.default_rng(1), {"a": np.ones(1)}, stored)


@pytest.mark.parametrize(
    "kind", ["relative", pytest.param("no Gaussian", marks=pytest.mark.slow)]
)
def test_a_term_that_draws_nothing_leaves_the_rows_of_others_as_they_are(kind):
    """Its own rows have the model's interval, and say neither yes nor no."""
    model = ef.FunctionModel(lambda p: np.array(MEASURED) * p["a"], n_modes=3)
    terms = [ef.FrequencyTerm(MEASURED, sd=ERRORS), own(kind)]
    both = ef.LogPosterior(model, terms, PRIOR_OF_A)
    alone = ef.LogPosterior(model, terms[:1], PRIOR_OF_A)
    move = ef.DEMCMove()
    run, other = (ef.run(p, move, 8, 200, ensembles=1, seed=2) for p in (both, alone))
    table, usual = (ef.predictive_table(r) for r in (run, other))
    assert table.column("inside") == [*usual.column("inside"), *3 * ["-"]]
    assert_allclose(widths(table)[:3], widths(usual), rtol=0.25)
    assert (widths(table)[3:] < widths(table)[:3]).all()
