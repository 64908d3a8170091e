"""Metropolis-Hastings with a Gaussian random walk, the paper's baseline."""

import numpy as np
from numpy.random import RandomState
from numpy.typing import ArrayLike

from .. import checks
from ..contracts import Floats
from .proposing import Proposal, ProposingMove


class MetropolisMove(ProposingMove):
    r"""Metropolis-Hastings with a Gaussian random walk, separately for each walker.

    .. math:: \theta^* = \theta_i + L z, \quad z \sim N(0, I), \quad L L^T = C, \qquad
        \alpha = \min\{1, p(\theta^*) / p(\theta_i)\}

    This is Eq. 3.1 with a symmetric proposal, the paper's baseline. Walkers do not
    interact, so one walker is enough. A proposal costs one solve. Give the size of the
    steps as either sd or cov.

    Args:
        sd: Standard deviations of the steps in parameter units, one number or
            ``(ndim,)``.
        cov: Variances, one number or ``(ndim,)``, or the covariance matrix C,
            ``(ndim, ndim)``, as in ``emcee.moves.GaussianMove``.

    Raises:
        TypeError: If both or neither are given, or they do not hold real numbers.
        ValueError: If a standard deviation or variance is not positive, a covariance is
            not symmetric and positive definite, or (when it proposes) the shape does
            not match ndim.

    Source: Eq. 3.1 of Sherri, Boulkaibet, Marwala and Friswell.

    Examples:
        >>> import emcee_femu as ef
        >>> posterior = ef.paper.mass_spring().posterior
        >>> move = ef.MetropolisMove(sd=[20.0, 20.0, 20.0, 30.0, 20.0])  # N/m
        >>> (run,) = ef.run(posterior, move, nwalkers=4, steps=50, seed=1, ensembles=1)
        >>> run.get_chain().shape
        (50, 4, 5)
    """

    def __init__(
        self, sd: ArrayLike | None = None, *, cov: ArrayLike | None = None
    ) -> None:
        if (sd is None) == (cov is None):
            raise TypeError(
                "sd, cov: expected one of the two, standard deviations or covariance "
                f"of the steps, got {'neither' if sd is None else 'both'}"
            )
        if sd is not None and checks.numeric_array("sd", sd).ndim > 1:
            raise ValueError(
                "sd: expected a number or (ndim,) standard deviations, got shape "
                f"{np.shape(sd)}; a covariance is given as cov="
            )
        self.sd = None if sd is None else checks.positive_array("sd", sd)
        self.cov = None if cov is None else checks.real_array("cov", cov)
        if self.sd is not None:
            self._factor = self.sd
        elif self.cov is not None and self.cov.ndim < 2:
            self._factor = np.sqrt(checks.positive_array("cov", self.cov))
        elif self.cov is not None:
            self._factor = checks.covariance_factor("cov", self.cov)

    @classmethod
    def tuned(cls, samples: ArrayLike) -> "MetropolisMove":
        """Return the move with the samples' covariance times :math:`2.38^2 / d`.

        Args:
            samples: Draws ``(n, ndim)`` of the target or a similar one, from a run
                that is not used for estimates.

        Returns:
            The move, with fixed steps.

        Raises:
            ValueError: If there are not more samples than dimensions, or their
                covariance is singular.

        Source: Roberts, Gelman and Gilks (1997), doi:10.1214/aoap/1034625254.

        Examples:
            >>> import numpy as np
            >>> from emcee_femu import MetropolisMove
            >>> draws = [[1.0, 0.0], [-1.0, 0.0], [0.0, 2.0], [0.0, -2.0]]
            >>> move = MetropolisMove.tuned(draws)
            >>> move.cov.round(2).tolist()  # 2.83 times theirs
            [[1.89, 0.0], [0.0, 7.55]]
        """
        draws = checks.real_array("samples", samples, 2)
        n, ndim = draws.shape
        if n <= ndim or not ndim:
            raise ValueError(f"samples: expected more than {ndim} draws, got {n}")
        covariance = np.atleast_2d(np.cov(draws, rowvar=False))
        checks.covariance_factor("samples (their covariance)", covariance)
        return cls(cov=2.38**2 / ndim * covariance)

    def check(self, nwalkers: int, ndim: int) -> None:
        """Refuse a dimension that does not match the steps."""
        if self._factor.ndim and len(self._factor) != ndim:
            name = "cov" if self.sd is None else "sd"
            raise ValueError(
                f"{name}: expected a number or steps of {ndim} parameters, got shape "
                f"{self._factor.shape}"
            )

    def get_proposal(self, s: Floats, c: list[Floats], random: RandomState) -> Proposal:
        """Propose a step of each walker ``s (k, ndim)`` (emcee's interface)."""
        steps = random.standard_normal(s.shape)
        if self._factor.ndim == 2:
            steps = steps @ self._factor.T
        else:
            steps *= self._factor
        steps += s
        return steps, None
