"""Draws of an emulated posterior, and of what it may yet turn out to be."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..interfaces import Floats, Parameters
from ..moves.mixture_em import Mixture, draw
from ..moves.mixture_fit import fit_mixture
from .annealing import anneal_population
from .emulate_problem import EmulationProblem
from .log_scale import LogScale
from .refine import Draws, refine, uncover
from .renewing import fewest_members

MEMBERS = 500  # draws that stand for a posterior
FROM_PRIOR = 400  # draws
ROUND, ROUNDS = 300, 6  # draws of a round of a refinement at least, and rounds at most
ANNEALED, DF = 200, 5.0  # members at least, and the tails that are fitted to them
GROWN = 1.5  # times as many points for another look at the whole prior
WIDER = 2.0  # standard deviations of the emulator that may be one in truth


@dataclass(frozen=True)
class Doubtful:
    """A model that trusts itself less: its spread is so many times as large."""

    model: Any
    factor: float

    @property
    def bounds(self) -> Any:
        """Where the model holds."""
        return self.model.bounds

    @property
    def variables(self) -> Any:
        """What it returns."""
        return self.model.variables

    def __call__(self, parameters: Parameters) -> Any:
        """Return the response."""
        return self.model(parameters)

    def spread(self, parameters: Parameters) -> Any:
        """Return the response, and its wider spread."""
        response, directions = self.model.spread(parameters)
        wider = {
            name: {label: self.factor * move for label, move in moves.items()}
            for name, moves in directions.items()
        }
        return response, wider


@dataclass(frozen=True, eq=False)
class EmulatedDraws:
    """Draws of the emulated posterior, and of a wider one around it.

    The wider one, whose emulator has twice the error that it claims, lies also where
    the full model may turn out to be better than the emulator says.

    Attributes:
        theta: Draws of the emulated posterior, ``(n, d)``, of equal weight.
        errors: Mean square errors predicted there, ``(n,)``, as those of ``deviate``.
        wide: Draws of the wider one, ``(n, d)``.
        wide_errors: Mean square errors predicted there.
        mean, covariance: Of the emulated posterior's coordinates on its scale.
    """

    theta: Floats
    errors: Floats
    wide: Floats
    wide_errors: Floats
    mean: Floats
    covariance: Floats

    @property
    def predicted(self) -> float:
        """The root mean square of the predicted errors."""
        return float(np.sqrt(self.errors.mean()))


class Explorer:
    """Draws from one emulated posterior after another.

    A proposal is refined from round to round by importance weights. Among its draws
    there are always some of the prior; and whenever the solves have grown by half, a
    population annealed from the prior joins it, which knows nothing of what was seen
    before, so that a mode that one emulator excluded comes back with a later one.

    Args:
        problem: What is emulated.
        scale: On which the posterior is explored.
    """

    def __init__(self, problem: EmulationProblem, scale: LogScale) -> None:
        self.problem, self.scale = problem, scale
        self.solves = 0  # of the emulated posterior, which cost nothing
        self._posterior: Any = None
        self._law: Mixture | None = None
        self._looked = 0

    def rows(self, x: Floats) -> Floats:
        """Return rows of the wider posterior at coordinates, as their densities."""
        self.solves += len(x)
        rows: Floats = self._posterior(self.scale.parameters(x))
        rows[:, :2] += self.scale.log_volume(x)[:, None]
        return rows

    def draw(self, emulator: Any, size: int, rng: np.random.Generator) -> EmulatedDraws:
        """Return draws of the posterior of an emulator made from ``size`` points."""
        problem, scale = self.problem, self.scale
        self._posterior = problem.replace_model(Doubtful(emulator, WIDER))
        ndim = len(scale.names)

        def propose(law: Mixture, number: int) -> tuple[Floats, Floats]:
            x = draw(rng, law, number)
            return x, self.rows(x)

        first = scale.sample(rng, FROM_PRIOR)
        draws = Draws.of_prior(first, self.rows(first))
        laws = [] if self._law is None else [self._law]
        if size >= GROWN * self._looked:
            laws.append(self._look(rng))
            self._looked = size
        number = max(ROUND, 10 * ndim)
        law = refine(draws, join(laws), number, ROUNDS * number, propose)
        self._law = uncover(law)
        tempered = temper(draws.log_weights, ndim + 1, np.arange(len(draws.x)))
        chosen = resample(np.exp(tempered - tempered.max()), MEMBERS, rng)
        x, log_p = draws.x[chosen], draws.log_p[chosen]
        wide, posterior = scale.parameters(x), problem.replace_model(emulator)
        log_weights = posterior(wide)[:, 0] + scale.log_volume(x) - log_p
        log_weights += (draws.log_weights - tempered)[chosen]
        log_weights = temper(log_weights, ndim + 1, chosen)
        weights = np.exp(log_weights - log_weights.max())
        weights /= weights.sum()
        mean = weights @ x
        apart = x - mean
        errors = problem.predict_error(posterior, wide) ** 2
        own = resample(weights, MEMBERS, rng)
        return EmulatedDraws(
            theta=wide[own],
            errors=errors[own],
            wide=wide,
            wide_errors=errors,
            mean=mean,
            covariance=(weights * apart.T) @ apart,
        )

    def _look(self, rng: np.random.Generator) -> Mixture:
        """Return the law of a population annealed from the prior.

        Or of the prior, if the population has become copies of too few members.
        """
        size = max(ANNEALED, fewest_members(len(self.scale.names)))
        x = anneal_population(self, self.scale, rng, size).theta
        try:
            return Mixture(*fit_mixture(x, "auto", DF), DF)
        except ValueError:
            return Mixture(*fit_mixture(self.scale.sample(rng, size), 1, DF), DF)


def temper(log_weights: Floats, fewest: float, which: NDArray[np.intp]) -> Floats:
    """Return log-weights, halved until so many draws count.

    A law that is far from the posterior may leave all weight to one draw, which has no
    covariance, however many copies of it there are: ``which (n,)`` tells copies.
    """

    def effective() -> float:
        shares = np.bincount(which, np.exp(log_weights - log_weights.max()))
        return float(shares.sum() ** 2 / (shares**2).sum())

    while effective() < fewest:
        if np.ptp(log_weights[np.isfinite(log_weights)]) < 1.0:
            break
        log_weights = 0.5 * log_weights
    return log_weights


def join(laws: list[Mixture]) -> Mixture:
    """Return the mixture of mixtures in equal parts, with the tails of the last."""
    return laws[-1]._replace(
        weights=np.concatenate([law.weights for law in laws]) / len(laws),
        means=np.concatenate([law.means for law in laws]),
        matrices=np.concatenate([law.matrices for law in laws]),
    )


def resample(weights: Floats, size: int, rng: np.random.Generator) -> NDArray[np.intp]:
    """Return members as often as their weights say, to one (systematic)."""
    places = (np.arange(size) + rng.random()) / size
    edges = np.cumsum(weights) / weights.sum()
    return np.minimum(np.searchsorted(edges, places, side="right"), len(weights) - 1)
