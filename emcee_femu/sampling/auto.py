"""``run(..., moves="auto")``: search, refine a proposal, freeze it, start from it."""

from collections.abc import Sequence

import emcee
import numpy as np
from numpy.typing import NDArray
from scipy.special import softmax

from ..contracts import Floats
from ..evaluation.evaluator import Evaluation
from ..moves import HamiltonianMove
from ..moves.mixture import Mixture
from .anneal import anneal_population, fewest_members
from .coordinates import Coordinates
from .importance import find_acceptance, resample
from .proposals import Component, Trial, carry, extend, refine, uncover
from .record import Annealed, SearchRecord, label, separate, weigh
from .response_surface import LEARNED, ResponseSurface, learn_surface
from .search import Search, follow_modes
from .tails import climb_tails

# Evaluations by those of the chain; of a short one.
CHAIN_BUDGET, LEAST_BUDGET = 2.0, 30_000
SEARCHED_SHARE = 0.2  # of the evaluations of the chain
# Points of a search; beyond, a long run only pays for them. (38,400 of them took a
# quarter of 250,000 solves for one mode; with 5,000 instead of 8,000 two of seven bent
# ridges of ten storeys did not converge.) A bare density has as many as its chain up to
# then, for climbs by its differences are dear. (2,000 points found a needle in d = 4 in
# 4 of 10 searches, 10,000 in 9.)
FEWEST_SEARCHED, MOST_SEARCHED = 1_000, 10_000
# Draws of a round of the refinement, at least, and by evaluations of the chain. (Five
# stiffnesses, 192,000 evaluations: 960 instead of 300 raise the acceptance from .7 to
# .83, which is worth 25,000 evaluations, and cost 4,000.)
ROUND, ROUND_SHARE = 300, 0.005
TRIED = 800  # draws by which a proposal is judged, at least
LAST_ROUND = 6  # times a round's draws, that the last round of a refinement may have
REFINED = 1_500  # draws for a refinement, or half as many as the chain has
BENT = 0.5  # effective share of a mixture below which polynomials may do better
MOST_QUADRATIC = 30  # parameters of which there are quadratic ones
# Factor of the weights of components for tails and carriers where a mixture is that
# poor: polynomials are learned from draws of it, which must reach the ends of a ridge.
# (Of 14 buildings of ten storeys 13 converged; without it 10.)
WEIGHED_WHERE_BENT = 2.0
SCREENED, MOST_SCREENED = 10, 100  # proposals that polynomials accept, and see
POPULATION, POPULATION_DF = 1_000, 5.0  # members of all ensembles
POOR_ACCEPTANCE = 0.2  # acceptance below which gradients do better
# Draws from which Hamiltonian moves are tuned, and the most solves, which a budget of
# twice as many affords.
TUNED, TUNING = 24, 14_000
# Part of a budget up to which the search may climb, however small the budget is.
CLIMBED_AT_LEAST = 1 / 3
TAIL_ROUNDS = 2  # of climbs in the tails
# Slabs of a tail for which there are as many draws, of these alone, as half a round of
# the refinement has.
SLABS_PER_ROUND = 4
# That each may spend, of those of a refinement, and twice what they are by default.
TAIL_SOLVES, MOST_TAIL_SOLVES = 0.6, 6_000
EVIDENCE_MISSED = 1.0  # log evidence by which one proposal finds more than another
# Share of independence proposals by their expected acceptance.
INDEPENDENCE_SHARES = ((0.2, 0.9), (0.05, 0.6), (0.0, 0.2))
# With polynomials, which are wrong in places: a walker that waits there leaves by the
# other moves. (H structure, beta 500, 200 steps, 5 seeds: at most 77 instead of 139.)
SCREENED_SHARE = 0.8
SHARE_BESIDE_HAMILTONIAN = 0.1  # the same beside Hamiltonian moves
KEPT_WEIGHTS = 2_000  # importance weights in the record


def budget_of(evaluations: int) -> int:
    """Return the most that a search may spend before a chain of so many evaluations."""
    return max(LEAST_BUDGET, round(CHAIN_BUDGET * evaluations))


def search_and_start(
    evaluator: Evaluation,
    nwalkers: int,
    ensembles: int,
    seed: int,
    evaluations: int,
    budget: int,
    starts: Sequence[Floats] | None,
) -> tuple[SearchRecord, list[emcee.State]]:
    """Search for the modes, refine a proposal, and draw the starts from it.

    The modes that any ensemble found are components of one proposal, from which each
    ensemble draws with its own stream. Its walkers start from its own draws, by their
    importance weights, in those modes that it found itself: it is the chain that has
    to bring the ensembles to agree. Where a proposal hardly meets the posterior, each
    starts from an annealed population, at the power that the budget lets it reach.

    Args:
        evaluator: What evaluates, and stores where there is a file.
        nwalkers: Walkers per ensemble.
        ensembles: How many there are.
        seed: Of the run.
        evaluations: Those of the chain.
        budget: Solves that the search may take.
        starts: Points ``(n, d)`` of each ensemble that are searched too.

    Returns:
        What was found, and the evaluated start of each ensemble with its random
        stream.
    """
    posterior = evaluator.posterior
    seeds = np.random.SeedSequence(seed).spawn(ensembles)
    streams = [np.random.default_rng(child.spawn(1)[0]) for child in seeds]
    most = max(REFINED, evaluations // 2)
    size = max(ROUND, 10 * posterior.ndim, round(ROUND_SHARE * evaluations))
    judged = max(TRIED, 2 * size, min(4 * nwalkers * ensembles, budget // 8))
    attempt = most + LAST_ROUND * size + judged
    tunable = posterior.differentiable and budget >= 2 * TUNING
    reserve = attempt + LEARNED * posterior.normal + TUNING * tunable
    search = Search(evaluator, streams)
    searched = max(FEWEST_SEARCHED, round(SEARCHED_SHARE * evaluations))
    searched = min(searched, MOST_SEARCHED)
    if not (posterior.differentiable or any(term.observed for term in posterior.terms)):
        searched = max(searched, min(MOST_SEARCHED, evaluations, budget - reserve))
    search.run(searched, starts, max(budget - reserve, CLIMBED_AT_LEAST * budget))
    trial, surface, populations, gradients = _find_proposal(
        search, most, size, judged, budget - attempt, tunable
    )
    mode_of = separate(trial.mixture)
    count = int(mode_of.max()) + 1
    tops = np.array([maximum.theta for maximum in search.maxima])
    found_by = np.zeros((ensembles, count), dtype=np.intp)
    np.add.at(found_by.T, label(tops, trial.mixture, mode_of), search.found_by)
    labels = label(trial.theta, trial.mixture, mode_of)
    states, shares = [], []
    for ensemble, rng in enumerate(streams):
        if trial.narrow and populations:
            theta, rows = populations[ensemble].theta, populations[ensemble].rows
            chosen = rng.choice(len(theta), nwalkers, replace=nwalkers > len(theta))
        else:
            theta, rows = trial.theta, trial.rows
            part = np.array_split(np.arange(len(theta)), ensembles)[ensemble]
            in_its_modes = found_by[ensemble, labels] > 0
            chosen = _choose_draws(rng, trial.log_weights, part, in_its_modes, nwalkers)
        theta, rows = theta[chosen], rows[chosen]
        stream = np.random.MT19937(seeds[ensemble])
        random = np.random.RandomState(stream).get_state()
        states.append(emcee.State(theta, rows[:, 0], rows[:, 1:], random))
        modes = label(theta, trial.mixture, mode_of)
        shares.append(np.bincount(modes, minlength=count) / nwalkers)
    share = next(s for least, s in INDEPENDENCE_SHARES if trial.acceptance >= least)
    trajectories, screened = None, 1
    if surface is not None:
        log_c = surface(trial.theta)
        accepted = find_acceptance(log_c, trial.log_q, trial.log_q)
        screened = min(int(np.ceil(SCREENED / accepted)), MOST_SCREENED)
        share = SCREENED_SHARE
    if gradients:
        draws = np.concatenate([state.coords for state in states])
        trajectories = _tune_trajectories(evaluator, trial.mixture, draws)
        # For jumps between modes.
        share = SHARE_BESIDE_HAMILTONIAN if count > 1 else 0.0
    weights, errors = weigh(labels, trial.log_weights, count)
    height = np.where(labels[:, None] == np.arange(count), trial.rows[:, :1], -np.inf)
    met = np.isfinite(height.max(axis=0))
    highest = trial.theta[height.argmax(axis=0)]
    followed = {
        experiment: np.where(met[:, None], numbers, 0)
        for experiment, numbers in follow_modes(posterior, highest).items()
    }
    record = SearchRecord(
        mixture=trial.mixture,
        mode_of=mode_of,
        weights=weights,
        errors=errors,
        found_by=found_by,
        starts=np.array(shares),
        pareto_k=trial.pareto_k,
        efficiency=trial.efficiency,
        log_weights=trial.log_weights[:: -(-len(trial.log_weights) // KEPT_WEIGHTS)],
        points=len(search.theta),
        climbs=search.climbs,
        from_prior=search.from_prior,
        annealed=bool(populations),
        solves=evaluator.solves + len(followed) * (count + 2),
        share=share,
        trajectories=trajectories,
        screened=screened,
        surface=None if surface is None else surface.arguments,
        followed=followed,
        kurtosis=search.draws.kurtosis(),
    )
    return record, states


def _find_proposal(
    search: Search, most: int, size: int, judged: int, last: int, tunable: bool
) -> tuple[Trial, ResponseSurface | None, list[Annealed], bool]:
    """Return a proposal, what screens it, annealed populations, and what does better.

    The last is whether gradients do.

    Args:
        search: What was found.
        most: Draws after which no round of the refinement begins.
        size: Draws of a round, at least.
        judged: Draws by which it is judged.
        last: Solves after which there is no second attempt.
        tunable: Whether gradients may be tried.
    """
    evaluator, streams = search.evaluator, search.streams

    def propose(mixture: Mixture, number: int) -> tuple[Floats, Floats]:
        each = -(-number // len(streams))
        theta = np.concatenate([mixture.draw(rng, each) for rng in streams])
        return theta, evaluator.rows(theta)

    added: list[Component] = []  # for tails, which no refinement keeps
    fits: list[float] = []  # effective shares of mixtures without these
    posterior = evaluator.posterior
    polynomial = posterior.normal and posterior.ndim <= MOST_QUADRATIC

    def attempt(mixture: Mixture) -> Trial:
        draws = search.draws
        refined = refine(draws, mixture, size, most, propose)
        fits.append(draws.effective_share(refined))
        heavy = WEIGHED_WHERE_BENT if polynomial and fits[0] < BENT else 1.0
        new = [*added]
        for number in range(TAIL_ROUNDS + 1):
            if new:
                drawn = size * max(1, len(new) // SLABS_PER_ROUND) // 2
                refined = extend(draws, refined, new, drawn, propose)
            if number == TAIL_ROUNDS or (number and not new):
                break
            # The refinement, for which "last" leaves room, is over.
            spent = evaluator.solves + min(TAIL_SOLVES * most, MOST_TAIL_SOLVES)
            tails = climb_tails(evaluator, draws, min(last + most, spent))
            new = [(heavy * share, at, matrix) for share, at, matrix in tails]
            added.extend(new)
        refined = carry(draws, refined, size, propose, heavy)
        return Trial(refined, *propose(refined, judged))

    trial = attempt(search.mixture())
    learned = None
    if (
        trial.acceptance > 0
        and fits[0] < BENT
        and evaluator.solves + LEARNED <= last
        and polynomial
    ):
        learned = learn_surface(evaluator, trial.mixture, streams[0])
    if learned is not None:
        surface, mixture = learned
        second = Trial(mixture, *propose(mixture, judged))
        log_p, log_c = second.rows[:, 0], surface(second.theta)
        accepted = find_acceptance(log_p, log_c, second.log_q)
        if accepted > max(trial.acceptance, POOR_ACCEPTANCE):
            return second, surface, [], False
        trial = second if is_better(second, trial) else trial
    populations: list[Annealed] = []
    gradients = tunable and trial.acceptance < POOR_ACCEPTANCE
    if trial.narrow and not (gradients and trial.efficiency):
        affordable, again = evaluator.solves < last, uncover(trial.mixture)
        # Where the shapes of the modes say too little, or never met the posterior.
        poor = trial.acceptance < POOR_ACCEPTANCE
        if poor and affordable or not trial.efficiency:
            populations = _anneal_each(search, last)
        if affordable:
            if populations:
                members = np.concatenate([each.theta for each in populations])
                again = Mixture.fit(members, "auto", POPULATION_DF)
            second = attempt(again)
            trial = second if is_better(second, trial) else trial
    return trial, None, populations, gradients


def is_better(second: Trial, first: Trial) -> bool:
    """Return whether a proposal finds more of the posterior, or fits it better."""
    if not (first.efficiency and second.efficiency):  # one never met the posterior
        return second.efficiency > first.efficiency
    gain = second.log_evidence - first.log_evidence
    better = second.efficiency > first.efficiency
    return gain > EVIDENCE_MISSED or (gain > -EVIDENCE_MISSED and better)


def _tune_trajectories(
    evaluator: Evaluation, mixture: Mixture, draws: Floats
) -> dict[str, object]:
    """Return the arguments of Hamiltonian moves."""
    narrow = uncover(mixture)
    metric = np.einsum("k,kij->ij", narrow.weights, narrow.matrices)
    some = draws[:: -(-len(draws) // TUNED)]
    move = HamiltonianMove.tuned(evaluator, some, metric, seed=0)
    return {"metric": metric, "steps": move.steps, "step_size": move.step_size}


def _anneal_each(search: Search, last: int) -> list[Annealed]:
    """Return an annealed population of each ensemble."""
    evaluator, number = search.evaluator, len(search.streams)
    posterior = evaluator.posterior
    size = max(fewest_members(posterior.ndim), POPULATION // number)
    plain = Coordinates.plain(posterior.prior)
    most = (last - evaluator.solves) / number
    return [
        anneal_population(evaluator, plain, rng, size, most=most)
        for rng in search.streams
    ]


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
    drawn = resample(softmax(eligible), nwalkers, rng.random(nwalkers))  # stratified
    return rng.permutation(part[drawn])
