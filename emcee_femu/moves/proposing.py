"""Moves propose, and one Metropolis step accepts, on arrays of walkers.

emcee's moves do both in one method, with a Python loop over walkers that costs more
than a cheap proposal. Moves that only propose also serve delayed acceptance, and all
temperatures at once.

Where a proposal is built from other walkers, the guides, detailed balance holds for the
joint density of the ensemble only if these stand still meanwhile. Moving all walkers at
once is biased: 4 walkers that start from a Gaussian in 3 dimensions have a variance of
0.87 of the truth after some 30 steps, and settle near 0.79
(``examples/explanation/de_mc.py``).
"""

import re
from collections.abc import Callable, Iterable, Iterator
from inspect import signature
from typing import TypeAlias

import emcee
import numpy as np
from emcee import State
from emcee.model import Model
from emcee.moves import DESnookerMove, GaussianMove, Move
from numpy.random import RandomState
from numpy.typing import ArrayLike, NDArray

from .. import checks
from ..contracts import Floats, read_declared
from ..table import Report

Indices: TypeAlias = NDArray[np.intp]
Proposal: TypeAlias = tuple[Floats, Floats | None]  # (k, ndim), and log-factors (k,)
Propose: TypeAlias = Callable[[Floats], Proposal]
Part: TypeAlias = tuple[Indices, Propose]
Batch: TypeAlias = tuple[Indices, Floats, Floats | None]


class ProposingMove(Move):
    """The base class of moves that only propose: parts of the ensemble move in turn.

    A subclass implements ``get_proposal``, and ``check`` if it cannot move every
    ensemble. Delayed acceptance, tempering and :func:`compare_moves` take such a move
    as they take those of this package.

    Attributes:
        nsplits: Number of parts of the ensemble that move in turn, guided by those at
            rest, 2 in emcee's ``RedBlueMove``; 1 if walkers propose on their own.
        randomize_split: Whether the parts are drawn anew in every step.

    Examples:
        >>> import emcee_femu as ef
        >>> class CentreMove(ef.moves.ProposingMove):
        ...     "Reflect a walker in the mean of those at rest."
        ...     nsplits = 2
        ...     def get_proposal(self, s, c, random):
        ...         return 2 * c[0].mean(axis=0) - s, None
        >>> moves = [(CentreMove(), 0.2), (ef.DEMCMove(), 0.8)]
        >>> posterior = ef.paper.mass_spring().posterior
        >>> (run,) = ef.run(posterior, moves, 20, 50, seed=1, ensembles=1)
        >>> run.get_chain().shape
        (50, 20, 5)
    """

    nsplits: int = 1
    randomize_split: bool = True

    def __repr__(self) -> str:
        """Return the call that makes an equal move."""
        names, values = signature(type(self)).parameters, vars(self)
        shown = (f"{name}={_as_code(values[name])}" for name in names if name in values)
        call = ", ".join(shown)
        return f"{type(self).__name__}({call})"

    def check(self, nwalkers: int, ndim: int) -> None:
        """Refuse an ensemble for which the move is not valid."""

    def get_proposal(self, s: Floats, c: list[Floats], random: RandomState) -> Proposal:
        """Propose for walkers that move at once (the interface of emcee's moves).

        Args:
            s: The walkers, ``(k, ndim)``.
            c: One array of the walkers at rest, ``(n, ndim)``; empty if all move.
            random: The random stream.

        Returns:
            Proposals ``(k, ndim)``, and the log Hastings factor of each, ``(k,)``; None
            if the proposal is symmetric.
        """
        raise NotImplementedError

    def parts(self, coords: Floats, random: RandomState) -> Iterator[Part]:
        """Yield walkers that move at once, and the function that proposes for them.

        It takes their positions ``(k, ndim)`` and may be called any number of times:
        all other walkers, its guides, stand still.
        """
        nwalkers = len(coords)
        if self.nsplits == 1:
            yield np.arange(nwalkers), self._guided([], random)
            return
        if self.randomize_split:
            order = random.random_sample(nwalkers).argsort()
        else:
            order = np.argsort(np.arange(nwalkers) % self.nsplits, kind="stable")
        ring = np.concatenate((order, order))
        size, larger = divmod(nwalkers, self.nsplits)
        end = 0
        for split in range(self.nsplits):
            start, end = end, end + size + (split < larger)
            guides = [coords.take(ring[end : start + nwalkers], axis=0)]
            yield order[start:end], self._guided(guides, random)

    def _guided(self, guides: list[Floats], random: RandomState) -> Propose:
        """Return the proposal with these guides; emcee's contract is positional."""
        return lambda walkers: self.get_proposal(walkers, guides, random)

    def batches(self, coords: Floats, random: RandomState) -> Iterator[Batch]:
        """Yield walkers, proposals and log-factors, a batch of accept_or_reject.

        Each batch is accepted or rejected, and ``coords (nwalkers, ndim)`` changed in
        place, before the next one is asked for.
        """
        for walkers, propose in self.parts(coords, random):
            yield walkers, *propose(coords.take(walkers, axis=0))

    def propose(self, model: Model, state: State) -> tuple[State, NDArray[np.bool_]]:
        """Move every walker once; return the state and who was accepted."""
        self.check(*state.coords.shape)
        check_state(state)
        accepted = np.zeros(len(state.coords), dtype=bool)
        for batch in self.batches(state.coords, model.random):
            accepted[accept_or_reject(model, state, batch)] = True
        return state, accepted


def only_propose(inner: Move) -> ProposingMove:
    """Return a move that leaves the acceptance to others.

    Raises:
        TypeError: If inner is not one of this package, or accepts in its own way.
    """
    propose = ProposingMove.propose
    if isinstance(inner, ProposingMove) and type(inner).propose is propose:
        return inner
    raise TypeError(
        "inner: expected an untempered move of this package that needs no gradient, "
        f"got {inner!r}"
    )


def read_betas(betas: ArrayLike) -> Floats:
    """Return powers of the likelihood, checked."""
    powers = checks.real_array("betas", betas, 1)
    falling = len(powers) > 1 and (np.diff(powers) < 0).all()
    if not falling or powers[0] != 1 or powers[-1] < 0:
        raise ValueError(
            "betas: expected at least two powers that descend from 1 to no less than "
            f"0, such as [1.0, 0.3, 0.0], got {powers.tolist()}"
        )
    return powers


def ladder_of(moves: Iterable[Move]) -> Floats:
    """Return the powers of the likelihood that walkers have under all ``moves``.

    ``betas`` of moves that temper, whose walkers are blocks in this order; else one.

    Raises:
        ValueError: If such moves are mixed with others, or their betas differ.
    """
    listed = list(moves)
    given = [read_declared(move, "betas") for move in listed]
    ladders = [np.ones(1) if betas is None else read_betas(betas) for betas in given]
    first = ladders[0] if ladders else np.ones(1)
    if not all(np.array_equal(betas, first) for betas in ladders):
        raise ValueError(
            "moves: expected every move to be a TemperedMove with the same betas, as a "
            f"walker has one temperature, got {listed}; write "
            "[(TemperedMove(a, betas), 0.9), (TemperedMove(b, betas), 0.1)]"
        )
    return first


def find_stock_fault(move: Move) -> str:
    """Return what is wrong with a move of emcee 3.1.6 itself, or an empty string.

    Source: emcee's pull requests 571 (GaussianMove) and 531 (DESnookerMove).
    """
    if [int(n) for n in re.findall(r"\d+", emcee.__version__)[:3]] > [3, 1, 6]:
        return ""
    if type(move) is GaussianMove and np.ndim(move.get_proposal.scale) == 2:
        return (
            "GaussianMove with a full covariance adds the same step to all walkers, "
            "which overstates their ESS; use emcee_femu.MetropolisMove(cov=...)"
        )
    if type(move) is DESnookerMove:
        return (
            "DESnookerMove has a wrong Hastings factor in this release of emcee, so "
            "that it samples another distribution; leave it out, or use DEMCMove()"
        )
    return ""


def accept_or_reject(
    model: Model, state: State, batch: Batch, betas: Floats | None = None
) -> Indices:
    r"""Evaluate proposals for ``walkers``, accept or reject each, update the state.

    .. math:: r = \min\left\{1, \frac{p(\theta^*)}{p(\theta_i)} e^{F}\right\}

    Args:
        model: emcee's ``Model``: log-probability function and random stream.
        state: emcee's ``State``; the accepted walkers are overwritten in place.
        batch: Indices ``(k,)`` of the walkers that may move; proposals ``(k, ndim)``;
            F of an asymmetric proposal, ``(k,)``, or None.
        betas: Powers of the likelihood other than 1, ``(k,)``.

    Returns:
        The indices of the walkers that moved.

    Source: Eqs. 3.1 and 3.3 of Sherri, Boulkaibet, Marwala and Friswell.
    """
    walkers, proposed, log_factors = batch
    if not len(walkers):
        return walkers
    log_prob, blobs = model.compute_log_prob_fn(proposed)
    target, threshold = log_prob, state.log_prob.take(walkers)
    if betas is not None:
        target = temper(log_prob, blobs[:, 0], betas)
        threshold = temper(threshold, state.blobs[walkers, 0], betas)
    # log U = -Exp(1). Written without a difference, so that -inf against -inf is a
    # rejection and not a NaN.
    threshold -= model.random.standard_exponential(len(walkers))
    if log_factors is not None:
        threshold -= log_factors
    better = (target > threshold).nonzero()[0]
    moved: Indices = walkers.take(better)
    state.coords[moved] = proposed.take(better, axis=0)
    state.log_prob[moved] = log_prob.take(better)
    if blobs is not None:
        state.blobs[moved] = blobs[better]
    return moved


def refresh(
    before: tuple[Floats, Floats] | None,
    coords: Floats,
    evaluate: Callable[[Floats], Floats],
) -> Floats:
    """Return ``evaluate`` at all walkers, calling it only for those that moved.

    Args:
        before: Where the walkers were, ``(n, ndim)``, and what was found there; None at
            first. It saves evaluations and nothing else.
        coords: Where they are.
        evaluate: Called with ``(k, ndim)``, returns ``(k, ...)``.
    """
    if before is None or before[0].shape != coords.shape:
        return evaluate(coords).copy()
    changed = (before[0] != coords).any(axis=1)
    values = before[1].copy()  # as it was, should a model raise
    if changed.any():
        values[changed] = evaluate(coords[changed])
    return values


def temper(log_prob: Floats, log_prior: Floats, beta: float | Floats) -> Floats:
    """Return log densities with powers of the likelihood.

    -inf stays -inf for every beta; beta = 1 changes no bit.
    """
    return np.asarray(log_prob - (1 - beta) * subtract_log_prior(log_prob, log_prior))


def subtract_log_prior(log_prob: Floats, log_prior: Floats) -> Floats:
    """Return the log-likelihoods of walkers, and 0 where the posterior is zero."""
    result = np.zeros_like(log_prob)
    return np.subtract(log_prob, log_prior, out=result, where=log_prob > -np.inf)


def check_state(state: State) -> None:
    """Refuse walkers of integers, and ensembles that are outside the support."""
    coords, log_prob = state.coords, state.log_prob
    if log_prob[0] == -np.inf and (log_prob == -np.inf).all():
        raise ValueError(
            "initial_state: all walkers have a log-probability of -inf, as outside of "
            "bounds; start where it is finite, such as at posterior.start(nwalkers, "
            "seed=1)"
        )
    # In an array of whole numbers emcee would truncate what is accepted.
    if coords.dtype.kind != "f":
        raise TypeError(
            f"initial_state: expected floating-point coordinates, got {coords.dtype}, "
            "which would truncate accepted proposals; pass numpy.asarray(p0, float)"
        )


def _as_code(value: object) -> str:
    """Return an argument as code; an object that prints tables, by its class."""
    if isinstance(value, np.ndarray):
        return repr(value.tolist())
    return type(value).__name__ if isinstance(value, Report) else repr(value)
