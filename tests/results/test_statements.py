"""The three statements of a diagnosis, and what is doubted before any sampling."""

import re
import warnings

import arviz as az
import emcee
import numpy as np
import pytest
from scipy import stats
from support.chains import ar1, backend
from support.printed import unwrapped

import emcee_femu as ef
from emcee_femu.sampling.first_solve import doubt_prior, doubt_units

HERTZ = np.array([3.13, 9.83])
MASSES = np.array([16.5e3, 16.1e3])


def frequencies(p, scale=1e6):
    """Two storeys, with stiffnesses in MN/m."""
    k1, k2 = scale * p["k1"], scale * p["k2"]
    K = np.array([[k1 + k2, -k2], [-k2, k2]])
    A = K / np.sqrt(np.outer(MASSES, MASSES))
    return np.sqrt(np.maximum(np.linalg.eigvalsh(A), 0)) / (2 * np.pi)


AT_MEAN = frequencies({"k1": 50.0, "k2": 10.0})


def posterior_of(measured=HERTZ, model=frequencies, prior=None, **error):
    if prior is None:
        bounds = [(20, 90), (1, 15)]
        prior = ef.GaussianPrior(["k1", "k2"], [50, 10], [9, 3], bounds)
    term = ef.FrequencyTerm(measured, **(error or {"relative_sd": 0.02}))
    return ef.LogPosterior(ef.FunctionModel(model, n_modes=2), term, prior)


def doubts(posterior, **options):
    """Return a short run, and what it warns of."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        run = ef.run(posterior, **{"steps": 60, "ensembles": 2, "seed": 1} | options)
    assert all(warning.filename == __file__ for warning in caught)
    return run, [str(warning.message) for warning in caught]


@pytest.fixture(scope="module")
def good():
    return doubts(posterior_of(), steps=120)[0]


def statuses(found):
    return found.chains.status, found.search.status, found.fit.status


def test_a_good_run_has_three_good_statements(good):
    found = ef.diagnose(good)
    assert statuses(found) == ("converged", "searched", "fits") and found.converged
    assert found.short == "Chains: converged. Search: one maximum. Fit: inside."
    *_, chains, search, fit = unwrapped(found).splitlines()
    assert chains == f"Chains: {found.chains.sentence}" and "R-hat at most" in chains
    points = good.search.points
    assert search.startswith(f"Search: one maximum, by {points:,} points.")
    assert f"one point in {points // 3:,} falls near it" in search
    assert fit.startswith("Fit: inside: 2 of 2 measured values (frequency)")
    assert "every check" not in str(found)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("measured", "scale", "times", "cause"),
    [
        (2 * np.pi * HERTZ, 1e6, "5.91", "rad/s"),
        (HERTZ, 1.0, "941", "units"),
        (HERTZ * 1e3, 1e6, "941", "units"),
        (HERTZ / 1e3, 1e6, "1.06e+03", "units"),
    ],
    ids=["rad/s for Hz", "N/m for MN/m", "mHz for Hz", "kHz for Hz"],
)
def test_other_units_are_doubted_before_sampling_and_by_the_fit(
    measured, scale, times, cause
):
    """Fault 3: the chains converge, and nothing else tells."""
    posterior = posterior_of(measured, lambda p: frequencies(p, scale))
    run, (doubt,) = doubts(posterior)
    side = "high" if "1.06" in times else "low"
    words = f"{measured[0]:.3g} Hz", f"{times} times too {side}", cause
    assert doubt.startswith("frequency at the prior mean: model ")
    assert all(word in doubt for word in words)
    fit = ef.diagnose(run).fit
    assert fit.status == "does not fit" and fit.short == "2 of 2 outside"
    assert all(word in fit.sentence for word in words)


def test_units_are_doubted_where_one_frequency_is_near():
    """A constant part of K, whose mode other units of the parameters leave alone."""
    (doubt,) = doubts(posterior_of(HERTZ / [2.0, 60.0]), moves=ef.DEMCMove())[1]
    assert "11.6 times too high" in doubt and "units" in doubt


def test_predictions_off_by_more_than_a_factor_of_two_are_no_discrepancy():
    prior = ef.IndependentPrior({"k1": stats.norm(50, 1), "k2": stats.norm(10, 0.2)})
    run = doubts(posterior_of(AT_MEAN * [1.0, 3.0], prior=prior))[0]
    sentence = ef.diagnose(run).fit.sentence
    assert "Units or the model are wrong" in sentence and "discrepancy" not in sentence


@pytest.mark.parametrize(
    ("measured", "prior"),
    [
        (2.9 * AT_MEAN, {"k1": stats.norm(50, 0.1), "k2": stats.norm(10, 0.02)}),
        (HERTZ * [1.0, 8.0], None),  # one alone is no matter of units
        (HERTZ, {"k1": stats.loguniform(1e-3, 1e6), "k2": stats.loguniform(1e-3, 1e6)}),
    ],
    ids=["2.9 times", "one mode", "a wide prior"],
)
def test_what_is_no_matter_of_units_is_not_doubted(measured, prior):
    prior = prior and ef.IndependentPrior(prior)
    assert doubts(posterior_of(measured, prior=prior), moves=ef.DEMCMove())[1] == []


def test_annealing_doubts_the_units_too_also_when_it_goes_on(tmp_path):
    posterior = posterior_of(HERTZ, lambda p: frequencies(p, 1.0))
    file, found = {"backend": tmp_path / "annealing"}, []
    for _ in range(2):
        with pytest.warns(UserWarning, match="model 0.0035.*units") as caught:
            found.append(ef.anneal(posterior, 40, seed=1, resume=True, **file))
        assert [warning.filename for warning in caught] == [__file__]
    first, again = found
    assert first.solves == again.solves
    np.testing.assert_array_equal(first.theta, again.theta)


@pytest.mark.slow
def test_emulating_doubts_the_units_too_by_the_solves_of_its_first_design():
    far = posterior_of(HERTZ, lambda p: frequencies(p, 1.0))
    with pytest.warns(UserWarning, match="first design: model 0.0035.*units") as caught:
        assert ef.emulate(far, 8, seed=1).solves == 8  # and none more
    assert [warning.filename for warning in caught] == [__file__]
    wide = {"k1": stats.loguniform(1e-3, 1e6), "k2": stats.loguniform(1e-3, 1e6)}
    high = {"k1": (0.1, 1_200.0), "k2": (0.1, 240.0)}  # at the mean it is far off
    for prior in (None, ef.IndependentPrior(wide), ef.IndependentPrior(high)):
        ef.emulate(posterior_of(HERTZ, prior=prior), 8, seed=1)


@pytest.mark.parametrize(
    ("measured", "fit"), [(HERTZ, "fits"), (HERTZ * [1.0, 2.0], "does not fit")]
)
def test_a_population_has_statements_but_no_chains(measured, fit):
    posterior = posterior_of(measured)
    population = ef.anneal(posterior, 60, seed=1)
    found = ef.diagnose(ef.to_inference_data(population, posterior))
    assert statuses(found) == ("none", "searched", fit)
    assert "other seeds" in found.chains.sentence
    assert f"{population.solves} solves" in found.search.sentence
    assert "one draw of the prior in 20 falls" in found.search.sentence
    assert unwrapped(found) == found.verdict and not found.converged
    assert statuses(ef.diagnose(population)) == ("none", "searched", "not checked")


def test_another_order_of_the_modes_is_doubted():
    posterior = posterior_of(HERTZ, lambda p: frequencies(p)[::-1])
    (doubt,) = doubts(posterior, moves=ef.DEMCMove())[1]
    assert "in another order than the measured" in doubt and "PairedModel" in doubt


def test_modes_that_are_paired_may_cross():
    """Two oscillators, of which the prior mean takes the other for the lower one."""
    springs = {"a": (0, 1, 100.0), "b": (0, 2, 120.0)}
    model = ef.MassSpringModel([1.0, 1.0], springs, shapes=True)
    measured = np.sqrt([100.0, 120.0]) / (2 * np.pi)
    test = ef.Measurements(measured, shapes=np.eye(2))
    prior = ef.GaussianPrior(["a", "b"], [120.0, 100.0], 20.0, [(1.0, 300.0)] * 2)
    terms = ef.FrequencyTerm(test, relative_sd=0.02)
    paired = ef.PairedModel(model, test, candidates=2)
    posterior = ef.LogPosterior(paired, terms, prior)
    assert doubts(posterior, moves=ef.DEMCMove())[1] == []


def test_draws_that_cannot_be_solved_say_nothing_of_units():
    predicted = np.array([[30.0, 50.0], [np.nan, np.nan], [40.0, 45.0]])
    assert "27.4 times" in doubt_units(predicted, np.array([1.0, 2.0]), "Hz")


def test_a_prior_mean_out_of_its_bounds_is_doubted():
    prior = ef.GaussianPrior(["k1", "k2"], [50, 10], [9, 3], [(20, 90), (1, 9)])
    (doubt,) = doubts(posterior_of(prior=prior), moves=ef.DEMCMove())[1]
    assert doubt.startswith("prior (its mean): k2 = 10 is outside its bounds (1, 9)")


def test_the_first_solve_is_counted_once_and_changes_no_chain(tmp_path):
    """In a file too, whose run goes on; a solve that fails says nothing."""
    asked = []

    def noted(p):
        asked.append(tuple(p.values()))
        return frequencies(p, 1.0)

    options = {"moves": ef.DEMCMove(), "nwalkers": 8, "ensembles": 1}
    posterior = posterior_of(model=noted)
    memory, said = doubts(posterior, **options, steps=20)
    assert asked[0] == (50, 10) and memory.solves == len(asked)
    assert len(said) == 1 and posterior.initial[3] == pytest.approx(0.00356, rel=0.01)
    options["backend"] = tmp_path / "run"
    part, first = doubts(posterior, **options, steps=10)
    whole, second = doubts(posterior, **options, steps=20, resume=True)
    assert first == second == said and whole.solves == memory.solves
    assert asked.count((50, 10)) == 2  # in memory, and by the first of both
    np.testing.assert_array_equal(whole[0].get_chain(), memory[0].get_chain())

    def fails_there(p):
        if p["k1"] == 50:
            raise ArithmeticError("no convergence")
        return frequencies(p, 1.0)

    del options["backend"]
    failing, said = doubts(posterior_of(model=fails_there), **options, steps=20)
    assert said == [] and failing.solves == memory.solves - 17
    np.testing.assert_array_equal(failing[0].get_chain(), memory[0].get_chain())


def test_what_is_not_known_is_said(good, tmp_path):
    """Of plain samplers, backends, files and objects of others."""
    chains = [ar1([0.5, 0.5], 1_000, 8, seed) for seed in range(4)]
    found = ef.diagnose([backend(chain) for chain in chains])
    assert statuses(found) == ("converged", "not searched", "not checked")
    assert "to_inference_data(source, posterior)" in found.fit.sentence
    assert 'run(posterior, "auto")' in found.search.sentence
    path = tmp_path / "run"
    run = ef.run(posterior_of(), steps=120, ensembles=2, seed=1, backend=path)
    stored, idata = ef.diagnose(path), ef.to_inference_data(path, posterior_of())
    assert statuses(stored) == ("converged", "searched", "not checked")
    assert statuses(ef.diagnose(run)) == ("converged", "searched", "fits")
    assert ef.diagnose(idata).short == ef.diagnose(run).short
    sampler = emcee.EnsembleSampler(8, 2, posterior_of(), moves=ef.DEMCMove())
    stream = np.random.RandomState(np.random.MT19937(1)).get_state()
    start = emcee.State(posterior_of().start(8, seed=1), random_state=stream)
    sampler.run_mcmc(start, 40)
    found = ef.diagnose(sampler)
    assert statuses(found) == ("not converged", "not searched", "fits")
    assert ef.diagnose(list(good)[:1]).chains.status == "well mixed"


def test_a_complaint_says_how_many_steps_mend_it():
    """Of an autoregressive chain tau is (1 + phi) / (1 - phi), and 50 are needed."""
    chains = [ar1([0.8, 0.5], 450, 8, seed) for seed in range(4)]
    said = ef.diagnose([backend(c) for c in chains], discard=200).chains.sentence
    assert said.startswith("not converged, too short: steps/tau of theta1 is ")
    steps = int(said.rpartition("steps=")[2].rstrip(".").replace(",", ""))
    assert steps == pytest.approx(200 + 1.25 * 50 * 9, rel=0.2)
    longer = [ar1([0.8, 0.5], steps, 8, seed) for seed in range(4)]
    assert ef.diagnose([backend(c) for c in longer], discard=200).converged


def test_a_parameter_at_its_bound_is_named():
    prior = ef.GaussianPrior(["k1", "k2"], [50, 5], [9, 3], [(20, 90), (1, 6.9)])
    found = ef.diagnose(doubts(posterior_of(prior=prior))[0]).fit
    assert found.status == found.short == "at a bound"
    assert "k2 is pressed against its upper bound 6.9" in found.sentence


@pytest.mark.parametrize(
    ("off", "fit"),
    [([2.5], "fits"), ([6.0], "does not fit"), ([2.5, -2.5, 2.5], "does not fit")],
    ids=["one outside", "one far outside", "three outside"],
)
def test_of_ten_values_one_may_be_outside_but_not_far(off, fit):
    exact, z = np.arange(1.0, 11.0), np.zeros(10)
    z[2 : 2 + len(off)] = off
    prior = ef.IndependentPrior({"k1": stats.norm(1, 1e-4), "k2": stats.norm(1, 1e-4)})
    model = ef.FunctionModel(lambda p: p["k1"] * p["k2"] * exact, n_modes=10)
    term = ef.FrequencyTerm(exact + 0.01 * z, sd=0.01)
    run = doubts(ef.LogPosterior(model, term, prior), moves=ef.DEMCMove())[0]
    found = ef.diagnose(run).fit
    assert found.status == fit
    assert f"{10 - len(off)} of 10 measured values" in found.sentence


def test_steps_that_are_dropped_say_nothing_of_the_fit(good):
    idata = ef.to_inference_data(good)
    assert ef.diagnose(idata).fit.status == "fits"
    for group in ("response", "new_measurement"):
        if group in idata:
            idata[group]["frequency"][:, :108] *= 2.0
    assert ef.diagnose(idata).fit.status == "does not fit"
    assert ef.diagnose(idata, 108).fit.status == "fits"


def test_an_error_that_surprises_does_not_fit_though_it_covers_all():
    laws = {"k1": stats.norm(50, 0.1), "k2": stats.norm(10, 0.02)}
    prior = ef.IndependentPrior(laws | {"error": stats.halfnorm(scale=0.02)})
    run, _ = doubts(posterior_of(1.07 * AT_MEAN, prior=prior, discrepancy="error"))
    fit = ef.diagnose(run).fit
    assert fit.status == "does not fit" and fit.short == "a surprising error"
    assert "2 of 2 measured values" in fit.sentence
    assert "above its prior mean: model and data disagree" in fit.sentence


def contradicted(**shape_error):
    """Two frequencies of one ground spring, shapes at 30 sensors of a softer one."""
    n, rng = 30, np.random.default_rng(1)
    springs = {f"s{i}": (i, i + 1, 100.0) for i in range(n)}
    model = ef.MassSpringModel([1.0] * n, springs, shapes=True)
    stiff, soft = (model({"s0": np.array([s0])}) for s0 in (100.0, 4.0))
    shapes = soft.shapes[0][:, :2] / np.linalg.norm(soft.shapes[0][:, :2], axis=0)
    shapes += 0.01 * rng.normal(size=shapes.shape)
    test = ef.Measurements(stiff.frequencies[0, :2], shapes=shapes)
    laws = {"s0": stats.lognorm(1.0, scale=20), "error": stats.halfnorm(scale=0.02)}
    laws |= {
        name: stats.halfnorm(scale=0.1)
        for name in shape_error.values()
        if name == "shape error"
    }
    terms = [
        ef.FrequencyTerm(test, relative_sd=0.002, discrepancy="error"),
        ef.ShapeTerm(test, **shape_error),
    ]
    return ef.LogPosterior(model, terms, ef.IndependentPrior(laws))


@pytest.mark.slow
def test_a_term_that_is_outvoted_is_named_with_the_cure():
    """Fault 26: many ordinates, whose error is inferred, against few frequencies."""
    run = doubts(contradicted(discrepancy="shape error"), steps=100)[0]
    fit = ef.diagnose(run).fit
    assert fit.status == "does not fit"
    assert "The 60 values of 'shape' outvote the 2 of 'frequency'" in fit.sentence
    assert "known standard deviations (sd=), or a fixed delta" in fit.sentence
    fixed = doubts(contradicted(delta=0.2), steps=100)[0]
    assert ef.diagnose(fixed).fit.status == "fits"


def factors(p):
    """Frequencies by factors of the stiffnesses."""
    return frequencies({"k1": 50 * p["k1"], "k2": 10 * p["k2"]})


def test_parameters_that_follow_other_units_leave_the_fit_in_doubt(tmp_path):
    """Frequencies in rad/s, which lognormal factors can follow."""
    prior = ef.IndependentPrior({k: stats.lognorm(0.3) for k in ("k1", "k2")})
    posterior = posterior_of(2 * np.pi * AT_MEAN, factors, prior)
    path = tmp_path / "run"
    options = {"moves": ef.DEMCMove(), "steps": 150, "backend": path}
    run, (doubt,) = doubts(posterior, **options)
    kept = ef.to_inference_data(run, discard=100)
    kept.to_netcdf(tmp_path / "run.nc")
    again = az.from_netcdf(tmp_path / "run.nc")
    for source in (ef.to_inference_data(path, posterior, 100), again):
        fit = ef.diagnose(source).fit
        assert fit.status == "doubtful" and "doubtful" in fit.short
        assert "2 of 2 measured values" in fit.sentence
        assert "+12." in fit.sentence and "rad/s" in fit.sentence
        assert doubt[:-1] in fit.sentence
        said = ef.identifiability(source).findings
        assert any(text.startswith("k1 is +12.") for text in said)
    alone = ef.diagnose(path).fit  # without the posterior
    assert alone.status == "not checked" and doubt[:-1] in alone.sentence


def test_what_was_doubted_of_an_annealing_is_in_its_statement():
    prior = ef.IndependentPrior({k: stats.lognorm(0.3) for k in ("k1", "k2")})
    posterior = posterior_of(2 * np.pi * AT_MEAN, factors, prior)
    with pytest.warns(UserWarning, match="rad/s") as caught:
        population = ef.anneal(posterior, 100, seed=1)
    fit = ef.diagnose(ef.to_inference_data(population, posterior)).fit
    assert fit.status == "doubtful" and str(caught[0].message)[:-1] in fit.sentence


def test_a_parameter_that_moves_as_its_prior_allows_is_not_doubted():
    prior = ef.IndependentPrior({k: stats.lognorm(0.3) for k in ("k1", "k2")})
    run, said = doubts(posterior_of(1.5 * AT_MEAN, factors, prior), steps=200)  # 2.7 sd
    assert said == [] and ef.diagnose(run).fit.status == "fits"


def ignored(p):
    """An old result, whatever the parameters are."""
    return AT_MEAN


ERRORS = {"known": {"relative_sd": 0.02}, "inferred": {"discrepancy": "error"}}


@pytest.mark.parametrize("moves", [ef.DEMCMove(), "auto"])
@pytest.mark.parametrize("errors", ERRORS)
def test_a_model_that_ignores_its_parameters_is_doubted(errors, moves):
    laws = {"k1": stats.norm(50, 9), "k2": stats.norm(10, 3)}
    if errors == "inferred":  # the likelihood varies, then
        laws["error"] = stats.gamma(4, scale=0.005)
    posterior = posterior_of(
        AT_MEAN, ignored, ef.IndependentPrior(laws), **ERRORS[errors]
    )
    run, (doubt,) = doubts(posterior, moves=moves)
    assert doubt.startswith("model: the same response")
    found = ef.diagnose(ef.to_inference_data(run)).fit
    assert (
        found.status == "doubtful" and "frequency: the same response" in found.sentence
    )


def test_annealing_and_emulating_doubt_a_model_that_ignores_its_parameters():
    posterior = posterior_of(AT_MEAN, ignored)
    with pytest.warns(UserWarning, match="^model: the same response") as caught:
        ef.anneal(posterior, 40, seed=1)
    assert [warning.filename for warning in caught] == [__file__]
    with pytest.warns(UserWarning, match="^model: the same response") as caught:
        assert ef.emulate(posterior, 8, seed=1).solves == 8
    assert [warning.filename for warning in caught] == [__file__]


def test_of_several_experiments_the_one_that_ignores_them_is_named():
    term = ef.FrequencyTerm(AT_MEAN, relative_sd=0.02)
    tests = {
        name: (ef.FunctionModel(model, n_modes=2), term)
        for name, model in {"empty": frequencies, "loaded": ignored}.items()
    }
    posterior = ef.LogPosterior.joint(tests, posterior_of().prior)
    (doubt,) = doubts(posterior, moves=ef.DEMCMove())[1]
    assert doubt.startswith("loaded.model: ")


def test_a_density_in_a_term_is_no_model_that_ignores_its_parameters():
    """As targets of benchmarks have it; and without a likelihood there is a prior."""

    def density(parameters, response):
        return stats.norm(50, 1).logpdf(parameters["k1"])

    model = ef.FunctionModel(ignored, n_modes=2)
    posterior = ef.LogPosterior(model, density, posterior_of().prior)
    for moves in (ef.DEMCMove(), "auto"):
        assert doubts(posterior, moves=moves)[1] == []
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        ef.anneal(posterior, 40, seed=1)


@pytest.mark.parametrize(
    ("law", "named"),
    [
        ({"error": stats.halfnorm(0.02)}, "'error' .* 8[12].*%"),
        ({"error": stats.lognorm(0.02)}, "'error' .* 100 %"),
        ({"k1": stats.lognorm(0.2, 50)}, ""),  # sd .22: 0.4 %, which may be meant
        ({"k1": stats.lognorm(0.2, 50e3)}, "'k1' .* 4e-06"),
        ({"k1": stats.norm(-5e4, 0.2)}, "'k1' .* 4e-06"),
        ({"k1": stats.norm(0, 0.2)}, ""),
        ({"error": stats.halfnorm(scale=0.02)}, ""),
    ],
)
def test_slips_in_a_prior_are_doubted(law, named):
    laws = {"k1": stats.norm(50, 9), "k2": stats.norm(10, 3)} | law
    error = {"discrepancy": "error"} if "error" in law else {}
    model = ef.FunctionModel(lambda p: AT_MEAN * (1 + p["k1"] / 1e9), n_modes=2)
    term = ef.FrequencyTerm(AT_MEAN, **(error or {"relative_sd": 0.02}))
    posterior = ef.LogPosterior(model, term, ef.IndependentPrior(laws))
    said = doubt_prior(posterior)
    assert len(said) == bool(named) and all(re.search(named, text) for text in said)
    if named:
        run, warned = doubts(posterior, moves=ef.DEMCMove(), steps=20)
        assert said[0] in warned and said[0] in run.doubts


def counted(asked):
    def model(p):
        asked.append((p["k1"], p["k2"]))
        return frequencies(p)

    return model


def test_a_table_solves_once_and_not_again_after_a_resumed_run(tmp_path):
    asked = []
    options = {"moves": ef.DEMCMove(), "steps": 20, "backend": tmp_path / "run"}
    run, _ = doubts(posterior_of(model=counted(asked)), **options)
    ef.parameter_table(run)
    ef.predictive_table(run)
    spent = len(asked)
    first = ef.frequency_table(run)
    assert len(asked) == spent + 1  # at the posterior mean
    assert str(ef.frequency_table(run)) == str(first) and len(asked) == spent + 1
    assert asked.count((50, 10)) == 1
    again, _ = doubts(posterior_of(model=counted(asked)), **options, resume=True)
    spent = len(asked)
    ef.parameter_table(again)
    ef.predictive_table(again)
    assert len(asked) == spent
    assert str(ef.frequency_table(again)) == str(first) and len(asked) == spent + 1
    assert asked.count((50, 10)) == 1
    posterior = posterior_of(model=counted(asked))  # of another process
    idata = ef.to_inference_data(tmp_path / "run", posterior)
    assert len(asked) == spent + 1
    expected = ef.to_inference_data(run)["constant_data"]["initial_frequency"]
    np.testing.assert_array_equal(idata["constant_data"]["initial_frequency"], expected)
