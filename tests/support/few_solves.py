"""Small problems for an emulator: models that count, stop, fail or ripple."""

import numpy as np

import emcee_femu as ef

DESIGN = np.array([[1.0, 0.4], [-0.3, 1.0], [0.5, 0.5]])
DATA, SD = np.array([0.6, -0.2, 0.3]), 0.1


class Gaussian(ef.likelihoods.term.Term):
    """Independent errors of a vector."""

    def __init__(self, data=DATA, sd=SD):
        self.data, self.sd = data, sd
        self.reads = {"y": ef.Variable({"point": range(len(data))})}

    def deviations(self, parameters, response):
        r = response["y"] - self.data
        return r, np.full_like(r, self.sd)


class Counted:
    """A model of one set at a time; it keeps where it was solved."""

    one_by_one = True

    def __init__(self, function, size):
        self.function, self.solved = function, []
        self.variables = {"y": ef.Variable({"point": range(size)})}

    def __call__(self, parameters):
        x = np.stack([*parameters.values()], axis=1)
        assert len(x) == 1
        self.solved.append(x[0].copy())
        return {"y": np.array([self.function(row) for row in x])}


def bent(x):
    return DESIGN @ x + 0.3 * np.sin(2.0 * x[0]) * np.array([1.0, 0.5, -1.0])


PRIOR = ef.GaussianPrior(["a", "b"], [0.0, 0.0], 1.0, [(-4.0, 4.0)] * 2)


def posed(function=bent, term=None, prior=PRIOR):
    """Return the posterior of a problem, whose model counts."""
    term = Gaussian() if term is None else term
    return ef.LogPosterior(Counted(function, len(term.data)), term, prior)
