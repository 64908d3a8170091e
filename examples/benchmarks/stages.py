"""Which stage of "auto" buys which target: runs without it, and with less of others.

A run of "auto" explores the prior, adapts a proposal, follows its tails, looks for
draws that carry a variance, judges the proposal, learns a response surface where the
posterior is bent, anneals populations where no proposal fits, and goes on with a chain.
Here one stage at a time is left out; or the exploration has half of its points, or, of
a bare density, 2,000 or 1,000 instead of 10,000; or the chain ends when standard
deviations are known to 10 % instead of 5 %. Nothing else is changed, so that what a
stage saves elsewhere is counted too. FE models are explored by 1,000 points.

The targets are those of ``constants.py`` and ``hard_targets.py``, with known answers. A
run has its target if it is called converged, and nothing is far off. Runs end at
120,000 solves at the latest.

Run it:  OMP_NUM_THREADS=1 python examples/benchmarks/stages.py  (an hour or two)
with --only for some of the targets, and --changes for some of the columns.
"""

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace
from itertools import product

import numpy as np
from commands import command, share_out, tabulate
from constants import MODULES, SETTINGS, put, run, springs
from hard_targets import Run, truth_of

from emcee_femu.table import Table

STAGES = MODULES["auto"].STAGES
LESS = {
    "half scan": {
        "searched_share": SETTINGS.searched_share / 2,
        "most_searched": SETTINGS.most_searched // 2,
    },
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
    *SPRINGS, "lobe at a bound, d=4", "crossed, d=6", "three crossed, d=6",
    "beside, d=3", "ring of four", "corner, d=5", "lognormal, d=4",
    "inferred errors, d=4", "common scale, d=5", "ten modes, d=5",
    "unequal, d=5, width .15", "needle inside, d=4", "narrow pair, d=3",
    "two t, 4 dof, d=3", "t, 3 dof, d=10", "gamma ridge, d=4", "arc, width .08",
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
) -> tuple[Table, Table]:
    """Print and return how many runs have each target, and what they take."""
    for target in only:  # once, for all workers
        springs(target) if target in SPRINGS else truth_of(target)
    cases = [*product(changes, only, range(first, first + seeds))]
    runs = dict(zip(cases, share_out(change, cases, workers), strict=True))

    def runs_of(name: str, target: str) -> list[Run]:
        found = [runs[name, target, seed] for seed in range(first, first + seeds)]
        return [one for one in found if one is not None]

    def has(name: str, target: str) -> int:
        return sum(r.converged and r.right for r in runs_of(name, target))

    def takes(name: str, target: str) -> float:
        return float(np.median([r.solves for r in runs_of(name, target)] or [np.nan]))

    def table(title: str, value: Callable[[str, str], float], how: str) -> Table:
        rows = ((t, *(value(name, t) for name in changes)) for t in only)
        return tabulate(title, {"target": ""} | dict.fromkeys(changes, how), rows)

    had = table(f"Runs of {seeds} that have the target", has, "d")
    return had, table("Solves, medians", takes, ",.0f")


if __name__ == "__main__":
    command(main)
