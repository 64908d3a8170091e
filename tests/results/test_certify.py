"""Certificates of emulated posteriors, against Gaussians of which all is known."""

import dataclasses
import sys
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from scipy import stats
from support.chains import ar1
from support.emulated_gaussians import (
    COVARIANCE,
    NEAR,
    SHIFTED,
    TRUE,
    LogGaussian,
    draws,
    posterior,
    sampled,
)
from support.free_posterior import box, free_posterior

import emcee_femu as ef


def certify(emulated, true=TRUE, n=4_000, seed=3, solves=100, phi=0.0, **options):
    """Return the certificate of an emulated Gaussian."""
    idata = sampled(posterior(emulated), draws(emulated, n, seed, phi))
    true = posterior(true) if isinstance(true, LogGaussian) else true
    return ef.certify(idata, true, solves, seed=seed, **options)


@pytest.mark.slow
@pytest.mark.parametrize(("emulated", "phi"), [(NEAR, 0.8), (SHIFTED, 0.0)])
def test_moments_are_the_exact_ones_and_errors_are_honest(emulated, phi):
    found = [certify(emulated, n=3_000, seed=s, solves=180, phi=phi) for s in range(30)]
    z = np.array(
        [[*(c.mean / c.mean_error), *((c.sd - 1) / c.sd_error)] for c in found]
    )
    assert (np.abs(z.mean(axis=0)) < 4.5 / np.sqrt(len(z))).all()
    # All six together: the mean square of a z-score is 1.
    assert 0.6 < (z**2).mean() < 1.45


@pytest.mark.slow
def test_the_error_of_a_standard_deviation_is_that_about_the_true_mean():
    """Far from the emulated one, about which squares would scatter more."""
    moved, true = (LogGaussian(np.full(1, at), np.eye(1)) for at in (0.8, 0.0))
    found = [certify(moved, true, seed=seed, solves=300) for seed in range(60)]
    z = [(c.sd[0] - 1) / c.sd_error[0] for c in found]
    assert 0.65 < np.mean(np.square(z)) < 1.5


@pytest.mark.slow
def test_a_variance_is_never_below_zero():
    """Of a wide chain, corrected by what the weights of some draws leave of theirs."""
    wide, true = (LogGaussian(np.zeros(1), v * np.eye(1)) for v in (1.0, 0.01))
    theta, below = draws(wide, 3_000, 1), 0
    idata = sampled(posterior(wide), theta)
    for seed in range(6):
        found = ef.certify(idata, posterior(true), 800, seed=seed)
        square = (found.theta[:, 0] - theta.mean()) ** 2
        below += theta.var() + (found.weights - 1) @ square / len(square) < 0
        assert found.short == "corrected" and found.sd[0] > 0
    assert 0 < below < 6


def test_where_all_weights_are_equal_moments_are_those_of_the_whole_chain():
    theta = draws(TRUE, 8_000, 1)
    found = ef.certify(sampled(posterior(TRUE), theta), posterior(TRUE), 75, seed=1)
    np.testing.assert_allclose(found.mean, theta.mean(axis=0), atol=1e-12)
    np.testing.assert_allclose(found.sd, theta.std(axis=0), rtol=1e-3)
    np.testing.assert_allclose(found.mean_error, 8_000**-0.5, rtol=0.1)


def test_errors_are_those_of_the_chain_whose_squares_forget_sooner():
    n, phi = 20_000, 0.9
    found = [certify(TRUE, n=n, seed=seed, phi=phi) for seed in range(3)]
    of_mean = np.sqrt((1 + phi) / (1 - phi) / n)
    of_sd = np.sqrt((1 + phi**2) / (1 - phi**2) / (2 * n))
    errors = np.mean([[c.mean_error, c.sd_error] for c in found], axis=(0, 2))
    np.testing.assert_allclose(errors, [of_mean, of_sd], rtol=0.15)


def test_the_variance_is_that_about_a_mean_which_few_draws_know():
    """Where all weights are equal a sample variance, which divides by n - 1."""
    ratios = []
    for seed in range(8):
        found, theta = certify(TRUE, n=40, seed=seed, solves=10), draws(TRUE, 40, seed)
        ratios.append(found.sd**2 / theta.var(axis=0))
    np.testing.assert_allclose(np.mean(ratios), 40 / 39, atol=0.01)


def test_draws_that_repeat_one_another_tell_no_more():
    law = LogGaussian(np.array([0.8, 0.4, -0.6]), COVARIANCE)
    once = draws(law, 100, 1)
    jitter = 1e-9 * np.random.default_rng(1).normal(size=(1_000, 3))
    often = np.repeat(once, 10, axis=0) + jitter  # so that each is solved
    few, many = (
        ef.certify(sampled(posterior(law), theta), posterior(TRUE), solves, seed=1)
        for theta, solves in ((once, 130), (often, 1_030))
    )
    assert len(many.theta) == 10 * len(few.theta) == 1_000
    for ratio in (many.mean_error / few.mean_error, many.sd_error / few.sd_error):
        np.testing.assert_allclose(ratio, 1.0, atol=0.4)


def test_efficiency_and_weights_are_those_of_the_law():
    moved = LogGaussian(np.array([0.5, 0.0, 0.0]), np.eye(3))
    law = LogGaussian(np.zeros(3), np.eye(3), 40.0)
    found = certify(moved, law, n=8_000, solves=1_500)
    assert found.efficiency == pytest.approx(np.exp(-(0.5**2)), abs=0.04)
    assert found.weights.mean() == pytest.approx(1.0)
    expected = np.exp(law(found.theta) - moved(found.theta))
    bulk = found.weights < np.quantile(found.weights, 0.9)  # the tail is smoothed
    ratio = found.weights[bulk] / expected[bulk]
    np.testing.assert_allclose(ratio, ratio[0], rtol=1e-3)
    assert np.ptp(found.weights / expected) > 1e-3 * ratio[0]


def test_draws_are_spread_evenly_and_count_as_often_as_they_were_met():
    flat = free_posterior(lambda theta: np.zeros(len(theta)), box(-9.0, 9.0, 2))
    rng = np.random.default_rng(1)
    walk = np.column_stack([np.linspace(-8.0, 8.0, 1_000), rng.uniform(-8, 8, 1_000)])
    steps = np.diff(ef.certify(sampled(flat, walk), flat, 60, seed=1).theta[:, 0])
    assert 0 < steps.min() and np.ptp(steps) < 1.01 * 16 / 999
    still = np.repeat(walk[::25], np.tile([1, 9], 20), axis=0)
    found = ef.certify(sampled(flat, still), flat, 400, seed=1)
    assert len(np.unique(found.theta, axis=0)) == len(found.theta) == 40
    np.testing.assert_allclose(found.weights, np.tile([0.2, 1.8], 20))


def test_a_shifted_one_is_corrected_by_its_weights():
    found = certify(SHIFTED, solves=200)
    assert found.short == "corrected" and "weights correct" in found.verdict
    z = (found.mean - TRUE.mean) / found.mean_error
    assert np.abs(z).max() < 4
    weighted = found.weights @ found.theta / len(found.weights)
    assert np.abs(weighted).max() < np.abs(SHIFTED.mean).max()


FAR = LogGaussian(np.array([1.6, 0.0, 0.0]), COVARIANCE)
NARROW = LogGaussian(np.zeros(3), 0.15 * COVARIANCE)


@pytest.mark.parametrize("emulated", [FAR, NARROW], ids=["far", "narrow"])
def test_a_poor_one_is_refused_with_a_remedy(emulated):
    found = certify(emulated)
    assert found.short == "refused"
    assert "emulate" in found.verdict
    assert f"Pareto k {found.pareto_k:.2f}" in found.verdict


def two_modes(share, variance=0.25):
    """Return a law in the box with two modes, far from each other."""

    def log_density(theta):
        parts = [
            np.log(w) + LogGaussian(np.full(3, at), size * np.eye(3))(theta)
            for w, at, size in ((share, 6.0, variance), (1 - share, -6.0, 0.25))
        ]
        return np.logaddexp(*parts)

    return log_density


@pytest.mark.slow
@pytest.mark.parametrize("variance", [0.25, 2.25])  # the second by its volume alone
def test_a_mode_that_the_emulator_lacks_is_found_by_climbing(variance):
    one = LogGaussian(np.full(3, -6.0), 0.25 * np.eye(3))
    true = free_posterior(two_modes(0.5, variance), box(-12.0, 12.0, 3))
    idata = sampled(posterior(one), draws(one, 4_000, 1))
    found = [ef.certify(idata, true, 120, seed=seed) for seed in range(6)]
    assert all(c.efficiency > 0.99 for c in found)  # which weights cannot see
    missed = [c for c in found if c.short == "refused"]
    assert len(missed) >= 4
    assert all("x1 = 6" in c.verdict or "x1 = 5.9" in c.verdict for c in missed)
    small = free_posterior(two_modes(0.05, variance), box(-12.0, 12.0, 3))
    found = [ef.certify(idata, small, 120, seed=seed) for seed in range(6)]
    assert sum(c.short == "refused" for c in found) >= 3
    # A mode of less than a hundredth may be missed, and one that none came upon.
    for share in (3e-3, 1e-4):
        alone = free_posterior(two_modes(share), box(-12.0, 12.0, 3))
        said = {ef.certify(idata, alone, 120, seed=seed).short for seed in range(4)}
        assert said == {"certified"}


def test_a_flat_part_that_the_emulator_lacks_is_refused():
    """Of which no climb comes to an end, nor has it a volume by Laplace."""
    one = LogGaussian(np.full(3, -6.0), 0.25 * np.eye(3))

    def log_density(theta):
        beyond = np.maximum(np.linalg.norm(theta - 6.0, axis=1) - 3.0, 0.0)
        return np.logaddexp(one(theta), -1.0 - 4.0 * beyond**2)

    true = free_posterior(log_density, box(-12.0, 12.0, 3))
    idata = sampled(posterior(one), draws(one, 4_000, 1))
    for seed in range(3):
        found = ef.certify(idata, true, 80, seed=seed)
        assert found.efficiency > 0.99 and found.short == "refused"
        assert "far from all draws" in found.verdict


def test_moments_that_differ_bar_a_certificate():
    found = certify(TRUE)
    assert found.short == "certified"
    wide = dataclasses.replace(found, emulated_sd=1.15 * found.sd)
    narrow = dataclasses.replace(found, emulated_sd=0.85 * found.sd)
    moved = dataclasses.replace(found, emulated_mean=found.mean + 0.15 * found.sd)
    unknown = dataclasses.replace(found, off_error=0.06 * found.sd)
    for other in (wide, narrow, moved, unknown):
        assert other.short == "corrected"


def test_the_error_of_a_difference_is_that_of_the_solved_draws_alone():
    """Both standard deviations are of one chain, however well it knows them."""
    exact = certify(TRUE, n=2_000, phi=0.9)
    assert (exact.off_error < 1e-6).all() and (exact.sd_error > 0.02).all()
    found = [certify(NEAR, seed=seed, solves=120) for seed in range(4)]
    off = np.array([c.sd / c.emulated_sd for c in found])
    z = (off - 1.02**-0.5) / [c.off_error / c.sd for c in found]
    assert (np.abs(z) < 4.5).all()
    assert (np.square(z).mean() < 3) and (np.abs(off - 1) < 0.02).all()


def test_a_chain_that_has_not_converged_is_refused_unless_it_is_but_short():
    """Fault 17: of walkers apart by less than makes parts, and of rare excursions."""
    true, apart, lobe = posterior(TRUE), draws(TRUE, 6_000, 1), draws(TRUE, 400, 1)
    apart[::2, 0] += 0.7
    lobe[200, 0] = 11.0  # a place that is met once, and holds much of the variance
    for chain, doubt in ((apart, "walkers stay apart"), (lobe, "sd unknown")):
        idata = sampled(true, chain, walkers=4)
        assert ef.diagnose(idata).chains.reasons == (doubt,)
        found = ef.certify(idata, true, seed=1)
        assert found.short == "refused" and doubt in found.verdict
    short = certify(TRUE, n=40_000, phi=0.998)
    assert ef.diagnose(short).chains.reasons == ("too short",)
    assert short.faults == () and "too short" in str(short)
    short = certify(TRUE, n=8_000, phi=0.998)  # so that squares are not known either
    assert ef.diagnose(short).chains.reasons == ("too short", "sd unknown")
    assert short.short == "refused" and "too short" in short.verdict


def test_bounds_that_leave_out_half_of_the_prior_are_refused():
    half = posterior(TRUE, low=0.0)
    theta = np.abs(draws(LogGaussian(np.zeros(3), np.eye(3)), 2_000, 1))
    found = ef.certify(sampled(half, theta), posterior(TRUE), seed=1)
    assert found.short == "refused" and "leave out 8" in found.verdict
    assert any("press against x1 = 0" in finding for finding in found.findings)


def test_draws_that_press_against_a_bound_of_the_emulator_are_refused():
    wide = ef.GaussianPrior(["x1"], [0.0], [1.0], [(-9.0, 9.0)])
    cut = ef.GaussianPrior(["x1"], [0.0], [1.0], [(-9.0, 2.5)])  # all but 0.6 %

    def climbing(theta):
        return -0.5 * ((theta[:, 0] - 6.0) / 0.8) ** 2

    true, emulated = free_posterior(climbing, wide), free_posterior(climbing, cut)
    mean, sd = 6 / (1 + 0.64), np.sqrt(0.64 / 1.64)
    law = stats.truncnorm(-np.inf, (2.5 - mean) / sd, mean, sd)
    theta = law.rvs((2_000, 1), random_state=1)
    found = ef.certify(sampled(emulated, theta), true, seed=1)
    assert found.efficiency == pytest.approx(1.0)
    assert found.short == "refused" and "press against x1 = 2.5" in found.verdict
    # A bound that the prior has, too, is no matter.
    assert ef.certify(sampled(emulated, theta), emulated, seed=1).short == "certified"


def test_a_short_chain_is_said_and_widens_the_errors():
    short, long = (certify(TRUE, n=n, solves=80, phi=0.98) for n in (3_000, 60_000))
    assert "independent draws only" in str(short)
    assert "independent draws only" not in str(long)
    assert (short.mean_error > 2 * long.mean_error).all()
    assert short.effective < 60 * short.efficiency < 1.2 * long.effective


def test_the_slowest_parameter_tells_what_a_chain_is_worth():
    law = posterior(LogGaussian(np.zeros(3), np.eye(3)))
    theta = ar1([0.98, 0.0, 0.0], 3_000, 1, 1)[:, 0]
    assert "independent draws only" in str(ef.certify(sampled(law, theta), law, seed=1))


def test_no_climb_begins_amid_the_draws():
    flat = free_posterior(lambda theta: np.zeros(len(theta)), box(-9.0, 9.0, 2))
    theta = np.random.default_rng(1).uniform(-9.0, 9.0, (4_000, 2))
    found = ef.certify(sampled(flat, theta), flat, 60, seed=1)
    assert len(found.theta) == found.solves == 60  # no place is away from all
    assert found.search.status == "not searched"
    assert ef.diagnose(certify(SHIFTED, solves=200)).search.status == "searched"


def test_a_chain_in_several_parts_is_refused():
    true, theta = posterior(TRUE), draws(TRUE, 2_000, 1)
    for apart, short in ((0.0, "certified"), (1.5, "refused")):
        moved = theta + apart * (np.arange(2_000) % 2)[:, None]
        found = ef.certify(sampled(true, moved, walkers=2), true, seed=1)
        assert found.short == short
    assert "in several parts" in found.verdict


@pytest.mark.parametrize("kind", ["a walker that never moved", "ensembles apart"])
def test_parts_that_walkers_among_one_another_do_not_show_are_refused(kind):
    true, theta = posterior(TRUE), draws(TRUE, 8_000, 1).reshape(2, 200, 20, 3)
    if kind == "ensembles apart":
        theta[1] += 1.5
    else:
        theta[0, :, 3] = theta[0, 0, 3]
    idata = sampled(true, theta.reshape(-1, 3), walkers=20, ensembles=2)
    assert ef.diagnose(idata).rhat_within.max() < 1.1
    found = ef.certify(idata, true, seed=1)
    assert found.short == "refused" and "in several parts" in found.verdict


@pytest.mark.slow
def test_walkers_that_exchange_places_know_no_more():
    """As of a tempered run: each forgets at once, but not their ensemble."""
    steps, walkers, phi = 1_500, 6, 0.9
    rng, true, found = np.random.default_rng(1), posterior(TRUE), []
    for seed in range(4):
        theta = ar1([phi] * 3, steps, walkers, seed) @ np.linalg.cholesky(COVARIANCE).T
        order = rng.permuted(np.tile(np.arange(walkers), (steps, 1)), axis=1)
        theta = np.take_along_axis(theta, order[:, :, None], axis=1)
        idata = sampled(true, theta.reshape(-1, 3), walkers)
        idata["posterior"].attrs["betas"] = "[1.0, 0.5]"
        found.append(ef.certify(idata, true, 400, seed=seed))
    size = steps * walkers * (1 - phi) / (1 + phi)
    of_squares = steps * walkers * (1 - phi**2) / (1 + phi**2)
    n = len(found[0].theta)
    worth = [c.effective / n for c in found]
    assert np.mean(worth) == pytest.approx(np.tanh(size / n), abs=0.14)  # the worst's
    errors = np.mean([[c.mean_error, c.sd_error] for c in found], axis=(0, 2))
    exact = size**-0.5, (2 * of_squares) ** -0.5
    np.testing.assert_allclose(errors, exact, rtol=0.25)


def test_no_weight_at_all():
    found = certify(NEAR, free_posterior(TRUE, box(5.0, 12.0, 3)))
    assert found.short == "refused" and "zero at all draws" in found.verdict
    assert "nan" not in str(found)


class Breaking:
    """A law whose solve fails at one point of ten."""

    def __call__(self, theta):
        if (np.abs(theta[:, 0] * 1e3 % 1) < 0.1).any():
            raise RuntimeError("no convergence")
        return TRUE(theta)


def test_failed_solves_have_no_weight():
    true = free_posterior(Breaking(), box(-12.0, 12.0, 3))
    with pytest.raises(RuntimeError, match="no convergence"):
        certify(NEAR, true, on_failure="raise")
    found = certify(SHIFTED, true, solves=300)
    assert found.failed_solves > 5
    assert f"{found.failed_solves} solves failed" in str(found)
    assert (found.weights == 0).sum() > 5
    assert found.short != "refused"
    kept = found.idata["posterior"]["x1"].values
    assert np.isfinite(kept).all()
    assert kept.size == (found.weights > 0).sum()
    few = certify(SHIFTED, true, solves=300, max_failures=0.05)
    assert few.short == "refused" and "could not be solved" in few.verdict


@pytest.mark.parametrize("on_failure", ["raise", "reject"])
def test_a_corner_that_cannot_be_solved_costs_climbs_alone(on_failure):
    """All that is out of sight of the draws fails, in whatever way."""

    def law(theta):
        if (np.abs(theta) > 6.0).any():
            raise ValueError("singular")
        return TRUE(theta)

    true = free_posterior(law, box(-12.0, 12.0, 3))
    found = certify(TRUE, true, on_failure=on_failure)
    assert found.short == "certified" and found.solves <= 100
    assert "climbs led nowhere" in str(found)
    # A pool and a file change nothing.
    with ThreadPoolExecutor(2) as pool:
        again = certify(TRUE, true, on_failure=on_failure, pool=pool)
    assert str(again) == str(found)


def test_a_density_without_bound_is_found_and_costs_nothing():
    """Its peak at x1 = 5, where an error goes to zero, is no Gaussian's."""

    def law(theta):
        return TRUE(theta) - 1e-3 * np.log(np.abs(theta[:, 0] - 5.0) + 1e-300)

    found = certify(TRUE, free_posterior(law, box(-12.0, 12.0, 3)))
    assert found.short in ("certified", "refused") and found.solves <= 100


def stiffness(log_density, low=1e1, high=1e9):
    """Return the posterior of a stiffness over decades."""
    prior = ef.IndependentPrior({"s": stats.loguniform(low, high)})
    return free_posterior(lambda theta: log_density(theta[:, 0]), prior)


def near(s):
    return -0.5 * (np.log(s / 3e4) / 0.4) ** 2


def both(s, share=1.0):
    """Return a density with as much again at 30, or a share of that."""
    return np.logaddexp(near(s), np.log(share) - 0.5 * (np.log(s / 30.0) / 0.4) ** 2)


def test_a_stiffness_over_decades_is_climbed_by_its_logarithm():
    """It was said to grow "without bound towards s = 12", by an exception."""
    theta = stats.lognorm(0.4, scale=3e4).rvs((3_000, 1), random_state=1)
    idata, refused = sampled(stiffness(near), theta), []
    for seed in range(8):
        found = ef.certify(idata, stiffness(near), 60, seed=seed)
        assert found.short == "certified" and "led nowhere" not in str(found)
        hardly = stiffness(lambda s: both(s, 3e-3))
        assert ef.certify(idata, hardly, 60, seed=seed).short == "certified"
        again = ef.certify(idata, stiffness(both), 60, seed=seed)
        if again.short == "refused":
            refused.append(again)
    assert len(refused) >= 4  # by two climbs each
    assert all("s = 30, about" in found.verdict for found in refused)


def test_corrected_means_lie_inside_the_bounds():
    """Weights that leave little of a long tail, near the lower bound."""
    law, outside = stats.lognorm(1.5, scale=3e4), 0
    theta = law.rvs((3_000, 1), random_state=1)
    emulated = stiffness(lambda s: law.logpdf(s) + np.log(s))  # times the prior
    idata, true = sampled(emulated, theta), stiffness(lambda s: -s / 1e3)
    for seed in range(6):
        found = ef.certify(idata, true, 60, seed=seed)
        weighted = found.weights @ found.theta[:, 0] / len(found.theta)
        difference = theta.mean() + weighted - found.theta.mean()
        if difference < 1e1:
            outside += 1
            difference = weighted
        assert found.mean[0] == pytest.approx(difference, rel=1e-6)
        assert 1e1 < found.mean[0] and found.mean_error[0] >= 0
    assert 0 < outside < 6


def test_a_terminal_shows_progress_unless_told_otherwise(monkeypatch, capsys, tmp_path):
    file = {"backend": tmp_path / "run.certificate", "resume": True}
    for terminal, asked, shown in (
        (True, None, True),
        (False, None, False),
        (True, False, False),
        (False, True, True),
    ):
        monkeypatch.setattr(sys.stderr, "isatty", lambda: terminal)  # noqa: B023
        certify(TRUE, solves=40, progress=asked, **file)  # from the second time on read
        text = capsys.readouterr().err
        assert ("certify: 100%" in text and "40/40" in text) == shown


class Stopping:
    """A law that counts, and stops the program at a call."""

    def __init__(self, stop=0):
        self.calls, self.stop = 0, stop

    def __call__(self, theta):
        self.calls += 1
        if self.calls == self.stop:
            raise KeyboardInterrupt
        time.sleep(0.002)
        return TRUE(theta)


def test_a_kill_loses_no_solve_and_files_and_pools_change_nothing(tmp_path):
    wide, alone = box(-12.0, 12.0, 3), certify(NEAR, solves=40)
    path, laws = tmp_path / "cut.certificate", [Stopping(30), Stopping(), Stopping()]
    file = {"backend": path, "resume": True}
    with ThreadPoolExecutor(2) as pool:
        cut, *going_on = (free_posterior(law, wide) for law in laws)
        with pytest.raises(KeyboardInterrupt):
            certify(NEAR, cut, solves=40, pool=pool, **file)
        for true in going_on:
            assert str(certify(NEAR, true, solves=40, pool=pool, **file)) == str(alone)
    # Up to 16 calls see that the model is the same; a few may have been under way.
    assert laws[1].calls <= 40 - 30 + 16 + 8 and laws[2].calls <= 16
    for options, message in (
        ({"backend": path}, "cut.certificate exists"),
        ({**file, "solves": 60}, "cut.certificate"),
    ):
        with pytest.raises(ValueError, match=message):
            certify(NEAR, **{"solves": 40, **options})
    with pytest.raises(ValueError, match="emulated draws: was"):  # emulated anew
        certify(SHIFTED, solves=40, **file)


def test_what_is_no_chain_of_this_posterior_is_refused():
    found = certify(SHIFTED, solves=200)
    with pytest.raises(ValueError, match="idata: expected draws of the emulated"):
        ef.certify(found.idata, posterior(TRUE), seed=1)
    with pytest.raises(ValueError, match="posterior: expected the sampled one"):
        ef.certify(found.idata, free_posterior(len, box(0.0, 1.0, 2)), seed=1)


def test_weights_that_are_nearly_equal_are_trusted_whatever_their_k():
    found = certify(NEAR)
    for k in (-np.inf, 0.9, 5.0):
        other = dataclasses.replace(found, pareto_k=k)
        assert other.short == "certified" and "Pareto" not in other.verdict
    unequal = dataclasses.replace(found, efficiency=0.6, pareto_k=0.9)
    assert unequal.short == "refused"
    light = {"pareto_k": 0.1, "effective": 40.0}
    assert dataclasses.replace(found, **light).short == "certified"
    few = dataclasses.replace(unequal, **light)
    assert few.short == "refused" and "50 are needed" in few.verdict
    weak = dataclasses.replace(unequal, pareto_k=0.6)  # of 75 weights
    assert "such a heavy tail that no mean over" in weak.verdict


def test_a_run_is_certified_as_its_arviz_object_is():
    term = ef.FrequencyTerm([3.0], relative_sd=0.01)
    prior = ef.GaussianPrior(["k"], [8.0], [2.0], [(1.0, 20.0)])
    true, near = (
        ef.LogPosterior(ef.FunctionModel(function, n_modes=1), term, prior)
        for function in (lambda p: [p["k"] ** 0.5], lambda p: [3 + (p["k"] - 9) / 6])
    )
    run = ef.run(near, ef.DEMCMove(), 20, 200, ensembles=2, seed=1)
    sources = run, ef.to_inference_data(run)
    one, other = (ef.certify(source, true, 60, seed=2) for source in sources)
    assert str(one) == str(other) and one.efficiency > 0.9
