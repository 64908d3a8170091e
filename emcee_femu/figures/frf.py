"""The figure of measured and predicted FRFs, and of what their lines tell."""

from typing import Any

import numpy as np

from ..interfaces import Floats
from ..posterior.log_posterior import LogPosterior
from ..results.arviz_objects import samples
from ..results.frequencies import check_sampled
from ..results.line_information import find_frf, inform_lines
from ..results.tables import INTERVAL
from .colours import BLUE, RED
from .shown import show_once

DRAWN = 200  # draws that are solved anew


def plot_frf(
    idata: Any, posterior: LogPosterior, *, experiment: str | None = None
) -> Any:
    r"""Draw measured and predicted amplitudes, and how much each line tells.

    One panel per channel: the measured amplitude is points, the updated model its 95 %
    interval, from 200 draws that are solved anew, since FRFs are not stored. Where the
    model has ``jacobian`` a last panel has :math:`\mathrm{tr}(\Sigma F_l)` of each
    line, all channels together, as a share of the sum over all lines.

    Args:
        idata: What :func:`to_inference_data` returns.
        posterior: The sampled posterior, one of its terms an :class:`FRFTerm`.
        experiment: Which one, where a joint posterior has several.

    Returns:
        The matplotlib Figure.

    Raises:
        TypeError: If posterior is not a LogPosterior.
        ValueError: If there is no FRFTerm or more than one, or posterior has other
            parameters than idata.

    Examples:
        >>> import numpy as np
        >>> import emcee_femu as ef
        >>> zero, unit = np.zeros((1, 1)), np.eye(1)
        >>> model = ef.MatrixModel(zero, unit, {"k": unit}, n_modes=1, shapes=True)
        >>> lines = np.linspace(0.2, 0.5, 20)
        >>> model = ef.FRFModel(model, lines, [(0, 0)], damping=0.05)
        >>> H = model({"k": np.array([4.0])})["receptance"][0] @ [1, 1j]
        >>> measured = ef.FRFMeasurements(lines, H, [(0, 0)], kind="receptance")
        >>> prior = ef.GaussianPrior(["k"], [4.0], [0.5], [(1.0, 9.0)])
        >>> posterior = ef.LogPosterior(model, ef.FRFTerm(measured, sd=0.1), prior)
        >>> samplers = ef.run(posterior, nwalkers=16, nsteps=50, seed=1)
        >>> idata = ef.to_inference_data(samplers, posterior)
        >>> len(ef.plot_frf(idata, posterior).axes)  # one channel, and what lines tell
        2
    """
    from matplotlib import pyplot as plt

    if not isinstance(posterior, LogPosterior):
        raise TypeError(
            f"posterior: expected a LogPosterior, got {type(posterior).__name__}"
        )
    names, draws = samples(idata)
    check_sampled(posterior, names)
    own, term = find_frf(posterior, experiment)
    order = [names.index(name) for name in posterior.names]
    theta = draws.reshape(-1, len(names))[:, order]
    some = theta[:: -(-len(theta) // DRAWN)]
    response = own.model(posterior.parameters(some.copy()))
    H = response[term.measured.kind]
    told = inform_lines(posterior, own, term, theta)
    channels, lines = term.measured.channels, term.measured.lines
    rows = len(channels) + (told is not None)
    figure, panels = plt.subplots(
        rows,
        1,
        figsize=(8, 1.0 + 2.3 * rows),
        sharex=True,
        layout="constrained",
        squeeze=False,
    )
    unit = term.reads[term.measured.kind].unit
    for i, channel in enumerate(channels):
        _draw_channel(panels[i, 0], lines, np.abs(term.measured.values[i]), H[:, i])
        panels[i, 0].set_ylabel(f"{channel.label}\n{term.measured.kind} ({unit})")
    if told is not None:
        axes = panels[-1, 0]
        axes.fill_between(lines, 100 * told / told.sum(), color=RED, alpha=0.5, lw=0)
        axes.set_ylabel("information\nof a line (%)")
        axes.set_ylim(bottom=0)
    panels[-1, 0].set_xlabel("frequency (Hz)")
    handles, labels = panels[0, 0].get_legend_handles_labels()
    where = {"loc": "outside lower center", "ncols": 2, "frameon": False}
    figure.legend(handles, labels, **where)
    return show_once(figure)


def _draw_channel(axes: Any, lines: Floats, measured: Floats, H: Floats) -> None:
    """Draw measured amplitudes, and the interval of predicted ones ``(n, l, 2)``."""
    amplitude = np.sqrt((H**2).sum(axis=-1))
    low, high = np.quantile(amplitude, INTERVAL, axis=0)
    label = "updated model, 95 %"
    axes.fill_between(lines, low, high, color=BLUE, alpha=0.6, lw=0.8, label=label)
    axes.plot(lines, measured, ".", color="black", ms=3, label="measured")
    axes.set_yscale("log")
    axes.grid(True, alpha=0.25)
