"""``run(..., moves="auto")``: a campaign of stages, then the starts of a chain."""

from collections.abc import Sequence

import emcee
import numpy as np
from numpy.typing import NDArray
from scipy.special import softmax

from ..contracts import Floats
from ..evaluation.ensemble import start_state
from ..evaluation.evaluator import Evaluation
from ..moves import HamiltonianMove
from ..moves.hamiltonian import MOST_LEAPS, RECORDED, TUNING_ROUNDS
from ..moves.mixture import PER_PARAMETER
from ..posterior.followed_modes import follow_modes
from .adapt import REFINING_ROUNDS, adapt, carry, judge
from .anneal import anneal_population, fewest_members
from .campaign import Campaign, Sizes, Stage
from .coordinates import Coordinates
from .explore import explore
from .importance import find_acceptance, resample
from .ledger import Kept, Ledger
from .proposal import assign
from .record import BEST_SHARE, SearchRecord, weigh
from .response_surface import SURFACE_COST, learn_surface
from .settings import SETTINGS
from .tails import follow_tails

# Fewest draws of a round of the refinement, and their ratio to the evaluations of the
# chain, which counts if it gives more.
# (Five stiffnesses, 192,000 evaluations: 960 instead of 300 raise the acceptance from
# .7 to .83, which is worth 25,000 evaluations, and cost 4,000.)
ROUND = 300
ROUND_SHARE = 0.005
# Proposals that a surface accepts before one is solved, and the most that it looks at.
SCREENED = 10
MOST_SCREENED = 100
# Members of the populations of all ensembles.
POPULATION = 1_000
# Draws from which Hamiltonian moves are tuned.
TUNING_DRAWS = 24
# Most solves that this takes, beside one for each draw. Moves are only tuned if the
# budget is at least twice as many.
TUNING = TUNING_DRAWS * (TUNING_ROUNDS + RECORDED) * MOST_LEAPS


def budget_of(evaluations: int) -> int:
    """Return the most that a search may spend before a chain of so many evaluations.

    It is twice as many, but never less than a short chain is given.
    """
    return max(SETTINGS.least_budget, 2 * evaluations)


def search_and_start(
    evaluator: Evaluation,
    nwalkers: int,
    ensembles: int,
    seed: int,
    evaluations: int,
    budget: int,
    starts: Sequence[Floats] | None,
) -> tuple[SearchRecord, list[emcee.State]]:
    """Search for the maxima, refine a proposal, and draw the starts from it.

    The maxima that any ensemble found are components of one proposal, from which each
    ensemble draws with its own stream. Its walkers start from its own draws, by their
    importance weights, at those maxima that it found itself: it is the chain that has
    to bring the ensembles to agree. Where a proposal hardly meets the posterior, each
    starts from an annealed population, at the power that the budget lets it reach.

    Args:
        evaluator: Evaluates the posterior, and stores the rows if there is a file.
        nwalkers: Walkers per ensemble.
        ensembles: How many there are.
        seed: The seed of the run.
        evaluations: Evaluations that the chain will take.
        budget: Solves that the search may take.
        starts: Points ``(n, d)`` of each ensemble that are searched too.

    Returns:
        The record of the search, and the evaluated start of each ensemble with its
        random stream.
    """
    seeds = np.random.SeedSequence(seed).spawn(ensembles)
    streams = [np.random.default_rng(child.spawn(1)[0]) for child in seeds]
    walkers = nwalkers * ensembles
    ledger, sizes = _plan(evaluator, walkers, evaluations, budget)
    campaign = Campaign(evaluator, streams, ledger, sizes, starts, SETTINGS)
    for stage in STAGES:
        with ledger.charge(stage.__name__):
            stage(campaign)
    found_by = _assign_climbs(campaign)
    drawn = [
        _draw_start(campaign, ensemble, found, nwalkers)
        for ensemble, found in enumerate(found_by)
    ]
    states = [
        start_state(theta, rows, child)
        for (theta, rows), child in zip(drawn, seeds, strict=True)
    ]
    return _record(campaign, found_by, [theta for theta, _ in drawn]), states


def _plan(
    evaluator: Evaluation,
    walkers: int,
    evaluations: int,
    budget: int,
) -> tuple[Ledger, Sizes]:
    """Return the ledger with its reserves, and the sizes of the stages."""
    posterior, settings = evaluator.posterior, SETTINGS
    batch = max(ROUND, PER_PARAMETER * posterior.ndim, round(ROUND_SHARE * evaluations))
    last = REFINING_ROUNDS // 2 * batch  # draws of the last round
    refined = max(last, evaluations // 2)
    judged = max(2 * batch, min(4 * walkers, budget // 8))
    tunable = posterior.differentiable and budget >= 2 * TUNING
    kept: dict[Kept, int] = {
        "adapt": refined,
        "judge": last + judged,
        "bend": SURFACE_COST * posterior.normal,
        "tune": TUNING * tunable,
    }
    ledger = Ledger(evaluator, budget, kept)
    most = settings.most_searched
    # At least as many as for a run that ends by its verdict.
    sized = max(settings.sized_for, evaluations)
    points = min(round(settings.searched_share * sized), most)
    if not (posterior.differentiable or any(term.observed for term in posterior.terms)):
        points = max(points, min(most, evaluations, ledger.end()))
    return ledger, Sizes(points, batch, refined, judged, evaluations)


def bend(campaign: Campaign) -> None:
    """Learn polynomials of the response where these do better than the mixture."""
    c, first = campaign, campaign.best
    end = c.ledger.end("adapt", "judge")
    affordable = c.evaluator.solves + SURFACE_COST <= end
    if not (c.bent and affordable and first.acceptance > 0):
        return
    learned = learn_surface(c.evaluator, first.proposal.law, c.streams[0])
    if learned is None:
        return
    surface, c.proposal = learned
    judge(c)
    log_c = surface(c.best.theta)
    accepted = find_acceptance(c.best.log_p, log_c, c.best.log_q)
    # A few draws are no sufficient reason to replace a fair mixture by a surface.
    poor = c.settings.poor_acceptance
    known = c.best.reliable or first.acceptance < poor
    if known and accepted > max(first.acceptance, poor):
        c.surface = surface
    elif not c.best.is_better(first):
        c.best = first


def look_for_gradients(campaign: Campaign) -> None:
    """Prefer trajectories where gradients are cheap and the proposal is poor."""
    c = campaign
    tunable = c.ledger.kept["tune"] > 0 and c.surface is None
    c.by_gradients = tunable and c.best.acceptance < c.settings.poor_acceptance


def anneal_starts(campaign: Campaign) -> None:
    """Anneal populations to start from, where the proposal hardly meets the posterior.

    This is so where the shapes of the maxima are a poor guide to the posterior, or
    where no draw of the proposal is possible.
    """
    c, best = campaign, campaign.best
    if c.surface or best.reliable or (c.by_gradients and best.efficiency):
        return
    affordable = c.evaluator.solves < c.ledger.end("adapt", "judge")
    fair = best.acceptance > c.settings.poor_acceptance
    if best.efficiency and (fair or not affordable):
        return
    number = len(c.streams)
    size = max(fewest_members(c.posterior.ndim), POPULATION // number)
    plain = Coordinates.plain(c.posterior.prior)
    most = (c.ledger.end("adapt", "judge") - c.evaluator.solves) / number
    c.populations = [
        anneal_population(c.evaluator, plain, rng, size, most=most) for rng in c.streams
    ]


# All of "auto". A tuple without a stage is an ablation.
STAGES: tuple[Stage, ...] = (
    explore,
    adapt,
    follow_tails,
    carry,
    judge,
    bend,
    look_for_gradients,
    anneal_starts,
)


def _assign_climbs(campaign: Campaign) -> NDArray[np.intp]:
    """Return each ensemble's climbs that ended at each maximum of the best proposal."""
    law, labels = campaign.best.proposal.law, campaign.best.labels
    tops = np.array([maximum.theta for maximum in campaign.maxima.found])
    count = int(labels.max()) + 1
    found_by = np.zeros((len(campaign.streams), count), dtype=np.intp)
    np.add.at(found_by.T, assign(tops, law, labels), campaign.maxima.found_by)
    return found_by


def _draw_start(
    campaign: Campaign, ensemble: int, found: NDArray[np.intp], nwalkers: int
) -> tuple[Floats, Floats]:
    """Return where the walkers of an ensemble start, and their rows.

    Args:
        campaign: The campaign after its last stage.
        ensemble: Which one.
        found: Its climbs by maximum.
        nwalkers: How many walkers it has.
    """
    best, rng = campaign.best, campaign.streams[ensemble]
    if campaign.populations and not best.reliable:
        population = campaign.populations[ensemble]
        n = len(population.theta)
        chosen = rng.choice(n, nwalkers, replace=nwalkers > n)
        return population.theta[chosen], population.rows[chosen]
    numbers = np.arange(len(best.theta))
    part = np.array_split(numbers, len(campaign.streams))[ensemble]
    found_itself = found[best.owner] > 0
    chosen = _choose_draws(rng, best.log_weights, part, found_itself, nwalkers)
    return best.theta[chosen], best.rows[chosen]


def _record(
    campaign: Campaign, found_by: NDArray[np.intp], starts: Sequence[Floats]
) -> SearchRecord:
    """Return what was found, and with which moves the chain goes on from starts."""
    c, best, count = campaign, campaign.best, found_by.shape[1]
    law, maximum_of = best.proposal.law, best.labels
    share = next(
        share
        for least, share in c.settings.independence_shares
        if best.acceptance >= least
    )
    trajectories, screened = None, 1
    if c.surface is not None:
        log_c = c.surface(best.theta)
        accepted = find_acceptance(log_c, best.log_q, best.log_q)
        screened = min(int(np.ceil(SCREENED / accepted)), MOST_SCREENED)
        share = BEST_SHARE
    if c.by_gradients:
        with c.ledger.charge("tune"):
            trajectories = _tune_trajectories(c, np.concatenate(starts))
        # For jumps between maxima.
        share = (1 - BEST_SHARE) / 2 if count > 1 else 0.0
    weights, errors = weigh(best.owner, best.log_weights, count)
    owned = best.owner[:, None] == np.arange(count)
    height = np.where(owned, best.log_p[:, None], -np.inf)
    met = np.isfinite(height.max(axis=0))
    highest = best.theta[height.argmax(axis=0)]
    followed = {
        experiment: np.where(met[:, None], numbers, 0)
        for experiment, numbers in follow_modes(c.posterior, highest).items()
    }
    walkers = [
        np.bincount(assign(theta, law, maximum_of), minlength=count) / len(theta)
        for theta in starts
    ]
    uncounted = len(followed) * (count + 2)
    return SearchRecord(
        mixture=law,
        kinds=best.proposal.law_kinds,
        maximum_of=maximum_of,
        weights=weights,
        errors=errors,
        found_by=found_by,
        starts=np.array(walkers),
        pareto_k=best.pareto_k,
        efficiency=best.efficiency,
        log_weights=best.log_weights,
        points=c.points,
        climbs=c.maxima.climbs,
        from_prior=c.maxima.from_prior,
        annealed=bool(c.populations),
        solves=c.evaluator.solves + uncounted,
        share=share,
        trajectories=trajectories,
        screened=screened,
        surface=None if c.surface is None else c.surface.arguments,
        followed=followed,
        kurtosis=c.archive.kurtosis,
        spent=c.ledger.spent | ({"follow_modes": uncounted} if followed else {}),
    )


def _tune_trajectories(campaign: Campaign, draws: Floats) -> dict[str, object]:
    """Return the arguments of Hamiltonian moves."""
    narrow = campaign.best.proposal.undefended.seen_in(None)
    metric = np.einsum("k,kij->ij", narrow.weights, narrow.matrices)
    some = draws[:: -(-len(draws) // TUNING_DRAWS)]
    move = HamiltonianMove.tuned(campaign.evaluator, some, metric, seed=0)
    return {"metric": metric, "steps": move.steps, "step_size": move.step_size}


def _choose_draws(
    rng: np.random.Generator,
    log_weights: Floats,
    part: NDArray[np.intp],
    found_itself: NDArray[np.bool_],
    nwalkers: int,
) -> NDArray[np.intp]:
    """Return which draws an ensemble's walkers start from, by importance weights.

    They are draws of its own part at maxima that it found itself. If there are none,
    any draw of its part will do; and if none of these is possible, any draw at all.
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
    if (possible & found_itself)[part].any():
        eligible = np.where(found_itself[part], eligible, -np.inf)
    drawn = resample(softmax(eligible), nwalkers, rng.random(nwalkers))  # stratified
    return rng.permutation(part[drawn])
