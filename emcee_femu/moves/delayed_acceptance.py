"""Delayed acceptance: a cheap posterior screens proposals for the full one."""

from collections.abc import Callable, Iterator
from copy import copy, deepcopy
from typing import Self, TypeAlias

import numpy as np
from emcee.moves import Move
from numpy.random import RandomState
from numpy.typing import ArrayLike, NDArray

from .. import checks
from ..contracts import LOG_POSTERIOR, Floats
from ..table import Parts, Report
from .independence import IndependenceMove
from .proposing import Batch, Propose, ProposingMove, only_propose, refresh

Steps: TypeAlias = int | tuple[int, int]


class DelayedAcceptanceMove(ProposingMove, Report):
    r"""Screen another move's proposals with a cheap posterior; solve those that pass.

    .. math:: \alpha = \min\left\{1, \frac{c(\theta^*)}{c(\theta_i)} e^F\right\}
        \min\left\{1, \frac{p(\theta^*) \, c(\theta_i)}
        {p(\theta_i) \, c(\theta^*)}\right\}

    where p is the posterior, c the cheap one, and F the log Hastings factor of the
    proposal. Use it if you have an approximate model that is much faster than the full
    one. The second factor costs one full solve, and only for proposals that pass the
    first. The chain samples p exactly, whatever c is; a poor c only lowers the
    acceptance. :class:`ReducedModel` gives a good one. If its frequency errors are
    below a tenth of their standard deviations, sample c itself: no correction is
    needed.

    With ``steps``, the first factor is applied that many times, one cheap step after
    another, and only the end point is solved in full. The longer this subchain, the
    less the full solves depend on each other. The guiding walkers do not move until
    that solve has been decided, and the inner move may use no others.

    Attributes:
        proposed: Number of proposals so far.
        full_solves: Number of proposals that the full posterior evaluated.
        accepted: Number of proposals that it accepted.

    Args:
        inner: The move that proposes, one of this package. Put temperatures around it:
            ``TemperedMove(DelayedAcceptanceMove(...), betas)``.
        cheap: Log-probability c, called with ``(n, ndim)``. It returns ``(n,)``, or
            rows that begin with the log-probability, as a :class:`LogPosterior` does.
            It must be finite wherever the posterior is; other regions are never
            sampled.
        steps: Number of cheap steps between full solves of a walker, at least 1; or
            ``(low, high)``, both included, to draw the number for each part of the
            ensemble.

    Raises:
        TypeError: If inner is another kind of move, cheap is not callable, or steps is
            not a whole number.
        ValueError: If steps is below 1 or low > high. When it proposes: if cheap is not
            finite at a walker, is NaN or +inf at a proposal, or has another length.

    Source: Christen and Fox (2005), doi:10.1198/106186005X76983; for steps, Lykkegaard
    et al. (2023), doi:10.1137/22M1476770.

    Examples:
        >>> import emcee
        >>> import numpy as np
        >>> from emcee_femu import DEMCMove
        >>> from emcee_femu.moves import DelayedAcceptanceMove
        >>> full = lambda theta: -0.5 * (theta**2).sum(axis=1)  # the expensive one
        >>> cheap = lambda theta: 0.9 * full(theta)
        >>> move = DelayedAcceptanceMove(DEMCMove(), cheap)
        >>> sampler = emcee.EnsembleSampler(8, 2, full, moves=move, vectorize=True)
        >>> _ = sampler.run_mcmc(np.random.default_rng(1).normal(size=(8, 2)), 50)
        >>> move.proposed, move.accepted <= move.full_solves < move.proposed
        (400, True)
    """

    def __init__(
        self, inner: Move, cheap: Callable[[Floats], ArrayLike], steps: Steps = 1
    ) -> None:
        checks.function("cheap", cheap)
        self.inner, self.cheap = only_propose(inner), cheap
        ends = steps if isinstance(steps, tuple | list | np.ndarray) else (steps, steps)
        lengths = [checks.whole_number("steps", end, 1) for end in ends]
        if len(lengths) != 2 or lengths[0] > lengths[1]:
            raise ValueError(
                "steps: expected a whole number, or an interval (low, high) of them "
                f"with low <= high, got {steps!r}"
            )
        low, high = self._lengths = lengths
        self.steps = low if low == high else (low, high)
        self.proposed = self.full_solves = self.accepted = 0
        self._before: tuple[Floats, Floats] | None = None

    def _parts(self) -> Parts:
        if not self.proposed:
            return ("delayed acceptance: nothing proposed yet",)
        share = 1 - self.full_solves / self.proposed
        second = self.accepted / max(self.full_solves, 1)
        return (
            f"delayed acceptance: {self.full_solves} full solves for {self.proposed} "
            f"proposals ({share:.1%} saved); {second:.1%} of the solved were accepted",
        )

    def __deepcopy__(self, memo: dict[int, object]) -> Self:
        """Copy everything but the cheap posterior, a function that may be large."""
        other = copy(self)
        other.inner = deepcopy(self.inner, memo)
        return other

    def check(self, nwalkers: int, ndim: int) -> None:
        """Refuse an ensemble that the inner move refuses."""
        self.inner.check(nwalkers, ndim)

    def batches(self, coords: Floats, random: RandomState) -> Iterator[Batch]:
        """Yield the end points of subchains, and their log correction factors."""
        cheap = refresh(self._before, coords, self._evaluate)
        if not np.isfinite(cheap).all():
            walker = int(np.argmin(np.isfinite(cheap)))
            raise ValueError(
                f"cheap: {cheap[walker]} at walker {walker}, "
                f"{coords[walker].tolist()}; it must be finite wherever the posterior "
                "is (are its bounds narrower?)"
            )
        for walkers, propose in self.inner.parts(coords, random):
            ends, values = coords.take(walkers, axis=0), cheap[walkers]
            passed = self._walk(propose, ends, values, random)
            walkers, ends, values = walkers[passed], ends[passed], values[passed]
            self.full_solves += len(walkers)
            yield walkers, ends, cheap[walkers] - values
            moved = (coords[walkers] == ends).all(axis=1)
            cheap[walkers[moved]] = values[moved]
            self.accepted += int(moved.sum())
        self._before = coords.copy(), cheap

    def _walk(
        self, propose: Propose, theta: Floats, values: Floats, random: RandomState
    ) -> NDArray[np.bool_]:
        """Walk in place by the values of c ``(k,)`` at theta; return who ever moved.

        The number of steps must not depend on the walkers' positions.
        """
        low, high = self._lengths
        length = random.randint(low, high + 1) if low < high else low
        self.proposed += length * len(theta)
        ever = np.zeros(len(theta), dtype=bool)
        if isinstance(self.inner, IndependenceMove):
            # No step changes the proposals: all of them are evaluated at once.
            n = len(theta)
            proposed = self.inner.mixture.draw(random, length * n)
            new = self._evaluate(proposed)
            weights = (new - self.inner.log_density(proposed)).reshape(length, n)
            thresholds = weights + random.standard_exponential((length, n))
            here, last = values - self.inner.log_density(theta), np.full(n, -1)
            for step in range(length):
                moved = thresholds[step] > here
                here[moved], last[moved] = weights[step, moved], step
            ever = last >= 0
            chosen = (last * n + np.arange(n))[ever]
            theta[ever], values[ever] = proposed[chosen], new[chosen]
            return ever
        for _ in range(length):
            proposed, log_factors = propose(theta)
            new = self._evaluate(proposed)
            threshold = values - random.standard_exponential(len(values))
            if log_factors is not None:
                threshold -= log_factors
            moved = new > threshold
            theta[moved], values[moved] = proposed[moved], new[moved]
            ever |= moved
        return ever

    def _evaluate(self, theta: Floats) -> Floats:
        """Return the values of c ``(n,)``, finite or -inf."""
        rows = checks.numeric_array("cheap", self.cheap(theta))
        whole = rows.ndim == 2 and rows.size > 0  # of a posterior
        log_prob: Floats = rows[:, LOG_POSTERIOR] if whole else rows
        remedy = "return a log-probability for each row"
        checks.shaped("cheap", log_prob.shape, (len(theta),), remedy=remedy)
        if not (log_prob < np.inf).all():
            row = int(np.argmin(log_prob < np.inf))
            raise ValueError(f"cheap: {log_prob[row]} at {theta[row].tolist()}")
        return log_prob
