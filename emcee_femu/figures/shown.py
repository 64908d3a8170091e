"""How a notebook comes to show a figure once."""

from functools import partial
from typing import Any


def show_once(figure: Any) -> Any:
    """Return a figure of pyplot, which a notebook will show once.

    When a cell ends a notebook shows the figures that pyplot holds, and before that
    the value of the last line: what a function draws and returns would come twice. Our
    figures leave pyplot when they are shown as a value. Scripts are left alone.
    """
    import matplotlib

    if "inline" in matplotlib.get_backend():
        figure._ipython_display_ = partial(_leave_pyplot, figure)
    return figure


def _leave_pyplot(figure: Any) -> None:
    """Close a figure, and leave it to IPython to show it as ever."""
    from matplotlib import pyplot as plt

    plt.close(figure)
    raise NotImplementedError  # how IPython is told so
