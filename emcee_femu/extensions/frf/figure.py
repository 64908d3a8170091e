"""Measured and predicted amplitudes of frequency response functions."""

import numpy as np
from matplotlib.figure import Figure

from ...figures.style import BELOW, BLUE, Style, finish, subplots
from ...posterior.log_posterior import LogPosterior
from ...results.arviz_objects import samples
from ...results.measured import INTERVAL
from ...results.to_arviz import read_samples_and_model
from ...verdict.statistics import spread_out
from .model import FRFTerm

FRF_DRAWS = 200  # draws that are solved again


def plot_frf(
    idata: object,
    posterior: LogPosterior | None = None,
    *,
    experiment: str | None = None,
) -> Figure:
    """Draw measured and predicted amplitudes of frequency response functions.

    There is one panel per channel. Points are the measured amplitude; the band is the
    95 % interval of the updated model, from 200 draws. They are solved again, because
    FRFs are not stored.

    Args:
        idata: The result of :func:`run` or :func:`to_inference_data`.
        posterior: The sampled posterior, with an :class:`FRFTerm`, if idata is an ArviZ
            object.
        experiment: Name of one experiment of a joint posterior.

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
        >>> model = ef.frf.FRFModel(model, lines, [(0, 0)], damping=0.05)
        >>> H = model({"k": np.array([4.0])})["receptance"][0] @ [1, 1j]
        >>> measured = ef.frf.FRFMeasurements(lines, H, [(0, 0)], kind="receptance")
        >>> prior = ef.GaussianPrior(["k"], [4.0], [0.5], [(1.0, 9.0)])
        >>> posterior = ef.LogPosterior(model, ef.frf.FRFTerm(measured, sd=0.1), prior)
        >>> run = ef.run(posterior, ef.DEMCMove(), 16, 50, ensembles=1, seed=1)
        >>> len(ef.frf.plot_frf(run).axes)  # one channel
        1
    """
    idata, posterior = read_samples_and_model(idata, posterior)
    pairs = [
        (measured_in.model, term.measured, term.reads)
        for measured_in in posterior.experiments
        for term in measured_in.terms
        if isinstance(term, FRFTerm) and experiment in (None, measured_in.name)
    ]
    if len(pairs) != 1:
        names = [measured_in.name for measured_in in posterior.experiments]
        raise ValueError(
            f"posterior, experiment: expected one FRFTerm, found {len(pairs)}; name "
            f"one of the experiments {names} with experiment="
        )
    ((model, measured, reads),) = pairs
    theta = samples(idata)[1].reshape(-1, posterior.ndim)
    some = theta[spread_out(len(theta), FRF_DRAWS)]
    H = model(posterior.parameters(some))[measured.kind]
    ends = np.quantile(np.sqrt((H**2).sum(axis=-1)), INTERVAL, axis=0)
    rows = len(measured.channels)
    figure, panels = subplots(rows, 1, (8.0, 1.0 + 2.3 * rows), sharex=True)
    unit, label = reads[measured.kind].unit, "updated model, 95 %"
    for i, (axes, channel) in enumerate(zip(panels, measured.channels, strict=True)):
        style: Style = {"color": "0.55", "ms": 5, "mew": 0, "label": "measured"}
        axes.plot(measured.lines, np.abs(measured.values[i]), "o", **style)
        # Its edges show where it is narrower than a line, on the points.
        style = {"fc": (BLUE, 0.3), "ec": BLUE, "lw": 1.0, "label": label, "zorder": 3}
        axes.fill_between(measured.lines, *ends[:, i], **style)
        axes.set_yscale("log")
        axes.grid(True, alpha=0.25)
        axes.set_ylabel(f"{channel.label}\n{measured.kind} ({unit})")
    panels[-1].set_xlabel("frequency (Hz)")
    figure.legend(handles=panels[0].get_legend_handles_labels()[0], **BELOW)
    return finish(figure, idata)
