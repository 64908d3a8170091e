"""The correlation of the parameters."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from .draws import changing_draws, say_certified
from .shown import show_once


def plot_correlation(idata: Any, *, var_names: Sequence[str] | None = None) -> Any:
    """Draw the correlation of the parameters as a map with numbers (Figs 4.4, 5.3).

    Args:
        idata: What :func:`to_inference_data` returns.
        var_names: Variables of its ``posterior`` group; default: the sampled ones.

    Returns:
        The matplotlib Figure.

    Raises:
        ValueError: If a parameter has the same value in all samples.

    Examples:
        >>> import emcee_femu as ef
        >>> posterior = ef.paper.mass_spring().posterior
        >>> samplers = ef.run(posterior, nwalkers=20, nsteps=100, seed=1)
        >>> idata = ef.to_inference_data(samplers, posterior, discard=50)
        >>> len(ef.plot_correlation(idata).axes)  # the map and its colour bar
        2
    """
    from matplotlib import pyplot as plt

    names, draws = changing_draws(idata, var_names)
    d = len(names)
    values = np.corrcoef(draws, rowvar=False).reshape(d, d)
    size = 1.8 + 0.7 * d
    figure, axes = plt.subplots(figsize=(size + 0.8, size), layout="constrained")
    image = axes.imshow(values, cmap="RdBu_r", vmin=-1, vmax=1)
    for (i, j), value in np.ndenumerate(values):
        color = "white" if abs(value) > 0.6 else "black"
        axes.text(j, i, f"{value:.2f}", ha="center", va="center", color=color)
    axes.set_xticks(range(d), names)
    axes.set_yticks(range(d), names)
    figure.colorbar(image, ax=axes, label="correlation", shrink=0.85)
    say_certified(figure, idata)
    figure.draw_without_rendering()  # the layout of square axes settles in two passes
    return show_once(figure)
