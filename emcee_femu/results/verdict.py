"""The verdict on chains: which check speaks first, and what to do then."""

from collections.abc import Iterator
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
ENOUGH_VISITS = 20  # accepted frozen proposals of a walker while it stays in a group
HITS = 3  # expected, of which none comes once in twenty times
ENOUGH_WAITS = 10  # the same from the worst place that a walker reached
HIGH_SHARE = 0.75  # effective share of a proposal for which no walker waits long
CONVERGED = "converged"

Complaint: TypeAlias = tuple[str, str]


def judge(diagnosis: "Diagnosis", starts_given: bool) -> Complaint:
    """Return the verdict in a few words and in a sentence."""
    for short, sentence in _complaints(diagnosis):
        return short, f"Not converged: {sentence}."
    length = (
        f"{diagnosis.steps_per_tau.min():.0f} autocorrelation times, ESS at least "
        f"{diagnosis.ess_bulk.min():.0f}"
    )
    if len(diagnosis.tau) == 1:
        return "one ensemble", (
            "Well mixed, but one ensemble cannot show a missed mode: "
            f"{length}; run ensembles=4 to be sure."
        )
    rhat = diagnosis.rhat_between.max()
    agreement = (
        f"{len(diagnosis.tau)} ensembles agree (R-hat at most {rhat:.3f}), {length}"
    )
    if starts_given:
        return "starts given", (
            f"Well mixed from the given starts: {agreement}; starts from the prior "
            "would show modes that none of these was near."
        )
    limit = ""
    if diagnosis.modes is not None and (searched := diagnosis.modes.searched):
        limit = (
            f" The search had {searched} points: a mode that fewer than one in "
            f"{searched // HITS} would hit may be missing."
        )
    return CONVERGED, f"Converged by every check: {agreement}.{limit}"


def _complaints(diagnosis: "Diagnosis") -> Iterator[Complaint]:
    """Yield what speaks against the chains, the plainest first."""
    names, stuck = diagnosis.names, diagnosis.stuck
    if stuck:
        walkers = f"{len(stuck)} walkers"
        places = f"(ensemble, walker): {list(stuck[:5])}"
        yield f"{walkers} stuck", f"{walkers} never moved {places}"
    worst = int(np.argmin(diagnosis.steps_per_tau))
    per_tau = diagnosis.steps_per_tau[worst]
    if per_tau < ENOUGH_TAU:
        length = min(round(per_tau), ENOUGH_TAU - 1)  # as in the table, but not enough
        yield (
            f"too short: {length} tau",
            f"the chain is {length} autocorrelation times long for {names[worst]} "
            f"({ENOUGH_TAU} are needed); run longer",
        )
    for limit, values, short, sentence in (
        (
            WALKERS_APART,
            diagnosis.rhat_within,
            "walkers stay apart",
            "the walkers of one ensemble stay apart in {name} (R-hat {value:.3f} over "
            "walkers), as they do between several modes; try DEMCMove(mode_jump=0.1)",
        ),
        (
            100 * SD_KNOWN_TO,
            100 * diagnosis.sd_error,
            "sd unknown",
            "the standard deviation of {name} is known to {value:.0f} % only, by the "
            "ESS of its squared deviations, as where tails are heavy or a mode is "
            "rarely visited; run longer, or sample its logarithm",
        ),
        (
            GOOD_RHAT,
            diagnosis.rhat_between,
            "ensembles disagree",
            "the ensembles disagree about {name} (R-hat {value:.3f}, at most "
            f"{GOOD_RHAT} is good); run longer, or try DEMCMove(mode_jump=0.1) if "
            "there are several modes",
        ),
        (
            1.0,
            diagnosis.scatter,
            "ensembles scatter",
            "the ensembles' means or variances of {name} scatter more than their "
            "autocorrelation times allow: something slower than tau is going on, as "
            "between modes or in heavy tails; run longer",
        ),
    ):
        worst = int(np.argmax(values))
        if values[worst] > limit:  # never for NaN
            yield short, sentence.format(name=names[worst], value=values[worst])
    if diagnosis.modes is not None:
        yield from _weights(diagnosis.modes)
        yield from _proposal(diagnosis.modes, diagnosis.steps)


def _weights(modes: ModeWeights) -> Iterator[Complaint]:
    """Yield modes that are lost, or weigh otherwise than they should."""
    chain, exact = modes.weights.mean(axis=0), modes.importance
    errors = np.hypot(modes.errors, modes.importance_errors)
    stated = [
        f"{weight:.3f} (+- {error:.3f})"
        for weight, error in zip(exact, modes.importance_errors, strict=True)
    ]
    for i in np.flatnonzero((chain == 0) & modes.reached & ~(exact < SMALL)):
        yield (
            "a mode is lost",
            f"no walker is in mode {i + 1}, where a search ended or a walker started, "
            "and its weight by importance sampling is "
            f"{'not known' if np.isnan(exact[i]) else stated[i]}; run again with more "
            "walkers, or with a TemperedMove",
        )
    apart = np.abs(chain - exact)
    for i in np.flatnonzero((apart > SMALL) & (apart > ERRORS_APART * errors)):
        yield (
            "weights disagree",
            f"mode {i + 1} holds {chain[i]:.3f} of the chain (+- "
            f"{modes.errors[i]:.3f}) but {stated[i]} by importance sampling; run "
            "longer, and again with another seed",
        )
    for i in np.flatnonzero((modes.scatter > 1.0) & (chain > SMALL)):
        yield (
            "weights disagree",
            f"the ensembles disagree about the weight of mode {i + 1} "
            f"({modes.weights[:, i].round(3).tolist()}); run longer, or try a "
            "TemperedMove",
        )
    best = np.fmin(modes.errors, modes.importance_errors)
    for i in np.flatnonzero(best > WEIGHT_KNOWN_TO):
        yield (
            "weights unknown",
            f"the weight of mode {i + 1} is known to +- {best[i]:.3f} only; run longer",
        )


def _proposal(modes: ModeWeights, steps: int) -> Iterator[Complaint]:
    """Yield what is wrong with the frozen proposal, if steps are made with it."""
    several = len(modes.importance) > 1
    accepted = np.nan_to_num(modes.acceptance, nan=1.0) * modes.share * steps
    worst = int(np.argmin(accepted))
    if several and modes.share and accepted[worst] < ENOUGH_VISITS:
        yield (
            "a mode is left too rarely",
            f"a frozen proposal is accepted from mode {worst + 1} only "
            f"{accepted[worst]:.1f} times in {steps} steps; run longer, or with a "
            "TemperedMove",
        )
    # Weights that are nearly equal have a tail too, but not one that matters.
    k = np.fmax(modes.pareto_k, modes.chain_k)
    narrow = not modes.efficiency > FAIR_SHARE
    if k > GOOD_K and narrow and (modes.share or several):
        yield (
            "proposal too narrow",
            f"the frozen proposal lacks part of the posterior (Pareto k {k:.2f} of the "
            f"importance weights, at most {GOOD_K} is good), where walkers stay long; "
            "run again with more walkers or steps, which fits it anew, or with "
            "DEMCMove()",
        )
    rare = modes.slowest * modes.share * steps
    uneven = not modes.efficiency > HIGH_SHARE
    if uneven and modes.share > 0.5 and rare < ENOUGH_WAITS:
        yield (
            "walkers wait too long",
            "from where a walker was a frozen proposal is accepted only "
            f"{rare:.1f} times in {steps} steps, fewer than {ENOUGH_WAITS}, as at the "
            "end of a tail that it lacks; run longer, or with DEMCMove()",
        )
