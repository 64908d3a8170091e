"""Efficiency on three targets, against the samplers that a user would pick instead.

fe5   five spring stiffnesses from five frequencies: bounded, correlated to 0.98
g20   a Gaussian in 20 dimensions, correlation 0.95, scales from 0.1 to 10
bim5  two Gaussians in 5 dimensions, ten standard deviations apart, weights 0.3 and 0.7

``compare_moves`` gives every move the same over-dispersed starts of four ensembles, and
compares it with the exact moments. dime-sampler takes part if it is installed:
``pip install dime-sampler``.

Run it:  OMP_NUM_THREADS=1 python examples/benchmarks/benchmark.py
"""

import importlib.util
from collections.abc import Callable
from typing import NamedTuple

import emcee
import numpy as np
from commands import command, tabulate, weigh
from hard_posteriors import box, correlated, gaussians

import emcee_femu as ef
from emcee_femu.extensions.comparison.compare import Comparison

Floats = np.ndarray
EFFECTIVE = 200_000  # draws behind the moments of a posterior that cannot be drawn


class Target(NamedTuple):
    """A log-density with its exact moments; the prior only spreads the starts."""

    posterior: ef.LogPosterior
    mean: Floats
    sd: Floats


def spread_out(
    log_density: Callable[[Floats], Floats], spread: Floats
) -> ef.LogPosterior:
    """Return a given density, with Gaussian starts of given spread."""
    names = [f"x{i}" for i in range(len(spread))]
    prior = ef.GaussianPrior(names, np.zeros(len(spread)), spread)

    def density(x: Floats) -> Floats:
        return log_density(x) - prior.logpdf(x)  # so that the prior cancels

    return ef.LogPosterior.from_function(density, prior, vectorize=True)


def weighed(posterior: ef.LogPosterior) -> Target:
    """Return a posterior with its moments by importance sampling."""
    (pilot,) = ef.run(posterior, ef.DEMCMove(), 40, 4_000, seed=1, ensembles=1)
    chain = pilot.get_chain(discard=1_000, flat=True)
    means, sds, _ = weigh([posterior], chain, EFFECTIVE)
    return Target(posterior, means[0], sds[0])


def fe5() -> Target:
    """Return the five-spring target."""
    ends = [(0, 1), (1, 2), (2, 3), (3, 4), (4, 5), (5, 0), (1, 3), (2, 4), (3, 5)]
    stiffness = [4010.0, 2210.0, 3200.0, 2130.0, 1840.0, 2595.0, 2200.0, 2398.0, 2800.0]
    springs = {f"k{i + 1}": (*ends[i], k) for i, k in enumerate(stiffness)}
    springs["k10"] = (0, 3, 2000.0)
    model = ef.MassSpringModel([2.7, 1.7, 6.1, 5.3, 2.9], springs)
    measured = model({}).frequencies[0]
    paper = ef.paper.mass_spring().posterior.prior  # of another topology
    centre = paper.mean
    prior = ef.GaussianPrior(paper.names, centre, 0.2 * centre, paper.bounds)
    posterior = ef.LogPosterior(model, ef.FrequencyTerm(measured, beta=4.5e5), prior)
    return weighed(posterior)


def g20() -> Target:
    """Return the 20-dimensional Gaussian."""
    sd = np.geomspace(0.1, 10, 20)
    law = correlated(0.95, sd[:, None], box(20, -100, 100), 0.0)
    return Target(spread_out(law.log_density, 3 * sd), np.zeros(20), sd)


def bim5() -> Target:
    """Return the two Gaussians, at -5 (0.3) and +5 (0.7) of the first axis."""
    means = np.outer([-5, 5], np.eye(5)[0])
    law = gaussians([0.3, 0.7], means, [np.eye(5)] * 2, box(5, -50, 50))
    sd = np.array([np.sqrt(1 + 25 - 4), 1, 1, 1, 1])
    return Target(spread_out(law.log_density, np.full(5, 4.0)), 2 * np.eye(5)[0], sd)


TARGETS = {"fe5": (fe5, 32), "g20": (g20, 64), "bim5": (bim5, 32)}  # and walkers
MOVES = {
    "auto": "auto",
    "DEMCMove": ef.DEMCMove(),
    "emcee DEMove": emcee.moves.DEMove(),
    "emcee StretchMove": emcee.moves.StretchMove(),
}
COLUMNS = {"target": "", "move": "", "ESS": ".1f", "end to end": ".1f"}
COLUMNS |= {"left mode": ".3f"}
if importlib.util.find_spec("dime_sampler"):
    from dime_sampler import DIMEMove

    MOVES["dime-sampler"] = DIMEMove()


def main(
    steps: int = 2_000, targets: tuple[str, ...] = tuple(TARGETS)
) -> dict[str, Comparison]:
    """Print the efficiencies, and the share of bim5's left mode; return comparisons."""
    compared, rows = {}, []
    for name in targets:
        make, nwalkers = TARGETS[name]
        posterior, *moments = make()
        exact = zip(*moments, strict=True)
        reference = dict(zip(posterior.names, exact, strict=True))
        found = compared[name] = ef.compare_moves(
            posterior, MOVES, nwalkers, steps, seed=1, reference=reference
        )
        ends = zip(found.idata.items(), found.table.column("end to end"), strict=True)
        for (label, idata), end in ends:
            first = idata["posterior"][posterior.names[0]].values
            share = (first < 0).mean() if name == "bim5" else np.nan
            rows.append((name, label, found.efficiency[label][0], end, share))
    tabulate("Effective samples per 1000 evaluations", COLUMNS, rows)
    return compared


if __name__ == "__main__":
    command(main)
