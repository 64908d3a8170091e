"""Draws of an emulated posterior, and of a wider one around it."""

from dataclasses import dataclass, replace

import numpy as np

from ...contracts import Floats
from ...evaluation.evaluator import Evaluation, Solver
from ...evaluation.failures import FailureLog
from ...moves.proposing import temper
from ...posterior.log_posterior import LOG_POSTERIOR, LogPosterior, log_likelihood
from ...search.anneal import anneal_population, fewest_members
from ...search.coordinates import Coordinates
from ...search.importance import bridge
from ...search.record import Annealed
from .emulated import EmulatedModel
from .problem import EmulationProblem

MEMBERS = 300  # draws that stand for a posterior
GROWN = 1.5  # growth of the number of points before another look at the prior
# Error predicted at carried draws below which each round has a look.
SMALL_PREDICTED = 0.1
WIDER_IN_TRUTH = 2.0  # emulator sds that may be a single sd in truth
# Power of the likelihood that makes a Gaussian posterior twice as wide.
WIDER_POWER = 0.25


@dataclass(frozen=True, eq=False)
class EmulatedDraws:
    """Draws of the emulated posterior, and of a wider one around it.

    The wider one assumes twice the emulator's claimed error, so it also covers places
    where the full model may turn out to fit better than the emulator predicts.

    Attributes:
        members: Draws of the emulated posterior, ``(n, d)``, with equal weights.
        wide: Draws of the wider one.
        errors: Mean square errors predicted at members, then at the wide ones,
            ``(2 n,)``, as returned by ``deviate``.
        size: Number of independent draws that the members are worth, from their
            lineages; the smaller number of the two halves.
    """

    members: Floats
    wide: Floats
    errors: Floats
    size: float

    @property
    def predicted(self) -> float:
        """The root mean square of the errors predicted at members."""
        return float(np.sqrt(self.errors[: len(self.members)].mean()))


@dataclass(eq=False)
class TemperedEvaluation(Evaluation):
    """An evaluator of a posterior with a power of the likelihood."""

    power: float = 1.0

    def rows(self, theta: Floats) -> Floats:
        """Return rows of the tempered posterior at ``theta (n, d)``."""
        rows = super().rows(theta)
        rows[:, 0] = temper(rows[:, 0], rows[:, 1], self.power)
        return rows


class Explorer:
    """Draws from one emulated posterior after another.

    Two populations are carried from each posterior to the next, by powers of their
    ratio: one of the emulated posterior, and one of the wider. When the number of
    solves has grown by half, or if the carried draws are emulated well, the wider one
    is annealed anew from the prior, without knowledge of earlier draws, and half of the
    other population is taken from it. A mode that one emulator excluded thus reappears
    with a later one. Each half is then moved by proposals fitted to the other.

    Args:
        problem: What is emulated.
    """

    def __init__(self, problem: EmulationProblem) -> None:
        self.problem, self._looked = problem, 0
        self._last: tuple[tuple[Evaluation, Floats], ...] | None = None

    def draw(
        self,
        emulator: EmulatedModel,
        coordinates: Coordinates,
        rng: np.random.Generator,
        power: float,
    ) -> EmulatedDraws:
        """Return draws of an emulator's posterior, of a ``power`` of its likelihood."""
        problem, size = self.problem, len(emulator.processes[0].points)
        posterior = problem.replace_model(emulator)
        wider = problem.replace_model(replace(emulator, factor=WIDER_IN_TRUTH))
        narrow, broad = (
            TemperedEvaluation(Solver(each, False), power=power)
            for each in (posterior, wider)
        )
        number = max(MEMBERS, fewest_members(posterior.ndim))

        def carry(
            evaluator: Evaluation, begin: tuple[Evaluation, Floats] | None
        ) -> Annealed:
            if begin is not None:
                halves = np.array_split(begin[1], 2)
                distinct = min(len(np.unique(half, axis=0)) for half in halves)
                theta = coordinates.coordinates(begin[1])
                # Copies have no covariance: it begins with the prior instead.
                begin = (begin[0], theta) if distinct > 2 * posterior.ndim else None
            found = anneal_population(evaluator, coordinates, rng, number, begin=begin)
            return replace(found, theta=coordinates.parameters(found.theta))

        last, kept, look = self._last, None, size >= GROWN * self._looked
        if last is not None:
            kept = carry(narrow, last[0])
            square = problem.predict_error(posterior, kept.theta).mean()
            look = look or square <= SMALL_PREDICTED**2
        wide = carry(broad, None if last is None or look else last[1]).theta
        if look:
            self._looked = size
        population = carry(narrow, (broad, wide)) if look or kept is None else kept
        members, worth = population.theta, population.effective_size.min()
        if look and kept is not None:
            halves = np.vstack([kept.theta[::2], members[1::2]])
            members = carry(narrow, (narrow, halves)).theta
            worth = min(worth, kept.effective_size.min())
        self._last = (narrow, members), (broad, wide)
        errors = problem.predict_error(posterior, np.vstack([members, wide]))
        return EmulatedDraws(members, wide, errors, float(worth))


def draw_wider(
    approximate: LogPosterior,
    log_likelihoods: Floats,
    number: int,
    rng: np.random.Generator,
) -> tuple[Floats, Floats, float]:
    r"""Return draws of a wider approximate posterior, which cost no full solve.

    .. math:: p_w(\theta) = p(\theta) \tilde L(\theta)^{1/4} / Z_w

    It is annealed from the prior, so it has parts that no chain came upon.

    Args:
        approximate: The approximate posterior.
        log_likelihoods: Of it, at draws of it, ``(m,)``.
        number: How many draws, at most a population's.
        rng: Draws.

    Returns:
        Different draws ``(n, d)``, their approximate log-posterior ``(n,)``, and the
        logarithm of the approximate evidence divided by :math:`Z_w`.

    Raises:
        ValueError: If too few draws of the prior have a finite likelihood.
        RuntimeError: If the likelihood jumps.
    """
    solver = Solver(approximate, True)
    evaluator = TemperedEvaluation(solver, None, FailureLog(1.0), power=WIDER_POWER)
    coordinates = Coordinates.unbounded(approximate.prior)
    size = max(MEMBERS, fewest_members(approximate.ndim))
    x = anneal_population(evaluator, coordinates, rng, size).theta
    theta = np.unique(coordinates.inside(x), axis=0)
    rows = Evaluation(solver, None, FailureLog(1.0)).rows(theta)
    less = 1 - WIDER_POWER
    ratio = bridge(less * log_likelihoods, less * log_likelihood(rows))
    some = rng.permutation(len(theta))[:number]
    return theta[some], rows[some, LOG_POSTERIOR], ratio.log_ratio
