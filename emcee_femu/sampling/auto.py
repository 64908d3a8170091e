"""``run(..., moves="auto")``: search, refine a proposal, freeze it, start from it."""

from collections.abc import Sequence
from typing import NamedTuple

import emcee
import numpy as np
from numpy.typing import NDArray

from ..interfaces import Evaluator, Floats
from ..moves import HamiltonianMove
from ..moves.mixture import Mixture
from .anneal import anneal_population, fewest_members
from .coordinates import Coordinates
from .importance import normalise, resample
from .proposals import Trial, refine, uncover
from .search import Search
from .search_record import Labels, SearchRecord, label, separate

SEARCHED = 0.2  # of the evaluations of the chain
FEWEST = 1_000  # points of a search
ROUND = 300  # draws of a round of the refinement, at least
TRIED = 800  # draws by which a proposal is judged, at least
REFINED = 1_500  # draws for a refinement, or half as many as the chain has
POPULATION, POPULATION_DF = 1_000, 5.0  # members of all ensembles
POOR = 0.2  # acceptance below which gradients do better
TUNED = 24  # draws from which Hamiltonian moves are tuned
MISSED = 1.0  # log evidence by which one proposal finds more than another

Population = tuple[Floats, Floats]  # members and their rows


class Budget(NamedTuple):
    """What a search may spend.

    Attributes:
        points: Points that are searched for modes.
        draws: Draws after which no round of the refinement begins.
    """

    points: int
    draws: int

    @classmethod
    def of(cls, evaluations: int) -> "Budget":
        """Return the budget by the evaluations of the chain."""
        points = max(FEWEST, round(SEARCHED * evaluations))
        return cls(points, max(REFINED, evaluations // 2))


def search_and_start(
    evaluator: Evaluator,
    nwalkers: int,
    ensembles: int,
    seed: int,
    budget: Budget,
    starts: Floats | None,
) -> tuple[SearchRecord, list[emcee.State]]:
    """Search for the modes, refine a proposal, and draw the starts from it.

    The modes that any ensemble found are components of one proposal, from which each
    ensemble draws with its own stream. Its walkers start from its own draws, by their
    importance weights, in those modes that it found itself: it is the chain that has
    to bring the ensembles to agree. Where no proposal is good, annealed populations
    are a second way to one, and each ensemble starts from its own.

    Args:
        evaluator: What evaluates, and stores where there is a file.
        nwalkers: Walkers per ensemble.
        ensembles: How many there are.
        seed: Of the run.
        budget: What the search may spend.
        starts: Points that are searched too, ``(ensembles, n, d)``.

    Returns:
        What was found, and the evaluated start of each ensemble with its random
        stream.
    """
    ndim = evaluator.posterior.ndim
    seeds = np.random.SeedSequence(seed).spawn(ensembles)
    streams = [np.random.default_rng(child.spawn(1)[0]) for child in seeds]
    search = Search(evaluator, streams)
    search.run(budget.points, starts)

    def propose(mixture: Mixture, number: int) -> tuple[Floats, Floats]:
        each = -(-number // len(streams))
        theta = np.concatenate([mixture.draw(rng, each) for rng in streams])
        return theta, evaluator.rows(theta)

    size = max(ROUND, 10 * ndim)
    final = max(TRIED, 2 * size, 4 * nwalkers * ensembles)

    def attempt(mixture: Mixture) -> Trial:
        refined = refine(search.draws, mixture, size, budget.draws, propose)
        return Trial.of(refined, final, propose)

    trial = attempt(search.mixture())
    populations: list[Population] = []
    gradients = evaluator.posterior.differentiable and trial.acceptance < POOR
    if trial.narrow and not (gradients and trial.efficiency):
        if trial.acceptance < POOR:  # the shapes of the modes say too little
            populations = _anneal_each(search)
            members = np.concatenate([theta for theta, _ in populations])
            second = attempt(Mixture.fit(members, "auto", POPULATION_DF))
        else:
            second = attempt(uncover(trial.mixture))
        trial = second if is_better(second, trial) else trial
    places = _choose_starts(search, trial, populations, nwalkers)
    states = []
    for child, (theta, rows) in zip(seeds, places, strict=True):
        random = np.random.RandomState(np.random.MT19937(child)).get_state()
        states.append(emcee.State(theta, rows[:, 0], rows[:, 1:], random))
    trajectories = None
    if gradients:
        draws = np.concatenate([theta for theta, _ in places])
        trajectories = _tune_trajectories(evaluator, trial.mixture, draws)
    coords = [theta for theta, _ in places]
    annealed = bool(populations)
    return SearchRecord.of(search, trial, coords, annealed, trajectories), states


def is_better(second: Trial, first: Trial) -> bool:
    """Return whether a proposal finds more of the posterior, or fits it better."""
    if not (first.efficiency and second.efficiency):  # one never met the posterior
        return second.efficiency > first.efficiency
    gain = second.log_evidence - first.log_evidence
    better = second.efficiency > first.efficiency
    return gain > MISSED or (gain > -MISSED and better)


def _tune_trajectories(
    evaluator: Evaluator, mixture: Mixture, draws: Floats
) -> tuple[Floats, int, float]:
    """Return metric, number of steps and step size of Hamiltonian moves."""
    narrow = uncover(mixture)
    metric = np.einsum("k,kij->ij", narrow.weights, narrow.matrices)
    some = draws[:: -(-len(draws) // TUNED)]
    move = HamiltonianMove.tuned(evaluator, some, metric, seed=0)
    return metric, move.steps, move.step_size


def _anneal_each(search: Search) -> list[Population]:
    """Return an annealed population, and its rows, of each ensemble."""
    posterior = search.evaluator.posterior
    size = max(fewest_members(posterior.ndim), POPULATION // len(search.streams))
    plain = Coordinates.plain(posterior.prior)
    annealed = [
        anneal_population(search.evaluator, plain, rng, size) for rng in search.streams
    ]
    return [(population.theta, population.rows) for population in annealed]


def _choose_starts(
    search: Search, trial: Trial, populations: Sequence[Population], nwalkers: int
) -> list[Population]:
    """Return where the walkers of each ensemble start, with their rows."""
    mode_of = separate(trial.mixture)
    tops = np.array([maximum.theta for maximum in search.maxima])
    modes = label(tops, trial.mixture, mode_of)
    places = []
    for ensemble, rng in enumerate(search.streams):
        if trial.narrow and populations:
            theta, rows = populations[ensemble]
            chosen = rng.choice(len(theta), nwalkers, replace=nwalkers > len(theta))
        else:
            theta, rows = trial.theta, trial.rows
            by = np.array([climbs[ensemble] > 0 for climbs in search.found_by])
            known = np.isin(np.arange(int(mode_of.max()) + 1), modes[by])
            parts = np.array_split(np.arange(len(theta)), len(search.streams))
            chosen = _choose_draws(
                rng, trial, parts[ensemble], mode_of, known, nwalkers
            )
        places.append((theta[chosen], rows[chosen]))
    return places


def _choose_draws(
    rng: np.random.Generator,
    trial: Trial,
    draws: NDArray[np.intp],
    mode_of: Labels,
    known: NDArray[np.bool_],
    nwalkers: int,
) -> NDArray[np.intp]:
    """Return which draws an ensemble's walkers start from, by importance weights.

    If it has none in the modes that it found, from any of its draws.
    """
    if not np.isfinite(trial.log_weights[draws]).any():
        draws = np.arange(len(trial.theta))
    log_weights = trial.log_weights[draws]
    if not np.isfinite(log_weights).any():
        raise ValueError(
            f"posterior: it is zero at all of {len(draws)} draws of the proposal that "
            "was fitted to it; is nearly all of it at its bounds? Narrow the prior, or "
            "use DEMCMove()"
        )
    inside = known[label(trial.theta[draws], trial.mixture, mode_of)]
    if np.isfinite(log_weights[inside]).any():
        log_weights = np.where(inside, log_weights, -np.inf)
    weights = normalise(log_weights)
    chosen = draws[resample(weights, nwalkers, rng.random(nwalkers))]  # stratified
    return rng.permutation(chosen)
