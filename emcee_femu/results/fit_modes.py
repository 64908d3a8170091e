"""Spurious modes, modes that were not measured, and suspect sensors."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import chain

import numpy as np

from ..contracts import Batch, Floats
from ..likelihoods.residuals import (
    ELSEWHERE,
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
from ..posterior.experiments import Experiment
from ..posterior.log_posterior import LogPosterior
from ..posterior.priors import prior_centre
from ..posterior.sensors import suspect_sensors

NEARLY_ALL = 0.9  # of the samples
UNLIKE = 0.5  # a MAC below which two shapes have little in common
WRONG = 1.5  # times what was measured, or its inverse: more than a model's error
SKIP_BETTER = 9.0  # times smaller squared errors: a third of the errors
AND, EACH = " and ", "each"


def judge_modes(experiment: Experiment, found: Sequence[FitRecord]) -> list[FitRecord]:
    """Return the records with measured modes marked that resemble none of the model's.

    Where a sensor is suspected, modes are not: it makes several of them unlike.
    """
    own = [r for r in found if r.experiment == experiment.name]
    others = [r for r in found if r.experiment != experiment.name]
    suspect = any(r.status == SUSPECT for r in own)
    if suspect:
        own = [
            replace(r, status=MISFIT) if r.status == RESEMBLES_NONE else r for r in own
        ]
    shaped = [r for r in own if r.kind == MODE and r.term and np.isfinite(r.mac)]
    # Parameters that follow a spurious mode make others unlike: the prior mean tells.
    wrong = any(r.status == MISFIT or r.mac < UNLIKE for r in shaped)
    unlike = {id(r) for r in shaped if wrong and r.mac_before < UNLIKE}
    # Many modes are unlike if the whole test is.
    if suspect or 2 * len(unlike) > max(len(shaped), 2):
        unlike.clear()
    own = [replace(r, status=RESEMBLES_NONE) if id(r) in unlike else r for r in own]
    return [*others, *own]


def judge_pairing(
    experiment: Experiment, stored: Batch, before: Batch, found: Sequence[FitRecord]
) -> Iterator[FitRecord]:
    """Yield measured modes of a :class:`.PairedModel` that are not paired.

    By its limit, and only where no term compares shapes.
    """
    paired, own = experiment.paired, (r for r in found if np.isfinite(r.mac))
    if paired is None or any(r.experiment == experiment.name for r in own):
        return
    if not paired.by_reference:
        yield FitRecord(
            status=NOT_JUDGED,
            experiment=experiment.name,
            term="measured shapes",
            kind=TERM,
            reason="they pair modes, and no ShapeTerm compares them",
        )
    shares = (stored["mac"] < paired.min_mac).mean(axis=0)
    unlike = np.flatnonzero(shares > NEARLY_ALL)
    # Parameters that follow a spurious mode make others unlike.
    spurious = np.flatnonzero(
        (shares > NEARLY_ALL) & ~(before["mac"][0] > paired.min_mac)
    )
    unlike = spurious if len(spurious) else unlike
    few = 2 * len(unlike) <= max(len(shares), 2)
    status = RESEMBLES_NONE if few else MISFIT
    record = FitRecord(status=status, experiment=experiment.name, term="", kind=MODE)
    for i in unlike:
        mac = float(stored["mac"][:, i].mean())
        yield replace(record, label=str(i + 1), mac=mac, mac_expected=paired.min_mac)


def judge_places(
    experiment: Experiment, stored: Batch, before: Batch, found: Sequence[FitRecord]
) -> list[FitRecord]:
    """Return the records, and one of a measured mode whose frequency no mode has.

    Its shape pairs it with a mode of quite another frequency, while the others are
    near their own. A spurious mode may take the partner of a good one, and parameters
    follow both: if one of them is spurious, it is the least like its partner of all
    modes, at the prior mean. Else it may be the model that is wrong.
    """
    own = [r for r in found if r.experiment == experiment.name]
    paired = experiment.paired
    named = any(r.status in (SUSPECT, RESEMBLES_NONE) for r in own)
    if paired is None or paired.by_reference or named:
        return [*found]
    off = [
        np.abs(ratios - np.median(ratios)) > np.log(WRONG)
        for frequencies in (before["frequency"][0], stored["frequency"].mean(axis=0))
        for ratios in (np.log(frequencies / paired.measurements.frequencies),)
    ]
    if not all(each.any() for each in off):  # or the updated model explains it
        return [*found]
    mac = before["mac"][0]
    least = int(np.argmin(mac))
    i = least if off[0][least] else int(np.flatnonzero(off[0])[0])
    ratio = before["frequency"][0, i] / paired.measurements.frequencies[i]
    reason = f"is like a mode of {ratio:.3g} times its frequency"
    record = FitRecord(
        status=RESEMBLES_NONE if i == least else ELSEWHERE,
        experiment=experiment.name,
        term="",
        kind=MODE,
        label=str(i + 1),
        mac_before=float(mac[i]),
        reason="" if mac[i] < UNLIKE else reason,
    )
    return [*found, record]


def find_skipped(
    experiment: Experiment, stored: Batch, before: Batch, found: Sequence[FitRecord]
) -> Iterator[FitRecord]:
    """Yield a mode of the model that was not measured, where their order matters.

    Without it the others agree far better, at the samples or at the prior mean.
    """
    observed = [term.observed for term in experiment.terms]
    measured = [by_name["frequency"] for by_name in observed if "frequency" in by_name]
    if experiment.paired is not None or "frequency" not in stored or not measured:
        return
    off = any(r.status == MISFIT for r in found if r.experiment == experiment.name)
    inferred = any(t.discrepancy for t in experiment.terms)
    m = len(measured[0])
    for predicted in (stored["frequency"].mean(axis=0), before["frequency"][0]):
        if len(predicted) <= m or not (predicted > 0).all() or not (off or inferred):
            continue
        apart = np.log(predicted[:, None] / measured[0]) ** 2
        squares = [
            apart[np.delete(np.arange(m + 1), j), np.arange(m)].sum()
            for j in range(m + 1)
        ]  # the last one leaves none out
        j = int(np.argmin(squares))
        if SKIP_BETTER * squares[j] < squares[m]:
            yield FitRecord(
                status=SKIPPED,
                experiment=experiment.name,
                term="",
                kind=MODE,
                label=str(j + 1),
            )
            return


def find_suspects(
    posterior: LogPosterior, best: Floats, found: Sequence[FitRecord]
) -> Iterator[FitRecord]:
    """Yield sensors that explain shapes which do not fit; ``best`` is a sample."""
    shaped = {(r.experiment, r.term) for r in found if np.isfinite(r.mac)}
    off = {
        r.experiment
        for r in found
        if r.status == RESEMBLES_NONE
        or (
            r.status == MISFIT
            and (r.kind == SENSOR or (r.experiment, r.term) in shaped)
        )
    }
    if not off:
        return
    theta = np.array([prior_centre(posterior.prior), best])
    try:
        suspects, _ = posterior.remember(
            SUSPECT, theta, lambda: suspect_sensors(posterior, theta)
        )
    except Exception as error:  # of any kind: it is the user's model
        reason = f"it raised {error!r}"
        yield FitRecord(NOT_JUDGED, "", "sensors", SENSOR, reason=reason)
        return
    named = {suspect.experiment for suspect in chain.from_iterable(suspects)}
    for name in sorted(off - named):
        yield FitRecord(NONE_SUSPECT, name, "", SENSOR, EACH)
    for suspect in chain.from_iterable(suspects):
        if suspect.experiment in off:
            yield FitRecord(
                SUSPECT,
                suspect.experiment,
                "",
                SENSOR,
                AND.join(suspect.sensors),
                mac=suspect.after,
                mac_before=suspect.before,
                reason=str(suspect),
            )
