"""Fourteen posteriors where a chain may look converged and be wrong.

Thin arms, lobes at bounds, neighbouring maxima, inferred errors, rings and corners:
much of the variance, or a second maximum, is where a sampler seldom goes. They were
written before anything was changed because of them; those in ``KEPT`` were run once, in
the end.

Run it:  python examples/benchmarks/hard_targets.py --believed
"""

from collections.abc import Callable

import numpy as np
from hard_posteriors import Target, box, gaussians
from scipy import stats
from scipy.special import logsumexp

Floats = np.ndarray


def arm(d: int, share: float, scale: float, bend: float, sides: int = 1) -> Target:
    """Return a Gaussian with a thin, bent arm along the first axis, or two."""
    signs = np.resize([1.0, -1.0], d - 1)

    def law(t: Floats) -> Floats:
        tail = sum(
            stats.expon.pdf(side * t - 3.0, scale=scale) for side in (-1, 1)[:sides]
        )
        return np.log((1 - share) * stats.norm.pdf(t) + share * tail / sides)

    def place(t: Floats) -> tuple[Floats, Floats]:
        u = np.maximum(np.abs(t) - 2.0, 0.0) * ((t < 0) | (sides > 1))
        return bend * u[:, None] ** 2 * signs, 1 / (1 + 0.6 * u)[:, None]

    def log_density(x: Floats) -> Floats:
        mean, sd = place(x[:, 0])
        return law(x[:, 0]) + stats.norm.logpdf(x[:, 1:], mean, sd).sum(axis=1)

    def draw(rng: np.random.Generator, n: int) -> Floats:
        t = rng.normal(size=n)
        out = rng.random(n) < share
        t[out] = -3.0 - rng.exponential(scale, out.sum())
        t[out] *= rng.choice([1.0, -1.0], out.sum()) if sides > 1 else 1.0
        mean, sd = place(t)
        return np.column_stack([t, mean + sd * rng.normal(size=(n, d - 1))])

    limits = box(d, -90, 90)
    limits[0] = -30, 8 if sides == 1 else 30
    return Target(log_density, draw, limits)


def crossed(d: int, apart: float, thin: float, weights: tuple[float, ...]) -> Target:
    """Return flat Gaussians that cross: the wide axes of one are thin in another."""
    count = len(weights)
    scales = [np.where(np.arange(d) % count == k, 2.0, thin) for k in range(count)]
    means = np.zeros((count, d))
    means[1:, :2] = apart * np.arange(1, count)[:, None]
    factors = [np.diag(scale) for scale in scales]
    return gaussians(weights, means, factors, box(d, -12, 12))


def lobe(d: int = 4, share: float = 0.1, depth: float = 0.02) -> Target:
    """Return a Gaussian inside, and a wide lobe pressed against a bound."""
    wide = 2.0

    def parts(x: Floats) -> Floats:
        inner = stats.norm.logpdf(x[:, 0], 4.0, 1.0)
        outer = stats.expon.logpdf(x[:, 0], scale=depth)
        rest = x[:, 1:]
        return np.array([
            np.log(1 - share) + inner + stats.norm.logpdf(rest).sum(axis=1),
            np.log(share) + outer + stats.norm.logpdf(rest, 1, wide).sum(axis=1),
        ])  # fmt: skip

    def draw(rng: np.random.Generator, n: int) -> Floats:
        x = rng.normal(size=(n, d))
        x[:, 0] += 4.0
        out = rng.random(n) < share
        x[out, 0] = rng.exponential(depth, out.sum())
        x[out, 1:] = 1 + wide * x[out, 1:]
        return x

    limits = box(d, -15, 15)
    limits[0, 0] = 0.0
    return Target(
        lambda x: logsumexp(parts(x), axis=0), draw, limits,
        lambda x: parts(x).argmax(axis=0),
    )  # fmt: skip


def errors(groups: int, shape: float, most: float) -> Target:
    """Return a mean and a standard deviation, inferred, of each group of data."""

    def log_density(x: Floats) -> Floats:
        mean, sd = x[:, ::2], x[:, 1::2]
        return -(
            (2 * shape + 2) * np.log(sd) + (shape + 2 * mean**2) / sd**2
        ).sum(axis=1)  # fmt: skip

    def draw(rng: np.random.Generator, n: int) -> Floats:
        variance = shape / rng.gamma(shape, size=(n, groups))
        mean = rng.normal(size=(n, groups)) * np.sqrt(variance) / 2
        return np.stack([mean, np.sqrt(variance)], axis=2).reshape(n, -1)

    limits = [[-most, most], [1e-3, most]] * groups
    return Target(log_density, draw, np.array(limits))


def bent_ring(d: int, radius: float, width: float, part: float = np.pi) -> Target:
    """Return a ring, or an arc of it, in the first two of several parameters."""

    def log_density(x: Floats) -> Floats:
        r, turn = np.hypot(x[:, 0], x[:, 1]), np.arctan2(x[:, 1], x[:, 0])
        off = (r - radius) / width
        value = -0.5 * (off**2 + (x[:, 2:] ** 2).sum(axis=1)) - np.log(r)
        return np.where(np.abs(turn) <= part, value, -np.inf)

    def draw(rng: np.random.Generator, n: int) -> Floats:
        r, turn = rng.normal(radius, width, n), rng.uniform(-part, part, n)
        rest = rng.normal(size=(n, d - 2))
        return np.column_stack([r * np.cos(turn), r * np.sin(turn), rest])

    return Target(log_density, draw, box(d, -2.5 * radius, 2.5 * radius))


def corner(d: int, ratio: float) -> Target:
    """Return exponentials into a corner, of scales that differ."""
    scales = 0.1 * np.geomspace(1, 1 / ratio, d)
    return Target(
        lambda x: -(x / scales).sum(axis=1),
        lambda rng, n: rng.exponential(scales, (n, d)),
        box(d, 0, 2),
    )


def lognormal(d: int, sd: float) -> Target:
    """Return correlated lognormal laws, with long tails to one side."""
    factor = np.linalg.cholesky(0.5 * np.eye(d) + 0.5)
    inverse = np.linalg.inv(factor)

    def log_density(x: Floats) -> Floats:
        logs = np.log(x)
        return -0.5 * ((logs @ inverse.T / sd) ** 2).sum(axis=1) - logs.sum(axis=1)

    return Target(
        log_density,
        lambda rng, n: np.exp(sd * rng.normal(size=(n, d)) @ factor.T),
        box(d, 1e-6, 400),
    )


def shrunk(d: int = 4) -> Target:
    """Return effects of a common scale, which is uniform, beside that scale."""

    def log_density(x: Floats) -> Floats:
        return stats.norm.logpdf(x[:, 1:], 0, x[:, :1]).sum(axis=1)

    def draw(rng: np.random.Generator, n: int) -> Floats:
        scale = rng.uniform(0.02, 1, (n, 1))
        return np.hstack([scale, scale * rng.normal(size=(n, d))])

    return Target(log_density, draw, np.vstack([[[0.02, 1.0]], box(d, -6, 6)]))


BELIEVED: dict[str, Callable[[], Target]] = {
    "arm, d=5": lambda: arm(5, 0.015, 4.0, 0.12),
    "two arms, d=3": lambda: arm(3, 0.03, 3.0, 0.1, sides=2),
    "lobe at a bound, d=4": lobe,
    "crossed, d=6": lambda: crossed(6, 1.5, 0.2, (0.7, 0.3)),
    "beside, d=3": lambda: gaussians(
        [0.75, 0.25],
        [[0, 0, 0], [1.2, 1.2, 0]],
        [np.eye(3), 0.15 * np.eye(3)],
        box(3, -9, 9),
    ),  # fmt: skip
    "inferred errors, d=4": lambda: errors(2, 2.5, 40),
    "ring of four": lambda: bent_ring(4, 4.0, 0.25),
    "corner, d=5": lambda: corner(5, 30),
    "lognormal, d=4": lambda: lognormal(4, 0.8),
    "arc, width .08": lambda: bent_ring(2, 5.0, 0.08, 2.0),
    "arm, d=4": lambda: arm(4, 0.02, 3.0, 0.2),
    "three crossed, d=6": lambda: crossed(6, 1.2, 0.3, (0.5, 0.3, 0.2)),
    "inferred errors, d=6": lambda: errors(3, 3.0, 30),
    "common scale, d=5": shrunk,
}
KEPT = "arm, d=4", "three crossed, d=6", "inferred errors, d=6", "common scale, d=5"
