"""The likelihood of measured frequency response functions, and their figure."""

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from ... import checks
from ...contracts import Parameters, Response, Variable, read
from ...figures.style import BELOW, BLUE, Style, finish, subplots
from ...likelihoods.term import (
    MODEL_ERROR,
    Deviations,
    Term,
    add_discrepancy,
    error_array,
)
from ...posterior.log_posterior import LogPosterior
from ...results.arviz_objects import samples
from ...results.tables import INTERVAL
from ...results.to_arviz import read_samples
from ...sampling.judge import spread_out
from .measurements import FRFMeasurements, frf_variable

FRF_DRAWS = 200  # draws that are solved again
# In words and as a formula in HTML, for reports.
BY_AMPLITUDE = (
    "The deviations of the logarithms of the amplitudes from the measured ones are "
    "Gaussian, line by line. s is the standard deviation of the measurement.",
    "ln |<i>H<sub>l</sub></i>(θ)| − ln |<i>H<sub>l</sub></i><sup>m</sup>| ~ N(0, "
    "<i>s<sub>l</sub></i><sup>2</sup> / |<i>H<sub>l</sub></i><sup>m</sup>|"
    "<sup>2</sup> + σ<sub>d</sub><sup>2</sup>)",
)
BY_PARTS = (
    "The deviations of the frequency response from the measured one are Gaussian, line "
    "by line, in their real and imaginary parts. s is the standard deviation of the "
    "measurement.",
    "<i>H<sub>l</sub></i>(θ) − <i>H<sub>l</sub></i><sup>m</sup> ~ N(0, "
    "<i>s<sub>l</sub></i><sup>2</sup> + (σ<sub>d</sub> "
    "|<i>H<sub>l</sub></i><sup>m</sup>|)<sup>2</sup>)",
)


class FRFTerm(Term):
    r"""Gaussian likelihood of frequency response functions (FRFs), line by line.

    .. math:: \ln p = \sum_{cl} \ln N(\mathrm{Re}\,\Delta_{cl}; 0, v_{cl})
        + \ln N(\mathrm{Im}\,\Delta_{cl}; 0, v_{cl}), \qquad
        v_{cl} = s_{cl}^2 + (\sigma_d |H_{cl}^m|)^2

    where :math:`\Delta = H - H^m`, for channel c at line l. With ``amplitude=True`` the
    logarithm of the amplitude is compared instead,

    .. math:: \ln p = \sum_{cl} \ln N\Big( \ln \frac{|H_{cl}|}{|H_{cl}^m|}; 0,
        \frac{s_{cl}^2}{|H_{cl}^m|^2} + \sigma_d^2 \Big)

    Use this if the phases are unreliable; antiresonances then count as much as
    resonances. The lines must be independent, as those of averaged FFTs without zero
    padding are.

    Args:
        measured: :class:`FRFMeasurements`.
        sd: s, the standard deviation of the real and of the imaginary part: one number,
            one per channel ``(n_channels, 1)``, or ``(n_channels, n_lines)``; computed
            from the coherence by default.
        amplitude: Whether to compare amplitudes only.
        discrepancy: Name of the parameter :math:`\sigma_d`, the discrepancy of the
            model relative to the amplitude; None for no discrepancy.
        name: The label under which the log-likelihood is stored.

    Raises:
        TypeError: If measured is not FRFMeasurements.
        ValueError: If the error is unknown, sd is not positive or has another shape, or
            only magnitudes were measured and ``amplitude`` is False.

    Source: Bendat and Piersol, Random Data, 4th ed. (2010), section 9.2.

    Examples:
        >>> import numpy as np
        >>> from emcee_femu.extensions.frf import FRFMeasurements, FRFTerm
        >>> measured = FRFMeasurements([9.0], [[2j]], [("a", "b")], kind="receptance")
        >>> term = FRFTerm(measured, sd=0.1)
        >>> term({}, {"receptance": np.array([[[[0.0, 2.1]]]])}).round(4).tolist()
        [2.2673]
    """

    reads: Mapping[str, Variable]
    symbol = MODEL_ERROR

    def __init__(
        self,
        measured: FRFMeasurements,
        *,
        sd: ArrayLike | None = None,
        amplitude: bool = False,
        discrepancy: str | None = None,
        name: str = "frf",
    ) -> None:
        self.measured = checks.instance("measured", measured, FRFMeasurements)
        self.label(name, discrepancy)
        self.amplitude = checks.flag("amplitude", amplitude)
        self.statement, self.formula = BY_AMPLITUDE if self.amplitude else BY_PARTS
        if not (self.amplitude or measured.values.imag.any()):
            raise ValueError(
                "measured: expected complex values with their phases, got real ones "
                "alone; of magnitudes take FRFTerm(..., amplitude=True)"
            )
        shape, spread = measured.values.shape, measured.sd
        if (self.amplitude or sd is None) and not measured.values.all():
            i, j = np.argwhere(measured.values == 0)[0]
            raise ValueError(
                f"measured: {measured.channels[i].label} is 0 at {measured.lines[j]:g} "
                "Hz, which has no relative error and no logarithm; give sd without "
                "amplitude, or leave such lines out"
            )
        if sd is not None:
            spread = error_array("sd", sd, (shape[0], 1), shape)
        elif spread is None and discrepancy is None:
            raise ValueError("sd: measured has no coherence; give sd or discrepancy")
        # (n_channels, n_lines); zero if exact
        self.sd = np.broadcast_to(0.0 if spread is None else spread, shape)
        kind, unit = measured.kind, measured.unit
        self.reads = {kind: frf_variable(measured.channels, measured.lines, kind, unit)}

    def deviations(self, parameters: Parameters, response: Response) -> Deviations:
        """Return deviations and their standard deviations, ``(n, m)`` each.

        For amplitudes they are those of the logarithms.
        """
        channels, lines = self.measured.values.shape
        H = read(response, self.measured.kind)[:, :channels, :lines]
        size = np.abs(self.measured.values)
        if self.amplitude:
            with np.errstate(divide="ignore"):  # an FRF of 0 is impossible, not wrong
                r = 0.5 * np.log((H**2).sum(axis=-1)) - np.log(size)
            r, sd, scale = r[..., None], self.sd / size, np.ones_like(size)
        else:
            values = self.measured.values
            r = H - np.stack([values.real, values.imag], axis=-1)
            sd, scale = self.sd, size
        if self.discrepancy is not None:
            sigma = parameters[self.discrepancy][:, None, None]
            sd = add_discrepancy(sd**2, sigma * scale)
        sd = np.broadcast_to(sd[..., None], r.shape)
        return r.reshape(len(r), -1), sd.reshape(len(r), -1)


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
