"""The statement on the fit: from records of what samples say of the data to words."""

from collections.abc import Collection, Iterator, Sequence
from itertools import groupby
from typing import NamedTuple

import numpy as np
from scipy import stats

from ..likelihoods.residuals import (
    ELSEWHERE,
    FITS,
    MISFIT,
    MODE,
    NONE_SUSPECT,
    NOT_JUDGED,
    RESEMBLES_NONE,
    SENSOR,
    SKIPPED,
    SUSPECT,
    TERM,
    FitRecord,
)
from ..posterior.log_posterior import LogPosterior
from ..posterior.plausibility import doubt_units, is_constant, same_response
from ..search.record import Chains
from ..verdict.diagnosis import Statement
from .arviz_objects import InferenceData
from .fit import find_farthest
from .fit_modes import AND, WRONG
from .identifiability import Identifiability, describe_samples
from .measured import Measured, read_measured

FAR_OUTSIDE = 4.0  # standard deviations of a new measurement, for a single value
OUTSIDE_BY_CHANCE = 0.05  # share of new measurements outside their 95 % range
CHANCE = 0.02  # that so many values are outside, had the posterior not seen them
OUTVOTED = 5  # times as many values in another term that make it outvote this one
SMALL_MAXIMUM = 0.01  # weight of a maximum whose modes do not matter
MOST_NAMED = 3  # terms that are described at length
NOT_DRAWN = "no term draws new measurements of what the model stores"
NO_DATA = "no term says what was measured; a bare log-likelihood cannot"
NOT_KNOWN = (
    "these are samples alone; to_inference_data(sampler, posterior) adds the data"
)
DOES_NOT_FIT, NOT_CHECKED = "does not fit", "not checked"
OFF = MISFIT, RESEMBLES_NONE
LEAVE_OUT = "Leave it out, and ask whether it is a harmonic of a machine, or noise."
CHECK_SENSORS = (
    "turned round, exchanged with another, or of another gain or unit? check_test("
    "posterior) tries each. It does not try other places or directions."
)
SENSORS_CHECKED = (
    "at another place, or along another direction, than the test says? That none is "
    "turned round, exchanged or of another gain was checked."
)
PAIR = "Pair the modes by shape: PairedModel(model, ...)."
OLD = (
    "Not judged: data of which no new measurement is drawn. The object is of an "
    "earlier version; convert its run again."
)


class _Replicates(NamedTuple):
    """The measured values, compared with new measurements that the terms draw.

    Attributes:
        inside: How many values are inside 95 % of them.
        total: How many values there are.
        names: Their variables.
        far: The variables with values that are too far out, each with its farthest.
        units: Doubts about their units.
        wrong: Whether a value is off by a factor that no model's error explains.
    """

    inside: int
    total: int
    names: str
    far: dict[str, str]
    units: list[str]
    wrong: bool


def judge_fit(
    idata: InferenceData | None, records: Sequence[FitRecord] | None, chains: Chains
) -> Statement:
    """Say whether the data are what the updated model makes likely.

    Args:
        idata: The samples with their response, None if the response is unknown.
        records: The records of the data, None if there are none.
        chains: The chains from which they were read.
    """
    parts = [] if idata is None else read_measured(idata)
    drawn = [part for part in parts if part.replicated is not None]
    known = idata is not None and "constant_data" in idata
    unknown = [OLD] if known and records is None else []
    records = records or ()
    not_judged = _name_silent(records)
    silent = [*unknown, *(f"Not judged: {names}." for names in not_judged)]
    judged = [record for record in records if record.status != NOT_JUDGED]
    recalled = [f"Before the run: {_end_sentence(text)}" for text in chains.doubts]
    if not drawn and not judged:
        reason = (NOT_DRAWN if parts else NO_DATA) if known else NOT_KNOWN
        because = f"{NOT_CHECKED}: {''.join(not_judged) or reason}."
        sentence = " ".join([because, *unknown, *recalled])
        return Statement(NOT_CHECKED, NOT_CHECKED, sentence)
    about, new = describe_samples(idata, fitted=False), _compare_replicates(drawn)
    missed = [*about.surprising, *new.far]
    off = [r for r in judged if r.status in OFF]
    suspects = [r for r in judged if r.status == SUSPECT]
    fitting = () if missed or off else _name_fits(judged, drawn)
    said = *_count(new), *_name_misfits(judged, missed), *fitting
    sentence = "; ".join(said) + "."
    pressed, swapped = about.find_pressed(), [*_find_swaps(chains)]
    if missed or off:
        units = [] if recalled else new.units
        doubted = bool(recalled or units)
        found = [*recalled, *_name_causes(judged, missed, doubted), *swapped, *units]
        # A wrong sensor does not move frequencies.
        moved = any(name.split(".")[-1] == "frequency" for name in new.far)
        likeliest = found or ([] if moved else [*_look_at_sensors(judged, missed)])
        outvoted = [] if found else [*_outvoted(chains.posterior, missed)]
        others = [*outvoted, *about.find_doubts(), *pressed]
        last = [] if likeliest or others else [_advise(new.wrong, about)]
        short = f"{new.total - new.inside} of {new.total} outside" if new.far else ""
        short = short or (_shorten(off) if off else "a surprising error")
        short = f"suspect: {suspects[0].label}" if suspects else short
        words = [f"{DOES_NOT_FIT}: {sentence}", *likeliest, *others, *last, *silent]
        return Statement(DOES_NOT_FIT, short, " ".join(words))
    doubts = [*about.find_followed(), *swapped, *recalled]
    still = [part for part in parts if is_constant(part.predicted)]
    if np.ptp(chains.draws) and still:
        label = ", ".join(part.name for part in still)
        doubts.append(same_response(label, len(still[0].predicted)))
    status, short = "fits", "inside"
    if doubts:
        status, short = "doubtful", "inside, but doubtful"
    if pressed:
        status = short = "at a bound"
    words = [f"{short}: {sentence}", *pressed, *doubts, *silent]
    return Statement(status, short, " ".join(words))


def _end_sentence(text: str) -> str:
    return text if text.endswith((".", "?")) else f"{text}."


def _compare_replicates(drawn: Sequence[Measured]) -> _Replicates:
    inside = sum(int(part.inside.sum()) for part in drawn)
    total = sum(len(part.values) for part in drawn)
    chance = stats.binom.sf(total - inside - 1, total, OUTSIDE_BY_CHANCE)
    far, units, wrong = {}, [], False
    for part in drawn:
        assert part.replicated is not None
        mean, sd = part.replicated.mean(axis=0), part.replicated.std(axis=0)
        with np.errstate(divide="ignore", invalid="ignore"):
            z = np.abs(part.values - mean) / sd
            ratios = np.abs(np.log(np.abs(mean / part.values)))[~part.inside]
        worst = int(np.argmax(z))
        wrong |= bool(ratios.max(initial=0) > np.log(WRONG))
        if z[worst] > FAR_OUTSIDE or (chance < CHANCE and not part.inside.all()):
            where = part.labels[worst]
            if where.replace(".", "", 1).isdigit():  # which says nothing alone
                where = f"{part.dims} {where}"
            far[part.name] = (
                f"{part.name} ({where}) is farthest out "
                f"(measured {part.values[worst]:.4g}, updated {part.updated[worst]:.4g}"
                f"{f' {part.unit}'.rstrip()})"
            )
            if text := doubt_units(part.initial[None], part.values, part.unit):
                units.append(f"At the prior mean {text}")
    names = ", ".join(part.name for part in drawn)
    return _Replicates(inside, total, names, far, units, wrong)


def _count(new: _Replicates) -> Iterator[str]:
    """Say how many values are inside, and which are farthest out."""
    if new.total:
        yield (
            f"{new.inside} of {new.total} measured values ({new.names}) are inside "
            "95 % of new measurements"
        )
    yield from new.far.values()


def _name_silent(records: Sequence[FitRecord]) -> list[str]:
    """Name terms that cannot be judged, in one string, with the reasons."""
    silent = [record for record in records if record.status == NOT_JUDGED]
    words = [f"{_full_name(record)} ({record.reason})" for record in silent]
    return [", ".join(words)] if words else []


def _full_name(record: FitRecord) -> str:
    return f"{record.experiment}.{record.term}".strip(".")


def _name_misfits(
    records: Sequence[FitRecord], named: Collection[str]
) -> Iterator[str]:
    """Describe the terms that chi^2 shows to be off, except those named already."""
    alike = [r for r in records if r.status == RESEMBLES_NONE]
    suspected = {r.experiment for r in records if r.status == SUSPECT}
    for record in alike:
        what = record.reason or "resembles no mode of the model"
        text = f"measured {_name_mode(record)} {what}"
        if np.isfinite(record.mac_before) and not record.mac <= record.mac_before:
            text += f" at the prior mean (MAC {record.mac_before:.2f})"
        yield text
    found = list[tuple[float, str]]()
    for of_term in _by_term(records):
        off, whole = [r for r in of_term if r.status in OFF], of_term[0]
        surprising = whole.error in named
        if not (off or surprising) or whole.kind != TERM or whole.variable in named:
            continue
        name = _full_name(whole)
        text = f"{name} is off in some of its data, not in all"
        if surprising:  # which absorbs the misfit
            text = f"{name} fits only because its inferred error is large"
        elif whole.error:
            text = f"{name} is off in some of its data by more than its inferred error"
        if whole.status == MISFIT:
            text = f"{name} {_compare_chi2(whole)}"
        if where := _name_farthest(of_term, whole.experiment in suspected):
            text += f", farthest out is {where}"
        found.append((-whole.chi2 / whole.size, text))
    yield from (text for _, text in sorted(found)[:MOST_NAMED])
    unlike = [r for r in records if r.status == MISFIT and not r.term]
    unpaired = [r for r in unlike if r.kind == MODE]
    if unpaired:
        words = ", ".join(map(_name_mode, unpaired))
        yield f"measured modes that resemble none of the model: {words}"
    if not (found or alike or named or unpaired):
        for r in unlike:  # experiments, each for all its terms
            yield f"{r.experiment} has a chi^2 of {r.chi2:.3g} on {r.size:.3g}"


def _name_fits(
    records: Sequence[FitRecord], drawn: Sequence[Measured]
) -> Iterator[str]:
    """Describe the terms that fit, but draw no new measurement."""
    fitting = [r for r in records if r.kind == TERM and r.status == FITS]
    counted = {part.variable for part in drawn}
    for record in [r for r in fitting if r.variable not in counted]:
        yield f"{_full_name(record)} {_compare_chi2(record)}"


def _compare_chi2(record: FitRecord) -> str:
    return (
        f"has a chi^2 of {record.chi2:.3g} on {record.size:.3g} (a right model gives "
        f"{record.low:.3g} to {record.high:.3g})"
    )


def _by_term(records: Sequence[FitRecord]) -> Iterator[list[FitRecord]]:
    """Yield the records of each term, that of all its data first."""
    for _, group in groupby(records, key=lambda r: (r.experiment, r.term)):
        yield [*group]


def _name_farthest(records: Sequence[FitRecord], suspected: bool) -> str:
    """Name the groups of a term in which most of its chi^2 is."""
    best = find_farthest(records)
    modes = [r for r in records if r.kind == MODE and np.isfinite(r.mac)]
    if not modes:
        return ", ".join(f"{r.kind} {r.label}" for r in best)
    # For shapes a mode is named in any case, the one with the lowest MAC.
    lowest = min(modes, key=lambda r: r.mac)
    words = f"the shape of {_name_mode(next((r for r in best if r in modes), lowest))}"
    at = [r.label for r in best if r.kind == SENSOR and not suspected]
    return f"{words}, most at {_name_sensors(at[0])}" if at else words


def _name_sensors(label: str) -> str:
    return f"sensors {label}" if AND in label else f"sensor {label}"


def _name_mode(record: FitRecord) -> str:
    modes = "modes" if " and " in record.label else "mode"
    words = f"{modes} {record.label}"
    if record.experiment:
        words += f" of {record.experiment}"
    if np.isfinite(record.mac):
        words += f" (MAC {record.mac:.2f}, {record.mac_expected:.2f} expected)"
    return words


def _name_causes(
    records: Sequence[FitRecord], missed: Collection[str], other_units: bool
) -> Iterator[str]:
    """Name what is likeliest wrong with the test: sensors, modes, pairing.

    Where units are wrong, parameters that follow them make good modes unlike.
    """
    for r in records:
        where = f" of {r.experiment}" if r.experiment else ""
        if r.status == SUSPECT:
            said = r.reason[0].upper() + r.reason[1:]
            yield f"{said}. If it is so, put it right in what was measured."
        elif r.status == RESEMBLES_NONE and not other_units:
            yield f"Is measured mode {r.label}{where} spurious? {LEAVE_OUT}"
        elif r.status == ELSEWHERE:
            yield (
                f"At the prior mean measured mode {r.label}{where} {r.reason} (MAC "
                f"{r.mac_before:.2f}): is it another mode, or does the model lack a "
                "mass or a stiffness that this mode moves?"
            )
        elif r.status == SKIPPED:
            yield (
                f"Mode {r.label} of the model{where} may not have been measured: the "
                f"other frequencies agree far better without it. {PAIR}"
            )
    for of_term in _unlike_shapes(records, missed):
        if of_term[0].term and not of_term[0].paired:
            yield PAIR


def _look_at_sensors(
    records: Sequence[FitRecord], missed: Collection[str]
) -> Iterator[str]:
    """Name the sensor that is farthest out where measured shapes do not fit."""
    tried = {r.experiment for r in records if r.status == NONE_SUSPECT}
    for of_term in _unlike_shapes(records, missed):
        name = of_term[0].experiment
        at = [r.label for r in find_farthest(of_term) if r.kind == SENSOR]
        which = _name_sensors(at[0]) if at else "one of the sensors"
        where = f" of {name}" if name else ""
        how = SENSORS_CHECKED if name in tried else CHECK_SENSORS
        yield f"Look at the sensors first: is {which}{where} {how}"


def _unlike_shapes(
    records: Sequence[FitRecord], missed: Collection[str]
) -> Iterator[list[FitRecord]]:
    """Yield the records of each term whose measured shapes do not fit."""
    for of_term in _by_term(records):
        modes = [r for r in of_term if r.kind == MODE and np.isfinite(r.mac)]
        misfit = any(r.status == MISFIT for r in of_term)
        if modes and (misfit or of_term[0].error in missed):
            yield of_term


def _shorten(off: Sequence[FitRecord]) -> str:
    """Say in a few words which data are off."""
    for record in off:
        if record.status == RESEMBLES_NONE:
            return f"measured mode {record.label} resembles none"
    named = [_full_name(record) for record in off if record.term]
    return f"{named[0]} is off" if named else "measured shapes are off"


def _advise(wrong: bool, about: Identifiability) -> str:
    """Suggest a remedy for a misfit whose cause is unknown."""
    if wrong:
        return (
            f"Check units and model: they are off by more than a factor of {WRONG:g}."
        )
    if about.is_error.any():
        return "Improve the model: its error, which is inferred, does not explain this."
    return "Improve the model, or infer its error (discrepancy=)."


def _find_swaps(chains: Chains) -> Iterator[str]:
    """Name modes of the structure that change places, at each maximum."""
    if (search := chains.search) is None:
        return
    for experiment, found in search.followed.items():
        for i, numbers in enumerate(found):
            there = numbers != 1 + np.arange(len(numbers))
            swapped = np.flatnonzero(there & (numbers > 0))
            if not swapped.size or search.weights[i] < SMALL_MAXIMUM:
                continue
            moved = [f"{mode + 1} is number {numbers[mode]}" for mode in swapped]
            where = f"maximum {i + 1}{f' of {experiment}' if experiment else ''}"
            yield (
                f"At {where} (weight {search.weights[i]:.2f}) modes of the structure "
                "have changed places since the prior mean, by the model's shapes: mode "
                f"{', mode '.join(moved)}. Pair them by shape: PairedModel(model, ...)."
            )


def _outvoted(posterior: LogPosterior | None, missed: Collection[str]) -> Iterator[str]:
    """Name terms that do not fit, and those with far more values that outvote them.

    The error of the others is inferred, so it can become as small as their fit allows.
    """
    for experiment in posterior.experiments if posterior else ():
        sizes = {
            term: sum(v.size for v in (term.reads or {}).values())
            for term in experiment.terms
        }
        for term, size in sizes.items():
            names = {*map(experiment.full_name, term.observed), term.discrepancy}
            for other, more in sizes.items():
                claims = other.discrepancy and other.discrepancy not in missed
                if names & {*missed} and claims and more >= OUTVOTED * size:
                    yield (
                        f"The {more} values of {other.name!r} outvote the {size} of "
                        f"{term.name!r}, since their error is inferred: give "
                        f"{other.name!r} known standard deviations (sd=), or a fixed "
                        "delta."
                    )
