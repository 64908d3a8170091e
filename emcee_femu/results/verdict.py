"""The verdict on chains: which check speaks first, and what to do then."""

from collections.abc import Iterator
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from ..sampling.importance import FAIR_SHARE, GOOD_K
from .groups import Groups

if TYPE_CHECKING:
    from .diagnostics import Diagnosis

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


def judge(found: "Diagnosis", starts_given: bool) -> Complaint:
    """Return the verdict in a few words and in a sentence."""
    for short, sentence in _complaints(found):
        return short, f"Not converged: {sentence}."
    length = (
        f"{found.steps_per_tau.min():.0f} autocorrelation times, ESS at least "
        f"{found.ess_bulk.min():.0f}"
    )
    if len(found.tau) == 1:
        return "one ensemble", (
            "Well mixed, but one ensemble cannot show a missed mode: "
            f"{length}; run ensembles=4 to be sure."
        )
    rhat = found.rhat_between.max()
    agreement = f"{len(found.tau)} ensembles agree (R-hat at most {rhat:.3f}), {length}"
    if starts_given:
        return "starts given", (
            f"Well mixed from the given starts: {agreement}; starts from the prior "
            "would show modes that none of these was near."
        )
    limit = ""
    if found.groups is not None and found.groups.searched:
        limit = (
            f" The search had {found.groups.searched} points: a mode that fewer than "
            f"one in {found.groups.searched // HITS} would hit may be missing."
        )
    return CONVERGED, f"Converged by every check: {agreement}.{limit}"


def _complaints(found: "Diagnosis") -> Iterator[Complaint]:
    """Yield what speaks against the chains, the plainest first."""
    yield from _mixing(found)
    yield from _agreement(found)
    if found.groups is not None:
        yield from _weights(found.groups)
        yield from _proposal(found.groups, found.steps)


def _mixing(found: "Diagnosis") -> Iterator[Complaint]:
    if found.stuck:
        yield (
            f"{len(found.stuck)} walkers stuck",
            f"{len(found.stuck)} walkers never moved (ensemble, walker): "
            f"{list(found.stuck[:5])}",
        )
    worst = int(np.argmin(found.steps_per_tau))
    per_tau = found.steps_per_tau[worst]
    if per_tau < ENOUGH_TAU:
        length = min(round(per_tau), ENOUGH_TAU - 1)  # as in the table, but not enough
        yield (
            f"too short: {length} tau",
            f"the chain is {length} autocorrelation times long for "
            f"{found.names[worst]} ({ENOUGH_TAU} are needed); run longer",
        )
    worst = int(np.argmax(found.rhat_within))
    rhat = found.rhat_within[worst]
    if rhat > WALKERS_APART:
        yield (
            "walkers stay apart",
            f"the walkers of one ensemble stay apart in {found.names[worst]} (R-hat "
            f"{rhat:.3f} over walkers), as they do between several modes; try "
            "DEMCMove(mode_jump=0.1)",
        )
    worst = int(np.argmax(found.sd_error))
    error = found.sd_error[worst]
    if error > SD_KNOWN_TO:
        yield (
            "sd unknown",
            f"the standard deviation of {found.names[worst]} is known to "
            f"{100 * error:.0f} % only, by the ESS of its squared deviations, as where "
            "tails are heavy or a mode is rarely visited; run longer, or sample its "
            "logarithm",
        )


def _agreement(found: "Diagnosis") -> Iterator[Complaint]:
    worst = int(np.argmax(found.rhat_between))
    rhat = found.rhat_between[worst]
    if rhat > GOOD_RHAT:
        yield (
            "ensembles disagree",
            f"the ensembles disagree about {found.names[worst]} (R-hat {rhat:.3f}, at "
            f"most {GOOD_RHAT} is good); run longer, or try DEMCMove(mode_jump=0.1) if "
            "there are several modes",
        )
    worst = int(np.argmax(found.scatter))
    if found.scatter[worst] > 1:
        yield (
            "ensembles scatter",
            f"the ensembles' means or variances of {found.names[worst]} scatter more "
            "than their autocorrelation times allow: something slower than tau is "
            "going on, as between modes or in heavy tails; run longer",
        )


def _weights(groups: Groups) -> Iterator[Complaint]:
    """Yield groups that are lost, or weigh otherwise than they should."""
    chain, exact = groups.weights.mean(axis=0), groups.importance
    errors = np.hypot(groups.errors, groups.importance_errors)
    for g, (share, weight, error) in enumerate(zip(chain, exact, errors, strict=True)):
        if share == 0 and groups.found[g] and not weight < SMALL:
            known = f"{weight:.3f} +- {groups.importance_errors[g]:.3f}"
            yield (
                "a mode is lost",
                f"no walker is in group {g + 1}, where a search ended or a walker "
                "started, and its weight by importance sampling is "
                f"{'not known' if np.isnan(weight) else known}; run again with more "
                "walkers, or with a TemperedMove",
            )
        apart = abs(share - weight)
        if apart > SMALL and apart > ERRORS_APART * error:
            yield (
                "weights disagree",
                f"group {g + 1} holds {share:.3f} of the chain (+- "
                f"{groups.errors[g]:.3f}) but {weight:.3f} (+- "
                f"{groups.importance_errors[g]:.3f}) by importance sampling; run "
                "longer, and again with another seed",
            )
    worst = int(np.argmax(np.nan_to_num(groups.scatter)))
    if groups.scatter[worst] > 1 and chain[worst] > SMALL:
        yield (
            "weights disagree",
            f"the ensembles disagree about the weight of group {worst + 1} "
            f"({groups.weights[:, worst].round(3).tolist()}); run longer, or try a "
            "TemperedMove",
        )
    best = np.fmin(groups.errors, groups.importance_errors)
    worst = int(np.argmax(best))
    if best[worst] > WEIGHT_KNOWN_TO:
        yield (
            "weights unknown",
            f"the weight of group {worst + 1} is known to +- {best[worst]:.3f} only; "
            "run longer",
        )


def _proposal(groups: Groups, steps: int) -> Iterator[Complaint]:
    """Yield what is wrong with the frozen proposal, if steps are made with it."""
    several = len(groups.importance) > 1
    accepted = np.nan_to_num(groups.acceptance, nan=1.0) * groups.share * steps
    worst = int(np.argmin(accepted))
    if several and groups.share and accepted[worst] < ENOUGH_VISITS:
        yield (
            "a group is left too rarely",
            f"a frozen proposal is accepted from group {worst + 1} only "
            f"{accepted[worst]:.1f} times in {steps} steps; run longer, or with a "
            "TemperedMove",
        )
    # Weights that are nearly equal have a tail too, but not one that matters.
    narrow = not groups.efficiency > FAIR_SHARE
    for k, where in ((groups.pareto_k, "its own"), (groups.chain_k, "the chain's")):
        if k > GOOD_K and narrow and (groups.share or several):
            yield (
                "proposal too narrow",
                f"the frozen proposal lacks part of the posterior (Pareto k {k:.2f} of "
                f"the importance weights of {where} draws, at most {GOOD_K} is good), "
                "where walkers stay long; run again with more walkers or steps, which "
                "fits it anew, or with DEMCMove()",
            )
    rare = groups.slowest * groups.share * steps
    uneven = not groups.efficiency > HIGH_SHARE
    if uneven and groups.share > 0.5 and rare < ENOUGH_WAITS:
        yield (
            "walkers wait too long",
            "from where a walker was a frozen proposal is accepted only "
            f"{rare:.1f} times in {steps} steps, fewer than {ENOUGH_WAITS}, as at the "
            "end of a tail that it lacks; run longer, or with DEMCMove()",
        )
