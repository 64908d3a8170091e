"""Delayed acceptance: a cheap posterior screens what the full one then decides."""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.random import RandomState
from numpy.typing import ArrayLike

from .. import checks
from ..interfaces import Floats
from .acceptance import Batch, ProposingMove
from .stock_proposals import only_propose


class DelayedAcceptanceMove(ProposingMove):
    r"""Screen the proposals of any move by a cheap posterior; solve only what passes.

    .. math:: \alpha = \min\left\{1, \frac{c(\theta^*)}{c(\theta_i)} e^F\right\}
        \min\left\{1, \frac{p(\theta^*) \, c(\theta_i)}
        {p(\theta_i) \, c(\theta^*)}\right\}

    with the posterior p, the cheap one c and the asymmetry F of the proposal. The
    second factor costs a solve of the full model, and only where the first accepts. The
    posterior is kept exactly whatever c is; a bad one costs acceptance.
    :class:`ReducedModel` gives a good one. If the error of its frequencies is below a
    tenth of their standard deviation, sample c itself: no correction is needed.

    Attributes:
        proposed: Number of proposals so far.
        full_solves: How many of them the full posterior evaluated.
        accepted: How many of these it accepted.

    Args:
        inner: The move that proposes: one of this package, or an emcee ``RedBlueMove``
            or ``MHMove``. Temperatures go around it, as in
            ``TemperedMove(DelayedAcceptanceMove(...), betas)``.
        cheap: Log-probability of c, called with ``(n, ndim)``: returns ``(n,)``, or
            rows that begin with it, as a :class:`LogPosterior` does. It must be finite
            wherever the posterior is, or that region is never sampled.

    Raises:
        TypeError: If inner is another kind of move, or cheap is not callable.
        ValueError: When it proposes: if cheap is not finite at a walker, NaN or +inf at
            a proposal, or of another length.

    Source: Christen and Fox (2005), doi:10.1198/106186005X76983.
    """

    def __init__(self, inner: Any, cheap: Callable[[Floats], ArrayLike]) -> None:
        if not callable(cheap):
            raise TypeError(f"cheap: expected a callable, got {cheap!r}")
        if isinstance(inner, DelayedAcceptanceMove):
            raise TypeError(f"inner: expected no delayed acceptance in it, got {inner}")
        self.inner = inner
        self.cheap = cheap
        self.proposed = self.full_solves = self.accepted = 0
        self._proposing = only_propose(inner)
        self._known: tuple[Floats, Floats] | None = None

    def __str__(self) -> str:
        """Return how many full solves were saved."""
        if not self.proposed:
            return "delayed acceptance: nothing proposed yet"
        share = 1 - self.full_solves / self.proposed
        second = self.accepted / max(self.full_solves, 1)
        return (
            f"delayed acceptance: {self.full_solves} full solves for {self.proposed} "
            f"proposals ({share:.1%} saved); {second:.1%} of the solved were accepted"
        )

    def check(self, nwalkers: int, ndim: int) -> None:
        """Refuse an ensemble that the inner move refuses."""
        self._proposing.check(nwalkers, ndim)

    def batches(self, coords: Floats, random: RandomState) -> Iterator[Batch]:
        """Yield what passes the screen, with the ratio that makes amends for it."""
        cheap = self._cheap_at_walkers(coords)
        for walkers, proposed, log_factors in self._proposing.batches(coords, random):
            old, new = cheap[walkers], self._evaluate(proposed)
            threshold = old - random.standard_exponential(len(walkers))
            if log_factors is not None:
                threshold -= log_factors
            passed = (new > threshold).nonzero()[0]
            walkers, proposed = walkers[passed], proposed[passed]
            self.proposed += len(threshold)
            self.full_solves += len(passed)
            yield walkers, proposed, (old - new)[passed]
            moved = (coords[walkers] == proposed).all(axis=1)
            cheap[walkers[moved]] = new[passed[moved]]
            self.accepted += int(moved.sum())
        self._known = coords.copy(), cheap

    def _cheap_at_walkers(self, coords: Floats) -> Floats:
        """Return c of the walkers; only those that another move changed cost a call."""
        if self._known is None or self._known[0].shape != coords.shape:
            changed, values = np.arange(len(coords)), np.empty(len(coords))
        else:
            changed = (self._known[0] != coords).any(axis=1).nonzero()[0]
            values = self._known[1].copy()  # kept should the full model raise
        if len(changed):
            values[changed] = self._evaluate(coords[changed])
        if not np.isfinite(values).all():
            walker = int(np.argmin(np.isfinite(values)))
            raise ValueError(
                f"cheap: {values[walker]} at walker {walker}, "
                f"{coords[walker].tolist()}; it must be finite wherever the posterior "
                "is (are its bounds narrower?)"
            )
        return values

    def _evaluate(self, theta: Floats) -> Floats:
        rows = checks.numeric_array("cheap", self.cheap(theta))
        log_prob: Floats = rows[:, 0] if rows.ndim == 2 and rows.size else rows
        if log_prob.shape != (len(theta),):
            raise ValueError(
                f"cheap: expected {len(theta)} log-probabilities for as many rows, got "
                f"shape {rows.shape}"
            )
        if not (log_prob < np.inf).all():
            row = int(np.argmin(log_prob < np.inf))
            raise ValueError(f"cheap: {log_prob[row]} at {theta[row].tolist()}")
        return log_prob
