"""Hard posteriors with known answers: how often is a converged run right?

The targets are those of ``hard_posteriors.py``; up to a million exact draws of each
give its means, standard deviations and the weights of its modes. Each run of "auto"
ends by its own verdict. docs/explanation/calibration.md says which runs are wrong. The
bar: at most 2 % of the runs that are called converged.

Run it:  OMP_NUM_THREADS=1 python examples/benchmarks/hard_targets.py --seeds 20
with --targets for a name or a part of names.
"""

import functools
import warnings
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from commands import command, tabulate
from hard_posteriors import (
    BELIEVED,
    FRESH,
    OVERLAPS,
    TARGETS,
    Target,
    inside,
    posterior_of,
)

import emcee_femu as ef

Floats = np.ndarray
MOST_DRAWS, MOST_NUMBERS = 1_000_000, 10_000_000  # of a target, exact
SETS = {"eighteen": TARGETS, "twelve": FRESH, "fourteen": BELIEVED}
SETS |= {"overlaps": OVERLAPS}
ALL = TARGETS | FRESH | BELIEVED | OVERLAPS
FAR_MEAN, FAR_SD, FAR_WEIGHT = 0.15, 0.12, 0.05
COLUMNS = {
    "target": "", "runs": "", "converged": "", "wrong": "", "sd off %": ".0f",
    "rms z": ".2f", "solves": ",.0f",
}  # fmt: skip


class Truth(NamedTuple):
    """What exact draws say."""

    mean: Floats
    sd: Floats
    weights: Floats  # of the modes
    draws: int


class Run(NamedTuple):
    """What one run says, and how far off it is."""

    converged: bool
    wrong: bool  # beyond what its own errors allow
    right: bool  # nothing is far off
    sd: float  # largest relative error of a standard deviation
    z: float  # the same by its claimed error
    solves: int


@functools.cache
def truth_of(name: str) -> tuple[Target, Truth]:
    """Return a target, and what exact draws say of it."""
    target = ALL[name]()
    x = inside(target, min(MOST_DRAWS, MOST_NUMBERS // len(target.box)))
    weights = np.bincount(target.label(x)) / len(x) if target.label else np.ones(1)
    return target, Truth(x.mean(axis=0), x.std(axis=0), weights, len(x))


def judge(name: str, **options: int) -> Run:
    """Run "auto" on a target, and compare."""
    target, truth = truth_of(name)
    return compare(posterior_of(target), truth, target.label, **options)


def compare(
    posterior: ef.LogPosterior,
    truth: Truth,
    label: Callable[[Floats], Floats] | None,
    **options: Any,
) -> Run:
    """Run "auto", or given moves, on a posterior, and compare with the truth."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the verdict is what counts
        run = ef.run(posterior, **options)
        found = ef.diagnose(run)
    group = ef.to_inference_data(run)["posterior"]  # without burn-in and hot walkers
    x = np.column_stack([np.ravel(group[name]) for name in posterior.names])
    error = truth.sd * np.sqrt(1 / found.ess_bulk + 1 / truth.draws)
    off = np.abs(x.mean(axis=0) - truth.mean)
    relative = x.std(axis=0) / truth.sd - 1
    weights = truth.weights
    if label:
        weights = np.bincount(label(x), minlength=len(weights)) / len(x)
    lost = np.abs(weights - truth.weights).max() > FAR_WEIGHT
    means, sds = off > FAR_MEAN * truth.sd, np.abs(relative) > FAR_SD
    beyond = means & (off > 3 * error)
    beyond |= sds & (np.abs(relative) > 2 * found.sd_error)
    worst = int(np.argmax(np.abs(relative)))
    return Run(
        found.converged, bool(lost or beyond.any()), not (lost or (means | sds).any()),
        float(np.abs(relative[worst])), float(relative[worst] / found.sd_error[worst]),
        run.solves,
    )  # fmt: skip


def summarize(name: str, runs: list[Run]) -> tuple[object, ...]:
    """Return a row of the table."""
    good = [run for run in runs if run.converged]
    return (
        name, len(runs), len(good), sum(run.wrong for run in good),
        100 * max((run.sd for run in good), default=np.nan),
        np.sqrt(np.mean([run.z**2 for run in good] or [np.nan])),
        np.median([run.solves for run in runs]),
    )  # fmt: skip


def main(
    seeds: int = 3, targets: str = "fourteen", first: int = 0
) -> dict[str, list[Run]]:
    """Run a set, a name or those with a part of it; print and return runs by target."""
    named = [targets] if targets in ALL else [name for name in ALL if targets in name]
    names = [*SETS.get(targets, named)]
    results: dict[str, list[Run]] = {}

    def row(name: str) -> tuple[object, ...]:
        results[name] = [judge(name, seed=seed) for seed in range(first, first + seeds)]
        return summarize(name, results[name])

    title = "Hard targets: what runs called converged are worth"
    tabulate(title, COLUMNS, map(row, names))
    runs = [run for found in results.values() for run in found]
    called, right = ([r for r in runs if r.converged], [r for r in runs if r.right])
    print(
        f"{len(called)} of {len(runs)} runs are called converged, "
        f"{sum(run.wrong for run in called)} of these are wrong;\n{len(right)} runs "
        f"are right, {sum(run.converged for run in right)} of these are called "
        "converged."
    )
    return results


if __name__ == "__main__":
    command(main)
