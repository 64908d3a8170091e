"""What the data say about the parameters, in sentences."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..interfaces import Floats

if TYPE_CHECKING:
    from .identifiability import Identifiability

UNINFORMED = 0.9  # sd ratio above which a parameter is as uncertain as before
MOVED = 0.5  # prior sds; data that leave 0.9 of the sd move the mean by 0.4 or so
WIDER = 1.1  # times as uncertain as before
SURPRISING = 2.0  # prior sds by which an error may exceed its prior mean
TOGETHER = 0.95  # |correlation| above which only a combination is known well
MANY = 3  # uninformed parameters from which on the known combinations are named
INFORMED = 0.5  # sd ratio below which a combination is worth naming
MOST_COMBINATIONS, MOST_PARTS, SMALL_PART = 3, 5, 0.15
CROWDED = 0.05  # share of the samples near a bound
CLOSE = 3.0  # posterior sds from a bound; a half-normal has 1.3, an exponential 1
GOOD_FIT = 0.98  # R^2 below which gradients were off by 10 % and more (H structure)


def describe_findings(result: "Identifiability") -> list[str]:
    """Return sentences."""
    names, is_error = result.names, result.is_error
    uninformed = np.flatnonzero(result.sd_ratio > UNINFORMED)
    together = np.abs(result.correlation) > TOGETHER
    sentences = [_name_unknown(result, i, together[i].sum() == 1) for i in uninformed]
    sentences += [_pair(result, pair) for pair in np.argwhere(np.triu(together, 1))]
    crowded = np.argwhere((result.at_bound > CROWDED) & (result.from_bound < CLOSE))
    pressed = any(side or not is_error[i] for i, side in crowded)
    if not sentences and not pressed:
        least = int(result.sd_ratio.argmax())
        sentences = [
            f"The data inform every parameter, {names[least]} least (sd "
            f"ratio {result.sd_ratio[least]:.2f})."
        ]
    if (~is_error[uninformed]).sum() >= MANY:
        sentences += _combinations(result)
    sentences += [
        f"{names[i]} is inferred {result.shift[i]:.1f} prior standard deviations "
        "above its prior mean: model and data disagree by more than was expected. Look "
        "for what the model lacks, or widen this prior."
        for i in np.flatnonzero(is_error & (result.shift > SURPRISING))
    ]
    what = "the Gaussian's draws" if result.local else "the samples"
    press = []
    # A narrow posterior may lie within 1 % of a wide range, and far from its bound.
    for i, side in crowded:
        share = f"{100 * result.at_bound[i, side]:.0f} % of {what}"
        bound = f"{('lower', 'upper')[side]} bound {result.bounds[i, side]:.5g}"
        if is_error[i] and side == 0:
            sentences.append(
                f"{names[i]} may well be as small as its {bound}, where {share} lie: "
                "the data do not need so large an error as the prior admits."
            )
        else:
            press.append(
                f"{names[i]} is pressed against its {bound}: {share} lie within 1 % of "
                "the range from it. Widen the bounds, or doubt the model."
            )
    rough = [
        f"The sensitivities of {result.modes[i]} are rough, for ln(lambda) is not a "
        f"quadratic over the samples (R^2 {result.r_squared[i]:.2f})."
        for i in np.flatnonzero(result.r_squared < GOOD_FIT)
    ]
    if result.modes and not result.local and np.isnan(result.sensitivities).all():
        rough.append(
            "There are no sensitivities: the samples do not span all directions of "
            "the parameters. Run longer, or with more walkers."
        )
    return [*press, *sentences, *rough]


def _name_unknown(result: "Identifiability", i: np.intp, alone: bool) -> str:
    name, shift, ratio = result.names[i], result.shift[i], result.sd_ratio[i]
    if abs(shift) >= MOVED:  # never for NaN
        how = "more uncertain than" if ratio > WIDER else "as uncertain as"
        return (
            f"The data move {name} by {shift:+.1f} prior standard deviations, but "
            f"leave it {how} before (sd ratio {ratio:.2f})."
        )
    reason = ""
    largest = np.abs(result.sensitivities[:, i]).max(initial=0.0)
    if result.modes and not np.isnan(largest):
        reason = (
            "; a prior standard deviation of it changes the eigenvalues by "
            f"{100 * largest:.2g} % at most"
        )
    return (
        f"The data say nothing about {name}{'' if alone else ' by itself'}: it is as "
        f"uncertain as before (sd ratio {ratio:.2f}){reason}."
    )


def _pair(result: "Identifiability", pair: NDArray[np.intp]) -> str:
    """Say which combination of two parameters is known best, by their prior sds."""
    variances, directions = _principal(result, pair)
    first, second = directions[:, 0] / result.prior_sd[pair]
    (a, b), ratios = (result.names[k] for k in pair), result.sd_ratio[pair]
    return (
        f"Only {a} {_sign(second / first)} {b} is known well, not {a} and {b} by "
        f"themselves: sd ratio {np.sqrt(variances[0]):.2g}, against {ratios[0]:.2g} "
        f"and {ratios[1]:.2g} (correlation {result.correlation[*pair]:+.3f})."
    )


def _combinations(result: "Identifiability") -> list[str]:
    """Name the directions in which the posterior is narrowest, in prior sds."""
    structural = np.flatnonzero(~result.is_error)
    variances, directions = _principal(result, structural)
    known = np.flatnonzero(np.sqrt(variances) < INFORMED)
    if not len(known):
        return ["No combination of the parameters is known well either."]
    words = []
    for k in known[:MOST_COMBINATIONS]:
        vector = directions[:, k]
        parts = np.argsort(-np.abs(vector))[:MOST_PARTS]
        parts = parts[np.abs(vector[parts]) >= SMALL_PART]
        vector = vector * np.sign(vector[parts[0]])
        text = f"{vector[parts[0]]:.2f} {result.names[structural[parts[0]]]}"
        for i in parts[1:]:
            text += f" {_sign(vector[i], '.2f')} {result.names[structural[i]]}"
        words.append(f"{text} (sd ratio {np.sqrt(variances[k]):.2g})")
    return [
        f"{len(known)} of {len(structural)} independent combinations are known well "
        f"(sd ratio below {INFORMED}), best, in prior standard deviations: "
        f"{'; '.join(words)}."
    ]


def _principal(
    result: "Identifiability", which: NDArray[np.intp]
) -> tuple[Floats, Floats]:
    """Return variances and directions of parameters in prior sds, narrowest first."""
    ratios = result.sd_ratio[which]
    within = result.correlation[np.ix_(which, which)]
    variances, directions = np.linalg.eigh(np.outer(ratios, ratios) * within)
    return np.maximum(variances, 0.0), directions


def _sign(value: float, spec: str = ".3g") -> str:
    return f"{'+' if value > 0 else '-'} {abs(value):{spec}}"
