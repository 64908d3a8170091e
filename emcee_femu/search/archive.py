"""The archive of a search: its draws, weighted by all laws that they came from."""

from functools import cached_property

import numpy as np
from scipy.special import logsumexp, softmax

from ..contracts import Floats
from ..moves.mixture import Mixture
from ..posterior.log_posterior import LOG_POSTERIOR, LOG_PRIOR
from .importance import (
    EVIDENCE_APART,
    are_reliable,
    find_acceptance,
    kish_share,
    pareto_k,
)
from .proposal import Labels, Proposal, assign

# Effective draws below which a kurtosis would come from a few of them.
FEWEST_OF_KURTOSIS = 100


class Archive:
    r"""All draws so far, weighted as if they came from the mixture of all their laws.

    .. math:: w(x) = \frac{p(x)}{\sum_t n_t q_t(x)}

    so that the weights sum to the evidence. It leaves out points that were not drawn
    from a known law, such as given starts and the ends of climbs.

    Source: Cornuet, Marin, Mira and Robert (2012),
    doi:10.1111/j.1467-9469.2011.00756.x.

    Attributes:
        x: Draws of finite log-posterior, ``(n, d)``.
        log_p: Their log-posteriors.
        log_q: The logarithms of the sum in the denominator.

    Args:
        ndim: Number of parameters d.
    """

    def __init__(self, ndim: int) -> None:
        self.x: Floats = np.empty((0, ndim))
        self.log_p, self.log_q = np.empty(0), np.empty(0)
        self._log_prior = np.empty(0)
        self._laws: list[tuple[int, Mixture | None]] = []

    def add(self, x: Floats, rows: Floats, law: Mixture | None = None) -> None:
        """Add draws ``(n, d)`` of a law, with their rows; None stands for the prior.

        Impossible draws are counted, but not kept.
        """
        n, possible = len(x), np.isfinite(rows[:, LOG_POSTERIOR])
        x, log_prior = x[possible], rows[possible, LOG_PRIOR]
        self._laws.append((n, law))
        old = _log_density(law, self.x, self._log_prior)
        self.log_q = np.logaddexp(self.log_q, np.log(n) + old)
        log_q = np.full(len(x), -np.inf)
        for count, each in self._laws:
            new = _log_density(each, x, log_prior)
            log_q = np.logaddexp(log_q, np.log(count) + new)
        self.x = np.vstack([self.x, x])
        self.log_p = np.append(self.log_p, rows[possible, LOG_POSTERIOR])
        self.log_q = np.append(self.log_q, log_q)
        self._log_prior = np.append(self._log_prior, log_prior)

    @property
    def log_weights(self) -> Floats:
        """The logarithms of the weights w, ``(n,)``."""
        return np.asarray(self.log_p - self.log_q)

    @property
    def shares(self) -> Floats:
        """The weights divided by their sum, ``(n,)``."""
        return np.asarray(softmax(self.log_weights))

    @property
    def log_evidence(self) -> float:
        """The logarithm of the sum of the weights."""
        return float(logsumexp(self.log_weights))

    @property
    def effective(self) -> float:
        """The number of independent draws that would estimate a mean equally well."""
        return len(self.x) * kish_share(self.log_weights)

    @property
    def influence(self) -> Floats:
        """What each draw contributes to the variance of each parameter, ``(n, d)``."""
        shares = self.shares
        return np.asarray(shares[:, None] * (self.x - shares @ self.x) ** 2)

    @property
    def kurtosis(self) -> Floats:
        """Kurtosis of each parameter; 0 if few draws have weight, or it is constant."""
        shares = self.shares
        squares = (self.x - shares @ self.x) ** 2
        second, fourth = shares @ squares, shares @ squares**2
        known = (second > 0) & (self.effective > FEWEST_OF_KURTOSIS)
        return np.divide(fourth, second**2, out=np.zeros_like(second), where=known)

    def log_ratio(self, law: Mixture) -> Floats:
        """Return ln(p / q) at each draw, with p normalised by the evidence."""
        log_q = law.log_density(self.x)
        return np.asarray(self.log_p - self.log_evidence - log_q)

    def effective_share(self, law: Mixture) -> float:
        r"""Return what the effective share of draws of another law would be.

        .. math:: \frac{E_q[w]^2}{E_q[w^2]} = \frac{Z}{E_p[p / q]}
        """
        excess = self.log_p - law.log_density(self.x)
        top = excess.max()
        mean = self.shares @ np.exp(excess - top)
        return float(np.exp(self.log_evidence - top) / mean)


def _log_density(law: Mixture | None, x: Floats, log_prior: Floats) -> Floats:
    return log_prior if law is None else law.log_density(x)


class JudgedProposal:
    """A proposal, judged by fresh draws of it.

    Args:
        proposal: The proposal.
        theta: Its draws ``(n, d)``.
        rows: Their rows.

    Attributes:
        log_p: The log-posterior of each draw.
        log_q: The log density of the proposal there.
        log_weights: ln(p / q) of each draw.
        pareto_k: Pareto k of the weights.
        efficiency: Effective share of the weights.
        log_evidence: Log evidence by importance sampling.
    """

    def __init__(self, proposal: Proposal, theta: Floats, rows: Floats) -> None:
        self.proposal, self.theta, self.rows = proposal, theta, rows
        self.log_p = rows[:, LOG_POSTERIOR]
        self.log_q = proposal.law.log_density(theta)
        self.log_weights = self.log_p - self.log_q
        self.pareto_k = pareto_k(self.log_weights)
        self.efficiency = kish_share(self.log_weights)
        self.log_evidence = float(logsumexp(self.log_weights)) - np.log(len(theta))

    @cached_property
    def labels(self) -> Labels:
        """The maximum of each component of the proposal, ``(k,)``."""
        return self.proposal.separate()

    @cached_property
    def owner(self) -> Labels:
        """The maximum that each draw belongs to, ``(n,)``."""
        return assign(self.theta, self.proposal.law, self.labels)

    @property
    def reliable(self) -> bool:
        """Whether it covers the posterior as far as its weights can tell."""
        return are_reliable(self.pareto_k, self.efficiency)

    @property
    def acceptance(self) -> float:
        """The acceptance of independence proposals in equilibrium."""
        return find_acceptance(self.log_p, self.log_q, self.log_q)

    def is_better(self, other: "JudgedProposal") -> bool:
        """Return whether it finds more of the posterior, or fits better."""
        if not (self.efficiency and other.efficiency):  # one never met the posterior
            return self.efficiency > other.efficiency
        gain = self.log_evidence - other.log_evidence
        better = self.efficiency > other.efficiency
        return gain > EVIDENCE_APART or (gain > -EVIDENCE_APART and better)
