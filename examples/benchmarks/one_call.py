"""How many solves ``run_emulated`` needs, and how often its certificates are right.

The problems are those of ``few_solves.py``, and the paper's mass-spring problem as a
black box of which 5 % of the solves fail by chance. A certificate is right if every
mean is within 0.1 standard deviations and every standard deviation within 10 % of the
true posterior's, by long chains of the full model and weights. It is *wrong* if it is
certified and a mean is off by 0.15 standard deviations, or a standard deviation by 12 %
and by two of its claimed errors. An emulation is right, whatever its verdict, if the
chain of its posterior is within 0.1 and 10 %.

Run it:  OMP_NUM_THREADS=1 python examples/benchmarks/one_call.py
for the solves that it takes, each problem with a budget of its own, and with
--budgets 70 90 120 160 220 --seeds 4 --first 3001 --learned "values only"
for 100 certificates of budgets from far too few to plenty.
"""

import functools
import warnings
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from commands import command, share_out, tabulate, weigh
from few_solves import KINDS, PROBLEMS, true_draws

import emcee_femu as ef

Floats = np.ndarray
RIGHT_MEAN, RIGHT_SD = 0.1, 0.1
WRONG_MEAN, WRONG_SD, WRONG_ERRORS = 0.15, 0.12, 2.0
TRUE_SIZE = 20_000  # effective draws: they know an sd with a kurtosis of 16 to 1.4 %
FAILING, GRAIN = 0.05, 1e6  # share of solves that fail; grains of a parameter
BLACK_BOX = "black_box"
OWN = 0  # stands for a budget of BUDGETS: for values only, and with derivatives
LARGE = 140, 80
BUDGETS = {"h_structure": LARGE, "shear": LARGE, BLACK_BOX: (160, 160)}
USUAL = 140, 140
NAMES = "mass_spring", "h_structure", "shear", "beck_au", BLACK_BOX
TAKES = {
    "problem": "", "learned": "", "budget": "d", "seeds": "d", "met": "d",
    "median": ".0f", "most": ".0f", "mean": ".3f", "sd": ".3f",
}  # fmt: skip
LAW = {
    "budget": "d", "calls": "d", "certified": "d", "wrong": "d", "corrected": "d",
    "refused": "d", "right": "d", "right refused": "d",
}  # fmt: skip


class Failing:
    """A model without derivatives, some of whose solves fail, chosen by chance."""

    def __init__(self, model: Any) -> None:
        self.model, self.variables, self.names = model, model.variables, model.names
        self.bounds = getattr(model, "bounds", {})

    def __call__(self, parameters: Any) -> Any:
        """Solve one set of parameters, or fail."""
        values = np.concatenate([np.atleast_1d(v) for v in parameters.values()])
        if (values * GRAIN % 1).sum() % 1 < FAILING:
            raise ArithmeticError("no convergence")
        return self.model(parameters)


class Found(NamedTuple):
    """What one call gave.

    Attributes:
        verdict: Of the certificate.
        solves: That it spent.
        mean: The worst error of a mean, in true standard deviations.
        sd: The worst relative error of a standard deviation.
        claimed: By how many claimed errors this one is off.
        emulated: Whether the chain of the emulated posterior is right.
    """

    verdict: str
    solves: int
    mean: float
    sd: float
    claimed: float
    emulated: bool

    @property
    def certified(self) -> bool:
        """Whether it was certified."""
        return self.verdict == "certified"

    @property
    def right(self) -> bool:
        """Whether it is near the truth."""
        return self.mean <= RIGHT_MEAN and self.sd <= RIGHT_SD

    @property
    def wrong(self) -> bool:
        """Whether it is certified, and should not be."""
        far = self.sd > WRONG_SD and self.claimed > WRONG_ERRORS
        return self.certified and (self.mean > WRONG_MEAN or far)


def pose(name: str, learned: str) -> ef.LogPosterior:
    """Return the posterior of a problem."""
    if name == BLACK_BOX:
        return PROBLEMS["mass_spring"](Failing).posterior
    return PROBLEMS[name](KINDS[learned]).posterior


@functools.cache
def truth_of(name: str) -> tuple[Floats, Floats]:
    """Return means and standard deviations of a true posterior."""
    known = "mass_spring" if name == BLACK_BOX else name
    problem = PROBLEMS[known](KINDS["with derivatives"])
    parts = weigh([problem.posterior], true_draws(known), TRUE_SIZE, 0, problem.first)
    return parts[0][0], parts[1][0]


def judge(call: tuple[str, str, int, int]) -> Found:
    """Make one call, compare, and print a line."""
    name, learned, budget, seed = call
    on_failure = "reject" if name == BLACK_BOX else "raise"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        posterior = pose(name, learned)
        found = ef.run_emulated(posterior, budget, seed=seed, on_failure=on_failure)
    mean, sd = truth_of(name)
    off, error = np.abs(found.sd / sd - 1), found.sd_error / sd
    worst = int(np.argmax(off))
    close = np.abs(found.emulated_mean - mean) <= RIGHT_MEAN * sd
    close &= np.abs(found.emulated_sd / sd - 1) <= RIGHT_SD
    one = Found(
        found.short,
        found.solves,
        float(np.abs((found.mean - mean) / sd).max()),
        float(off[worst]),
        float(off[worst] / error[worst]),
        bool(close.all()),
    )
    shown = (f"{v:.3g}" if isinstance(v, float) else v for v in one)
    print(name, learned, budget, seed, *shown, sep="  ", flush=True)
    return one


def say_takes(key: tuple[str, str, int], found: list[Found]) -> tuple[object, ...]:
    """Return the row of a problem and a budget."""
    certified = [f for f in found if f.certified]
    good = [f for f in certified if f.right]
    takes = [f.solves if f in good else np.inf for f in found]
    mean, sd = (max((f[k] for f in certified), default=np.nan) for k in (2, 3))
    most = max(f.solves for f in found)
    counts = len(found), len(good), float(np.median(takes)), float(most)
    return (*key, *counts, mean, sd)


def say_law(budget: int, found: list[Found]) -> tuple[object, ...]:
    """Return the row of a budget."""
    count = [f.verdict for f in found].count
    right = [f for f in found if f.emulated]
    return (
        budget, len(found), count("certified"), sum(f.wrong for f in found),
        count("corrected"), count("refused"), len(right),
        sum(f.verdict == "refused" for f in right),
    )  # fmt: skip


def main(
    seeds: int = 10,
    first: int = 2001,
    problem: tuple[str, ...] = NAMES,
    learned: tuple[str, ...] = tuple(KINDS),
    budgets: tuple[int, ...] = (OWN,),
    workers: int = 2,
) -> None:
    """Print a line a call as it ends, then the tables."""
    for name in problem:
        truth_of(name)  # once, for all workers
    calls = [
        (name, kind, budget or BUDGETS.get(name, USUAL)[[*KINDS].index(kind)], seed)
        for name, kind, budget in product(problem, learned, budgets)
        for seed in range(first, first + seeds)
        if name != BLACK_BOX or kind == learned[0]  # it has no derivatives
    ]
    results: dict[tuple[str, str, int], list[Found]] = {}
    by_budget: dict[int, list[Found]] = {}
    for call, one in zip(calls, share_out(judge, calls, workers), strict=True):
        results.setdefault(call[:3], []).append(one)
        by_budget.setdefault(call[2], []).append(one)
    tabulate("Solves that are certified and right", TAKES,
             (say_takes(*pair) for pair in results.items()))  # fmt: skip
    tabulate("What the certificates are worth", LAW,
             (say_law(*pair) for pair in sorted(by_budget.items())))  # fmt: skip


if __name__ == "__main__":
    command(main)
