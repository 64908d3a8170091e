"""How often two tests of one structure raise an alarm, and whether intervals hold.

Run it:  python examples/benchmarks/damage_alarms.py   (400 pairs, some 10 minutes)
         python examples/benchmarks/damage_alarms.py --pairs 20

The structure is the mast of the tutorial on two states, which is run first. It is
tested twice, and both tests are simulated: moduli are drawn from the prior. Then
nothing changes, or the lower part loses some of its stiffness. An alarm is a fall of a
part whose 95 % interval excludes zero. Printed are the share of alarms by part, and how
often intervals of 50, 80 and 95 % contain the truth.
"""

import runpy
from pathlib import Path

import numpy as np
from commands import command, tabulate

import emcee_femu as ef

TUTORIAL = Path(__file__).parents[1] / "tutorials" / "two_states.py"
PARTS = "lower", "middle", "upper"
LEVELS = np.array([0.5, 0.8, 0.95])
COLUMNS = {"pairs": "", "loss %": ""} | dict.fromkeys(
    [*PARTS, *(f"{100 * level:.0f} %" for level in LEVELS)], ".1f"
)


def study(page, prior, seed, loss):
    """Alarms, and intervals that hold, of one pair: (3,) and (3, levels)."""
    rng = np.random.default_rng(seed)
    drawn = np.clip(rng.normal(200, 30, 6), 140, 300)
    truth = dict(zip(prior.names, drawn, strict=True))
    truth |= {f"{part} after": truth[f"{part} before"] for part in PARTS}
    truth["lower after"] *= 1 - loss
    at, tests = {name: np.array([value]) for name, value in truth.items()}, {}
    error = page["ERROR"]
    for state, model in page["models"].items():
        measured = model(at).frequencies[0] * (1 + error * rng.standard_normal(5))
        tests[state] = model, ef.FrequencyTerm(measured, relative_sd=error)
    posterior = ef.LogPosterior.joint(tests, prior, dict.fromkeys(prior.names, "GPa"))
    run = ef.run(posterior, steps=80, ensembles=1, seed=seed, progress=False)
    samples = page["convert"](run)[0]["posterior"]
    found = [samples[f"fall {part}"].values.ravel() for part in PARTS]
    tail = (1 - LEVELS) / 2
    low, high = (np.quantile(found, q, axis=1).T for q in (tail, 1 - tail))
    true = np.array([[100 * loss], [0.0], [0.0]])
    return (low[:, -1] > 0) | (high[:, -1] < 0), (low < true) & (true < high)


def main(pairs: int = 400):
    """Print the table, and return it; a quarter of the pairs has a damage."""
    page = runpy.run_path(str(TUTORIAL))
    prior = ef.IndependentPrior(page["priors"], bounds=page["bounds"])
    rows = []
    for loss, count in (0.0, pairs - pairs // 4), (0.05, pairs // 4):
        found = [study(page, prior, seed, loss) for seed in range(count)]
        alarms = np.mean([alarm for alarm, _ in found], axis=0)
        held = np.mean([inside for _, inside in found], axis=(0, 1))
        rows.append((count, 100 * loss, *(100 * alarms), *(100 * held)))
    title = "Alarms by part and truths inside the intervals, in %"
    return tabulate(title, COLUMNS, rows)


if __name__ == "__main__":
    command(main)
