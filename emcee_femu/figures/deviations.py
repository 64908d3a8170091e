"""The panels of deviations from what was measured, and of the MAC."""

from typing import Any, NamedTuple

import numpy as np

from ..interfaces import Floats
from ..results.measured import Measured
from ..results.tables import INTERVAL
from .colours import BLUE, RED

FAR = 4.0  # times the updated deviations, beyond which the prior's go to the edge


class Compared(NamedTuple):
    """A variable measured at ``m`` places, and predicted there by ``n`` samples."""

    what: Measured
    labels: list[str]  # m
    below: str  # what the labels say
    sd: Floats  # (m,), NaN where unknown
    initial: Floats  # (m,), at the prior mean
    predicted: Floats  # (n, m)
    replicated: Floats | None  # (n, m), predicted with a measurement's error
    mac: Floats | None  # (n, m), where the variable is the frequency of paired modes


def draw_deviations(axes: Any, item: Compared) -> None:
    """Draw the variable before and after updating, and its measurement error."""
    measured, unit = item.what.values, item.what.unit
    scale = np.ones_like(measured)
    if unit == "Hz":
        scale, unit = 100 / measured, "%"
    place = np.arange(len(measured))
    mean, low, high = scale * (_summary(item.predicted) - measured)
    before = scale * (item.initial - measured)
    band = np.abs(2 * scale * item.sd)
    known = np.isfinite(band)
    shown = [np.zeros(1), low, high, -band[known], band[known]]
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
    if item.replicated is not None:
        ends = scale * (_summary(item.replicated)[1:] - measured)
        shown.extend(ends)
        label = "95 % of new measurements"
        axes.vlines(place, *ends, color=BLUE, lw=1.2, label=label)
    label = "updated model: mean (circle), 95 % interval"
    _draw_intervals(axes, mean, low, high, label)
    _draw_initial(axes, before, np.concatenate(shown), unit)
    old, new = (f"{np.abs(x).mean():.2g} {unit}".rstrip() for x in (before, mean))
    solved = np.isfinite(before).all()  # the model may fail at the prior mean
    title = f"{old} at the prior mean, {new} updated" if solved else f"{new} updated"
    axes.set_title(f"{item.what.name}: mean error {title}", fontsize=10)
    label = f"deviation from the\nmeasured {item.what.name}"
    axes.set_ylabel(f"{label} ({unit})" if unit else label)
    # A power of ten above the axis would stand in the title.
    axes.yaxis.set_major_formatter(lambda value, _: f"{value:.6g}")
    axes.grid(True, axis="y", alpha=0.25)


def draw_mac(axes: Any, mac: Floats) -> None:
    """Draw mean and 95 % interval of the MAC ``(n, m)``."""
    mean, low, high = _summary(mac)
    _draw_intervals(axes, mean, low, high)
    axes.axhline(1, color="black", lw=0.8)
    span = 1 - min(low.min(), 0.9)
    axes.set_ylim(1 - 1.1 * span, 1 + 0.1 * span)
    axes.set_ylabel("MAC\n(1: same shape)")
    axes.grid(True, axis="y", alpha=0.25)


def _draw_initial(axes: Any, before: Floats, shown: Floats, unit: str) -> None:
    """Draw the model at the prior mean, and set limits that hold what is ``shown``."""
    near = np.abs(before) <= FAR * np.abs(shown).max()
    inside = np.append(shown, before[near])
    margin = 0.08 * float(np.ptp(inside)) or 1.0  # all alike only in an exact fit
    room = 3 * margin  # for arrows
    low = inside.min() - margin - room * (before[~near] < 0).any()
    high = inside.max() + margin + room * (before[~near] > 0).any()
    near |= (low < before) & (before < high)
    far = np.isfinite(before) & ~near
    place = np.arange(len(before))
    label = "before updating: prior mean"
    style = {"color": RED, "mfc": "none", "ms": 7, "label": label}
    axes.plot(place[near] - 0.22, before[near], "D", **style)
    for x, value in zip(place[far], before[far], strict=True):
        axes.annotate(
            f"before:\n{value:+.3g} {unit}".rstrip(),
            (x, high if value > 0 else low),
            (x, high - room if value > 0 else low + room),
            color=RED,
            ha="center",
            va="bottom" if value > 0 else "top",
            fontsize=9,
            arrowprops={"arrowstyle": "-|>", "color": RED},
        )
    axes.set_ylim(low, high)


def _summary(draws: Floats) -> Floats:
    """Return mean and ends of the 95 % interval, ``(3, m)``."""
    return np.stack([draws.mean(axis=0), *np.quantile(draws, INTERVAL, axis=0)])


def _draw_intervals(
    axes: Any, mean: Floats, low: Floats, high: Floats, label: str | None = None
) -> None:
    place = np.arange(len(mean))
    axes.vlines(place, low, high, color=BLUE, lw=5, label=label)
    axes.plot(place, mean, "o", color="white", mec=BLUE, ms=5)
    axes.set_xlim(-0.6, len(mean) - 0.4)
