"""The log evidence against exact values: bias, spread, and what is claimed.

Gaussians in 2 to 20 dimensions, two modes and a funnel in a uniform box; Beck and Au's
shear frame with two modes; a linear model with a Gaussian prior. Three methods: a
tempered run of twelve betas, "auto", and "anneal". z is the error in claimed standard
errors, over the seeds that claim one.

Run it:  OMP_NUM_THREADS=1 python examples/benchmarks/evidence.py --seeds 20
"""

import functools
import itertools
from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from commands import command, tabulate
from hard_posteriors import Target, box, funnel, gaussians
from scipy import integrate, stats

import emcee_femu as ef
from emcee_femu.table import Table

Floats = np.ndarray
BETAS = np.linspace(1, 0, 12) ** 4
MEMBERS = 1_000  # of a population


class Problem(NamedTuple):
    """A posterior and the exact logarithm of its evidence."""

    posterior: ef.LogPosterior
    exact: float
    steps: int = 800


def in_box(target: Target, mass: float, steps: int = 800) -> Problem:
    """Return a target with the mass of its density in its box, whose prior is flat."""
    bounds = {f"x{i + 1}": ends for i, ends in enumerate(target.box)}
    density = target.log_density
    posterior = ef.LogPosterior.from_function(density, bounds, vectorize=True)
    return Problem(posterior, np.log(mass) - np.log(np.diff(target.box)).sum(), steps)


def gaussian(d: int) -> Problem:
    """Return one in a box of 20 standard deviations, neighbours correlated by 0.8."""
    index = np.arange(d)
    factor = np.linalg.cholesky(0.8 ** np.abs(index[:, None] - index))
    target = gaussians([1], [np.linspace(-1, 1, d)], [factor], box(d, -10, 10))
    steps = 800 + 80 * max(0, d - 5)  # DE-MC forgets more slowly
    return in_box(target, (2 * np.pi) ** (d / 2), steps)


def two_modes() -> Problem:
    """Return weights 0.3 and 0.7, ten standard deviations apart in the plane."""
    means, factors = [[-5, 0], [5, 0]], [np.eye(2)] * 2
    return in_box(gaussians([0.3, 0.7], means, factors, box(2, -12, 12)), 2 * np.pi)


def narrow_funnel(d: int = 5, neck: float = 4.0, wide: float = 30.0) -> Problem:
    """Return Neal's funnel in a box that cuts it."""

    def slice_inside(v: float) -> float:
        share = 2 * stats.norm.cdf(wide * np.exp(-v / 2)) - 1
        return float(stats.norm.pdf(v, 0, 3) * share ** (d - 1))

    mass = integrate.quad(slice_inside, -neck, neck)[0] * 3 * (2 * np.pi) ** (d / 2)
    limits = np.vstack([box(1, -neck, neck), box(d - 1, -wide, wide)])
    return in_box(replace(funnel(d), box=limits), mass, 2_400)


def misfit(parameters: Any, modes: Any) -> Floats:
    """Return the log-likelihood of Beck and Au's two frequencies."""
    ratio = modes.frequencies**2 / np.array([3.13, 9.83]) ** 2
    return -((ratio - 1) ** 2).sum(axis=1) / (2 * 0.5**8)


def beck_au() -> Problem:
    """Return the posterior of Beck and Au's shear frame, which has two modes.

    By quadrature: evidence 1.50950e-3, E[x1] 1.11700, P[x1 < 1] 0.53079.
    """
    x1 = stats.lognorm(0.497868, scale=np.exp(0.510237))
    x2 = stats.lognorm(0.626675, scale=np.exp(0.169578))
    K = {"x1": np.diag([29.7e6, 0.0]), "x2": 29.7e6 * np.array([[1, -1], [-1, 1]])}
    masses, nothing = np.diag([16.5e3, 16.1e3]), np.zeros((2, 2))
    model = ef.MatrixModel(nothing, masses, K, n_modes=2)
    prior = ef.IndependentPrior({"x1": x1, "x2": x2})
    return Problem(ef.LogPosterior(model, misfit, prior), float(np.log(1.50950e-3)))


def linear(d: int = 6, n: int = 12) -> Problem:
    """Return n values linear in d parameters, with a Gaussian prior and errors."""
    rng = np.random.default_rng(7)
    design, sd = rng.normal(size=(n, d)), 0.2
    measured = design @ rng.normal(size=d) + sd * rng.normal(size=n)
    prior = ef.GaussianPrior([f"x{i + 1}" for i in range(d)], np.zeros(d), 2.0)

    def log_likelihood(x: Floats) -> Floats:
        return stats.norm.logpdf(x @ design.T, measured, sd).sum(axis=1)

    covariance = 4.0 * design @ design.T + sd**2 * np.eye(n)
    exact = stats.multivariate_normal.logpdf(measured, np.zeros(n), covariance)
    posterior = ef.LogPosterior.from_function(log_likelihood, prior, vectorize=True)
    return Problem(posterior, float(exact))


PROBLEMS: dict[str, Callable[[], Problem]] = {
    **{f"Gaussian, d={d}": functools.partial(gaussian, d) for d in (2, 5, 10, 20)},
    "two modes": two_modes,
    "funnel, d=5": narrow_funnel,
    "Beck and Au": beck_au,
    "linear, d=6": linear,
}


def temper(problem: Problem, seed: int) -> tuple[Any, int]:
    """Return the evidence of a tempered run."""
    move = ef.moves.TemperedMove(ef.DEMCMove(mode_jump=0.1), BETAS)
    run = ef.run(problem.posterior, move, steps=problem.steps, ensembles=1, seed=seed)
    evidence = ef.log_evidence(run)
    return evidence, run[0].nwalkers * problem.steps


def automatic(problem: Problem, seed: int) -> tuple[Any, int]:
    """Return the evidence of a run of "auto"."""
    run = ef.run(problem.posterior, "auto", steps=400, ensembles=2, seed=seed)
    return ef.log_evidence(run), run.evaluations + 2 * 400 * run[0].nwalkers


def anneal(problem: Problem, seed: int) -> tuple[Any, int]:
    """Return the evidence of an annealed population."""
    population = ef.anneal(problem.posterior, MEMBERS, seed=seed)
    return ef.log_evidence(population), population.solves


METHODS = {"tempered": temper, "auto": automatic, "anneal": anneal}


def estimate(name: str, method: str, seed: int) -> tuple[float, ...]:
    """Return error, claimed standard error and evaluations of one seed."""
    problem = PROBLEMS[name]()
    found, evaluations = METHODS[method](problem, seed)
    return found.log_evidence - problem.exact, found.log_evidence_error, evaluations


FORMATS = {
    "problem": "", "method": "", "evaluations": ",.0f", "bias": "+.3f",
    "spread": ".4f", "claimed": ".4f", "|z| > 3": "d", "no claim": "d",
}  # fmt: skip


def summarize(name: str, method: str, results: Floats) -> tuple[object, ...]:
    """Return what the seeds of a problem say of cost, bias, spread and claims."""
    off, claimed, evaluations = results.T
    able = np.isfinite(claimed)
    rms = np.sqrt(np.mean(claimed[able] ** 2)) if able.any() else np.nan
    beyond = np.sum(np.abs(off[able]) > 3 * claimed[able])
    spread = off.mean(), off.std(ddof=1)
    return name, method, evaluations.mean(), *spread, rms, beyond, np.sum(~able)


def main(
    seeds: int = 20,
    problem: tuple[str, ...] = tuple(PROBLEMS),
    method: tuple[str, ...] = tuple(METHODS),
) -> Table:
    """Print and return the table."""

    def row(name: str, method: str) -> tuple[object, ...]:
        found = [estimate(name, method, seed) for seed in range(1, 1 + seeds)]
        return summarize(name, method, np.array(found))

    rows = itertools.starmap(row, itertools.product(problem, method))
    return tabulate(f"Log evidence, {seeds} seeds each", FORMATS, rows)


if __name__ == "__main__":
    command(main)
