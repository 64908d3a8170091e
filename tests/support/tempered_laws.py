"""Posteriors whose tempered laws and evidence are known in closed form.

Statistics have expectation zero under prior times likelihood**beta.
"""

import numpy as np
from scipy import stats

import emcee_femu as ef

from .free_posterior import FreeModel


class GaussianLaw:
    """Frequencies linear in three parameters, Gaussian prior and errors."""

    C = np.array([[1.0, 0.2, 0.0], [0.5, 1.0, 0.3], [0.1, 0.4, 2.0], [0.3, 0.3, 0.3]])
    offset, measured = np.array([9.0, 20.0, 30.0, 45.0]), np.array([10, 21, 32, 46.0])
    median = stats.chi2.median(3)
    mean, sd, relative_sd = np.array([0.5, 0.3, -0.2]), np.array([1.0, 0.7, 0.5]), 0.03

    def __init__(self):
        term = ef.FrequencyTerm(self.measured, relative_sd=self.relative_sd)
        prior = ef.GaussianPrior(["a", "b", "c"], self.mean, self.sd)
        self.posterior = ef.LogPosterior(self.solve, term, prior)

    def solve(self, parameters):
        columns = np.stack([*parameters.values()], axis=-1)
        # A sum that rounds alike for one row and for many.
        return ef.ModalSolution(
            self.offset + (columns[:, None, :] * self.C).sum(axis=2)
        )

    def moments(self, beta):
        weight = beta * self.C.T / (self.relative_sd * self.measured) ** 2
        covariance = np.linalg.inv(weight @ self.C + np.diag(self.sd**-2.0))
        right = weight @ (self.measured - self.offset) + self.mean / self.sd**2
        return covariance @ right, covariance

    def sample(self, rng, n, beta):
        return rng.multivariate_normal(*self.moments(beta), size=n)

    def statistics(self, theta, beta):
        mean, covariance = self.moments(beta)
        x = np.linalg.solve(np.linalg.cholesky(covariance), (theta - mean).T).T
        core = (x**2).sum(axis=1) < self.median
        pairs = x * np.roll(x, 1, axis=1)
        return np.column_stack([x, x**2 - 1, pairs, core - 0.5])

    @property
    def log_evidence(self):
        errors = np.diag((self.relative_sd * self.measured) ** 2)
        covariance = self.C * self.sd**2 @ self.C.T + errors
        law = stats.multivariate_normal(self.offset + self.C @ self.mean, covariance)
        return float(law.logpdf(self.measured))


class BoundedLaw:
    """Likelihood prod x_i**c_i on the unit box: bounded, and asymmetric."""

    powers = np.array([1.0, 2.0, 4.0])

    def __init__(self):
        self.posterior = ef.LogPosterior(FreeModel(), self.term, _UnitBox())

    def term(self, parameters, modes):
        logs = [np.log(np.maximum(x, 1e-300)) for x in parameters.values()]
        return sum(c * log for c, log in zip(self.powers, logs, strict=True))

    def sample(self, rng, n, beta):
        return rng.random((n, 3)) ** (1 / (beta * self.powers + 1))

    def statistics(self, theta, beta):
        u = theta ** (beta * self.powers + 1)  # uniform on the unit box
        return np.column_stack(
            [u - 1 / 2, u**2 - 1 / 3, u * np.roll(u, 1, axis=1) - 1 / 4]
        )

    @property
    def log_evidence(self):
        return float(-np.log(self.powers + 1).sum())


class _UnitBox:
    names, bounds = ("a", "b", "c"), np.tile([0.0, 1.0], (3, 1))

    def logpdf(self, theta):
        return np.where(((theta >= 0) & (theta <= 1)).all(axis=1), 0.0, -np.inf)

    def sample(self, rng, n):
        return rng.random((n, 3))
