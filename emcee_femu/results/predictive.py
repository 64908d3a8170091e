"""Measured against predicted: frequencies, MAC, and which modes were paired."""

from typing import Any

import numpy as np

from ..interfaces import Floats
from ..likelihoods.frequency import FrequencyTerm
from ..posterior.log_posterior import LogPosterior
from ..table import Table
from .frequencies import check_sampled, measured_frequencies
from .inference_data import dataset, samples

LOW_MAC = 0.5  # the default of PairedModel, below which a pair does not mean much
INTERVAL = (0.025, 0.975)


def predictive_table(idata: Any, posterior: LogPosterior | None = None) -> Table:
    r"""Tabulate the measured frequencies against the posterior's predictions.

    A row a measured mode: mean and 95 % interval (the 2.5 % and 97.5 % quantiles) of
    the prediction, and whether the measured frequency lies inside. Without
    ``posterior`` the prediction is the model's at every sample, and the interval is how
    uncertain the parameters leave it; the measured value, with its error, need not lie
    inside. With ``posterior`` it is a new measurement,

    .. math:: \tilde f_i = f_i(\theta) + f_i^m \sqrt{R_{ii} + \sigma_d^2} \,
        \varepsilon, \qquad \varepsilon \sim N(0, 1),

    with the measurement error R and discrepancy :math:`\sigma_d` of its
    :class:`FrequencyTerm`; at least 95 % of the measured values, which the posterior
    has seen, should lie inside. The column ``sd Hz`` holds :math:`f_i^m R_{ii}^{1/2}`
    where it is known. Where the modes were paired, there are the mean and the 5 %
    quantile of the MAC too.

    Args:
        idata: What :func:`to_inference_data` returns.
        posterior: The sampled posterior, or None for the model's prediction alone.

    Raises:
        ValueError: If there are no measured frequencies, or posterior has no
            FrequencyTerm with them or other parameters.
    """
    measured = measured_frequencies(idata)
    draws = predicted(idata, "frequency")[:, : len(measured)]
    what, sd = "the model alone", np.full(len(measured), np.nan)
    if posterior is not None:
        what = "a new measurement, with its error and the discrepancy"
        sd = measurement_sd(idata, posterior)
        draws = replicated(idata, posterior)
    low, high = np.quantile(draws, INTERVAL, axis=0)
    inside = (low <= measured) & (measured <= high)
    columns: list[tuple[str, str, Any]] = [
        ("mode", "d", np.arange(1, len(measured) + 1)),
        ("measured Hz", ".3f", measured),
        ("sd Hz", ".3g", sd),
        ("predicted Hz", ".3f", draws.mean(axis=0)),
        ("2.5 %", ".3f", low),
        ("97.5 %", ".3f", high),
        ("inside", "", np.where(inside, "yes", "no")),
    ]
    if posterior is None:
        del columns[2]
    if has_pairing(idata):
        mac = predicted(idata, "mac")[:, : len(measured)]
        columns.append(("MAC", ".3f", mac.mean(axis=0)))
        columns.append(("MAC 5 %", ".3f", np.quantile(mac, 0.05, axis=0)))
    return Table.from_columns(
        f"Predicted frequencies, 95 % intervals of {what}", columns
    )


def pairing_table(idata: Any) -> Table:
    """Tabulate which of the model's modes were paired with the measured ones.

    A row a measured mode: the number of the model's mode that it has in most samples,
    the share of samples in which it has another, mean and 5 % quantile of the MAC, the
    share of samples with a MAC below 0.5, and the share in which a comparison in
    ascending order, the i-th measured with the model's i-th, takes another mode.

    In the last row the shares are those of samples in which this holds of any mode. The
    order of the modes is the list of all numbers; the title says in which share of the
    samples it is not the most frequent one.

    Args:
        idata: What :func:`to_inference_data` returns.

    Raises:
        ValueError: If the model does not pair modes.
    """
    if not has_pairing(idata):
        raise ValueError(
            "idata: it holds no MAC, since its model pairs no modes; wrap the model "
            "in a pairing.PairedModel"
        )
    mac, numbers = predicted(idata, "mac"), predicted(idata, "model_mode").astype(int)
    n, m = numbers.shape
    usual = np.array([np.bincount(column).argmax() for column in numbers.T])
    orders, counts = np.unique(numbers, axis=0, return_counts=True)
    order = orders[counts.argmax()]

    def percent(happened: Any, in_any: Any) -> list[float]:
        return [*(100 * happened.mean(axis=0)).tolist(), 100 * float(in_any.mean())]

    low, by_index = mac < LOW_MAC, numbers != np.arange(1, m + 1)
    changed = (numbers != order).any(axis=1)
    columns: list[tuple[str, str, Any]] = [
        ("mode", "", [*map(str, range(1, m + 1)), "any"]),
        ("model's mode", "", [*map(str, usual), ""]),
        ("another in %", ".2f", percent(numbers != usual, changed)),
        ("MAC", ".3f", [*mac.mean(axis=0).tolist(), np.nan]),
        ("MAC 5 %", ".3f", [*np.quantile(mac, 0.05, axis=0).tolist(), np.nan]),
        ("MAC < 0.5 in %", ".2f", percent(low, low.any(axis=1))),
        ("wrong by index in %", ".2f", percent(by_index, by_index.any(axis=1))),
    ]
    title = (
        "Pairing with the model's modes: their order changed in "
        f"{100 * changed.mean():.3g} % of {n} samples"
    )
    return Table.from_columns(title, columns)


def has_pairing(idata: Any) -> bool:
    """Return whether the model paired its modes with the measured ones."""
    return "mac" in dataset(idata, "response")


def predicted(idata: Any, what: str) -> Floats:
    """Return frequency, mac or model_mode of all samples, ``(n, n_modes)``."""
    values = dataset(idata, "response")[what]
    array: Floats = values.transpose("chain", "draw", "mode").values
    return array.reshape(-1, array.shape[-1])


def measurement_sd(idata: Any, posterior: LogPosterior) -> Floats:
    """Return the measured standard deviations in Hz, NaN where unknown, ``(m,)``."""
    term = frequency_term(idata, posterior)
    variances = term.relative_variances
    known = np.where(variances > 0, variances, np.nan)
    result: Floats = term.measured * np.sqrt(known)
    return result


def replicated(idata: Any, posterior: LogPosterior) -> Floats:
    """Return one new measurement in Hz a sample, ``(n, m)``, always the same draws."""
    term = frequency_term(idata, posterior)
    names, chains = samples(idata)
    variances = term.relative_variances
    if term.discrepancy is not None:
        sigma = chains[..., names.index(term.discrepancy)].reshape(-1, 1)
        variances = variances + sigma**2
    frequencies = predicted(idata, "frequency")[:, : term.n_modes]
    errors = np.random.default_rng(0).standard_normal(frequencies.shape)
    return frequencies + term.measured * np.sqrt(variances) * errors


def frequency_term(idata: Any, posterior: LogPosterior) -> FrequencyTerm:
    """Return the term with the measured frequencies of idata."""
    names, _ = samples(idata)
    check_sampled(posterior, names)
    measured = measured_frequencies(idata)
    for term in posterior.terms:
        if isinstance(term, FrequencyTerm) and np.array_equal(term.measured, measured):
            return term
    raise ValueError(
        "posterior: it has no FrequencyTerm with the measured frequencies of idata, so "
        "that the measurement error is not known; leave posterior out"
    )
