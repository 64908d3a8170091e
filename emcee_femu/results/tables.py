"""Tables of parameters, frequencies, other predictions and paired modes."""

from collections.abc import Mapping, Sequence
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from .. import checks
from ..contracts import Floats
from ..digits import show, show_given
from ..posterior.log_posterior import LogPosterior
from ..table import Column, Table, number_columns
from .arviz_objects import (
    dataset,
    in_brackets,
    note_of,
    prior_constants,
    samples,
    unit_of,
)
from .identifiability import describe_samples
from .measured import (
    INTERVAL,
    Measured,
    find_pairs,
    measured_frequencies,
    measured_variables,
    with_frequencies,
)
from .to_arviz import read_samples

V = TypeVar("V")  # what is published of a column

OF_PRIOR = "prior mean", "error %", "sd/prior sd"  # columns
# Of a Gaussian 8 % of the samples lie within a tenth of an sd of the mean.
NEAR_MEAN, FEW_NEAR = 0.1, 0.01
OF_TRUTH = "true", "error %", "error % "
INTERVAL_WIDTH = 3.92  # width of a Gaussian's 95 % interval, in standard deviations
LOW_MAC = 0.5  # the limit of pairs in objects that do not hold the one of their model


def parameter_table(
    idata: object,
    true: Mapping[str, float] | None = None,
    published: Mapping[str, Mapping[str, float]] | None = None,
    var_names: Sequence[str] | None = None,
    *,
    before: Mapping[str, float] | None = None,
) -> Table:
    """Tabulate the updated parameters, as in Tables 4.1 and 5.1 of the paper.

    Columns: the unit where any parameter has one; the true value and relative errors
    where it is known; the model before updating (the prior mean, or ``before``);
    posterior mean, its 95 % interval (the 2.5 % and 97.5 % quantiles), c.o.v. = sd /
    mean in percent, and the ratio of posterior to prior standard deviation: near 1 the
    data said nothing about the parameter; it is that of :func:`identifiability`, of
    logarithms where the prior is more symmetrical in them. Without a prior, as in
    objects of ``arviz.from_emcee``, its columns are left out.

    Args:
        idata: What :func:`to_inference_data` returns or takes, such as a run.
        true: Known true values by parameter name, as in a simulation; None for a real
            structure.
        published: Further columns, ``{title: {parameter: value}}``, which are printed
            as they are given; all others are then in the units of the parameters,
            without another prefix.
        var_names: Rows, with quantities that were added to the ``posterior`` group;
            None for the sampled parameters.
        before: Parameters of the model before updating, by name, in place of the prior
            mean: an engineer's nominal values.

    Returns:
        The table, one row per parameter.

    Raises:
        TypeError: If idata holds no samples, or true, before or published is not such a
            mapping.
        ValueError: If true, before, a published column or var_names names an unknown
            parameter.

    Examples:
        >>> import emcee_femu as ef
        >>> posterior = ef.paper.mass_spring().posterior
        >>> run = ef.run(posterior, ef.DEMCMove(), 20, 100, ensembles=1, seed=1)
        >>> idata = ef.to_inference_data(run, discard=50)
        >>> table = ef.parameter_table(idata)
        >>> [round(mean / 1e3) for mean in table.column("mean")[:3]]  # N/mm
        [4, 2, 2]
    """
    idata, _ = read_samples(idata)
    names, chains = samples(idata, var_names)
    draws = chains.reshape(-1, len(names))
    mean, low, high = summarize(draws)
    sd, ratio = draws.std(axis=0, ddof=1), np.full(len(names), np.nan)
    units = [unit_of(idata, name) for name in names]
    prior = prior_constants(idata, names)
    start, initial = "prior mean", prior["initial"].values
    known = np.isfinite(prior["prior_sd"].values)
    if known.any():
        about = describe_samples(idata, fitted=False)
        ratios = dict(zip(about.names, about.sd_ratio, strict=True))
        ratio = np.array([ratios.get(name, np.nan) for name in names])
    if before is not None:
        start, initial = "before", checks.numbers_by_name("before", before, names)
    truth = checks.numbers_by_name("true", {} if true is None else true, names)
    others: list[Column] = [
        (title, ".5g", checks.numbers_by_name(f"published[{title!r}]", values, names))
        for title, values in _columns(published)
    ]
    unit, numbers = number_columns(
        units,
        [
            ("true", truth, sd),
            (start, initial, prior["prior_sd"].values),
            ("mean", mean, sd),
            ("2.5 %", low, sd),
            ("97.5 %", high, sd),
        ],
        prefixes=not others,  # a percentage or a length: these have any unit
    )
    of_truth, of_start, of_mean, of_low, of_high = numbers
    percent = 100 * sd / np.abs(mean)
    before_off, off = _percent_off(initial, truth), _percent_off(mean, truth)
    known_sign = np.where(low * high > 0, percent, np.nan)  # else it tells nothing
    columns: list[Column] = [
        ("parameter", "", names),
        *unit,
        of_truth,
        of_start,
        ("error %", show(before_off, percent), before_off),
        of_mean,
        ("error % ", show(off, percent), off),
        of_low,
        of_high,
        ("c.o.v. %", show(known_sign, known_sign), known_sign),
        ("sd/prior sd", ".2f", ratio),
    ]
    unknown = {*OF_TRUTH} if true is None else set[str]()
    if not known.any():
        unknown |= {*OF_PRIOR}
    columns = [c for c in columns if c[0] not in unknown] + others
    title = f"Updating parameters{in_brackets(note_of(idata))}"
    near = (np.abs(draws - mean) < NEAR_MEAN * sd).mean(axis=0)
    # Constant samples, of which none is nearer than 0, are no clouds.
    between = ", ".join(np.array(names)[(near < FEW_NEAR) & (sd > 0)])
    if between:
        title += f" (the mean of {between} lies between clouds of samples)"
    return Table.from_columns(title, columns)


def frequency_table(
    idata: object,
    posterior: LogPosterior | None = None,
    published: Mapping[str, Sequence[float]] | None = None,
    experiment: str | None = None,
) -> Table:
    """Tabulate measured, initial and updated frequencies, as in Tables 4.2 and 5.2.

    The initial frequencies are those at the prior mean of the parameters. The updated
    frequencies are the means of the model's frequencies over all samples, as everywhere
    in this package. Errors are ``100 |f_m - f| / f_m``; the last row holds their mean,
    the total average error (TAE). The paper has the frequencies at the mean of the
    parameters instead, which differ from the updated ones where the model is not
    linear: with ``posterior``, further columns hold them and their errors, which takes
    one solve, the first time only.

    Args:
        idata: The result of :func:`run` or :func:`to_inference_data`.
        posterior: The sampled posterior, for the frequencies at the mean of the
            parameters; None to leave them out.
        published: Further columns, ``{title: one number per measured mode}``.
        experiment: Name of one experiment of a joint posterior; None for all of them,
            below each other.

    Returns:
        The table, one row per measured mode.

    Raises:
        TypeError: If published is not such a mapping, or posterior is not a
            LogPosterior.
        ValueError: If there are no measured frequencies, a published column has
            another length or belongs to no experiment, or posterior has other
            parameters.

    Examples:
        >>> import emcee_femu as ef
        >>> posterior = ef.paper.mass_spring().posterior
        >>> run = ef.run(posterior, ef.DEMCMove(), 20, 100, ensembles=1, seed=1)
        >>> idata = ef.to_inference_data(run, discard=50)
        >>> table = ef.frequency_table(idata)
        >>> table.column("mode")
        ['1', '2', '3', '4', '5', 'TAE']
    """
    asked = posterior is not None
    idata, posterior = read_samples(idata, posterior)
    parts = with_frequencies(measured_variables(idata))
    tests = [part.experiment for part in parts if part.experiment]
    if experiment is None and tests:
        if published is not None:
            raise ValueError(f"published: name one of the experiments {tests} as well")
        given = posterior if asked else None
        tables = {name: frequency_table(idata, given, None, name) for name in tests}
        title = f"Natural frequencies{in_brackets(note_of(idata))}"
        return Table.stack(title, tables)
    frequency = measured_frequencies(idata, experiment)
    measured, draws = frequency.values, frequency.predicted
    m, updated = len(measured), frequency.updated
    sd, its_sd = draws.std(axis=0, ddof=1), frequency.sd(posterior)
    percent = 100 * sd / updated
    as_given = show_given(measured, np.where(np.isfinite(its_sd), its_sd, sd))

    def hertz(title: str, values: Floats, to: Floats = sd) -> Column:
        return title, [*show(values, to), ""], np.append(values, np.nan)

    def error(title: str, values: Floats) -> Column:
        errors = _percent_off(values, measured)
        errors, to = np.append(errors, errors.mean()), np.median(percent)
        return title, show(errors, np.append(percent, to)), errors

    columns: list[Column] = [
        (frequency.dims, "", [*frequency.labels, "TAE"]),
        ("measured Hz", [*as_given, ""], np.append(measured, np.nan)),
        hertz("prior mean Hz", frequency.initial),
        error("error %", frequency.initial),
        hertz("updated Hz", updated),
        hertz("c.o.v. %", percent, percent),
        error("error % ", updated),
    ]
    if asked and posterior is not None:
        row = posterior.recall(samples(idata)[1].mean(axis=(0, 1)))
        at_mean = row[posterior.columns[frequency.variable]][:m]
        columns.append(hertz("at mean parameters Hz", at_mean))
        columns.append(error("error %  ", at_mean))
    for title, values in _columns(published):
        column = checks.numeric_array(f"published[{title!r}]", values)
        shapes, argument = ((m,), (m + 1,)), f"published[{title!r}]"
        checks.shaped(argument, column.shape, *shapes, remedy="the last is the TAE")
        padded = np.append(column, [np.nan] * (m + 1 - len(column)))
        columns.append((title, ".5g", padded))
    words = f" of {experiment!r}" if experiment else ""
    words += in_brackets(note_of(idata))
    return Table.from_columns(f"Natural frequencies{words}", columns)


def predictive_table(idata: object, posterior: LogPosterior | None = None) -> Table:
    r"""Compare the measured values with the posterior's predictions, in a table.

    There is one row per measured value: the updated value, which is the mean of the
    model's over all samples, the 95 % interval of a new measurement (its 2.5 % and 97.5
    % quantiles), and whether the measured value lies inside, as :func:`diagnose` counts
    it. For frequencies a new measurement is

    .. math:: \tilde f_i = f_i(\theta) + f_i^m (\eta_i + \sigma_d \varepsilon_i),
        \qquad \eta \sim N(0, R), \quad \varepsilon \sim N(0, I),

    with the measurement error R and the discrepancy :math:`\sigma_d` of the
    :class:`FrequencyTerm`. At least 95 % of the measured values should lie inside,
    because the posterior was fitted to them. Where a term draws no new measurements,
    the interval is that of the model alone: it shows only the uncertainty of the
    parameters, and the measured value need not lie inside, so the table has "-" there.
    If no term draws any, the column is named "in the model's interval". With a
    posterior, which a run knows, the column ``sd`` holds :math:`f_i^m R_{ii}^{1/2}`.
    If modes were paired, mean and 5 % quantile of the MAC are added. It takes no
    solves.

    Args:
        idata: The result of :func:`run` or :func:`to_inference_data`.
        posterior: The sampled posterior, if idata is an ArviZ object; None to leave
            out the standard deviations of the measurements.

    Returns:
        The table, one row per measured value.

    Raises:
        TypeError: If posterior is not a LogPosterior.
        ValueError: If no variable of the response was measured, or posterior has other
            parameters.

    Examples:
        >>> import emcee_femu as ef
        >>> posterior = ef.paper.mass_spring().posterior
        >>> run = ef.run(posterior, ef.DEMCMove(), 20, 100, ensembles=1, seed=1)
        >>> idata = ef.to_inference_data(run, discard=50)
        >>> ef.predictive_table(idata, posterior).column("inside")
        ['yes', 'yes', 'yes', 'yes', 'yes']
    """
    idata, posterior = read_samples(idata, posterior)
    parts = measured_variables(idata)
    missing = [part.name for part in parts if part.replicated is None]
    none_drawn = len(missing) == len(parts)
    title_of_inside = "in the model's interval" if none_drawn else "inside"
    what = "the model alone"
    if not none_drawn:
        what = "a new measurement, with its error and discrepancy"
        what += f"; of {', '.join(missing)} the model alone" * bool(missing)
    new = [p.predicted if p.replicated is None else p.replicated for p in parts]
    low, high = summarize(np.concatenate(new, axis=1))[1:]
    updated = np.concatenate([part.updated for part in parts])
    # The model's own interval need not hold what was measured.
    judged = [np.full(len(p.values), p.name not in missing) for p in parts]
    inside = np.concatenate([part.inside for part in parts])
    said = np.where(inside, "yes", "no")
    if not none_drawn:
        said = np.where(np.concatenate(judged), said, "-")
    measured = np.concatenate([part.values for part in parts])
    title, labels, unit = _name_rows(parts)
    sd = np.concatenate([part.sd(posterior) for part in parts])
    # Where the error of the test is not known: as if the interval were a Gaussian's.
    about = (high - low) / INTERVAL_WIDTH
    to = np.where(np.isfinite(sd), sd, about)
    columns: list[Column] = [
        (title, "", labels),
        (f"measured{unit}", show_given(measured, to), measured),
        (f"updated{unit}", show(updated, about), updated),
        ("2.5 %", show(low, about), low),
        ("97.5 %", show(high, about), high),
        (title_of_inside, "", said),
    ]
    if np.isfinite(sd).any() and not none_drawn:
        columns.insert(2, (f"sd{unit}", show(sd, sd), sd))
    mac = np.concatenate([_summarize_mac(part) for part in parts], axis=1)
    if np.isfinite(mac).any():
        columns += [("MAC", ".3f", mac[0]), ("MAC 5 %", ".3f", mac[1])]
    what += in_brackets(note_of(idata))
    return Table.from_columns(f"Predictions, 95 % intervals of {what}", columns)


def pairing_table(idata: object, experiment: str | None = None) -> Table:
    """Tabulate which modes of the model were paired with the measured ones.

    There is one row per measured mode: the number of the model mode that was most often
    paired with it, the share of samples with another mode, mean and 5 % quantile of the
    MAC, the share of samples with a MAC below the ``min_mac`` of the model (0.5 by
    default), and the share of samples in which a comparison in ascending order (i-th
    measured with i-th model mode) would choose another mode. Use it to see whether
    modes change places, and whether pairing was needed.

    In the last row, the shares are those of samples in which this happens for any mode.
    The mode order is the list of all mode numbers; the title gives the share of samples
    in which it is not the most frequent one.

    Args:
        idata: The result of :func:`run` or :func:`to_inference_data`.
        experiment: Name of one experiment of a joint posterior; None for all that pair
            modes, below each other.

    Returns:
        The table, one row per measured mode, and one for all.

    Raises:
        ValueError: If the model does not pair modes.

    Examples:
        >>> import emcee_femu as ef
        >>> springs = {"k1": (0, 1, 10.0), "k2": (1, 2, 5.0)}
        >>> model = ef.MassSpringModel([1.0, 1.0], springs, shapes=True)
        >>> measured = ef.Measurements([0.66], sd=[0.01], shapes=[[1.9], [-1.0]])
        >>> prior = ef.GaussianPrior(["k1"], [10.0], [2.0], [(5.0, 20.0)])
        >>> paired = ef.PairedModel(model, measured)
        >>> posterior = ef.LogPosterior(paired, ef.FrequencyTerm(measured), prior)
        >>> run = ef.run(posterior, ef.DEMCMove(), 16, 50, ensembles=1, seed=1)
        >>> table = ef.pairing_table(run)
        >>> table.column("model's mode")
        ['2', '']
    """
    data, _ = read_samples(idata)
    response = dataset(data, "response")
    tests = [name for name in find_pairs(data) if name]
    if experiment is None and tests:
        tables = {name: pairing_table(data, name) for name in tests}
        title = f"Pairing with the model's modes{in_brackets(note_of(data))}"
        return Table.stack(title, tables)
    names = [f"{experiment}.{v}" if experiment else v for v in ("mac", "model_mode")]
    if not set(names) <= set(response.data_vars):
        remedy = "the model pairs no modes; wrap the model in a PairedModel"
        if tests:
            remedy = f"name one of {tests} with experiment="
        raise ValueError(f"idata, experiment: there is no {names[0]!r}; {remedy}")
    both = (response[name].transpose("chain", "draw", ...) for name in names)
    mac, model_mode = (values.values for values in both)
    limit = LOW_MAC
    if "constant_data" in data:
        stored = dataset(data, "constant_data")
        limit = float(stored.get(names[0].removesuffix("mac") + "min_mac", LOW_MAC))
    n, m = mac.shape[0] * mac.shape[1], mac.shape[2]
    mac, numbers = mac.reshape(n, m), model_mode.reshape(n, m).astype(int)
    usual = np.array([np.bincount(column).argmax() for column in numbers.T])
    orders, counts = np.unique(numbers, axis=0, return_counts=True)
    changed = (numbers != orders[counts.argmax()]).any(axis=1)

    def percent(
        happened: NDArray[np.bool_], in_any: NDArray[np.bool_] | None = None
    ) -> Floats:
        for_any = happened.any(axis=1) if in_any is None else in_any
        return 100 * np.append(happened.mean(axis=0), for_any.mean())

    columns: list[Column] = [
        ("mode", "", [*map(str, range(1, m + 1)), "any"]),
        ("model's mode", "", [*map(str, usual), ""]),
        ("another in %", ".2f", percent(numbers != usual, changed)),
        ("MAC", ".3f", np.append(mac.mean(axis=0), np.nan)),
        ("MAC 5 %", ".3f", np.append(np.quantile(mac, 0.05, axis=0), np.nan)),
        (f"MAC < {limit:g} in %", ".2f", percent(mac < limit)),
        ("wrong by index in %", ".2f", percent(numbers != np.arange(1, m + 1))),
    ]
    words = f" of {experiment!r}" if experiment else ""
    title = (
        f"Pairing with the model's modes{words}: their order changed in "
        f"{100 * changed.mean():.3g} % of {n} samples{in_brackets(note_of(data))}"
    )
    return Table.from_columns(title, columns)


def summarize(draws: Floats) -> Floats:
    """Return mean and ends of the 95 % interval of ``draws (n, m)``, ``(3, m)``."""
    return np.stack([draws.mean(axis=0), *np.quantile(draws, INTERVAL, axis=0)])


def _summarize_mac(part: Measured) -> Floats:
    """Return mean and 5 % quantile of the MAC, NaN where no modes were paired."""
    if part.mac is None:
        return np.full((2, len(part.values)), np.nan)
    return np.stack([part.mac.mean(axis=0), np.quantile(part.mac, 0.05, axis=0)])


def _name_rows(parts: list[Measured]) -> tuple[str, list[str], str]:
    """Return title and labels of the rows, and the unit for the titles of columns."""
    if len(parts) == 1:
        (only,) = parts
        return only.dims or "quantity", list(only.labels), f" {only.unit}".rstrip()
    labels = [f"{p.name}[{place}] {p.unit}" for p in parts for place in p.labels]
    return "quantity", [label.rstrip().replace("[]", "") for label in labels], ""


def _columns(published: Mapping[str, V] | None) -> list[tuple[str, V]]:
    """Return the further columns of a table by title."""
    if published is None:
        return []
    return list(checks.by_label("published", published, "columns").items())


def _percent_off(values: Floats, reference: Floats) -> Floats:
    """Return the relative errors in percent, NaN where the reference is zero."""
    return 100 * np.abs(values / np.where(reference == 0, np.nan, reference) - 1)
