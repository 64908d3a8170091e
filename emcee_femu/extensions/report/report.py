"""One HTML file of what was measured, sampled and learned; the template has its words.

``report.html.jinja`` leaves out a section whose values are empty.
"""

import platform
from base64 import b64encode
from collections.abc import Iterable, Iterator, Sequence
from datetime import date
from hashlib import sha256
from importlib.metadata import version
from os import PathLike
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ... import checks
from ...contracts import Reported, read_declared
from ...likelihoods.shape import ShapeTerm
from ...models.paired import PairedModel
from ...posterior.experiments import Experiment
from ...posterior.log_posterior import LogPosterior
from ...posterior.priors import tabulate_prior
from ...results.arviz_objects import (
    InferenceData,
    groups,
    prior_constants,
    samples,
    unit_of,
)
from ...results.chains import read_chains
from ...results.diagnose import diagnose
from ...results.identifiability import identifiability
from ...results.measured import Measured, each_term, read_measured
from ...results.tables import (
    frequency_table,
    pairing_table,
    parameter_table,
    predictive_table,
)
from ...results.to_arviz import read_samples
from ...sampling.record import Run
from ...table import Column, Report, Table, unit_column

Figure: TypeAlias = Any  # of matplotlib, which figures import

MOST_ROWS = 40  # of a table; figures show the rest
SHAPES_BESIDE = 8  # mode shapes beside each other in a table
MOST_PAIRED = 6  # parameters that a scatter figure shows at page width
LIBRARIES = ("emcee-femu", "emcee", "numpy", "scipy", "arviz", "matplotlib")


def report(
    source: object,
    path: str | PathLike[str],
    *,
    title: str = "Updated finite element model",
    posterior: LogPosterior | None = None,
    discard: int = 0,
) -> Path:
    """Write one HTML file to hand over, which answers what a reader of a result asks.

    It says what was measured, with a digest of the data; the model, its parameters and
    priors; the likelihood in words and formulas; the solves spent; what
    :func:`diagnose` states; parameters and fit before and after; the MAC of paired
    modes and their shapes, where the model has a ``geometry`` (:class:`Geometry`); the
    prior beside the posterior, correlations, :func:`identifiability`; and seeds,
    versions and the call that writes the file again. Its pictures are inside, and it
    prints on A4. What the source does not tell is left out. It costs a solve for each
    experiment with frequencies and three more where modes are paired. A file that is
    there is overwritten.

    Args:
        source: What :func:`run` or :func:`to_inference_data` returned, or whatever else
            the latter takes; what :func:`certify` or :func:`pool_tests` returned.
        path: Name of the file, such as "report.html".
        title: Its heading.
        posterior: The sampled posterior, where the source does not know it: without it
            terms, measurement errors and mode shapes are left out.
        discard: Stored steps to drop as burn-in.

    Returns:
        The path of the file.

    Raises:
        TypeError: If source holds no samples, path or title is no text, or posterior
            is not a LogPosterior.
        ValueError: If path does not end in .html, there are too few samples to judge,
            or posterior has other parameters.
        ImportError: If Jinja2, of the extra ``report``, is not installed.

    Examples:
        >>> import os, tempfile
        >>> import emcee_femu as ef
        >>> posterior = ef.paper.mass_spring().posterior
        >>> run = ef.run(posterior, ef.DEMCMove(), 20, 200, ensembles=2, seed=1)
        >>> path = os.path.join(tempfile.mkdtemp(), "tower.html")
        >>> ef.report(run, path, title="Tower", discard=100).name
        'tower.html'
    """
    try:
        from jinja2 import Environment, StrictUndefined
    except ImportError:
        raise ImportError(
            'a report needs Jinja2: pip install "emcee_femu[report]"'
        ) from None
    path = Path(checks.file_name("path", path))
    if path.suffix.lower() not in (".html", ".htm"):
        raise ValueError(
            f"path: expected the name of an HTML file, such as {path.stem}.html, got "
            f"{path.name!r}; a browser prints it to PDF"
        )
    checks.text("title", title)
    name = "run" if isinstance(source, Run) else "samples"
    result, own = source, None
    if (reported := getattr(source, "reported", None)) is not None:
        told: Reported = reported()
        source, name, own = told.source, told.name, told if told.title else None
    run = source if isinstance(source, Run) else None
    idata, sampled = read_samples(source, posterior, discard, argument="source")
    experiments = sampled.experiments if sampled else ()
    held = groups(idata)
    measured = read_measured(idata)
    with_frequencies = _find_places((part.name for part in measured), "frequency")
    with_pairs = _find_places(map(str, held.get("response", ())), "mac")
    environment = Environment(autoescape=True, undefined=StrictUndefined)
    environment.filters |= {"show": _show, "draw": _draw}
    template = Path(__file__).with_name("report.html.jinja").read_text("utf-8")
    page = environment.from_string(template).render(
        title=title,
        today=date.today(),
        versions={library: version(library) for library in LIBRARIES},
        python=f"{platform.python_version()} on {platform.system()}",
        own=own,
        result=result,
        measured=[_tabulate_measured(part, sampled) for part in measured],
        measured_shapes=[t for e in experiments for t in _tabulate_shapes(e)],
        digests={
            key: sha256(values.tobytes()).hexdigest()
            for key, values in _list_data(measured, sampled)
        },
        posterior=sampled,
        experiments=experiments,
        kind=lambda value: type(value).__name__,
        priors=_tabulate_priors(idata, sampled) if "constant_data" in held else None,
        chains=read_chains(idata),
        run=run,
        diagnosis=diagnose(run or idata, discard if run else 0),
        certificate=held["certificate"].attrs if "certificate" in held else None,
        parameters=parameter_table(
            idata, var_names=[*map(str, idata["posterior"].data_vars)]
        ),
        frequencies=[
            frequency_table(idata, sampled, None, e) for e in with_frequencies
        ],
        pictures=dict(_draw_all(idata, sampled, measured)) | _draw_own(result, own),
        predicted=_tabulate_predictions(idata, sampled, measured),
        pairings=[pairing_table(idata, e) for e in with_pairs],
        identifiability=(
            identifiability(idata) if "constant_data" in held and not own else None
        ),
        made=held["posterior"].attrs,
        name=name,
        file=path.name,
        given=posterior is not None,
        discard=discard,
    )
    path.write_text(page, encoding="utf-8")
    return path


def _find_places(names: Iterable[str], quantity: str) -> list[str | None]:
    """Return the experiments that have a quantity, None for a single one."""
    parts = (name.rpartition(".") for name in names)
    return [experiment or None for experiment, _, last in parts if last == quantity]


def _show(part: Table | Report) -> Any:
    """Return tables in HTML, with the width of the widest, which print fits to A4."""
    from markupsafe import Markup

    text = f'<div class="wide" style="--characters: {part.width}">'
    return Markup(f"{text}{part._repr_html_()}</div>")


def _draw(figure: Figure) -> str:
    """Return the address of a picture that is itself the picture."""
    from ...figures.style import draw_png

    return f"data:image/png;base64,{b64encode(draw_png(figure)).decode()}"


def _list_data(
    measured: Iterable[Measured], posterior: LogPosterior | None
) -> Iterator[tuple[str, NDArray[Any]]]:
    """Yield names and numbers of all that was measured."""
    for part in measured:
        yield part.name, part.values
    for experiment, term, label in each_term(posterior) if posterior else ():
        name = experiment.full_name(label)
        data = getattr(term, "measured", None)
        if data is not None and not term.observed:  # else it is among those above
            yield name, getattr(data, "values", data)


def _tabulate_measured(part: Measured, posterior: LogPosterior | None) -> Table:
    unit, values, sd = f" {part.unit}".rstrip(), part.values, part.sd(posterior)
    columns: list[Column] = [
        (part.dims or "quantity", "", part.labels if part.dims else [part.name]),
        (f"measured{unit}", ".6g", values),
    ]
    if np.isfinite(sd).any():
        columns.append((f"standard deviation{unit}", ".3g", sd))
    if len(values) > MOST_ROWS:
        ends = (f"lowest{unit}", values.min()), (f"highest{unit}", values.max())
        columns = [("values", "d", [len(values)])]
        columns += [(title, ".6g", [value]) for title, value in ends]
    return Table.from_columns(f"Measured: {part.name}", columns)


def _tabulate_shapes(experiment: Experiment) -> Iterator[Table]:
    """Yield the measured shapes, of the pairing or else of the terms."""
    of_terms = [t.measured for t in experiment.terms if isinstance(t, ShapeTerm)]
    sensors: Sequence[str] = ()
    if isinstance(experiment.model, PairedModel):
        test = experiment.model.measurements
        assert test.shapes is not None
        of_terms, sensors = [test.shapes], test.sensors
    title = f"Measured mode shapes {experiment.name}".rstrip()
    for shapes in of_terms:
        if len(shapes) > MOST_ROWS:
            continue
        sensors = sensors or [*map(str, range(1, 1 + len(shapes)))]
        modes = [(f"mode {i}", ".3f", shape) for i, shape in enumerate(shapes.T, 1)]
        for start in range(0, len(modes), SHAPES_BESIDE):
            shown = modes[start : start + SHAPES_BESIDE]
            yield Table.from_columns(title, [("sensor", "", sensors), *shown])


def _tabulate_priors(idata: InferenceData, posterior: LogPosterior | None) -> Table:
    title = "Parameters and priors"
    if posterior is not None:
        return tabulate_prior(title, posterior.prior, posterior.units)
    names = samples(idata)[0]
    prior = prior_constants(idata, names)
    columns: list[Column] = [("parameter", "", names)]
    columns += unit_column(unit_of(idata, name) for name in names)
    for constant in ("prior_mean", "prior_sd", "lower", "upper"):
        columns.append((constant.replace("_", " "), ".4g", prior[constant].values))
    return Table.from_columns(title, columns)


def _tabulate_predictions(
    idata: InferenceData, posterior: LogPosterior | None, measured: list[Measured]
) -> Table | None:
    if not 0 < sum(len(part.values) for part in measured) <= MOST_ROWS:
        return None
    drawn = all(part.replicated is not None for part in measured)
    return predictive_table(idata, posterior if drawn else None)


def _draw_own(result: object, own: Reported | None) -> dict[str, list[Figure]]:
    """Return the figure of a result that has a section of its own."""
    from ... import figures

    return {"own": [getattr(figures, own.figure)(result)]} if own else {}


def _draw_all(
    idata: InferenceData, posterior: LogPosterior | None, measured: list[Measured]
) -> Iterator[tuple[str, list[Figure]]]:
    """Yield the figures of each section that has some."""
    from ... import figures

    if measured:
        yield "fit", [figures.plot_predictive(idata, posterior)]
    mac, shapes = [], []
    for test in posterior.experiments if posterior else ():
        place = test.name or None
        if isinstance(test.model, PairedModel):
            mac.append(figures.plot_mac(idata, posterior, place))
            if read_declared(test.model, "geometry") is not None:
                shapes.append(figures.plot_shapes(idata, posterior, experiment=place))
    yield from [("mac", mac), ("shapes", shapes)]
    yield "parameters", [figures.plot_prior_posterior(idata, posterior)]
    d = len(samples(idata)[0])
    plot = figures.plot_scatter if d <= MOST_PAIRED else figures.plot_correlation
    yield "correlations", [plot(idata)] if d > 1 else []
