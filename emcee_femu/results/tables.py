"""Tables of parameters and frequencies."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .. import checks
from ..interfaces import Floats
from ..posterior.log_posterior import LogPosterior
from ..table import Table
from .frequencies import check_sampled, measured_frequencies, total_average_error
from .inference_data import dataset, samples


def parameter_table(
    idata: Any,
    nominal: Mapping[str, float] | None = None,
    published: Mapping[str, Mapping[str, float]] | None = None,
) -> Table:
    r"""Tabulate the updated parameters, as Tables 4.1 and 5.1 of the paper.

    Columns: initial (the prior mean), nominal and relative errors where the nominal is
    known, posterior mean, c.o.v. = sd / mean in percent, and the ratio of posterior to
    prior standard deviation: near 1 the data said nothing about the parameter.

    Args:
        idata: What :func:`to_inference_data` returns.
        nominal: Known true values by parameter name; None for a real structure.
        published: Further columns, ``{title: {parameter: value}}``.

    Raises:
        TypeError: If nominal or published is no such mapping.
        ValueError: If nominal or a published column names an unknown parameter.
    """
    names, chains = samples(idata)
    draws = chains.reshape(-1, len(names))
    constants = dataset(idata, "constant_data")
    initial, prior_sd = constants["initial"].values, constants["prior_sd"].values
    mean, sd = draws.mean(axis=0), draws.std(axis=0, ddof=1)
    columns: list[tuple[str, str, Any]] = [
        ("parameter", "", names),
        ("initial", ".5g", initial),
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
        ("c.o.v. %", ".2f", 100 * sd / np.abs(mean)),
        ("sd/prior sd", ".2f", sd / prior_sd),
    ]
    for title, values in _columns(published):
        columns.append((title, ".5g", _by_name(f"published[{title!r}]", values, names)))
    return Table.from_columns("Updating parameters", columns)


def frequency_table(
    idata: Any,
    posterior: LogPosterior | None = None,
    published: Mapping[str, Sequence[float]] | None = None,
) -> Table:
    r"""Tabulate measured, initial and updated frequencies, as Tables 4.2 and 5.2.

    The updated frequencies are the means of the predictions at all samples; with
    ``posterior`` they are those of the model at the mean of the parameters, as in the
    paper (one FE solve). Errors are ``100 |f_m - f| / f_m``; the last row holds their
    mean, the total average error TAE.

    Args:
        idata: What :func:`to_inference_data` returns.
        posterior: The sampled posterior, or None.
        published: Further columns, ``{title: one number a measured mode}``.

    Raises:
        TypeError: If published is no such mapping, or posterior no LogPosterior.
        ValueError: If there are no measured frequencies, a published column has
            another length, or posterior has other parameters.
    """
    measured = measured_frequencies(idata)
    m = len(measured)
    predicted = dataset(idata, "response")["frequency"]
    draws = predicted.transpose("chain", "draw", "mode").values
    draws = draws.reshape(-1, draws.shape[-1])[:, :m]
    initial = dataset(idata, "constant_data")["initial_frequency"].values[:m]
    updated = draws.mean(axis=0)
    if posterior is not None:
        names, chains = samples(idata)
        check_sampled(posterior, names)
        at_mean = posterior(chains.mean(axis=(0, 1)))
        updated = at_mean[posterior.columns["frequency"]][:m]

    def with_tae(values: ArrayLike) -> Floats:
        return np.append(100 * np.abs(np.asarray(values) / measured - 1), np.nan)

    def padded(values: ArrayLike) -> Floats:
        return np.append(np.asarray(values, dtype=float), np.nan)

    errors = [with_tae(initial), with_tae(updated)]
    errors[0][-1] = total_average_error(measured, initial)
    errors[1][-1] = total_average_error(measured, updated)
    columns: list[tuple[str, str, Any]] = [
        ("mode", "", [*map(str, range(1, m + 1)), "TAE"]),
        ("measured Hz", ".3f", padded(measured)),
        ("initial Hz", ".3f", padded(initial)),
        ("error %", ".2f", errors[0]),
        ("updated Hz", ".3f", padded(updated)),
        ("c.o.v. %", ".3f", padded(100 * draws.std(axis=0, ddof=1) / updated)),
        ("error % ", ".3f", errors[1]),
    ]
    for title, values in _columns(published):
        given = checks.numeric_array(f"published[{title!r}]", values)
        if given.shape not in ((m,), (m + 1,)):
            raise ValueError(
                f"published[{title!r}]: expected {m} numbers, or {m + 1} with the "
                f"TAE, got shape {given.shape}"
            )
        columns.append((title, ".4g", given if len(given) > m else padded(given)))
    return Table.from_columns("Natural frequencies", columns)


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
    with np.errstate(over="ignore"):  # of a known value next to zero
        np.divide(values, known, out=result, where=known != 0)
    return 100 * np.abs(result - 1)
