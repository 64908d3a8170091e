"""Draws of an emulated posterior, and of what it may yet turn out to be."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..evaluation.evaluator import Evaluation, Solver
from ..interfaces import Evaluator, Floats
from ..sampling.anneal import anneal_population, fewest_members
from ..sampling.coordinates import Coordinates
from ..sampling.importance import normalise, resample, resampled_count
from .emulated import EmulatedModel
from .emulation_problem import EmulationProblem

MEMBERS = 500  # draws that stand for a posterior
SWEEPS = 5  # at one power at most
FEWEST = 200  # independent draws that they are to be worth
GROWN = 1.5  # times as many points for another look at the whole prior
WIDER = 2.0  # standard deviations of the emulator that may be one in truth


@dataclass(frozen=True, eq=False)
class EmulatedDraws:
    """Draws of the emulated posterior, and of a wider one around it.

    The wider one, whose emulator has twice the error that it claims, lies also where
    the full model may turn out to be better than the emulator says.

    Attributes:
        wide: Draws of the wider one, ``(n, d)``, of equal weight.
        errors: Mean square errors predicted there, ``(n,)``, as those of ``deviate``.
        members: Which of them are draws of the emulated one, with repetitions.
        weights: Of ``wide`` as draws of the emulated one, ``(n,)``, which sum to one.
        size: As many independent draws are worth as much.
    """

    wide: Floats
    errors: Floats
    members: NDArray[np.intp]
    weights: Floats
    size: float

    @property
    def predicted(self) -> float:
        """The root mean square of the predicted errors."""
        return float(np.sqrt(self.errors[self.members].mean()))


class Explorer:
    """Draws from one emulated posterior after another.

    A population is carried from each to the next, power by power of their ratio. When
    the solves have grown by half, half of it is annealed from the prior anew, which
    knows nothing of what was seen before, so that a mode that one emulator excluded
    comes back with a later one; either half is then moved by proposals fitted to the
    other.

    Args:
        problem: What is emulated.
        coordinates: In which the posterior is explored.
    """

    def __init__(self, problem: EmulationProblem, coordinates: Coordinates) -> None:
        self.problem, self.coordinates = problem, coordinates
        self._last: tuple[Evaluator, Floats] | None = None
        self._looked = 0

    def draw(
        self, emulator: EmulatedModel, size: int, rng: np.random.Generator
    ) -> EmulatedDraws:
        """Return draws of the posterior of an emulator made from ``size`` points."""
        problem, coordinates = self.problem, self.coordinates
        wider = problem.replace_model(replace(emulator, factor=WIDER))
        evaluator = Evaluation(Solver(wider, False))
        fewest = fewest_members(wider.ndim)
        number = max(MEMBERS, fewest)

        def carry(number: int, begin: tuple[Evaluator, Floats] | None) -> Floats:
            return anneal_population(
                evaluator, coordinates, rng, number, sweeps=SWEEPS, begin=begin
            ).theta

        x = carry(number, self._last)
        if self._last is not None and size >= GROWN * self._looked:
            fresh = carry(max(number // 2, fewest), None)[: number // 2]
            x = carry(number, (evaluator, np.vstack([x[::2], fresh])))
        if size >= GROWN * self._looked:
            self._looked = size
        self._last = evaluator, x
        wide = coordinates.parameters(x)
        posterior = problem.replace_model(emulator)
        log_weights = posterior(wide)[:, 0] - wider(wide)[:, 0]
        which = np.unique(x, axis=0, return_inverse=True)[1].ravel()
        weights = normalise(_temper(log_weights, which))
        return EmulatedDraws(
            wide=wide,
            errors=problem.predict_error(posterior, wide),
            members=resample(weights, MEMBERS, rng.random()),
            weights=weights,
            size=resampled_count(which, weights),
        )


def _temper(log_weights: Floats, which: NDArray[np.intp]) -> Floats:
    """Return log-weights, halved until enough draws count.

    As long as the emulator is poor few draws of the wider posterior may be such of the
    narrower one, which then is one between the two; ``which (n,)`` tells copies.
    """
    while resampled_count(which, normalise(log_weights)) < FEWEST:
        if np.ptp(log_weights[np.isfinite(log_weights)]) < 1.0:
            break
        log_weights = 0.5 * log_weights
    return log_weights
