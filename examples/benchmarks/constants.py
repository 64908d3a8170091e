"""What the constants of "auto" are worth: each is halved and doubled.

Six targets with known answers: the two springs of the README; five springs from five
frequencies; ten maxima; an arc; inferred errors, with long tails; Student's t in ten
dimensions. The settings, and the constants of auto.py, campaign.py and
response_surface.py, are tried on a bent ridge too, four storeys from two frequencies,
where a response surface screens. Slow targets have half of the seeds, and runs end at
120,000 solves at the latest.

A row has, halved and doubled: solves by those of today, the geometric mean over runs;
how many converged; how many are wrong, as ``hard_targets.py`` has it, or fail; and how
many differ at all. Whole numbers stay whole, numbers below one stay below it, degrees
of freedom above two, and of a ratio by which something grows the growth is halved.

Left out are verdict.py, judge.py and modes.py, which say what is called converged; what
"auto" does not read; records, warnings and guards; and shares that must sum to one.

Run it:  OMP_NUM_THREADS=1 python examples/benchmarks/constants.py  (an hour or two)
with --only for some of the names.
"""

import functools
import sys
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import fields, replace
from importlib import import_module
from typing import Any
from unittest.mock import patch

import numpy as np
from benchmark import EFFECTIVE, fe5, weighed
from buildings import draw, measure, shear_building, terms_of
from commands import command, tabulate
from hard_targets import Run, Truth, compare, judge

import emcee_femu as ef
from emcee_femu.table import Table

# Each after what imports it.
OWNERS = """run advance auto explore shoulders tails adapt campaign archive maxima
    record response_surface anneal climbing curvature quadratic proposal
    importance""".split()
FOLDERS = {"run": "sampling", "advance": "sampling"}
MODULES = {
    owner: import_module(f"emcee_femu.{FOLDERS.get(owner, 'search')}.{owner}")
    for owner in OWNERS
}
SETTINGS = MODULES["auto"].SETTINGS
LEFT_OUT = """FOLLOWED_MAC NARROWEST CURVATURE_ROUNDED FEWEST_WEIGHTS LAST_POWERS
    AGREED NO_MAXIMUM BRIEF BRIEF_ALONE COEFFICIENT_RIDGE LONG_RUN GAUSSIAN
    STAGES LOG_POSTERIOR LOG_PRIOR""".split()
FIELDS = {field.name: "Settings" for field in fields(SETTINGS)}
NAMES = FIELDS | {
    name: owner for owner, module in MODULES.items()
    for name, value in vars(module).items() if name.isupper() and name not in LEFT_OUT
    and isinstance(value, int | float | tuple | np.ndarray)
}  # fmt: skip
SLOW = "five springs", "bent ridge", "inferred errors, d=4", "t, 3 dof, d=10"
TARGETS = "two springs", *SLOW, "ten modes, d=5", "arc, width .08"
ON_RIDGE = "Settings", "auto", "campaign", "response_surface"
COLUMNS = {
    "constant": "", "value": "", "half": ".2f", "conv.": "", "wrong": "", "differ": "",
    "twice": ".2f", "conv. ": "", "wrong ": "", "differ ": "",
}  # fmt: skip


@functools.cache
def springs(which: str) -> tuple[ef.LogPosterior, Truth]:
    """Return a posterior of stiffnesses, with its moments by importance sampling."""
    if which == "five springs":
        target = fe5()
    elif which == "two springs":
        frame = {"k1": (0, 1, 50e3), "k2": (1, 2, 10e3)}
        model = ef.MassSpringModel([16.5, 16.1], frame)
        term = ef.FrequencyTerm([3.13, 9.83], relative_sd=0.02)
        bounds = [(20e3, 90e3), (1e3, 15e3)]
        prior = ef.GaussianPrior([*frame], [50e3, 10e3], [9e3, 3e3], bounds)
        target = weighed(ef.LogPosterior(model, term, prior))
    else:
        rng = np.random.default_rng(0)
        model, prior = shear_building(["k1", "k2", "k3", "k4"], 2e5, 2, [])
        terms = terms_of(measure(model, draw(prior, rng), 2, rng))
        target = weighed(ef.LogPosterior(model, terms, prior))
    return target.posterior, Truth(target.mean, target.sd, np.ones(1), EFFECTIVE)


def run(target: str, seed: int) -> Run | None:
    """Return what a run says; None if it fails."""
    options = {"seed": seed, "solves": 120_000}
    try:
        if target in ("two springs", "five springs", "bent ridge"):
            return compare(*springs(target), None, **options)
        return judge(target, **options)
    except Exception as error:
        print(repr(error), file=sys.stderr)
        return None


def scale(name: str, value: Any, factor: float) -> Any:
    """Return a constant times a factor, as far as it makes sense."""
    if isinstance(value, tuple | np.ndarray):
        parts = [scale(name, part, factor) for part in value]
        return tuple(parts) if isinstance(value, tuple) else np.array(parts)
    if isinstance(value, int):
        return max(1, round(value * factor))
    name = name.upper()
    if name in ("LOOK_FURTHER", "WIDER"):
        return 1 + factor * (value - 1)
    if name.endswith(("DF", "DFS")):
        return max(value * factor, 2.1)
    return min(value * factor, 0.95 if value < 1 else np.inf)


def put(stack: ExitStack, name: str, old: object, new: object) -> None:
    """Put a constant in place of another wherever that was imported."""
    loaded = [m for k, m in sys.modules.items() if k.startswith("emcee_femu.")]
    for module in loaded:
        if vars(module).get(name) is old:
            stack.enter_context(patch.object(module, name, new))


def main(seeds: int = 2, only: tuple[str, ...] = tuple(NAMES)) -> Table:
    """Print and return the table."""
    counts = {t: -(-seeds // 2) if t in SLOW else seeds for t in TARGETS}
    cases = [(t, seed) for t in TARGETS for seed in range(1, counts[t] + 1)]
    today = [run(*case) for case in cases]

    def run_all(owner: str) -> list[Run | None]:
        again = [t != "bent ridge" or owner in ON_RIDGE for t, _ in cases]
        known = zip(cases, again, today, strict=True)
        return [run(*case) if anew else old for case, anew, old in known]

    def sum_up(runs: list[Run | None]) -> tuple[object, ...]:
        pairs = [(r, t) for r, t in zip(runs, today, strict=True) if r and t]
        ratio = np.exp(np.mean([np.log(r.solves / t.solves) for r, t in pairs]))
        converged = sum(r.converged for r in runs if r)
        wrong = sum(not r or r.wrong for r in runs)
        differ = sum(repr(r) != repr(t) for r, t in zip(runs, today, strict=True))
        return ratio, converged, wrong, differ

    def rows() -> Iterator[tuple[object, ...]]:
        yield "today", "", *sum_up(today), *sum_up(today)
        order = ["Settings", *OWNERS]
        for name in sorted(only, key=lambda name: order.index(NAMES[name])):
            owner, cells = NAMES[name], list[object]()
            is_field = owner == "Settings"
            value = getattr(SETTINGS if is_field else MODULES[owner], name)
            for factor in (0.5, 2.0):
                new = scale(name, value, factor)
                with ExitStack() as stack:
                    if is_field:
                        settings = replace(SETTINGS, **{name: new})
                        put(stack, "SETTINGS", SETTINGS, settings)
                    else:
                        put(stack, name, value, new)
                    cells.extend(sum_up(run_all(owner)))
            shown = f"{value:g}" if np.isscalar(value) else "several"
            yield f"{owner}.{name}", shown, *cells

    title = f'"auto" with a constant halved and doubled, {len(cases)} runs each'
    return tabulate(title, COLUMNS, rows())


if __name__ == "__main__":
    command(main)
