"""What withholds "converged" from chains that agree: groups, proposal, heavy tails."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
import xarray
from numpy.testing import assert_allclose, assert_array_equal
from scipy import stats
from scipy.special import logsumexp
from support.chains import ar1, backend, switching

import emcee_femu as ef
from emcee_femu.results.agreement import excess_scatter, tau_by_ensemble
from emcee_femu.results.arviz_objects import wrap
from emcee_femu.results.groups import expected_acceptance

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
    """Return what "auto" would have found: the modes, and one wide component."""
    matrices = [np.eye(2) * s**2 for s in (*SDS, 6.0)]
    means = [*CENTRES.tolist(), [4.0, 4.0]]
    found = {
        "proposal": [[0.63, 0.27, 0.1], means, np.array(matrices).tolist(), 16.0],
        "group_of": [0, 1, -1],
        "weights": [1 - WEIGHT, WEIGHT],
        "errors": [0.01, 0.01],
        "found_by": [[2, 1]] * 4,
        "start": [[0.75, 0.25]] * 4,
        "pareto_k": 0.1,
        "efficiency": 0.4,
        "searched": [500, 8],
        "share": 0.9,
    }
    return found | changes


def runs(record, share=WEIGHT, stay=0.5, steps=STEPS, ensembles=4, sds=SDS):
    """Return runs of ensembles that visit the second group ``share`` of the time."""
    result = []
    for seed in range(ensembles):
        own = share[seed] if np.ndim(share) else share
        group = switching(own, stay, steps, WALKERS, seed)
        noise = ar1([stay, stay], steps, WALKERS, seed + 100)
        chain = CENTRES[group] + np.array(sds)[group][..., None] * noise
        run = backend(chain, log_prob=log_density(chain))
        run.recipe = SimpleNamespace(record=record)
        result.append(run)
    return result


def test_a_healthy_run_is_converged_and_shows_its_groups():
    found = ef.diagnose(runs(record()))
    assert found.converged, found.verdict
    groups = found.groups
    assert groups.weights.shape == (4, 2)
    # The switches have tau 3.
    expected = np.sqrt(WEIGHT * (1 - WEIGHT) * 3 / (4 * WALKERS * STEPS))
    assert_allclose(groups.errors, expected, rtol=0.1)
    assert (np.abs(groups.weights.mean(axis=0) - [0.7, 0.3]) < 4 * expected).all()
    assert_array_equal(groups.found, [True, True])
    assert groups.chain_k < 0.5 and (groups.acceptance > 0.7).all()
    text, page = str(found), found._repr_html_()
    assert str(groups.table) in text and "importance" in page
    assert text.endswith(found.verdict) and page.endswith(f"<p>{found.verdict}</p>")
    one = record(weights=[1.0], errors=[0.0], group_of=[0, 0, -1], found_by=[[3]] * 4)
    alone = ef.diagnose(runs(one | {"start": [[1.0]] * 4}))
    assert alone.converged and "group" not in str(alone)
    assert ef.diagnose([run.backend if hasattr(run, "backend") else run
                        for run in runs(None)]).groups is None  # fmt: skip


@pytest.mark.parametrize(
    ("short", "changes", "words"),
    [  # each just inside and just outside of its bound
        ("converged", {"weights": [0.735, 0.265]}, "agree"),
        ("weights disagree", {"weights": [0.77, 0.23]}, "but 0.770 (+- 0.010)"),
        ("weights disagree", {"weights": [0.63, 0.37]}, "group 1 holds 0.70"),
        ("converged", {"weights": [0.63, 0.37], "errors": [0.03, 0.03]}, "agree"),
        ("converged", {"pareto_k": 0.69}, "agree"),
        ("proposal too narrow", {"pareto_k": 0.71}, "Pareto k 0.71 of the importance"),
        ("converged", {"share": 0.05}, "agree"),
        ("a group is left too rarely", {"share": 0.02}, "in 600 steps"),
        ("converged", {"share": 0.0}, "agree"),  # only local moves, which are judged
        ("proposal too narrow", {"share": 0.0, "pareto_k": 0.9}, "Pareto k 0.90"),
    ],
)
def test_the_bounds_of_what_a_record_says(short, changes, words):
    found = ef.diagnose(runs(record(**changes)))
    assert found.short == short and words in found.verdict
    assert found.verdict.startswith("Converged" if found.converged else "Not converged")


def third(weights, errors, **changes):
    """Return a record with a third group, far away."""
    given = record()
    given["proposal"][0] = [0.5, 0.3, 0.1, 0.1]
    given["proposal"][1].insert(2, [-30.0, 0.0])
    given["proposal"][2].insert(2, np.eye(2).tolist())
    return (
        given
        | {"group_of": [0, 1, 2, -1], "weights": weights, "errors": errors}
        | {"found_by": [[1, 1, 1]] + [[1, 1, 0]] * 3, "start": [[0.7, 0.3, 0]] * 4}
        | changes
    )


@pytest.mark.parametrize(
    ("short", "given", "words"),
    [
        ("converged", third([0.7, 0.296, 0.004], [0.01, 0.01, 0.001]), "agree"),
        ("a mode is lost", third([0.7, 0.29, 0.01], [0.01, 0.01, 0.002]), "0.010 +-"),
        ("a mode is lost", third([0.7, 0.3, None], [0.01, 0.01, None]), "not known"),
        (
            "a mode is lost",
            third(
                [0.7, 0.3, float("nan")],
                [0.01, 0.01, float("nan")],
                found_by=[[1, 1, 0]] * 4,
                start=[[0.7, 0.25, 0.05]] + [[0.7, 0.3, 0]] * 3,
            ),
            "group 3, where a search ended or a walker started",
        ),
        (
            "converged",
            third([0.7, 0.3, None], [0.01, 0.01, None], found_by=[[1, 1, 0]] * 4),
            "agree",  # nobody was ever there
        ),
    ],
)
def test_a_group_that_no_walker_is_in_any_more(short, given, words):
    found = ef.diagnose(runs(given))
    assert found.short == short and words in found.verdict
    assert np.isnan(found.groups.acceptance[2])


def test_weights_that_differ_between_ensembles_are_not_converged():
    """By some errors, far from what R-hat sees."""
    found = ef.diagnose(runs(record(), share=[0.25, 0.25, 0.35, 0.35]))
    assert (found.rhat_between < 1.01).all()
    assert found.short == "ensembles scatter" and found.groups.scatter.min() > 1
    assert (ef.diagnose(runs(record())).groups.scatter < 0.5).all()


def test_weights_that_nobody_knows_well_are_not_converged():
    unsure = record(errors=[0.02, 0.02])
    found = ef.diagnose(runs(unsure, stay=0.9, steps=1_200))
    assert found.converged and 0.008 < found.groups.errors[0] < 0.0125
    found = ef.diagnose(runs(unsure, stay=0.94, steps=2_000, ensembles=2))
    assert 0.0125 < found.groups.errors[0] < 0.02
    assert found.short == "weights unknown" and "+- 0.01" in found.verdict


def test_a_proposal_that_lacks_what_the_chain_has_is_not_converged():
    """The second mode of the posterior, in which walkers are, is not in the law."""
    narrow = record(weights=[1.0], errors=[0.0], group_of=[0], found_by=[[3]] * 4)
    narrow |= {"start": [[1.0]] * 4, "pareto_k": 0.1}
    narrow["proposal"] = [[1.0], [[0.0, 0.0]], [np.eye(2).tolist()], 8.0]
    found = ef.diagnose(runs(narrow))
    assert found.groups.slowest * 0.9 * STEPS < 10 and found.groups.chain_k < 0.7
    assert found.short == "walkers wait too long" and "in 600 steps" in found.verdict
    assert ef.diagnose(runs(narrow | {"share": 0.0})).converged  # it is not used


def held_to_a_gaussian(chains, variance):
    """Return runs of N(0, 1) with the frozen proposal N(0, variance)."""
    record = {"proposal": [[1.0], [[0.0] * 2], [variance * np.eye(2)], 1e6]}
    record |= {"group_of": [0], "weights": [1.0], "errors": [0.0], "pareto_k": 0.1}
    record |= {"found_by": [[3]] * 4, "start": [[1.0]] * 4}
    samplers = [backend(c, log_prob=stats.norm.logpdf(c).sum(-1)) for c in chains]
    for run in samplers:
        run.recipe = SimpleNamespace(record=record)
    return samplers


@pytest.mark.parametrize(("variance", "k"), [(0.3, 0.7), (0.15, 0.85), (0.8, 0.2)])
def test_the_pareto_k_of_the_chain_is_that_of_the_proposal(variance, k):
    """p is N(0, 1), q is N(0, v): of draws of q k is 1 - v."""
    chains = [ar1([0.5, 0.5], 1_000, 8, seed) for seed in range(4)]
    found = ef.diagnose(held_to_a_gaussian(chains, variance))
    assert_allclose(found.groups.chain_k, k, atol=0.07)
    too_narrow = found.groups.chain_k > 0.7
    assert (found.short == "proposal too narrow") == too_narrow
    assert too_narrow or found.converged == (k < 0.5)


def test_a_walker_that_came_to_the_end_of_a_tail_is_seen():
    chains = [ar1([0.5, 0.5], 1_000, 8, seed) for seed in range(4)]
    assert ef.diagnose(held_to_a_gaussian(chains, 0.8)).converged
    chains[2][500:505, 3] = 6.5, 0.0
    found = ef.diagnose(held_to_a_gaussian(chains, 0.8))
    assert found.groups.slowest < 0.01 and found.short == "walkers wait too long"


def test_the_expected_acceptance_is_that_of_proposals():
    law = ef.IndependenceMove([1.0], [[0.5]], [[[2.0]]], 5.0)
    rng, n = np.random.default_rng(2), 200_000
    x = rng.normal(size=(n, 1))
    log_weights = stats.norm.logpdf(x[:, 0]) - law.log_density(x)
    found = expected_acceptance(log_weights)
    y = 0.5 + np.sqrt(2.0) * rng.standard_t(5.0, size=(n, 1))
    proposed = stats.norm.logpdf(y[:, 0]) - law.log_density(y)
    for i in range(5):
        share = np.exp(np.minimum(0, proposed - log_weights[i]))
        error = 4 * share.std() / np.sqrt(n)
        assert_allclose(found[i], share.mean(), atol=error + 0.004)


def test_scatter_is_a_chi_square_over_its_quantile():
    """Of 150 parameters of the right law; one ensemble shifted by nine errors."""
    steps, walkers, d, phi = 800, 6, 150, 0.6
    draws = np.stack([ar1([phi] * d, steps, walkers, s) for s in range(4)], axis=1)
    moved = np.ones((4, walkers), dtype=bool)
    tau = tau_by_ensemble(draws, moved)
    ratios = excess_scatter(draws, tau)
    chi_square = ratios * 1.5 * stats.chi2.isf(1e-4 / d, 3)
    variance = draws.var(axis=(0, 1, 2)) * tau / (steps * walkers)
    means = draws.mean(axis=(0, 2))
    off = means - (means / variance).sum(axis=0) / (1 / variance).sum(axis=0)
    assert_allclose(chi_square, (off**2 / variance).sum(axis=0), rtol=1e-9)
    assert abs(chi_square.mean() - 3) < 4 * np.sqrt(6 / d) + 0.2  # tau is estimated
    assert stats.kstest(chi_square, stats.chi2(3).cdf).pvalue > 1e-3
    assert ratios.max() < 1
    error = np.sqrt((1 + phi) / (1 - phi) / (steps * walkers))
    few = draws[..., :2].copy()
    few[:, 2] += 9 * error
    assert (excess_scatter(few, tau[:, :2]) > 1).all()
    assert np.isnan(excess_scatter(few[:, :2], tau[:2, :2])).all()
    # An ensemble that never leaves a place has no tau of its own.
    few[:, 1, :, 0] = 0.5
    moved[1] = False
    held = tau_by_ensemble(few, moved)
    assert np.isnan(held[1, 0]) and excess_scatter(few, held)[0] > 1


def test_standard_deviations_that_are_not_known_are_not_converged():
    """Few visits to a heavy tail: R-hat and tau are of the ranks and the centre."""
    chains = [ar1([0.9, 0.9], 1_500, 8, seed) for seed in range(2)]
    for chain in chains:
        chain[..., 1] = np.exp(1.8 * chain[..., 1])
    found = ef.diagnose([backend(chain) for chain in chains])
    assert (found.steps_per_tau > 50).all() and (found.rhat_between < 1.01).all()
    assert found.sd_error[0] < 0.05 and found.sd_error[1] > 0.1
    assert found.short == "sd unknown" and "theta2" in found.verdict


def test_the_error_of_a_standard_deviation_is_its_scatter():
    """Of an autoregressive chain squares forget by phi^2."""
    phi, steps, runs = 0.7, 500, 40
    chains = [ar1([phi], steps, 8, seed) for seed in range(runs)]
    claimed = np.mean([ef.diagnose(backend(c)).sd_error[0] for c in chains])
    sds = [chain.std() for chain in chains]
    exact = np.sqrt((1 + phi**2) / (1 - phi**2) / (2 * 8 * steps))
    assert_allclose(claimed, exact, rtol=0.1)
    assert_allclose(np.std(sds), exact, rtol=4 / np.sqrt(2 * runs))


@pytest.mark.parametrize("discard", [0, 100])
def test_an_arviz_object_knows_the_groups_of_its_samplers(discard):
    given = third([0.6, 0.3, None], [0.01, 0.01, None])
    samplers = runs(given)
    chain = np.concatenate([s.get_chain().swapaxes(0, 1) for s in samplers])
    log_prob = np.concatenate([s.get_log_prob().T for s in samplers])
    coords = {"ensemble": ("chain", np.repeat(np.arange(4), WALKERS))}
    attrs = {"sample_dims": ["chain", "draw"], "recipe": json.dumps(given)}
    names = ["theta1", "theta2"]
    posterior = {n: (("chain", "draw"), chain[..., i]) for i, n in enumerate(names)}
    idata = wrap(
        {
            "posterior": xarray.Dataset(posterior, coords, attrs),
            "sample_stats": xarray.Dataset({"lp": (("chain", "draw"), log_prob)}),
        }
    )
    found, expected = ef.diagnose(idata, discard), ef.diagnose(samplers, discard)
    for name, value in vars(expected.groups).items():
        assert_array_equal(getattr(found.groups, name), value, err_msg=name)
    assert found.verdict == expected.verdict
    del idata["posterior"].attrs["recipe"]
    assert ef.diagnose(idata, discard).groups is None
