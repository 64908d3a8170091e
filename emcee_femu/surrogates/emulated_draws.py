"""Draws of an emulated posterior, and of what it may yet turn out to be."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..evaluation.evaluator import Evaluation, Solver
from ..interfaces import Evaluator, Floats
from ..moves.mixture import Mixture
from ..sampling.anneal import anneal_population, fewest_members
from ..sampling.coordinates import Coordinates
from ..sampling.importance import normalise, resample, resampled_count
from ..sampling.proposals import Draws, refine, uncover
from .emulated import EmulatedModel
from .emulation_problem import EmulationProblem

MEMBERS = 500  # draws that stand for a posterior
FROM_PRIOR = 400  # draws
ROUND, ROUNDS = 300, 6  # draws of a round of a refinement at least, and rounds at most
ANNEALED, DF = 200, 5.0  # members at least, and the tails that are fitted to them
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
    """

    wide: Floats
    errors: Floats
    members: NDArray[np.intp]
    weights: Floats

    @property
    def predicted(self) -> float:
        """The root mean square of the predicted errors."""
        return float(np.sqrt(self.errors[self.members].mean()))


class Explorer:
    """Draws from one emulated posterior after another.

    A proposal is refined from round to round by importance weights. Among its draws
    there are always some of the prior; and whenever the solves have grown by half, a
    population annealed from the prior joins it, which knows nothing of what was seen
    before, so that a mode that one emulator excluded comes back with a later one.

    Args:
        problem: What is emulated.
        coordinates: In which the posterior is explored.
    """

    def __init__(self, problem: EmulationProblem, coordinates: Coordinates) -> None:
        self.problem, self.coordinates = problem, coordinates
        self._mixture: Mixture | None = None
        self._looked = 0

    def draw(
        self, emulator: EmulatedModel, size: int, rng: np.random.Generator
    ) -> EmulatedDraws:
        """Return draws of the posterior of an emulator made from ``size`` points."""
        problem, coordinates = self.problem, self.coordinates
        wider = problem.replace_model(replace(emulator, factor=WIDER))
        evaluator = Evaluation(Solver(wider, False))
        x = coordinates.sample(rng, FROM_PRIOR)
        draws, d = Draws(x, coordinates.rows(evaluator, x)), x.shape[1]
        mixtures = [] if self._mixture is None else [self._mixture]
        if size >= GROWN * self._looked:
            mixtures.append(_look(evaluator, coordinates, rng))
            self._looked = size

        def propose(mixture: Mixture, number: int) -> tuple[Floats, Floats]:
            proposed = mixture.draw(rng, number)
            return proposed, coordinates.rows(evaluator, proposed)

        number = max(ROUND, 10 * d)
        refined = refine(draws, _join(mixtures), number, ROUNDS * number, propose)
        self._mixture = uncover(refined)
        tempered = _temper(draws.log_weights, d + 1, np.arange(len(draws.x)))
        chosen = resample(normalise(tempered), MEMBERS, rng.random())
        x, log_p = draws.x[chosen], draws.log_p[chosen]
        wide = coordinates.parameters(x)
        posterior = problem.replace_model(emulator)
        log_weights = posterior(wide)[:, 0] + coordinates.log_volume(x) - log_p
        log_weights += (draws.log_weights - tempered)[chosen]
        weights = normalise(_temper(log_weights, d + 1, chosen))
        return EmulatedDraws(
            wide=wide,
            errors=problem.predict_error(posterior, wide),
            members=resample(weights, MEMBERS, rng.random()),
            weights=weights,
        )


def _look(
    evaluator: Evaluator, coordinates: Coordinates, rng: np.random.Generator
) -> Mixture:
    """Return a fit to a population annealed from the prior.

    Or to the prior, if the population has become copies of too few members.
    """
    size = max(ANNEALED, fewest_members(evaluator.posterior.ndim))
    x = anneal_population(evaluator, coordinates, rng, size).theta
    try:
        return Mixture.fit(x, "auto", DF)
    except ValueError:
        return Mixture.fit(coordinates.sample(rng, size), 1, DF)


def _temper(log_weights: Floats, fewest: float, which: NDArray[np.intp]) -> Floats:
    """Return log-weights, halved until so many draws count.

    A proposal far from the posterior may leave all weight to one draw, which has no
    covariance, however many copies of it there are: ``which (n,)`` tells copies.
    """
    while resampled_count(which, normalise(log_weights)) < fewest:
        if np.ptp(log_weights[np.isfinite(log_weights)]) < 1.0:
            break
        log_weights = 0.5 * log_weights
    return log_weights


def _join(mixtures: list[Mixture]) -> Mixture:
    """Return the mixture of mixtures in equal parts, with the tails of the last."""
    return replace(
        mixtures[-1],
        weights=np.concatenate([m.weights for m in mixtures]) / len(mixtures),
        means=np.concatenate([m.means for m in mixtures]),
        matrices=np.concatenate([m.matrices for m in mixtures]),
    )
