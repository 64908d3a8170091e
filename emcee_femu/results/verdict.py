"""Statements on a run: whether its chains converged, and what was searched."""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from ..sampling.importance import FAIR_SHARE, GOOD_K
from ..sampling.record import Chains
from .arviz_objects import dataset
from .modes import ModeWeights

if TYPE_CHECKING:
    from .diagnose import Diagnosis

ENOUGH_TAU = 50  # steps per autocorrelation time below which tau itself is unreliable
GOOD_RHAT = 1.01  # Vehtari et al. (2021), doi:10.1214/20-BA1221
# R-hat over walkers is about sqrt(1 + 2 tau / steps), 1.02 at 50 tau. More means
# walkers that stay apart, which tau cannot see: it centres each walker on its own mean.
WALKERS_APART = 1.05
SD_KNOWN_TO = 0.1  # relative standard error of a standard deviation
ERRORS_APART = 4.0  # between two estimates of a weight
SMALL = 0.005  # a weight, or a difference of two, that does not matter
WEIGHT_KNOWN_TO = 0.0125  # standard error of a weight: four of them are 0.05
ENOUGH_VISITS = 20  # accepted frozen proposals of a walker while it stays in a mode
ENOUGH_WAITS = 10  # the same from the worst places, a thousandth of the chain
HITS = 3  # expected, of which none comes once in twenty times
STUCK_BY_CHANCE = 0.05  # walkers that may not have moved yet in a short chain
CONVERGED, MIXED, NOT_CONVERGED = "converged", "well mixed", "not converged"
NO_CHAINS = "none"
TOO_SHORT = "too short"
SEARCHED, NOT_SEARCHED = "searched", "not searched"
MARGIN = 1.25  # since tau and errors are estimates themselves
MUCH = 4.0  # times longer, where no number says how much
MOST = 10.0  # times longer, above which it is not length that lacks

# In a few words, in a sentence, and how many times longer a chain would mend it; 0
# where none would, and the sentence says what does.
Complaint: TypeAlias = tuple[str, str, float]


@dataclass(frozen=True)
class Statement:
    """One of the three statements of a diagnosis.

    Attributes:
        status: A word or two that never vary, such as "converged".
        short: The status in a few words, with its reason.
        sentence: The same at length, and what to do.
        reasons: All that speaks against chains, in a word or two each.
    """

    status: str
    short: str
    sentence: str
    reasons: tuple[str, ...] = ()


def judge_chains(diagnosis: "Diagnosis", starts_given: bool, discard: int) -> Statement:
    """Say whether the chains converged; if not, what speaks first and what mends it."""
    if complaints := list(_complaints(diagnosis)):
        short, sentence, longer = complaints[0]
        if longer:
            longer = max(factor for *_, factor in complaints)
            steps = discard + MARGIN * longer * diagnosis.steps
            unit = 10 ** max(int(np.log10(steps)) - 1, 0)  # two digits, and zeros
            sentence += f"; run steps={unit * int(np.ceil(steps / unit)):,}"
        sentence = f"{NOT_CONVERGED}, {short}: {sentence}."
        reasons = tuple(reason for reason, *_ in complaints)
        return Statement(NOT_CONVERGED, short, sentence, reasons)
    count, status, short = len(diagnosis.tau), CONVERGED, CONVERGED
    words = f"{status}: {count} ensembles agree"
    if count > 1:
        words += f" (R-hat at most {diagnosis.rhat_between.max():.3f})"
    if starts_given or count == 1:
        status, short = MIXED, "starts given" if count > 1 else "one ensemble"
        cure = "leave starts out" if count > 1 else "run ensembles=4"
        words = f"{status}, but other modes would not be seen ({short}): {cure}"
    sentence = (
        f"{words}; {diagnosis.steps_per_tau.min():.0f} autocorrelation times, ESS at "
        f"least {diagnosis.ess_bulk.min():,.0f}."
    )
    return Statement(status, short, sentence)


def judge_search(modes: ModeWeights | None) -> Statement:
    """Say what a search found, and how small a maximum it may have missed."""
    if modes is None:
        sentence = "none: a maximum that no walker started near is not seen; "
        sentence += 'run(posterior, "auto") searches.'
        return Statement(NOT_SEARCHED, "none", sentence)
    count = len(modes.importance)
    short = "one maximum" if count == 1 else f"{count} maxima"
    sentence = (
        f"{short}, by {modes.searched:,} points. A maximum so small that fewer than "
        f"one point in {modes.searched // HITS:,} falls near it may be missing."
    )
    return Statement(SEARCHED, short, sentence)


def judge_without_chains(source: Any, chains: Chains) -> tuple[Statement, Statement]:
    """Say by what draws are judged that are no chains, and what a search found."""
    if chains.kind == "population":
        words = "an annealed population; anneal with other seeds and compare"
        found = (
            f"{chains.origin}. A maximum so small that fewer than one draw of the "
            f"prior in {len(chains.draws) // HITS:,} falls near it may be missing."
        )
        search = Statement(SEARCHED, SEARCHED, found)
    else:
        certificate = dataset(source, "certificate").attrs
        words = f"draws weighted by full solves. {certificate['verdict']}"
        search = Statement(**json.loads(certificate["search"]))
    return Statement(NO_CHAINS, NO_CHAINS, f"{NO_CHAINS}, but {words}"), search


def _complaints(diagnosis: "Diagnosis") -> Iterator[Complaint]:
    """Yield what speaks against the chains, the plainest first."""
    names, stuck, modes = diagnosis.names, diagnosis.stuck, diagnosis.modes
    places = f"(ensemble, walker): {list(stuck[:5])}"
    sentence = f"they never moved, {places}; look at starts and at failed solves"
    complaint = f"{len(stuck)} walkers stuck", sentence, 0.0
    moving = diagnosis.acceptance[diagnosis.acceptance > 0]
    # So many of the others would be still there by chance after as many steps.
    by_chance = ((1 - moving) ** diagnosis.steps).sum()
    if stuck and by_chance < STUCK_BY_CHANCE:
        yield complaint
    within, between = diagnosis.rhat_within, diagnosis.rhat_between
    # Values, their best, their limit, and by which power of them a chain is too short.
    for values, best, limit, power, short, what in (
        (diagnosis.steps_per_tau, 0, ENOUGH_TAU, -1, TOO_SHORT, "steps/tau"),
        (within, 1, WALKERS_APART, 1, "walkers stay apart", "R-hat over walkers"),
        (diagnosis.sd_error, 0, SD_KNOWN_TO, 2, "sd unknown", "relative error of sd"),
        (between, 1, GOOD_RHAT, 1, "ensembles disagree", "R-hat over ensembles"),
        (diagnosis.scatter, 0, 1, 1, "ensembles disagree", "chi-square by its limit"),
    ):
        excess = ((values - best) / (limit - best)) ** power
        worst = int(np.argmax(excess))
        longer = float(excess[worst])
        if longer > 1:  # never for NaN
            bound = f"at {'least' if power < 0 else 'most'} {limit}"
            sentence = f"{what} of {names[worst]} is {values[worst]:.4g} ({bound})"
            if best and longer > MOST:
                cure = "take a TemperedMove" if modes else 'run moves="auto"'
                sentence, longer = f"{sentence}, as between modes; {cure}", 0.0
            yield short, sentence, longer
    if stuck and by_chance >= STUCK_BY_CHANCE:
        yield complaint
    if modes is not None:
        yield from _weights(modes, diagnosis.acceptance.shape[1])
        yield from _proposal(modes, diagnosis.steps)


def _weights(modes: ModeWeights, walkers: int) -> Iterator[Complaint]:
    """Yield modes that are lost, weigh otherwise than they should, or are not known."""
    chain, exact, error = modes.weights.mean(axis=0), modes.importance, modes.errors
    best, apart = np.fmin(error, modes.importance_errors), np.abs(chain - exact)
    both = np.hypot(error, modes.importance_errors)
    differ = apart > np.maximum(SMALL, ERRORS_APART * both)  # never for NaN
    for i, lost in enumerate((chain == 0) & modes.reached & ~(exact < SMALL)):
        stated = f"{exact[i]:.3f} (+- {modes.importance_errors[i]:.3f})"
        sentence = (
            f"mode {i + 1}, where a search ended or a walker started, holds "
            f"{chain[i]:.3f} (+- {error[i]:.3f}) of the chain, by importance sampling "
            f"{'what is not known' if np.isnan(exact[i]) else stated}"
        )
        if lost:
            yield "a mode is lost", f"{sentence}; run nwalkers={2 * walkers}", 0.0
        elif differ[i] or best[i] > WEIGHT_KNOWN_TO:
            longer = max(MUCH * differ[i], (best[i] / WEIGHT_KNOWN_TO) ** 2)
            yield f"weights {'disagree' if differ[i] else 'unknown'}", sentence, longer


def _proposal(modes: ModeWeights, steps: int) -> Iterator[Complaint]:
    """Yield what is wrong with the frozen proposal, if steps are made with it."""
    several, made = len(modes.importance) > 1, modes.share * steps
    k = float(np.fmax(modes.pareto_k, modes.chain_k))
    # Weights that are nearly equal have a tail too, but not one that matters.
    narrow = k > GOOD_K and not modes.efficiency > FAIR_SHARE and (several or made)
    worst, done = np.nanmin(modes.acceptance) * made, modes.slowest * made
    visits = worst / ENOUGH_VISITS if several and made else 1.0
    waits = done / ENOUGH_WAITS if modes.share > 0.5 else 1.0
    if narrow or min(visits, waits) < 1:
        sentence = (
            f"Pareto k is {k:.2f} (at most {GOOD_K}), and in {steps} steps a walker "
            f"leaves the worst mode {worst:.1f} times (at least {ENOUGH_VISITS}), "
            f"the worst places {done:.1f} times (at least {ENOUGH_WAITS})"
        )
        longer = MUCH if narrow else 1 / max(float(min(visits, waits)), 0.1)
        yield "proposal too narrow", sentence, longer
