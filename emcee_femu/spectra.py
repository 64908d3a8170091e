"""Ambient vibration: spectra, and the modes that they tell of."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import block_diag

from . import checks
from .interfaces import Floats
from .likelihoods.spectrum import SpectrumTerm as SpectrumTerm
from .measurements import Measurements
from .measurements.spectra import Spectra as Spectra
from .models.spectrum import SpectrumModel as SpectrumModel
from .results import arviz_objects
from .results.arviz_objects import InferenceData

DIMENSIONS = {  # of what is read of a posterior
    "frequency": ("sample", "mode"),
    "damping_ratio": ("sample", "mode"),
    "shapes": ("sample", "sensor", "mode"),
}


def modes_from_spectra(
    posteriors: Mapping[str, InferenceData], *, dofs: ArrayLike | None = None
) -> Measurements:
    r"""Return the modes of several bands as :class:`Measurements`.

    .. math:: \bar x = \frac1N \sum_i x_i, \qquad
        C = \frac{1}{N - 1} \sum_i (x_i - \bar x)(x_i - \bar x)^T

    over the draws: means and the covariance of the frequencies, means and standard
    deviations of damping ratios and of shapes of unit length. Bands hold different
    lines and are independent; the two modes of a pair are not.

    Args:
        posteriors: ``{label: idata}``, one for each band, of posteriors of a
            :class:`SpectrumModel` at the same sensors.
        dofs: The model's DOF at each sensor.

    Returns:
        The modes of all bands, ascending.

    Raises:
        TypeError: If posteriors is no mapping of ArviZ objects.
        ValueError: If there are none, one has no draws of modes, or sensors differ.

    Examples:
        >>> import numpy as np
        >>> from scipy.signal import lfilter
        >>> import emcee_femu as ef
        >>> noise = np.random.default_rng(1).standard_normal((4000, 1))
        >>> record = lfilter([1.0], [1.0, -1.6, 0.97], noise, axis=0)  # 0.99 Hz, 2.4 %
        >>> spectra = ef.spectra.Spectra.from_record(record, rate=10.0, band=(0.8, 1.2))
        >>> model = ef.spectra.SpectrumModel(spectra)
        >>> term = ef.spectra.SpectrumTerm(spectra)
        >>> bounds = [(0.9, 1.1), (0.01, 0.1), (-9, 9), (-9, 9)]
        >>> prior = ef.GaussianPrior(model.names, [1, 0.03, 0, 0], [1, 1, 9, 9], bounds)
        >>> posterior = ef.LogPosterior(model, term, prior)
        >>> samplers = ef.run(posterior, ef.DEMCMove(), steps=300, ensembles=1, seed=1)
        >>> idata = ef.to_inference_data(samplers, posterior, discard=100)
        >>> modes = ef.spectra.modes_from_spectra({"first": idata})
        >>> modes.frequencies.round(1).tolist()
        [1.0]
    """
    form = "{label: idata}, one of each band"
    if arviz_objects.is_arviz(posteriors) or not posteriors:
        kind = type(posteriors).__name__
        raise TypeError(f"posteriors: expected {form}, got {kind}")
    checks.mapping("posteriors", posteriors, form)
    bands = [_read(label, idata) for label, idata in posteriors.items()]
    sensors = bands[0][1]
    for label, (_, others) in zip(posteriors, bands, strict=True):
        if others != sensors:
            raise ValueError(f"posteriors: {label!r} has {others}, others {sensors}")
    frequencies = [draws["frequency"] for draws, _ in bands]
    mean, sd = {}, {}
    order = np.argsort(np.concatenate([f.mean(axis=0) for f in frequencies]))
    for name in DIMENSIONS:  # modes of all bands side by side
        means = [draws[name].mean(axis=0) for draws, _ in bands]
        deviations = [draws[name].std(axis=0, ddof=1) for draws, _ in bands]
        mean[name] = np.concatenate(means, axis=-1)[..., order]
        sd[name] = np.concatenate(deviations, axis=-1)[..., order]
    pair = any(f.shape[1] > 1 for f in frequencies)
    blocks = block_diag(*(np.cov(f, rowvar=False) for f in frequencies))
    return Measurements(
        mean["frequency"],
        sd=None if pair else sd["frequency"],
        covariance=blocks[np.ix_(order, order)] if pair else None,
        shapes=mean["shapes"],
        # That of a single sensor is 1, without error.
        shape_sd=sd["shapes"] if len(sensors) > 1 else None,
        sensors=sensors,
        dofs=dofs,
        damping=mean["damping_ratio"],
        damping_sd=sd["damping_ratio"],
    )


def _read(label: str, idata: InferenceData) -> tuple[dict[str, Floats], list[str]]:
    """Return the draws of one band by variable, and the sensors."""
    try:
        response = arviz_objects.dataset(idata, "response")
        stacked = response[[*DIMENSIONS]].stack(sample=("chain", "draw"))
        draws = {k: stacked[k].transpose(*d).values for k, d in DIMENSIONS.items()}
        return draws, [str(sensor) for sensor in response["sensor"].values]
    except (KeyError, TypeError, ValueError) as error:
        raise TypeError(
            f"posteriors: {label!r} has no draws of {', '.join(DIMENSIONS)}; expected "
            "what to_inference_data returns for the posterior of a SpectrumModel"
        ) from error
