r"""Correlations between points: smooth, or with kinks that a smooth one would deny.

.. math:: r^2 = \sum_j \Big(\frac{x_j - x_j'}{\ell_j}\Big)^2, \qquad
    k = e^{-r^2 / 2} \quad \text{or} \quad
    k = \Big(1 + \sqrt5 r + \frac{5 r^2}{3}\Big) e^{-\sqrt5 r}

The second is Matern's of twice differentiable functions.
"""

from dataclasses import dataclass

import numpy as np

from ..interfaces import Floats


@dataclass(frozen=True, eq=False)
class Kernel:
    """A correlation of points, given the length of each coordinate.

    Args:
        lengths: ``(d,)``.
        rough: Whether it is Matern's.
    """

    lengths: Floats
    rough: bool

    def correlate(self, a: Floats, b: Floats) -> Floats:
        """Return the correlations of points ``(n, d)`` with others: ``(n, m)``."""
        square = self._measure(a, b)
        if not self.rough:
            square *= -0.5
            return np.asarray(np.exp(square, out=square))
        r = np.sqrt(5.0 * square)
        return np.asarray((1.0 + r + r**2 / 3.0) * np.exp(-r))

    def steepen(self, a: Floats, b: Floats) -> Floats:
        r"""Return how steep they are, ``(n, m)``.

        The slope by :math:`x_j` is minus this times :math:`(x_j - x_j') / \ell_j^2`.
        """
        if not self.rough:
            return self.correlate(a, b)
        r = np.sqrt(5.0 * self._measure(a, b))
        return np.asarray(5.0 / 3.0 * (1.0 + r) * np.exp(-r))

    def _measure(self, a: Floats, b: Floats) -> Floats:
        """Return the squared distances in lengths, ``(n, m)``."""
        a, b = a / self.lengths, b / self.lengths
        square = (a**2).sum(axis=1)[:, None] + (b**2).sum(axis=1) - 2.0 * a @ b.T
        return np.asarray(np.maximum(square, 0.0, out=square))
