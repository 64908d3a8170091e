"""What withholds "converged" from chains that agree: groups, proposal, heavy tails."""

import re

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy import stats
from scipy.special import logsumexp
from support.chains import ar1, as_arviz, backend, switching

import emcee_femu as ef

CENTRES = np.array([[0.0, 0.0], [9.0, 9.0]])
SDS = np.array([1.0, 0.5])
WEIGHT = 0.3  # of the second group
STEPS, WALKERS = 600, 8


def log_density(x):
    parts = [
        np.log([1 - WEIGHT, WEIGHT][g])
        + stats.norm(CENTRES[g], SDS[g]).logpdf(x).sum(-1)
        for g in (0, 1)
    ]
    return logsumexp(parts, axis=0)


def record(**changes):
    """Return what "auto" would have found: the modes, and two wide components."""
    matrices = [np.eye(2) * s**2 for s in (*SDS, 6.0, 6.0)]
    means = [*CENTRES.tolist(), [4.0, 4.0], [4.0, 4.0]]
    weights = [0.63, 0.27, 0.05, 0.05]
    return {
        "mixture": [weights, means, np.array(matrices).tolist(), 16.0],
        "mode_of": [0, 1, -1, -1],
        "weights": [1 - WEIGHT, WEIGHT],
        "errors": [0.01, 0.01],
        "found_by": [[2, 1]] * 4,
        "starts": [[0.75, 0.25]] * 4,
        "pareto_k": 0.1,
        "efficiency": 0.4,
        "log_weights": [0.0],
        "points": 500,
        "climbs": 8,
        "annealed": False,
        "solves": 0,
        "share": 0.9,
        "trajectories": None,
    } | changes


def runs(share=WEIGHT, stay=0.5, steps=STEPS, ensembles=4):
    """Return ensembles that visit the second mode ``share`` of the time."""
    result = []
    for seed in range(ensembles):
        mode = switching(np.resize(share, seed + 1)[-1], stay, steps, WALKERS, seed)
        noise = ar1([stay, stay], steps, WALKERS, seed + 100)
        chain = CENTRES[mode] + SDS[mode][..., None] * noise
        result.append(backend(chain, log_prob=log_density(chain)))
    return result


@pytest.fixture(scope="module")
def usual():
    return runs()


ONE = {"weights": [1.0], "errors": [0.0], "found_by": [[3]] * 4, "starts": [[1.0]] * 4}
ONE["mode_of"] = [0, 0, -1, -1]
# A proposal that meets the first mode well, and hardly ever the second.
THIN = [[0.89, 0.01, 0.05, 0.05], *record()["mixture"][1:]]


def test_a_healthy_run_is_converged_and_shows_its_modes(usual):
    found = ef.diagnose(as_arviz(usual, search=record()))
    assert found.converged and found.search.status == "searched"
    assert "1 in 166 points" in found.search.sentence
    modes = found.maxima
    assert modes.weights.shape == (4, 2)
    # The switches have tau 3.
    expected = np.sqrt(WEIGHT * (1 - WEIGHT) * 3 / (4 * WALKERS * STEPS))
    assert_allclose(modes.errors, expected, rtol=0.1)
    assert (np.abs(modes.weights.mean(axis=0) - [0.7, 0.3]) < 4 * expected).all()
    assert_array_equal(modes.reached, [True, True])
    assert modes.chain_k < 0.5 and (modes.acceptance > 0.7).all()
    assert str(modes.table) in str(found) and (found.scatter < 1).all()
    alone = ef.diagnose(as_arviz(usual, search=record(**ONE)))
    assert alone.converged and str(alone.maxima.table) not in str(alone)
    assert ef.diagnose(usual).maxima is None


def third(weights, errors, **changes):
    """Return a record with a third group, far away."""
    three = record()
    three["mixture"][0] = [0.5, 0.3, 0.1, 0.05, 0.05]
    three["mixture"][1].insert(2, [-30.0, 0.0])
    three["mixture"][2].insert(2, np.eye(2).tolist())
    three |= {"mode_of": [0, 1, 2, -1, -1], "weights": weights, "errors": errors}
    three |= {"found_by": [[1, 1, 1]] + [[1, 1, 0]] * 3, "starts": [[0.7, 0.3, 0]] * 4}
    return three | changes


LOST = [0.7, 0.3, np.nan], [0.01, 0.01, np.nan]
NEVER = {"found_by": [[1, 1, 0]] * 4}
ONCE = {"starts": [[0.7, 0.25, 0.05]] + [[0.7, 0.3, 0]] * 3}


@pytest.mark.parametrize(
    ("short", "found_so"),
    [  # each just inside and just outside of its bound
        ("converged", record(weights=[0.735, 0.265])),
        ("weights disagree", record(weights=[0.77, 0.23])),
        ("weights disagree", record(weights=[0.63, 0.37])),
        ("converged", record(weights=[0.63, 0.37], errors=[0.03, 0.03])),
        ("converged", record(pareto_k=0.69)),
        ("proposal too narrow", record(pareto_k=0.71)),
        ("converged", record(share=0.05)),
        ("proposal too narrow", record(share=0.02)),
        ("converged", record(share=0.01, screened=5)),  # five for a step of theirs
        ("converged", record(share=0.0)),  # only local moves, which are judged
        ("converged", record(**ONE, share=0.0, pareto_k=0.9)),  # no use of it
        ("proposal too narrow", record(share=0.0, pareto_k=0.9)),
        ("converged", record(pareto_k=0.9, efficiency=0.51)),
        ("converged", record(**ONE, pareto_k=0.9)),  # errors by waits say it
        ("proposal too narrow", record(share=0.05, mixture=THIN)),
        # A mode that no walker is in any more.
        ("converged", third([0.7, 0.296, 0.004], [0.01, 0.01, 5e-4])),
        ("a maximum is lost", third([0.7, 0.29, 0.01], [0.01, 0.01, 0.002])),
        ("a maximum is lost", third(*LOST)),
        ("a maximum is lost", third(*LOST, **NEVER, **ONCE)),
        ("converged", third(*LOST, **NEVER)),
    ],
)
def test_the_bounds_of_what_a_record_says(usual, short, found_so):
    found = ef.diagnose(as_arviz(usual, search=found_so))
    assert found.chains.short == short
    # Waits are not known of few proposals; the chain's own error always is.
    assert np.isnan(found.maxima.sd_error).all() == (found_so["share"] < 0.5)
    assert np.isfinite(found.sd_error).all()
    if len(found_so["weights"]) == 3:
        assert np.isnan(found.maxima.acceptance[2])
        # As if there were one other draw.
        assert_allclose(found.maxima.errors[2], 1 / (4 * WALKERS * STEPS), rtol=1e-3)


def test_weights_that_differ_or_that_nobody_knows_well_are_not_converged():
    differ = as_arviz(runs([0.25, 0.25, 0.35, 0.35]), search=record())
    found = ef.diagnose(differ)  # by some errors, far from what R-hat sees
    assert (found.rhat_between < 1.01).all()
    assert found.chains.short == "ensembles disagree" and found.scatter.min() > 1
    unsure = record(errors=[0.02, 0.02])
    for stay, steps, ensembles in ((0.9, 1_200, 4), (0.94, 2_000, 2)):
        source = runs(stay=stay, steps=steps, ensembles=ensembles)
        found = ef.diagnose(as_arviz(source, search=unsure))
        error = found.maxima.errors[0]
        assert 0.008 < error < 0.02 and found.converged == (error < 0.0125)
    said = found.chains.sentence
    assert found.chains.short == "weights unknown"
    needed = 1.5 * steps * (error / 0.0125) ** 2
    longer = int(said.rpartition("steps=")[2].rstrip(".").replace(",", ""))
    assert needed <= longer <= 1.1 * needed


def held_to_a_gaussian(chains, variance, higher=0.0, **changes):
    """Return runs of N(0, 1), or higher, with the frozen proposal N(0, variance)."""
    covariances = [(variance * np.eye(2)).tolist()] * 3  # two weigh nothing
    mixture = [[1.0, 1e-300, 1e-300], [[0.0, 0.0]] * 3, covariances, 1e6]
    found = record(**ONE, mixture=mixture) | {"mode_of": [0, -1, -1]}
    log_prob = stats.norm.logpdf(chains).sum(-1) + higher
    samplers = [backend(c, log_prob=lp) for c, lp in zip(chains, log_prob, strict=True)]
    return as_arviz(samplers, search=found | changes)


@pytest.fixture
def chains():
    return np.array([ar1([0.5, 0.5], 1_000, 8, seed) for seed in range(4)])


@pytest.mark.parametrize("variance", [0.15, 0.45, 0.8])
def test_the_pareto_k_of_the_chain_is_that_of_the_proposal(chains, variance):
    """p is N(0, 1), q is N(0, v): of draws of q k is 1 - v."""
    found = ef.diagnose(held_to_a_gaussian(chains, variance))
    assert_allclose(found.maxima.chain_k, 1 - variance, atol=0.07)
    # Tails of the second are left too seldom.
    reason = "sd unknown" if variance == 0.45 else "proposal too narrow"
    assert (reason in found.chains.reasons) == (variance != 0.8)


@pytest.mark.parametrize(
    ("steps", "place", "short"),  # at 80 no proposal is ever accepted
    [(20, 6.5, "converged"), (100, 6.5, "sd unknown"), (1, 80.0, "sd unknown")],
)
def test_a_walker_that_waits_matters_where_it_stays(chains, steps, place, short):
    """Fault 27: if it hardly matters to a variance it is no reason for a rerun."""
    chains[2][900 : 900 + steps, 3] = place, 0.0  # at the end of a tail
    found = ef.diagnose(held_to_a_gaussian(chains, 0.8 if steps > 1 else 0.3))
    assert found.rhat_between.max() < 1.01 and found.chains.short == short
    assert np.isinf(found.sd_error[0]) == (steps == 1)  # no number of them is enough
    assert steps == 1 or found.maxima.pareto_k < 0.5


@pytest.mark.parametrize(
    ("height", "short"), [(1.0, "converged"), (8.0, "proposal too narrow")]
)
def test_a_needle_that_the_search_missed_and_walkers_do_not_leave(
    chains, height, short
):
    """Inside of a wide mode: two walkers enter it, of 32, and then no other."""
    higher = np.zeros(chains.shape[:3])
    chains[2:, 700:, 3] *= 0.05
    higher[2:, 700:, 3] = height
    found = ef.diagnose(held_to_a_gaussian(chains, 0.9, higher, efficiency=0.95))
    assert max(found.maxima.pareto_k, found.maxima.chain_k) < 0.5
    assert found.rhat_between.max() < 1.01 and (found.scatter < 1).all()
    assert found.chains.short == short


def test_the_expected_acceptance_is_that_of_proposals():
    """Of q = N(0, 2 I) and p = N(0, I) in the plane, by draws of both."""
    rng, n = np.random.default_rng(2), 200_000
    chains = rng.normal(size=(2, 500, 8, 2))
    found = ef.diagnose(held_to_a_gaussian(chains, 2.0)).maxima
    log_weight = -0.25 * (chains.reshape(-1, 2) ** 2).sum(axis=1)
    proposed = -0.25 * 2.0 * (rng.normal(size=(n, 2)) ** 2).sum(axis=1)
    accepted = [np.exp(np.minimum(0, proposed - w)).mean() for w in log_weight[::40]]
    assert_allclose(found.acceptance[0], np.mean(accepted), atol=0.02)


@pytest.mark.parametrize("variance", [0.8, pytest.param(2.0, marks=pytest.mark.slow)])
def test_errors_by_waits_are_those_of_independence_chains(variance):
    """p = N(0, 1), q = N(0, v): of 200 runs, by what four of them say."""
    rng, steps, shape = np.random.default_rng(5), 300, (200, 32, 2)
    x, draws = rng.normal(size=shape), np.empty((steps, *shape))
    for step in range(steps):
        proposed = variance**0.5 * rng.normal(size=shape)
        gain = 0.5 * (1 / variance - 1) * (proposed**2 - x**2).sum(axis=-1)
        moved = np.log(rng.random(shape[:2])) < gain
        moved &= rng.random(shape[:2]) < 0.9  # other moves stay
        draws[step] = x = np.where(moved[..., None], proposed, x)
    claimed = []
    for run in range(4):
        ensembles = draws[:, run].reshape(steps, 4, 8, 2).swapaxes(0, 1)
        modes = ef.diagnose(held_to_a_gaussian(ensembles, variance)).maxima
        claimed.append([modes.mean_error, modes.sd_error])
    runs = draws.swapaxes(0, 1).reshape(200, -1, 2)
    scatter = [runs.mean(axis=1).std(axis=0), runs.std(axis=1).std(axis=0)]
    of_means, of_sds = (np.mean(claimed, axis=0) / scatter).mean(axis=1)
    assert 0.95 < of_means < 1.4  # as if they were weights, too
    assert 0.85 < of_sds < 1.12


def test_scatter_is_a_chi_square_over_its_quantile():
    """Of parameters of the right law; one ensemble shifted by nine errors."""
    steps, walkers, d, phi = 400, 6, 30, 0.6
    draws = np.stack([ar1([phi] * d, steps, walkers, s) for s in range(4)], axis=1)
    tau = (1 + phi) / (1 - phi)

    def diagnosed(draws):
        return ef.diagnose([backend(chain) for chain in np.moveaxis(draws, 1, 0)])

    def chi_square(draws, tau):
        variance = draws.var(axis=(0, 1, 2)) * tau / (steps * walkers)
        means = draws.mean(axis=(0, 2))
        centre = np.average(means, axis=0, weights=1 / variance * np.ones_like(means))
        return ((means - centre) ** 2 / variance).sum(axis=0)

    assert stats.kstest(chi_square(draws, tau), stats.chi2(3).cdf).pvalue > 1e-3
    few = draws[..., :2].copy()
    limit = 1.5 * stats.chi2.isf(1e-4 / 2, 3)
    found = diagnosed(few)  # the worse of means and variances, by taus it estimates
    assert (found.scatter >= 0.999 * chi_square(few, found.tau) / limit).all()
    assert found.scatter.max() < 1
    few[:, 2] += 9 * np.sqrt(tau / (steps * walkers))
    assert (diagnosed(few).scatter > 1).all()
    assert np.isnan(diagnosed(few[:, :2]).scatter).all()
    wide = draws[..., :2].copy()
    wide[:, 2] *= 1.25  # about the same mean
    assert (diagnosed(wide).scatter > 1).all()
    # An ensemble that never leaves a place has no tau of its own.
    few[:, 1, :, 0] = 0.5
    held = diagnosed(few)
    assert np.isnan(held.tau[1]).all() and held.scatter[0] > 1


def test_standard_deviations_that_are_not_known_are_not_converged():
    """Few visits to a heavy tail: R-hat and tau are of the ranks and the centre."""
    chains = np.stack([ar1([0.9, 0.9], 1_500, 8, seed) for seed in range(2)])
    chains[..., 1] = np.exp(1.8 * chains[..., 1])
    found = ef.diagnose([*map(backend, chains)])
    assert (found.steps_per_tau > 25).all() and (found.rhat_between < 1.01).all()
    assert found.sd_error[0] < 0.05 and found.sd_error[1] > 0.1
    assert found.chains.short == "sd unknown" and "theta2" in found.chains.sentence
    # Where the chain is a little too short, and much too short for a heavy tail, the
    # steps that are said mend both.
    found = ef.diagnose([backend(chain[:250]) for chain in chains])
    assert found.chains.short == "too short" and found.steps_per_tau.min() > 12
    (steps,) = re.findall(r"run ([\d,]+) steps", found.chains.sentence)
    steps = int(steps.replace(",", ""))
    needed = 1.5 * 250 * (found.sd_error[1] / 0.1) ** 2
    assert needed > 1.1 * 1.5 * 250 * 25 / found.steps_per_tau.min()
    assert needed <= steps <= 1.1 * needed
