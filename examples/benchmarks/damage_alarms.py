"""How often two tests of one structure raise an alarm, and whether intervals hold.

Run it:  python examples/benchmarks/damage_alarms.py   (400 pairs, some 10 minutes)
         python examples/benchmarks/damage_alarms.py --pairs 20

A steel mast of three parts is tested twice, five frequencies each, known to 0.2 %. Both
tests are simulated: moduli are drawn from the prior. Then nothing changes, or the lower
part loses some of its stiffness. An alarm is a fall of a part whose 95 % interval
excludes zero. Printed are the share of alarms by part, and how often intervals of 50,
80 and 95 % contain the truth. Both states are solved by reduced matrices.
"""

import argparse

import numpy as np
from scipy import stats

import emcee_femu as ef
from emcee_femu.table import Table

# Area, m2, and second moments of area, m4.
PARTS = {
    "lower": (9e-3, 9e-5, 9e-5),
    "middle": (7e-3, 5e-5, 5e-5),
    "upper": (5e-3, 2.2e-5, 2.2e-5),
}
STATES = "before", "after"
ERROR = 0.002  # of a frequency, one standard deviation
LOW, HIGH = 100.0, 320.0  # GPa
LEVELS = 0.5, 0.8, 0.95


def build_mast(state, n_modes=5, warm=False):
    """A mast of 12 m that bends in a plane, with a modulus by part and state.

    With `warm` a parameter multiplies the density, as if all moduli were lower.
    """
    nodes = [(0, 0, z) for z in np.linspace(0, 12, 25)]  # m
    rho = (7850.0, "warm") if warm else 7850.0
    sections = {
        part: ef.Section((1e9, f"{part} {state}"), 4e6, rho, area, *second, (0, 1, 0))
        for part, (area, *second) in PARTS.items()
    }
    elements = [(i, i + 1, [*PARTS][i // 8]) for i in range(24)]
    held = dict.fromkeys(range(1, 25), ("uy", "uz", "rx", "rz"))
    return ef.FrameModel(nodes, elements, sections, held | {0: "all"}, n_modes=n_modes)


def reduce_states():
    """The mast before and after, reduced."""
    models = {}
    for state in STATES:
        full = build_mast(state)
        models[state] = ef.reduce_model(full, dict.fromkeys(full.names, (LOW, HIGH)))
    return models


def build_prior():
    """200 GPa, by part and state, to 15 %."""
    names = [f"{part} {state}" for state in STATES for part in PARTS]
    return ef.IndependentPrior(
        dict.fromkeys(names, stats.norm(200.0, 30.0)),
        bounds=dict.fromkeys(names, (LOW, HIGH)),
    )


def simulate(models, truth, rng):
    """Frequencies of both states with errors, in Hz."""
    at = {name: np.array([value]) for name, value in truth.items()}
    exact = {state: model(at).frequencies[0] for state, model in models.items()}
    return {
        state: f * (1 + ERROR * rng.standard_normal(len(f)))
        for state, f in exact.items()
    }


def build_posterior(models, tests, prior):
    """Both states in one posterior."""
    pairs = {
        state: (models[state], ef.FrequencyTerm(tests[state], relative_sd=ERROR))
        for state in STATES
    }
    return ef.LogPosterior.joint(pairs, prior, dict.fromkeys(prior.names, "GPa"))


def falls(samples):
    """The fall of each part in %, from samples by name."""
    return {
        part: 100 * (1 - samples[f"{part} after"] / samples[f"{part} before"])
        for part in PARTS
    }


def study(models, prior, seed, loss):
    """Alarms, and intervals that hold, of one pair: (3,) and (3, levels)."""
    rng = np.random.default_rng(seed)
    before = dict(
        zip(prior.names, np.clip(rng.normal(200, 30, 6), 140, 300), strict=True)
    )
    truth = before | {f"{part} after": before[f"{part} before"] for part in PARTS}
    truth["lower after"] *= 1 - loss
    posterior = build_posterior(models, simulate(models, truth, rng), prior)
    run = ef.run(posterior, steps=80, ensembles=1, seed=seed, progress=False)
    samples = ef.to_inference_data(run)["posterior"]
    drawn = np.array([fall.values.ravel() for fall in falls(samples).values()])
    true = np.array([*falls(truth).values()])
    tail = (1 - np.array(LEVELS)) / 2
    low, high = (np.quantile(drawn, q, axis=1).T for q in (tail, 1 - tail))
    return (low[:, -1] > 0) | (high[:, -1] < 0), (low < true[:, None]) & (
        true[:, None] < high
    )


def main(pairs=400):
    """Print the table, and return it; a quarter of the pairs has a damage."""
    models, prior, rows = reduce_states(), build_prior(), []
    for loss, count in (0.0, pairs - pairs // 4), (0.05, pairs // 4):
        found = [study(models, prior, seed, loss) for seed in range(count)]
        alarms = np.mean([alarm for alarm, _ in found], axis=0)
        held = np.mean([inside for _, inside in found], axis=(0, 1))
        rows.append([count, 100 * loss, *(100 * alarms), *(100 * held)])
    columns = ["pairs", "loss %", *PARTS, *(f"{100 * level:.0f} %" for level in LEVELS)]
    formats = ["", "", *[".1f"] * 6]
    values = [list(column) for column in zip(*rows, strict=True)]
    table = Table.from_columns(
        "Alarms by part and truths inside the intervals, in %",
        [*zip(columns, formats, values, strict=True)],
    )
    print(table)
    return table


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--pairs", type=int, default=400)
    main(parser.parse_args().pairs)
