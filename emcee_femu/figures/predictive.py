"""The figure of what was measured against what the model predicts."""

from itertools import product
from math import ceil
from typing import Any

import numpy as np

from ..interfaces import Floats
from ..likelihoods.frequency import FrequencyTerm
from ..posterior.log_posterior import LogPosterior
from ..results.frequencies import check_sampled
from ..results.inference_data import dataset, samples
from .deviations import Compared, draw_deviations, draw_mac

MOST_LABELS = 24  # below a panel


def plot_predictive(idata: Any, posterior: LogPosterior | None = None) -> Any:
    """Draw how far predictions lie from what was measured, and the MAC.

    One panel per measured variable, with the deviations from its measured values: in
    percent for frequencies, in its own unit for any other. The model before updating,
    at the prior mean, is a diamond, or, where that would shrink all else, an arrow with
    a number; the updated model is its mean and 95 % interval over the samples. A thin
    line is the 95 % interval of a new measurement, with its error and any inferred
    discrepancy. With ``posterior``, bands are measured frequencies +- 2 standard
    deviations where its :class:`FrequencyTerm` knows them. Where modes are paired, a
    panel below has the mean and 95 % interval of the MAC, and the model's mode that is
    paired most often.

    Args:
        idata: What :func:`to_inference_data` returns.
        posterior: The sampled posterior, or None for no measurement errors.

    Returns:
        The matplotlib Figure.

    Raises:
        TypeError: If posterior is no LogPosterior.
        ValueError: If no measured variable is one of the response, or posterior has
            other parameters.
    """
    from matplotlib import pyplot as plt

    if posterior is not None:
        check_sampled(posterior, samples(idata)[0])
    items = [_compare(idata, name, posterior) for name in _measured_names(idata)]
    heights = [h for i in items for h in ([3.4] if i.mac is None else [3.4, 1.7])]
    width = float(np.clip(1.6 + 0.8 * max(len(i.measured) for i in items), 7, 16))
    figure, panels = plt.subplots(
        len(heights),
        1,
        figsize=(width, 1.2 + sum(heights)),
        height_ratios=heights,
        layout="constrained",
        squeeze=False,
    )
    remaining = iter(panels[:, 0])
    handles: dict[str, Any] = {}
    for item in items:
        axes = next(remaining)
        draw_deviations(axes, item)
        found, labels = axes.get_legend_handles_labels()
        handles |= dict(zip(labels, found, strict=True))
        if item.mac is not None:
            axes.set_xticks([])
            axes = next(remaining)
            draw_mac(axes, item.mac)
        step = ceil(len(item.labels) / MOST_LABELS)
        axes.set_xticks(range(0, len(item.labels), step), item.labels[::step])
        axes.set_xlabel(item.below)
    where = {"loc": "outside lower center", "ncols": 2, "frameon": False}
    figure.legend(handles.values(), handles.keys(), **where)
    return figure


def _measured_names(idata: Any) -> list[str]:
    """Return the measured variables that the response holds."""
    try:
        observed = list(map(str, dataset(idata, "observed_data").data_vars))
    except ValueError:
        observed = []
    response = list(map(str, dataset(idata, "response").data_vars))
    names = [name for name in observed if name in response]
    if not names:
        raise ValueError(
            f"idata: expected measured variables of the response {response}, got "
            f"{observed}; no likelihood term says what it observed"
        )
    return names


def _compare(idata: Any, name: str, posterior: LogPosterior | None) -> Compared:
    """Gather a variable where it was measured."""
    observed = dataset(idata, "observed_data")[name]
    kept = np.isfinite(observed.values).ravel()

    def at_places(group: str, variable: str) -> Any:
        """Return ``(n, m)`` for samples, ``(1, m)`` for constants, None without any."""
        try:
            values = dataset(idata, group)[variable]
        except (KeyError, ValueError):
            return None
        places = values.reindex_like(observed).transpose(..., *observed.dims)
        return places.values.reshape(-1, observed.size)[:, kept]

    measured = observed.values.ravel()[kept]
    unit = observed.attrs.get("unit", "")
    places = list(product(*(observed[dim].values for dim in observed.dims)))
    labels = [
        f"{', '.join(map(str, places[i]))}\n{value:.5g} {unit}".rstrip()
        for i, value in zip(np.flatnonzero(kept), measured, strict=True)
    ]
    dims = ", ".join(str(dim).rpartition(".")[2] for dim in observed.dims)
    below = f"measured {dims}, its {name}"
    mac = None
    if name.rpartition(".")[2] == "frequency":
        mac = at_places("response", name.replace("frequency", "mac"))
    if mac is not None:
        modes = at_places("response", name.replace("frequency", "model_mode"))
        below += ", and the model's mode paired with it"
        partners = map(_partner, modes.astype(int).T)
        labels = [f"{a}\n{b}" for a, b in zip(labels, partners, strict=True)]
    return Compared(
        name=name,
        unit=unit,
        labels=labels,
        below=below,
        measured=measured,
        sd=_measured_sd(posterior, name, measured),
        initial=at_places("constant_data", f"initial_{name}")[0],
        predicted=at_places("response", name),
        replicated=at_places("posterior_predictive", name),
        mac=mac,
    )


def _measured_sd(posterior: LogPosterior | None, name: str, measured: Floats) -> Floats:
    """Return standard deviations in Hz, NaN where no FrequencyTerm knows them."""
    for experiment in () if posterior is None else posterior.experiments:
        for term in experiment.terms:
            if (
                isinstance(term, FrequencyTerm)
                and experiment.full_name("frequency") == name
                and np.array_equal(term.measured, measured)
            ):
                known = term.relative_variances
                sd: Floats = measured * np.sqrt(np.where(known > 0, known, np.nan))
                return sd
    return np.full(measured.shape, np.nan)


def _partner(numbers: Any) -> str:
    """Return the model's mode of most samples, with its share unless it is all."""
    counts = np.bincount(numbers)
    share = 100 * counts.max() / len(numbers)
    text = f"model's {counts.argmax()}"
    return text if share == 100 else f"{text}\nin {min(share, 99.9):.3g} %"
