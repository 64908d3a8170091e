"""Failures of a solver that are easily missed, and a move that cannot go on."""

import re
from functools import cache, partial

import emcee
import numpy as np
import pytest
from support.pool_problems import Immediate

import emcee_femu as ef
from emcee_femu.interfaces import PLACE, SolveError

LIMIT = 1.3  # which no walker is beyond at first
PRIOR = ef.GaussianPrior(["k", "m"], [1.0, 1.0], [0.2, 0.2], bounds=[(0.1, 2.0)] * 2)
TERM = ef.FrequencyTerm([1.0, 2.0], sd=[0.2, 0.4])
START = np.random.default_rng(0).uniform(0.95, 1.05, (12, 2))
OPTIONS = {"nwalkers": 12, "nsteps": 40, "seed": 1, "initial": START}
REJECT = {"on_failure": "reject", "max_failures": 1.0}
beyond = []  # parameter sets beyond the limit that were solved, in this process


class Solver:
    """A solver of one parameter set, with something odd beyond the limit.

    That is a frequency, in one column, or what makes an exception.
    """

    def __init__(self, odd, column=0):
        self.odd, self.column = odd, column

    def __call__(self, p):
        frequencies = [p["k"], 2 * p["m"]]
        if p["k"] > LIMIT:
            beyond.append(p["k"])
            if not isinstance(self.odd, float):
                raise self.odd()
            frequencies[self.column] = self.odd
        return frequencies


class Vectorised(Solver):
    """The same of all walkers at once."""

    variables = ef.modal_variables(2)

    def __call__(self, parameters):
        k, m = parameters["k"], parameters["m"]
        frequencies = np.column_stack([k, 2 * m])
        if (k > LIMIT).any():
            if not isinstance(self.odd, float):
                raise self.odd()
            frequencies[k > LIMIT, self.column] = self.odd
            if len(k) == 1:
                beyond.append(float(k[0]))
        return ef.ModalSolution(frequencies)


def one_by_one(odd, column=0):
    return ef.FunctionModel(Solver(odd, column), n_modes=2)


MODELS = {"one by one": one_by_one, "vectorised": Vectorised}
POOLS = {
    "serial": dict,
    "emcee's map": lambda: {"vectorize": False},
    "in an EvaluationPool": lambda: {"pool": ef.EvaluationPool(Immediate())},
    "by a bare pool": lambda: {"pool": Immediate()},
}
ODD = {"-inf": -np.inf, "+inf": np.inf, "NaN": np.nan}
every_model = pytest.mark.parametrize("model", MODELS)
every_pool = pytest.mark.parametrize("pool", POOLS)


def posterior(model):
    return ef.LogPosterior(model, TERM, PRIOR)


def places(text):
    """Return k of every parameter set in a text."""
    return {float(k) for k in re.findall(r"\{'k': ([0-9.]+), 'm': [0-9.]+\}", text)}


def named(error, model, pool):
    """Return whether the message, or else the notes, name the place.

    A batch that raises in this process is named as a whole.
    """
    notes = [note.partition("\n")[0] for note in getattr(error, "__notes__", ())]
    found = places(str(error)) or places("\n".join(notes))
    if model == "vectorised" and pool == "serial" and not isinstance(error, SolveError):
        return 1 < len(found) <= 6 and max(found) > LIMIT  # half an ensemble
    return len(found) == 1 and min(found) > LIMIT


@cache
def expected_chain():
    """Return the chain of a prior that ends at the limit."""
    bounds = [(0.1, LIMIT), (0.1, 2.0)]
    prior = ef.GaussianPrior(["k", "m"], [1.0, 1.0], [0.2, 0.2], bounds=bounds)
    (sampler,) = ef.run(ef.LogPosterior(one_by_one(0.0), TERM, prior), **OPTIONS)
    return sampler.get_chain()


# --- frequencies that are not finite ----------------------------------------------


@every_model
@pytest.mark.parametrize("column", [0, 1])
@pytest.mark.parametrize("odd", ODD)
def test_a_frequency_that_is_not_finite_is_a_failure(model, odd, column):
    log_posterior = posterior(MODELS[model](ODD[odd], column))
    theta = np.array([[1.0, 1.0], [1.5, 0.75], [1.0, 1.1]])
    for given in (theta, theta[1]):
        with pytest.raises(SolveError, match="finite numbers") as caught:
            log_posterior(given)
        assert caught.value.cause == "not finite"
        assert "{'k': 1.5, 'm': 0.75}" in str(caught.value)
        assert places(str(caught.value)) == {1.5}
    assert np.isfinite(log_posterior(theta[[0, 2]])).all()


@every_pool
@every_model
@pytest.mark.parametrize("odd", ODD)
def test_a_run_stops_at_a_frequency_that_is_not_finite(model, odd, pool):
    with pytest.raises(ValueError, match="finite numbers") as caught:
        ef.run(posterior(MODELS[model](ODD[odd])), **OPTIONS, **POOLS[pool]())
    assert caught.value.cause == "not finite"  # it survives the journey, too
    assert named(caught.value, model, pool)
    assert caught.value.samplers[0].iteration > 0


@every_pool
@every_model
@pytest.mark.parametrize("odd", ODD)
def test_every_frequency_that_is_not_finite_is_rejected_and_counted(model, odd, pool):
    beyond.clear()
    log_posterior = posterior(MODELS[model](ODD[odd]))
    (sampler,) = ef.run(log_posterior, **OPTIONS, **REJECT, **POOLS[pool]())
    assert len({*beyond}) > 10
    assert sampler.failures.causes == {"not finite": len({*beyond})}
    assert {failed.parameters["k"] for failed in sampler.failures.kept} == {*beyond}
    np.testing.assert_array_equal(sampler.get_chain(), expected_chain())


# --- what a solver should not raise -----------------------------------------------


LEAVES = {
    "SystemExit": partial(SystemExit, "licence server not found"),
    "SystemExit without a word": SystemExit,
    "StopIteration": partial(StopIteration, "no more output"),
}


@pytest.mark.parametrize("leave", LEAVES)
def test_a_solver_that_leaves_is_a_runtime_error_with_its_parameters(leave):
    raised = repr(LEAVES[leave]())
    parameters = {"k": np.array([1.0, 1.5]), "m": np.array([1.0, 0.75])}
    with pytest.raises(RuntimeError, match="^function: it raised") as caught:
        one_by_one(LEAVES[leave])(parameters)
    assert raised in str(caught.value) and places(str(caught.value)) == {1.5}
    assert repr(caught.value.__cause__) == raised

    with pytest.raises(RuntimeError, match="^model: it raised") as caught:
        posterior(Vectorised(LEAVES[leave]))([1.5, 0.75])
    assert raised in str(caught.value) and places(str(caught.value)) == {1.5}
    assert repr(caught.value.__cause__) == raised


@every_pool
@every_model
@pytest.mark.parametrize("leave", LEAVES)
def test_a_run_ends_with_an_error_where_a_solver_leaves(model, leave, pool):
    with pytest.raises(RuntimeError, match="it raised") as caught:
        ef.run(posterior(MODELS[model](LEAVES[leave])), **OPTIONS, **POOLS[pool]())
    assert repr(LEAVES[leave]()) in str(caught.value)
    assert named(caught.value, model, pool)
    assert caught.value.samplers[0].iteration > 0


@every_pool
@every_model
@pytest.mark.parametrize("leave", ["SystemExit", "StopIteration"])
def test_a_solver_that_leaves_can_be_rejected(model, leave, pool):
    log_posterior = posterior(MODELS[model](LEAVES[leave]))
    (sampler,) = ef.run(log_posterior, **OPTIONS, **REJECT, **POOLS[pool]())
    assert sampler.failures.causes["exception"] == len(sampler.failures.kept) > 10
    assert sampler.failures.causes.keys() == {"exception"}
    for failed in sampler.failures.kept:
        assert failed.parameters["k"] > LIMIT
        assert repr(LEAVES[leave]()) in failed.message
    np.testing.assert_array_equal(sampler.get_chain(), expected_chain())


def with_notes():
    error = ArithmeticError("the solver did not converge")
    error.add_note("iteration 50")
    error.add_note("see the log of the solver")
    return error


@every_model
def test_an_error_with_notes_of_its_own_still_gets_the_parameters(model):
    with pytest.raises(ArithmeticError, match="^the solver did not") as caught:
        posterior(MODELS[model](with_notes))([1.5, 0.75])
    *own, last = caught.value.__notes__
    assert own == ["iteration 50", "see the log of the solver"]
    assert last == PLACE + " {'k': 1.5, 'm': 0.75}"  # said once, by the innermost


@every_pool
@every_model
def test_a_run_keeps_notes_and_parameters(model, pool):
    with pytest.raises(ArithmeticError) as caught:
        ef.run(posterior(MODELS[model](with_notes)), **OPTIONS, **POOLS[pool]())
    assert caught.value.__notes__[:2] == ["iteration 50", "see the log of the solver"]
    assert sum(note.startswith(PLACE) for note in caught.value.__notes__) == 1
    assert named(caught.value, model, pool)


# --- a move that goes on from where its last run ended ----------------------------


def gaussian(mode):
    return emcee.moves.GaussianMove([0.01, 0.02], mode=mode)


def cheap(theta):
    return -0.5 * ((theta - 1.0) ** 2).sum(axis=-1)


INSIDE = {
    "alone": lambda move: move,
    "in a list": lambda move: [ef.DEMCMove(), move],
    "in a weighted list": lambda move: [(ef.DEMCMove(), 0.9), (move, 0.1)],
    "in weighted pairs as lists": lambda move: [[move, 0.1], [ef.DEMCMove(), 0.9]],
    "in a TemperedMove": lambda move: ef.TemperedMove(move, betas=[1.0, 0.5]),
    "in a DelayedAcceptanceMove": lambda move: ef.DelayedAcceptanceMove(move, cheap),
    "in one in the other": lambda move: [
        (ef.TemperedMove(ef.DelayedAcceptanceMove(move, cheap), betas=[1, 0.5]), 1.0)
    ],
}


@pytest.mark.parametrize("inside", INSIDE)
def test_a_sequential_gaussian_move_is_refused_by_name(inside, tmp_path):
    file = tmp_path / "run.chain"
    moves = INSIDE[inside](gaussian("sequential"))
    with pytest.raises(ValueError, match="^moves: GaussianMove.*sequential.*'random'"):
        ef.run(posterior(one_by_one(0.5)), moves, backend=file, **OPTIONS)
    assert not file.exists()


@pytest.mark.parametrize("mode", ["random", "vector"])
@pytest.mark.parametrize("inside", INSIDE)
def test_other_gaussian_moves_give_the_same_chain_again(inside, mode):
    moves = INSIDE[inside](gaussian(mode))
    first, again = (
        ef.run(posterior(one_by_one(0.5)), moves, **OPTIONS | {"nsteps": 10})[0]
        for _ in range(2)
    )
    np.testing.assert_array_equal(first.get_chain(), again.get_chain())


def test_the_reason_for_the_refusal_holds():
    # If a release of emcee mends it, this fails and the refusal may go.
    move = gaussian("sequential")
    first, again = (
        move.get_proposal(np.ones((4, 2)), np.random.RandomState(1))[0]
        for _ in range(2)
    )
    assert not np.array_equal(first, again)
