"""Statements on a run: whether its chains converged, and what was searched."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from ..sampling.importance import FAIR_SHARE, GOOD_K
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
ENOUGH_WAITS = 10  # the same from the worst place that a walker reached
HIGH_SHARE = 0.75  # effective share of a proposal for which no walker waits long
# Pareto k above which importance weights have no variance: below it the places where a
# walker waits long are too rare to matter.
LONG_WAITS_K = 0.5
HITS = 3  # expected, of which none comes once in twenty times
CONVERGED, MIXED, NOT_CONVERGED = "converged", "well mixed", "not converged"
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
    """

    status: str
    short: str
    sentence: str


def judge_chains(diagnosis: "Diagnosis", starts_given: bool, discard: int) -> Statement:
    """Say whether the chains converged; if not, what speaks first and what mends it."""
    if complaints := list(_complaints(diagnosis)):
        short, sentence, longer = complaints[0]
        if longer:
            longer = max(factor for *_, factor in complaints)
            steps = discard + MARGIN * longer * diagnosis.steps
            unit = 10 ** max(int(np.log10(steps)) - 1, 0)  # two digits, and zeros
            sentence += f"; run steps={unit * int(np.ceil(steps / unit)):,}"
        return Statement(NOT_CONVERGED, short, f"{NOT_CONVERGED}: {sentence}.")
    count, status, short = len(diagnosis.tau), CONVERGED, CONVERGED
    words = f"{status}: {count} ensembles agree"
    if count == 1:
        status, short = MIXED, "one ensemble"
        words = f"{status}, but one ensemble cannot show a missed mode: run ensembles=4"
    elif starts_given:
        status, short = MIXED, "starts given"
        words = (
            f"{status}, but starts from the prior would show other modes: omit starts"
        )
    rhat = f" (R-hat at most {diagnosis.rhat_between.max():.3f})" if count > 1 else ""
    sentence = (
        f"{words}{rhat}, {diagnosis.steps_per_tau.min():.0f} autocorrelation times, "
        f"ESS at least {diagnosis.ess_bulk.min():,.0f}."
    )
    return Statement(status, short, sentence)


def judge_search(modes: ModeWeights | None) -> Statement:
    """Say what a search found, and how small a mode it may have missed."""
    if modes is None:
        sentence = (
            "none: a mode that no start was near is not seen; "
            'run(posterior, "auto") searches.'
        )
        return Statement("not searched", "none", sentence)
    count = len(modes.importance)
    short = "one mode" if count == 1 else f"{count} modes"
    sentence = (
        f"{short}, by {modes.searched:,} points. A mode so small that fewer than one "
        f"point in {modes.searched // HITS:,} falls near it may be missing."
    )
    return Statement("searched", short, sentence)


def _complaints(diagnosis: "Diagnosis") -> Iterator[Complaint]:
    """Yield what speaks against the chains, the plainest first."""
    names, stuck = diagnosis.names, diagnosis.stuck
    if stuck:
        walkers = f"{len(stuck)} walkers"
        places = f"(ensemble, walker): {list(stuck[:5])}"
        where = "look at their starts, and at solves that fail"
        yield f"{walkers} stuck", f"{walkers} never moved {places}; {where}", 0.0
    within, between = diagnosis.rhat_within, diagnosis.rhat_between
    # As in the table, but not enough.
    length = np.fmin(np.round(diagnosis.steps_per_tau), ENOUGH_TAU - 1)
    for excess, values, short, sentence in (
        (
            ENOUGH_TAU / diagnosis.steps_per_tau,
            length,
            "too short ({:.0f} tau)",
            "the chain is {:.0f} autocorrelation times long for {} "
            f"({ENOUGH_TAU} are needed)",
        ),
        (
            (within - 1) / (WALKERS_APART - 1),
            within,
            "walkers stay apart",
            "the walkers of an ensemble stay apart in {1} (R-hat {0:.3f} over walkers, "
            f"at most {WALKERS_APART})",
        ),
        (
            (diagnosis.sd_error / SD_KNOWN_TO) ** 2,
            diagnosis.sd_error,
            "sd unknown",
            "the standard deviation of {1} has a relative error of {0:.2f} (at most "
            f"{SD_KNOWN_TO}), as where tails are heavy or a mode is rarely visited",
        ),
        (
            (between - 1) / (GOOD_RHAT - 1),
            between,
            "ensembles disagree",
            f"ensembles disagree about {{1}} (R-hat {{0:.3f}}, at most {GOOD_RHAT})",
        ),
        (
            diagnosis.scatter,
            diagnosis.scatter,
            "ensembles disagree",
            "the ensembles scatter in {1}, by chi-square {0:.1f} times as much as "
            "autocorrelation times allow",
        ),
    ):
        worst = int(np.argmax(excess))
        value, longer = values[worst], float(excess[worst])
        if longer > 1:  # never for NaN
            sentence = sentence.format(value, names[worst])
            if longer > MOST and "R-hat" in sentence:
                cure = "take a TemperedMove" if diagnosis.modes else 'run moves="auto"'
                sentence, longer = f"{sentence}, as between modes; {cure}", 0.0
            yield short.format(value), sentence, longer
    if (modes := diagnosis.modes) is not None:
        yield from _weights(modes, diagnosis.acceptance.shape[1])
        yield from _proposal(modes, diagnosis.steps)


def _weights(modes: ModeWeights, walkers: int) -> Iterator[Complaint]:
    """Yield modes that are lost, weigh otherwise than they should, or are not known."""
    chain, exact = modes.weights.mean(axis=0), modes.importance
    pairs = modes.errors, modes.importance_errors
    best, apart = np.fmin(*pairs), np.abs(chain - exact)
    differ = apart > np.fmax(SMALL, ERRORS_APART * np.hypot(*pairs))
    for i, weight in enumerate(exact):
        stated = f"{weight:.3f} (+- {pairs[1][i]:.3f})"
        if chain[i] == 0 and modes.reached[i] and not weight < SMALL:
            weight = "not known" if np.isnan(weight) else stated
            yield (
                "a mode is lost",
                f"no walker is in mode {i + 1}, where a search ended or a walker "
                f"started, and its weight by importance sampling is {weight}; run "
                f"nwalkers={2 * walkers}",
                0.0,
            )
        elif differ[i] or best[i] > WEIGHT_KNOWN_TO:
            yield (
                "weights disagree" if differ[i] else "weights unknown",
                f"mode {i + 1} holds {chain[i]:.3f} (+- {pairs[0][i]:.3f}) of the "
                f"chain, and {stated} by importance sampling",
                max(MUCH * differ[i], (best[i] / WEIGHT_KNOWN_TO) ** 2),
            )


def _proposal(modes: ModeWeights, steps: int) -> Iterator[Complaint]:
    """Yield what is wrong with the frozen proposal, if steps are made with it."""
    several = len(modes.importance) > 1
    k = float(np.fmax(modes.pareto_k, modes.chain_k))
    made = modes.share * steps
    # Weights that are nearly equal have a tail too, but not one that matters.
    narrow = k > GOOD_K and not modes.efficiency > FAIR_SHARE
    uneven = k > LONG_WAITS_K and not modes.efficiency > HIGH_SHARE
    visits = [np.nanmin(modes.acceptance) * made / ENOUGH_VISITS] * (
        several and made > 0
    )
    waits = [modes.slowest * made / ENOUGH_WAITS] * (uneven and modes.share > 0.5)
    share = min(visits + waits, default=1.0)
    if share < 1 or (narrow and (several or made)):
        yield (
            "proposal too narrow",
            f"walkers wait long for the frozen proposal (Pareto k {k:.2f} of the "
            f"importance weights, at most {GOOD_K}; from the worst place it is "
            f"accepted {modes.slowest * made:.1f} times in {steps} steps)",
            1 / max(float(share), 0.1) if share < 1 else MUCH,
        )
