"""References of the few-solves problems: means and standard deviations, from long runs.

"auto" samples the true posterior; a Student-t mixture is fitted to its draws, one for
each mode where there are two, and drawn from anew, by importance weights. So a lobe of
3 % of the mass, which holds a third of a variance, is as certain as the rest. The
effective number of weights says how certain a reference is: with 40,000 a mean to .005
standard deviations. The figures go to ``few_solves_references.json``, with those of
another seed beside them: the worst difference of means (in standard deviations) and of
standard deviations (relative).

Run it:  OMP_NUM_THREADS=1 python examples/benchmarks/few_solves_references.py
"""

import argparse
import json
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from few_solves_problems import PROBLEMS

import emcee_femu as ef
from emcee_femu.moves.mixture_em import Mixture, draw, log_density
from emcee_femu.sampling.importance import kish_share, pareto_k

Floats = np.ndarray
First = Callable[[Floats], Floats] | None
FILE = Path(__file__).with_suffix(".json")
ROUND, DF, FEWEST = 2_000, 8.0, 15  # draws, degrees of freedom, draws per dimension


class Moments(NamedTuple):
    """Means, standard deviations, weight of the first mode; how certain they are."""

    mean: Floats
    sd: Floats
    first: float | None
    effective: int
    pareto_k: float

    def compare(self, other: "Moments") -> tuple[float, float, float]:
        """Return the worst differences of means, deviations and the weight."""
        means = np.abs((self.mean - other.mean) / other.sd).max()
        sds = np.abs(self.sd / other.sd - 1).max()
        known = self.first is not None and other.first is not None
        return float(means), float(sds), abs(self.first - other.first) if known else 0.0


def sample(posterior: ef.LogPosterior, evaluations: int, seed: int) -> list[Any]:
    """Return samplers of "auto"."""
    nwalkers = max(32, 4 * posterior.ndim)
    steps = evaluations // (2 * nwalkers)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the weights are what counts
        return ef.run(posterior, "auto", nwalkers, steps, ensembles=2, seed=seed)


def fit(chain: Floats, first: First) -> Mixture:
    """Return the mixture of draws, of which each mode has half."""
    parts = [chain]
    if first is not None:
        inside = first(chain)
        parts = [chain[inside], chain[~inside]]
        parts = [part for part in parts if len(part) > FEWEST * chain.shape[1]]
    fits = [ef.IndependenceMove.fit(part, "auto", DF) for part in parts]
    return Mixture(
        np.concatenate([one.weights / len(fits) for one in fits]),
        np.concatenate([one.means for one in fits]),
        np.concatenate([one.scale_matrices for one in fits]),
        DF,
    )


def weigh(
    posteriors: Sequence[ef.LogPosterior],
    chain: Floats,
    first: First,
    size: float,
    seed: int,
) -> list[Moments]:
    """Return moments of posteriors by the same draws of a fit to a chain.

    At least ``size`` are effective for the first posterior. What is common to
    posteriors that are nearly alike drops out of the difference of their moments.
    """
    law, rng = fit(chain, first), np.random.default_rng(seed)
    theta, log_weights = np.empty((0, chain.shape[1])), np.empty((len(posteriors), 0))
    while len(theta) * kish_share(log_weights[0]) < size:
        more = draw(rng, law, ROUND)
        ratios = [p(more)[:, 0] - log_density(more, law) for p in posteriors]
        theta = np.concatenate([theta, more])
        log_weights = np.hstack([log_weights, ratios])
    return [average(theta, own, first) for own in log_weights]


def average(theta: Floats, log_weights: Floats, first: First) -> Moments:
    """Return moments of weighted draws."""
    weights = np.exp(log_weights - log_weights.max())
    weights /= weights.sum()
    mean = weights @ theta
    return Moments(
        mean,
        np.sqrt(weights @ (theta - mean) ** 2),
        None if first is None else float(weights @ first(theta)),
        round(len(theta) * kish_share(log_weights)),
        round(pareto_k(log_weights), 2),
    )


def load(name: str) -> Moments:
    """Return the reference of a problem."""
    known = json.loads(FILE.read_text())[name]
    mean, sd = np.array(known["mean"]), np.array(known["sd"])
    return Moments(mean, sd, known["first"], known["effective"], known["pareto_k"])


def main() -> None:
    """Make the references that are asked for, and print and store them."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--problem", action="append", choices=list(PROBLEMS))
    parser.add_argument("--evaluations", type=int, default=40_000)
    parser.add_argument("--size", type=float, default=40_000)
    given = parser.parse_args()
    for name in given.problem or PROBLEMS:
        problem = PROBLEMS[name]()
        both = []
        for seed, size in ((1, given.size), (2, given.size / 4)):
            runs = sample(problem.posterior, given.evaluations, seed)
            chain = np.concatenate([run.get_chain(flat=True) for run in runs])
            both += weigh([problem.posterior], chain, problem.first, size, seed)
        found, other = both
        prior = problem.posterior.prior.sample(np.random.default_rng(0), 20_000)
        shown = found._asdict() | {
            "mean": found.mean.tolist(),
            "sd": found.sd.tolist(),
            "other": [round(value, 4) for value in other.compare(found)],
            "sd_of_prior": (found.sd / prior.std(axis=0)).round(3).tolist(),
        }
        print(name, json.dumps(shown), flush=True)
        known = json.loads(FILE.read_text()) if FILE.exists() else {}
        FILE.write_text(json.dumps(known | {name: shown}, indent=1) + "\n")


if __name__ == "__main__":
    main()
