"""What the samples say about the parameters, in sentences."""

from typing import Any

import numpy as np

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


def describe_findings(found: Any) -> list[str]:
    """Return sentences about an ``Identifiability``."""
    uninformed = np.flatnonzero(found.sd_ratio > UNINFORMED)
    together = np.abs(found.correlation) > TOGETHER
    sentences = [_name_unknown(found, i, together[i].sum() == 1) for i in uninformed]
    sentences += [_pair(found, i, j) for i, j in np.argwhere(np.triu(together, 1))]
    # A narrow posterior may lie within 1 % of a wide range, and far from its bound.
    crowded = np.argwhere((found.at_bound > CROWDED) & (found.from_bound < CLOSE))
    small = [i for i, side in crowded if found.is_error[i] and side == 0]
    pressed = [(i, side) for i, side in crowded if not found.is_error[i] or side]
    if not sentences and not pressed:
        least = int(found.sd_ratio.argmax())
        sentences = [
            f"The data inform every parameter, {found.names[least]} least (sd "
            f"ratio {found.sd_ratio[least]:.2f})."
        ]
    if (~found.is_error[uninformed]).sum() >= MANY:
        sentences += _combinations(found)
    sentences += [
        f"{found.names[i]} is inferred {found.shift[i]:.1f} prior standard deviations "
        "above its prior mean: model and data disagree by more than was expected. Look "
        "for what the model lacks, or widen this prior."
        for i in np.flatnonzero(found.is_error & (found.shift > SURPRISING))
    ]
    sentences += [_say_small(found, i) for i in small]
    sentences = [_press(found, i, side) for i, side in pressed] + sentences
    sentences += [
        f"The sensitivities of {found.modes[i]} are rough, for ln(lambda) is not a "
        f"quadratic over the samples (R^2 {found.r_squared[i]:.2f})."
        for i in np.flatnonzero(found.r_squared < GOOD_FIT)
    ]
    if found.modes and not found.local and np.isnan(found.sensitivities).all():
        sentences.append(
            "There are no sensitivities: the samples do not span all directions of "
            "the parameters. Run longer, or with more walkers."
        )
    return sentences


def _name_unknown(found: Any, i: Any, alone: bool) -> str:
    name, shift, ratio = found.names[i], found.shift[i], found.sd_ratio[i]
    if abs(shift) >= MOVED:  # never for NaN
        how = "more uncertain than" if ratio > WIDER else "as uncertain as"
        return (
            f"The data move {name} by {shift:+.1f} prior standard deviations, but "
            f"leave it {how} before (sd ratio {ratio:.2f})."
        )
    reason = ""
    largest = np.abs(found.sensitivities[:, i]).max(initial=0.0)
    if found.modes and not np.isnan(largest):
        reason = (
            "; a prior standard deviation of it changes the eigenvalues by "
            f"{100 * largest:.2g} % at most"
        )
    return (
        f"The data say nothing about {name}{'' if alone else ' by itself'}: it is as "
        f"uncertain as before (sd ratio {ratio:.2f}){reason}."
    )


def _pair(found: Any, i: int, j: int) -> str:
    """Say which combination of two parameters is known best, by their prior sds."""
    pair = [i, j]
    variances, directions = _principal(found, pair)
    first, second = directions[:, 0] / found.prior_sd[pair]
    (a, b), ratios = (found.names[k] for k in pair), found.sd_ratio[pair]
    return (
        f"Only {a} {_sign(second / first)} {b} is known well, not {a} and {b} by "
        f"themselves: sd ratio {np.sqrt(variances[0]):.2g}, against {ratios[0]:.2g} "
        f"and {ratios[1]:.2g} (correlation {found.correlation[i, j]:+.3f})."
    )


def _combinations(found: Any) -> list[str]:
    """Name the directions in which the posterior is narrowest, in prior sds."""
    structural = np.flatnonzero(~found.is_error)
    variances, directions = _principal(found, structural)
    known = np.flatnonzero(np.sqrt(variances) < INFORMED)
    if not len(known):
        return ["No combination of the parameters is known well either."]
    words = []
    for k in known[:MOST_COMBINATIONS]:
        vector = directions[:, k]
        parts = np.argsort(-np.abs(vector))[:MOST_PARTS]
        parts = parts[np.abs(vector[parts]) >= SMALL_PART]
        vector = vector * np.sign(vector[parts[0]])
        text = f"{vector[parts[0]]:.2f} {found.names[structural[parts[0]]]}"
        for i in parts[1:]:
            text += f" {_sign(vector[i], '.2f')} {found.names[structural[i]]}"
        words.append(f"{text} (sd ratio {np.sqrt(variances[k]):.2g})")
    return [
        f"{len(known)} of {len(structural)} independent combinations are known well "
        f"(sd ratio below {INFORMED}), best, in prior standard deviations: "
        f"{'; '.join(words)}."
    ]


def _principal(found: Any, which: Any) -> Any:
    """Return variances and directions of parameters in prior sds, narrowest first."""
    ratios = found.sd_ratio[which]
    within = found.correlation[np.ix_(which, which)]
    variances, directions = np.linalg.eigh(np.outer(ratios, ratios) * within)
    return np.maximum(variances, 0.0), directions


def _sign(value: float, spec: str = ".3g") -> str:
    return f"{'+' if value > 0 else '-'} {abs(value):{spec}}"


def _say_small(found: Any, i: int) -> str:
    share, what = _crowd(found, i, 0)
    return (
        f"{found.names[i]} may well be as small as its lower bound "
        f"{found.bounds[i, 0]:.5g}, where {share} of {what} lie: the data do not need "
        "so large an error as the prior admits."
    )


def _press(found: Any, i: int, side: int) -> str:
    share, what = _crowd(found, i, side)
    return (
        f"{found.names[i]} is pressed against its {('lower', 'upper')[side]} bound "
        f"{found.bounds[i, side]:.5g}: {share} of {what} lie within 1 % of the range "
        "from it. Widen the bounds, or doubt the model."
    )


def _crowd(found: Any, i: int, side: int) -> tuple[str, str]:
    what = "the Gaussian's draws" if found.local else "the samples"
    return f"{100 * found.at_bound[i, side]:.0f} %", what
