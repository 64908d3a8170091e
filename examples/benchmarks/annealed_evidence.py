"""The evidence that `anneal` gives, and whether the errors it claims are honest.

Exponentials in a corner of the unit box, Student t with 3 degrees of freedom in a wide
box, Gaussians, two modes and a funnel. z is the error in claimed standard errors, over
the seeds that claim one.

The bar: rms z at most 1.3, and errors claimed in at least half of the seeds, except
for the t and the funnel.

Run it:  OMP_NUM_THREADS=1 python examples/benchmarks/annealed_evidence.py --seeds 20
"""

import argparse
import functools
from collections.abc import Callable
from typing import Any

import numpy as np
from evidence import (
    Problem,
    anneal,
    funnel,
    gaussian,
    in_box,
    summarize,
    tabulate,
    two_modes,
)  # fmt: skip
from hard_posteriors import Target, box, posterior_of
from scipy import stats

Floats = np.ndarray


def corner(d: int, scale: float = 0.03) -> Problem:
    """Return independent exponentials in the unit box, highest at a corner."""

    def log_density(x: Floats) -> Floats:
        return -x.sum(axis=1) / scale - d * np.log(scale)

    target = Target(log_density, draw=None, box=box(d, 0, 1))  # type: ignore[arg-type]
    return Problem(posterior_of(target), d * float(np.log1p(-np.exp(-1 / scale))))


def heavy(d: int) -> Problem:
    """Return a t with 3 degrees of freedom; a few millionths are outside its box."""
    law = stats.multivariate_t(np.zeros(d), np.eye(d), df=3)
    return Problem(*in_box(law.logpdf, [100.0] * d, 1.0))


PROBLEMS: dict[tuple[str, int], Callable[[], Problem]] = {
    **{("corner", d): functools.partial(corner, d) for d in (1, 2, 4, 6)},
    **{("t, 3 degrees", d): functools.partial(heavy, d) for d in (2, 5)},
    **{("Gaussian", d): functools.partial(gaussian, d) for d in (2, 5, 10, 20)},
    ("two modes", 2): two_modes,
    ("funnel", 5): funnel,
}


FORMATS = {
    "target": "", "d": "d", "rms z": ".2f", "claimed %": ".0f", "rms error": ".3f",
    "evaluations": ".0f",
}  # fmt: skip


def measure(name: str, d: int, size: int, seeds: range) -> dict[str, Any]:
    """Return what the seeds of a problem say of errors, claims and cost."""
    method = functools.partial(anneal, size=size)
    return {"target": name, "d": d} | summarize(PROBLEMS[name, d], method, seeds)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first", type=int, default=1, help="the first seed")
    parser.add_argument("--size", type=int, default=1_000)
    parser.add_argument("--target", action="append", choices={n for n, _ in PROBLEMS})
    asked = parser.parse_args()
    seeds = range(asked.first, asked.first + asked.seeds)
    chosen = [key for key in PROBLEMS if key[0] in (asked.target or key)]
    rows = (measure(*key, asked.size, seeds) for key in chosen)
    tabulate(f"Annealed evidence, {len(seeds)} seeds each", FORMATS, rows)


if __name__ == "__main__":
    main()
