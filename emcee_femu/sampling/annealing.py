"""Carry a population from the prior to the posterior through powers of the likelihood.

The population is two halves. Each is resampled within itself, and moved by proposals
that were fitted to the other: a fit to the members that it then moves follows their
accidents, which made the evidence 1.3 too large in ten dimensions.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.random import RandomState
from numpy.typing import NDArray

from ..interfaces import Floats, Prior
from ..moves import IndependenceMove
from ..table import Parts, Report, Table
from .bridging import bridge
from .importance import FAIR_SHARE, GOOD_K, kish_share, pareto_k
from .log_scale import LogScale
from .renewing import fewest_members as fewest_members
from .renewing import renew

MOST_DRAWS = 20  # times the size, for a population of finite likelihood
LAST = 2  # powers whose proposals tell of what is missing; early ones may fit badly


@dataclass(frozen=True, eq=False)
class Annealed(Report):
    """A population of the posterior, and how it got there; ``print`` it.

    Attributes:
        names: Parameter names.
        theta: The members, ``(size, d)``, of equal weight.
        rows: Their rows as a LogPosterior returns them, ``(size, columns)``.
        powers: Powers of the likelihood from 0 to 1, ``(stages + 1,)``.
        acceptance: Share of the proposals that were accepted after each, ``(stages,)``.
        sweeps: How often all members were moved, ``(stages,)``.
        log_evidence: Natural logarithm of the evidence.
        log_evidence_error: Its Monte Carlo standard error; infinite where none can be
            claimed.
        effective_size: As many independent draws would know the mean as well, ``(d,)``.
        solves: Model solves spent.
        failed_solves: Of these, how many failed and were taken for impossible.
        problems: Why no standard error can be claimed; usually none.
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
    problems: tuple[str, ...] = ()

    @property
    def table(self) -> Table:
        """Mean, standard deviation and effective size, one row per parameter."""
        columns: list[tuple[str, str, Any]] = [
            ("parameter", "", list(self.names)),
            ("mean", ".5g", self.theta.mean(axis=0)),
            ("sd", ".4g", self.theta.std(axis=0, ddof=1)),
            ("effective size", ".0f", self.effective_size),
        ]
        return Table.from_columns(f"Population of {len(self.theta)}", columns)

    def _parts(self) -> Parts:
        error = f"+- {self.log_evidence_error:.3f}"
        if self.problems:
            error = "(no standard error can be claimed)"
        yield self.table
        yield f"log evidence (natural) {self.log_evidence:.3f} {error}"
        yield from (f"{text[:1].upper()}{text[1:]}." for text in self.problems)
        yield (
            f"{len(self.sweeps)} powers of the likelihood, {self.solves} solves, "
            f"{100 * self.acceptance.min():.0f} to {100 * self.acceptance.max():.0f} % "
            "of the proposals accepted"
        )
        if self.failed_solves:
            yield (
                f"{self.failed_solves} solves failed: the evidence takes the "
                "likelihood for zero there"
            )


def anneal_population(
    evaluation: Any, prior: Prior | LogScale, rng: np.random.Generator, size: int
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
    halves = [np.arange(size // 2), np.arange(size // 2, size)]
    fits = [IndependenceMove.fit(theta[half]) for half in halves[::-1]]
    ancestors, influence = np.arange(size), np.zeros(size)
    log_evidence, powers = float(np.log(share)), [0.0]
    moved, tried = [], []
    while powers[-1] < 1:
        low = rows[:, 0] - rows[:, 1]
        step = _next_step(low, 1 - powers[-1])
        if powers[-1] + step == powers[-1]:
            raise RuntimeError(
                f"posterior: the likelihood still varies by {np.ptp(low):g} at its "
                f"power {powers[-1]:g}, and no larger one can be reached; is it a "
                "function of the parameters alone?"
            )
        powers.append(1.0 if step == 1 - powers[-1] else powers[-1] + step)
        weights = np.exp(step * (low - low.max()))
        kept = np.concatenate([half[_resample(weights[half], rng)] for half in halves])
        parents, ancestors = ancestors, ancestors[kept]
        theta, rows = theta[kept], rows[kept]
        *how, log_weights = renew(
            evaluation, theta, rows, halves, powers[-1], random, fits
        )
        moved.append(how)
        tried.append(log_weights)
        high = rows[:, 0] - rows[:, 1]
        found = bridge(step * high, step * low)
        log_evidence += found.log_ratio
        np.add.at(influence, parents, found.from_g / len(low))
        np.add.at(influence, ancestors, found.from_f / len(high))
    acceptance, sweeps = zip(*moved, strict=True)
    variance = (influence**2).sum() + (1 - share) / (share * draws)
    problems = _find_problems(tried[-LAST:])
    return Annealed(
        names=tuple(prior.names),
        theta=theta,
        rows=rows,
        powers=np.array(powers),
        acceptance=np.array(acceptance),
        sweeps=np.array(sweeps),
        log_evidence=log_evidence,
        log_evidence_error=np.inf if problems else float(np.sqrt(variance)),
        effective_size=_effective_size(theta, ancestors),
        solves=evaluation.solves - before,
        problems=problems,
    )


def _find_problems(tried: list[Floats]) -> tuple[str, ...]:
    """Return what the weights of independence proposals at some powers forbid.

    A region that the population missed is in none of the fits to it, and the few
    proposals that come upon it have weights far above all others.
    """
    k = max((pareto_k(w) for w in tried if kish_share(w) < FAIR_SHARE), default=0.0)
    if k <= GOOD_K:
        return ()
    return (
        "a region of the posterior may be missing, for the weights of proposals fitted "
        f"to the population have a heavy tail (Pareto k {k:.2f}, {GOOD_K} is the "
        'limit); a larger size may find it, and "auto" does in some cases',
    )


def _draw(
    evaluation: Any, prior: Prior | LogScale, rng: np.random.Generator, size: int
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


def _resample(weights: Floats, rng: np.random.Generator) -> NDArray[np.intp]:
    """Return members as often as their weights say, to one (systematic)."""
    n = len(weights)
    edges = np.cumsum(weights)
    places = (np.arange(n) + rng.random()) / n * edges[-1]
    kept: NDArray[np.intp] = np.searchsorted(edges, places, side="right")
    return np.minimum(kept, n - 1)


def _effective_size(theta: Floats, ancestors: NDArray[np.intp]) -> Floats:
    """Return the variance of each parameter by that of its mean, by lineages."""
    n = len(theta)
    centred = theta - theta.mean(axis=0)
    sums = np.zeros((n, theta.shape[1]))
    np.add.at(sums, ancestors, centred)
    size: Floats = n * (centred**2).sum(axis=0) / (sums**2).sum(axis=0)
    return np.minimum(size, n)
