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
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from itertools import product
from math import comb
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from ..contracts import Batch, Floats, Variable
from ..likelihoods.residuals import (
    EXPERIMENT,
    FITS,
    MISFIT,
    MODE,
    NOT_JUDGED,
    RESEMBLES_NONE,
    SENSOR,
    SKIPPED,
    TERM,
    FitRecord,
    Residuals,
)
from ..likelihoods.term import Term
from ..posterior.experiments import Experiment
from ..posterior.log_posterior import LogPosterior
from ..sampling.importance import resample
from ..sampling.judge import spread_out
from .measured import INTERVAL

# Samples that are solved again where a term reads what is not stored, as shapes.
SOLVED_AGAIN = 8
ENOUGH_STORED = 1_000  # samples where nothing is solved
FALSE_ALARM = 0.01  # of a right test, over all groups that are looked at
# chi^2 by its expectation below which a misfit does not matter: errors 10 % too small,
# which thousands of data would show.
MATTERS = 1.2
LEAST_SIZE = 0.1  # degrees of freedom, for a sensor that alone makes up a shape
NEARLY_ALL = 0.9  # of the samples
LOW_MAC = 0.5  # below it two shapes have little in common
STANDS_OUT = 4.0  # times the next largest 1 - MAC, for a mode that resembles none
SKIP_BETTER = 9.0  # times smaller squared errors: a third of the errors
# Chance of a share of a term's chi^2; larger ones say nothing of where data are off.
NOTABLE = 0.05
FEWEST_FOR_PAIRS = 4  # groups of which two may be off together

WORDS = {"dof": SENSOR}  # for dimensions
AND = " and "


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
    again, the first time only.

    Args:
        posterior: What was sampled.
        theta: Samples ``(n, d)``.
        rows: Their rows, ``(n, columns)``.
        initial: The row at the prior mean.
        weights: Of the samples, if these are not equal, ``(n,)``.
        solves: How many samples may be solved.
    """
    rng, order = np.random.default_rng(0), np.arange(len(theta))
    if weights is not None:
        order = resample(weights, ENOUGH_STORED, 0.5)
    many = rng.permutation(order)[:ENOUGH_STORED]
    few = theta[np.unique(many)[spread_out(len(np.unique(many)), solves)]]
    some = theta[many], posterior.unfold(rows[many])
    found: list[FitRecord] = []
    for experiment in posterior.experiments:
        found += _judge_experiment(posterior, experiment, some, few)
    looks = sum(np.isfinite(record.p) for record in found)
    found = [_settle(record, looks) for record in found]
    whole, start = posterior.unfold(rows[order]), posterior.unfold(initial)
    for experiment in posterior.experiments:
        stored, before = (_own(experiment, all_of) for all_of in (whole, start))
        found = _judge_modes(experiment, stored, found)
        found += _find_skipped(experiment, stored, before, found)
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


def _own(experiment: Experiment, values: Batch) -> Batch:
    """Return the stored variables of an experiment by their own names."""
    return {name: values[experiment.full_name(name)] for name in experiment.variables}


def _judge_experiment(
    posterior: LogPosterior,
    experiment: Experiment,
    some: tuple[Floats, Batch],
    few: Floats,
) -> Iterator[FitRecord]:
    """Yield the records of all terms, and of all data if there are other experiments.

    Args:
        posterior: What was sampled.
        experiment: One of its experiments.
        some: Samples ``(n, d)``, and all stored variables there.
        few: The samples that may be solved.
    """
    stored = some[0], _own(experiment, some[1])
    sums = list[_Sum]()
    for term, name in zip(experiment.terms, experiment.term_names, strict=True):
        record = FitRecord(
            FITS,
            experiment.name,
            name,
            TERM,
            variable=", ".join(map(experiment.full_name, term.observed)),
            paired=experiment.paired is not None,
        )
        try:
            residuals = _find_residuals(posterior, experiment, term, stored, few)
        except Exception as error:  # of any kind: it is the user's model or term
            residuals = f"it raised {error!r}"
        if isinstance(residuals, Residuals):
            judged, whole = _judge_term(record, experiment, term, residuals, stored[1])
            yield from judged
            sums.append(whole)
        elif residuals:
            yield replace(record, status=NOT_JUDGED, reason=residuals)
    if len(posterior.experiments) > 1 and sums:
        all_data = _Sum(*map(sum, zip(*sums, strict=True)))
        record = FitRecord(FITS, experiment.name, "", EXPERIMENT)
        yield _test(record, all_data, None, False)


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
        return "" if drawn else "it has no deviations"
    if not _is_stored(experiment, term):
        theta, held = few, posterior.answer(few, experiment)
    residuals = term.residuals(posterior.parameters(theta), held)
    if residuals is None or len(theta) < 2:
        return "it has no deviations" if residuals is None else "there is one sample"
    if not np.isfinite(residuals.independent).all():
        return "its deviations are not finite"
    return residuals


def _add_up(z: Floats, freedom: Floats) -> _Sum:
    """Return the chi^2 of residuals ``(n, k)`` with degrees of freedom ``(k,)``."""
    return _Sum(float((z**2).sum(axis=1).mean()), float(freedom.sum()))


def _test(record: FitRecord, part: _Sum, whole: _Sum | None, share: bool) -> FitRecord:
    """Return a record with chi^2 and its chance, or that of its share of the whole."""
    law = stats.chi2(part.size)
    (low, high), p, p_share = law.ppf(INTERVAL), float(law.sf(part.chi2)), np.nan
    if whole is not None and whole.chi2 > 0 and part.size < whole.size:
        of_whole = stats.beta(part.size / 2, (whole.size - part.size) / 2)
        p_share = float(of_whole.sf(min(part.chi2 / whole.chi2, 1.0)))
        if share:
            (low, high), p = whole.chi2 * of_whole.ppf(INTERVAL), p_share
    return replace(
        record,
        chi2=part.chi2,
        size=part.size,
        low=float(low),
        high=float(high),
        p=p,
        p_share=p_share,
    )


def _judge_term(
    record: FitRecord,
    experiment: Experiment,
    term: Term,
    residuals: Residuals,
    stored: Batch,
) -> tuple[list[FitRecord], _Sum]:
    """Return the records of a term and of its groups, and the term's sums."""
    z, freedom, mac = residuals.by_datum, residuals.freedom, residuals.mac
    by_datum = z is residuals.independent
    whole = _add_up(z, freedom)
    total = whole
    if not by_datum:
        ones = np.ones(residuals.independent.shape[1])
        total = _add_up(residuals.independent, ones)
    found = [_test(record, total, None, False)]
    if mac is not None and "mac" in stored:
        mac = stored["mac"]
    for dim, labels in (residuals.places or _place(experiment, term, z)).items():
        kind = WORDS.get(dim, dim.replace("_", " "))
        groups = {str(k): labels == k for k in dict.fromkeys(labels.tolist())}
        if len(groups) < 2:
            continue
        sums = {k: _add_up(z[:, mask], freedom[mask]) for k, mask in groups.items()}
        judged = []
        for k, part in sums.items():
            group = replace(record, kind=kind, label=k)
            group = _test(group, part, whole, residuals.inferred)
            if kind == MODE and mac is not None:
                mean = float(mac[:, int(k) - 1].mean())
                expected = 1 - (1 - mean) * part.size / max(part.chi2, part.size)
                group = replace(group, mac=mean, mac_expected=expected)
            judged.append(group)
        found += judged
        if len(groups) >= FEWEST_FOR_PAIRS:
            found += _judge_pair(judged, groups, (z, freedom), whole, residuals)
    return found, total


def _judge_pair(
    judged: Sequence[FitRecord],
    groups: Mapping[str, NDArray[np.bool_]],
    data: tuple[Floats, Floats],
    whole: _Sum,
    residuals: Residuals,
) -> Iterator[FitRecord]:
    """Yield the two farthest groups together, if these are farther than any one."""
    first, second = sorted(judged, key=by_share)[:2]
    z, freedom = data
    mask = groups[first.label] | groups[second.label]
    label = AND.join(k for k in groups if k in (first.label, second.label))
    both = replace(first, label=label, mac=np.nan, mac_expected=np.nan)
    both = _test(both, _add_up(z[:, mask], freedom[mask]), whole, residuals.inferred)
    pairs = comb(len(groups), 2)
    both = replace(both, p=min(1.0, pairs * both.p), p_share=pairs * both.p_share)
    if both.p_share < first.p_share * len(groups):
        yield both


def by_share(record: FitRecord) -> tuple[float, float]:
    """Return what sorts groups of a term, the farthest out first."""
    p = record.p_share if np.isfinite(record.p_share) else 1.0
    return p, -record.chi2 / max(record.size, LEAST_SIZE)


def _settle(record: FitRecord, looks: int) -> FitRecord:
    """Return a record whose chance counts all that was looked at."""
    if not np.isfinite(record.p):
        return record
    p = min(1.0, looks * record.p)
    off = p < FALSE_ALARM and record.chi2 > MATTERS * record.size
    return replace(record, p=p, status=MISFIT if off else FITS)


def _place(
    experiment: Experiment, term: Term, z: Floats
) -> dict[str, NDArray[np.object_]]:
    """Return labels of a term's data by dimension; empty if there are not as many."""
    names = [*(term.observed or term.reads or ())]
    if len(names) != 1:
        return {}
    (name,) = names
    returned = experiment.variables.get(name, Variable({}))
    variable = (term.reads or {}).get(name) or returned
    shape = variable.shape
    if name in term.observed:
        shape = np.shape(term.observed[name])
    while len(shape) > 1 and int(np.prod(shape)) > z.shape[1]:
        shape = shape[:-1]  # of amplitudes: no real and imaginary parts
    if int(np.prod(shape)) != z.shape[1] or len(shape) > len(variable.dims):
        return {}
    axes = {}
    for size, (dim, labels) in zip(shape, variable.coords.items(), strict=False):
        of_model = returned.coords.get(dim, ())
        known = of_model if None in labels and len(of_model) >= size else labels
        axes[dim] = [*known][:size] if None not in known else [*range(1, size + 1)]
    every = np.array([*product(*axes.values())], dtype=object)
    return {dim: every[:, i] for i, dim in enumerate(axes)}


def _judge_modes(
    experiment: Experiment, stored: Batch, found: Sequence[FitRecord]
) -> list[FitRecord]:
    """Return the records with measured modes marked that resemble none of the model's.

    Where no shapes are compared those of a :class:`.PairedModel` are, by its limit.
    """
    own = [r for r in found if r.experiment == experiment.name]
    others = [r for r in found if r.experiment != experiment.name]
    shaped = [r for r in own if r.kind == MODE and np.isfinite(r.mac)]
    if not shaped:
        return [*others, *own, *_judge_unpaired(experiment, stored)]
    lost = 1 - np.array([r.mac for r in shaped])
    unlike = [i for i, r in enumerate(shaped) if r.mac < LOW_MAC]
    worst = int(lost.argmax())
    if len(shaped) == 1 or lost[worst] > STANDS_OUT * np.sort(lost)[-2]:
        unlike.append(worst)
    by_sensor = [by_share(r)[0] for r in own if r.kind == SENSOR]
    marked = {
        id(shaped[i])
        for i in {*unlike}
        if shaped[i].status == MISFIT
        and 2 * len({*unlike}) <= max(len(shaped), 2)
        and by_share(shaped[i])[0] <= min(by_sensor, default=1.0)
    }
    own = [replace(r, status=RESEMBLES_NONE) if id(r) in marked else r for r in own]
    return [*others, *own]


def _judge_unpaired(experiment: Experiment, stored: Batch) -> Iterator[FitRecord]:
    """Yield measured modes of a :class:`.PairedModel` that are not paired."""
    paired = experiment.paired
    if paired is None:
        return
    shares = (stored["mac"] < paired.min_mac).mean(axis=0)
    unlike = np.flatnonzero(shares > NEARLY_ALL)
    few = 2 * len(unlike) <= max(len(shares), 2)
    record = FitRecord(RESEMBLES_NONE if few else MISFIT, experiment.name, "", MODE)
    for i in unlike:
        mac = float(stored["mac"][:, i].mean())
        yield replace(record, label=str(i + 1), mac=mac, mac_expected=paired.min_mac)


def _find_skipped(
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
    for predicted in (stored["frequency"].mean(axis=0), before["frequency"]):
        if len(predicted) <= m or not (predicted > 0).all() or not (off or inferred):
            continue
        apart = np.log(predicted[:, None] / measured[0]) ** 2
        squares = [
            apart[np.delete(np.arange(m + 1), j), np.arange(m)].sum()
            for j in range(m + 1)
        ]  # the last one leaves none out
        j = int(np.argmin(squares))
        if SKIP_BETTER * squares[j] < squares[m]:
            yield FitRecord(SKIPPED, experiment.name, "", MODE, str(j + 1))
            return


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
