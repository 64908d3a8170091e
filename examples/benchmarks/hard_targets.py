"""Hard posteriors with known answers: how often is a converged run right?

The targets are those of ``hard_posteriors.py``; up to a million exact draws of each
give its means, its 1 % and 99 % quantiles and the weights of its modes. Each run of
"auto", four independent ensembles, is compared with them in its own standard errors.
z of a mean is its error over the run's standard deviation times sqrt(1 / ESS). z of a
quantile is that of the share of draws beyond the exact quantile. The exact draws' own
error is added. ESS / 1000 is the bulk ESS of the worst parameter per 1000
evaluations, including all before the chain.

The bar: of all runs called converged at most 1 % have a mean off by more than 5 of
its standard errors, none has a mode's weight off by more than 0.05, and z scatters by
0.8 to 1.3. All of these are given the modes that the run found; missed modes are in a
separate column.

Run it:  OMP_NUM_THREADS=1 python examples/benchmarks/hard_targets.py --seeds 20
and with --fresh for twelve targets to which no setting was tuned.
"""

import argparse
import functools
import warnings
from collections import Counter
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor
from typing import NamedTuple

import arviz
import numpy as np
from hard_posteriors import FRESH, TARGETS, Target, inside, posterior_of

import emcee_femu as ef
from emcee_femu.table import Table

Floats = np.ndarray
MOST_DRAWS, MOST_NUMBERS = 1_000_000, 10_000_000  # of a target, exact
MOST_TAILS = 10  # parameters whose quantiles are compared
ALL = TARGETS | FRESH
COLUMNS = {
    "target": "", "runs": "", "converged": "", "worst z": ".1f", "rms z": ".2f",
    "rms z 1, 99 %": ".2f", "weight error": ".3f", "missed in": "",
    "its weight": ".2f", "ESS/1000": ".1f",
}  # fmt: skip


class Truth(NamedTuple):
    """Expectations of :func:`features` and how many exact draws they come from."""

    ends: Floats  # 1 % and 99 % quantiles (2, d')
    tails: Floats  # parameters that they belong to (d')
    n_modes: int
    means: Floats
    draws: int


@functools.cache
def truth_of(name: str, kept: tuple[int, ...] | None = None) -> tuple[Target, Truth]:
    """Return the target and what exact draws say of it, of those in some modes."""
    target, d = ALL[name](), len(ALL[name]().box)
    x = inside(target, min(MOST_DRAWS, MOST_NUMBERS // d))
    if kept is not None and target.label:
        x = x[np.isin(target.label(x), kept)]
    tails = np.unique(np.linspace(0, d - 1, MOST_TAILS).astype(int))
    ends = np.quantile(x[:, tails], [0.01, 0.99], axis=0)
    n_modes = 1 + int(target.label(x).max()) if target.label else 0
    truth = Truth(ends, tails, n_modes, np.empty(0), len(x))
    return target, truth._replace(means=features(target, truth, x).mean(axis=0))


def features(target: Target, truth: Truth, x: Floats) -> Floats:
    """Return parameters, whether they are below each quantile, and indicators."""
    tails = [x[:, truth.tails] < end for end in truth.ends]
    modes = np.empty((len(x), 0))
    if target.label:
        modes = target.label(x)[:, None] == np.arange(truth.n_modes)
    return np.hstack([x, *tails, modes]).astype(float)


class Run(NamedTuple):
    """What one run says, and how wrong it is in its own standard errors."""

    short: str
    mean_z: Floats
    tail_z: Floats
    weight_z: Floats
    weight_error: float
    ess: float  # per 1000 evaluations
    missed: float  # weight of the modes that it did not find


def judge(name: str, seed: int, steps: int) -> Run:
    """Run "auto" on a target and compare."""
    target, truth = truth_of(name)
    d, steps = len(target.box), max(8, round(target.steps * steps))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the verdict is what counts
        runs = ef.run(
            posterior_of(target), "auto", nwalkers=max(16, min(4 * d, 2 * d + 24)),
            steps=steps, ensembles=4, seed=seed,
        )  # fmt: skip
        found = ef.diagnose(runs)
    cost = runs.evaluations + sum(s.nwalkers * steps for s in runs)
    chains = np.concatenate([s.get_chain().swapaxes(0, 1) for s in runs])
    missed = 0.0
    if target.label:
        labels = target.label(chains.reshape(-1, d))
        kept = tuple(np.flatnonzero(np.bincount(labels, minlength=truth.n_modes)))
        whole = truth.means[len(truth.means) - truth.n_modes :]
        missed = 1 - float(whole[list(kept)].sum())
        if missed > 0:
            target, truth = truth_of(name, kept)
    columns = features(target, truth, chains.reshape(-1, d))
    by_walker = columns.reshape(*chains.shape[:2], -1)  # (walkers, steps, features)
    sizes = np.array(
        [arviz.ess(c, method="mean") for c in np.moveaxis(by_walker, 2, 0)]
    )
    shares = truth.means[d:]
    sd = np.append(chains.std(axis=(0, 1)), np.sqrt(shares * (1 - shares)))
    sd = np.maximum(sd, 1e-12)  # of a mode that is missed
    errors = columns.mean(axis=0) - truth.means
    # An indicator that never changes claims no error of its own.
    z = errors / (sd * np.sqrt(1 / np.nan_to_num(sizes, nan=len(columns))
                               + 1 / truth.draws))  # fmt: skip
    weights = slice(d + 2 * len(truth.tails), None)
    worst = np.abs(errors[weights]).max(initial=0)
    ess = 1000 * float(found.ess_bulk.min()) / cost
    short = found.chains.short
    return Run(short, z[:d], z[d : weights.start], z[weights], worst, ess, missed)


def rms(values: Iterable[Floats]) -> float:
    """Return the root mean square of all z."""
    z = np.concatenate([*values, np.empty(0)])
    return float(np.sqrt(np.mean(z**2))) if len(z) else np.nan


def report(results: dict[str, list[Run]]) -> None:
    """Print the table and the totals."""
    rows, called, off = [], [], 0
    for name, runs in results.items():
        good = [run for run in runs if run.short == "converged"]
        worst = [float(np.abs(run.mean_z).max()) for run in good]
        errors, missed = [r.weight_error for r in good], [r.missed for r in good]
        rows.append((
            name, len(runs), len(good), max(worst, default=np.nan),
            rms(r.mean_z for r in good), rms(r.tail_z for r in good),
            max(errors, default=np.nan), sum(m > 0 for m in missed),
            max(missed, default=np.nan), np.median([r.ess for r in runs]),
        ))  # fmt: skip
        called += good
        off += sum(z > 5 for z in worst)
    title = "Hard targets; z and weights of the runs called converged"
    print(Table(title, tuple(COLUMNS), tuple(COLUMNS.values()), tuple(rows)))
    heavier = max((run.weight_error for run in called), default=0.0)
    print(
        f"{len(called)} of {sum(map(len, results.values()))} runs are called "
        f"converged; {off} of these have a mean off by more than 5 standard errors "
        f"(bar: 1 %), the worst weight is off by {heavier:.3f} (bar: 0.05), rms z is "
        f"{rms(run.mean_z for run in called):.2f} for means, "
        f"{rms(run.tail_z for run in called):.2f} for quantiles and "
        f"{rms(run.weight_z for run in called):.2f} for weights (bar: 0.8 to 1.3)."
    )


def main(
    seeds: int = 3,
    targets: str = "",
    steps: int = 2_000,
    processes: int = 1,
    fresh: bool = False,
) -> dict[str, list[Run]]:
    """Run, print the table and the totals, and return all runs by target."""
    results: dict[str, list[Run]] = {}
    for name in (n for n in (FRESH if fresh else TARGETS) if targets in n):
        truth_of(name)  # before processes are forked
        jobs = [name] * seeds, range(seeds), [steps] * seeds
        if processes > 1:
            with ProcessPoolExecutor(processes) as pool:
                results[name] = list(pool.map(judge, *jobs))
        else:
            results[name] = list(map(judge, *jobs))
        said = Counter(run.short.split(":")[0] for run in results[name])
        print(f"{name}: {dict(said)}", flush=True)
    report(results)
    return results


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--targets", default="", help="part of their names")
    parser.add_argument("--steps", type=int, default=2_000)
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--fresh", action="store_true", help="the other targets")
    main(**vars(parser.parse_args()))
