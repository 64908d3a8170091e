"""How good a proposal is, by fresh draws of it."""

from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp

from ..interfaces import Floats
from ..moves.mixture_em import Mixture, log_density
from .importance import FAIR_SHARE, GOOD_K, kish_share, pareto_k
from .refine import Propose

PAIRED = 500  # draws of which all pairs are compared


@dataclass(frozen=True, eq=False)
class Trial:
    """A proposal, and draws of it.

    Attributes:
        law: The proposal.
        theta: Draws ``(n, d)``, as many of each ensemble, one after another.
        rows: Their rows.
        log_weights: ln(p / q), ``(n,)``.
        k: Pareto k of the weights.
        share: Their effective share.
        log_evidence: Of the posterior, by importance sampling.
    """

    law: Mixture
    theta: Floats
    rows: Floats
    log_weights: Floats
    k: float
    share: float
    log_evidence: float

    @property
    def narrow(self) -> bool:
        """Whether it lacks part of the posterior; nearly equal weights do not."""
        return self.k > GOOD_K and self.share < FAIR_SHARE

    @property
    def acceptance(self) -> float:
        """The acceptance of independence proposals in equilibrium."""
        if not self.share:
            return 0.0
        some = self.log_weights[:: -(-len(self.log_weights) // PAIRED)]
        weights = np.exp(some - some.max())
        # Walkers are where the weights are: w_i min(1, w_j / w_i).
        accepted = np.minimum(weights, weights[:, None]).sum()
        return float(accepted / (len(some) * weights.sum()))


def try_out(law: Mixture, size: int, propose: Propose) -> Trial:
    """Return a trial of ``size`` draws."""
    theta, rows = propose(law, size)
    log_weights = rows[:, 0] - log_density(theta, law)
    return Trial(
        law,
        theta,
        rows,
        log_weights,
        pareto_k(log_weights),
        kish_share(log_weights),
        float(logsumexp(log_weights)) - np.log(len(theta)),
    )
