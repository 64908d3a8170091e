"""Tables of parameters and frequencies."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .. import checks
from ..interfaces import Floats
from ..posterior.log_posterior import LogPosterior
from ..table import Table
from .arviz_objects import dataset, describe_certificate, samples
from .frequencies import check_sampled, total_average_error
from .measured import at_places, measured_frequencies

INTERVAL = (0.025, 0.975)


def parameter_table(
    idata: Any,
    nominal: Mapping[str, float] | None = None,
    published: Mapping[str, Mapping[str, float]] | None = None,
    var_names: Sequence[str] | None = None,
) -> Table:
    r"""Tabulate the updated parameters, as Tables 4.1 and 5.1 of the paper.

    Columns: the prior mean, nominal and relative errors where the nominal is known,
    posterior mean, its 95 % interval (the 2.5 % and 97.5 % quantiles), c.o.v. = sd /
    mean in percent, and the ratio of posterior to prior standard deviation: near 1 the
    data said nothing about the parameter.

    Args:
        idata: What :func:`to_inference_data` returns.
        nominal: Known true values by parameter name; None for a real structure.
        published: Further columns, ``{title: {parameter: value}}``.
        var_names: Rows, with quantities that were added to the ``posterior`` group;
            None for the sampled parameters.

    Returns:
        The table, one row per parameter.

    Raises:
        TypeError: If nominal or published is not such a mapping.
        ValueError: If nominal, a published column or var_names names an unknown
            parameter.

    Examples:
        >>> import emcee_femu as ef
        >>> posterior = ef.paper.mass_spring().posterior
        >>> samplers = ef.run(posterior, nwalkers=20, nsteps=100, seed=1)
        >>> idata = ef.to_inference_data(samplers, posterior, discard=50)
        >>> table = ef.parameter_table(idata)
        >>> [round(mean / 1e3) for mean in table.column("mean")[:3]]  # N/mm
        [4, 2, 2]
    """
    names, chains = samples(idata, var_names)
    draws = chains.reshape(-1, len(names))
    constants = dataset(idata, "constant_data").reindex(parameter=names)
    initial, prior_sd = constants["initial"].values, constants["prior_sd"].values
    mean, sd = draws.mean(axis=0), draws.std(axis=0, ddof=1)
    low, high = np.quantile(draws, INTERVAL, axis=0)
    columns: list[tuple[str, str, Any]] = [
        ("parameter", "", names),
        ("prior mean", ".5g", initial),
    ]
    if nominal is not None:
        known = _by_name("nominal", nominal, names)
        columns += [
            ("nominal", ".5g", known),
            ("error %", ".2f", _percent_off(initial, known)),
        ]
    columns.append(("mean", ".5g", mean))
    if nominal is not None:
        columns.append(("error % ", ".2f", _percent_off(mean, known)))
    columns += [
        ("2.5 %", ".5g", low),
        ("97.5 %", ".5g", high),
        ("c.o.v. %", ".2f", 100 * sd / np.abs(mean)),
        ("sd/prior sd", ".2f", sd / prior_sd),
    ]
    for title, values in _columns(published):
        columns.append((title, ".5g", _by_name(f"published[{title!r}]", values, names)))
    title = f"Updating parameters{describe_certificate(idata)}"
    return Table.from_columns(title, columns)


def frequency_table(
    idata: Any,
    posterior: LogPosterior | None = None,
    published: Mapping[str, Sequence[float]] | None = None,
    experiment: str | None = None,
) -> Table:
    r"""Tabulate measured, initial and updated frequencies, as Tables 4.2 and 5.2.

    The initial frequencies are those at the prior mean of the parameters. The updated
    ones are the means of the predictions at all samples; with ``posterior`` they are
    those of the model at the posterior mean of the parameters, as in the paper (one FE
    solve). Errors are ``100 |f_m - f| / f_m``; the last row holds their mean, the total
    average error TAE.

    Args:
        idata: What :func:`to_inference_data` returns.
        posterior: The sampled posterior, or None.
        published: Further columns, ``{title: one number per measured mode}``.
        experiment: Name of one experiment of a joint posterior.

    Returns:
        The table, one row per measured mode.

    Raises:
        TypeError: If published is not such a mapping, or posterior not a
            LogPosterior.
        ValueError: If there are no measured frequencies, a published column has
            another length, or posterior has other parameters.

    Examples:
        >>> import emcee_femu as ef
        >>> posterior = ef.paper.mass_spring().posterior
        >>> samplers = ef.run(posterior, nwalkers=20, nsteps=100, seed=1)
        >>> idata = ef.to_inference_data(samplers, posterior, discard=50)
        >>> table = ef.frequency_table(idata)
        >>> table.column("mode")
        ['1', '2', '3', '4', '5', 'TAE']
    """
    found = measured_frequencies(idata, experiment)
    measured, m = found.values, len(found.values)
    draws = at_places(idata, "response", found.variable, found)
    initial = at_places(idata, "constant_data", f"initial_{found.variable}", found)
    if draws is None or initial is None:
        raise ValueError(f"idata: its response does not hold {found.name!r}")
    updated, what = draws.mean(axis=0), "mean of samples"
    if posterior is not None:
        names, chains = samples(idata)
        check_sampled(posterior, names)
        at_mean = posterior(chains.mean(axis=(0, 1)))
        updated = at_mean[posterior.columns[found.variable]][:m]
        what = "at posterior mean"

    def pad(values: ArrayLike) -> Floats:
        return np.append(np.asarray(values, dtype=float), np.nan)

    def with_tae(values: Floats) -> Floats:
        errors = 100 * np.abs(values / measured - 1)
        return np.append(errors, total_average_error(measured, values))

    columns: list[tuple[str, str, Any]] = [
        (found.dims, "", [*found.labels, "TAE"]),
        ("measured Hz", ".3f", pad(measured)),
        ("at prior mean Hz", ".3f", pad(initial[0])),
        ("error %", ".2f", with_tae(initial[0])),
        (f"{what} Hz", ".3f", pad(updated)),
        ("c.o.v. %", ".3f", pad(100 * draws.std(axis=0, ddof=1) / updated)),
        ("error % ", ".3f", with_tae(updated)),
    ]
    for title, values in _columns(published):
        given = checks.numeric_array(f"published[{title!r}]", values)
        if given.shape not in ((m,), (m + 1,)):
            raise ValueError(
                f"published[{title!r}]: expected {m} numbers, or {m + 1} with the "
                f"TAE, got shape {given.shape}"
            )
        columns.append((title, ".4g", given if len(given) > m else pad(given)))
    words = f" of {experiment!r}" if experiment else ""
    words += describe_certificate(idata)
    return Table.from_columns(f"Natural frequencies{words}", columns)


def _columns(published: Any) -> list[tuple[str, Any]]:
    """Return the further columns of a table by title."""
    if published is None:
        return []
    if not isinstance(published, Mapping):
        raise TypeError(
            f"published: expected {{title: column}}, got {type(published).__name__}"
        )
    for title in published:
        if not isinstance(title, str):
            raise TypeError(f"published: expected titles that are text, got {title!r}")
    return list(published.items())


def _by_name(argument: str, values: Mapping[str, float], names: list[str]) -> Floats:
    """Return a number for each name, NaN where there is none."""
    known = checks.by_name(argument, values, names)
    result = np.full(len(names), np.nan)
    for name, value in known.items():
        number = checks.numeric_array(f"{argument}[{name!r}]", value)
        if number.shape != ():
            raise ValueError(
                f"{argument}[{name!r}]: expected a number, got shape {number.shape}"
            )
        result[names.index(name)] = number
    return result


def _percent_off(values: Floats, known: Floats) -> Floats:
    """Return the relative errors in percent, NaN where the known value is zero."""
    result: Floats = np.full(len(known), np.nan)
    np.divide(values, known, out=result, where=known != 0)
    return 100 * np.abs(result - 1)
