r"""What the samples say of the data: chi^2 by term, experiment, mode, sensor, channel.

A Gaussian term has n residuals z over their standard deviations. Of a right model that
is linear near the posterior, the mean of :math:`\chi^2 = \sum z^2` over the samples is
:math:`h + s`: h, by which the samples scatter, is at most the number of parameters that
follow these data, and s is a sum of squares of mean n - h with weights of at most 1.
Its upper quantiles are below those of :math:`\chi^2_n`, with which it is compared: a
right test raises fewer alarms than stated.

An inferred error absorbs a misfit. Its share of the term's chi^2 still tells whether a
group of k data is off: without fitted parameters it has the law Beta(k / 2, (n - k) /
2) whatever the error is, and parameters that follow the data make large shares rarer.
"""

import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict, replace
from itertools import combinations, product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from ..contracts import LOG_POSTERIOR, Batch, Floats, Variable
from ..likelihoods.residuals import (
    EXPERIMENT,
    FITS,
    MISFIT,
    MODE,
    NOT_JUDGED,
    SENSOR,
    TERM,
    FitRecord,
    Residuals,
)
from ..likelihoods.term import Term
from ..posterior.experiments import Experiment
from ..posterior.log_posterior import LogPosterior
from ..posterior.priors import prior_centre
from ..search.importance import resample
from ..verdict.statistics import spread_out
from .fit_modes import (
    find_skipped,
    find_suspects,
    judge_modes,
    judge_pairing,
    judge_places,
)
from .measured import INTERVAL

# Samples that are solved again where a term reads what is not stored, as shapes.
SOLVED_AGAIN = 8
ENOUGH_STORED = 1_000  # samples where nothing is solved
MISFIT_BY_CHANCE = 0.01  # of a right test, over all groups that are looked at
# chi^2 over what a right model gives, up to which no misfit is reported: that of stated
# errors 10 % too small. Of thousands of data even that would be more than chance.
MATTERS = 1.2
# Chance of a share of a term's chi^2; larger ones say nothing of where data are off.
NOTABLE = 0.05
NO_CHI2 = 1e-12
NO_RESIDUALS = "it has no deviations, and so does not say what was measured"

WORDS = {"dof": SENSOR}  # for dimensions


class _Sum(NamedTuple):
    """chi^2 of some data, mean over the samples, and its expectation."""

    chi2: float
    size: float


def judge_data(
    posterior: LogPosterior,
    theta: Floats,
    rows: Floats,
    initial: Floats,
    weights: Floats | None = None,
    solves: int = SOLVED_AGAIN,
) -> tuple[FitRecord, ...]:
    """Return what samples say of each term, its groups of data, and each experiment.

    Terms that read stored variables take no solve. For others some samples are solved
    again, and where shapes do not fit, sensors are suspected as by :func:`.check_test`
    at the prior mean and the best sample; both the first time only.

    Args:
        posterior: What was sampled.
        theta: Samples ``(n, d)``.
        rows: Their rows, ``(n, columns)``.
        initial: The row at the prior mean.
        weights: Of the samples, if these are not equal, ``(n,)``; then no sensor is
            suspected, for that takes solves which are not counted.
        solves: How many samples may be solved.
    """
    rng, order = np.random.default_rng(0), np.arange(len(theta))
    if weights is not None:
        order = resample(weights, ENOUGH_STORED, 0.5)
    many = rng.permutation(order)[:ENOUGH_STORED]
    few = theta[np.unique(many)[spread_out(len(np.unique(many)), solves)]]
    some = theta[many], posterior.unfold(rows[many])
    start = prior_centre(posterior.prior)[None], posterior.unfold(initial[None])
    found: list[FitRecord] = []
    for experiment in posterior.experiments:
        found += _judge_experiment(posterior, experiment, some, few, start)
    looks = sum(np.isfinite(record.p) for record in found)
    found = [_settle(record, looks) for record in found]
    whole = posterior.unfold(rows[order])
    parts = [
        (experiment, experiment.stored(whole), experiment.stored(start[1]))
        for experiment in posterior.experiments
    ]
    for part in parts:
        found += judge_pairing(*part, found)
    if weights is None:
        found += find_suspects(posterior, theta[rows[:, LOG_POSTERIOR].argmax()], found)
    for part in parts:
        found = judge_modes(part[0], found)
        found = judge_places(*part, found)
        found += find_skipped(*part, found)
    return tuple(found)


def needs_solves(posterior: LogPosterior) -> bool:
    """Return whether a term reads what is not stored with the samples."""
    return any(
        term.gaussian and not _is_stored(experiment, term)
        for experiment in posterior.experiments
        for term in experiment.terms
    )


def _is_stored(experiment: Experiment, term: Term) -> bool:
    return term.reads is not None and {*term.reads} <= {*experiment.variables}


def _judge_experiment(
    posterior: LogPosterior,
    experiment: Experiment,
    some: tuple[Floats, Batch],
    few: Floats,
    start: tuple[Floats, Batch],
) -> Iterator[FitRecord]:
    """Yield the records of all terms, and of all data if there are other experiments.

    Args:
        posterior: What was sampled.
        experiment: One of its experiments.
        some: Samples ``(n, d)``, and all stored variables there.
        few: The samples that may be solved.
        start: The prior mean ``(1, d)``, and all stored variables there.
    """
    stored, initial = ((at, experiment.stored(held)) for at, held in (some, start))
    sums = list[_Sum]()
    for term, name in zip(experiment.terms, experiment.term_names, strict=True):
        record = FitRecord(
            status=FITS,
            experiment=experiment.name,
            term=name,
            kind=TERM,
            error=term.discrepancy or "",
            variable=", ".join(map(experiment.full_name, term.observed)),
            paired=experiment.paired is not None,
        )
        try:
            residuals = _find_residuals(posterior, experiment, term, stored, few)
        except Exception as error:  # of any kind: it is the user's model or term
            residuals = f"it raised {error!r}"
        if isinstance(residuals, Residuals):
            try:
                before = _find_residuals(posterior, experiment, term, initial, start[0])
            except Exception:  # there the model or the term may fail
                before = ""
            both = [r for r in (residuals, before) if isinstance(r, Residuals)]
            judged, whole = _judge_term(record, experiment, term, both, stored[1])
            yield from judged
            sums.append(whole)
        elif residuals:
            yield replace(record, status=NOT_JUDGED, reason=residuals)
    if len(posterior.experiments) > 1 and sums:
        all_data = _Sum(*map(sum, zip(*sums, strict=True)))
        record = FitRecord(
            status=FITS, experiment=experiment.name, term="", kind=EXPERIMENT
        )
        yield _test(record, all_data)


def _find_residuals(
    posterior: LogPosterior,
    experiment: Experiment,
    term: Term,
    stored: tuple[Floats, Batch],
    few: Floats,
) -> Residuals | str:
    """Return a term's residuals, or why there are none; empty if it draws replicates.

    Args:
        posterior: What was sampled.
        experiment: That of the term.
        term: The term.
        stored: Samples ``(n, d)``, and the stored variables there.
        few: The samples that may be solved.
    """
    theta, held = stored
    if not term.gaussian:
        drawn = term.replicate(
            np.random.default_rng(0), posterior.parameters(theta), held
        )
        return "" if drawn else NO_RESIDUALS
    if not _is_stored(experiment, term):
        theta, held = few, posterior.answer(few, experiment)
    residuals = term.residuals(posterior.parameters(theta), held)
    if residuals is None:
        return NO_RESIDUALS
    if not np.isfinite(residuals.independent).all():
        return "its deviations are not finite"
    return residuals


def _add_up(residuals: Residuals, which: NDArray[np.bool_]) -> _Sum:
    r"""Return the chi^2 of some data ``(k,)``.

    Of a shape whose model's is scaled to fit, it is what chi^2 falls by if these
    sensors S are left out, :math:`e_S^T (I - \phi_S \phi_S^T)^{-1} e_S`: a sensor that
    is far off, and draws the scale after it, is seen whole.
    """
    z = residuals.by_datum[:, which]
    chi2, size = (z**2).sum(axis=1), float(which.sum())
    if residuals.shapes is not None:
        phi, modes = residuals.shapes.fitted[:, which], residuals.places[MODE]
        for mode in dict.fromkeys(modes[which].tolist()):
            part = modes[which] == mode
            if part.sum() == (modes == mode).sum():
                size -= 1
                continue
            left = 1 - (phi[:, part] ** 2).sum(axis=1)
            along = (phi[:, part] * z[:, part]).sum(axis=1)
            chi2 = chi2 + along**2 / np.maximum(left, NO_CHI2)
    return _Sum(float(chi2.mean()), size)


def _test(record: FitRecord, part: _Sum) -> FitRecord:
    """Return a record with the chi^2 of some data, and its chance."""
    law = stats.chi2(part.size)
    low, high = law.ppf(INTERVAL).tolist()
    p = float(law.sf(part.chi2))
    return replace(record, chi2=part.chi2, size=part.size, low=low, high=high, p=p)


def _test_share(
    record: FitRecord, sets: Sequence[Residuals], which: NDArray[np.bool_]
) -> FitRecord:
    """Return a record of a group, with the chance of its share of the term's chi^2.

    Parameters that follow wrong data make others wrong. Where they stood before, at the
    prior mean, the group that is off may be seen better: the clearer of both counts.
    """
    every = np.ones(len(which), dtype=bool)
    parts = [_add_up(residuals, which) for residuals in sets]
    wholes = [_add_up(residuals, every) for residuals in sets]
    record, shares = _test(record, parts[0]), list[tuple[float, float]]()
    k, n = parts[0].size, wholes[0].size
    if not 0 < k < n:
        return record
    law = stats.beta(k / 2, (n - k) / 2)
    for part, whole in zip(parts, wholes, strict=True):
        share = min(part.chi2 / max(whole.chi2, NO_CHI2), 1.0)
        shares.append((float(law.sf(share)), -share))
    if sets[0].inferred:
        low, high = (wholes[0].chi2 * law.ppf(INTERVAL)).tolist()
        record = replace(record, low=low, high=high, p=shares[0][0])
    p_share, share = min(shares)
    return replace(record, p_share=p_share, share=-share)


def _judge_term(
    record: FitRecord,
    experiment: Experiment,
    term: Term,
    sets: Sequence[Residuals],
    stored: Batch,
) -> tuple[list[FitRecord], _Sum]:
    """Return the records of a term and of its groups, and the term's sum.

    Args:
        record: What is known of the term.
        experiment: That of the term.
        term: The term.
        sets: Its residuals at the samples and, where it has some, at the prior mean.
        stored: The stored variables at the samples.
    """
    residuals = sets[0]
    total = _add_up(residuals, np.ones(residuals.by_datum.shape[1], dtype=bool))
    if residuals.by_datum is not residuals.independent:
        independent = residuals.independent
        total = _Sum(float((independent**2).sum(axis=1).mean()), independent.shape[1])
    found = [_test(record, total)]
    places = residuals.places or _place(experiment, term, residuals.by_datum)
    for dim, labels in places.items():
        kind = WORDS.get(dim, dim.replace("_", " "))
        groups = {_as_label(k): labels == k for k in dict.fromkeys(labels.tolist())}
        if len(groups) < 2:
            continue
        of_kind = replace(record, kind=kind)
        found += [
            _test_share(replace(of_kind, label=label), sets, mask)
            for label, mask in groups.items()
        ]
    if residuals.shapes is not None:
        found = _add_mac(found, sets, stored)
    return found, total


def _add_mac(
    found: Sequence[FitRecord], sets: Sequence[Residuals], stored: Batch
) -> list[FitRecord]:
    """Return records whose modes have their MAC."""
    now, before = (r.shapes.mac.mean(axis=0) for r in (sets[0], sets[-1]) if r.shapes)
    now = stored["mac"].mean(axis=0) if "mac" in stored else now
    complete = []
    for record in found:
        if record.kind == MODE:
            i = int(record.label) - 1
            mac = float(now[i])
            expected = 1 - (1 - mac) * record.size / max(record.chi2, record.size)
            record = replace(
                record,
                mac=mac,
                mac_expected=expected,
                mac_before=float(before[i]),
            )
        complete.append(record)
    return complete


def by_share(record: FitRecord) -> tuple[float, float]:
    """Return what sorts groups of a term, the farthest out first."""
    return (
        (record.p_share, -record.share) if np.isfinite(record.p_share) else (1.0, 0.0)
    )


def _settle(record: FitRecord, looks: int) -> FitRecord:
    """Return a record whose chance counts all that was looked at."""
    if not np.isfinite(record.p):
        return record
    p = float(min(1.0, looks * record.p))
    off = p < MISFIT_BY_CHANCE and record.chi2 > MATTERS * record.size
    return replace(record, p=p, status=MISFIT if off else FITS)


def _as_label(place: object) -> str:
    return f"{place:.6g}" if isinstance(place, float) else str(place)


def _place(
    experiment: Experiment, term: Term, z: Floats
) -> dict[str, NDArray[np.object_]]:
    """Return labels of a term's deviations by dimension; empty where that is unknown.

    If there are fewer deviations than data, as of amplitudes, which have no real and
    imaginary parts, they belong to as many axes of the data as have their number, the
    first ones of several.
    """
    names = [*(term.observed or term.reads or ())]
    if len(names) != 1:
        return {}
    (name,) = names
    returned = experiment.variables.get(name, Variable({}))
    variable = (term.reads or {}).get(name) or returned
    shape = variable.shape
    if name in term.observed:
        shape = np.shape(term.observed[name])
    kept = next(
        (
            axes
            for count in range(len(shape), 0, -1)
            for axes in combinations(range(len(shape)), count)
            if int(np.prod([shape[axis] for axis in axes])) == z.shape[1]
        ),
        (),
    )
    labels = [*variable.coords.items()]
    if not kept or kept[-1] >= len(labels):
        return {}
    axes = {}
    for size, (dim, of_term) in ((shape[axis], labels[axis]) for axis in kept):
        of_model = returned.coords.get(dim, ())
        known = of_model if None in of_term and len(of_model) >= size else of_term
        axes[dim] = [*known][:size] if None not in known else [*range(1, size + 1)]
    every = np.array([*product(*axes.values())], dtype=object)
    return {dim: every[:, i] for i, dim in enumerate(axes)}


def find_farthest(records: Sequence[FitRecord]) -> list[FitRecord]:
    """Return the groups of a term that have more of its chi^2 than by chance.

    The farthest of each kind, such as a mode and a sensor, the clearest first.
    """
    kinds = dict.fromkeys(r.kind for r in records if r.kind not in (TERM, EXPERIMENT))
    best = [min((r for r in records if r.kind == kind), key=by_share) for kind in kinds]
    return sorted((r for r in best if by_share(r)[0] < NOTABLE), key=by_share)


def write_records(records: Sequence[FitRecord]) -> str:
    """Return records as text that an ArviZ object can store."""
    return json.dumps([asdict(record) for record in records])


def read_records(text: str) -> tuple[FitRecord, ...]:
    """Return the records that were written."""
    return tuple(FitRecord(**fields) for fields in json.loads(text))
