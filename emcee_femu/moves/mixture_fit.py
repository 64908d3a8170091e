"""Fit a mixture of multivariate Student-t laws of given df by EM."""

import numpy as np
from scipy.cluster.vq import kmeans2

from ..interfaces import Floats
from .metropolis import factorize
from .mixture_em import log_constant

MOST_COMPONENTS = 6
MOST_DRAWS = 20_000  # more draws do not make the fit better, only slower
ITERATIONS, TOLERANCE = 300, 1e-5
COVER = 0.1  # weight of the component that covers gaps between the others
RIDGE = 1e-6  # of the variance of all draws


def fit_mixture(
    draws: Floats, components: int | str, df: float
) -> tuple[Floats, Floats, Floats]:
    """Return weights ``(k,)``, means ``(k, d)`` and scale matrices ``(k, d, d)``.

    Raises:
        ValueError: If there are fewer than ``10 d`` draws per component, they lie in a
            subspace, or no fit of that many components is possible.
    """
    n, d = draws.shape
    fewest = 10 * d * (components if isinstance(components, int) else 1)
    if n < fewest or not d:
        raise ValueError(
            f"samples: expected at least {fewest} draws, got shape {draws.shape}"
        )
    # Evenly spaced, so that every walker and time of a chain takes part.
    draws = draws[np.linspace(0, n - 1, min(n, MOST_DRAWS)).astype(int)]
    # Whitened by all draws: scales may differ by 1e11, correlations be 0.99999.
    centre = draws.mean(axis=0)
    covariance = np.atleast_2d(np.cov(draws, rowvar=False))
    factor = factorize("samples (their covariance)", covariance)
    spread = np.sqrt(np.diag(covariance))
    white = np.linalg.solve(factor / spread[:, None], ((draws - centre) / spread).T).T
    one = _run_em(white, 1, df)
    if isinstance(components, int):
        counts = range(components, components + 1)
    else:
        counts = range(1, max(2, min(MOST_COMPONENTS, len(draws) // (10 * d)) + 1))
    fits = [one if k == 1 else _run_em(white, k, df) for k in counts]
    possible = [fit for fit in fits if fit is not None]
    if not possible or one is None:
        raise ValueError(
            f"samples: no fit with {components} components; give more draws, or ask "
            "for fewer components"
        )
    _, weights, means, matrices = min(possible, key=lambda fit: fit[0])
    if len(weights) > 1:
        weights = np.append((1 - COVER) * weights, COVER)
        means, matrices = np.vstack([means, one[2]]), np.vstack([matrices, one[3]])
    return weights, centre + means @ factor.T, factor @ matrices @ factor.T


def _widen(matrices: Floats) -> Floats:
    """Return scale matrices with a ridge on those that are nearly singular.

    A walker that hardly moved, caught in a local mode, needs a component of its own:
    only then do independence proposals set it free.
    """
    narrow = np.linalg.eigvalsh(matrices)[:, 0] < RIDGE
    ridges: Floats = RIDGE * np.eye(matrices.shape[1]) * narrow[:, None, None]
    return matrices + ridges


def _run_em(
    x: Floats, components: int, df: float
) -> tuple[float, Floats, Floats, Floats] | None:
    """Return BIC, weights, means and scale matrices; None where a component dies."""
    n, d = x.shape
    labels = np.zeros(n, dtype=int)
    if components > 1:
        _, labels = kmeans2(x, components, minit="++", rng=np.random.default_rng(0))
    share = np.eye(components)[labels]  # (n, k)
    tail_weight = np.ones((n, components))
    previous = -np.inf
    for _ in range(ITERATIONS):
        counts = share.sum(axis=0)
        if (counts < 2 * d).any():
            return None
        pull = share * tail_weight
        means = (pull.T @ x) / pull.sum(axis=0)[:, None]
        centred = x - means[:, None]  # (k, n, d)
        matrices = np.einsum("nk,kni,knj->kij", pull, centred, centred, optimize=True)
        matrices /= counts[:, None, None]
        matrices = _widen(matrices)
        factors = np.linalg.cholesky(matrices)
        inverses = np.linalg.inv(factors)
        standard = centred @ inverses.transpose(0, 2, 1)
        distance = np.einsum("kni,kni->nk", standard, standard)
        diagonals = np.diagonal(factors, axis1=1, axis2=2)
        log_parts = (
            np.log(counts / n)
            - np.log(diagonals).sum(axis=1)
            - 0.5 * (df + d) * np.log1p(distance / df)
        )
        log_total = np.logaddexp.reduce(log_parts, axis=1)
        share = np.exp(log_parts - log_total[:, None])
        tail_weight = (df + d) / (df + distance)
        mean_log = float(log_total.mean())
        if mean_log - previous < TOLERANCE:
            break
        previous = mean_log
    n_parameters = components * (1 + d + d * (d + 1) / 2) - 1
    bic = -2 * n * (mean_log + log_constant(df, d)) + n_parameters * np.log(n)
    return bic, counts / n, means, matrices
