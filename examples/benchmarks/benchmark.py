"""Efficiency on three targets, against the samplers that a user would pick instead.

fe5   five spring stiffnesses from five frequencies: bounded, correlated to 0.98
g20   a Gaussian in 20 dimensions, correlation 0.95, scales from 0.1 to 10
bim5  two Gaussians in 5 dimensions, ten standard deviations apart, weights 0.3 and 0.7

Every sampler gets the same vectorised log-density, the same over-dispersed starts and
the same number of walkers. The effective sample size is the bulk ESS of the worst
parameter. "/1000" counts what comes after the burn-in; "end to end" counts all
evaluations, including burn-in and the search of "auto". Another sampler takes part if
it is installed: ``pip install dime-sampler``.

Run it:  OMP_NUM_THREADS=1 python examples/benchmarks/benchmark.py
"""

import importlib.util
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import emcee
import numpy as np
from commands import command

import emcee_femu as ef
from emcee_femu.moves.mixture import Mixture

Floats = np.ndarray


@dataclass(frozen=True)
class Target:
    """A log-density with its exact moments; the prior only spreads the starts."""

    name: str
    posterior: ef.LogPosterior
    mean: Floats
    sd: Floats


def free_target(
    name: str, log_density: Callable[[Floats], Floats], spread: Floats, mean: Floats,
    sd: Floats,
) -> Target:  # fmt: skip
    """Return a target of given density, with Gaussian starts of given spread."""
    names = [f"x{i}" for i in range(len(spread))]
    prior = ef.GaussianPrior(names, np.zeros(len(spread)), spread)

    def density(x: Floats) -> Floats:
        return log_density(x) - prior.logpdf(x)  # so that the prior cancels

    posterior = ef.LogPosterior.from_function(density, prior, vectorize=True)
    return Target(name, posterior, mean, sd)


def fe5() -> Target:
    """Return the five-spring target; its moments come from importance sampling."""
    ends = [(0, 1), (1, 2), (2, 3), (3, 4), (4, 5), (5, 0), (1, 3), (2, 4), (3, 5)]
    stiffness = [4010.0, 2210.0, 3200.0, 2130.0, 1840.0, 2595.0, 2200.0, 2398.0, 2800.0]
    springs = {
        f"k{i}": (*pair, k)
        for i, (pair, k) in enumerate(zip(ends, stiffness, strict=True), 1)
    } | {"k10": (0, 3, 2000.0)}
    model = ef.MassSpringModel([2.7, 1.7, 6.1, 5.3, 2.9], springs)
    measured = model({}).frequencies[0]
    centre = np.array([4600.0, 2580.0, 1680.0, 3100.0, 2350.0])
    bounds = np.array(
        [(3200, 4800), (1800, 2600), (1600, 2670), (1800, 3400), (2050, 2750)]
    )
    names = ["k1", "k2", "k4", "k6", "k8"]
    prior = ef.GaussianPrior(names, centre, 0.2 * centre, bounds)
    posterior = ef.LogPosterior(model, ef.FrequencyTerm(measured, beta=4.5e5), prior)
    (pilot,) = ef.run(posterior, ef.DEMCMove(), 40, 4_000, seed=1, ensembles=1)
    fit = ef.IndependenceMove.fit(pilot.get_chain(discard=1_000, flat=True), "auto", 5)
    law = Mixture(fit.weights, fit.means, fit.scale_matrices, 5)
    draws = law.draw(np.random.default_rng(1), 400_000)
    parts = np.array_split(draws, 80)
    logs = np.concatenate([posterior(x)[:, 0] - law.log_density(x) for x in parts])
    weights = np.exp(logs - logs.max())
    mean = np.average(draws, axis=0, weights=weights)
    sd = np.sqrt(np.average((draws - mean) ** 2, axis=0, weights=weights))
    return Target("fe5", posterior, mean, sd)


def g20() -> Target:
    """Return the 20-dimensional Gaussian."""
    sd = np.geomspace(0.1, 10, 20)
    precision = np.linalg.inv(0.05 * np.eye(20) + 0.95) / np.outer(sd, sd)
    return free_target(
        "g20",
        lambda x: -0.5 * np.einsum("ni,ni->n", x @ precision, x),
        3 * sd,
        np.zeros(20),
        sd,
    )


def bim5() -> Target:
    """Return the two Gaussians, at -5 (0.3) and +5 (0.7) of the first axis."""

    def log_density(x: Floats) -> Floats:
        rest = -0.5 * (x[:, 1:] ** 2).sum(axis=1)
        left = np.log(0.3) - 0.5 * (x[:, 0] + 5) ** 2
        return rest + np.logaddexp(left, np.log(0.7) - 0.5 * (x[:, 0] - 5) ** 2)

    mean = np.array([2.0, 0, 0, 0, 0])
    sd = np.array([np.sqrt(1 + 25 - 4), 1, 1, 1, 1])
    return free_target("bim5", log_density, np.full(5, 4.0), mean, sd)


Result = tuple[
    emcee.EnsembleSampler, int, int, int
]  # burn-in, then evaluations kept, all


def with_emcee(move: Any, target: Target, start: Floats, steps: int) -> Result:
    """Run any emcee move with plain emcee; the first quarter is burn-in."""
    nwalkers, d = start.shape
    sampler = emcee.EnsembleSampler(
        nwalkers, d, lambda x: target.posterior(x)[:, 0], moves=move, vectorize=True
    )
    burn_in = steps // 4
    sampler.run_mcmc(sampler.run_mcmc(start, burn_in), steps - burn_in)
    return sampler, burn_in, nwalkers * (steps - burn_in), nwalkers * (1 + steps)


def automatic(target: Target, start: Floats, steps: int, seed: int) -> Result:
    """Run "auto"; its search is extra and counts end to end."""
    kept, options = steps - steps // 4, {"ensembles": 1, "seed": seed, "starts": start}
    run = ef.run(target.posterior, "auto", len(start), kept, **options)
    return run[0], 0, len(start) * kept, run.evaluations + len(start) * kept


MOVES: dict[str, Callable[[], Any]] = {  # "auto" is no move
    "DEMCMove (ours)": ef.DEMCMove,
    "emcee DEMove": emcee.moves.DEMove,
    "emcee StretchMove": emcee.moves.StretchMove,
}
if importlib.util.find_spec("dime_sampler"):
    from dime_sampler import DIMEMove

    MOVES["dime-sampler"] = DIMEMove


def measured(result: Result, target: Target) -> tuple[float, ...]:
    """Return ESS /1000, end to end /1000, errors, and share x1 < 0."""
    sampler, burn_in, kept, every = result
    ess = 1000 * ef.diagnose(sampler, discard=burn_in).ess_bulk.min()
    draws = sampler.get_chain(discard=burn_in, flat=True)
    off = np.abs((draws.mean(axis=0) - target.mean) / target.sd).max()
    spread = 100 * np.abs(draws.std(axis=0) / target.sd - 1).max()
    return ess / kept, ess / every, off, spread, (draws[:, 0] < 0).mean()


def main(
    steps: int = 8_000, repeats: int = 3, only: str = ""
) -> dict[tuple[str, str], Floats]:
    """Print a table a target; return the medians over the repeats."""
    medians = {}
    for make, nwalkers in ((fe5, 32), (g20, 64), (bim5, 32)):
        if only and make.__name__ != only:
            continue
        target, runs = make(), {name: [] for name in ("auto (ours)", *MOVES)}
        for seed in range(repeats):
            start = target.posterior.start(nwalkers, seed)
            for name, rows in runs.items():
                np.random.seed(seed)  # noqa: NPY002 - emcee and the peer use it
                if name in MOVES:
                    result = with_emcee(MOVES[name](), target, start.copy(), steps)
                else:
                    result = automatic(target, start.copy(), steps, seed)
                rows.append(measured(result, target))
        print(
            f"\n{target.name}, {nwalkers} walkers, {steps} generations, medians of "
            f"{repeats} paired runs\n{'sampler':<18} ESS /1000  end to end "
            " mean error (sd)  sd error %  share x1 < 0"
        )
        for name, rows in runs.items():
            row = medians[target.name, name] = np.median(rows, axis=0)
            print(
                "{:<18} {:9.1f} {:11.1f} {:16.3f} {:11.1f} {:13.3f}".format(name, *row)
            )
    return medians


if __name__ == "__main__":
    command(main)
