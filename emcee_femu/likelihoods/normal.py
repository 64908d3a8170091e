"""Derivatives of Gaussian log-likelihoods."""

import numpy as np

from ..interfaces import Floats

# An inferred error of zero, where a search may stand on the bound of a prior: its
# likelihood overflows to zero, and is not undefined.
LEAST_SD = 1e-160


def linearize_normal(
    deviations: Floats, sd: Floats, d_deviations: Floats, d_sd: Floats | None = None
) -> tuple[Floats, Floats]:
    r"""Return gradient ``(n, d)`` and scores of :math:`\sum_i \ln N(r_i; 0, \sigma_i)`.

    The scores are the rows :math:`dr_i / \sigma_i` and, where the standard deviations
    change, :math:`\sqrt 2 d\sigma_i / \sigma_i`.

    Args:
        deviations: :math:`r_i`, ``(n, m)``.
        sd: :math:`\sigma_i`, ``(n, m)``.
        d_deviations: Derivatives of the deviations, ``(n, m, d)``.
        d_sd: Those of the standard deviations, ``(n, m, d)``; None for none.
    """
    standard = (deviations / sd)[:, None]  # a product per row, so that rows round alike
    scores = d_deviations / sd[:, :, None]
    gradient: Floats = -(standard @ scores)[:, 0]
    if d_sd is not None:
        relative = d_sd / sd[:, :, None]
        gradient += ((standard**2 - 1) @ relative)[:, 0]
        scores = np.concatenate([scores, np.sqrt(2.0) * relative], axis=1)
    return gradient, scores
