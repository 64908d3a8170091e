"""A posterior from few solves: what it finds, when it stops, what it refuses."""

import logging
import pickle
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from scipy import stats
from support.few_solves import (
    DATA,
    DESIGN,
    PRIOR,
    SD,
    Gaussian,
    broken,
    linear,
    posed,
    rippled,
    square,
)

import emcee_femu as ef

GRID = np.stack(np.meshgrid(*[np.linspace(-3.0, 3.0, 241)] * 2), axis=-1).reshape(-1, 2)


def weigh(posterior):
    """Return the posterior's shares of the grid."""
    log_p = posterior(GRID)[:, 0]
    shares = np.exp(log_p - log_p.max())
    return shares / shares.sum()


def test_a_linear_model_is_known_exactly_after_two_batches():
    emulated = ef.emulate(posed(linear), 60, seed=1)
    assert emulated.solves == 6 + 2 * 2
    precision = DESIGN.T @ DESIGN / SD**2 + np.eye(2)
    exact = np.linalg.solve(precision, DESIGN.T @ DATA / SD**2)
    weights = weigh(emulated.posterior)
    mean = weights @ GRID
    covariance = (weights * (GRID - mean).T) @ (GRID - mean)
    np.testing.assert_allclose(mean, exact, atol=1e-3)
    np.testing.assert_allclose(covariance, np.linalg.inv(precision), atol=1e-4)


@pytest.mark.slow
def test_both_modes_are_found_with_their_weights():
    data = np.array([1.0, 0.2])
    prior = ef.GaussianPrior(["a", "b"], [0.3, 0.0], 1.0, [(-3.0, 3.0)] * 2)
    posterior = posed(square, term=Gaussian(data, 0.2), prior=prior)
    emulated = ef.emulate(posterior, 30, seed=2)
    exact, found = weigh(posterior_of(square, data, prior)), weigh(emulated.posterior)
    left = GRID[:, 0] < 0
    assert abs(found[left].sum() - exact[left].sum()) < 0.01
    assert 0.5 * abs(found - exact).sum() < 0.03  # total variation


def posterior_of(function, data, prior):
    """Return the same posterior for a batch."""

    def model(parameters):
        x = np.stack([*parameters.values()], axis=1)
        return {"y": np.array([function(row) for row in x])}

    return ef.LogPosterior(model, Gaussian(data, 0.2), prior)


@pytest.mark.slow
def test_true_errors_decide_where_predicted_ones_do_not_see():
    strict = ef.emulate(posed(rippled), 26, seed=1, tolerance=0.3)
    assert strict.solves == 26
    assert min(strict.history.column("true error")[:-1]) > 0.3
    assert ef.emulate(posed(rippled), 26, seed=1, tolerance=50.0).solves == 10


def test_no_tolerance_spends_all_solves_and_history_tells():
    posterior = posed()
    emulated = ef.emulate(posterior, 11, seed=1, tolerance=0.0)
    assert emulated.solves == len(posterior.model.solved) == 11
    assert emulated.history.column("solves") == [6, 8, 10, 11]
    assert np.isfinite(emulated.history.column("true error")[:-1]).all()
    assert "11 full solves" in str(emulated)
    again = pickle.loads(pickle.dumps(emulated))
    theta = PRIOR.sample(np.random.default_rng(1), 5)
    assert (again.posterior(theta) == emulated.posterior(theta)).all()


@pytest.mark.slow
def test_the_first_design_lies_where_it_is_asked_for():
    wide, near, given = posed(), posed(), posed()
    ef.emulate(wide, 8, seed=1)
    ef.emulate(near, 8, seed=1, initial=[0.5, -0.5])
    points = np.array([[0.1, 0.2], [0.5, -0.4], [0.6, 0.9], [-0.3, 0.1]])
    ef.emulate(given, 8, seed=1, initial=points)
    spreads = [np.std(own.model.solved[:6], axis=0) for own in (wide, near)]
    assert (spreads[0] > 2 * spreads[1]).all()
    assert (near.model.solved[0] == [0.5, -0.5]).all()
    assert (given.model.solved[:4] == points).all()


def hopeless(x):
    raise ArithmeticError("no equilibrium")


def test_failed_solves_are_left_out_and_not_asked_again(caplog):
    caplog.set_level(logging.CRITICAL, "emcee_femu")
    posterior = posed(broken)
    emulated = ef.emulate(
        posterior, 14, seed=3, on_failure="reject", max_failures=0.5, tolerance=0.0
    )
    solved = np.array(posterior.model.solved)
    failed = solved[:, 0] > 0.9
    assert 0 < failed.sum() < 7
    assert emulated.solves == 14
    assert len(emulated.processes.points) == 14 - failed.sum()
    assert len(np.unique(solved, axis=0)) == 14
    with pytest.raises(ArithmeticError, match="no equilibrium"):
        ef.emulate(posed(broken), 24, seed=3)
    never = posed(hopeless)
    with pytest.raises(RuntimeError, match="only 0 of 6 solves of the first design"):
        ef.emulate(never, 24, seed=3, on_failure="reject", max_failures=1.0)
    with pytest.raises(RuntimeError, match="on_failure: .* of 6 solves failed"):
        ef.emulate(posed(broken), 24, seed=3, on_failure="reject", max_failures=0.0)


@pytest.mark.slow
def test_a_pool_changes_no_bit():
    serial = ef.emulate(posed(), 9, seed=4)
    with ThreadPoolExecutor(3) as pool:
        threads = ef.emulate(posed(), 9, seed=4, pool=pool)
    theta = PRIOR.sample(np.random.default_rng(1), 5)
    assert threads.solves == serial.solves
    assert (threads.posterior(theta) == serial.posterior(theta)).all()


def test_inferred_errors_are_no_inputs_of_the_emulator():
    model = ef.FunctionModel(lambda p: [p["k"] ** 0.5, (3 * p["k"]) ** 0.5], n_modes=2)
    prior = ef.IndependentPrior(
        {"k": ef.uniform_between(5.0, 12.0), "s": stats.halfnorm(scale=0.02)}
    )
    term = ef.FrequencyTerm([3.0, 5.2], discrepancy="s")
    posterior = ef.LogPosterior(model, term, prior)
    emulated = ef.emulate(posterior, 12, seed=1)
    assert emulated.names == ("k",)
    theta = prior.sample(np.random.default_rng(1), 50)
    found, full = emulated.posterior(theta)[:, 0], posterior(theta)[:, 0]
    near = full > full.max() - 10
    np.testing.assert_allclose(found[near], full[near], atol=0.1)


def refused(posterior=None, error=ValueError, match="", solves=20, **options):
    posterior = posed() if posterior is None else posterior
    with pytest.raises(error, match=match):
        ef.emulate(posterior, solves, **{"seed": 1, **options})
    return posterior


def test_what_cannot_work_is_refused_before_the_first_solve():
    for posterior in (
        refused(solves=7, match="solves: expected at least 8 for 2 parameters"),
        refused(initial=[9.0, 0.0], match="initial: a = 9"),
        refused(initial=[[0.0, 0.0]], match="initial: .*at least 3 points"),
        refused(initial=[[0.0, x] for x in range(3)], match="one value of .'a'"),
        refused(tolerance=-1.0, match="tolerance"),
        refused(on_failure="stop", match="on_failure"),
        refused(pool=3, error=TypeError, match="pool"),
        refused(progress="no such bar", match="progress"),
        refused(backend=7, error=TypeError, match="backend"),
    ):
        assert posterior.model.solved == []
    with pytest.raises(TypeError, match="posterior: expected a LogPosterior"):
        ef.emulate(lambda theta: 0.0, seed=1)
    one = posed()
    joint = ef.LogPosterior.joint(
        {name: (one.model, Gaussian()) for name in ("empty", "loaded")}, PRIOR
    )
    refused(joint, match=r"expected one experiment to emulate, got \['empty', 'load")

    def silent(parameters, response):
        return np.zeros(len(parameters["a"]))

    modes = ef.LogPosterior(ef.FunctionModel(lambda p: [1.0], n_modes=1), silent, PRIOR)
    refused(modes, match="'silent' says what it reads")
