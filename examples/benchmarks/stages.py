"""Which stage of "auto" buys which target: runs without it, and with less of others.

A run of "auto" explores the prior, adapts a proposal, follows its tails, looks for
draws that carry a variance, judges the proposal, learns a response surface where the
posterior is bent, anneals populations where no proposal fits, and goes on with a chain.
Here one stage at a time is left out; or the exploration of a bare density has 2,000 or
1,000 points, as that of an FE model has, instead of 10,000; or the chain ends when
standard deviations are known to 10 % instead of 5 %. Nothing else is changed, so that
what a stage saves elsewhere is counted too.

The targets are those of ``constants.py`` and ``hard_targets.py``, with known answers. A
run has its target if it is called converged, and nothing is far off. Runs end at
120,000 solves at the latest.

Run it:  OMP_NUM_THREADS=1 python examples/benchmarks/stages.py  (an hour)
with --only for some of the targets, and --changes for some of the columns.
"""

from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack
from dataclasses import replace
from itertools import product

import numpy as np
from commands import command, tabulate
from constants import MODULES, SETTINGS, put, run, springs
from hard_targets import Run, truth_of

STAGES = MODULES["auto"].STAGES
LESS = {
    "2,000 p.": {"most_searched": 2_000},
    "1,000 p.": {"most_searched": 1_000},
    "sd 10 %": {"sd_at_end": 2 * SETTINGS.sd_at_end},
}
WITHOUT = {
    "no adapt": "adapt",
    "no tails": "follow_tails",
    "no carry": "carry",
    "no bend": "bend",
    "no anneal": "anneal_starts",
}
TODAY = "today"
CHANGES = TODAY, *LESS, *WITHOUT
SPRINGS = "two springs", "five springs", "bent ridge"
TARGETS = (
    *SPRINGS, "crossed, d=6", "three crossed, d=6", "ring of four", "corner, d=5",
    "lognormal, d=4", "inferred errors, d=4", "common scale, d=5", "ten modes, d=5",
    "unequal, d=5, width .15", "needle inside, d=4", "needle, d=4, 5 sd, .2",
    "narrow pair, d=3", "gamma ridge, d=4", "arc, width .08", "banana, d=4",
    "funnel, d=5",
)  # fmt: skip


def change(case: tuple[str, str, int]) -> Run | None:
    """Return a run of a target by a seed, with one change; None if it fails."""
    name, target, seed = case
    with ExitStack() as stack:
        if name in LESS:
            put(stack, "SETTINGS", SETTINGS, replace(SETTINGS, **LESS[name]))
        if name in WITHOUT:
            kept = tuple(s for s in STAGES if s.__name__ != WITHOUT[name])
            put(stack, "STAGES", STAGES, kept)
        return run(target, seed)


def main(
    seeds: int = 2,
    first: int = 41,
    only: tuple[str, ...] = TARGETS,
    changes: tuple[str, ...] = CHANGES,
    workers: int = 2,
) -> None:
    """Print how many runs have each target, and what they take."""
    for target in only:  # once, for all workers
        springs(target) if target in SPRINGS else truth_of(target)
    cases = [*product(changes, only, range(first, first + seeds))]
    with ProcessPoolExecutor(workers) as pool:
        runs = dict(zip(cases, pool.map(change, cases), strict=True))

    def runs_of(name: str, target: str) -> list[Run]:
        found = [runs[name, target, seed] for seed in range(first, first + seeds)]
        return [one for one in found if one is not None]

    def has(name: str, target: str) -> int:
        return sum(r.converged and r.right for r in runs_of(name, target))

    def takes(name: str, target: str) -> float:
        return float(np.median([r.solves for r in runs_of(name, target)] or [np.nan]))

    columns = ("target", *changes)
    counted, priced = (dict.fromkeys(columns, spec) for spec in ("d", ",.0f"))
    tabulate(f"Runs of {seeds} that have the target", counted | {"target": ""},
             ((t, *(has(name, t) for name in changes)) for t in only))  # fmt: skip
    tabulate("Solves, medians", priced | {"target": ""},
             ((t, *(takes(name, t) for name in changes)) for t in only))  # fmt: skip


if __name__ == "__main__":
    command(main)
