"""The figure of model classes: how far behind each is, and how probable."""

import textwrap
from typing import Any

import numpy as np

from ..comparison.classes import LEAD, ModelComparison
from .colours import BLUE, GREY, RED
from .shown import show_once

LABEL_WIDTH = 28  # characters per line
LEAST = 0.001  # probability that is written as a number
FAR = 25.0  # log evidence behind the first beyond which a class is only named


def plot_model_comparison(comparison: ModelComparison) -> Any:
    """Draw the log Bayes factors of model classes against the first, and probabilities.

    Left: the best on top; bars of two combined standard errors, beyond which a class is
    called behind, and no bar where no error can be claimed. Hollow: undecided. Right:
    probabilities given the data.

    Args:
        comparison: What :func:`compare_models` returns.

    Returns:
        The matplotlib Figure.

    Raises:
        TypeError: If it is something else.

    Examples:
        >>> import emcee_femu as ef
        >>> from emcee_femu.results.evidence import Evidence
        >>> one, four = Evidence(-12.3, 0.1, "known"), Evidence(-9.1, 0.1, "known")
        >>> comparison = ef.compare_models({"one factor": one, "four factors": four})
        >>> len(ef.plot_model_comparison(comparison).axes)
        2
    """
    if not isinstance(comparison, ModelComparison):
        raise TypeError(
            "comparison: expected what compare_models returns, got "
            f"{type(comparison).__name__}"
        )
    from matplotlib import pyplot as plt

    column = comparison.table.column
    labels, verdicts = column("model class"), column("verdict")
    behind = -np.array(column("ln Bayes factor"))
    errors = LEAD * np.array(column("its +-"))
    rows = np.arange(len(labels))
    figure, (left, right) = plt.subplots(
        1,
        2,
        figsize=(9.0, 1.9 + 0.55 * len(rows)),
        layout="constrained",
        sharey=True,
        width_ratios=[1.6, 1.0],
    )
    left.axvline(0.0, color=GREY, lw=0.8)
    for row, verdict in enumerate(verdicts):
        if behind[row] < -FAR:  # it would hide how the others differ
            place = {"xycoords": left.get_yaxis_transform(), "va": "center"}
            left.annotate(f"{behind[row]:.0f}, far left", (0.02, row), **place)
            continue
        colour = RED if row == 0 else BLUE
        known = np.isfinite(errors[row])
        left.errorbar(
            behind[row],
            row,
            xerr=errors[row] if row and known else None,
            fmt="o",
            color=colour,
            mfc="white" if verdict == "undecided" else colour,
            capsize=4,
        )
        if not known:
            where = {"xytext": (8, 4), "textcoords": "offset points"}
            left.annotate("no error can be claimed", (behind[row], row), **where)
    left.margins(x=0.12, y=0.2)
    left.set_yticks(rows, [textwrap.fill(label, LABEL_WIDTH) for label in labels])
    left.invert_yaxis()
    left.set_xlabel("log evidence less that of the first (natural)")
    bars = right.barh(
        rows,
        column("probability"),
        height=0.55,
        color=[RED if row == 0 else BLUE for row in rows],
    )
    shares = [f"{p:.3f}" if p >= LEAST else f"< {LEAST}" for p in column("probability")]
    right.bar_label(bars, shares, padding=4, fontsize=9)
    right.set_xlim(0, 1.2)
    right.set_xticks([0, 0.5, 1])
    right.set_xlabel("probability given the data")
    for axes in (left, right):
        axes.spines[["top", "right"]].set_visible(False)
    headline = comparison.conclusion.splitlines()[0]
    figure.suptitle(textwrap.fill(headline, 90), fontsize=11)
    return show_once(figure)
