"""The likelihood of spectra, against scipy, Au's laws and calibration."""

import numpy as np
import pytest
from scipy import signal, stats
from support.ambient import draw_spectra, matrices, simulate, widely
from support.calibration import auto_ranks, p_values, shorten_search
from support.gradients import numerical

import emcee_femu as ef

RNG = np.random.default_rng(11)
LINES = np.array([0.93, 0.98, 1.0, 1.03, 1.06])
ONE = {"f": 1.0, "zeta": 0.03, "ln_S": -4.0, "ln_S_e": -2.0}
PAIR = {"f1": 0.99, "f2": 1.03, "zeta1": 0.02, "zeta2": 0.03, "ln_S1": -5.0}
PAIR |= {"ln_S2": -4.5, "ln_S_e": -2.0, "coherence_re": 0.3, "coherence_im": -0.5}


def blank(channels, lines=LINES, kind="acceleration"):
    D = np.tile(np.eye(channels), (len(lines), 1, 1))
    return ef.spectra.Spectra(lines, D, averages=1, kind=kind)


def problem(n_modes, channels, kind="acceleration", averages=3):
    """Return model, spectra of the law, and five parameter sets near the truth."""
    model = ef.spectra.SpectrumModel(blank(channels, kind=kind), n_modes)
    truth = dict.fromkeys(model.names, 0.4) | (ONE if n_modes == 1 else PAIR)
    truth |= {"phi2_s2": -0.7} if n_modes == 2 and channels > 1 else {}
    truth = {name: truth[name] for name in model.names}
    measured = draw_spectra(RNG, model, truth, LINES, averages, kind)
    theta = np.array([*truth.values()]) * (1 + 0.02 * RNG.standard_normal((5, 1)))
    if n_modes == 2:  # ascending
        theta[:, 0] = np.minimum(theta[:, 0], 1.0)
    return model, measured, theta


def evaluate(model, measured, theta):
    parameters = dict(zip(model.names, theta.T, strict=True))
    return ef.spectra.SpectrumTerm(measured)(parameters, model(parameters))


CASES = [(1, 1), (1, 3), (2, 1), (2, 2), (2, 4)]


@pytest.mark.parametrize("kind", ["acceleration", "velocity", "displacement"])
@pytest.mark.parametrize(("n_modes", "channels"), CASES)
def test_values_are_those_of_real_and_imaginary_parts(n_modes, channels, kind):
    model, _, theta = problem(n_modes, channels, kind)
    F = RNG.standard_normal((3, len(LINES), channels, 2)) @ [1, 1j]
    D = np.einsum("skc,skd->kcd", F, F.conj()) / 3
    measured = ef.spectra.Spectra(LINES, D, averages=3, kind=kind)
    found = evaluate(model, measured, theta)
    E = matrices(model(dict(zip(model.names, theta.T, strict=True))), LINES, kind)
    by_hand = np.zeros(5)
    for i, k in np.ndindex(5, len(LINES)):
        own = E[i, k]
        both = 0.5 * np.block([[own.real, -own.imag], [own.imag, own.real]])
        law = stats.multivariate_normal(np.zeros(2 * channels), both)
        by_hand[i] += law.logpdf(np.hstack([F[:, k].real, F[:, k].imag])).sum()
    np.testing.assert_allclose(found, by_hand, rtol=1e-10)


@pytest.mark.parametrize(("n_modes", "channels"), CASES)
def test_gradient_and_information(n_modes, channels):
    """Against differences, and tr(E^-1 dE E^-1 dE) with whole matrices."""
    model, measured, theta = problem(n_modes, channels, "velocity")
    ranges = {name: (-9.0, 9.0) for name in model.names}
    ranges |= {name: (0.0, 9.0) for name in model.bounds}
    post = ef.LogPosterior(
        model, ef.spectra.SpectrumTerm(measured), ef.IndependentPrior(ranges)
    )
    assert post.names == model.names
    found = post.linearize(theta)
    expected = numerical(lambda at: post(at)[:, 0], theta, 1e-6)
    scale = np.abs(expected).max()
    np.testing.assert_allclose(found.gradient, expected, rtol=1e-5, atol=1e-6 * scale)

    def covariance(at):
        return matrices(
            model(dict(zip(model.names, at.T, strict=True))), LINES, "velocity"
        )

    E, step = covariance(theta[:1])[0], 1e-5
    slopes = [
        (covariance(theta[:1] + u)[0] - covariance(theta[:1] - u)[0]) / (2 * step)
        for u in step * np.eye(len(model.names))
    ]
    turned = [np.linalg.solve(E, dE) for dE in slopes]
    fisher = [[3 * np.einsum("kij,kji->", a, b).real for b in turned] for a in turned]
    sd = np.sqrt(np.diag(fisher))
    np.testing.assert_allclose(
        found.information[0] / np.outer(sd, sd), fisher / np.outer(sd, sd), atol=1e-6
    )


@pytest.mark.parametrize("power", range(3))
def test_the_response_is_that_of_an_oscillator_by_state_space(power):
    """By scipy; of one sensor ln p = -ln(pi E) - D / E, E = S |h|^2 + S_e."""
    w, zeta = 2 * np.pi * 1.02, 0.03
    _, X = signal.freqs([1.0], [1.0, 2 * zeta * w, w * w], 2 * np.pi * LINES)
    kind = ["displacement", "velocity", "acceleration"][power]
    measured = blank(1, kind=kind)
    modes = {"frequency": np.array([[1.02]]), "damping_ratio": np.array([[zeta]])}
    modes |= {"shapes": np.ones((1, 1, 1)), "noise_psd": np.array([1e-3])}
    modes |= {"force_psd": np.array([[[[2.0, 0.0]]]])}
    E = 2.0 * np.abs(X * (2j * np.pi * LINES) ** power) ** 2 + 1e-3
    exact = -measured.averages * (np.log(np.pi * E) + measured.psd[:, 0] / E).sum()
    found = ef.spectra.SpectrumTerm(measured)({}, modes)
    np.testing.assert_allclose(found, exact, rtol=1e-12)


def long_data_laws(zeta, periods, kappa):
    """Return Au's c.o.v. of frequency and damping ratio for long data."""
    angle, part = np.arctan(kappa), kappa / (kappa**2 + 1)
    by_f = 2 / np.pi * (angle - part)
    by_zeta = 2 / np.pi * (angle + part - 2 * angle**2 / kappa)
    return (
        np.sqrt(zeta / (2 * np.pi * periods * by_f)),
        np.sqrt(1 / (2 * np.pi * zeta * periods * by_zeta)),
    )


LONG = np.arange(940, 1061) / 1_000  # 1,000 periods of 1 Hz, six half widths


@pytest.mark.parametrize("channels", [1, 3])
def test_the_information_is_that_of_the_long_data_laws(channels):
    """Au (2014), Mech. Syst. Signal Process. 48, 15-33: high signal.

    One channel cannot tell noise from the flanks, so that it has to be known there.
    """
    model = ef.spectra.SpectrumModel(blank(channels, LONG))
    truth = {"f": 1.0, "zeta": 0.01, "ln_S": 0.0, "ln_S_e": -7.0}
    truth |= {"phi_s2": 0.5, "phi_s3": -0.7}
    wide = {name: (-40.0, 9.0) for name in model.names}
    wide |= {name: (0.0, 9.0) for name in ("f", "zeta")}
    post = ef.LogPosterior(
        model, ef.spectra.SpectrumTerm(blank(channels, LONG)), ef.IndependentPrior(wide)
    )
    at = np.array([[truth[name] for name in post.names]])
    information = post.linearize(at).information[0]
    known = -1 if channels == 1 else len(post.names)
    assert post.names[-1] == "ln_S_e"
    sd = np.sqrt(np.diag(np.linalg.inv(information[:known, :known])))
    law = np.array(long_data_laws(0.01, 1_000, 6))
    np.testing.assert_allclose(sd[:2], law * [1.0, 0.01], rtol=0.005)


def sample(spectra, n_modes=1, seed=1, reference=None, steps=100):
    model = ef.spectra.SpectrumModel(spectra, n_modes, reference=reference)
    post = ef.LogPosterior(model, ef.spectra.SpectrumTerm(spectra), widely(model))
    return ef.run(post, "auto", steps=steps, ensembles=1, seed=seed), post


def test_a_simulated_oscillator_is_found():
    rng = np.random.default_rng(5)
    shapes = [[0.8], [0.6], [0.0]]
    record, rate = simulate(rng, 1.0, 0.01, 1e-4, shapes, 1e-5, 1_000)
    samplers, post = sample(ef.spectra.Spectra.from_record(record, rate, (0.94, 1.06)))
    draws = samplers[0].get_chain(flat=True)
    mean, sd = draws.mean(axis=0), draws.std(axis=0)
    truth = {"f": 1.0, "zeta": 0.01, "ln_S": np.log(1e-4), "ln_S_e": np.log(1e-5)}
    truth |= {"phi_s2": 0.75, "phi_s3": 0.0}
    z = (mean - [truth[name] for name in post.names]) / sd
    assert np.abs(z).max() < 3.5
    cov = dict(zip(post.names, sd / np.abs(mean), strict=True))
    law = long_data_laws(0.01, 1_000, 6)
    assert 0.75 < cov["f"] / law[0] < 1.35 and 0.75 < cov["zeta"] / law[1] < 1.35


def test_impossible_pairs_have_no_likelihood():
    model, measured, theta = problem(2, 2)
    names = [*model.names]
    wrong = theta.copy()
    wrong[0, names.index("f1")] = 1.2
    wrong[1, names.index("coherence_im")] = -0.96
    found = evaluate(model, measured, wrong)
    assert (found[:2] == -np.inf).all() and np.isfinite(found[2:]).all()


PRIOR = ef.GaussianPrior(  # 100 s of 1 Hz, two channels
    ["f", "zeta", "ln_S", "phi_s2", "ln_S_e"],
    [1.0, 0.02, -4.0, 0.0, -1.0],
    [0.01, 0.006, 0.5, 0.4, 0.5],
    [(0.95, 1.05), (0.004, 0.04), (-6.0, -2.0), (-1.0, 1.0), (-3.0, 1.0)],
)
SHORT = np.arange(86, 115) / 100


def simulated(rng, stated=2):
    """Return the posterior of a simulated data set, and the truth ``(1, 5)``."""
    truth = PRIOR.sample(rng, 1)
    model = ef.spectra.SpectrumModel(blank(2, SHORT), reference="s1")
    values = dict(zip(PRIOR.names, truth[0], strict=True))
    measured = draw_spectra(rng, model, values, SHORT, averages=2)
    told = ef.spectra.Spectra(SHORT, measured.matrices, averages=stated)
    return ef.LogPosterior(model, ef.spectra.SpectrumTerm(told), PRIOR), truth


LEVEL = 0.001 / 6


@pytest.mark.slow
def test_the_truth_ranks_uniformly_among_the_draws(monkeypatch):
    shorten_search(monkeypatch)
    assert p_values(auto_ranks(simulated, 48, seed=41)).min() > LEVEL


@pytest.mark.slow
def test_ranks_with_lines_counted_twice_are_not_uniform(monkeypatch):
    shorten_search(monkeypatch)
    found = auto_ranks(lambda rng: simulated(rng, 4), 24, seed=42)
    assert p_values(found).min() < LEVEL


@pytest.mark.slow
def test_two_close_modes_and_the_coherence_of_their_forces():
    rng = np.random.default_rng(3)
    shapes = [[0.8, 0.6], [0.6, -0.8], [0.0, 0.2]]
    record, rate = simulate(
        rng,
        [1.0, 1.03],
        [0.01, 0.012],
        [1e-4, 2e-4],
        shapes,
        1e-5,
        1_000,
        10.0,
        0.4 + 0.3j,
    )
    spectra = ef.spectra.Spectra.from_record(record, rate, (0.94, 1.09))
    samplers, post = sample(spectra, 2, reference=["s1", "s2"], steps=40)
    draws = samplers[0].get_chain(flat=True)
    length = np.linalg.norm([0.6, -0.8, 0.2])  # of the simulated shape
    truth = {"f1": 1.0, "f2": 1.03, "zeta1": 0.01, "zeta2": 0.012, "phi1_s2": 0.75}
    truth |= {"ln_S1": np.log(1e-4), "ln_S2": np.log(2e-4 * length**2), "phi1_s3": 0.0}
    truth |= {"phi2_s1": -0.75, "phi2_s3": -0.25, "ln_S_e": np.log(1e-5)}
    truth |= {"coherence_re": -0.4, "coherence_im": -0.3}  # s2 is up, not down
    z = (draws.mean(axis=0) - [truth[k] for k in post.names]) / draws.std(axis=0)
    assert np.abs(z).max() < 3.7
