"""What figures share: colours, the samples shown, and how a notebook shows a figure."""

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from ..interfaces import Floats
from ..results.arviz_objects import InferenceData, describe_certificate, samples

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Style: TypeAlias = dict[str, Any]  # keyword arguments of matplotlib

# Red is what counts, blue what it is compared with.
RED, BLUE, GREY = "#c8102e", "#1f5fa8", "0.45"
BELOW: Style = {
    "loc": "outside lower center",
    "ncols": 2,
    "frameon": False,
}  # of a legend


def changing_draws(
    idata: InferenceData, var_names: Sequence[str] | None
) -> tuple[list[str], Floats]:
    """Return names and draws ``(n, d)``, refusing a parameter that never changes."""
    names, chains = samples(idata, var_names)
    draws = chains.reshape(-1, len(names))
    for name, column in zip(names, draws.T, strict=True):
        if np.ptp(column) == 0:
            raise ValueError(f"idata: every sample of {name!r} is {column[0]:g}")
    return names, draws


def finish(figure: "Figure", idata: InferenceData | None = None) -> "Figure":
    """Return a figure of pyplot, which a notebook will show once.

    Above it stands what :func:`certify` said of its samples, if it did.

    When a cell ends a notebook shows the figures that pyplot holds, and before that
    the value of the last line: what a function draws and returns would come twice. Our
    figures leave pyplot when they are shown as a value. Scripts are left alone.
    """
    import matplotlib

    if idata is not None and (text := describe_certificate(idata).strip(" ()")):
        figure.suptitle(f"{text[:1].upper()}{text[1:]}", fontsize=10)
    if "inline" in matplotlib.get_backend():
        show = partial(_leave_pyplot, figure)
        figure._ipython_display_ = show  # type: ignore[attr-defined]
    return figure


def _leave_pyplot(figure: "Figure") -> None:
    """Close a figure, and leave it to IPython to show it as ever."""
    from matplotlib import pyplot as plt

    plt.close(figure)
    raise NotImplementedError  # how IPython is told so
