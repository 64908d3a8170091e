"""A posterior of any density: the FE model does nothing."""

import numpy as np
from scipy import stats

import emcee_femu as ef


class FreeModel:
    """No FE model, for any parameters."""

    variables = ef.modal_variables(1)

    def __call__(self, parameters):
        return ef.ModalSolution(np.ones((len(next(iter(parameters.values()))), 1)))


def box(low, high, d):
    """Return a uniform prior of x1 ... xd."""
    laws = {f"x{i}": stats.uniform(low, high - low) for i in range(1, d + 1)}
    return ef.IndependentPrior(laws)


def free_posterior(log_density, prior, model=None):
    """Return the posterior of a likelihood that is a function of ``(n, d)``."""

    def term(parameters, _):
        return log_density(np.column_stack([parameters[n] for n in prior.names]))

    return ef.LogPosterior(model or FreeModel(), term, prior)
