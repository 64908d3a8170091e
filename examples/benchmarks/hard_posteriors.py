"""Fourteen posteriors where a chain may look converged and be wrong, with exact draws.

Every target is a density inside a box, with a uniform prior there: thin arms, lobes at
bounds, neighbouring maxima, inferred errors, rings and corners, of which much of the
variance, or a second maximum, is where a sampler seldom goes.

Run it:  python examples/benchmarks/hard_targets.py
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import stats
from scipy.special import logsumexp

import emcee_femu as ef

Floats = np.ndarray


@dataclass(frozen=True)
class Target:
    """A density inside a box ``(d, 2)`` that can be drawn; labels tell its modes."""

    log_density: Callable[[Floats], Floats]
    draw: Callable[[np.random.Generator, int], Floats]
    box: Floats
    label: Callable[[Floats], Floats] | None = None


@dataclass(frozen=True)
class Box:
    """A uniform prior."""

    names: tuple[str, ...]
    bounds: Floats

    def logpdf(self, theta: Floats) -> Floats:
        """Return a constant inside and -inf outside."""
        inside = (theta >= self.bounds[:, 0]) & (theta <= self.bounds[:, 1])
        constant = -np.log(np.diff(self.bounds)).sum()
        return np.where(inside.all(axis=1), constant, -np.inf)

    def sample(self, rng: np.random.Generator, n: int) -> Floats:
        """Draw ``(n, d)`` points."""
        return rng.uniform(*self.bounds.T, size=(n, len(self.names)))


def posterior_of(target: Target) -> ef.LogPosterior:
    """Return the target with its box as prior."""
    prior = Box(tuple(f"x{i + 1}" for i in range(len(target.box))), target.box)
    return ef.LogPosterior.from_function(target.log_density, prior, vectorize=True)


def inside(target: Target, n: int, seed: int = 1) -> Floats:
    """Return those of ``n`` exact draws that lie inside the box."""
    x = target.draw(np.random.default_rng(seed), n)
    return x[((x >= target.box[:, 0]) & (x <= target.box[:, 1])).all(axis=1)]


def box(d: int, low: float, high: float) -> Floats:
    """Return the same bounds for all parameters."""
    return np.tile([low, high], (d, 1)).astype(float)


def mixture(parts: Any, draw: Any, box: Floats, modes: int) -> Target:
    """Return a mixture of log-densities ``(k, n)``; two or more are told apart."""
    label = (lambda x: parts(x).argmax(axis=0)) if modes > 1 else None
    return Target(lambda x: logsumexp(parts(x), axis=0), draw, box, label)


def gaussians(weights: Any, means: Any, factors: Any, box: Floats) -> Target:
    """Return a mixture of Gaussians of Cholesky (or any) factors ``(k, d, d)``."""
    weights, means, factors = (np.asarray(a, float) for a in (weights, means, factors))
    inverses = np.linalg.inv(factors)
    constants = np.log(weights) - np.linalg.slogdet(factors)[1]

    def parts(x: Floats) -> Floats:
        white = (x - means[:, None]) @ inverses.transpose(0, 2, 1)
        return constants[:, None] - 0.5 * (white**2).sum(axis=2)

    def draw(rng: np.random.Generator, n: int) -> Floats:
        which = rng.choice(len(weights), n, p=weights)
        result = rng.normal(size=(n, means.shape[1]))
        for k, (mean, factor) in enumerate(zip(means, factors, strict=True)):
            result[which == k] = mean + result[which == k] @ factor.T
        return result

    return mixture(parts, draw, box, len(weights))


def crossed(d: int, apart: float, thin: float, weights: tuple[float, ...]) -> Target:
    """Return flat Gaussians that cross: the wide axes of one are thin in another."""
    count = len(weights)
    scales = [np.where(np.arange(d) % count == k, 2.0, thin) for k in range(count)]
    means = np.zeros((count, d))
    means[1:, :2] = apart * np.arange(1, count)[:, None]
    factors = [np.diag(scale) for scale in scales]
    return gaussians(weights, means, factors, box(d, -12, 12))


def corner(scales: Any, most: float) -> Target:
    """Return exponentials that press into the corner of a box at zero."""
    scales = np.array(scales)
    return Target(
        lambda x: -(x / scales).sum(axis=1),
        lambda rng, n: rng.exponential(scales, (n, len(scales))),
        box(len(scales), 0, most),
    )


def unknown_errors(
    groups: int, shape: float, data: int, mean: float, high: float
) -> Target:
    """Return a mean and an inferred standard deviation of each group."""

    def log_density(x: Floats) -> Floats:
        m, sd = x[:, ::2], x[:, 1::2]
        exponent = (shape + data / 2 * m**2) / sd**2
        return -((2 * shape + 2) * np.log(sd) + exponent).sum(axis=1)

    def draw(rng: np.random.Generator, n: int) -> Floats:
        variance = shape / rng.gamma(shape, size=(n, groups))
        m = rng.normal(size=(n, groups)) * np.sqrt(variance / data)
        return np.stack([m, np.sqrt(variance)], axis=2).reshape(n, -1)

    return Target(log_density, draw, np.array([[-mean, mean], [1e-3, high]] * groups))


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
    return mixture(parts, draw, limits, 2)


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


BESIDE = [[0, 0, 0], [1.2, 1.2, 0]], [np.eye(3), 0.15 * np.eye(3)]

TARGETS: dict[str, Callable[[], Target]] = {
    "arm, d=5": lambda: arm(5, 0.015, 4.0, 0.12),
    "two arms, d=3": lambda: arm(3, 0.03, 3.0, 0.1, sides=2),
    "lobe at a bound, d=4": lobe,
    "crossed, d=6": lambda: crossed(6, 1.5, 0.2, (0.7, 0.3)),
    "beside, d=3": lambda: gaussians([0.75, 0.25], *BESIDE, box(3, -9, 9)),
    "inferred errors, d=4": lambda: unknown_errors(2, 2.5, 4, 40, 40),
    "ring of four": lambda: bent_ring(4, 4.0, 0.25),
    "corner, d=5": lambda: corner(0.1 * np.geomspace(1, 1 / 30, 5), 2),
    "lognormal, d=4": lambda: lognormal(4, 0.8),
    "arc, width .08": lambda: bent_ring(2, 5.0, 0.08, 2.0),
    "arm, d=4": lambda: arm(4, 0.02, 3.0, 0.2),
    "three crossed, d=6": lambda: crossed(6, 1.2, 0.3, (0.5, 0.3, 0.2)),
    "inferred errors, d=6": lambda: unknown_errors(3, 3.0, 4, 30, 30),
    "common scale, d=5": shrunk,
}
