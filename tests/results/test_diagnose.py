"""The three statements of a diagnosis, and what is doubted before any sampling."""

import re
import warnings
from types import SimpleNamespace

import emcee
import numpy as np
import pytest
from scipy import stats
from support.chains import ar1, backend, stored_and_read
from support.gradients import Crossing

import emcee_femu as ef
from emcee_femu.results.diagnose import FURTHER, judge_search
from emcee_femu.search.maxima import HITS
from emcee_femu.verdict.diagnosis import OF_RUN

HERTZ = np.array([3.13, 9.83])
MASSES = np.array([16.5e3, 16.1e3])
DEMC = {"moves": ef.DEMCMove()}


def frequencies(p, scale=1e6):
    """Two storeys, with stiffnesses in MN/m."""
    k1, k2 = scale * p["k1"], scale * p["k2"]
    K = np.array([[k1 + k2, -k2], [-k2, k2]])
    A = K / np.sqrt(np.outer(MASSES, MASSES))
    return np.sqrt(np.maximum(np.linalg.eigvalsh(A), 0)) / (2 * np.pi)


def in_newtons(p):
    return frequencies(p, 1.0)


def factors(p):
    """Frequencies by factors of the stiffnesses."""
    return frequencies({"k1": 50 * p["k1"], "k2": 10 * p["k2"]})


AT_MEAN = frequencies({"k1": 50.0, "k2": 10.0})


def ignored(p):
    """An old result, whatever the parameters are."""
    return AT_MEAN


def independent(**laws):
    """Return a prior of two stiffnesses, or of others."""
    usual = {"k1": stats.norm(50, 9), "k2": stats.norm(10, 3)}
    return ef.IndependentPrior(usual | laws)


NARROW = independent(k1=stats.norm(50, 0.1), k2=stats.norm(10, 0.02))
WIDE = independent(k1=stats.loguniform(1e-3, 1e6), k2=stats.loguniform(1e-3, 1e6))
FACTORS = ef.IndependentPrior({k: stats.lognorm(0.3) for k in ("k1", "k2")})


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
def good(tmp_path_factory):
    path = tmp_path_factory.mktemp("good") / "run"
    return doubts(posterior_of(), steps=120, backend=path)[0], path


def statuses(found):
    return found.chains.status, found.search.status, found.fit.status


def test_a_good_run_has_three_good_statements_and_what_is_not_known_is_said(good):
    """Of plain samplers, backends, files and objects of others."""
    run, path = good
    for source in (run, ef.to_inference_data(path, posterior_of())):
        found = ef.diagnose(source)
        assert statuses(found) == ("converged", "searched", "fits")
        assert found.converged
        assert f"1 in {run.search.points // 3:,} points" in found.search.sentence
    assert statuses(ef.diagnose(path)) == ("converged", "searched", "not checked")
    assert ef.diagnose(list(run)[:1]).chains.status == "well mixed"
    chains = [backend(ar1([0.5, 0.5], 1_000, 8, seed)) for seed in range(4)]
    expected = "converged", "not searched", "not checked"
    assert statuses(ef.diagnose(chains)) == expected
    sampler = emcee.EnsembleSampler(8, 2, posterior_of(), **DEMC)
    stream = np.random.RandomState(np.random.MT19937(1)).get_state()
    sampler.run_mcmc(emcee.State(posterior_of().start(8, 1), random_state=stream), 40)
    found = ef.diagnose(sampler)
    assert statuses(found) == ("not converged", "not searched", "fits")


@pytest.mark.parametrize(
    ("measured", "model", "said"),
    [
        (2 * np.pi * HERTZ, frequencies, "5.91 times too low.*rad/s"),
        (HERTZ, in_newtons, "941 times too low.*units"),
        (HERTZ / 1e3, frequencies, "1.06e.03 times too high.*units"),
        (HERTZ * 9.81**0.5, frequencies, "2.95 times too low.*weight"),
        # A constant part of K, whose mode other units leave alone.
        (HERTZ / [2.0, 60.0], frequencies, "11.6 times too high.*units"),
    ],
    ids=["rad/s for Hz", "N/m for MN/m", "kHz for Hz", "N for kg", "one is near"],
)
def test_other_units_are_doubted_before_sampling_and_by_the_fit(measured, model, said):
    """Fault 3: the chains converge, and nothing else tells."""
    run, (doubt,) = doubts(posterior_of(measured, model), **DEMC)
    fit = ef.diagnose(run).fit
    assert fit.status == "does not fit"
    for text in (doubt, fit.sentence):
        assert re.search(said, text) and f"{measured[0]:.3g} Hz" in text


def crossing():
    """Two oscillators, of which the prior mean takes the other for the lower one."""
    test = ef.Measurements([10.0, 11.0], shapes=np.eye(2))
    prior = ef.GaussianPrior(["a", "b"], [11.0, 10.0], 1.0, [(1.0, 30.0)] * 2)
    paired = ef.PairedModel(Crossing(), test, candidates=2)
    return ef.LogPosterior(paired, ef.FrequencyTerm(test, relative_sd=0.02), prior)


DENSITY = ef.LogPosterior(  # a term has all of it, as in targets of benchmarks
    ef.FunctionModel(ignored, n_modes=2),
    lambda p, _: stats.norm.logpdf(p["k1"], 50, 1),
    posterior_of().prior,
)


@pytest.mark.parametrize(
    ("posterior", "moves"),
    [
        (posterior_of(2.6 * AT_MEAN, prior=NARROW), ef.DEMCMove()),
        (posterior_of(HERTZ * [1.0, 8.0]), ef.DEMCMove()),
        (posterior_of(prior=WIDE), ef.DEMCMove()),
        (crossing(), ef.DEMCMove()),
        (DENSITY, ef.DEMCMove()),
        (DENSITY, "auto"),
    ],
    ids=["2.6 times", "one mode", "a wide prior", "paired", "no model", "none, auto"],
)
def test_what_is_no_matter_of_units_is_not_doubted(posterior, moves):
    assert doubts(posterior, moves=moves)[1] == []


@pytest.mark.slow
@pytest.mark.parametrize(
    ("model", "said"),
    [(in_newtons, "model 0.0035.*units"), (ignored, "^model: the same response")],
)
def test_annealing_and_emulating_doubt_too_also_when_they_go_on(model, said, tmp_path):
    posterior = posterior_of(AT_MEAN, model)
    file, found = {"backend": tmp_path / "annealing", "resume": True}, []
    for _ in range(2):
        with pytest.warns(UserWarning, match=said) as caught:
            found.append(ef.anneal(posterior, 40, seed=1, **file))
        assert [warning.filename for warning in caught] == [__file__]
    assert found[0].solves == found[1].solves
    np.testing.assert_array_equal(found[0].theta, found[1].theta)
    with pytest.warns(UserWarning, match=said) as caught:
        assert ef.emulate(posterior, 8, seed=1).solves == 8  # and none more
    assert [warning.filename for warning in caught] == [__file__]


@pytest.mark.slow
def test_an_emulators_first_design_tells_where_units_are_right_or_solves_fail():
    """Five emulators: priors that hold what was measured far from their mean."""
    high = independent(k1=stats.uniform(0.1, 1_200.0), k2=stats.uniform(0.1, 240.0))
    for prior in (None, WIDE, high):  # a warning would be an error
        ef.emulate(posterior_of(HERTZ, prior=prior), 8, seed=1)

    def partly(p):
        if p["k1"] > 55:
            raise ArithmeticError("no convergence")
        return in_newtons(p)

    with pytest.warns(UserWarning, match="units"):
        ef.emulate(posterior_of(HERTZ, partly), 8, seed=1, on_failure="reject")


@pytest.mark.parametrize(
    ("measured", "fit"), [(HERTZ, "fits"), (HERTZ * [1.0, 2.0], "does not fit")]
)
def test_a_population_has_statements_but_no_chains(measured, fit):
    posterior = posterior_of(measured)
    population = ef.anneal(posterior, 60, seed=1)
    found = ef.diagnose(ef.to_inference_data(population, posterior))
    assert statuses(found) == ("none", "searched", fit) and not found.converged
    assert statuses(ef.diagnose(population)) == ("none", "searched", "not checked")


@pytest.mark.parametrize(
    ("model", "bounds", "said"),
    [
        (lambda p: frequencies(p)[::-1], [(20, 90), (1, 15)], "PairedModel"),
        (frequencies, [(20, 90), (1, 9)], r"k2 = 10 .*\(1, 9\)"),
    ],
    ids=["another order of the modes", "prior mean out of bounds"],
)
def test_what_is_seen_of_the_first_solve_is_doubted(model, bounds, said):
    prior = ef.GaussianPrior(["k1", "k2"], [50, 10], [9, 3], bounds)
    (doubt,) = doubts(posterior_of(model=model, prior=prior), **DEMC)[1]
    assert re.search(said, doubt)


def test_the_first_solve_is_counted_once_and_changes_no_chain(tmp_path):
    """In a file too, whose run goes on; a solve that fails says nothing."""
    asked, options = [], {**DEMC, "nwalkers": 8, "ensembles": 1}

    def noted(p):
        asked.append(tuple(p.values()))
        return in_newtons(p)

    posterior = posterior_of(model=noted)
    memory, said = doubts(posterior, **options, steps=20)
    assert asked[0] == (50, 10) and memory.solves == len(asked)
    assert len(said) == 1 and posterior.initial[3] == pytest.approx(0.00356, rel=0.01)
    file = {"backend": tmp_path / "run"}
    _, first = doubts(posterior, **options, **file, steps=10)
    whole, second = doubts(posterior, **options, **file, steps=20, resume=True)
    assert first == second == said and whole.solves == memory.solves
    assert asked.count((50, 10)) == 2  # in memory, and by the first of both

    def fails_there(p):
        if p["k1"] == 50:
            raise ArithmeticError("no convergence")
        return in_newtons(p)

    failing, said = doubts(posterior_of(model=fails_there), **options, steps=20)
    assert said == []
    for run in (whole, failing):
        np.testing.assert_array_equal(run[0].get_chain(), memory[0].get_chain())


def test_a_table_solves_once_and_not_again_after_a_resumed_run(tmp_path):
    asked = []

    def counted(p):
        asked.append((p["k1"], p["k2"]))
        return frequencies(p)

    options = {**DEMC, "steps": 20, "backend": tmp_path / "run"}
    posterior = posterior_of(model=counted)
    run, _ = doubts(posterior, **options)
    again, _ = doubts(posterior, **options, resume=True)
    for each in (run, again):
        spent = len(asked)
        ef.parameter_table(each)
        ef.predictive_table(each)
        assert len(asked) == spent
        first = str(ef.frequency_table(each, posterior))
        assert str(ef.frequency_table(each, posterior)) == first
        assert len(asked) <= spent + 1  # at the mean of the parameters
    assert asked.count((50, 10)) == 1


def test_a_complaint_says_how_many_steps_mend_it():
    """Of an autoregressive chain tau is (1 + phi) / (1 - phi), and 25 are needed."""
    chains = [backend(ar1([0.8, 0.5], 350, 8, seed)) for seed in range(4)]
    said = ef.diagnose(chains, discard=200).chains
    assert said.status == "not converged" and "theta1" in said.sentence
    steps = int(re.findall(r"run ([\d,]+)", said.sentence)[-1].replace(",", ""))
    assert steps == pytest.approx(200 + 1.25 * 25 * 9, rel=0.2)
    longer = [backend(ar1([0.8, 0.5], steps, 8, seed)) for seed in range(4)]
    assert ef.diagnose(longer, discard=200).converged


def test_a_parameter_at_its_bound_is_named():
    prior = ef.GaussianPrior(["k1", "k2"], [50, 5], [9, 3], [(20, 90), (1, 6.9)])
    found = ef.diagnose(doubts(posterior_of(prior=prior), steps=150, **DEMC)[0]).fit
    assert found.status == "at a bound" and re.search("k2 .*6.9", found.sentence)


@pytest.mark.parametrize(
    ("off", "fit"),
    [([2.5], "fits"), ([6.0], "does not fit"), ([2.5, -2.5, 2.5], "does not fit")],
    ids=["one outside", "one far outside", "three outside"],
)
def test_of_ten_values_one_may_be_outside_but_not_far(off, fit):
    exact, z = np.arange(1.0, 11.0), np.zeros(10)
    z[2 : 2 + len(off)] = off
    prior = independent(k1=stats.norm(1, 1e-4), k2=stats.norm(1, 1e-4))
    model = ef.FunctionModel(lambda p: p["k1"] * p["k2"] * exact, n_modes=10)
    term = ef.FrequencyTerm(exact + 0.01 * z, sd=0.01)
    run = doubts(ef.LogPosterior(model, term, prior), **DEMC)[0]
    found = ef.diagnose(run).fit
    assert found.status == fit and f"{10 - len(off)} of 10" in found.sentence


def test_steps_that_are_dropped_say_nothing_of_the_fit(good):
    idata = ef.to_inference_data(good[0])
    for group in ("response", "new_measurement"):
        if group in idata:
            idata[group]["frequency"][:, :112] *= 2.0
    # Of 456 draws the last 8 are right, fewer than the 2.5 % below an interval.
    idata = idata.isel(draw=[*range(112)] * 4 + [*range(112, 120)])
    assert ef.diagnose(idata).fit.status == "does not fit"
    assert ef.diagnose(idata, 448).fit.status == "fits"


@pytest.mark.slow
def test_an_error_that_surprises_does_not_fit_though_it_covers_all():
    prior = ef.IndependentPrior(
        {"k1": stats.norm(50, 0.1), "k2": stats.norm(10, 0.02)}
        | {"error": stats.halfnorm(scale=0.02)}
    )
    run, _ = doubts(posterior_of(1.07 * AT_MEAN, prior=prior, discrepancy="error"))
    fit = ef.diagnose(run).fit
    assert fit.status == "does not fit" and "2 of 2" in fit.sentence
    assert "error" in fit.short


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
    if "discrepancy" in shape_error:
        laws["shape error"] = stats.halfnorm(scale=0.1)
    terms = [
        ef.FrequencyTerm(test, relative_sd=0.002, discrepancy="error"),
        ef.ShapeTerm(test, **shape_error),
    ]
    return ef.LogPosterior(model, terms, ef.IndependentPrior(laws))


@pytest.mark.slow
def test_a_term_that_is_outvoted_is_named_with_the_cure():
    """Fault 26: many ordinates, whose error is inferred, against few frequencies."""
    options = {**DEMC, "nwalkers": 16, "steps": 300}
    run = doubts(contradicted(discrepancy="shape error"), **options)[0]
    fit = ef.diagnose(run, 100).fit
    assert fit.status == "does not fit"
    assert re.search("60 .*'shape'.* 2 .*'frequency'.*sd=", fit.sentence)
    fixed = doubts(contradicted(delta=0.2), **options)[0]
    assert ef.diagnose(fixed, 100).fit.status == "fits"


@pytest.mark.slow
def test_parameters_that_follow_other_units_leave_the_fit_in_doubt(tmp_path):
    """Frequencies in rad/s, which lognormal factors can follow; said before the run."""
    posterior, path = posterior_of(2 * np.pi * AT_MEAN, factors, FACTORS), tmp_path
    options = {**DEMC, "steps": 150, "backend": path / "run"}
    run, (doubt,) = doubts(posterior, **options)
    idata = ef.to_inference_data(run, discard=100)
    stored = stored_and_read(idata, path / "run.nc")
    read = ef.to_inference_data(path / "run", posterior, 100)
    for source in (idata, read, stored):
        fit = ef.diagnose(source).fit
        assert fit.status == "doubtful" and doubt[:-1] in fit.sentence
    said = ef.identifiability(idata).findings
    assert any(text.startswith("k1 is +12.") for text in said)
    alone = ef.diagnose(path / "run").fit  # without the posterior
    assert alone.status == "not checked" and doubt[:-1] in alone.sentence


def test_a_parameter_that_moves_as_its_prior_allows_is_not_doubted():
    posterior = posterior_of(1.5 * AT_MEAN, factors, FACTORS)  # 2.7 sd
    run, said = doubts(posterior, steps=200, **DEMC)
    assert said == [] and ef.diagnose(run, 100).fit.status == "fits"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("error", "moves"),
    [("relative_sd", ef.DEMCMove()), ("relative_sd", "auto"), ("discrepancy", "auto")],
)
def test_a_model_that_ignores_its_parameters_is_doubted(error, moves):
    known = error == "relative_sd"  # else the likelihood varies
    laws = {} if known else {"error": stats.gamma(4, scale=0.005)}
    value = {error: 0.02 if known else "error"}
    posterior = posterior_of(AT_MEAN, ignored, independent(**laws), **value)
    run, (doubt,) = doubts(posterior, moves=moves)
    found = ef.diagnose(ef.to_inference_data(run)).fit
    assert doubt.startswith("model: the same response")
    assert found.status == "doubtful" and "same response" in found.sentence


def test_of_several_experiments_the_one_that_ignores_them_is_named():
    term = ef.FrequencyTerm(AT_MEAN, relative_sd=0.02)
    tests = {
        name: (ef.FunctionModel(model, n_modes=2), term)
        for name, model in {"empty": frequencies, "loaded": ignored}.items()
    }
    posterior = ef.LogPosterior.joint(tests, posterior_of().prior)
    (doubt,) = doubts(posterior, **DEMC)[1]
    assert doubt.startswith("loaded.model: ")


@pytest.mark.parametrize(
    ("law", "named"),
    [
        ({"error": stats.halfnorm(0.02)}, r"'error' .*halfnorm\(0.02\).*scale 1"),
        ({"error": stats.halfnorm(0, 1.0)}, "'error' .* 80 %|'error' .* 79.*%"),
        ({"error": stats.lognorm(0.02)}, "'error' .* 100 %"),
        ({"k1": stats.lognorm(0.2, 50)}, r"'k1' .*lognorm\(0.2, 50\).*scale 1"),
        ({"k1": stats.lognorm(0.2, 50, 1)}, ""),  # sd .22: 0.4 %, which may be meant
        ({"k1": stats.norm(-5e4, 0.2)}, "'k1' .* 4e-06"),
        ({"k1": stats.norm(0, 0.2)}, ""),
        ({"error": stats.halfnorm(scale=0.02)}, ""),
    ],
)
def test_slips_in_a_prior_are_doubted(law, named):
    error = {"discrepancy": "error"} if "error" in law else {}

    def model(p):
        return AT_MEAN * (1 + p["k1"] / 1e9)

    posterior = posterior_of(AT_MEAN, model, independent(**law), **error)
    run, warned = doubts(posterior, **DEMC, steps=20)
    slips = [text for text in warned if text.startswith("prior")]
    assert {*slips} <= {*run.doubts}
    assert len(slips) == bool(named) and all(re.search(named, text) for text in slips)


def test_draws_of_the_prior_have_no_burn_in(monkeypatch):
    """What is pressed against a bound is told by them, however much is left out."""
    monkeypatch.setattr("emcee_femu.results.groups.PRIOR_STORED", 200)
    model = ef.FunctionModel(lambda p: [p["k"] ** 0.5], n_modes=1)
    term = ef.FrequencyTerm([2.0], relative_sd=0.01)  # as of k = 4, out of bounds
    posterior = ef.LogPosterior(model, term, ef.IndependentPrior({"k": (6.0, 20.0)}))
    run = ef.run(posterior, ef.DEMCMove(), 16, 400, seed=1, ensembles=1)
    idata = ef.to_inference_data(run, discard=0)
    kept, left = (ef.diagnose(idata, discard).fit for discard in (150, 250))
    assert "pressed" in kept.sentence and "pressed" in left.sentence


@pytest.mark.parametrize("faulty", [lambda idata: idata["nothing"], lambda idata: "ok"])
def test_a_further_judge_that_fails_is_named_and_the_others_stay(faulty, monkeypatch):
    """Whether it raises or returns no statement: a long run is judged all the same."""
    run = ef.run(posterior_of(relative_sd=0.02), steps=60, ensembles=2, seed=1)
    before = str(ef.diagnose(run))
    monkeypatch.setitem(FURTHER, "Extra", faulty)
    after = ef.diagnose(run)
    assert after.further["Extra"].status == "not judged"
    assert str(after).startswith(before) and "Extra: not judged" in str(after)
    alone = ef.diagnose([backend(ar1([0.5], 100, 8, seed)) for seed in range(2)])
    assert alone.further["Extra"].status == "not judged"
    monkeypatch.setitem(FURTHER, "Fit", faulty)
    with pytest.raises(ValueError, match="FURTHER.*Fit"):
        str(ef.diagnose(run))


def test_a_file_that_others_wrote_is_called_that(tmp_path):
    file = tmp_path / "chain.h5"
    file.write_bytes(b"\x89HDF\r\n\x1a\n" + bytes(100))
    with pytest.raises(ValueError, match="HDF5.*HDFBackend"):
        ef.diagnose(file)


@pytest.mark.parametrize("from_prior", [0, HITS - 1, HITS, 100])
def test_a_search_by_few_climbs_claims_nothing_by_them(from_prior):
    """What it may have missed is less than one in so many, a whole number."""
    maxima = SimpleNamespace(
        importance=[1.0], climbs=(200, from_prior), searched=1_000, held=1
    )
    told = judge_search(maxima, OF_RUN).sentence
    shares = [int(n) for n in re.findall(r"1 in (\S+) (?:points|climbs)", told)]
    assert shares == [n // HITS for n in (1_000, from_prior) if n >= HITS]
