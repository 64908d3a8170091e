"""Solvers that do something odd where a parameter is large, in all ways that occur."""

from functools import partial

import numpy as np

import emcee_femu as ef

LIMIT = 1.3  # which no walker of START is beyond
PRIOR = ef.GaussianPrior(["k", "m"], [1.0, 1.0], [0.2, 0.2], bounds=[(0.1, 2.0)] * 2)
UP_TO_LIMIT = ef.GaussianPrior(
    ["k", "m"], [1.0, 1.0], [0.2, 0.2], bounds=[(0.1, LIMIT), (0.1, 2.0)]
)
TERM = ef.FrequencyTerm([1.0, 2.0], sd=[0.1, 0.2])
START = np.random.default_rng(0).uniform(0.95, 1.05, (12, 2))


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


class Solver:
    """A solver of one parameter set, with something odd beyond the limit.

    That is a frequency, in one column, or what makes an exception.
    """

    def __init__(self, fault, column=0):
        self.fault, self.column = FAULTS[fault], column

    def __call__(self, p):
        frequencies = [p["k"], 2 * p["m"]]
        if p["k"] > LIMIT:
            if not isinstance(self.fault, float):
                raise self.fault()
            frequencies[self.column] = self.fault
        return frequencies


class Vectorised(Solver):
    """The same of all walkers at once."""

    variables = ef.modal_variables(2)

    def __call__(self, parameters):
        k, m = parameters["k"], parameters["m"]
        frequencies = np.column_stack([k, 2 * m])
        if (k > LIMIT).any():
            if not isinstance(self.fault, float):
                raise self.fault()
            frequencies[k > LIMIT, self.column] = self.fault
        return ef.ModalSolution(frequencies)


def one_by_one(fault, column=0):
    return ef.FunctionModel(Solver(fault, column), n_modes=2)


MODELS = {"one by one": one_by_one, "vectorised": Vectorised}


def posterior(model, fault, column=0, prior=PRIOR):
    return ef.LogPosterior(MODELS[model](fault, column), TERM, prior)


def is_as_raised(error, fault):
    """Return whether an error is what a solver's fault should become."""
    if isinstance(FAULTS[fault], float):
        return isinstance(error, ValueError) and "finite" in str(error)
    if fault == "an error with notes":  # which it keeps
        return type(error) is ArithmeticError and error.__notes__[0] == "iteration 50"
    return type(error) is RuntimeError and repr(FAULTS[fault]()) in str(error)
