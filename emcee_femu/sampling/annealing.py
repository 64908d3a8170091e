"""Carry a population from the prior to the posterior through powers of the likelihood.

The population is two halves. Each is resampled within itself, and moved by proposals
that were fitted to the other: a fit to the members that it then moves follows their
accidents, which made the evidence 1.3 too large in ten dimensions.
"""

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.random import RandomState
from numpy.typing import NDArray
from scipy.special import logsumexp

from ..interfaces import Floats, Prior
from ..moves import IndependenceMove
from ..moves.acceptance import accept_or_reject
from ..moves.component_walk import ComponentWalk
from ..table import Table

MOST_DRAWS = 20  # times the size, for a population of finite likelihood
RENEWED = 0.8  # of the members are to be independent of their ancestors
MOST_SWEEPS = 20  # at one power
MOST_COMPONENTS = 6
PER_COMPONENT = 10  # members of a half for each parameter and component


@dataclass(frozen=True, eq=False)
class Annealed:
    """A population of the posterior, and how it got there; ``print`` it.

    Attributes:
        names: Parameter names.
        theta: The members, ``(size, d)``, of equal weight.
        rows: Their rows as a LogPosterior returns them, ``(size, columns)``.
        powers: Powers of the likelihood from 0 to 1, ``(stages + 1,)``.
        acceptance: Share of the proposals that were accepted after each, ``(stages,)``.
        sweeps: How often all members were moved, ``(stages,)``.
        log_evidence: Natural logarithm of the evidence.
        log_evidence_error: Its Monte Carlo standard error.
        effective_size: As many independent draws would know the mean as well, ``(d,)``.
        solves: Model solves spent.
        failed_solves: Of these, how many failed and were taken for impossible.
    """

    names: tuple[str, ...]
    theta: Floats
    rows: Floats
    powers: Floats
    acceptance: Floats
    sweeps: NDArray[np.intp]
    log_evidence: float
    log_evidence_error: float
    effective_size: Floats
    solves: int
    failed_solves: int = 0

    def table(self) -> Table:
        """Return mean, standard deviation and effective size of each parameter."""
        columns: list[tuple[str, str, Any]] = [
            ("parameter", "", list(self.names)),
            ("mean", ".5g", self.theta.mean(axis=0)),
            ("sd", ".4g", self.theta.std(axis=0, ddof=1)),
            ("effective size", ".0f", self.effective_size),
        ]
        return Table.from_columns(f"Population of {len(self.theta)}", columns)

    def __str__(self) -> str:
        """Return the table, and a sentence on the evidence and what it cost."""
        failed = ""
        if self.failed_solves:
            failed = (
                f"\n{self.failed_solves} solves failed: the evidence takes the "
                "likelihood for zero there"
            )
        return (
            f"{self.table()}\n"
            f"log evidence (natural) {self.log_evidence:.3f} +- "
            f"{self.log_evidence_error:.3f}\n"
            f"{len(self.sweeps)} powers of the likelihood, {self.solves} solves, "
            f"{100 * self.acceptance.min():.0f} to {100 * self.acceptance.max():.0f} % "
            f"of the proposals accepted{failed}"
        )


def anneal_population(
    evaluation: Any, prior: Prior, rng: np.random.Generator, size: int
) -> Annealed:
    """Return the population at the power 1; see :func:`anneal`.

    Args:
        evaluation: Has ``rows(theta)`` and counts ``solves``.
        prior: Where the population starts.
        rng: The same stream gives the same population.
        size: Members, at least ``fewest_members(d)``.

    Raises:
        ValueError: If too few draws of the prior have a finite likelihood.
        RuntimeError: If no power above the last one can be told from it.
    """
    before = evaluation.solves
    random = RandomState(rng.bit_generator)
    theta, rows, share, draws = _draw(evaluation, prior, rng, size)
    ends = (0, size // 2, size)
    halves = [np.arange(*pair) for pair in zip(ends[:-1], ends[1:], strict=True)]
    log_z = np.full(2, np.log(share))
    ancestors, variation = np.arange(size), (1 - share) / (share * draws)
    powers, moved = [0.0], []
    while powers[-1] < 1:
        log_likelihood = rows[:, 0] - rows[:, 1]
        step = _next_step(log_likelihood, 1 - powers[-1])
        if powers[-1] + step == powers[-1]:
            raise RuntimeError(
                f"posterior: the likelihood still varies by {np.ptp(log_likelihood):g} "
                f"at its power {powers[-1]:g}, and no larger one can be reached; is it "
                "a function of the parameters alone?"
            )
        last = step == 1 - powers[-1]
        powers.append(1.0 if last else powers[-1] + step)
        log_weights = step * log_likelihood
        log_all = log_weights + np.repeat(log_z, [len(half) for half in halves])
        log_z = np.array([_log_mean(log_all[half]) for half in halves])
        weights = np.exp(log_weights - log_weights.max())
        variation += weights.var() / weights.mean() ** 2 / size
        if last:  # the halves meet: the evidence knows no later bias
            weights = np.exp(log_all - log_all.max())
            lineage = _lineage_error(weights, ancestors)
            kept = _resample(weights, rng)
        else:
            kept = np.concatenate([h[_resample(weights[h], rng)] for h in halves])
        theta, rows, ancestors = theta[kept], rows[kept], ancestors[kept]
        moved.append(_move(evaluation, theta, rows, halves, powers[-1], random))
    acceptance, sweeps = zip(*moved, strict=True)
    return Annealed(
        names=tuple(prior.names),
        theta=theta,
        rows=rows,
        powers=np.array(powers),
        acceptance=np.array(acceptance),
        sweeps=np.array(sweeps),
        log_evidence=_log_mean(log_z),
        # Lineages see what moves leave correlated, and scatter: never below the sum of
        # the stages, which is the error of a perfect mixture.
        log_evidence_error=float(np.sqrt(max(lineage, variation))),
        effective_size=_effective_size(theta, ancestors),
        solves=evaluation.solves - before,
    )


def _draw(
    evaluation: Any, prior: Prior, rng: np.random.Generator, size: int
) -> tuple[Floats, Floats, float, int]:
    """Return members of finite likelihood, their rows, their share of the prior."""
    theta = prior.sample(rng, size)
    rows = evaluation.rows(theta)
    for draws in range(size, (MOST_DRAWS + 1) * size, size):
        finite = rows[:, 0] > -np.inf
        if (found := int(finite.sum())) >= size:
            keep = np.flatnonzero(finite)[:size]
            return theta[keep], rows[keep], found / draws, draws
        more = prior.sample(rng, size)
        theta = np.concatenate([theta[finite], more])
        rows = np.concatenate([rows[finite], evaluation.rows(more)])
    raise ValueError(
        f"posterior: only {found} of {draws} draws of the prior have a finite "
        "likelihood; narrow the prior to where the model can be solved"
    )


def _next_step(log_likelihood: Floats, most: float) -> float:
    """Return the increment whose weights have a coefficient of variation of 1."""
    centred = log_likelihood - log_likelihood.max()

    def variation(step: float) -> float:
        weights = np.exp(step * centred)
        return float(weights.std() / weights.mean())

    if variation(most) <= 1:
        return most
    low, high = 0.0, most
    for _ in range(200):
        middle = 0.5 * (low + high)
        if middle in (low, high):
            break
        low, high = (middle, high) if variation(middle) < 1 else (low, middle)
    return low


def _log_mean(logs: Floats) -> float:
    return float(logsumexp(logs) - np.log(len(logs)))


def _resample(weights: Floats, rng: np.random.Generator) -> NDArray[np.intp]:
    """Return members as often as their weights say, to one (systematic)."""
    n = len(weights)
    edges = np.cumsum(weights)
    places = (np.arange(n) + rng.random()) / n * edges[-1]
    kept: NDArray[np.intp] = np.searchsorted(edges, places, side="right")
    return np.minimum(kept, n - 1)


def _lineage_error(weights: Floats, ancestors: NDArray[np.intp]) -> float:
    """Return the squared relative error of the evidence.

    Descendants of one draw of the prior are one draw as long as they have not moved
    far: what counts is how unequal the shares of the lineages are.

    Source: Lee and Whiteley (2018), doi:10.1093/biomet/asy028.
    """
    shares = np.bincount(ancestors, weights / weights.sum())
    return float((shares**2).sum() - 1 / len(weights))


def _effective_size(theta: Floats, ancestors: NDArray[np.intp]) -> Floats:
    """Return the variance of each parameter by that of its mean, by lineages."""
    n = len(theta)
    centred = theta - theta.mean(axis=0)
    sums = np.zeros((n, theta.shape[1]))
    np.add.at(sums, ancestors, centred)
    size: Floats = n * (centred**2).sum(axis=0) / (sums**2).sum(axis=0)
    return np.minimum(size, n)


def fewest_members(ndim: int) -> int:
    """Return the smallest population that a mixture can be fitted to, in halves."""
    return 2 * PER_COMPONENT * ndim


def _fit(draws: Floats, others: Floats) -> IndependenceMove:
    """Return a mixture with as many components as make the others more likely."""
    most = min(MOST_COMPONENTS, len(draws) // (PER_COMPONENT * draws.shape[1]))
    best = IndependenceMove.fit(draws)
    score = best.log_density(others).mean()
    for components in range(2, most + 1):
        try:
            fitted = IndependenceMove.fit(draws, components)
        except ValueError:  # a component died
            break
        if (new := fitted.log_density(others).mean()) <= score:
            break
        best, score = fitted, new
    return best


def _move(
    evaluation: Any,
    theta: Floats,
    rows: Floats,
    halves: list[NDArray[np.intp]],
    power: float,
    random: RandomState,
) -> tuple[float, int]:
    """Move all members, in place, until they are far from where they were.

    Sweeps of independence proposals alternate with a random walk, whichever renews
    more members having three quarters of them.

    Returns:
        The share of accepted proposals, and the number of sweeps.
    """
    n, ndim = theta.shape
    one, other = (theta[half] for half in halves)
    fits = [_fit(other, one), _fit(one, other)]
    walks = [ComponentWalk(fit) for fit in fits]

    def compute(proposed: Floats) -> tuple[Floats, Floats]:
        new = evaluation.rows(proposed)
        return new[:, 0], new[:, 1:]

    model = SimpleNamespace(compute_log_prob_fn=compute, random=random)
    state = SimpleNamespace(coords=theta, log_prob=rows[:, 0], blobs=rows[:, 1:])
    renewed, betas, accepted = np.zeros(n), np.full(n, power), []
    # An accepted step of the walk is worth 2.38**2 / (2 ndim) independent draws.
    worth = min(1.0, 2.8 / ndim)
    rates = [1.0, 0.25 * worth]
    for sweep in range(MOST_SWEEPS):
        better = rates[1] > rates[0]
        walking = better if sweep % 4 < 3 and sweep else not better and sweep > 0
        moves: Any = walks if walking else fits
        batches = [
            next(move.batches(theta[half], random))
            for move, half in zip(moves, halves, strict=True)
        ]
        proposed, factors = (
            np.concatenate(parts) for parts in list(zip(*batches, strict=True))[1:]
        )
        moved = accept_or_reject(model, state, np.arange(n), proposed, factors, betas)
        accepted.append(len(moved) / n)
        rates[walking] = accepted[-1] * (worth if walking else 1.0)
        renewed[moved] += worth if walking else 1.0
        if walking:
            for walk in walks:
                walk.scale *= np.exp(accepted[-1] - 0.25)
        if np.minimum(renewed, 1).mean() > RENEWED:
            break
    return float(np.mean(accepted)), len(accepted)
