"""The error of the mean so far, generation by generation."""

from typing import Any

import numpy as np

from ..interfaces import Floats
from ..posterior.log_posterior import LogPosterior
from ..results.frequencies import running_tae
from .draws import say_certified
from .shown import show_once


def plot_tae(idata: Any, posterior: LogPosterior, experiment: str | None = None) -> Any:
    """Draw the total average error of the running mean (Figs 4.3, 5.4).

    Args:
        idata: What :func:`to_inference_data` returns, best without burn-in removed,
            or several as ``{label: idata}`` of the same posterior.
        posterior: The sampled posterior.
        experiment: Name of one experiment of a joint posterior.

    Returns:
        The matplotlib Figure.

    Raises:
        TypeError: If posterior is not a LogPosterior.
        ValueError: If no term of it has measured frequencies, it has other parameters,
            or there is no idata.

    Examples:
        >>> import emcee_femu as ef
        >>> posterior = ef.paper.mass_spring().posterior
        >>> samplers = ef.run(posterior, nwalkers=20, nsteps=100, seed=1)
        >>> idata = ef.to_inference_data(samplers, posterior, discard=50)
        >>> figure = ef.plot_tae(idata, posterior)
        >>> figure.axes[0].get_ylabel()
        'total average error of the mean so far (%)'
    """
    from matplotlib import pyplot as plt

    given = dict(idata) if isinstance(idata, dict) else {"": idata}
    if not given:
        raise ValueError("idata: expected at least one, got none")
    curves = {
        label: running_tae(item, posterior, experiment=experiment)
        for label, item in given.items()
    }
    figure, axes = plt.subplots(figsize=(6.4, 4.0), layout="constrained")
    for label, (generations, tae) in curves.items():
        end = f"ends at {tae[-1]:.3g} %"
        axes.plot(generations, tae, label=f"{label}, {end}" if label else end)
    scale_error_axes(axes, [tae for _, tae in curves.values()])
    axes.set_xlabel("generation")
    axes.legend(frameon=False)
    for item in given.values():
        say_certified(figure, item)
    return show_once(figure)


def scale_error_axes(axes: Any, errors: list[Floats]) -> None:
    """Label the axes of errors in percent; logarithmic where a decade is passed."""
    from matplotlib import ticker

    axes.set(xscale="log", ylabel="total average error of the mean so far (%)")
    axes.xaxis.set_major_formatter("{x:g}")
    values = np.concatenate(errors)
    if values.max() > 10 * values.min():
        axes.set_yscale("log")
        axes.yaxis.set_major_locator(ticker.LogLocator(subs=(1, 2, 5)))
        axes.yaxis.set_minor_formatter(ticker.NullFormatter())
        axes.yaxis.set_major_formatter("{x:g}")
    axes.grid(True, which="both", alpha=0.25)
