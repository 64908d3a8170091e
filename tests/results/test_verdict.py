"""What withholds "converged" from chains that agree: groups, proposal, heavy tails."""

import arviz as az
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy import stats
from scipy.special import logsumexp
from support.chains import ar1, as_arviz, backend, dataset, switching
from support.free_posterior import box, free_posterior

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


def runs(share=WEIGHT, stay=0.5, steps=STEPS, ensembles=4, sds=SDS):
    """Return ensembles that visit the second mode ``share`` of the time."""
    result = []
    for seed in range(ensembles):
        mode = switching(np.resize(share, seed + 1)[-1], stay, steps, WALKERS, seed)
        noise = ar1([stay, stay], steps, WALKERS, seed + 100)
        chain = CENTRES[mode] + np.array(sds)[mode][..., None] * noise
        result.append(backend(chain, log_prob=log_density(chain)))
    return result


def judged(record, **options):
    return ef.diagnose(as_arviz(runs(**options), search=record))


ONE = {"weights": [1.0], "errors": [0.0], "found_by": [[3]] * 4, "starts": [[1.0]] * 4}
ONE["mode_of"] = [0, 0, -1, -1]
# A proposal that meets the first mode well, and hardly ever the second.
THIN = [[0.89, 0.01, 0.05, 0.05], *record()["mixture"][1:]]


def test_a_healthy_run_is_converged_and_shows_its_modes():
    found = judged(record())
    assert found.converged, found.chains.sentence
    modes = found.modes
    assert modes.weights.shape == (4, 2)
    # The switches have tau 3.
    expected = np.sqrt(WEIGHT * (1 - WEIGHT) * 3 / (4 * WALKERS * STEPS))
    assert_allclose(modes.errors, expected, rtol=0.1)
    assert (np.abs(modes.weights.mean(axis=0) - [0.7, 0.3]) < 4 * expected).all()
    assert_array_equal(modes.reached, [True, True])
    assert modes.chain_k < 0.5 and (modes.acceptance > 0.7).all()
    text, page = str(found), found._repr_html_()
    assert str(modes.table) in text and "importance" in page
    assert text.split()[-9:] == found.verdict.split()[-9:]
    assert "<p>Search: 2 maxima, by 500 points" in page
    assert found.search.status == "searched" and "one point in 166" in found.verdict
    alone = judged(record(**ONE))
    assert alone.converged and "Weights of" not in str(alone)
    assert judged(record(**ONE, share=0.0, pareto_k=0.9)).converged  # no use of it
    assert ef.diagnose(runs()).modes is None


@pytest.mark.parametrize(
    ("short", "changes", "words"),
    [  # each just inside and just outside of its bound
        ("converged", {"weights": [0.735, 0.265]}, "agree"),
        ("weights disagree", {"weights": [0.77, 0.23]}, "sampling 0.770 (+- 0.010)"),
        ("weights disagree", {"weights": [0.63, 0.37]}, "walker started, holds 0.70"),
        ("converged", {"weights": [0.63, 0.37], "errors": [0.03, 0.03]}, "agree"),
        ("converged", {"pareto_k": 0.69}, "agree"),
        ("proposal too narrow", {"pareto_k": 0.71}, "Pareto k is 0.71"),
        ("converged", {"share": 0.05}, "agree"),
        ("proposal too narrow", {"share": 0.02}, "in 600 steps"),
        ("converged", {"share": 0.0}, "agree"),  # only local moves, which are judged
        ("proposal too narrow", {"share": 0.0, "pareto_k": 0.9}, "Pareto k is 0.90"),
        ("converged", {"pareto_k": 0.9, "efficiency": 0.51}, "agree"),
        ("proposal too narrow", {"share": 0.05, "mixture": THIN}, "in 600 steps"),
    ],
)
def test_the_bounds_of_what_a_record_says(short, changes, words):
    found = judged(record(**changes))
    assert found.chains.short == short and words in found.chains.sentence
    assert found.chains.sentence.startswith(found.chains.status)


def third(weights, errors, **changes):
    """Return a record with a third group, far away."""
    three = record()
    three["mixture"][0] = [0.5, 0.3, 0.1, 0.05, 0.05]
    three["mixture"][1].insert(2, [-30.0, 0.0])
    three["mixture"][2].insert(2, np.eye(2).tolist())
    return (
        three
        | {"mode_of": [0, 1, 2, -1, -1], "weights": weights, "errors": errors}
        | {"found_by": [[1, 1, 1]] + [[1, 1, 0]] * 3, "starts": [[0.7, 0.3, 0]] * 4}
        | changes
    )


LOST = [0.7, 0.3, np.nan], [0.01, 0.01, np.nan]
NEVER = {"found_by": [[1, 1, 0]] * 4}
ONCE = {"starts": [[0.7, 0.25, 0.05]] + [[0.7, 0.3, 0]] * 3}


@pytest.mark.parametrize(
    ("short", "found_so", "words"),
    [
        ("converged", third([0.7, 0.296, 0.004], [0.01, 0.01, 5e-4]), "agree"),
        ("a mode is lost", third([0.7, 0.29, 0.01], [0.01, 0.01, 0.002]), "0.010 (+-"),
        ("a mode is lost", third(*LOST), "not known"),
        ("a mode is lost", third(*LOST, **NEVER, **ONCE), "or a walker started"),
        ("converged", third(*LOST, **NEVER), "agree"),
    ],
)
def test_a_mode_that_no_walker_is_in_any_more(short, found_so, words):
    found = judged(found_so)
    assert found.chains.short == short and words in found.chains.sentence
    assert np.isnan(found.modes.acceptance[2])
    # As if there were one other draw.
    assert_allclose(found.modes.errors[2], 1 / (4 * WALKERS * STEPS), rtol=1e-3)


def test_weights_that_differ_between_ensembles_are_not_converged():
    """By some errors, far from what R-hat sees."""
    found = judged(record(), share=[0.25, 0.25, 0.35, 0.35])
    assert (found.rhat_between < 1.01).all()
    assert found.chains.short == "ensembles disagree" and found.scatter.min() > 1
    assert (judged(record()).scatter < 1).all()


def test_weights_that_nobody_knows_well_are_not_converged():
    unsure = record(errors=[0.02, 0.02])
    found = judged(unsure, stay=0.9, steps=1_200)
    assert found.converged and 0.008 < found.modes.errors[0] < 0.0125
    found = judged(unsure, stay=0.94, steps=2_000, ensembles=2)
    assert 0.0125 < found.modes.errors[0] < 0.02
    said = found.chains.sentence
    assert found.chains.short == "weights unknown" and "+- 0.01" in said
    needed = 1.25 * 2_000 * (found.modes.errors[0] / 0.0125) ** 2
    steps = int(said.rpartition("steps=")[2].rstrip(".").replace(",", ""))
    assert needed <= steps <= 1.1 * needed


def gaussian(variance, df):
    """Return one component, and two that cover it and weigh nothing."""
    weights, matrices = [1.0, 1e-300, 1e-300], [(variance * np.eye(2)).tolist()] * 3
    return [weights, [[0.0, 0.0]] * 3, matrices, df]


def held_to_a_gaussian(chains, variance, higher=0.0, **changes):
    """Return runs of N(0, 1), or higher, with the frozen proposal N(0, variance)."""
    found = record(**ONE, mixture=gaussian(variance, 1e6)) | {"mode_of": [0, -1, -1]}
    log_prob = stats.norm.logpdf(chains).sum(-1) + higher
    samplers = [backend(c, log_prob=lp) for c, lp in zip(chains, log_prob, strict=True)]
    return as_arviz(samplers, search=found | changes)


@pytest.mark.parametrize(("variance", "k"), [(0.15, 0.85), (0.8, 0.2)])
def test_the_pareto_k_of_the_chain_is_that_of_the_proposal(variance, k):
    """p is N(0, 1), q is N(0, v): of draws of q k is 1 - v."""
    chains = [ar1([0.5, 0.5], 1_000, 8, seed) for seed in range(4)]
    found = ef.diagnose(held_to_a_gaussian(chains, variance))
    assert_allclose(found.modes.chain_k, k, atol=0.07)
    too_narrow = found.modes.chain_k > 0.7
    assert (found.chains.short == "proposal too narrow") == too_narrow
    assert too_narrow or found.converged == (k < 0.5)


@pytest.mark.parametrize(
    ("steps", "short"), [(20, "converged"), (50, "proposal too narrow")]
)
def test_a_walker_that_waits_matters_where_it_stays(steps, short):
    """Fault 27: in a thousandth of the chain or less it is no reason for a rerun."""
    chains = [ar1([0.5, 0.5], 1_000, 8, seed) for seed in range(4)]
    assert ef.diagnose(held_to_a_gaussian(chains, 0.8)).converged
    chains[2][900 : 900 + steps, 3] = 6.5, 0.0  # at the end of a tail
    found = ef.diagnose(held_to_a_gaussian(chains, 0.8))
    assert found.modes.pareto_k < 0.5 and found.rhat_between.max() < 1.01
    assert found.chains.short == short
    assert (found.modes.slowest < 0.01) == (short != "converged")


@pytest.mark.parametrize(
    ("height", "short"), [(1.0, "converged"), (8.0, "proposal too narrow")]
)
def test_a_needle_that_the_search_missed_and_walkers_do_not_leave(height, short):
    """Inside of a wide mode: two walkers enter it, of 32, and then no other."""
    chains = np.array([ar1([0.5, 0.5], 1_000, 8, seed) for seed in range(4)])
    higher = np.zeros(chains.shape[:3])
    chains[2:, 700:, 3] *= 0.05
    higher[2:, 700:, 3] = height
    found = ef.diagnose(held_to_a_gaussian(chains, 0.9, higher, efficiency=0.95))
    assert max(found.modes.pareto_k, found.modes.chain_k) < 0.5
    assert found.rhat_between.max() < 1.01 and (found.scatter < 1).all()
    assert found.chains.short == short


def test_tails_that_are_left_too_seldom_are_too_narrow():
    chains = [ar1([0.5, 0.5], 1_000, 8, seed) for seed in range(4)]
    found = ef.diagnose(held_to_a_gaussian(chains, 0.45))
    assert 0.5 < found.modes.chain_k < 0.7
    assert found.chains.short == "proposal too narrow"
    assert "in 1000 steps" in found.chains.sentence


def test_the_expected_acceptance_is_that_of_proposals():
    """Of q = N(0, 2 I) and p = N(0, I) in the plane, by draws of both."""
    rng, n = np.random.default_rng(2), 200_000
    x = rng.normal(size=(500, 8, 2))
    chains = [x, rng.normal(size=(500, 8, 2))]
    found = ef.diagnose(held_to_a_gaussian(chains, 2.0)).modes
    log_weight = -0.25 * (np.concatenate(chains).reshape(-1, 2) ** 2).sum(axis=1)
    proposed = -0.25 * 2.0 * (rng.normal(size=(n, 2)) ** 2).sum(axis=1)
    accepted = [np.exp(np.minimum(0, proposed - w)).mean() for w in log_weight[::40]]
    assert_allclose(found.acceptance[0], np.mean(accepted), atol=0.02)
    rare = np.quantile(log_weight, 0.999)
    worst = np.exp(np.minimum(0, proposed - rare)).mean()
    assert_allclose(found.slowest, worst, atol=0.02)


def test_scatter_is_a_chi_square_over_its_quantile():
    """Of 60 parameters of the right law; one ensemble shifted by nine errors."""
    steps, walkers, d, phi = 400, 6, 60, 0.6
    draws = np.stack([ar1([phi] * d, steps, walkers, s) for s in range(4)], axis=1)
    tau = np.full((4, d), (1 + phi) / (1 - phi))

    def diagnosed(draws):
        return ef.diagnose([backend(chain) for chain in np.moveaxis(draws, 1, 0)])

    variance = draws.var(axis=(0, 1, 2)) * tau / (steps * walkers)
    squares = (draws.mean(axis=(0, 2)) - draws.mean(axis=(0, 1, 2))) ** 2
    chi_square = (squares / variance).sum(axis=0)
    assert stats.kstest(chi_square, stats.chi2(3).cdf).pvalue > 1e-3
    few = draws[..., :2].copy()
    limit = 1.5 * stats.chi2.isf(1e-4 / 2, 3)
    found = diagnosed(
        few
    )  # the worse of means and variances, by taus that it estimates
    assert (found.scatter > 0.8 * chi_square[:2] / limit).all()
    assert found.scatter.max() < 1
    few[:, 2] += 9 * np.sqrt((1 + phi) / (1 - phi) / (steps * walkers))
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
    chains = [ar1([0.9, 0.9], 1_500, 8, seed) for seed in range(2)]
    for chain in chains:
        chain[..., 1] = np.exp(1.8 * chain[..., 1])
    found = ef.diagnose([backend(chain) for chain in chains])
    assert (found.steps_per_tau > 50).all() and (found.rhat_between < 1.01).all()
    assert found.sd_error[0] < 0.05 and found.sd_error[1] > 0.1
    assert found.chains.short == "sd unknown" and "theta2" in found.chains.sentence


def test_the_steps_that_are_said_mend_all_that_speaks():
    """The chain is a little too short, and much too short for a heavy tail."""
    chains = [ar1([0.9, 0.9], 800, 8, seed) for seed in range(2)]
    for chain in chains:
        chain[..., 1] = np.exp(1.8 * chain[..., 1])
    found = ef.diagnose([backend(chain) for chain in chains])
    assert found.chains.short == "too short" and found.steps_per_tau.min() > 25
    steps = int(found.chains.sentence.rpartition("steps=")[2][:-1].replace(",", ""))
    needed = 1.25 * 800 * (found.sd_error[1] / 0.1) ** 2
    assert needed > 1.1 * 1.25 * 800 * 50 / found.steps_per_tau.min()
    assert needed <= steps <= 1.1 * needed


def test_the_error_of_a_standard_deviation_is_its_scatter():
    """Of an autoregressive chain squares forget by phi^2."""
    phi, steps, runs = 0.7, 500, 40
    chains = np.stack([ar1([phi], steps, 8, seed) for seed in range(runs)])
    claimed = np.mean([ef.diagnose(backend(c)).sd_error[0] for c in chains[:10]])
    exact = np.sqrt((1 + phi**2) / (1 - phi**2) / (2 * 8 * steps))
    assert_allclose(claimed, exact, rtol=0.1)
    sds = chains.std(axis=(1, 2, 3))
    assert_allclose(np.std(sds), exact, rtol=4 / np.sqrt(2 * runs))


def two_modes(x):
    """Return the log-density of a wide and a narrow mode, 0.7 and 0.3 of the whole."""
    apart = ((x[:, None, :] - [[0.0], [6.0]]) ** 2).sum(axis=2)
    return np.logaddexp(*(np.log([0.7, 30.0]) - apart / [2.0, 0.02]).T)


def test_a_stored_run_has_the_verdict_and_the_modes_of_its_samplers(tmp_path):
    posterior = free_posterior(two_modes, box(-8, 12, 2))
    run = ef.run(posterior, "auto", 16, 100, ensembles=3, seed=1)
    path = str(tmp_path / "run.nc")
    ef.to_inference_data(run).to_netcdf(path)
    before, after = ef.diagnose(run), ef.diagnose(az.from_netcdf(path))
    attrs = dataset(az.from_netcdf(path), "posterior").attrs
    assert attrs["origin"] == run.search.sentence
    assert (after.short, after.verdict) == (before.short, before.verdict)
    assert before.modes.weights.shape == (3, 2)
    for name, value in vars(before.modes).items():
        assert_allclose(getattr(after.modes, name), value, rtol=1e-9, err_msg=name)
    assert str(after.modes.table) == str(before.modes.table)
