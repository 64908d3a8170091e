"""Posteriors that are hard for samplers but can be sampled exactly.

Every target is a density inside a box, with a uniform prior there. TARGETS: unequal
modes, a ring, a funnel, heavy tails, a banana, ten modes, a corner, a ridge,
exchangeable labels, ill-conditioned Gaussians, a speck in a wide prior, and unknown
noise. FRESH, to which no setting was tuned: modes of unequal widths and weights, some
of which a search of this size misses, heavy tails, flat and skew densities, and shells.
BELIEVED, where a chain looks converged and is wrong: thin arms, lobes at bounds,
neighbouring maxima, inferred errors, rings and corners, of which much of the variance,
or a second maximum, is where a sampler seldom goes. OVERLAPS: flat Gaussians across
each other, whose curvature at a maximum is that of neither.

Run it:  python examples/benchmarks/hard_targets.py
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import permutations, product
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


def pair(d: int, mean: Any, weight: float, width: float, limits: Floats) -> Target:
    """Return a unit Gaussian at 0 and a narrower, lighter one."""
    means = [np.zeros(d), np.broadcast_to(mean, d)]
    factors = [np.eye(d), width * np.eye(d)]
    return gaussians([1 - weight, weight], means, factors, limits)


def needle(d: int, apart: float, weight: float, width: float) -> Target:
    """Return such a pair, ``apart`` along the diagonal."""
    mean = apart / np.sqrt(d)
    return pair(d, mean, weight, width, box(d, -6, 6 + mean))


def unequal(d: int, apart: float, weight: float, width: float) -> Target:
    """Return the same along the first axis, in a larger box."""
    return pair(d, np.eye(d)[0] * apart, weight, width, box(d, -apart, 2 * apart))


def turned(d: int) -> Target:
    """Return a Gaussian whose covariance has condition 1e4, its axes turned."""
    factor = stats.ortho_group(d, seed=d).rvs() * np.geomspace(1, 0.01, d)
    return gaussians([1], np.zeros((1, d)), [factor], box(d, -8, 8))


def correlated(correlation: float, sd: float, limits: Floats, centre: float) -> Target:
    """Return a Gaussian with one correlation of all parameters."""
    d = len(limits)
    factor = sd * np.linalg.cholesky((1 - correlation) * np.eye(d) + correlation)
    return gaussians([1], [np.full(d, centre)], [factor], limits)


def round_modes(seed: int, d: int, sds: Any, half: float, weights: Any, means: Any):
    """Return ten round Gaussians; weights and means by a generator."""
    rng = np.random.default_rng(seed)
    weights = weights(rng)
    factors = rng.uniform(*sds, 10)[:, None, None] * np.eye(d)
    return gaussians(weights, means(rng), factors, box(d, -half, half))


def crossed(d: int, apart: float, thin: float, weights: tuple[float, ...]) -> Target:
    """Return flat Gaussians that cross: the wide axes of one are thin in another."""
    count = len(weights)
    scales = [np.where(np.arange(d) % count == k, 2.0, thin) for k in range(count)]
    means = np.zeros((count, d))
    means[1:, :2] = apart * np.arange(1, count)[:, None]
    factors = [np.diag(scale) for scale in scales]
    return gaussians(weights, means, factors, box(d, -12, 12))


def pancakes(d: int, apart: float, light: float) -> Target:
    """Return two flat Gaussians across each other, the lighter off where both are wide.

    That is in two of the axes that are wide in the heavier one and thin in itself.
    """
    scales = np.where(np.arange(d) < d // 2, [[2.0], [0.2]], [[0.2], [2.0]])
    means = np.zeros((2, d))
    means[1, :2] = apart
    factors = [*map(np.diag, scales)]
    return gaussians([1 - light, light], means, factors, box(d, -12, 12))


def radial(
    limits: Floats, log_density: Any, radii: Any,
    weights: Any = (1.0,), means: Any = (0.0,), scales: Any = (1.0,),
) -> Target:  # fmt: skip
    """Return a density of the radius alone, or several; ``radii(rng, n)`` draws it."""
    d, weights, scales = len(limits), np.array(weights), np.array(scales)
    centres = np.outer(means, np.ones(d))
    constants = np.log(weights) - d * np.log(scales)

    def parts(x: Floats) -> Floats:
        r = np.linalg.norm(x - centres[:, None], axis=2) / scales[:, None]
        return constants[:, None] + log_density(r)

    def draw(rng: np.random.Generator, n: int) -> Floats:
        which = rng.choice(len(weights), n, p=weights)
        direction = rng.normal(size=(n, d))
        r = scales[which] * radii(rng, n) / np.linalg.norm(direction, axis=1)
        return centres[which] + r[:, None] * direction

    return mixture(parts, draw, limits, len(weights))


def shell(d: int, radius: float, width: float, half: float) -> Target:
    """Return a ring or a shell: the radius is Gaussian, weighted by its surface."""
    grid = np.linspace(0.01, radius + 8 * width, 100_000)

    def log_density(r: Floats) -> Floats:
        return -0.5 * ((r - radius) / width) ** 2

    def radii(rng: np.random.Generator, n: int) -> Floats:
        return np.interp(rng.random(n), share / share[-1], grid)

    share = (grid ** (d - 1) * np.exp(log_density(grid))).cumsum()
    return radial(box(d, -half, half), log_density, radii)


def student(d: int, df: float, half: float = 100, **modes: Any) -> Target:
    """Return a multivariate t law, or several."""
    return radial(
        box(d, -half, half),
        lambda r: -0.5 * (df + d) * np.log1p(r**2 / df),
        lambda rng, n: np.sqrt(rng.chisquare(d, n) * df / rng.chisquare(df, n)),
        **modes,
    )


def balls(d: int = 4, apart: float = 6.0, power: int = 8) -> Target:
    """Return two flat unit balls with soft edges, of weights .6 and .4."""
    return radial(
        box(d, -4, 10), lambda r: -(r**power),
        lambda rng, n: rng.gamma(d / power, size=n) ** (1 / power),
        (0.6, 0.4), (0.0, apart), (1.0, 1.0),
    )  # fmt: skip


def funnel(d: int = 5) -> Target:
    """Return Neal's funnel: x1 is N(0, 3), the others are N(0, exp(x1 / 2))."""

    def log_density(x: Floats) -> Floats:
        v, others = x[:, 0], x[:, 1:]
        squares = (others**2).sum(axis=1) * np.exp(-v)
        return -(v**2) / 18 - 0.5 * (squares + others.shape[1] * v)

    def draw(rng: np.random.Generator, n: int) -> Floats:
        z = rng.normal(size=(n, d))
        return np.column_stack([3 * z[:, 0], np.exp(1.5 * z[:, :1]) * z[:, 1:]])

    limits = np.vstack([box(1, -12, 12), box(d - 1, -99, 99)])
    return Target(log_density, draw, limits)


def banana(d: int = 4, bend: float = 0.03) -> Target:
    """Return Haario's twisted Gaussian: x1 has sd 10, x2 is bent along x1^2."""

    def bent(x: Floats, sign: int) -> Floats:
        x = x.copy()
        x[:, 1] += sign * bend * (x[:, 0] ** 2 - 100)
        return x

    sd = np.array([10.0, *[1.0] * (d - 1)])
    return Target(
        lambda x: -0.5 * ((bent(x, 1) / sd) ** 2).sum(axis=1),
        lambda rng, n: bent(sd * rng.normal(size=(n, d)), -1),
        box(d, -60, 60),
    )


def corner(scales: Any, most: float) -> Target:
    """Return exponentials that press into the corner of a box at zero."""
    scales = np.array(scales)
    return Target(
        lambda x: -(x / scales).sum(axis=1),
        lambda rng, n: rng.exponential(scales, (n, len(scales))),
        box(len(scales), 0, most),
    )


def unknown_errors(
    groups: int, shape: float, power: int, data: int, mean: float, ends: Any
) -> Target:
    """Return a mean and an error of each group: its variance, or sd (power 2)."""

    def log_density(x: Floats) -> Floats:
        m, error = x[:, ::2], x[:, 1::2]
        front = power * (shape + 1.5) - (power - 1)
        exponent = (shape + data / 2 * m**2) / error**power
        return -(front * np.log(error) + exponent).sum(axis=1)

    def draw(rng: np.random.Generator, n: int) -> Floats:
        variance = shape / rng.gamma(shape, size=(n, groups))
        m = rng.normal(size=(n, groups)) * np.sqrt(variance / data)
        return np.stack([m, variance ** (1 / power)], axis=2).reshape(n, -1)

    return Target(log_density, draw, np.array([[-mean, mean], ends] * groups))


def skewed(d: int = 4, shape: float = 1.5) -> Target:
    """Return Gamma laws whose scales grow with the sum of those before them."""

    def draw(rng: np.random.Generator, n: int) -> Floats:
        x = rng.gamma(shape, size=(n, d))
        for j in range(1, d):
            x[:, j] *= 1 + 0.3 * x[:, :j].sum(axis=1)
        return x

    def log_density(x: Floats) -> Floats:
        before = np.maximum(x, 1e-12).cumsum(axis=1)[:, :-1]
        scale = 1 + 0.3 * np.column_stack([0 * x[:, :1], before])
        return stats.gamma.logpdf(x, shape, scale=scale).sum(axis=1)

    return Target(log_density, draw, box(d, 0, 200))


def arm(d: int, share: float, scale: float, bend: float, sides: int = 1) -> Target:
    """Return a Gaussian with a thin, bent arm along the first axis, or two."""
    signs = np.resize([1.0, -1.0], d - 1)

    def law(t: Floats) -> Floats:
        beyond = [-t - 3.0, t - 3.0][:sides]
        tail = sum(stats.expon.pdf(u, scale=scale) for u in beyond)
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

    def parts(x: Floats) -> Floats:
        inner = stats.norm.logpdf(x[:, 0], 4.0, 1.0)
        outer = stats.expon.logpdf(x[:, 0], scale=depth)
        rest = x[:, 1:]
        return np.array([
            np.log(1 - share) + inner + stats.norm.logpdf(rest).sum(axis=1),
            np.log(share) + outer + stats.norm.logpdf(rest, 1, 2).sum(axis=1),
        ])  # fmt: skip

    def draw(rng: np.random.Generator, n: int) -> Floats:
        x = rng.normal(size=(n, d))
        x[:, 0] += 4.0
        out = rng.random(n) < share
        x[out, 0] = rng.exponential(depth, out.sum())
        x[out, 1:] = 1 + 2 * x[out, 1:]
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


GRID = np.array([(i, j) for i in range(-10, 15, 5) for j in (-5, 5)]) * 1.0
CUT = np.array([[-0.5, 6.0], [-0.5, 6.0], [-6.0, 6.0], [-6.0, 6.0]])  # two by bounds
ORDERS = list(permutations([-4.0, 0.0, 5.0]))  # of exchangeable parameters
BESIDE = [[0, 0, 0], [1.2, 1.2, 0]], [np.eye(3), 0.15 * np.eye(3)]
PLANE = (0.3, 1), 20, lambda _: np.linspace(4, 16, 10) / 100, lambda rng: (
    GRID + rng.normal(size=(10, 2))
)  # fmt: skip
SPACE = (0.4, 0.8), 10, lambda rng: rng.dirichlet(np.full(10, 4.0)), lambda rng: (
    rng.uniform(-7, 7, (10, 5))
)  # fmt: skip
TWO_T = {"weights": (0.75, 0.25), "means": (-4.0, 5.0), "scales": (1.0, 0.5)}

TARGETS: dict[str, Callable[[], Target]] = {
    "needle, d=4, 5 sd, .2": lambda: needle(4, 5, 0.2, 0.2),
    "needle, d=5, 20 sd, .2": lambda: needle(5, 20, 0.2, 0.2),
    "needle, d=2, 10 sd, .05": lambda: needle(2, 10, 0.05, 0.5),
    "needle, d=3, 20 sd, .3": lambda: needle(3, 20, 0.3, 0.2),
    "needle, d=6, 10 sd, .1": lambda: needle(6, 10, 0.1, 0.3),
    "ring": lambda: shell(2, 5.0, 0.2, 10.0),
    "funnel, d=5": funnel,
    "t, 3 dof, d=10": lambda: student(10, 3.0),
    "banana, d=4": banana,
    "ten modes": lambda: round_modes(10, 2, *PLANE),
    "corner of the box": lambda: corner([0.02] * 4, 1),
    "ridge .9999, d=4": lambda: correlated(0.9999, 1.0, box(4, -10, 20), 0.0),
    "labels": lambda: gaussians([1 / 6] * 6, ORDERS, [np.eye(3)] * 6, box(3, -12, 12)),
    "condition 1e4, d=20": lambda: turned(20),
    "condition 1e4, d=50": lambda: turned(50),
    "condition 1e4, d=100": lambda: turned(100),
    "1e-4 of the prior, d=4": lambda: correlated(0.5, 3e-5, box(4, 0, 1), 1 / 3),
    "unknown noise": lambda: unknown_errors(2, 3.0, 1, 5, 30, (1e-6, 200)),
}
FRESH: dict[str, Callable[[], Target]] = {
    "unequal, d=5, width .15": lambda: unequal(5, 6.0, 0.3, 0.15),
    "unequal, d=8, width .3": lambda: unequal(8, 8.0, 0.4, 0.3),
    "flat balls, d=4": balls,
    "ten modes, d=5": lambda: round_modes(77, 5, *SPACE),
    "needle inside, d=4": lambda: pair(4, 0.7, 0.2, 0.05, box(4, -6, 6)),
    "t, 2.2 dof, d=4": lambda: student(4, 2.2),
    "two t, 4 dof, d=3": lambda: student(3, 4.0, 40, **TWO_T),
    "shell, d=5": lambda: shell(5, 4.0, 0.3, 9.0),
    "gamma ridge, d=4": skewed,
    "cut by bounds, d=4": lambda: correlated(0.6, 1.0, CUT, 0.0),
    "close modes, d=6": lambda: unequal(6, 4.0, 0.5, 0.7),
    "narrow pair, d=3": lambda: unequal(3, 30.0, 0.15, 0.5),
}
BELIEVED: dict[str, Callable[[], Target]] = {
    "arm, d=5": lambda: arm(5, 0.015, 4.0, 0.12),
    "two arms, d=3": lambda: arm(3, 0.03, 3.0, 0.1, sides=2),
    "lobe at a bound, d=4": lobe,
    "crossed, d=6": lambda: crossed(6, 1.5, 0.2, (0.7, 0.3)),
    "beside, d=3": lambda: gaussians([0.75, 0.25], *BESIDE, box(3, -9, 9)),
    "inferred errors, d=4": lambda: unknown_errors(2, 2.5, 2, 4, 40, (1e-3, 40)),
    "ring of four": lambda: bent_ring(4, 4.0, 0.25),
    "corner, d=5": lambda: corner(0.1 * np.geomspace(1, 1 / 30, 5), 2),
    "lognormal, d=4": lambda: lognormal(4, 0.8),
    "arc, width .08": lambda: bent_ring(2, 5.0, 0.08, 2.0),
    "arm, d=4": lambda: arm(4, 0.02, 3.0, 0.2),
    "three crossed, d=6": lambda: crossed(6, 1.2, 0.3, (0.5, 0.3, 0.2)),
    "inferred errors, d=6": lambda: unknown_errors(3, 3.0, 2, 4, 30, (1e-3, 30)),
    "common scale, d=5": shrunk,
}
OVERLAPS: dict[str, Callable[[], Target]] = {
    f"pancakes, d={d}, {light}, {apart} off": partial(pancakes, d, apart, light)
    for d, light, apart in product(
        (6, 8, 10), (0.1, 0.2, 0.3, 0.4, 0.5), (1.0, 1.5, 2.0)
    )
}
