"""The figure of measured against predicted modes."""

from typing import Any

import numpy as np

from ..interfaces import Floats
from ..posterior.log_posterior import LogPosterior
from ..results.frequencies import measured_frequencies, total_average_error
from ..results.inference_data import dataset
from ..results.predictive import (
    INTERVAL,
    frequency_term,
    has_pairing,
    measurement_sd,
    predicted,
    replicated,
)
from .colours import BLUE, RED

FAR = 4.0  # times the updated deviations, beyond which the initial ones go to the edge


def plot_predictive(idata: Any, posterior: LogPosterior | None = None) -> Any:
    """Draw how far the predicted frequencies lie from the measured ones, and the MAC.

    Above, in percent of each measured frequency: the model before updating (at the
    prior mean) as a diamond, or, where that would shrink all else, as an arrow with a
    number; the updated model's mean and 95 % interval over the samples. With
    ``posterior``, the measured frequency +- 2 standard deviations as a band where its
    :class:`FrequencyTerm` knows them, and, where it infers a discrepancy, a thin line
    for the 95 % interval of a new measurement with error and discrepancy. Below, where
    modes are paired: mean and 95 % interval of the MAC, and the model's mode that is
    paired most often.

    Args:
        idata: What :func:`to_inference_data` returns.
        posterior: The sampled posterior, or None for no measurement errors.

    Returns:
        The matplotlib Figure.

    Raises:
        ValueError: If there are no measured frequencies, or posterior has no
            FrequencyTerm with them or other parameters.
    """
    measured = measured_frequencies(idata)
    m = len(measured)
    draws = predicted(idata, "frequency")[:, :m]
    initial = dataset(idata, "constant_data")["initial_frequency"].values[:m]
    new, sd = None, np.full(m, np.nan)
    if posterior is not None:
        sd = measurement_sd(idata, posterior)
        if frequency_term(idata, posterior).discrepancy is not None:
            new = replicated(idata, posterior)

    from matplotlib import pyplot as plt

    paired = has_pairing(idata)
    figure, panels = plt.subplots(
        1 + paired,
        1,
        figsize=(max(7.0, 1.6 + 0.8 * m), 6.4 if paired else 4.6),
        height_ratios=[2.0, 1.0] if paired else [1.0],
        sharex=True,
        layout="constrained",
        squeeze=False,
    )
    top, bottom = panels[0, 0], panels[-1, 0]
    _draw_deviations(top, measured, initial, draws, sd, new)
    labels = [f"{i}\n{hertz:.5g} Hz" for i, hertz in enumerate(measured, 1)]
    if paired:
        _draw_mac(bottom, predicted(idata, "mac")[:, :m])
        numbers = predicted(idata, "model_mode")[:, :m].astype(int)
        labels = [
            f"{label}\n{_partner(column)}"
            for label, column in zip(labels, numbers.T, strict=True)
        ]
    bottom.set_xticks(range(m), labels)
    bottom.set_xlim(-0.6, m - 0.4)
    under = ", and the model's mode paired with it" if paired else ""
    bottom.set_xlabel(f"measured mode, its frequency{under}")
    before = total_average_error(measured, initial)
    after = total_average_error(measured, draws.mean(axis=0))
    figure.suptitle(
        f"Mean error of the frequencies: {before:.2g} % before updating, {after:.2g} % "
        "after",
        fontsize=12,
    )
    figure.legend(
        *top.get_legend_handles_labels(),
        loc="outside lower center",
        frameon=False,
        ncols=2,
    )
    return figure


def _draw_deviations(
    axes: Any,
    measured: Floats,
    initial: Floats,
    draws: Floats,
    sd: Floats,
    new: Floats | None,
) -> None:
    place = np.arange(len(measured))
    band = 200 * sd / measured
    known = np.isfinite(band)
    mean, low, high = 100 * (_summary(draws) / measured - 1)
    shown = np.concatenate([[0.0], low, high, -band[known], band[known]])
    axes.axhline(0, color="black", lw=0.8)
    if known.any():
        axes.bar(
            place[known],
            2 * band[known],
            bottom=-band[known],
            width=0.7,
            color="0.85",
            label="measured ± 2 sd",
        )
    if new is not None:
        _, lowest, highest = 100 * (_summary(new) / measured - 1)
        shown = np.concatenate([shown, lowest, highest])
        label = "95 % of new measurements, with discrepancy"
        axes.vlines(place, lowest, highest, color=BLUE, lw=1.2, label=label)
    _draw_intervals(
        axes, mean, low, high, label="updated model: mean (circle), 95 % interval"
    )
    before = 100 * (initial / measured - 1)
    near, limits, room = _frame(shown, before)
    axes.plot(
        place[near] - 0.22,
        before[near],
        "D",
        ms=7,
        color=RED,
        mfc="none",
        label="model before updating",
    )
    for x, value in zip(place[~near], before[~near], strict=True):
        _draw_arrow(axes, x, value, limits[int(value > 0)], room)
    axes.set_ylim(limits)
    axes.set_ylabel("deviation from the\nmeasured frequency (%)")
    axes.grid(True, axis="y", alpha=0.25)


def _frame(shown: Floats, before: Floats) -> tuple[Any, Floats, float]:
    """Return which initial values are drawn, the limits, and the room for arrows."""
    near = np.abs(before) <= FAR * np.abs(shown).max()
    while True:
        inside = np.append(shown, before[near])
        margin = 0.08 * float(np.ptp(inside)) or 1.0  # all alike only in an exact fit
        room, far = 3 * margin, before[~near]
        low = inside.min() - margin - room * (far < 0).any()
        high = inside.max() + margin + room * (far > 0).any()
        fits = near | ((low <= before) & (before <= high))
        if (fits == near).all():
            return near, np.array([low, high]), room
        near = fits  # the room for the others' arrows holds it


def _draw_arrow(axes: Any, x: float, value: float, edge: float, room: float) -> None:
    """Point to a value beyond the edge, with its number."""
    axes.annotate(
        f"before:\n{value:+.3g} %",
        (x, edge),
        (x, edge - np.sign(value) * room),
        color=RED,
        ha="center",
        va="bottom" if value > 0 else "top",
        fontsize=9,
        arrowprops={"arrowstyle": "-|>", "color": RED},
    )


def _draw_mac(axes: Any, mac: Floats) -> None:
    mean, low, high = _summary(mac)
    _draw_intervals(axes, mean, low, high)
    axes.axhline(1, color="black", lw=0.8)
    span = 1 - min(low.min(), 0.9)
    axes.set_ylim(1 - 1.1 * span, 1 + 0.1 * span)
    axes.set_ylabel("MAC\n(1: same shape)")
    axes.grid(True, axis="y", alpha=0.25)


def _summary(draws: Floats) -> Floats:
    """Return mean and ends of the 95 % interval, ``(3, m)``."""
    return np.stack([draws.mean(axis=0), *np.quantile(draws, INTERVAL, axis=0)])


def _draw_intervals(
    axes: Any, mean: Floats, low: Floats, high: Floats, label: str | None = None
) -> None:
    place = np.arange(len(mean))
    axes.vlines(place, low, high, color=BLUE, lw=5, label=label)
    axes.plot(place, mean, "o", color="white", mec=BLUE, ms=5)


def _partner(numbers: Any) -> str:
    """Return the model's mode of most samples, with its share unless it is all."""
    counts = np.bincount(numbers)
    share = 100 * counts.max() / len(numbers)
    text = f"model's {counts.argmax()}"
    return text if share == 100 else f"{text}\nin {min(share, 99.9):.3g} %"
