"""Certificates of emulated posteriors, against Gaussians of which all is known."""

import dataclasses
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from scipy import stats
from support.chains import ar1, backend, stored_and_read
from support.free_posterior import box, free_posterior

import emcee_femu as ef
from emcee_femu.extensions.emulation.certify import ONLY_CHAIN, UNKNOWN
from emcee_femu.extensions.emulation.emulated_chain import EmulatedChain

COVARIANCE = np.array([[1.0, 0.6, 0.0], [0.6, 1.0, -0.3], [0.0, -0.3, 1.0]])


@dataclasses.dataclass(frozen=True)
class LogGaussian:
    """A log density that is pickled, with a level that weights must not depend on."""

    mean: np.ndarray
    covariance: np.ndarray
    level: float = 0.0

    def __call__(self, theta):
        law = stats.multivariate_normal(self.mean, self.covariance)
        return self.level + np.atleast_1d(law.logpdf(theta))


TRUE = LogGaussian(np.zeros(3), COVARIANCE)
SHIFTED = LogGaussian(np.array([0.4, 0.2, -0.3]), 1.15 * COVARIANCE, 7.0)
NEAR = LogGaussian(np.array([0.02, 0.0, -0.02]), 1.02 * COVARIANCE, -5.0)


def posterior(law, low=-12.0, high=12.0):
    """Return a law as a posterior inside a box, uniform prior."""
    return free_posterior(law, box(low, high, len(law.mean)))


def draws(law, n, seed, phi=0.0):
    """Return an AR(1) chain of a law, ``(n, d)``; independent draws by default."""
    white = ar1([phi] * len(law.mean), n, 1, seed)[:, 0]
    return law.mean + white @ np.linalg.cholesky(law.covariance).T


def sampled(emulated, theta, walkers=1):
    """Return the ArviZ object of a run on an emulated posterior with these draws."""
    rows = emulated(theta).reshape(len(theta) // walkers, walkers, -1)
    coords = theta.reshape(len(rows), walkers, -1)
    run = backend(coords, log_prob=rows[..., 0], blobs=rows[..., 1:])
    return ef.to_inference_data([run], emulated)


WIDE_BOX = box(-12.0, 12.0, 3)
FAR = LogGaussian(np.array([1.6, 0.0, 0.0]), COVARIANCE)
NARROW = LogGaussian(np.zeros(3), 0.15 * COVARIANCE)
WHITE = LogGaussian(np.zeros(3), np.eye(3))
AWAY = LogGaussian(np.full(3, -6.0), 0.25 * np.eye(3))
AT_08, AT_0 = (LogGaussian(np.full(1, at), np.eye(1)) for at in (0.8, 0.0))


def certify(emulated, true=TRUE, n=4_000, seed=3, solves=100, phi=0.0, **options):
    """Return the certificate of an emulated Gaussian."""
    idata = sampled(posterior(emulated), draws(emulated, n, seed, phi))
    true = posterior(true) if isinstance(true, LogGaussian) else true
    return ef.certify(idata, true, solves, seed=seed, **options)


@pytest.fixture(scope="module")
def exact():
    return certify(TRUE)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("emulated", "true", "phi"),
    [(NEAR, TRUE, 0.8), (SHIFTED, TRUE, 0.0), (AT_08, AT_0, 0.0)],
    ids=["near", "shifted", "far from the true mean"],
)
def test_moments_are_the_exact_ones_and_errors_are_honest(emulated, true, phi):
    """The law of certificates: z-scores of unit size, over twenty seeds each."""
    found = [
        certify(emulated, true, n=2_000, seed=s, solves=180, phi=phi) for s in range(20)
    ]
    z = np.array(
        [[*(c.mean / c.mean_error), *((c.sd - 1) / c.sd_error)] for c in found]
    )
    assert (np.abs(z.mean(axis=0)) < 4.5 / np.sqrt(len(z))).all()
    # All together: the mean square of a z-score is 1.
    assert 0.55 < (z**2).mean() < 1.6


def test_where_all_weights_are_equal_all_is_that_of_the_whole_chain():
    """Its errors too, where squares forget sooner, by phi^2."""
    n, phi = 10_000, 0.9
    theta = draws(TRUE, n, 3, phi)
    found = certify(TRUE, n=n, phi=phi)
    np.testing.assert_allclose(found.mean, theta.mean(axis=0), atol=1e-12)
    np.testing.assert_allclose(found.sd, theta.std(axis=0), rtol=1e-3)
    of_mean = np.sqrt((1 + phi) / (1 - phi) / n)
    of_sd = np.sqrt((1 + phi**2) / (1 - phi**2) / (2 * n))
    errors = [found.mean_error.mean(), found.sd_error.mean()]
    np.testing.assert_allclose(errors, [of_mean, of_sd], rtol=0.2)
    # A sample variance, which divides by n - 1.
    few = [certify(TRUE, n=40, seed=seed, solves=10).sd ** 2 for seed in range(8)]
    ratios = few / np.array([draws(TRUE, 40, seed).var(axis=0) for seed in range(8)])
    np.testing.assert_allclose(ratios.mean(axis=0), 40 / 39, atol=0.01)


def test_efficiency_and_weights_are_those_of_the_law():
    moved = LogGaussian(np.array([0.5, 0.0, 0.0]), np.eye(3))
    law = LogGaussian(np.zeros(3), np.eye(3), 40.0)
    found = certify(moved, law, n=4_000, solves=1_000)
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
    # Where draws are everywhere, no climb begins, and all solves are of draws.
    everywhere = rng.uniform(-9.0, 9.0, (4_000, 2))
    found = ef.certify(sampled(flat, everywhere), flat, 60, seed=1)
    assert len(found.theta) == found.solves == 60
    assert found.search.status == "not searched"
    # They are not beside a thin ridge, though each parameter has all its values there.
    ridge = rng.uniform(-8.0, 8.0, (400, 1)) + rng.normal(0.0, 0.05, (400, 2))
    chain = EmulatedChain(sampled(flat, ridge), flat.prior, rng)
    on, beside = chain.distance(np.array([[1.0, 1.0], [1.0, -1.0]]))
    assert on < 1.0 < beside


def test_the_error_of_a_difference_is_that_of_the_solved_draws_alone():
    """Both standard deviations are of one chain, however well it knows them."""
    slow, near = certify(TRUE, n=2_000, phi=0.9), certify(NEAR, seed=1, solves=120)
    assert (slow.off_error < 1e-6).all() and (slow.sd_error > 0.02).all()
    off = near.sd / near.emulated_sd
    z = (off - 1.02**-0.5) / (near.off_error / near.sd)
    assert (np.abs(z) < 4.5).all() and (np.abs(off - 1) < 0.02).all()


@pytest.mark.slow
def test_a_short_chain_is_said_and_widens_the_errors():
    short, long = (certify(TRUE, n=n, solves=80, phi=0.98) for n in (2_000, 30_000))
    assert (short.mean_error > 2 * long.mean_error).all()
    assert short.effective < 60 * short.efficiency < 1.2 * long.effective
    slowest = ar1([0.98, 0.0, 0.0], 3_000, 1, 1)[:, 0]
    one_slow = ef.certify(sampled(posterior(WHITE), slowest), posterior(WHITE), seed=1)
    for found, said in ((short, True), (long, False), (one_slow, True)):
        assert ("independent draws only" in str(found)) == said


def stiffness(log_density, low=1e1, high=1e9):
    """Return the posterior of a stiffness over decades."""
    prior = ef.IndependentPrior({"s": stats.loguniform(low, high)})
    return free_posterior(lambda theta: log_density(theta[:, 0]), prior)


def test_corrected_means_lie_inside_the_bounds():
    """Weights that leave little of a long tail, near the lower bound."""
    law, outside = stats.lognorm(1.5, scale=3e4), 0
    theta = law.rvs((3_000, 1), random_state=1)
    emulated = stiffness(lambda s: law.logpdf(s) + np.log(s))  # times the prior
    idata, true = sampled(emulated, theta), stiffness(lambda s: -s / 1e3)
    for seed in range(4):
        found = ef.certify(idata, true, 60, seed=seed)
        weighted = found.weights @ found.theta[:, 0] / len(found.theta)
        difference = theta.mean() + weighted - found.theta.mean()
        if difference < 1e1:
            outside += 1
            difference = weighted
        assert found.mean[0] == pytest.approx(difference, rel=1e-6)
        assert 1e1 < found.mean[0] and found.mean_error[0] >= 0
    assert 0 < outside < 4


UNEQUAL = {"efficiency": 0.6, "pareto_k": 0.9}
LIGHT = {"pareto_k": 0.1, "effective": 40.0}


@pytest.mark.parametrize(
    ("verdict", "change"),
    [  # each of a certificate that differs from a good one
        ("certified", lambda c: {}),
        ("corrected", lambda c: {"emulated_sd": 1.15 * c.sd}),
        ("corrected", lambda c: {"emulated_sd": 0.85 * c.sd}),
        ("corrected", lambda c: {"emulated_sd": 1.15 * c.sd, "refitted": True}),
        ("corrected", lambda c: {"emulated_mean": c.mean + 0.15 * c.sd}),
        ("certified", lambda c: {"emulated_mean": c.mean + 0.05 * c.sd}),
        ("corrected", lambda c: {"off_error": 0.06 * c.sd}),
        ("certified", lambda c: {"off_error": 0.06 * c.sd, "refitted": True}),
        ("certified", lambda c: {"pareto_k": 5.0}),  # weights are nearly equal
        ("refused", lambda c: UNEQUAL),
        ("corrected", lambda c: {"efficiency": 0.6, "pareto_k": 0.1}),
        ("refused", lambda c: UNEQUAL | {"pareto_k": 0.6}),  # of 75 weights
        ("certified", lambda c: LIGHT),
        ("refused", lambda c: UNEQUAL | LIGHT),  # worth too few draws
    ],
)
def test_the_bounds_of_the_verdict(exact, verdict, change):
    assert dataclasses.replace(exact, **change(exact)).short == verdict


def test_a_chain_that_has_not_converged_is_refused_unless_it_is_but_short():
    """Fault 17: walkers apart, parts, rare excursions."""
    true, theta = posterior(TRUE), draws(TRUE, 6_000, 1)
    apart, parts, lobe = theta.copy(), theta[:2_000].copy(), theta[:400].copy()
    apart[::2, 0] += 0.7
    parts[::2] += 1.5
    lobe[200, 0] = 11.0  # a place that is met once, and holds much of the variance
    for chain, walkers, reason in (
        (apart, 4, "walkers stay apart"),
        (lobe, 4, "sd unknown"),
        (parts, 2, "walkers stay apart"),
    ):
        found = ef.certify(sampled(true, chain, walkers), true, seed=1)
        assert found.short == "refused" and reason in found.verdict
    chain = sampled(true, draws(TRUE, 3_200, 3, 0.99), 8)
    short = ef.certify(chain, true, seed=3)
    assert ef.diagnose(short).chains.reasons == ("too short",)
    assert short.faults == ()
    short = certify(TRUE, n=2_000, phi=0.99)  # so that squares are not known either
    assert ef.diagnose(short).chains.reasons == ("too short", "sd unknown")
    assert short.short == "refused"


def test_bounds_that_leave_out_half_of_the_prior_are_refused():
    half, theta = posterior(TRUE, low=0.0), np.abs(draws(WHITE, 2_000, 1))
    found = ef.certify(sampled(half, theta), posterior(TRUE), seed=1)
    assert found.short == "refused" and "leave out 8" in found.verdict
    assert any("x1 = 0" in finding for finding in found.findings)


def test_draws_that_press_against_a_bound_of_the_emulator_are_refused():
    wide = ef.GaussianPrior(["x1"], [0.0], [1.0], [(-9.0, 9.0)])
    cut = ef.GaussianPrior(["x1"], [0.0], [1.0], [(-9.0, 2.5)])  # all but 0.6 %

    def climbing(theta):
        return -0.5 * ((theta[:, 0] - 6.0) / 0.8) ** 2

    true, emulated = free_posterior(climbing, wide), free_posterior(climbing, cut)
    mean, sd = 6 / (1 + 0.64), np.sqrt(0.64 / 1.64)
    law = stats.truncnorm(-np.inf, (2.5 - mean) / sd, mean, sd)
    idata = sampled(emulated, law.rvs((2_000, 1), random_state=1))
    found = ef.certify(idata, true, seed=1)
    assert found.efficiency == pytest.approx(1.0)
    assert found.short == "refused" and "x1 = 2.5" in found.verdict
    # A bound that the prior has, too, is no matter.
    assert ef.certify(idata, emulated, seed=1).short == "certified"


def two_modes(share, variance=0.25):
    """Return a law in the box with two modes, far from each other."""

    def log_density(theta):
        parts = [
            np.log(w) + LogGaussian(np.full(3, at), size * np.eye(3))(theta)
            for w, at, size in ((share, 6.0, variance), (1 - share, -6.0, 0.25))
        ]
        return np.logaddexp(*parts)

    return free_posterior(log_density, WIDE_BOX)


@pytest.mark.slow
@pytest.mark.parametrize("variance", [0.25, 2.25])  # the second by its volume alone
def test_a_mode_that_the_emulator_lacks_is_found_by_climbing(variance):
    """The law of climbs: they find half, mostly a twentieth, not less."""
    idata = sampled(posterior(AWAY), draws(AWAY, 4_000, 1))
    for share, least, most in ((0.5, 3, 4), (0.05, 2, 4), (3e-3, 0, 0)):
        true = two_modes(share, variance if most else 0.25)
        found = [ef.certify(idata, true, 120, seed=seed) for seed in range(4)]
        missed = [c for c in found if c.short == "refused"]
        assert least <= len(missed) <= most
        assert all(c.efficiency > 0.99 for c in found)
        assert all("x1 = 6" in c.verdict or "x1 = 5.9" in c.verdict for c in missed)


def lobed(level):
    """Return a law with a lobe of 30 % of it, at a level that may be too low."""
    lobe = LogGaussian(np.array([7.0, 0.0, 0.0]), COVARIANCE, level)
    return free_posterior(
        lambda x: np.logaddexp(np.log(0.7) + TRUE(x), np.log(0.3) + lobe(x)), WIDE_BOX
    )


@pytest.mark.slow
def test_a_lobe_that_the_emulator_denies_is_seen_by_wider_draws():
    """It holds .1 % for 30 %; for climbs solves are too few; a wider draw in seven."""
    run, verdicts = ef.run(lobed(-6.0), seed=1), list[str]()
    for seed in range(20):
        found = ef.certify(run, lobed(0.0), 44, seed=seed)
        assert found.search.status == "not searched"
        verdicts.append(found.short)
    assert verdicts.count("certified") <= 10  # 20 * 0.85^11 are expected
    # Of an ArviZ object the draws of the chain are all there is, and it says so.
    alone = ef.certify(ef.to_inference_data(run), lobed(0.0), 44, seed=1)
    assert alone.short == "certified" and ONLY_CHAIN in alone.findings


def test_wider_draws_count_as_draws_of_two_laws_together():
    near = LogGaussian(np.full(3, 0.05), COVARIANCE)
    emulated, true = posterior(near), posterior(TRUE)
    run = ef.run(emulated, ef.DEMCMove(), 24, 400, ensembles=1, seed=1)
    found = ef.certify(run, true, 600, seed=1)
    theta, weights = found.theta, found.weights / found.weights.sum()
    lower = found.log_posterior.max() - 7.0
    assert (found.log_posterior < lower).sum() > 20  # wider
    exact = np.exp(-(0.05**2) * np.linalg.inv(COVARIANCE).sum())
    assert found.efficiency == pytest.approx(exact, abs=0.01)
    np.testing.assert_allclose(weights @ theta**2, 1.0, atol=0.3)  # by them alone
    z = np.append(found.mean / found.mean_error, (found.sd - 1) / found.sd_error)
    assert (np.abs(z) < 4.5).all()


def test_a_flat_part_that_the_emulator_lacks_is_refused():
    """Of which no climb comes to an end, nor has it a volume by Laplace."""

    def log_density(theta):
        beyond = np.maximum(np.linalg.norm(theta - 6.0, axis=1) - 3.0, 0.0)
        return np.logaddexp(AWAY(theta), -1.0 - 4.0 * beyond**2)

    true = free_posterior(log_density, WIDE_BOX)
    idata = sampled(posterior(AWAY), draws(AWAY, 4_000, 1))
    found = ef.certify(idata, true, 80, seed=0)
    assert found.efficiency > 0.99 and found.short == "refused" and found.missed


def near(s):
    return -0.5 * (np.log(s / 3e4) / 0.4) ** 2


def both(s):
    """Return a density with as much again at 30."""
    return np.logaddexp(near(s), -0.5 * (np.log(s / 30.0) / 0.4) ** 2)


def test_a_stiffness_over_decades_is_climbed_by_its_logarithm():
    """It was said to grow "without bound towards s = 12", by an exception."""
    theta = stats.lognorm(0.4, scale=3e4).rvs((3_000, 1), random_state=1)
    idata, refused = sampled(stiffness(near), theta), []
    found = ef.certify(idata, stiffness(near), 60, seed=0)
    assert found.short == "certified" and "led nowhere" not in str(found)
    for seed in range(4):
        again = ef.certify(idata, stiffness(both), 60, seed=seed)
        refused += [again.verdict] if again.short == "refused" else []
    assert len(refused) >= 2  # by two climbs each
    assert all("s = 30" in verdict for verdict in refused)


@pytest.mark.parametrize(
    ("emulated", "true"),
    [(FAR, TRUE), (NARROW, TRUE), (NEAR, free_posterior(TRUE, box(5.0, 12.0, 3)))],
    ids=["far", "narrow", "no weight at all"],
)
def test_a_poor_one_is_refused(emulated, true):
    found = certify(emulated, true)
    assert found.short == "refused" and "nan" not in str(found)


def breaking(theta):
    """Fail at one point of ten."""
    if (np.abs(theta[:, 0] * 1e3 % 1) < 0.1).any():
        raise RuntimeError("no convergence")
    return TRUE(theta)


def test_failed_solves_have_no_weight():
    true = free_posterior(breaking, WIDE_BOX)
    with pytest.raises(RuntimeError, match="no convergence"):
        certify(NEAR, true, on_failure="raise")
    found = certify(SHIFTED, true, solves=300)
    assert found.failed_solves > 5 and f"{found.failed_solves} solves" in str(found)
    assert (found.weights == 0).sum() > 5 and found.short != "refused"
    kept = found.idata["posterior"]["x1"].values
    assert np.isfinite(kept).all() and kept.size == (found.weights > 0).sum()
    assert certify(SHIFTED, true, solves=300, max_failures=0.05).short == "refused"
    none = certify(NEAR, failing(TRUE, lambda theta: theta[:, 0] < 99.0), solves=20)
    assert none.short == "refused" and none.efficiency == 0.0


def failing(law, where):
    """Return the law as a posterior that cannot be solved at some places."""

    def solve(theta):
        if where(theta).any():
            raise RuntimeError("no convergence")
        return law(theta)

    return free_posterior(solve, WIDE_BOX)


def test_what_fails_by_chance_is_left_out_and_what_fails_in_a_place_is_not():
    """The law: most of the first are certified, few of the second, right if large."""
    chance = failing(TRUE, lambda theta: theta[:, 0] * 1e3 % 1 < 0.1)
    tail = failing(TRUE, lambda theta: theta[:, 0] > 1.2)  # 11.5 %
    by_chance, in_tail = (
        [certify(TRUE, true, n=1_000, seed=seed, solves=50) for seed in range(8)]
        for true in (chance, tail)
    )
    assert sum(c.short == "certified" for c in by_chance) >= 5
    left_out = [c for c in by_chance if c.efficiency > 1 - 1e-9]
    assert len(left_out) >= 5 and any((c.weights == 0).any() for c in left_out)
    assert sum(c.short == "certified" for c in in_tail) <= 2
    large = certify(TRUE, tail, solves=500)
    law = stats.truncnorm(-np.inf, 1.2)
    assert large.efficiency == pytest.approx(stats.norm.cdf(1.2), abs=0.06)
    assert abs(large.mean[0] - law.mean()) < 4 * large.mean_error[0]


@pytest.mark.parametrize("on_failure", ["raise", "reject"])
def test_a_corner_that_cannot_be_solved_costs_climbs_alone(on_failure):
    """All that is out of sight of the draws fails, in whatever way."""

    def law(theta):
        if (np.abs(theta) > 6.0).any():
            raise ValueError("singular")
        return TRUE(theta)

    none = {"on_failure": on_failure, "max_failures": 0.0}  # of the draws
    found = certify(TRUE, free_posterior(law, WIDE_BOX), **none)
    assert found.short == "certified" and found.solves <= 100
    assert "climbs failed" in str(found)


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
    alone = certify(NEAR, solves=40)
    path, laws = tmp_path / "cut.chain", [Stopping(30), Stopping(), Stopping()]
    file = {"backend": path, "resume": True}
    with ThreadPoolExecutor(2) as pool:
        cut, *going_on = (free_posterior(law, WIDE_BOX) for law in laws)
        with pytest.raises(KeyboardInterrupt):
            certify(NEAR, cut, solves=40, pool=pool, **file)
        for true in going_on:
            assert str(certify(NEAR, true, solves=40, pool=pool, **file)) == str(alone)
    # Up to 16 calls see that the model is the same; a few may have been under way.
    assert laws[1].calls <= 40 - 30 + 16 + 8 and laws[2].calls <= 16
    for emulated, options, message in (
        (NEAR, {"backend": path}, "cut.chain exists"),
        (NEAR, {**file, "solves": 60}, "cut.chain"),
        (SHIFTED, file, "emulated draws"),  # emulated anew
    ):
        with pytest.raises(ValueError, match=message):
            certify(emulated, **{"solves": 40, **options})


def test_what_is_no_chain_of_this_posterior_is_refused():
    weighted = certify(SHIFTED, solves=200).idata
    with pytest.raises(ValueError, match="^idata"):
        ef.certify(weighted, posterior(TRUE), seed=1)
    with pytest.raises(ValueError, match="^posterior"):
        ef.certify(weighted, free_posterior(len, box(0.0, 1.0, 2)), seed=1)


SPRINGS = {"k1": (0, 1, 10.0), "k2": (1, 2, 5.0)}
PRIOR = ef.GaussianPrior(["k1", "k2"], [10.0, 5.0], 2.0, [(2.0, 20.0), (1.0, 12.0)])
MODEL = ef.MassSpringModel([1.0, 2.0], SPRINGS)
MEASURED = ef.FrequencyTerm(MODEL({}).frequencies[0] * [1.01, 0.99], relative_sd=0.02)
EXACT = ef.LogPosterior(MODEL, MEASURED, PRIOR)


def certificate(masses, solves):
    """Return a run of a model with other masses, and its certificate."""
    wrong = ef.LogPosterior(ef.MassSpringModel(masses, SPRINGS), MEASURED, PRIOR)
    run = ef.run(wrong, ef.DEMCMove(), 20, 400, seed=1, ensembles=1)
    idata = ef.to_inference_data(run, discard=200)
    return idata, ef.certify(idata, EXACT, solves, seed=2)


def test_tables_show_the_weighted_draws_and_say_so(tmp_path):
    idata, found = certificate([1.01, 2.02], 300)
    assert found.short == "corrected", found.verdict
    exact = found.weights @ found.theta / len(found.theta)
    true = EXACT(found.theta)[:, EXACT.columns["frequency"]]
    order = np.argsort(found.theta[:, 0])
    shares = np.cumsum(found.weights[order]) / found.weights.sum()
    quantile = found.theta[order, 0][np.searchsorted(shares, 0.975)]
    sealed = stored_and_read(found.idata, tmp_path / "weighted.nc")
    parameters, frequencies = ef.parameter_table(sealed), ef.frequency_table(sealed)
    np.testing.assert_allclose(parameters.column("mean"), exact, rtol=1e-4)
    assert parameters.column("97.5 %")[0] == pytest.approx(quantile, rel=0.01)
    means = frequencies.column("updated Hz")[:2]
    expected = found.weights @ true / len(found.theta)
    np.testing.assert_allclose(means, expected, rtol=1e-4)
    said = parameters, frequencies, ef.predictive_table(sealed)
    assert all("corrected" in table.title for table in said)
    diagnosis = ef.diagnose(sealed)
    assert diagnosis.chains.status == "none" and not diagnosis.converged
    assert diagnosis.search == found.search
    emulated_mean = ef.parameter_table(idata).column("mean")
    assert np.abs(emulated_mean / exact - 1).max() > 0.01
    # Predictive draws are taken by weight.
    new = found.idata["new_measurement"]["frequency"][0]
    some = found.idata["posterior_predictive"]["frequency"][0]
    weights = found.weights[found.weights > 0]
    exact = weights @ new.values / weights.sum()
    error = 4 * some.std("draw").values / np.sqrt(len(some))
    assert (abs(some.mean("draw").values - exact) < error).all()
    assert (abs(new.values.mean(axis=0) - exact) > error).any()  # without weights


def test_the_object_of_a_certified_posterior_is_its_chain_with_a_seal(tmp_path):
    idata, found = certificate([1.0005, 2.001], 60)
    assert found.short == "certified", found.verdict
    sealed = stored_and_read(found.idata, tmp_path / "sealed.nc")
    table = ef.parameter_table(sealed)
    assert table.rows == ef.parameter_table(idata).rows
    assert f"certified by {found.solves}" in table.title
    group = sealed["certificate"]
    assert group.attrs["verdict"] == found.verdict
    np.testing.assert_array_equal(group["weight"].values, found.weights)
    true = EXACT(found.theta)[:, 0]
    np.testing.assert_allclose(group["lp"].values, true, rtol=1e-9)
    assert ef.diagnose(sealed).chains.status != "none"
    assert "certified" not in ef.parameter_table(idata).title  # given as it was


def noted(settled, law=NEAR):
    """Return a posterior whose samples say whether its emulator settled."""
    emulated = posterior(law)
    emulated.notes = {"settled": settled}
    return emulated


def test_an_emulator_that_did_not_settle_is_refused_however_equal_the_weights(tmp_path):
    """By every door: a run, an ArviZ object, one read back from netCDF."""
    for settled, verdict in ((0, "refused"), (1, "certified")):
        idata = sampled(noted(settled), draws(NEAR, 4_000, 3))
        read = stored_and_read(idata, tmp_path / f"{settled}.nc")
        for given in (idata, read):
            found = ef.certify(given, posterior(TRUE), 100, seed=3)
            assert found.settled is bool(settled) and found.short == verdict
            assert found.efficiency > 0.98
            assert UNKNOWN not in found.findings


def test_where_nobody_knows_whether_an_emulator_settled_a_finding_says_so(exact):
    assert exact.settled is None and UNKNOWN in exact.findings
    assert exact.short == "certified"
    run = ef.run(EXACT, ef.DEMCMove(), 20, 200, seed=1, ensembles=1)
    found = ef.certify(run, EXACT, 30, seed=1)  # no emulator
    assert found.settled is None and UNKNOWN not in found.findings


@pytest.mark.slow
def test_the_evidence_is_that_of_the_true_posterior(tmp_path):
    """Second route: a run on it. A corrected certificate keeps no chain."""

    def raised(parameters, response):
        return MEASURED(parameters, response) + 3.0

    wrong = ef.LogPosterior(ef.MassSpringModel([1.015, 2.03], SPRINGS), raised, PRIOR)
    emulated, true = ef.run(wrong, seed=1), ef.log_evidence(ef.run(EXACT, seed=2))
    found = ef.certify(emulated, EXACT, 300, seed=3)
    assert found.short == "corrected", found.verdict
    evidence = ef.log_evidence(found)
    error = np.hypot(evidence.log_evidence_error, true.log_evidence_error)
    assert abs(evidence.log_evidence - true.log_evidence) < 4.5 * error
    off = ef.log_evidence(emulated).log_evidence - true.log_evidence
    assert 2.0 < off < 4.0  # without the ratio of the two
    read = stored_and_read(found.idata, tmp_path / "corrected.nc")
    assert str(ef.log_evidence(read)) == str(evidence)
    failed = np.arange(len(found.weights)) % 5 == 0  # by chance, of equal weights
    equal = {"efficiency": 1.0, "effective": 40.0, "weights": np.where(failed, 0, 1.25)}
    some = dataclasses.replace(found, **equal).evidence.log_evidence_error
    others = found.emulated_evidence.log_evidence_error
    assert some**2 - others**2 == pytest.approx(failed.mean() / 40, rel=1e-6)
    # Of moves that know no evidence there is none.
    plain = certificate([1.0005, 2.001], 60)[1]
    assert plain.evidence is None
    with pytest.raises(ValueError, match="expected a run of 'auto'"):
        ef.log_evidence(plain)


@pytest.mark.slow
def test_tables_and_a_new_certificate_take_a_certificate_as_its_samples():
    _, found = certificate([1.0005, 2.001], 60)
    for tabulate in (ef.parameter_table, ef.frequency_table, ef.predictive_table):
        assert str(tabulate(found)) == str(tabulate(found.idata))
    assert ef.to_inference_data(found) is found.idata
    again = ef.certify(found, EXACT, 60, seed=2)
    assert str(again) == str(found)  # it knows nothing of the one before


def test_a_refused_certificate_is_refused_by_every_judge(tmp_path):
    idata, found = certificate([1.3, 2.6], 40)
    assert found.short == "refused" and ef.diagnose(idata).chains.status != "refused"
    for given in (found, found.idata, stored_and_read(found.idata, tmp_path / "r.nc")):
        chains = ef.diagnose(given).chains
        assert chains.status == "refused" and found.verdict in chains.sentence
        assert "refused" in ef.parameter_table(given).title
