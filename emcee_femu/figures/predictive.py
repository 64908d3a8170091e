"""The figure of what was measured against what the model predicts."""

from math import ceil
from typing import Any

import numpy as np

from ..posterior.log_posterior import LogPosterior
from ..results.arviz_objects import samples
from ..results.frequencies import check_sampled
from ..results.measured import Measured, at_places, measured_variables
from ..results.predictive import measurement_sd
from .deviations import Compared, draw_deviations, draw_mac
from .draws import say_certified
from .shown import show_once

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
        TypeError: If posterior is not a LogPosterior.
        ValueError: If no measured variable is one of the response, or posterior has
            other parameters.

    Examples:
        >>> import emcee_femu as ef
        >>> posterior = ef.paper.mass_spring().posterior
        >>> samplers = ef.run(posterior, nwalkers=20, nsteps=100, seed=1)
        >>> idata = ef.to_inference_data(samplers, posterior, discard=50)
        >>> figure = ef.plot_predictive(idata, posterior)
        >>> len(figure.axes)  # no modes were paired
        1
    """
    from matplotlib import pyplot as plt

    if posterior is not None:
        check_sampled(posterior, samples(idata)[0])
    items = [_compare(idata, own, posterior) for own in measured_variables(idata)]
    heights = [h for i in items for h in ([3.4] if i.mac is None else [3.4, 1.7])]
    width = float(np.clip(1.6 + 0.8 * max(len(i.labels) for i in items), 7, 16))
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
    say_certified(figure, idata)
    where = {"loc": "outside lower center", "ncols": 2, "frameon": False}
    figure.legend(handles.values(), handles.keys(), **where)
    return show_once(figure)


def _compare(idata: Any, found: Measured, posterior: LogPosterior | None) -> Compared:
    """Gather what is known where a variable was measured."""

    def there(group: str, variable: str) -> Any:
        return at_places(idata, group, variable, found)

    labels = [
        f"{label}\n{value:.5g} {found.unit}".strip()
        for label, value in zip(found.labels, found.values, strict=True)
    ]
    below = f"measured {found.dims}, its {found.name}".replace(" , its", "")
    experiment, dot, variable = found.variable.rpartition(".")
    mac = None
    if variable == "frequency":
        mac = there("response", f"{experiment}{dot}mac")
    if mac is not None:
        below += ", and the model's mode paired with it"
        modes = there("response", f"{experiment}{dot}model_mode").astype(int)
        partners = map(_partner, modes.T)
        labels = [f"{a}\n{b}" for a, b in zip(labels, partners, strict=True)]
    unknown = np.full(len(labels), np.nan)
    return Compared(
        what=found,
        labels=labels,
        below=below,
        sd=unknown if posterior is None else measurement_sd(found, posterior),
        initial=there("constant_data", f"initial_{found.variable}")[0],
        predicted=there("response", found.variable),
        replicated=there("posterior_predictive", found.name),
        mac=mac,
    )


def _partner(numbers: Any) -> str:
    """Return the model's mode of most samples, with its share unless it is all."""
    counts = np.bincount(numbers)
    share = 100 * counts.max() / len(numbers)
    text = f"model's {counts.argmax()}"
    return text if share == 100 else f"{text}\nin {min(share, 99.9):.3g} %"
