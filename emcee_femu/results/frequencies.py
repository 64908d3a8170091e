"""The error of predicted frequencies, as in the tables and figures of the paper."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from .. import checks
from ..interfaces import Floats
from ..posterior.log_posterior import LogPosterior
from .arviz_objects import dataset, samples
from .measured import measured_frequencies


def running_tae(
    idata: Any,
    posterior: LogPosterior,
    points: int = 200,
    experiment: str | None = None,
) -> tuple[Floats, Floats]:
    r"""Return generations and the total average error of the mean so far, in percent.

    .. math:: TAE(i) = \frac{100}{N_m} \sum_j \frac{|f_j^m - f_j(\bar\theta_i)|}{f_j^m},
        \qquad \bar\theta_i = \frac{1}{i} \sum_{s \le i} \theta_s

    with the mean over all walkers and ensembles up to generation i, at ``points``
    generations spaced geometrically.

    Args:
        idata: What :func:`to_inference_data` returns.
        posterior: The sampled posterior.
        points: Number of generations at which the model is solved.
        experiment: Name of one experiment of a joint posterior.

    Raises:
        TypeError: If posterior is no LogPosterior.
        ValueError: If no term of the posterior has measured frequencies, or it has
            other parameters.

    Source: the text below Table 4.2 of Sherri, Boulkaibet, Marwala and Friswell.
    """
    points = checks.whole_number("points", points, 2)
    measured = measured_frequencies(idata, experiment)
    names, chains = samples(idata)
    check_sampled(posterior, names)
    by_generation = chains.mean(axis=0)  # (draws, d)
    n = len(by_generation)
    means = np.cumsum(by_generation, axis=0) / np.arange(1, n + 1)[:, None]
    where = np.unique(np.geomspace(1, n, points).round().astype(int))
    frequencies = posterior(means[where - 1])[:, posterior.columns[measured.variable]]
    group = dataset(idata, "posterior")
    steps = 1.0 + group.get("step", group["draw"]).values[where - 1]
    return steps, total_average_error(measured.values, frequencies)


def total_average_error(measured: Floats, frequencies: Floats) -> Floats:
    """Return the mean of ``|f_m - f| / f_m`` over the measured modes, in percent."""
    errors = np.abs(frequencies[..., : len(measured)] / measured - 1)
    result: Floats = 100 * errors.mean(axis=-1)
    return result


def check_sampled(posterior: Any, names: Sequence[str]) -> None:
    """Refuse what is not the posterior that was sampled, by its parameters."""
    if not isinstance(posterior, LogPosterior):
        raise TypeError(
            f"posterior: expected a LogPosterior, got {type(posterior).__name__}"
        )
    if posterior.names != tuple(names):
        raise ValueError(
            f"posterior: expected the sampled one, with the parameters {list(names)}, "
            f"got {list(posterior.names)}"
        )
