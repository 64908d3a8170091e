"""The figure of measured and predicted FRFs."""

import numpy as np
from matplotlib.figure import Figure

from ... import checks
from ...figures.style import BELOW, BLUE, Style, finish, subplots
from ...posterior.log_posterior import LogPosterior
from ...results.arviz_objects import samples
from ...results.tables import INTERVAL
from ...results.to_arviz import read_samples
from ...sampling.judge import spread_out
from .term import FRFTerm

FRF_DRAWS = 200  # draws that are solved anew


def plot_frf(
    idata: object,
    posterior: LogPosterior | None = None,
    *,
    experiment: str | None = None,
) -> Figure:
    """Draw measured and predicted amplitudes.

    One panel per channel: the measured amplitude is points, the updated model its 95 %
    interval, from 200 draws that are solved anew, since FRFs are not stored.

    Args:
        idata: What :func:`to_inference_data` returns, or :func:`run`.
        posterior: The sampled posterior, one of its terms an :class:`FRFTerm`; known of
            a run.
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
        >>> model = ef.frf.FRFModel(model, lines, [(0, 0)], damping=0.05)
        >>> H = model({"k": np.array([4.0])})["receptance"][0] @ [1, 1j]
        >>> measured = ef.frf.FRFMeasurements(lines, H, [(0, 0)], kind="receptance")
        >>> prior = ef.GaussianPrior(["k"], [4.0], [0.5], [(1.0, 9.0)])
        >>> posterior = ef.LogPosterior(model, ef.frf.FRFTerm(measured, sd=0.1), prior)
        >>> run = ef.run(posterior, ef.DEMCMove(), 16, 50, ensembles=1, seed=1)
        >>> len(ef.frf.plot_frf(run).axes)  # one channel
        1
    """
    idata, posterior = read_samples(idata, posterior)
    posterior = checks.instance("posterior", posterior, LogPosterior)
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
        style: Style = {"color": BLUE, "alpha": 0.6, "lw": 0.8, "label": label}
        axes.fill_between(measured.lines, *ends[:, i], **style)
        style = {"color": "black", "ms": 3, "label": "measured"}
        axes.plot(measured.lines, np.abs(measured.values[i]), ".", **style)
        axes.set_yscale("log")
        axes.grid(True, alpha=0.25)
        axes.set_ylabel(f"{channel.label}\n{measured.kind} ({unit})")
    panels[-1].set_xlabel("frequency (Hz)")
    figure.legend(handles=panels[0].get_legend_handles_labels()[0], **BELOW)
    return finish(figure, idata)
