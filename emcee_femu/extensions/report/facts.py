"""What the first page of a report says of model, result and trust, in words."""

import re
from collections.abc import Iterator, Sequence

import numpy as np

from ...contracts import Floats, read_declared
from ...likelihoods.residuals import FITS
from ...posterior.experiments import Experiment
from ...posterior.log_posterior import LogPosterior
from ...posterior.priors import prior_centre
from ...results.arviz_objects import (
    InferenceData,
    groups,
    prior_constants,
    samples,
    unit_of,
)
from ...results.fit_statement import DOES_NOT_FIT, NOT_CHECKED
from ...results.measured import Measured
from ...results.shapes import solve_shapes
from ...results.tables import summarize
from ...table import Column, Table, number_columns
from ...verdict.diagnosis import CONVERGED, NOT_CONVERGED, Diagnosis

TELLING = 2  # mode shapes on the first page
WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[^A-Z]+")  # of a class: FRFModel has two
TRANSLATION = re.compile(r"(.+):u([xyz])")
MOST_LISTED = 12  # sensors or supports, of which each is named


def tabulate_result(idata: InferenceData) -> Table:
    """Tabulate each parameter before and after as mean ± standard deviation."""
    names, chains = samples(idata)
    draws = chains.reshape(-1, len(names))
    mean, low, high = summarize(draws)
    sd, prior = draws.std(axis=0, ddof=1), prior_constants(idata, names)
    before = prior["prior_sd"].values
    units = [unit_of(idata, name) for name in names]
    _, numbers = number_columns(
        units,
        [
            ("before", prior["prior_mean"].values, before),
            ("its sd", before, before),
            ("after", mean, sd),
            ("sd", sd, sd),
            ("low", low, sd),
            ("high", high, sd),
        ],
    )
    unit, _ = number_columns(units, [("after", mean, sd)])
    shown = [column[1] for column in unit] or [[""] * len(names)]
    known = groups(idata)
    rows = [
        [f"{b} ± {s}" if b and s else "", f"{m} ± {e}", f"{lo} to {hi}"]
        for b, s, m, e, lo, hi in zip(*(c[1] for c in numbers), strict=True)
    ]
    first, after, ends = zip(*rows, strict=True)
    columns: list[Column] = [("parameter", "", names)]
    columns += [("before the test", "", first)] if "constant_data" in known else []
    columns += [("after the test", "", after), ("95 % interval", "", ends)]
    columns += [("unit", "", list(shown[0]))] if any(units) else []
    return Table.from_columns("Result: mean ± standard deviation", columns)


def say_trust(diagnosis: Diagnosis, measured: Sequence[Measured]) -> str:
    """Return in one plain sentence whether runs, data and search support the result."""
    count, status = len(diagnosis.acceptance), diagnosis.chains.status
    against, parts = list[str](), [diagnosis.chains.short]
    if status == CONVERGED:
        parts = [f"{count} independent runs agree"]
    elif status == NOT_CONVERGED:
        against, parts = [f"the runs have {status}"], []
    if diagnosis.fit.status == DOES_NOT_FIT:
        against.append(f"the model does not fit the test ({diagnosis.fit.short})")
    elif diagnosis.fit.status not in (FITS, NOT_CHECKED):
        parts.append(f"doubts remain ({diagnosis.fit.short}), which stand below")
    if against:
        parts.insert(0, f"do not use these numbers yet: {' and '.join(against)}")
    judged = [part for part in measured if part.replicated is not None]
    if judged:
        inside = sum(int(part.inside.sum()) for part in judged)
        total = sum(len(part.values) for part in judged)
        parts.append(f"the model reproduces {inside} of {total} measured values")
    maxima = 0 if diagnosis.maxima is None else diagnosis.maxima.held
    found = {0: "no second solution was looked for", 1: "no second solution was found"}
    parts.append(found.get(maxima, f"{maxima} different solutions were found"))
    text = "; ".join(parts)
    return f"{text[:1].upper()}{text[1:]}."


def choose_telling(
    measured: Sequence[Measured],
    posterior: LogPosterior,
    experiment: Experiment,
    theta: Floats,
) -> list[int]:
    """Return the modes, from 1, whose frequencies updating has changed most.

    Last come close modes of which only the sensors tell how they move. It takes a
    solve, at ``theta (d,)``.
    """
    pairing = solve_shapes(posterior, experiment, theta).pairing
    assert pairing is not None
    moved = np.zeros(len(pairing.hertz))
    for part in measured:
        if part.name == experiment.full_name("frequency"):
            moved = np.abs(np.log(part.updated / part.initial))
    unknown = np.isnan(pairing.everywhere).any(axis=0)
    order = np.lexsort([-np.nan_to_num(moved), unknown])
    return sorted((1 + order[:TELLING]).tolist())


def describe_model(
    experiment: Experiment, posterior: LogPosterior
) -> Iterator[tuple[str, str]]:
    """Yield what an FE model consists of, as far as it says so itself."""
    paired = experiment.paired
    model = experiment.model if paired is None else paired.model
    words = WORD.findall(type(model).__name__)
    kind = " ".join(word if word.isupper() else word.lower() for word in words)
    yield "Model", f"{kind[:1].upper()}{kind[1:]}"
    dofs = [*map(str, read_declared(model, "dofs") or ())]
    geometry = read_declared(model, "geometry")
    if geometry is not None:
        yield "Mesh", f"{len(geometry.nodes)} nodes, {len(geometry.lines)} elements"
        if supports := [*_list_supports([*map(str, geometry.nodes)], dofs)]:
            yield "Supports", _name(supports)
    if dofs:
        yield "Free DOFs", str(len(dofs))
    if hasattr(model, "matrices") and (mass := _weigh(model, dofs, posterior)):
        yield "Moving mass", f"{mass:.4g} in the unit of the mass matrix"
    if paired is not None:
        test = paired.measurements
        yield "Sensors", f"{test.n_sensors}: {_name([*test.sensors])}".rstrip(": ")
        yield "Modes", "paired with the measured ones by their shapes (MAC)"


def _list_supports(nodes: Sequence[str], dofs: Sequence[str]) -> Iterator[str]:
    """Yield nodes without a translation that others have, and which they lack.

    A node of solid elements has no rotations, and is none.
    """
    free: dict[str, set[str]] = {node: set() for node in nodes}
    for dof in dofs:
        node, _, direction = dof.rpartition(":")
        free.get(node, set()).add(direction)
    every = sorted(d for d in set().union(*free.values()) if d.startswith("u"))
    for node, directions in free.items():
        if held := [direction for direction in every if direction not in directions]:
            yield f"node {node} ({', '.join(held) if directions else 'held'})"


def _weigh(model: object, dofs: Sequence[str], posterior: LogPosterior) -> float:
    """Return the mass of a rigid motion along one axis, zero if DOFs have no names."""
    axes = [found[2] for dof in dofs if (found := TRANSLATION.fullmatch(dof))]
    if not axes:
        return 0.0
    axis = max(sorted({*axes}), key=axes.count)
    along = np.array([dof.endswith(f":u{axis}") for dof in dofs], float)
    values = dict(zip(posterior.names, prior_centre(posterior.prior), strict=True))
    own = {name: values[name] for name in read_declared(model, "names") or ()}
    _, M = model.matrices(own)  # type: ignore[attr-defined]
    return float(along @ (M @ along))


def _name(labels: Sequence[object]) -> str:
    """Return labels in words, the first ones of many."""
    shown = ", ".join(map(str, labels[:MOST_LISTED]))
    return shown + " …" * (len(labels) > MOST_LISTED)
