"""Expectation-maximisation of Student-t mixtures, from draws or from weighted draws."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln

from ..interfaces import Floats


class Mixture(NamedTuple):
    """A mixture of multivariate Student-t laws that share their degrees of freedom.

    Attributes:
        weights: ``(k,)``, which sum to one.
        means: ``(k, d)``.
        matrices: Scale matrices, ``(k, d, d)``.
        df: Degrees of freedom.
    """

    weights: Floats
    means: Floats
    matrices: Floats
    df: float


def log_parts(x: Floats, law: Mixture) -> tuple[Floats, Floats]:
    """Return ln(w_k t_k(x)) without the constant, and squared distances, ``(n, k)``."""
    d = x.shape[1]
    factors = np.linalg.cholesky(law.matrices)
    inverses = invert_factors(factors)
    standard = (x - law.means[:, None]) @ inverses.transpose(0, 2, 1)
    distance = np.einsum("kni,kni->nk", standard, standard)
    diagonals = np.diagonal(factors, axis1=1, axis2=2)
    parts = (
        np.log(law.weights)
        - np.log(diagonals).sum(axis=1)
        - 0.5 * (law.df + d) * np.log1p(distance / law.df)
    )
    return parts, distance


def invert_factors(factors: NDArray[np.floating[Any]]) -> Floats:
    """Return the inverses of Cholesky factors ``(k, d, d)``."""
    # Rows scaled first: entries of one factor may differ by 1e22.
    rows = np.abs(factors).max(axis=2)
    inverses: Floats = np.linalg.inv(factors / rows[:, :, None]) / rows[:, None, :]
    return inverses


def log_constant(df: float, d: int) -> float:
    """Return the constant of a Student-t law, whatever its matrix."""
    constant = gammaln((df + d) / 2) - gammaln(df / 2) - 0.5 * d * np.log(df * np.pi)
    return float(constant)


def log_density(x: Floats, law: Mixture) -> Floats:
    """Return the log density ``(n,)`` at ``x (n, d)``."""
    total: Floats = np.logaddexp.reduce(log_parts(x, law)[0], axis=1)
    return total + log_constant(law.df, x.shape[1])


def draw(rng: np.random.Generator, law: Mixture, n: int) -> Floats:
    """Draw ``(n, d)``."""
    d = law.means.shape[1]
    factors = np.linalg.cholesky(law.matrices)
    which = rng.choice(len(law.weights), n, p=law.weights)
    normal = rng.standard_normal((n, d))
    normal *= np.sqrt(law.df / rng.chisquare(law.df, n))[:, None]
    drawn: Floats = np.einsum("nij,nj->ni", factors[which], normal)
    return law.means[which] + drawn


def improve(
    x: Floats, shares: Floats, law: Mixture, most: int = 50, tolerance: float = 1e-4
) -> tuple[Mixture, float]:
    r"""Fit a mixture to weighted draws, starting from one, by EM.

    .. math:: \max_q \sum_i W_i \ln q(x_i)

    Scale matrices are drawn towards those at the start, as if ``d + 1`` draws had said
    so, and a component on which less than one effective draw is left is dropped.

    Args:
        x: Draws, ``(n, d)``.
        shares: Their weights W, which sum to one.
        law: Where to start.
        most: Iterations.
        tolerance: Gain of the mean log density below which they end.

    Returns:
        The fit, and its mean log density over the weighted draws.
    """
    d = x.shape[1]
    size = 1.0 / np.sum(shares**2)
    best, previous, before = law, -np.inf, law.matrices
    for _ in range(most):
        parts, distance = log_parts(x, law)
        total = np.logaddexp.reduce(parts, axis=1)
        gained = float(shares @ total) + log_constant(law.df, d)
        if gained - previous < tolerance:
            break
        best, previous = law, gained
        own = np.exp(parts - total[:, None]) * shares[:, None]
        counts = own.sum(axis=0)
        alive = counts * size > 1.0
        if not alive.any():
            break
        own, counts, before = own[:, alive], counts[alive], before[alive]
        pull = own * (law.df + d) / (law.df + distance[:, alive])
        means = (pull.T @ x) / pull.sum(axis=0)[:, None]
        centred = x - means[:, None]
        sums = (pull.T[:, None, :] * centred.transpose(0, 2, 1)) @ centred
        n = (counts**2 / (own**2).sum(axis=0))[:, None, None]
        matrices = n * sums / counts[:, None, None] + (d + 1) * before
        law = Mixture(counts / counts.sum(), means, matrices / (n + d + 1), law.df)
    return best, previous
