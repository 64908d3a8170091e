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
every_model = pytest.mark.parametrize("model", MODELS)
every_pool = pytest.mark.parametrize("pool", POOLS)


def with_notes():
    error = ArithmeticError("the solver did not converge")
    error.add_note("iteration 50")
    return error


FAULTS = {
    "-inf": -np.inf,
    "+inf": np.inf,
    "NaN": np.nan,
    "SystemExit": partial(SystemExit, "licence server not found"),
    "StopIteration": partial(StopIteration, "no more output"),
    "an error with notes": with_notes,
}
every_fault = pytest.mark.parametrize("fault", FAULTS)


def posterior(model):
    return ef.LogPosterior(model, TERM, PRIOR)


def places(text):
    """Return k of every parameter set in a text."""
    return {float(k) for k in re.findall(r"\{'k': ([0-9.]+), 'm': [0-9.]+\}", text)}


def is_as_raised(error, fault):
    """Return whether an error is what a solver's fault should become."""
    if isinstance(FAULTS[fault], float):
        return isinstance(error, SolveError) and error.cause == "not finite"
    if fault == "an error with notes":  # kept, and the parameters said once
        notes = error.__notes__
        once = sum(note.startswith(PLACE) for note in notes) == 1
        return type(error) is ArithmeticError and notes[0] == "iteration 50" and once
    return type(error) is RuntimeError and repr(FAULTS[fault]()) in str(error)


@every_model
@every_fault
@pytest.mark.parametrize("column", [0, 1])
def test_an_evaluation_says_what_was_wrong_and_where(model, fault, column):
    log_posterior = posterior(MODELS[model](FAULTS[fault], column))
    with pytest.raises((SolveError, RuntimeError, ArithmeticError)) as caught:
        log_posterior([1.5, 0.75])
    assert is_as_raised(caught.value, fault)
    notes = getattr(caught.value, "__notes__", ())
    assert "{'k': 1.5, 'm': 0.75}" in f"{caught.value} {notes}"
    assert np.isfinite(log_posterior([[1.0, 1.0], [1.0, 1.1]])).all()


@every_pool
@every_model
@every_fault
def test_a_run_stops_with_the_place_and_keeps_what_it_has(model, fault, pool):
    with pytest.raises((SolveError, RuntimeError, ArithmeticError)) as caught:
        ef.run(posterior(MODELS[model](FAULTS[fault])), **OPTIONS, **POOLS[pool]())
    error = caught.value
    assert is_as_raised(error, fault) and error.samplers[0].iteration > 0
    notes = [note.partition("\n")[0] for note in getattr(error, "__notes__", ())]
    found = places(str(error)) or places("\n".join(notes))
    if model == "vectorised" and pool == "serial" and not isinstance(error, SolveError):
        assert 1 < len(found) <= 6 and max(found) > LIMIT  # half an ensemble raised
    else:
        assert len(found) == 1 and min(found) > LIMIT


@cache
def expected_chain():
    """Return the chain of a prior that ends at the limit."""
    bounds = [(0.1, LIMIT), (0.1, 2.0)]
    prior = ef.GaussianPrior(["k", "m"], [1.0, 1.0], [0.2, 0.2], bounds=bounds)
    (sampler,) = ef.run(ef.LogPosterior(one_by_one(0.0), TERM, prior), **OPTIONS)
    return sampler.get_chain()


@every_pool
@every_model
@every_fault
def test_every_fault_can_be_rejected_and_is_counted(model, fault, pool):
    beyond.clear()
    log_posterior = posterior(MODELS[model](FAULTS[fault]))
    (sampler,) = ef.run(log_posterior, **OPTIONS, **REJECT, **POOLS[pool]())
    cause = "not finite" if isinstance(FAULTS[fault], float) else "exception"
    assert sampler.failures.causes == {cause: len(sampler.failures.kept)}
    found = {failed.parameters["k"] for failed in sampler.failures.kept}
    assert len(found) > 10 and min(found) > LIMIT
    if cause == "not finite":
        assert found == {*beyond} and len(sampler.failures.kept) == len(found)
    np.testing.assert_array_equal(sampler.get_chain(), expected_chain())


# --- a move that goes on from where its last run ended ----------------------------


def gaussian(mode):
    return emcee.moves.GaussianMove([0.01, 0.02], mode=mode)


def cheap(theta):
    return -0.5 * ((theta - 1.0) ** 2).sum(axis=-1)


INSIDE = {
    "alone": lambda move: move,
    "in a weighted list": lambda move: [[move, 0.1], [ef.DEMCMove(), 0.9]],
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
