"""Metropolis-Hastings with a Gaussian random walk, the paper's baseline."""

from typing import Any

import numpy as np
from emcee.moves import Move
from numpy.typing import ArrayLike, NDArray

from .. import checks
from ..interfaces import Floats
from .acceptance import check_floats, metropolis_step


class MetropolisMove(Move):
    r"""Gaussian random walk: every walker is a Metropolis-Hastings chain of its own.

    .. math:: \theta^* = \theta_i + L z, \quad z \sim N(0, I), \quad L L^T = C, \qquad
        \alpha = \min\{1, p(\theta^*) / p(\theta_i)\}

    (Eq. 3.1 with a symmetric proposal density). Walkers do not interact; one walker
    is enough.

    Args:
        cov: A number or ``(ndim,)``: standard deviations of the steps, in parameter
            units. ``(ndim, ndim)``: their covariance.

    Raises:
        TypeError: If cov does not hold real numbers.
        ValueError: If a standard deviation is not above zero, a covariance is not
            symmetric and positive definite, or (when it proposes) cov does not fit
            ndim.

    Source: Eq. 3.1 of Sherri, Boulkaibet, Marwala and Friswell.
    """

    def __init__(self, cov: ArrayLike) -> None:
        """See the class."""
        self.cov = checks.real_array("cov", cov)
        if not self.cov.size:
            raise ValueError("cov: expected at least one number, got none")
        if self.cov.ndim < 2:
            checks.positive_array("cov", self.cov)
            self._factor = self.cov
            return
        self._factor = scaled_cholesky("cov", self.cov)

    def __repr__(self) -> str:
        """Return the call that makes an equal move."""
        return f"MetropolisMove({self.cov.tolist()})"

    @classmethod
    def tuned(cls, samples: ArrayLike) -> "MetropolisMove":
        r"""Return the move with covariance :math:`(2.38^2 / d)` times the samples'.

        Args:
            samples: Draws of a target like the one to sample, ``(n, ndim)``, of a run
                that is not used for estimates.

        Raises:
            ValueError: If there are not more samples than dimensions, or their
                covariance is singular.

        Source: Roberts, Gelman and Gilks (1997), doi:10.1214/aoap/1034625254.
        """
        draws = checks.real_array("samples", samples, 2)
        n, ndim = draws.shape
        if n <= ndim or not ndim:
            raise ValueError(
                f"samples: expected more draws than {ndim} parameters, got {n}"
            )
        covariance = np.atleast_2d(np.cov(draws, rowvar=False))
        scaled_cholesky("samples (their covariance)", covariance)
        return cls(2.38**2 / ndim * covariance)

    def check(self, nwalkers: int, ndim: int) -> None:
        """Refuse a dimension that the steps do not fit.

        Raises:
            ValueError: If cov is neither a number nor of the shape of ndim parameters.
        """
        if self.cov.ndim and len(self.cov) != ndim:
            raise ValueError(
                f"cov: expected a number, ({ndim},) or ({ndim}, {ndim}) for {ndim} "
                f"parameters, got shape {self.cov.shape}"
            )

    def propose(self, model: Any, state: Any) -> tuple[Any, NDArray[np.bool_]]:
        """Move every walker once; return the state and who was accepted."""
        nwalkers, ndim = state.coords.shape
        self.check(nwalkers, ndim)
        check_floats(state.coords)
        normal = model.random.standard_normal((nwalkers, ndim))
        if self._factor.ndim == 2:
            steps = normal @ self._factor.T
        else:
            steps = normal * self._factor
        accepted = np.zeros(nwalkers, dtype=bool)
        accepted[
            metropolis_step(model, state, np.arange(nwalkers), state.coords + steps)
        ] = True
        return state, accepted


def scaled_cholesky(argument: str, covariance: Floats) -> Floats:
    """Return L with ``L L^T = covariance``, exact for scales that differ by 1e11.

    Raises:
        ValueError: If covariance is not square, symmetric and positive definite.
    """
    if covariance.ndim != 2 or covariance.shape[0] != covariance.shape[1]:
        raise ValueError(
            f"{argument}: expected a square matrix, got shape {covariance.shape}"
        )
    variances = np.diag(covariance)
    if not (variances > 0).all():
        raise ValueError(
            f"{argument}: expected variances above zero, got {variances.tolist()}"
        )
    scale = np.sqrt(variances)
    correlation = covariance / np.outer(scale, scale)
    if np.abs(correlation - correlation.T).max() > 1e-8:
        raise ValueError(f"{argument}: expected a symmetric matrix")
    try:
        factor = np.linalg.cholesky(correlation)
    except np.linalg.LinAlgError:
        raise ValueError(
            f"{argument}: expected a positive definite matrix; its correlations are "
            f"{correlation.round(6).tolist()}"
        ) from None
    result: Floats = scale[:, None] * factor
    return result
