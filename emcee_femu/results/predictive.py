"""Measured against predicted: any measured variable, and which modes were paired."""

from typing import Any

import numpy as np

from ..interfaces import Floats
from ..posterior.log_posterior import LogPosterior
from ..table import Table
from .arviz_objects import dataset, describe_certificate, samples
from .frequencies import check_sampled
from .measured import Measured, at_places, measured_variables
from .tables import INTERVAL

LOW_MAC = 0.5  # the default of PairedModel, below which a pair does not mean much


def predictive_table(idata: Any, posterior: LogPosterior | None = None) -> Table:
    r"""Tabulate what was measured against the posterior's predictions.

    One row per measured value of the response: mean and 95 % interval (the 2.5 % and
    97.5 % quantiles) of the prediction, and whether the measured value lies inside.
    Without ``posterior`` the prediction is the model's at every sample, and the
    interval is how uncertain the parameters leave it; the measured value, with its
    error, need not lie inside. With ``posterior`` it is a new measurement, such as

    .. math:: \tilde f_i = f_i(\theta) + f_i^m (\eta_i + \sigma_d \varepsilon_i),
        \qquad \eta \sim N(0, R), \quad \varepsilon \sim N(0, I),

    with the measurement error R and discrepancy :math:`\sigma_d` of a
    :class:`FrequencyTerm`; at least 95 % of the measured values, which the posterior
    has seen, should lie inside. The column ``sd`` holds :math:`f_i^m R_{ii}^{1/2}`
    where it is known. Where modes were paired, there are the mean and the 5 % quantile
    of the MAC too.

    Args:
        idata: What :func:`to_inference_data` returns.
        posterior: The sampled posterior, or None for the model's prediction only.

    Returns:
        The table, one row per measured value.

    Raises:
        TypeError: If posterior is not a LogPosterior.
        ValueError: If nothing of the response was measured, or posterior has other
            parameters or no term that draws new measurements.

    Examples:
        >>> import emcee_femu as ef
        >>> posterior = ef.paper.mass_spring().posterior
        >>> samplers = ef.run(posterior, nwalkers=20, nsteps=100, seed=1)
        >>> idata = ef.to_inference_data(samplers, posterior, discard=50)
        >>> ef.predictive_table(idata, posterior).column("inside")
        ['yes', 'yes', 'yes', 'yes', 'yes']
    """
    found = measured_variables(idata)
    group, what = "response", "the model alone"
    if posterior is not None:
        check_sampled(posterior, samples(idata)[0])
        group = "posterior_predictive"
        what = "a new measurement, with its error and the discrepancy"
    draws = np.concatenate([_draws(idata, group, own) for own in found], axis=1)
    measured = np.concatenate([own.values for own in found])
    low, high = np.quantile(draws, INTERVAL, axis=0)
    title, labels, unit = _rows(found)
    spec = ".3f" if unit == " Hz" else ".5g"
    columns: list[tuple[str, str, Any]] = [
        (title, "", labels),
        (f"measured{unit}", spec, measured),
        (f"predicted{unit}", spec, draws.mean(axis=0)),
        ("2.5 %", spec, low),
        ("97.5 %", spec, high),
        ("inside", "", np.where((low <= measured) & (measured <= high), "yes", "no")),
    ]
    if posterior is not None:
        sd = np.concatenate([measurement_sd(own, posterior) for own in found])
        columns.insert(2, (f"sd{unit}", ".3g", sd))
    mac = [_mac(idata, own) for own in found]
    if any(np.isfinite(own).any() for own in mac):
        mean, lowest = np.concatenate(mac, axis=1)
        columns += [("MAC", ".3f", mean), ("MAC 5 %", ".3f", lowest)]
    what += describe_certificate(idata)
    return Table.from_columns(f"Predictions, 95 % intervals of {what}", columns)


def _draws(idata: Any, group: str, found: Measured) -> Floats:
    name = found.variable if group == "response" else found.name
    draws = at_places(idata, group, name, found)
    if draws is None:
        raise ValueError(
            f"posterior: no term draws new measurements of {found.name!r} (its "
            "replicate), so that their error is not known; leave posterior out"
        )
    return draws


def _rows(found: list[Measured]) -> tuple[str, list[str], str]:
    """Return title and labels of the rows, and the unit for the titles of columns."""
    if len(found) == 1:
        (own,) = found
        return own.dims or "quantity", list(own.labels), f" {own.unit}".rstrip()
    labels = [
        f"{own.name}[{place}] {own.unit}" for own in found for place in own.labels
    ]
    return "quantity", [label.rstrip().replace("[]", "") for label in labels], ""


def _mac(idata: Any, found: Measured) -> Floats:
    """Return mean and 5 % quantile of the MAC of measured frequencies, ``(2, m)``."""
    experiment, dot, variable = found.variable.rpartition(".")
    mac = None
    if variable == "frequency":
        mac = at_places(idata, "response", f"{experiment}{dot}mac", found)
    if mac is None:
        return np.full((2, len(found.values)), np.nan)
    return np.stack([mac.mean(axis=0), np.quantile(mac, 0.05, axis=0)])


def measurement_sd(found: Measured, posterior: LogPosterior) -> Floats:
    """Return the standard deviations of what was measured, NaN where unknown."""
    for experiment in posterior.experiments:
        for term, own in zip(experiment.terms, experiment.term_names, strict=True):
            observed = getattr(term, "observed", {})
            for variable, sd in getattr(term, "error_sd", {}).items():
                name = experiment.full_name(variable)
                if found.name in (name, f"{name}[{own}]") and np.array_equal(
                    np.ravel(observed[variable]), found.values
                ):
                    return np.where(sd > 0, sd, np.nan).ravel()
    return np.full(len(found.values), np.nan)


def pairing_table(idata: Any, experiment: str | None = None) -> Table:
    """Tabulate which of the model's modes were paired with the measured ones.

    One row per measured mode: the number of the model's mode that it has in most
    samples, the share of samples in which it has another, mean and 5 % quantile of the
    MAC, the share of samples with a MAC below 0.5, and the share in which a comparison
    in ascending order, the i-th measured with the model's i-th, takes another mode.

    In the last row the shares are those of samples in which this holds for any mode.
    The order of the modes is the list of all numbers; the title says in which share of
    the samples it is not the most frequent one.

    Args:
        idata: What :func:`to_inference_data` returns.
        experiment: Name of one experiment of a joint posterior.

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
        >>> samplers = ef.run(posterior, nwalkers=16, nsteps=50, seed=1)
        >>> table = ef.pairing_table(ef.to_inference_data(samplers, posterior))
        >>> table.column("model's mode")
        ['2', '']
    """
    response = dataset(idata, "response")
    names = [f"{experiment}.{v}" if experiment else v for v in ("mac", "model_mode")]
    if not set(names) <= set(response.data_vars):
        paired = [v[: -len(".mac")] for v in map(str, response) if v.endswith(".mac")]
        remedy = "the model pairs no modes; wrap the model in a PairedModel"
        if paired:
            remedy = f"name one of {paired} with experiment="
        raise ValueError(f"idata, experiment: there is no {names[0]!r}; {remedy}")
    mac, model_mode = (
        response[name].transpose("chain", "draw", ...).values for name in names
    )
    n, m = mac.shape[0] * mac.shape[1], mac.shape[2]
    mac, numbers = mac.reshape(n, m), model_mode.reshape(n, m).astype(int)
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
        f"{100 * changed.mean():.3g} % of {n} samples{describe_certificate(idata)}"
    )
    return Table.from_columns(title, columns)
