"""The modes that posteriors of spectra tell, as measurements."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import block_diag

from ..interfaces import Floats
from ..measurements import Measurements
from .arviz_objects import dataset

READ = ("frequency", "damping_ratio", "shapes")


class Drawn(NamedTuple):
    """Draws of one band, ``(draws, modes)`` and ``(draws, sensors, modes)``."""

    frequencies: Floats
    damping: Floats
    shapes: Floats
    sensors: list[str]


def modes_from_spectra(
    posteriors: Mapping[str, Any], *, dofs: ArrayLike | None = None
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
        >>> spectra = ef.Spectra.from_record(record, rate=10.0, band=(0.8, 1.2))
        >>> model, term = ef.SpectrumModel(spectra), ef.SpectrumTerm(spectra)
        >>> bounds = [(0.9, 1.1), (0.01, 0.1), (-9, 9), (-9, 9)]
        >>> prior = ef.GaussianPrior(model.names, [1, 0.03, 0, 0], [1, 1, 9, 9], bounds)
        >>> posterior = ef.LogPosterior(model, term, prior)
        >>> samplers = ef.run(posterior, nsteps=300, seed=1)
        >>> idata = ef.to_inference_data(samplers, posterior, discard=100)
        >>> ef.modes_from_spectra({"first": idata}).frequencies.round(1).tolist()
        [1.0]
    """
    alone = hasattr(posteriors, "posterior")  # an ArviZ object is a mapping too
    if alone or not isinstance(posteriors, Mapping) or not posteriors:
        raise TypeError(
            "posteriors: expected {label: idata}, one of each band, got "
            f"{type(posteriors).__name__}"
        )
    found = [_read(label, idata) for label, idata in posteriors.items()]
    sensors = found[0].sensors
    for label, own in zip(posteriors, found, strict=True):
        if own.sensors != sensors:
            raise ValueError(
                f"posteriors: {label!r} has the sensors {own.sensors}, others {sensors}"
            )
    f, f_sd = _summarize([own.frequencies for own in found])
    zeta, zeta_sd = _summarize([own.damping for own in found])
    shapes, shape_sd = _summarize([own.shapes for own in found])
    order = np.argsort(f)
    covariance = None
    if any(own.frequencies.shape[1] > 1 for own in found):
        blocks = [np.cov(own.frequencies, rowvar=False) for own in found]
        covariance = block_diag(*blocks)[np.ix_(order, order)]
    return Measurements(
        f[order],
        sd=f_sd[order] if covariance is None else None,
        covariance=covariance,
        shapes=shapes[:, order],
        # That of a single sensor is 1, without error.
        shape_sd=shape_sd[:, order] if len(sensors) > 1 else None,
        sensors=sensors,
        dofs=dofs,
        damping=zeta[order],
        damping_sd=zeta_sd[order],
    )


def _summarize(draws: list[Floats]) -> tuple[Floats, Floats]:
    """Return means and standard deviations, modes of all bands side by side."""
    means = np.concatenate([own.mean(axis=0) for own in draws], axis=-1)
    return means, np.concatenate([own.std(axis=0, ddof=1) for own in draws], axis=-1)


def _read(label: str, idata: Any) -> Drawn:
    """Return the draws of one band."""
    try:
        response = dataset(idata, "response")
        stacked = response[[*READ]].stack(sample=("chain", "draw"))
        return Drawn(
            stacked["frequency"].transpose("sample", "mode").values,
            stacked["damping_ratio"].transpose("sample", "mode").values,
            stacked["shapes"].transpose("sample", "sensor", "mode").values,
            [str(sensor) for sensor in response["sensor"].values],
        )
    except (KeyError, TypeError, ValueError) as error:
        raise TypeError(
            f"posteriors: {label!r} has no draws of {', '.join(READ)}; expected what "
            "to_inference_data returns for the posterior of a SpectrumModel"
        ) from error
