"""What a search for maxima found, as tables and sentences."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import special, stats

from .. import checks
from ..interfaces import Floats
from ..posterior.climbing import Maximum
from ..posterior.laplace import moments_inside
from ..posterior.log_posterior import LogPosterior
from ..posterior.priors import inside, summarize_prior
from ..table import Parts, Report, Table
from .importance import GOOD_K

SHOWN = 4  # maxima in the tables
TRIALS = 100  # draws for each that is to lie inside the bounds
EFFECTIVE = 0.5  # share of draws of a Gaussian that is close


@dataclass(frozen=True, eq=False)
class FoundMap(Report):
    """What :func:`.find_map` found; ``print`` it for tables and what to think of them.

    Attributes:
        posterior: The posterior.
        maxima: Its distinct maxima, that of the largest weight first
            (:class:`.Maximum`): ``theta``, ``covariance``,
            ``log_evidence``, ``at_bound``, ...
        weights: Their shares of the posterior by Laplace's evidence, ``(k,)``.
        climbs: How many climbs ended in each, ``(k,)``.
        lost: Why other starts led nowhere, one sentence each.
        solves: Model solves spent, those of the check included.
        draws: Draws of the check, 0 without one.
        pareto_k: Of their importance weights; NaN without a check.
        efficiency: Their effective share (Kish); NaN without a check.
    """

    posterior: LogPosterior
    maxima: tuple[Maximum, ...]
    weights: Floats
    climbs: NDArray[np.int_]
    lost: tuple[str, ...]
    solves: int
    draws: int = 0
    pareto_k: float = np.nan
    efficiency: float = np.nan

    def draw(self, n: int, seed: int) -> Floats:
        """Return draws ``(n, d)`` of the Gaussians, by weight, inside the bounds.

        As starts of a chain: ``run(..., initial=found.draw(nwalkers, seed))``. They
        are no draws of the posterior; where it is wider, give them more time.

        Args:
            n: How many.
            seed: A whole number.

        Returns:
            The draws, ``(n, d)``.

        Raises:
            TypeError: If an argument is not a whole number.
            ValueError: If n is below 1, or hardly any draw is inside the bounds.

        Examples:
            >>> import emcee_femu as ef
            >>> posterior = ef.paper.mass_spring().posterior
            >>> found = ef.find_map(posterior, 4, seed=1, check=0)
            >>> starts = found.draw(20, seed=1)
            >>> (sampler,) = ef.run(posterior, nsteps=20, seed=1, initial=starts)
            >>> starts.shape
            (20, 5)
        """
        n = checks.whole_number("n", n, 1)
        rng = np.random.default_rng(checks.whole_number("seed", seed))
        bounds = self.posterior.prior.bounds
        draws, _ = draw_inside(self.maxima, self.weights, bounds, n, rng)
        if len(draws) < n:
            raise ValueError(
                f"n: of {TRIALS * n} draws of the Gaussians only {len(draws)} are "
                f"inside the bounds, fewer than {n}; start from the prior"
            )
        return draws

    @property
    def table(self) -> Table:
        """The prior, then maxima and sds inside the bounds, one row per parameter."""
        mean, sd = summarize_prior(self.posterior.prior)
        bounds = self.posterior.prior.bounds.T
        columns: list[tuple[str, str, Any]] = [
            ("parameter", "", list(self.posterior.names)),
            ("prior mean", ".5g", getattr(self.posterior.prior, "mean", mean)),
            ("prior sd", ".3g", sd),
        ]
        for number, own in enumerate(self.maxima[:SHOWN], 1):
            columns.append((f"maximum {number}", ".5g", own.theta))
            inside = moments_inside(own.theta, own.covariance, *bounds)[1]
            columns.append((f"sd {number}", ".3g", np.sqrt(np.diag(inside))))
        return Table.from_columns("Maxima of the posterior", columns)

    @property
    def maxima_table(self) -> Table:
        """Weight, height, evidence and climbs that ended there, one row per maximum."""
        shown = self.maxima[:SHOWN]
        names = np.array(self.posterior.names)
        columns: list[tuple[str, str, Any]] = [
            ("maximum", "d", [*range(1, len(shown) + 1)]),
            ("weight", ".3f", self.weights[:SHOWN]),
            ("log-posterior", ".2f", [own.log_posterior for own in shown]),
            ("log evidence", ".2f", [own.log_evidence for own in shown]),
            ("climbs", "d", self.climbs[:SHOWN]),
            ("at a bound", "", [" ".join(names[own.at_bound]) for own in shown]),
            ("converged", "", ["yes" if own.converged else "no" for own in shown]),
        ]
        return Table.from_columns("Gaussians about them (Laplace)", columns)

    @property
    def findings(self) -> tuple[str, ...]:
        """What to think of it, in sentences."""
        k, n = len(self.maxima), int(self.climbs.sum()) + len(self.lost)
        sentences = [
            f"A start and a quick look: {k} maxim{'a' if k > 1 else 'um'} from {n} "
            f"climb{'s' if n > 1 else ''} and {self.solves} solves."
        ]
        if k > SHOWN:
            sentences.append(f"{k - SHOWN} of smaller weight are not shown.")
        for reason, count in Counter(self.lost).items():
            sentences.append(f"{count} of {n} starts led nowhere: {reason}.")
        stopped = [own.message for own in self.maxima if not own.converged]
        for reason, count in Counter(stopped).items():
            sentences.append(f"{count} of {k} are perhaps no maxima: {reason}.")
        return (*sentences, self._judge())

    def _judge(self) -> str:
        if not self.draws:
            return (
                "Whether the posterior is Gaussian about them was not checked: "
                "check=100 does, by as many solves. Standard deviations and weights "
                "are those of Gaussians; sample the posterior before you report any."
            )
        found = (
            f"Pareto k {self.pareto_k:.2f}, {100 * self.efficiency:.0f} % effective, "
            f"of {self.draws} draws"
        )
        if not (self.pareto_k < GOOD_K and self.efficiency > EFFECTIVE):
            return (
                f"The posterior is not Gaussian about them ({found}): take neither "
                "standard deviations nor weights from here; sample it."
            )
        return f"The posterior is nearly Gaussian about them ({found})."

    def _parts(self) -> Parts:
        return self.table, self.maxima_table, *self.findings


def draw_inside(
    maxima: Sequence[Maximum],
    weights: Floats,
    bounds: Floats,
    n: int,
    rng: np.random.Generator,
) -> tuple[Floats, Floats]:
    """Draw from the Gaussians about maxima, inside the bounds.

    Returns:
        Draws, fewer than n where most of a Gaussian is out of bounds, and the log of
        their density but for a constant: cut at the bounds the law is the same.
    """
    laws = [_Gaussian(own) for own in maxima]
    chosen = rng.choice(len(laws), size=TRIALS * n, p=weights)
    draws = np.stack([law.mean for law in laws])[chosen]
    for number, law in enumerate(laws):
        own = chosen == number
        draws[own] += law.scatter(rng, int(own.sum()))
    draws = draws[inside(draws, bounds)][:n]
    densities = np.stack([law.log_density(draws) for law in laws])
    log_density: Floats = special.logsumexp(densities, axis=0, b=weights[:, None])
    return draws, log_density


class _Gaussian:
    """The Gaussian about a maximum."""

    def __init__(self, maximum: Maximum) -> None:
        self.mean = maximum.theta
        self.root = np.linalg.cholesky(maximum.covariance)

    def scatter(self, rng: np.random.Generator, n: int) -> Floats:
        about: Floats = rng.standard_normal((n, len(self.mean))) @ self.root.T
        return about

    def log_density(self, theta: Floats) -> Floats:
        white = np.linalg.solve(self.root, (theta - self.mean).T)
        log_scale = np.log(np.diag(self.root)).sum()
        density: Floats = stats.norm.logpdf(white).sum(axis=0) - log_scale
        return density
