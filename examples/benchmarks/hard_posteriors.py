"""Eighteen posteriors that are hard for samplers but can be sampled exactly.

Every target is a density inside a box, with a uniform prior there: unequal modes, a
ring, a funnel, heavy tails, a banana, ten modes, a corner, a ridge, exchangeable
labels, ill-conditioned Gaussians, a speck in a wide prior, and unknown noise.
Run it:  python examples/benchmarks/hard_targets.py
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import permutations
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
    steps: float = 1.0  # share of the steps asked for


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


@dataclass(frozen=True)
class FreeModel:
    """No FE model: the density stands in the likelihood term."""

    variables: dict[str, ef.Variable] = field(
        default_factory=lambda: ef.modal_variables(1)
    )

    def __call__(self, parameters: Any) -> ef.ModalSolution:
        """Return one frequency that nobody reads."""
        return ef.ModalSolution(np.ones((len(next(iter(parameters.values()))), 1)))


def posterior_of(target: Target) -> ef.LogPosterior:
    """Return the target with its box as prior."""
    names = tuple(f"x{i + 1}" for i in range(len(target.box)))

    def density(parameters: Any, modes: Any) -> Floats:
        return target.log_density(np.stack([parameters[n] for n in names], axis=1))

    return ef.LogPosterior(FreeModel(), density, Box(names, target.box))


def inside(target: Target, n: int, seed: int = 1) -> Floats:
    """Return those of ``n`` exact draws that lie inside the box."""
    x = target.draw(np.random.default_rng(seed), n)
    return x[((x >= target.box[:, 0]) & (x <= target.box[:, 1])).all(axis=1)]


def box(d: int, low: float, high: float) -> Floats:
    """Return the same bounds for all parameters."""
    return np.tile([low, high], (d, 1)).astype(float)


def gaussians(
    weights: Any, means: Any, factors: Any, box: Floats, steps: float = 1.0
) -> Target:
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

    label = None if len(weights) == 1 else lambda x: parts(x).argmax(axis=0)
    return Target(lambda x: logsumexp(parts(x), axis=0), draw, box, label, steps)


def needle(d: int, apart: float, weight: float, width: float) -> Target:
    """Return a unit Gaussian at 0 and a narrow one ``apart`` along the diagonal."""
    mean = np.full(d, apart / np.sqrt(d))
    factors = [np.eye(d), width * np.eye(d)]
    limits = box(d, -6, 6 + mean[0])
    return gaussians([1 - weight, weight], [np.zeros(d), mean], factors, limits)


def turned(d: int, steps: float) -> Target:
    """Return a Gaussian whose covariance has condition 1e4, its axes turned."""
    rotation = stats.ortho_group(d, seed=d).rvs()
    factor = rotation * np.geomspace(1, 0.01, d)
    return gaussians([1], np.zeros((1, d)), [factor], box(d, -8, 8), steps)


def equicorrelated(d: int, correlation: float, sd: float, limits: Floats) -> Target:
    """Return a Gaussian centred at a third of the box."""
    matrix = sd**2 * ((1 - correlation) * np.eye(d) + correlation)
    centre = limits[:, 0] + np.diff(limits)[:, 0] / 3
    return gaussians([1], [centre], [np.linalg.cholesky(matrix)], limits)


def ring(radius: float = 5.0, width: float = 0.2) -> Target:
    """Return a thin ring: the radius is Gaussian, weighted by itself."""

    def draw(rng: np.random.Generator, n: int) -> Floats:
        r = rng.normal(radius, width, 2 * n)
        r = r[rng.random(2 * n) < r / (radius + 8 * width)][:n]
        turn = rng.uniform(0, 2 * np.pi, len(r))
        return np.stack([r * np.cos(turn), r * np.sin(turn)], axis=1)

    def log_density(x: Floats) -> Floats:
        return -0.5 * ((np.hypot(*x.T) - radius) / width) ** 2

    return Target(log_density, draw, box(2, -10, 10))


def funnel(d: int = 5) -> Target:
    """Return Neal's funnel: x1 is N(0, 3), the others N(0, exp(x1 / 2))."""

    def draw(rng: np.random.Generator, n: int) -> Floats:
        z = rng.normal(size=(n, d))
        return np.column_stack([3 * z[:, 0], np.exp(1.5 * z[:, :1]) * z[:, 1:]])

    def log_density(x: Floats) -> Floats:
        v, rest = x[:, 0], (x[:, 1:] ** 2).sum(axis=1)
        return -(v**2) / 18 - 0.5 * (rest * np.exp(-v) + (d - 1) * v)

    return Target(log_density, draw, np.vstack([box(1, -12, 12), box(d - 1, -99, 99)]))


def student(d: int = 10, df: float = 3.0) -> Target:
    """Return a multivariate t law."""

    def draw(rng: np.random.Generator, n: int) -> Floats:
        return rng.normal(size=(n, d)) * np.sqrt(df / rng.chisquare(df, (n, 1)))

    def log_density(x: Floats) -> Floats:
        return -0.5 * (df + d) * np.log1p((x**2).sum(axis=1) / df)

    return Target(log_density, draw, box(d, -100, 100))


def banana(d: int = 4, bend: float = 0.03) -> Target:
    """Return Haario's twisted Gaussian: x1 has sd 10, x2 is bent along x1^2."""

    def draw(rng: np.random.Generator, n: int) -> Floats:
        x = rng.normal(size=(n, d))
        x[:, 0] *= 10
        x[:, 1] -= bend * (x[:, 0] ** 2 - 100)
        return x

    def log_density(x: Floats) -> Floats:
        straight = x[:, 1] + bend * (x[:, 0] ** 2 - 100)
        rest = straight**2 + (x[:, 2:] ** 2).sum(axis=1)
        return -0.5 * (x[:, 0] ** 2 / 100 + rest)

    return Target(log_density, draw, box(d, -60, 60))


def corner(d: int = 4, scale: float = 0.02) -> Target:
    """Return exponentials that press into the corner at zero of the unit box."""

    def draw(rng: np.random.Generator, n: int) -> Floats:
        return rng.exponential(scale, (n, d))

    return Target(lambda x: -x.sum(axis=1) / scale, draw, box(d, 0, 1))


def noise(pairs: int = 2, shape: float = 3.0, rate: float = 3.0) -> Target:
    """Return means x1, x3 and unknown variances x2, x4: normal-inverse-gamma laws."""

    def draw(rng: np.random.Generator, n: int) -> Floats:
        variance = rate / rng.gamma(shape, size=(n, pairs))
        mean = rng.normal(size=(n, pairs)) * np.sqrt(variance / 5)
        return np.stack([mean, variance], axis=2).reshape(n, -1)

    def log_density(x: Floats) -> Floats:
        mean, variance = x[:, ::2], x[:, 1::2]
        exponent = (rate + 2.5 * mean**2) / variance
        return -((shape + 1.5) * np.log(variance) + exponent).sum(axis=1)

    limits = [[-30.0, 30.0], [1e-6, 200.0]] * pairs
    return Target(log_density, draw, np.array(limits))


def ten_modes() -> Target:
    """Return ten Gaussians in the plane, weights 0.04 to 0.16, sds 0.3 to 1."""
    rng = np.random.default_rng(10)
    means = np.array([(i, j) for i in range(-10, 15, 5) for j in (-5, 5)]) * 1.0
    factors = rng.uniform(0.3, 1, 10)[:, None, None] * np.eye(2)
    return gaussians(
        np.linspace(4, 16, 10) / 100, means + rng.normal(size=(10, 2)), factors,
        box(2, -20, 20),
    )  # fmt: skip


def labels() -> Target:
    """Return three exchangeable parameters around -4, 0 and 5: six equal modes."""
    means = list(permutations([-4.0, 0.0, 5.0]))
    return gaussians(np.full(6, 1 / 6), means, [np.eye(3)] * 6, box(3, -12, 12))


TARGETS: dict[str, Callable[[], Target]] = {
    "needle, d=4, 5 sd, .2": lambda: needle(4, 5, 0.2, 0.2),
    "needle, d=5, 20 sd, .2": lambda: needle(5, 20, 0.2, 0.2),
    "needle, d=2, 10 sd, .05": lambda: needle(2, 10, 0.05, 0.5),
    "needle, d=3, 20 sd, .3": lambda: needle(3, 20, 0.3, 0.2),
    "needle, d=6, 10 sd, .1": lambda: needle(6, 10, 0.1, 0.3),
    "ring": ring,
    "funnel, d=5": funnel,
    "t, 3 dof, d=10": student,
    "banana, d=4": banana,
    "ten modes": ten_modes,
    "corner of the box": corner,
    "ridge .9999, d=4": lambda: equicorrelated(4, 0.9999, 1.0, box(4, -10, 20)),
    "labels": labels,
    "condition 1e4, d=20": lambda: turned(20, 1.0),
    "condition 1e4, d=50": lambda: turned(50, 0.5),
    "condition 1e4, d=100": lambda: turned(100, 0.2),
    "1e-4 of the prior, d=4": lambda: equicorrelated(4, 0.5, 3e-5, box(4, 0, 1)),
    "unknown noise": noise,
}
