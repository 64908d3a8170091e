"""One HTML file of what was measured, sampled and learned; the template has its words.

``report.html.jinja`` leaves out a section whose values are empty.
"""

import platform
import re
from base64 import b64encode
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from datetime import date
from functools import partial
from hashlib import sha256
from os import PathLike
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from ... import checks
from ...contracts import Floats, Parameters, Reported, read_declared
from ...digits import show, show_given
from ...evaluation.resume import installed_version
from ...likelihoods.shape import ShapeTerm
from ...posterior.experiments import Experiment
from ...posterior.log_posterior import LogPosterior
from ...posterior.priors import list_laws
from ...results.arviz_objects import (
    InferenceData,
    groups,
    judgement_of,
    note_of,
    prior_constants,
    prior_draws,
    samples,
    unit_of,
)
from ...results.chains import read_chains
from ...results.diagnose import diagnose
from ...results.identifiability import identifiability
from ...results.measured import (
    Measured,
    each_term,
    find_pairs,
    read_measured,
    with_frequencies,
)
from ...results.tables import (
    frequency_table,
    pairing_table,
    parameter_table,
    predictive_table,
    summarize,
)
from ...results.to_arviz import read_samples
from ...sampling.record import Run
from ...table import Column, Report, Table, number_columns
from .facts import TELLING, choose_telling, describe_model, say_trust, tabulate_result

Figure: TypeAlias = Any  # of matplotlib, which figures import
Pictures: TypeAlias = list[tuple[str, Figure]]  # each with its experiment
Derived: TypeAlias = Mapping[str, tuple[Callable[[Parameters], Floats], str]]

MOST_ROWS = 40  # of a table; figures show the rest
SHAPE_ERROR = 0.01  # by which measured shapes are printed
MOST_PAIRED = 4  # parameters of a scatter figure that is read at half a page's width
PRIOR_DRAWN = 20_000  # draws, for the ends of its intervals
CONTENTS = "[contents]"  # where they will be
TEXTS = ("author", "project", "date", "structure", "question", "conclusion")
LIBRARIES = ("emcee-femu", "emcee", "numpy", "scipy", "arviz", "matplotlib")


def report(
    source: object,
    path: str | PathLike[str],
    *,
    title: str = "Updated finite element model",
    text: Mapping[str, str] | None = None,
    derived: Derived | None = None,
    posterior: LogPosterior | None = None,
    discard: int | None = None,
) -> Path:
    """Write one HTML file to hand over, with the answer on its first page.

    The first page has the structure, the question, the result and, in one sentence,
    what :func:`diagnose` says of it. Then come the test, the model, priors and
    posteriors with their correlations, the likelihood in words and formulas, the fit
    before and after, mode shapes and their MAC where modes are paired (and drawn where
    the model has a ``geometry``, :class:`Geometry`), and :func:`identifiability`. How
    the samples were judged and how to repeat them is at the end: the statements, the
    solves, seeds, versions, digests of the data, and the call that writes the file
    again. A line explains each number. Pictures are inside the file, which
    prints on A4. What the source does not know is left out. Writing costs a solve for
    each experiment with frequencies and three more where modes are paired. An existing
    file is overwritten.

    Args:
        source: The result of :func:`run`, :func:`certify` or :func:`pool_tests`, or
            anything that :func:`to_inference_data` accepts.
        path: Name of the file, such as "report.html".
        title: Its heading.
        text: What you want to say yourself, such as ``{"author": "A. Bauer"}``: any of
            author, project, date (otherwise today), structure, question (otherwise
            written from the model) and conclusion.
        derived: Quantities that follow from the parameters, with their units, such as
            ``{"fall": (lambda p: 100 * (1 - p["E2"] / p["E1"]), "%")}``. The functions
            take arrays ``(n,)`` by parameter, as a model does, and return ``(n,)``.
        posterior: The sampled posterior, where the source does not know it: without it
            terms, measurement errors and mode shapes are left out.
        discard: Number of stored steps to drop as burn-in. None for those that a run
            by given moves found itself.

    Returns:
        The path of the file.

    Raises:
        TypeError: If source holds no samples, path, title or a text is no text, derived
            is not such a mapping, or posterior is not a LogPosterior.
        ValueError: If path does not end in .html, text has another key, a derived
            quantity is not one finite number for each sample, there are too few samples
            to judge, or posterior has other parameters.
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
        raise ImportError("a report needs Jinja2: pip install jinja2") from None
    path, said = _check_words(path, title, text)
    result = source
    tell = read_declared(source, "reported")
    told: Reported | None = tell() if tell else None
    if told:
        source = told.source
    own = told if told and told.title else None
    run = source if isinstance(source, Run) else None
    name = told.name if told else "run" if run else "samples"
    idata, sampled = read_samples(source, posterior, discard, argument="source")
    experiments = sampled.experiments if sampled else ()
    held = groups(idata)
    measured = read_measured(idata)
    judged = diagnose(run or idata, discard if run else None)
    places = [part.experiment or None for part in with_frequencies(measured)]
    frequencies = [frequency_table(idata, experiment=e) for e in places]
    environment = Environment(autoescape=True, undefined=StrictUndefined)
    environment.filters |= {"show": _show, "draw": _draw}
    template = Path(__file__).with_name("report.html.jinja").read_text("utf-8")
    page = environment.from_string(template).render(
        title=title,
        contents=CONTENTS,
        said=dict.fromkeys(TEXTS, "") | {"date": str(date.today())} | said,
        names=samples(idata)[0],
        versions={library: installed_version(library) for library in LIBRARIES},
        python=f"{platform.python_version()} on {platform.system()}",
        own=own,
        result=result,
        counts=dict(_count_data(measured, experiments)),
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
        laws=list_laws(sampled.prior) if sampled else (),
        chains=read_chains(idata),
        run=run,
        diagnosis=judged,
        verdict=judgement_of(idata).get("verdict", ""),
        note=note_of(idata),
        outcome=tabulate_result(idata),
        trust=say_trust(judged, measured),
        models=[(e, [*describe_model(e, sampled)]) for e in experiments if sampled],
        parameters=parameter_table(
            idata, var_names=[*map(str, idata["posterior"].data_vars)]
        ),
        derived=_tabulate_derived(idata, derived) if derived is not None else None,
        frequencies=[*zip(places, frequencies, strict=True)],
        scattered=len(samples(idata)[0]) <= MOST_PAIRED,
        pictures=dict(_draw_all(idata, sampled, measured, result, own)),
        predicted=_tabulate_predictions(idata, sampled, measured),
        fitted=frequency_table(idata) if frequencies else None,
        pairings=pairing_table(idata) if find_pairs(idata) else None,
        identifiability=(
            identifiability(idata) if "constant_data" in held and not own else None
        ),
        made=held["posterior"].attrs,
        name=name,
        file=path.name,
        given=posterior is not None,
        given_text=bool(text),
        discard=discard,
    )
    path.write_text(_list_contents(page, len(experiments) > 1), encoding="utf-8")
    return path


def _check_words(
    path: str | PathLike[str], title: str, text: Mapping[str, str] | None
) -> tuple[Path, dict[str, str]]:
    """Return the file's path and what the user says, refusing what is no text."""
    path = Path(checks.file_name("path", path))
    if path.suffix.lower() not in (".html", ".htm"):
        raise ValueError(
            f"path: expected the name of an HTML file, such as {path.stem}.html, got "
            f"{path.name!r}; a browser prints it to PDF"
        )
    checks.text("title", title)
    said = {} if text is None else checks.by_label("text", text, "{'author': text}")
    for key, words in said.items():
        checks.one_of("text", key, TEXTS)
        checks.text(f"text[{key!r}]", words)
    return path, dict(said)


def _list_contents(page: str, long: bool) -> str:
    """Give headings their anchors, and a long report a list of them."""
    titles = re.findall("<h2>(.*?)</h2>", page)
    for number, title in enumerate(titles):
        page = page.replace(f"<h2>{title}", f'<h2 id="{number}">{title}', 1)
    entries = (f'<li><a href="#{i}">{title}</a></li>' for i, title in enumerate(titles))
    listed = (
        f'<h2 id="contents">Contents</h2><ol class="contents">{"".join(entries)}</ol>'
    )
    return page.replace(CONTENTS, listed if long else "", 1)


def _show(part: Table | Report) -> str:
    """Return tables and sentences in HTML."""
    from markupsafe import Markup

    return Markup(f'<div class="wide">{part._repr_html_()}</div>')


def _draw(figure: Figure) -> str:
    """Return the address of a picture that is itself the picture."""
    from ...figures.style import draw_png

    return f"data:image/png;base64,{b64encode(draw_png(figure)).decode()}"


def _count_data(
    measured: Iterable[Measured], experiments: Iterable[Experiment]
) -> Iterator[tuple[str, int]]:
    """Yield how many values of each kind were measured, those of shapes among them."""
    for part in measured:
        yield part.name, len(part.values)
    for experiment in experiments:
        for term in experiment.terms:
            if isinstance(term, ShapeTerm):
                yield experiment.full_name("mode shapes"), int(term.there.sum())


def _list_data(
    measured: Iterable[Measured], posterior: LogPosterior | None
) -> Iterator[tuple[str, Floats]]:
    """Yield names and numbers of all that was measured."""
    for part in measured:
        yield part.name, part.values
    for experiment, term, label in each_term(posterior) if posterior else ():
        data = getattr(term, "measured", None)
        if data is not None and not term.observed:  # else it is among those above
            yield experiment.full_name(label), getattr(data, "values", data)


def _tabulate_measured(part: Measured, posterior: LogPosterior | None) -> Table:
    unit, values, sd = f" {part.unit}".rstrip(), part.values, part.sd(posterior)
    columns: list[Column] = [
        (part.dims or "quantity", "", part.labels if part.dims else [part.name]),
        (f"measured{unit}", show_given(values, sd), values),
    ]
    if np.isfinite(sd).any():
        columns.append((f"standard deviation{unit}", show(sd, sd), sd))
    if len(values) > MOST_ROWS:
        columns = [
            ("values", "d", [len(values)]),
            (f"lowest{unit}", ".6g", [values.min()]),
            (f"highest{unit}", ".6g", [values.max()]),
        ]
    return Table.from_columns(f"Measured: {part.name}", columns)


def _tabulate_shapes(experiment: Experiment) -> Iterator[Table]:
    """Yield the measured shapes, of the pairing or else of the terms."""
    of_terms = [t.measured for t in experiment.terms if isinstance(t, ShapeTerm)]
    sensors: Sequence[str] = ()
    if experiment.paired is not None:
        test = experiment.paired.measurements
        assert test.shapes is not None
        of_terms, sensors = [test.shapes], test.sensors
    title = f"Measured mode shapes of {experiment.name}".removesuffix(" of ")
    for shapes in of_terms:
        if len(shapes) > MOST_ROWS:
            continue
        sensors = sensors or [*map(str, range(1, 1 + len(shapes)))]
        named = ((f"mode {i}", shape) for i, shape in enumerate(shapes.T, 1))
        modes = [(title, show(shape, SHAPE_ERROR), shape) for title, shape in named]
        yield Table.from_columns(title, [("sensor", "", sensors), *modes])


def _tabulate_priors(idata: InferenceData, posterior: LogPosterior | None) -> Table:
    """Tabulate means and 95 % intervals of any prior, from draws."""
    names = samples(idata)[0]
    prior, draws = prior_constants(idata, names), prior_draws(idata, names)
    if posterior is not None:
        draws = posterior.prior.sample(np.random.default_rng(0), PRIOR_DRAWN)
    _, low, high = summarize(draws)
    sd = prior["prior_sd"].values
    unit, numbers = number_columns(
        (unit_of(idata, name) for name in names),
        [
            ("prior mean", prior["prior_mean"].values, sd),
            ("2.5 %", low, sd),
            ("97.5 %", high, sd),
            ("lower bound", prior["lower"].values, np.nan),
            ("upper bound", prior["upper"].values, np.nan),
        ],
    )
    columns: list[Column] = [("parameter", "", names), *unit, *numbers]
    return Table.from_columns("Parameters before the test", columns)


def _tabulate_derived(idata: InferenceData, derived: Derived) -> Table:
    names, chains = samples(idata)
    draws = dict(zip(names, chains.reshape(-1, len(names)).T, strict=True))
    rows, units, size = {}, [], chains.shape[0] * chains.shape[1]
    for name, pair in checks.by_label("derived", derived, "(function, unit)").items():
        argument = f"derived[{name!r}]"
        function, unit = checks.group(argument, pair, "(function, unit)", 2)
        if not callable(function) or not isinstance(unit, str):
            raise TypeError(f"{argument}: expected (function, unit), got {pair!r}")
        rows[name] = checks.real_array(argument, function(draws))
        checks.shaped(argument, rows[name].shape, (size,), remedy="one by sample")
        units.append(unit)
    values = np.column_stack([*rows.values()])
    titles = zip(("mean", "2.5 %", "97.5 %"), summarize(values), strict=True)
    sd = values.std(axis=0, ddof=1)
    unit, numbers = number_columns(units, [(title, row, sd) for title, row in titles])
    columns: list[Column] = [("quantity", "", [*rows]), *unit, *numbers]
    return Table.from_columns("Derived quantities", columns)


def _tabulate_predictions(
    idata: InferenceData, posterior: LogPosterior | None, measured: list[Measured]
) -> Table | None:
    if not 0 < sum(len(part.values) for part in measured) <= MOST_ROWS:
        return None
    drawn = all(part.replicated is not None for part in measured)
    return predictive_table(idata, posterior if drawn else None)


def _draw_all(
    idata: InferenceData,
    posterior: LogPosterior | None,
    measured: list[Measured],
    result: object,
    own: Reported | None,
) -> Iterator[tuple[str, Pictures]]:
    """Yield the figures of each section that has some, by experiment."""
    from ... import figures

    if own and own.figure:  # in a section of the result's own
        yield "own", [("", getattr(figures, own.figure)(result))]
    if measured:
        places = dict.fromkeys(part.experiment for part in measured)
        drawn = partial(figures.plot_predictive, idata, posterior)
        yield "fit", [(place, drawn(experiment=place or None)) for place in places]
    tests = posterior.experiments if posterior else ()
    paired = [test for test in tests if test.paired is not None]
    drawn = partial(figures.plot_mac, idata, posterior)
    yield "mac", [(test.name, drawn(test.name or None)) for test in paired]
    placed = [t for t in paired if read_declared(t.model, "geometry") is not None]
    drawn = partial(figures.plot_shapes, idata, posterior)
    mean, first = samples(idata)[1].mean(axis=(0, 1)), []
    for test in placed:
        assert posterior is not None
        modes = choose_telling(measured, posterior, test, mean)
        one = drawn(modes=modes, experiment=test.name or None, structure=True)
        first.append((test.name, one))
    yield "first", first
    many = [t for t in placed if t.paired and t.paired.measurements.n_modes > TELLING]
    yield "shapes", [(t.name, drawn(experiment=t.name or None)) for t in many]
    yield "parameters", [("", figures.plot_prior_posterior(idata, posterior))]
    d = len(samples(idata)[0])
    plot = figures.plot_scatter if d <= MOST_PAIRED else figures.plot_correlation
    yield "correlations", [("", plot(idata))] if d > 1 else []
