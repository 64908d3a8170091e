"""The verdict on chains: what speaks against them, and what would help.

This module lies below :func:`.run`, which may end by the verdict.
"""

from collections.abc import Iterator
from typing import TypeAlias

import numpy as np

from ..search.importance import GOOD_K, are_reliable
from ..search.settings import SETTINGS
from .diagnosis import CONVERGED, MIXED, NOT_CONVERGED, Diagnosis, Statement
from .statistics import FALSE_ALARM, TAU_KNOWN_TO, MaximaWeights

# Steps per autocorrelation time below which tau itself is unreliable. (emcee centres
# each walker on its own mean, so an estimate is .7 of tau on average. The largest of
# four ensembles of ten walkers is .84 of it, and .96 with five parameters. At 50 tau,
# which emcee asks of a chain, these are .83, .96 and 1.1. ESS does not depend on it.)
STEPS_PER_TAU = 25
GOOD_RHAT = 1.01  # Vehtari et al. (2021), doi:10.1214/20-BA1221
# R-hat over walkers is about sqrt(1 + 2 tau / steps): 1.02 at 50 tau, and 1.03 in the
# worst of four ensembles and five parameters. A larger one means that walkers stay
# apart, which tau cannot see. The limit grows for shorter chains as R-hat does: it is
# 1.1 at 25 tau, where the worst is 1.06, and above 1.08 in one of twenty runs.
WALKERS_APART = 1.05
SD_KNOWN_TO = SETTINGS.sd_known_to  # relative standard error of an sd
ERRORS_APART = 4.0  # between two estimates of a weight
SMALL_WEIGHT = 0.005  # a weight, or a difference of two, that does not matter
ENOUGH_VISITS = 20  # accepted frozen proposals of a walker while it stays at a maximum
# Standard error of a mean in sds, including waits at places of poor acceptance: as
# small as that of an sd at the end of a run.
MEAN_KNOWN_TO = SETTINGS.sd_at_end
WEIGHT_KNOWN_TO = MEAN_KNOWN_TO / ERRORS_APART  # standard error of a weight
TOO_SHORT = "too short"
BEGINS_ELSEWHERE = "the chain begins elsewhere"
MUCH = 4.0  # times longer, if no number says how much
MUCH_TOO_SHORT = 1_000.0  # times longer; for more, the verdict says at least so much
MOST_LONGER = 10.0  # times longer, above which a longer chain is not the remedy
# The complaint in a few words, in a sentence, and the factor of length that would
# remove it; 0 if no longer chain would, and the sentence names the remedy.
Complaint: TypeAlias = tuple[str, str, float]


def judge_chains(diagnosis: Diagnosis, starts_given: bool) -> Statement:
    """Say whether the chains converged; if not, name the first reason and a remedy."""
    if complaints := list(_complaints(diagnosis)):
        short, sentence, longer = complaints[0]
        if longer:
            longer = min(max(factor for *_, factor in complaints), MUCH_TOO_SHORT)
            # What says how much longer is an estimate itself.
            steps = diagnosis.discard + TAU_KNOWN_TO * longer * diagnosis.steps
            unit = 10 ** max(int(np.log10(steps)) - 1, 0)  # two digits, and zeros
            needed = unit * int(np.ceil(steps / unit))
            sentence += f"; {diagnosis.cures.steps.format(needed)}"
            sentence += " at least" if longer == MUCH_TOO_SHORT else ""
        sentence = f"{NOT_CONVERGED}, {short}: {sentence}."
        reasons = tuple(reason for reason, *_ in complaints)
        return Statement(NOT_CONVERGED, short, sentence, reasons)
    count, status, short = len(diagnosis.tau), CONVERGED, CONVERGED
    most = diagnosis.rhat_between.max()
    words = f"{status}: {count} ensembles agree (R-hat at most {most:.3f})"
    if starts_given or count == 1:
        status, short = MIXED, "starts given" if count > 1 else "one ensemble"
        cure = "leave starts out" if count > 1 else diagnosis.cures.ensembles
        words = f"{status}, but other maxima would not be seen ({short}): {cure}"
    sentence = (
        f"{words}; {diagnosis.steps_per_tau.min():.0f} autocorrelation times, ESS at "
        f"least {diagnosis.ess_bulk.min():,.0f}."
    )
    return Statement(status, short, sentence)


def _complaints(diagnosis: Diagnosis) -> Iterator[Complaint]:
    """Yield what speaks against the chains, the plainest complaint first."""
    names, stuck, maxima = diagnosis.names, diagnosis.stuck, diagnosis.maxima
    places = f"(ensemble, walker): {list(stuck[:5])}"
    sentence = f"they never moved, {places}; {diagnosis.cures.stuck}"
    complaint = f"{len(stuck)} walkers stuck", sentence, 0.0
    moving = diagnosis.acceptance[diagnosis.acceptance > 0]
    # The expected number of walkers that have not moved after as many steps by chance.
    by_chance = ((1 - moving) ** diagnosis.steps).sum()
    if stuck and by_chance < FALSE_ALARM:
        yield complaint
    if drift := diagnosis.drift:
        over = drift < diagnosis.steps
        sentence = (
            f"its first {drift} steps differ from those after; "
            f"discard={diagnosis.discard + drift}"
            if over
            else "its second half still drifts"
        )
        yield BEGINS_ELSEWHERE, sentence, 0.0 if over else MUCH
    within, between = diagnosis.rhat_within, diagnosis.rhat_between
    fewer = np.fmax(1.0, 2 * STEPS_PER_TAU / diagnosis.steps_per_tau)
    apart = np.sqrt(1 + (WALKERS_APART**2 - 1) * fewer)
    # Of each criterion: its values, the best possible value, and the limit. The ratio
    # of the distance from the best to the allowed distance, to this power, is the
    # factor by which the chain must be longer.
    for values, best, limit, power, short, what in (
        (diagnosis.steps_per_tau, 0, STEPS_PER_TAU, -1, TOO_SHORT, "steps/tau"),
        (within, 1, apart, 1, "walkers stay apart", "R-hat over walkers"),
        (diagnosis.sd_error, 0, SD_KNOWN_TO, 2, "sd unknown", "relative error of sd"),
        (between, 1, GOOD_RHAT, 1, "ensembles disagree", "R-hat over ensembles"),
        (diagnosis.scatter, 0, 1, 1, "ensembles disagree", "chi-square by its limit"),
    ):
        excess = ((values - best) / (limit - best)) ** power
        worst = int(np.argmax(excess))
        longer = float(excess[worst])
        if longer > 1:  # never for NaN
            limit = np.broadcast_to(limit, values.shape)[worst]
            bound = f"at {'least' if power < 0 else 'most'} {limit:.4g}"
            sentence = f"{what} of {names[worst]} is {values[worst]:.4g} ({bound})"
            if best and longer > MOST_LONGER:
                cure = "take a TemperedMove" if maxima else diagnosis.cures.search
                sentence, longer = f"{sentence}, as between maxima; {cure}", 0.0
            yield short, sentence, longer
    if stuck and by_chance >= FALSE_ALARM:
        yield complaint
    if maxima is not None:
        yield from _weights(maxima, diagnosis.acceptance.shape[1])
        yield from _proposal(maxima, diagnosis.steps)


def _weights(maxima: MaximaWeights, walkers: int) -> Iterator[Complaint]:
    """Yield maxima that are lost, or whose weight is wrong or not known."""
    chain, exact, error = maxima.weights.mean(axis=0), maxima.importance, maxima.errors
    best, apart = np.fmin(error, maxima.importance_errors), np.abs(chain - exact)
    both = np.hypot(error, maxima.importance_errors)
    differ = apart > np.maximum(SMALL_WEIGHT, ERRORS_APART * both)  # never for NaN
    for i, lost in enumerate((chain == 0) & maxima.reached & ~(exact < SMALL_WEIGHT)):
        stated = f"{exact[i]:.3f} (+- {maxima.importance_errors[i]:.3f})"
        sentence = (
            f"maximum {i + 1}, where a search ended or a walker started, holds "
            f"{chain[i]:.3f} (+- {error[i]:.3f}) of the chain, by importance sampling "
            f"{'what is not known' if np.isnan(exact[i]) else stated}"
        )
        if lost:
            yield "a maximum is lost", f"{sentence}; run nwalkers={2 * walkers}", 0.0
        elif differ[i] or best[i] > WEIGHT_KNOWN_TO:
            longer = max(MUCH * differ[i], (best[i] / WEIGHT_KNOWN_TO) ** 2)
            yield f"weights {'disagree' if differ[i] else 'unknown'}", sentence, longer


def _proposal(maxima: MaximaWeights, steps: int) -> Iterator[Complaint]:
    """Yield what is wrong with the frozen proposal, if steps are made with it."""
    several, made = len(maxima.importance) > 1, maxima.share * steps
    k = float(np.fmax(maxima.pareto_k, maxima.chain_k))
    # Weights of maxima are compared with those of the search, unless k is large.
    if several and not are_reliable(k, maxima.efficiency):
        yield "proposal too narrow", f"Pareto k is {k:.2f} (at most {GOOD_K})", MUCH
    left = float(np.nanmin(maxima.acceptance)) * made
    if several and made and left < ENOUGH_VISITS:
        sentence = (
            f"in {steps} steps a walker leaves the worst maximum {left:.1f} times (at "
            f"least {ENOUGH_VISITS})"
        )
        longer = min(ENOUGH_VISITS / left, MOST_LONGER) if left else MOST_LONGER
        yield "proposal too narrow", sentence, longer
    error = float(maxima.mean_error.max())
    if error > MEAN_KNOWN_TO:  # never for NaN
        sentence = (
            f"waits of walkers make the error of a mean {error:.3f} sd (at most "
            f"{MEAN_KNOWN_TO})"
        )
        yield "proposal too narrow", sentence, (error / MEAN_KNOWN_TO) ** 2
