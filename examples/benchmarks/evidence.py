"""The log evidence against exact values: bias, spread, and what is claimed.

Gaussians in 2, 10 and 20 dimensions, two modes and a funnel in a uniform box; Beck and
Au's shear frame with two modes; a linear model with a Gaussian prior. Three methods: a
tempered run of twelve betas, "auto", and ``anneal``. z is the
error in claimed standard errors; "no claim" counts the seeds whose result says that no
error can be claimed.

The bar: |z| < 3 in 19 of 20 seeds, claimed errors within a factor of 1.5 of the spread.

Run it:  OMP_NUM_THREADS=1 python examples/benchmarks/evidence.py --seeds 20
"""

import argparse
import functools
import itertools
import sys
from collections.abc import Callable, Mapping
from concurrent.futures import ProcessPoolExecutor
from typing import Any, NamedTuple

import numpy as np
from hard_posteriors import FreeModel, Target, posterior_of
from scipy import integrate, stats

import emcee_femu as ef
from emcee_femu.table import Table

Floats = np.ndarray
BETAS = np.linspace(1, 0, 12) ** 4


class Problem(NamedTuple):
    """A posterior and the exact logarithm of its evidence."""

    posterior: ef.LogPosterior
    exact: float
    steps: int = 800


def in_box(log_density: Callable[[Floats], Floats], half: Any, inside: float) -> Any:
    """Return a density, ``inside`` of whose mass lies in a centred box, and steps."""
    box = np.outer(half, [-1.0, 1.0])

    def many(x: Floats) -> Floats:  # scipy drops the axis of a single point
        return np.atleast_1d(log_density(x))

    target = Target(many, draw=None, box=box)  # type: ignore[arg-type]
    return posterior_of(target), np.log(inside) - np.log(np.diff(box)).sum()


def gaussian(d: int) -> Problem:
    """Return one in a box of 20 standard deviations, neighbours correlated by 0.8."""
    index = np.arange(d)
    covariance = 0.8 ** np.abs(index[:, None] - index)
    law = stats.multivariate_normal(np.linspace(-1, 1, d), covariance)
    steps = 800 + 80 * max(0, d - 5)  # DE-MC forgets more slowly
    return Problem(*in_box(law.logpdf, [10.0] * d, 1.0), steps)


def two_modes() -> Problem:
    """Return weights 0.3 and 0.7, ten standard deviations apart in the plane."""
    laws = [stats.multivariate_normal([x, 0.0]) for x in (-5.0, 5.0)]

    def log_density(x: Floats) -> Floats:
        return np.logaddexp(
            np.log(0.3) + laws[0].logpdf(x), np.log(0.7) + laws[1].logpdf(x)
        )

    return Problem(*in_box(log_density, [12.0] * 2, 1.0))


def funnel(d: int = 5, neck: float = 4.0, wide: float = 30.0) -> Problem:
    """Return Neal's funnel: x1 is N(0, 3), the others N(0, exp(x1 / 2))."""

    def log_density(x: Floats) -> Floats:
        v, others = x[:, 0], x[:, 1:]
        along = stats.norm.logpdf(v, 0, 3) - (d - 1) * (v + np.log(2 * np.pi)) / 2
        return along - 0.5 * (others**2).sum(axis=1) * np.exp(-v)

    def slice_inside(v: float) -> float:
        share = 2 * stats.norm.cdf(wide * np.exp(-v / 2)) - 1
        return float(stats.norm.pdf(v, 0, 3) * share ** (d - 1))

    mass = integrate.quad(slice_inside, -neck, neck)[0]
    return Problem(*in_box(log_density, [neck] + [wide] * (d - 1), mass), 2_400)


def misfit(parameters: Any, modes: Any) -> Floats:
    """Return the log-likelihood of Beck and Au's two frequencies."""
    ratio = modes.frequencies**2 / np.array([3.13, 9.83]) ** 2
    return -((ratio - 1) ** 2).sum(axis=1) / (2 * 0.5**8)


def beck_au() -> Problem:
    """Return the posterior of Beck and Au's shear frame, which has two modes.

    By quadrature: evidence 1.50950e-3, E[x1] 1.11700, P[x1 < 1] 0.53079.
    """
    prior = ef.IndependentPrior(
        {
            "x1": stats.lognorm(0.497868, scale=np.exp(0.510237)),
            "x2": stats.lognorm(0.626675, scale=np.exp(0.169578)),
        }
    )
    springs = {
        "x1": 29.7e6 * np.array([[1.0, 0.0], [0.0, 0.0]]),
        "x2": 29.7e6 * np.array([[1.0, -1.0], [-1.0, 1.0]]),
    }
    masses = np.diag([16.5e3, 16.1e3])
    model = ef.MatrixModel(np.zeros((2, 2)), masses, springs, n_modes=2)
    return Problem(ef.LogPosterior(model, misfit, prior), float(np.log(1.50950e-3)))


def linear(d: int = 6, n: int = 12) -> Problem:
    """Return n values linear in d parameters, with a Gaussian prior and errors."""
    rng = np.random.default_rng(7)
    design, sd = rng.normal(size=(n, d)), 0.2
    measured = design @ rng.normal(size=d) + sd * rng.normal(size=n)
    prior = ef.GaussianPrior([f"x{i + 1}" for i in range(d)], np.zeros(d), 2.0)

    def term(parameters: Any, modes: Any) -> Floats:
        x = np.stack([*parameters.values()], axis=1)
        return stats.norm.logpdf(x @ design.T, measured, sd).sum(axis=1)

    law = stats.multivariate_normal(
        np.zeros(n), 4.0 * design @ design.T + sd**2 * np.eye(n)
    )
    exact = float(law.logpdf(measured))
    return Problem(ef.LogPosterior(FreeModel(), term, prior), exact)


PROBLEMS: dict[str, Callable[[], Problem]] = {
    **{f"Gaussian, d={d}": functools.partial(gaussian, d) for d in (2, 10, 20)},
    "two modes": two_modes,
    "funnel, d=5": funnel,
    "Beck and Au": beck_au,
    "linear, d=6": linear,
}


def temper(problem: Problem, seed: int) -> tuple[Any, int]:
    """Return the evidence of a tempered run."""
    move = ef.moves.TemperedMove(ef.DEMCMove(mode_jump=0.1), BETAS)
    run = ef.run(problem.posterior, move, steps=problem.steps, ensembles=1, seed=seed)
    evidence = ef.log_evidence(run, discard=problem.steps // 4)
    return evidence, run[0].nwalkers * problem.steps


def automatic(problem: Problem, seed: int) -> tuple[Any, int]:
    """Return the evidence of a run of "auto"."""
    run = ef.run(problem.posterior, "auto", steps=400, ensembles=2, seed=seed)
    return ef.log_evidence(run), run.evaluations + 2 * 400 * run[0].nwalkers


def anneal(problem: Problem, seed: int, size: int = 1_000) -> tuple[Any, int]:
    """Return the evidence of an annealed population."""
    population = ef.anneal(problem.posterior, size, seed=seed)
    return ef.log_evidence(population), population.solves


METHODS = {"tempered": temper, "auto": automatic, "anneal": anneal}


def estimate(make: Callable[[], Problem], method: Any, seed: int) -> tuple[float, ...]:
    """Return error, claimed standard error and evaluations of one seed."""
    problem = make()
    found, evaluations = method(problem, seed)
    return found.log_evidence - problem.exact, found.log_evidence_error, evaluations


def summarize(
    make: Callable[[], Problem], method: Any, seeds: range, mapping: Any = map
) -> dict[str, float]:
    """Return what the seeds of a problem say of bias, spread, claims and cost."""
    jobs = [(make, method, seed) for seed in seeds]
    results = np.array(list(mapping(estimate, *zip(*jobs, strict=True))))
    off, claimed, evaluations = results.T
    able = np.isfinite(claimed)
    z = off[able] / claimed[able]
    return {
        "evaluations": evaluations.mean(),
        "bias": off.mean(),
        "spread": off.std(ddof=1),
        "claimed": np.sqrt(np.mean(claimed[able] ** 2)) if able.any() else np.nan,
        "|z| > 3": int((np.abs(z) > 3).sum()),
        "no claim": int((~able).sum()),
        "rms z": np.sqrt(np.mean(z**2)) if able.any() else np.nan,
        "claimed %": 100 * able.mean(),
        "rms error": np.sqrt(np.mean(off**2)),
    }


def tabulate(title: str, formats: Mapping[str, str], rows: Any) -> Table:
    """Print each row as it is there, then the table of those columns."""
    found = []
    for row in rows:
        found.append(tuple(row[column] for column in formats))
        print(*found[-1], file=sys.stderr, flush=True)
    table = Table(title, tuple(formats), tuple(formats.values()), tuple(found))
    print(table)
    return table


FORMATS = {
    "problem": "", "method": "", "evaluations": ".0f", "bias": "+.3f", "spread": ".3f",
    "claimed": ".3f", "|z| > 3": "d", "no claim": "d",
}  # fmt: skip


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--problem", action="append", choices=list(PROBLEMS))
    parser.add_argument("--method", action="append", choices=list(METHODS))
    given = parser.parse_args()
    cases = itertools.product(given.problem or PROBLEMS, given.method or METHODS)
    seeds = range(1, given.seeds + 1)
    with ProcessPoolExecutor(given.processes) as pool:
        rows = (
            {"problem": name, "method": method}
            | summarize(PROBLEMS[name], METHODS[method], seeds, pool.map)
            for name, method in cases
        )
        tabulate(f"Log evidence, {given.seeds} seeds each", FORMATS, rows)


if __name__ == "__main__":
    main()
