"""The recipe behind ``run(..., moves="auto")``: search, refine, freeze."""

from typing import Any, NamedTuple

import emcee
import numpy as np
from numpy.typing import NDArray

from ..interfaces import Floats
from ..moves import HamiltonianMove
from ..moves.mixture_em import Mixture, draw
from ..moves.mixture_fit import fit_mixture
from .annealing import anneal_population, fewest_members
from .arguments import Settings
from .groups import count_shares, label
from .journal import Journal
from .recipe import BESIDE, Recipe, describe, make_moves, write_sentence
from .refine import refine, uncover
from .search import Search
from .trial import Trial, try_out

SEARCHED = 0.2  # of the evaluations of the chain
FEWEST = 1_000  # points of a search
ROUND = 300  # draws of a round of the refinement, at least
TRIED = 800  # draws by which a proposal is judged, at least
REFINED = 1_500  # draws for a refinement, or half as many as the chain has
POPULATION, POPULATION_DF = 1_000, 5.0  # members of all ensembles
POOR = 0.2  # acceptance below which gradients do better
TUNED = 24  # draws from which Hamiltonian moves are tuned
MISSED = 1.0  # log evidence by which one proposal finds more than another


class Budget(NamedTuple):
    """What a search may spend.

    Attributes:
        points: Points that are searched for modes.
        draws: Draws after which no round of the refinement begins.
    """

    points: int
    draws: int


def plan(settings: Settings) -> Budget:
    """Return the budget of a search, by the evaluations of the chain."""
    generations = settings.nsteps * settings.thin_by
    chain = generations * settings.nwalkers * settings.ensembles
    return Budget(max(FEWEST, round(SEARCHED * chain)), max(REFINED, chain // 2))


def find_recipe(journal: Journal, settings: Settings, budget: Budget) -> Recipe:
    """Search for the modes, refine a proposal, and draw the starts from it.

    The modes that any ensemble found are components of one proposal, from which each
    ensemble draws with its own stream. Its walkers start from its own draws, by their
    importance weights, in those groups that it found itself: it is the chain that has
    to bring the ensembles to agree. Where no proposal is good, annealed populations
    are a second way to one, and each ensemble starts from its own.

    Args:
        journal: Evaluates.
        settings: What was asked for.
        budget: What the search may spend.
    """
    ndim, nwalkers = settings.posterior.ndim, settings.nwalkers
    seeds = np.random.SeedSequence(settings.seed).spawn(settings.ensembles)
    streams = [np.random.default_rng(seed.spawn(1)[0]) for seed in seeds]
    search = Search(journal, settings.posterior.prior, streams)
    search.run(budget.points, settings.initial)

    def propose(law: Mixture, number: int) -> tuple[Floats, Floats]:
        each = -(-number // len(streams))
        theta = np.concatenate([draw(rng, law, each) for rng in streams])
        return theta, journal.rows(theta)

    size = max(ROUND, 10 * ndim)
    final = max(TRIED, 2 * size, 4 * nwalkers * len(streams))

    def attempt(law: Mixture) -> Trial:
        refined = refine(search.draws, law, size, budget.draws, propose)
        return try_out(refined, final, propose)

    trial = attempt(search.law())
    populations = None
    gradients = settings.posterior.differentiable and trial.acceptance < POOR
    if trial.narrow and not (gradients and trial.share):
        if trial.acceptance < POOR:  # the shapes of the modes say too little
            populations = anneal_each(journal, search)
            law = fit_population(np.concatenate([theta for theta, _ in populations]))
        else:
            law = uncover(trial.law)
        other = attempt(law)
        trial = other if is_better(other, trial) else trial
    record = describe(search, trial)
    group_of, count = np.array(record["group_of"]), len(record["weights"])
    record["start"], states = [], []
    for number, (rng, seed) in enumerate(zip(streams, seeds, strict=True)):
        if trial.narrow and populations is not None:
            theta, rows = populations[number]
            chosen = rng.choice(len(theta), nwalkers, replace=nwalkers > len(theta))
        else:
            theta, rows = trial.theta, trial.rows
            found = np.array(record["found_by"][number]) > 0
            chosen = choose_starts(
                rng, trial, number, len(streams), group_of, found, nwalkers
            )
        coords, rows = theta[chosen], rows[chosen]
        record["start"].append(count_shares(label(coords, trial.law, group_of), count))
        random = np.random.RandomState(np.random.MT19937(seed)).get_state()
        states.append(emcee.State(coords, rows[:, 0], rows[:, 1:], random))
    if gradients:
        record["hamiltonian"] = tune_hamiltonian(journal, trial.law, states)
        record["share"] = BESIDE if count > 1 else 0.0  # for jumps between groups
    solves = journal.solves
    return Recipe(
        make_moves(record),
        states,
        -(-solves // len(streams)),
        write_sentence(record, populations is not None, solves),
        record,
    )


def tune_hamiltonian(
    journal: Journal, law: Mixture, states: list[emcee.State]
) -> list[Any]:
    """Return metric, number of steps and step size of Hamiltonian moves."""
    own = uncover(law)
    metric = np.einsum("k,kij->ij", own.weights, own.matrices)
    draws = np.concatenate([state.coords for state in states])
    some = draws[:: -(-len(draws) // TUNED)]
    move = HamiltonianMove.tuned(journal, some, metric, seed=0)
    return [metric.tolist(), move.steps, move.step_size]


def is_better(other: Trial, trial: Trial) -> bool:
    """Return whether a proposal finds more of the posterior, or fits it better."""
    if not (trial.share and other.share):  # one never met the posterior
        return other.share > trial.share
    gain = other.log_evidence - trial.log_evidence
    return gain > MISSED or (gain > -MISSED and other.share > trial.share)


def anneal_each(journal: Journal, search: Search) -> list[tuple[Floats, Floats]]:
    """Return an annealed population, and its rows, of each ensemble."""
    fewest = fewest_members(len(search.prior.names))
    size = max(fewest, POPULATION // len(search.streams))
    found = [
        anneal_population(journal, search.prior, rng, size) for rng in search.streams
    ]
    return [(one.theta, one.rows) for one in found]


def fit_population(theta: Floats) -> Mixture:
    """Return a mixture fitted to draws of equal weight."""
    return Mixture(*fit_mixture(theta, "auto", POPULATION_DF), POPULATION_DF)


def choose_starts(
    rng: np.random.Generator,
    trial: Trial,
    number: int,
    ensembles: int,
    group_of: NDArray[np.intp],
    found: NDArray[np.bool_],
    nwalkers: int,
) -> NDArray[np.intp]:
    """Return which draws an ensemble's walkers start from, by importance weights.

    They are its own, in the groups that it found, as far as there are any.
    """
    own = np.array_split(np.arange(len(trial.theta)), ensembles)[number]
    if not np.isfinite(trial.log_weights[own]).any():
        own = np.arange(len(trial.theta))
    log_weights = trial.log_weights[own]
    inside = found[label(trial.theta[own], trial.law, group_of)]
    if np.isfinite(log_weights[inside]).any():
        log_weights = np.where(inside, log_weights, -np.inf)
    weights = np.exp(log_weights - log_weights.max())
    edges = np.cumsum(weights) / weights.sum()
    places = (np.arange(nwalkers) + rng.random(nwalkers)) / nwalkers  # stratified
    chosen = np.minimum(np.searchsorted(edges, places, side="right"), len(own) - 1)
    return rng.permutation(own[chosen])
