import numpy as np
import pytest
from scipy import integrate, stats

import emcee_femu as ef
from emcee_femu import Measurements
from emcee_femu.interfaces import ModalSolution
from emcee_femu.likelihoods.frequency import FrequencyTerm
from emcee_femu.posterior.priors import GaussianPrior

MEASURED = np.array([3.18, 28.54, 1.1e3, 5e-3])
BETA = np.array([10.0, 6.8e5, 1e4, 1.0])
RNG = np.random.default_rng(5)
PREDICTED = MEASURED * (1 + 0.02 * RNG.standard_normal((20, 4)))


@pytest.mark.parametrize("beta", [6.8e5, 10.0, BETA], ids=["paper", "weak", "per mode"])
@pytest.mark.parametrize("given", ["beta", "relative_sd"])
def test_term_is_the_normal_density_of_the_frequencies(beta, given):
    value = beta if given == "beta" else beta**-0.5
    term = FrequencyTerm(MEASURED, **{given: value})
    expected = stats.norm.logpdf(PREDICTED, MEASURED, MEASURED / np.sqrt(beta))
    result = term({}, ModalSolution(PREDICTED))
    assert result.shape == (20,)
    np.testing.assert_allclose(result, expected.sum(axis=1), rtol=1e-12)


def test_beta_and_relative_sd_say_the_same():
    modes = ModalSolution(PREDICTED)
    by_beta = FrequencyTerm(MEASURED, beta=BETA)
    by_sd = FrequencyTerm(MEASURED, relative_sd=BETA**-0.5)
    np.testing.assert_allclose(by_sd.beta, BETA, rtol=1e-15)
    np.testing.assert_allclose(by_sd({}, modes), by_beta({}, modes), rtol=1e-13)


@pytest.mark.parametrize("beta", [4.0, [2.5e3, 4e4]])
def test_likelihood_of_two_modes_integrates_to_one_over_the_frequencies(beta):
    measured = np.array([3.0, 50.0])
    term = FrequencyTerm(measured, beta=beta)
    x, step = np.linspace(-9, 9, 401, retstep=True)  # trapezoid: spectrally accurate
    sd = measured / np.sqrt(beta)
    first, second = np.meshgrid(*(measured[:, None] + sd[:, None] * x), indexing="ij")
    predicted = np.column_stack([first.ravel(), second.ravel()])
    total = np.exp(term({}, ModalSolution(predicted))).sum() * step**2 * sd.prod()
    assert total == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize("n", [1, 3])
def test_the_lowest_modes_are_compared_when_the_model_returns_more(n):
    term = FrequencyTerm(MEASURED[:n], beta=BETA[:n])
    assert term.n_modes == n
    all_modes = term({}, ModalSolution(PREDICTED))
    lowest = term({}, ModalSolution(PREDICTED[:, :n]))
    np.testing.assert_array_equal(all_modes, lowest)
    density = stats.norm.logpdf(PREDICTED, MEASURED, MEASURED / np.sqrt(BETA))[:, :n]
    np.testing.assert_allclose(all_modes, density.sum(axis=1), rtol=1e-12)


def test_more_measured_modes_than_the_model_returns_are_refused():
    term = FrequencyTerm(MEASURED, beta=1.0)
    with pytest.raises(ValueError, match="4 modes were measured.*returned 3"):
        term({}, ModalSolution(PREDICTED[:, :3]))


@pytest.mark.parametrize("n_modes", [2, 7, 8, 9, 40])
@pytest.mark.parametrize("order", "CF")
def test_a_row_has_the_same_bits_alone_and_in_a_batch(n_modes, order):
    measured = np.linspace(1.0, 9.0, n_modes)
    batch = measured * (1 + 0.1 * RNG.standard_normal((50, n_modes)))
    term = FrequencyTerm(measured, beta=1e3)
    alone = [term({}, ModalSolution(row[None]))[0] for row in batch]
    together = term({}, ModalSolution(np.array(batch, order=order)))
    np.testing.assert_array_equal(together, alone)


def test_a_nan_frequency_stays_nan():
    result = FrequencyTerm([1.0, 2.0], beta=1.0)(
        {}, ModalSolution(np.array([[1.0, np.nan], [1.0, 2.0]]))
    )
    assert np.isnan(result[0]) and np.isfinite(result[1])


def test_arguments_are_copied_and_the_name_is_kept():
    measured, beta = MEASURED.copy(), BETA.copy()
    term = FrequencyTerm(measured, beta=beta, name="run 2")
    measured += 1.0
    beta += 1.0
    np.testing.assert_array_equal(term.measured, MEASURED)
    np.testing.assert_array_equal(term.beta, BETA)
    assert term.name == "run 2"
    assert FrequencyTerm([1.0], beta=1.0).name == "frequency"


@pytest.mark.parametrize(
    ("measured", "options", "error", "message"),
    [
        ([1.0, np.nan], {"beta": 1.0}, ValueError, r"measured: .*nan at index \(1,\)"),
        ([1.0, np.inf], {"beta": 1.0}, ValueError, r"measured: .*inf at index \(1,\)"),
        ([1.0, 0.0], {"beta": 1.0}, ValueError, r"measured: .*0.0 at index \(1,\)"),
        ([-1.0, 2.0], {"beta": 1.0}, ValueError, r"measured: .*-1.0 at index \(0,\)"),
        ([], {"beta": 1.0}, ValueError, "measured: expected at least one"),
        (5.0, {"beta": 1.0}, ValueError, "measured: expected 1 dimension"),
        ([[1.0, 2.0]], {"beta": 1.0}, ValueError, "measured: expected 1 dimension"),
        (["1", "2"], {"beta": 1.0}, TypeError, "measured: expected real numbers"),
        ([1.0, 2.0], {}, TypeError, "beta, relative_sd, sd.*exactly one"),
        ([1.0, 2.0], {"beta": 1.0, "relative_sd": 1.0}, TypeError, "exactly one"),
        ([1.0, 2.0], {"beta": [1.0]}, ValueError, "beta: .*2 modes"),
        ([1.0, 2.0], {"relative_sd": [1.0] * 3}, ValueError, "relative_sd: .*2 modes"),
        ([1.0, 2.0], {"beta": 0.0}, ValueError, "beta: expected numbers above zero"),
        ([1.0, 2.0], {"beta": [1.0, -2.0]}, ValueError, r"beta: .*-2.0 at index \(1,"),
        ([1.0, 2.0], {"beta": np.nan}, ValueError, "beta: expected finite"),
        ([1.0, 2.0], {"relative_sd": 0.0}, ValueError, "relative_sd: .*above zero"),
        ([1.0, 2.0], {"relative_sd": -0.1}, ValueError, "relative_sd: .*above zero"),
        ([1.0, 2.0], {"relative_sd": True}, TypeError, "relative_sd: expected real"),
        ([1.0, 2.0], {"sd": [1.0, 2.0, 3.0]}, ValueError, "sd: .*2 modes"),
        ([1.0, 2.0], {"sd": 0.0}, ValueError, "sd: expected numbers above zero"),
        ([1.0, 2.0], {"covariance": np.eye(3)}, ValueError, r"covariance: .*\(2, 2\)"),
        ([1.0, 2.0], {"covariance": [[1, 2], [0, 1]]}, ValueError, "symmetric"),
        ([1.0, 2.0], {"covariance": [[1, 2], [2, 1]]}, ValueError, "positive definite"),
        ([1.0, 2.0], {"covariance": [[1, 1], [1, 1]]}, ValueError, "more of them than"),
        ([1.0, 2.0], {"covariance": np.eye(2), "sd": 1.0}, TypeError, "exactly one"),
        ([1.0, 2.0], {"discrepancy": ""}, TypeError, "discrepancy: expected a non-"),
        ([1.0, 2.0], {"discrepancy": 0.1}, TypeError, "discrepancy: expected a non-"),
        ([1.0, 2.0], {"beta": 1.0, "name": ""}, TypeError, "name: "),
        ([1.0, 2.0], {"beta": 1.0, "name": 3}, TypeError, "name: "),
    ],
)
def test_term_refuses(measured, options, error, message):
    with pytest.raises(error, match=message):
        FrequencyTerm(measured, **options)


@pytest.mark.parametrize("beta", [1e2, [1e4, 4e2, 25.0]])
@pytest.mark.parametrize(("mean", "sd"), [(0.0, 0.1), (0.3, 0.02)])
def test_evidence_of_a_linear_model_is_the_closed_form_gaussian(beta, mean, sd):
    # f = f0 (1 + theta), theta ~ N(mean, sd^2), errors N(0, fm^2 / beta):
    # marginally fm ~ N(f0 (1 + mean), sd^2 f0 f0^T + diag(fm^2 / beta)).
    f0, measured = np.array([10.0, 25.0, 60.0]), np.array([10.5, 25.2, 66.0])
    term = FrequencyTerm(measured, beta=beta)
    prior = GaussianPrior(["theta"], [mean], sd)
    noise = np.diag(measured**2 / beta)
    exact = stats.multivariate_normal.pdf(
        measured, f0 * (1 + mean), noise + sd**2 * np.outer(f0, f0)
    )

    def density(value):
        theta = np.array([[value]])
        modes = ModalSolution(f0 * (1 + theta))
        return np.exp(prior.logpdf(theta) + term({"theta": theta[:, 0]}, modes))[0]

    ends = mean - 12 * sd, mean + 12 * sd
    evidence, _ = integrate.quad(
        density, *ends, points=[0.0, 0.05, mean], epsabs=0, epsrel=1e-10, limit=200
    )
    assert evidence == pytest.approx(exact, rel=1e-9)


ORDER = np.argsort(MEASURED)  # Measurements are ascending


def in_order(**options):
    return Measurements(MEASURED[ORDER], **options)


def logpdf(covariance, predicted):
    """Return the multivariate normal density, in relative units for its accuracy."""
    relative = covariance / np.outer(MEASURED, MEASURED)
    density = stats.multivariate_normal(np.ones(4), relative)
    return density.logpdf(predicted / MEASURED) - np.log(MEASURED).sum()


def test_standard_deviations_in_hertz():
    sd = np.array([0.01, 0.2, 3.0, 1e-4])
    expected = stats.norm.logpdf(PREDICTED, MEASURED, sd).sum(axis=1)
    found = FrequencyTerm(MEASURED, sd=sd)({}, ModalSolution(PREDICTED))
    np.testing.assert_allclose(found, expected, rtol=1e-11)
    ordered = FrequencyTerm(in_order(sd=sd[ORDER]))
    found = ordered({}, ModalSolution(PREDICTED[:, ORDER]))
    np.testing.assert_allclose(found, expected, rtol=1e-11)


def random_covariance(seed=1):
    factor = np.random.default_rng(seed).normal(size=(4, 4)) + 2 * np.eye(4)
    scale = 0.01 * MEASURED
    return scale[:, None] * (factor @ factor.T) * scale


def test_a_covariance_is_the_multivariate_normal_density():
    C = random_covariance()
    expected = logpdf(C, PREDICTED)
    found = FrequencyTerm(MEASURED, covariance=C)({}, ModalSolution(PREDICTED))
    np.testing.assert_allclose(found, expected, rtol=1e-9)
    ordered = FrequencyTerm(in_order(covariance=C[np.ix_(ORDER, ORDER)]))
    found = ordered({}, ModalSolution(PREDICTED[:, ORDER]))
    np.testing.assert_allclose(found, expected, rtol=1e-9)


@pytest.mark.parametrize("given", ["nothing", "relative_sd", "covariance"])
def test_a_discrepancy_adds_its_variance_to_every_mode(given):
    C = {
        "nothing": np.zeros((4, 4)),
        "relative_sd": np.diag((0.01 * MEASURED) ** 2),
        "covariance": random_covariance(),
    }[given]
    value = {"relative_sd": 0.01, "covariance": C}.get(given)
    options = {} if given == "nothing" else {given: value}
    term = FrequencyTerm(MEASURED, discrepancy="sigma", **options)
    assert term.names == term.positive == ("sigma",)
    sigma = np.linspace(0.005, 0.1, 20)
    found = term({"sigma": sigma}, ModalSolution(PREDICTED))
    for row in range(20):
        exact = logpdf(C + np.diag((sigma[row] * MEASURED) ** 2), PREDICTED[row])
        np.testing.assert_allclose(found[row], exact, rtol=1e-9)


def test_rows_are_the_same_to_the_bit_alone_and_in_a_batch():
    for options in ({"covariance": random_covariance()}, {"beta": 10.0}):
        term = FrequencyTerm(MEASURED, discrepancy="s", **options)
        sigma = np.linspace(0.01, 0.1, 20)
        whole = term({"s": sigma}, ModalSolution(PREDICTED))
        for i in range(20):
            one = term({"s": sigma[[i]]}, ModalSolution(PREDICTED[[i]]))
            assert one[0] == whole[i]


def test_what_is_said_beats_what_the_measurements_hold():
    test = in_order(sd=0.1 * MEASURED[ORDER])
    term = FrequencyTerm(test, relative_sd=0.02)
    np.testing.assert_allclose(term.beta, 0.02**-2)
    with pytest.raises(TypeError, match="exactly one"):
        FrequencyTerm(in_order())


def test_an_inferred_discrepancy_has_the_posterior_of_quadrature():
    # Two parameters: a common factor of three frequencies, and the discrepancy.
    measured = np.array([10.0, 20.0, 33.0])
    prior = ef.IndependentPrior(
        {"factor": stats.norm(1, 0.1), "sigma": stats.halfnorm(scale=0.05)}
    )
    term = FrequencyTerm(measured, relative_sd=0.002, discrepancy="sigma")
    model = ef.FunctionModel(
        lambda p: p["factor"] * np.array([10, 20.5, 32]), n_modes=3
    )
    posterior = ef.LogPosterior(model, term, prior)
    factor, sigma = np.linspace(0.85, 1.15, 601), np.linspace(1e-4, 0.25, 800)
    residuals = factor[:, None] * np.array([10, 20.5, 32]) / measured - 1
    sd = np.sqrt(0.002**2 + sigma**2)
    weight = stats.norm.pdf(residuals[:, None], 0, sd[None, :, None]).prod(axis=2)
    weight *= stats.norm.pdf(factor, 1, 0.1)[:, None]
    weight *= stats.halfnorm.pdf(sigma, scale=0.05)
    weight /= weight.sum()
    (sampler,) = ef.run(posterior, nwalkers=24, nsteps=2_000, seed=4)
    draws = sampler.get_chain(discard=300)
    error = draws.mean(axis=1).std(axis=0) * np.sqrt(40 / len(draws))  # tau below 40
    exact = [weight.sum(axis=1) @ factor, weight.sum(axis=0) @ sigma]
    assert (np.abs(draws.mean(axis=(0, 1)) - exact) < 4 * error).all()
    assert (error < 0.05 * np.array([0.02, 0.02])).all()


@pytest.mark.parametrize("kind", ["relative_sd", "covariance"])
@pytest.mark.parametrize("discrepancy", [None, "error"])
def test_replicates_have_the_covariance_of_all_errors(kind, discrepancy):
    measured = np.array([3.0, 8.0, 9.0])
    C = np.array([[0.04, 0.05, 0.01], [0.05, 0.25, 0.1], [0.01, 0.1, 0.36]])
    given = {"covariance": C, "relative_sd": [0.1, 0.05, 0.02]}[kind]
    term = FrequencyTerm(measured, **{kind: given}, discrepancy=discrepancy)
    expected = C if kind == "covariance" else np.diag((measured * given) ** 2)
    n, parameters = 40_000, {"error": np.full(40_000, 0.08)}
    if discrepancy:
        expected = expected + np.diag((0.08 * measured) ** 2)
    stored = {"frequency": np.tile([2.0, 7.0, 9.5, 11.0], (n, 1))}
    drawn = term.replicate(np.random.default_rng(1), parameters, stored)["frequency"]
    assert drawn.shape == (n, 3)
    sd = np.sqrt(np.diag(expected) / n)
    spread = 5 * np.sqrt(2 * n) * np.outer(sd, sd)
    assert (np.abs(np.cov(drawn.T) - expected) < spread).all()
    assert (
        np.abs(drawn.mean(axis=0) - [2, 7, 9.5]) < 5 * np.sqrt(np.diag(expected) / n)
    ).all()
    factors = term.pointwise(parameters, stored)
    if kind == "covariance":
        assert factors is None
    else:
        total = term(parameters, stored)
        np.testing.assert_allclose(factors["frequency"].sum(axis=1), total, rtol=1e-12)
