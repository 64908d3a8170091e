"""``run(..., moves="auto")``: search, refine a proposal, freeze it, start from it."""

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
from .search_record import SearchRecord, label, separate, weigh

SEARCHED = 0.2  # of the evaluations of the chain
FEWEST = 1_000  # points of a search
ROUND = 300  # draws of a round of the refinement, at least
TRIED = 800  # draws by which a proposal is judged, at least
REFINED = 1_500  # draws for a refinement, or half as many as the chain has
POPULATION, POPULATION_DF = 1_000, 5.0  # members of all ensembles
POOR = 0.2  # acceptance below which gradients do better
TUNED = 24  # draws from which Hamiltonian moves are tuned
MISSED = 1.0  # log evidence by which one proposal finds more than another
# Share of independence proposals by their expected acceptance.
SHARES = ((0.2, 0.9), (0.05, 0.6), (0.0, 0.2))
BESIDE = 0.1  # the same beside Hamiltonian moves
KEPT = 2_000  # importance weights in the record

Population = tuple[Floats, Floats]  # members and their rows


def search_and_start(
    evaluator: Evaluator,
    nwalkers: int,
    ensembles: int,
    seed: int,
    evaluations: int,
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
        evaluations: Those of the chain, by which the search may spend.
        starts: Points that are searched too, ``(ensembles, n, d)``.

    Returns:
        What was found, and the evaluated start of each ensemble with its random
        stream.
    """
    seeds = np.random.SeedSequence(seed).spawn(ensembles)
    streams = [np.random.default_rng(child.spawn(1)[0]) for child in seeds]
    search = Search(evaluator, streams)
    search.run(max(FEWEST, round(SEARCHED * evaluations)), starts)
    most = max(REFINED, evaluations // 2)
    trial, populations, gradients = _find_proposal(
        search, most, 4 * nwalkers * ensembles
    )
    mode_of = separate(trial.mixture)
    count = int(mode_of.max()) + 1
    tops = np.array([maximum.theta for maximum in search.maxima])
    found_by = np.zeros((ensembles, count), dtype=np.intp)
    for mode, by in zip(
        label(tops, trial.mixture, mode_of), search.found_by, strict=True
    ):
        found_by[:, mode] += by
    labels = label(trial.theta, trial.mixture, mode_of)
    places = []
    for ensemble, rng in enumerate(streams):
        if trial.narrow and populations:
            theta, rows = populations[ensemble]
            chosen = rng.choice(len(theta), nwalkers, replace=nwalkers > len(theta))
        else:
            theta, rows = trial.theta, trial.rows
            part = np.array_split(np.arange(len(theta)), ensembles)[ensemble]
            in_its_modes = found_by[ensemble, labels] > 0
            chosen = _choose_draws(rng, trial.log_weights, part, in_its_modes, nwalkers)
        places.append((theta[chosen], rows[chosen]))
    states, shares = [], []
    for child, (theta, rows) in zip(seeds, places, strict=True):
        random = np.random.RandomState(np.random.MT19937(child)).get_state()
        states.append(emcee.State(theta, rows[:, 0], rows[:, 1:], random))
        modes = label(theta, trial.mixture, mode_of)
        shares.append(np.bincount(modes, minlength=count) / nwalkers)
    share = next(s for least, s in SHARES if trial.acceptance >= least)
    trajectories = None
    if gradients:
        draws = np.concatenate([theta for theta, _ in places])
        trajectories = _tune_trajectories(evaluator, trial.mixture, draws)
        share = BESIDE if count > 1 else 0.0  # for jumps between modes
    weights, errors = weigh(labels, trial.log_weights, count)
    record = SearchRecord(
        mixture=trial.mixture,
        mode_of=mode_of,
        weights=weights,
        errors=errors,
        found_by=found_by,
        starts=np.array(shares),
        pareto_k=trial.pareto_k,
        efficiency=trial.efficiency,
        log_weights=trial.log_weights[:: -(-len(trial.log_weights) // KEPT)],
        points=len(search.theta),
        climbs=search.climbs,
        annealed=bool(populations),
        solves=evaluator.solves,
        share=share,
        trajectories=trajectories,
    )
    return record, states


def _find_proposal(
    search: Search, most: int, fewest: int
) -> tuple[Trial, list[Population], bool]:
    """Return a proposal, annealed populations, and whether gradients do better.

    Args:
        search: What was found.
        most: Draws after which no round of the refinement begins.
        fewest: Draws by which it is judged, at least.
    """
    evaluator, streams = search.evaluator, search.streams

    def propose(mixture: Mixture, number: int) -> tuple[Floats, Floats]:
        each = -(-number // len(streams))
        theta = np.concatenate([mixture.draw(rng, each) for rng in streams])
        return theta, evaluator.rows(theta)

    size = max(ROUND, 10 * evaluator.posterior.ndim)

    def attempt(mixture: Mixture) -> Trial:
        refined = refine(search.draws, mixture, size, most, propose)
        return Trial(refined, *propose(refined, max(TRIED, 2 * size, fewest)))

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
    return trial, populations, gradients


def is_better(second: Trial, first: Trial) -> bool:
    """Return whether a proposal finds more of the posterior, or fits it better."""
    if not (first.efficiency and second.efficiency):  # one never met the posterior
        return second.efficiency > first.efficiency
    gain = second.log_evidence - first.log_evidence
    better = second.efficiency > first.efficiency
    return gain > MISSED or (gain > -MISSED and better)


def _tune_trajectories(
    evaluator: Evaluator, mixture: Mixture, draws: Floats
) -> dict[str, object]:
    """Return the arguments of Hamiltonian moves."""
    narrow = uncover(mixture)
    metric = np.einsum("k,kij->ij", narrow.weights, narrow.matrices)
    some = draws[:: -(-len(draws) // TUNED)]
    move = HamiltonianMove.tuned(evaluator, some, metric, seed=0)
    return {"metric": metric, "steps": move.steps, "step_size": move.step_size}


def _anneal_each(search: Search) -> list[Population]:
    """Return an annealed population, and its rows, of each ensemble."""
    posterior = search.evaluator.posterior
    size = max(fewest_members(posterior.ndim), POPULATION // len(search.streams))
    plain = Coordinates.plain(posterior.prior)
    annealed = [
        anneal_population(search.evaluator, plain, rng, size) for rng in search.streams
    ]
    return [(population.theta, population.rows) for population in annealed]


def _choose_draws(
    rng: np.random.Generator,
    log_weights: Floats,
    part: NDArray[np.intp],
    in_its_modes: NDArray[np.bool_],
    nwalkers: int,
) -> NDArray[np.intp]:
    """Return which draws an ensemble's walkers start from, by importance weights.

    Its part of them; if none of that is in the modes that it found, any; and if none
    is possible at all, those of the others.
    """
    possible = np.isfinite(log_weights)
    if not possible.any():
        raise ValueError(
            f"posterior: it is zero at all of {len(log_weights)} draws of the proposal "
            "that was fitted to it; is nearly all of it at its bounds? Narrow the "
            "prior, or use DEMCMove()"
        )
    if not possible[part].any():
        part = np.arange(len(log_weights))
    eligible = log_weights[part]
    if (possible & in_its_modes)[part].any():
        eligible = np.where(in_its_modes[part], eligible, -np.inf)
    drawn = resample(normalise(eligible), nwalkers, rng.random(nwalkers))  # stratified
    return rng.permutation(part[drawn])
