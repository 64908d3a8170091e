"""Twelve more posteriors with known answers, to which no setting was tuned.

Modes of unequal widths and weights, some of which a search of this size misses, heavy
tails, flat and skew densities, and shells. Converged runs are compared with the modes
that they found; missed modes concern the search and are counted separately.

Run it:  python examples/benchmarks/hard_targets.py --fresh
"""

from collections.abc import Callable

import numpy as np
from hard_posteriors import Target, box, gaussians, student
from scipy import stats
from scipy.special import gammaln, logsumexp

Floats = np.ndarray


def unequal(d: int, apart: float, weight: float, width: float) -> Target:
    """Return a unit Gaussian and a narrower, lighter one along the first axis."""
    mean = np.eye(d)[0] * apart
    factors = [np.eye(d), width * np.eye(d)]
    limits = box(d, -apart, 2 * apart)
    return gaussians([1 - weight, weight], [0 * mean, mean], factors, limits)


def balls(d: int = 4, radius: float = 1.0, apart: float = 6.0) -> Target:
    """Return two flat balls with soft edges, of weights .6 and .4."""
    means, power = np.array([[0.0] * d, [apart] * d]), 8

    def parts(x: Floats) -> Floats:
        r = np.linalg.norm(x - means[:, None], axis=2) / radius
        return np.log([[0.6], [0.4]]) - r**power

    def draw(rng: np.random.Generator, n: int) -> Floats:
        direction = rng.normal(size=(n, d))
        direction /= np.linalg.norm(direction, axis=1)[:, None]
        r = radius * rng.gamma(d / power, size=(n, 1)) ** (1 / power)
        return means[(rng.random(n) < 0.4).astype(int)] + r * direction

    return Target(
        lambda x: logsumexp(parts(x), axis=0), draw, box(d, -4, 10),
        lambda x: parts(x).argmax(axis=0),
    )  # fmt: skip


def scattered(d: int = 5, modes: int = 10) -> Target:
    """Return ten round modes in d dimensions, a thousandth of the box each."""
    rng = np.random.default_rng(77)
    weights = rng.dirichlet(np.full(modes, 4.0))
    factors = rng.uniform(0.4, 0.8, modes)[:, None, None] * np.eye(d)
    means = rng.uniform(-7, 7, (modes, d))
    return gaussians(weights, means, factors, box(d, -10, 10))


def shell(d: int = 5, radius: float = 4.0, width: float = 0.3) -> Target:
    """Return a thick shell: the radius is Gaussian, weighted by its surface."""

    def draw(rng: np.random.Generator, n: int) -> Floats:
        grid = np.linspace(0.01, radius + 8 * width, 100_000)
        density = grid ** (d - 1) * np.exp(-0.5 * ((grid - radius) / width) ** 2)
        cumulative = density.cumsum() / density.sum()
        r = np.interp(rng.random(n), cumulative, grid)
        direction = rng.normal(size=(n, d))
        return direction * (r / np.linalg.norm(direction, axis=1))[:, None]

    def log_density(x: Floats) -> Floats:
        return -0.5 * ((np.linalg.norm(x, axis=1) - radius) / width) ** 2

    return Target(log_density, draw, box(d, -9, 9))


def skewed(d: int = 4, shape: float = 1.5) -> Target:
    """Return Gamma laws whose scales grow with the sum of those before them."""

    def scales(x: Floats) -> Floats:
        return 1 + 0.3 * np.column_stack([0 * x[:, :1], x[:, :-1].cumsum(axis=1)])

    def draw(rng: np.random.Generator, n: int) -> Floats:
        x = rng.gamma(shape, size=(n, d))
        for j in range(1, d):
            x[:, j] *= 1 + 0.3 * x[:, :j].sum(axis=1)
        return x

    def log_density(x: Floats) -> Floats:
        scale = scales(np.maximum(x, 1e-12))
        return stats.gamma.logpdf(x, shape, scale=scale).sum(axis=1)

    return Target(log_density, draw, box(d, 0, 200))


def heavy_modes(d: int = 3, df: float = 4.0) -> Target:
    """Return two t laws of 4 degrees of freedom, of weights .75 and .25."""
    means, scales = np.array([[-4.0] * d, [5.0] * d]), np.array([1.0, 0.5])
    weights = np.array([0.75, 0.25])
    constant = gammaln((df + d) / 2) - gammaln(df / 2)

    def parts(x: Floats) -> Floats:
        r2 = ((x - means[:, None]) ** 2).sum(axis=2) / scales[:, None] ** 2
        front = np.log(weights) - d * np.log(scales) + constant
        return front[:, None] - 0.5 * (df + d) * np.log1p(r2 / df)

    def draw(rng: np.random.Generator, n: int) -> Floats:
        which = (rng.random(n) < weights[1]).astype(int)
        z = rng.normal(size=(n, d)) * np.sqrt(df / rng.chisquare(df, (n, 1)))
        return means[which] + scales[which, None] * z

    return Target(
        lambda x: logsumexp(parts(x), axis=0), draw, box(d, -40, 40),
        lambda x: parts(x).argmax(axis=0),
    )  # fmt: skip


def inner_needle(d: int = 4, weight: float = 0.2, width: float = 0.05) -> Target:
    """Return a needle inside a wide mode, off its centre."""
    mean = np.full(d, 0.7)
    factors = [np.eye(d), width * np.eye(d)]
    return gaussians([1 - weight, weight], [0 * mean, mean], factors, box(d, -6, 6))


def truncated(d: int = 4) -> Target:
    """Return a correlated Gaussian of which two bounds cut a quarter or more."""
    factor = np.linalg.cholesky(0.4 * np.eye(d) + 0.6)
    limits = box(d, -6, 6)
    limits[:2, 0] = -0.5
    return gaussians([1], np.zeros((1, d)), [factor], limits)


FRESH: dict[str, Callable[[], Target]] = {
    "unequal, d=5, width .15": lambda: unequal(5, 6.0, 0.3, 0.15),
    "unequal, d=8, width .3": lambda: unequal(8, 8.0, 0.4, 0.3),
    "flat balls, d=4": balls,
    "ten modes, d=5": scattered,
    "needle inside, d=4": inner_needle,
    "t, 2.2 dof, d=4": lambda: student(4, 2.2),
    "two t, 4 dof, d=3": heavy_modes,
    "shell, d=5": shell,
    "gamma ridge, d=4": skewed,
    "cut by bounds, d=4": truncated,
    "close modes, d=6": lambda: unequal(6, 4.0, 0.5, 0.7),
    "narrow pair, d=3": lambda: unequal(3, 30.0, 0.15, 0.5),
}
