"""How often two tests of one structure raise an alarm, and whether intervals hold.

Run it:  python examples/benchmarks/damage_alarms.py   (400 pairs, some 10 minutes)
         python examples/benchmarks/damage_alarms.py --pairs 20

A steel mast of three parts is tested twice, five frequencies each, known to 0.2 %. Both
tests are simulated: moduli are drawn from the prior. Then nothing changes, or the lower
part loses some of its stiffness. An alarm is a fall of a part whose 95 % interval
excludes zero. Printed are the share of alarms by part, and how often intervals of 50,
80 and 95 % contain the truth. Both states are solved by reduced matrices.
"""

import numpy as np
from commands import command, tabulate
from scipy import stats

import emcee_femu as ef

# Area, m2, and second moment of area, m4.
PARTS = {"lower": (9e-3, 9e-5), "middle": (7e-3, 5e-5), "upper": (5e-3, 2.2e-5)}
STATES = "before", "after"
ERROR = 0.002  # of a frequency, one standard deviation
LIMITS = 100.0, 320.0  # GPa
LEVELS = np.array([0.5, 0.8, 0.95])
COLUMNS = {"pairs": "", "loss %": ""} | dict.fromkeys(
    [*PARTS, *(f"{100 * level:.0f} %" for level in LEVELS)], ".1f"
)


def build_mast(state):
    """A mast of 12 m that bends in a plane, with a modulus by part and state."""
    nodes = [(0, 0, z) for z in np.linspace(0, 12, 25)]  # m
    sections = {
        part: ef.Section((1e9, f"{part} {state}"), 4e6, 7850.0, area, I2, I2, (0, 1, 0))
        for part, (area, I2) in PARTS.items()
    }
    elements = [(i, i + 1, [*PARTS][i // 8]) for i in range(24)]
    held = dict.fromkeys(range(1, 25), ("uy", "uz", "rx", "rz"))
    full = ef.FrameModel(nodes, elements, sections, held | {0: "all"}, n_modes=5)
    return ef.reduce_model(full, dict.fromkeys(full.names, LIMITS))


def falls(samples):
    """The fall of each part in %, from samples by name: ``(3, n)``."""
    kept = [samples[f"{part} after"] / samples[f"{part} before"] for part in PARTS]
    return 100 * (1 - np.array(kept))


def study(models, prior, seed, loss):
    """Alarms, and intervals that hold, of one pair: (3,) and (3, levels)."""
    rng = np.random.default_rng(seed)
    drawn = np.clip(rng.normal(200, 30, 6), 140, 300)
    truth = dict(zip(prior.names, drawn, strict=True))
    truth |= {f"{part} after": truth[f"{part} before"] for part in PARTS}
    truth["lower after"] *= 1 - loss
    at, tests = {name: np.array([value]) for name, value in truth.items()}, {}
    for state, model in models.items():
        measured = model(at).frequencies[0] * (1 + ERROR * rng.standard_normal(5))
        tests[state] = model, ef.FrequencyTerm(measured, relative_sd=ERROR)
    posterior = ef.LogPosterior.joint(tests, prior, dict.fromkeys(prior.names, "GPa"))
    run = ef.run(posterior, steps=80, ensembles=1, seed=seed, progress=False)
    samples = ef.to_inference_data(run)["posterior"]
    found = falls({name: samples[name].values.ravel() for name in truth})
    tail = (1 - LEVELS) / 2
    low, high = (np.quantile(found, q, axis=1).T for q in (tail, 1 - tail))
    true = falls(truth)[:, None]
    return (low[:, -1] > 0) | (high[:, -1] < 0), (low < true) & (true < high)


def main(pairs: int = 400):
    """Print the table, and return it; a quarter of the pairs has a damage."""
    models = {state: build_mast(state) for state in STATES}
    names = [f"{part} {state}" for state in STATES for part in PARTS]
    prior = ef.IndependentPrior(
        dict.fromkeys(names, stats.norm(200.0, 30.0)),
        bounds=dict.fromkeys(names, LIMITS),
    )
    rows = []
    for loss, count in (0.0, pairs - pairs // 4), (0.05, pairs // 4):
        found = [study(models, prior, seed, loss) for seed in range(count)]
        alarms = np.mean([alarm for alarm, _ in found], axis=0)
        held = np.mean([inside for _, inside in found], axis=(0, 1))
        rows.append((count, 100 * loss, *(100 * alarms), *(100 * held)))
    title = "Alarms by part and truths inside the intervals, in %"
    return tabulate(title, COLUMNS, rows)


if __name__ == "__main__":
    command(main)
