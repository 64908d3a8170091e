"""Draws of an emulated posterior, and of what it may yet turn out to be."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..interfaces import Floats, Parameters
from ..posterior.log_posterior import LogPosterior
from .annealing import anneal_population
from .emulate_problem import EmulationProblem
from .renewing import fewest_members

MEMBERS = 500  # of a population, at least
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
        mean, covariance: Of the emulated posterior.
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


class _Cheap:
    """Evaluates an emulated posterior for a search."""

    def __init__(self, posterior: LogPosterior) -> None:
        self.posterior, self.solves = posterior, 0

    def rows(self, theta: Floats) -> Floats:
        self.solves += len(theta)
        return self.posterior(theta)


def draw_emulated(
    problem: EmulationProblem, emulator: Any, rng: np.random.Generator
) -> EmulatedDraws:
    """Return draws; the wider population is annealed from the prior, anew each time.

    So it looks at the whole prior, and does not depend on what was seen before.
    """
    posterior = problem.replace_model(emulator)
    wider = _Cheap(problem.replace_model(Doubtful(emulator, WIDER)))
    size = max(MEMBERS, 2 * fewest_members(posterior.ndim))
    wide = anneal_population(wider, posterior.prior, rng, size)
    log_weights = posterior(wide.theta)[:, 0] - wide.rows[:, 0]
    weights = np.exp(log_weights - log_weights.max())
    weights /= weights.sum()
    mean = weights @ wide.theta
    apart = wide.theta - mean
    # Systematic: a member as often as its weight says, to one.
    places = (np.arange(size) + rng.random()) / size
    chosen = np.searchsorted(np.cumsum(weights), places, side="right")
    theta = wide.theta[np.minimum(chosen, size - 1)]
    return EmulatedDraws(
        theta=theta,
        errors=problem.predict_error(posterior, theta) ** 2,
        wide=wide.theta,
        wide_errors=problem.predict_error(posterior, wide.theta) ** 2,
        mean=mean,
        covariance=(weights * apart.T) @ apart,
    )
