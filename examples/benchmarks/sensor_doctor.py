"""How often `check_test` finds a wrong sensor, and how often it suspects a right one.

Run it:  python examples/benchmarks/sensor_doctor.py   (1,600 tests, some 6 minutes)
         python examples/benchmarks/sensor_doctor.py --right 10 --wrong 5

Tests of four kinds of structures are simulated: chains of masses, portal frames, square
columns, which bend alike in both directions, and nets of masses at random. Stiffnesses
are up to 20 % off the model, and shapes of one to five modes at two to twenty sensors
have errors of 1 % of their largest value. Then one sensor is turned round, two are
exchanged, or one reads twice, or a thousand times, what it should. A fault counts if
the data can tell it: if it brings the mean MAC with the true structure below .98.
"""

import numpy as np
from commands import command, tabulate

import emcee_femu as ef

SPREAD, NOISE = 0.2, 0.01  # of stiffnesses, and of shapes by their largest value
VISIBLE = 0.98  # mean MAC with the true structure
GAINS = {"gain 2": 2.0, "gain 1000": 1e3}
FAULTS = ("turned", "exchanged", *GAINS)
COLUMNS = {
    "structure": "",
    "fault": "",
    "tests": "d",
    "found %": ".1f",
    "other %": ".1f",
}


def chain(rng):
    """Masses in a row, held at one end or at both."""
    n = int(rng.integers(2, 21))
    ends = [(i, i + 1) for i in range(n)] + [(n, 0)] * int(rng.integers(2))
    springs = {f"k{i}": (*pair, 1.0) for i, pair in enumerate(ends)}
    model = ef.MassSpringModel([1.0] * n, springs, shapes=True)
    return model, np.arange(n)


def portal(rng):
    """Two columns and a beam in a plane, sensors along and across them."""
    height, width = rng.uniform(2, 5), rng.uniform(2, 8)
    corners = [(0, 0), (0, height), (width, height), (width, 0)]
    points = [corners[0]]
    for first, last in zip(corners[:-1], corners[1:], strict=True):
        points += list(np.linspace(first, last, 6)[1:])
    names = [name for name in ("left", "beam", "right") for _ in range(5)]
    shape = {"GJ": 1e6, "rho": 7850, "A": 5e-3, "Iy": 2e-5, "Iz": 2e-5}
    sections = {
        name: ef.Section(E=(2.1e11, name), **shape, orientation=(0, 1, 0))
        for name in ("left", "beam", "right")
    }
    nodes = [(x, 0, z) for x, z in points]
    plane = {i: ("uy", "rx", "rz") for i in range(1, len(nodes) - 1)}
    supports = plane | {0: "all", len(nodes) - 1: "all"}
    bars = [(i, i + 1, name) for i, name in enumerate(names)]
    dofs = [f"{i}:u{axis}" for i in range(1, len(nodes) - 1) for axis in "xz"]
    return ef.FrameModel(
        nodes, bars, sections, supports, n_modes=10, shapes=dofs
    ), np.array(dofs)


def column(rng):
    """A square cantilever, which bends alike in both directions."""
    parts = ("low", "middle", "top")
    sections = {
        part: ef.Section(
            E=2.1e11,
            GJ=1e6,
            rho=7850,
            A=5e-3,
            Iy=(2e-5, f"{part} y"),
            Iz=(2e-5, f"{part} z"),
        )
        for part in parts
    }
    nodes = [(x, 0, 0) for x in np.linspace(0, 6, 10)]
    bars = [(i, i + 1, parts[i // 3]) for i in range(9)]
    dofs = [f"{i}:u{axis}" for i in range(1, 10) for axis in "yz"]
    return ef.FrameModel(
        nodes, bars, sections, {0: "all"}, n_modes=10, shapes=dofs
    ), np.array(dofs)


def net(rng):
    """Masses joined at random, by springs of all sizes, some to the ground."""
    n = int(rng.integers(3, 21))
    pairs = [(i, i + 1) for i in range(n)]  # node 0 is the ground
    pairs += [(int(rng.integers(0, i)), i + 1) for i in range(1, n)]
    springs = {f"k{i}": (*p, rng.lognormal(0, 0.5)) for i, p in enumerate(pairs)}
    model = ef.MassSpringModel(rng.lognormal(0, 0.3, n), springs, shapes=True)
    return model, np.arange(n)


STRUCTURES = {f.__name__: f for f in (chain, portal, column, net)}


def examine(name, fault, seed):
    """Simulate a test and check it; None where the data cannot tell the fault.

    Returns whether the fault is named, or none where there is none, and whether another
    is named instead.
    """
    rng = np.random.default_rng([seed, *f"{name} {fault}".encode()])
    model, dofs = STRUCTURES[name](rng)
    at = {n: rng.uniform(1 - SPREAD, 1 + SPREAD, 1) for n in model.names}
    nominal = {n: 1.0 for n in model.names}
    if isinstance(model, ef.MassSpringModel):  # its parameters are the stiffnesses
        nominal = {n: spring[2] for n, spring in model.springs.items()}
        at = {n: value * nominal[n] for n, value in at.items()}
    true = model(at)
    most = len(dofs)
    chosen = np.sort(rng.choice(most, int(rng.integers(2, min(most, 20) + 1)), False))
    m = int(rng.integers(1, min(5, true.frequencies.shape[1], len(chosen)) + 1))
    shapes = true.shapes[0][chosen, :m]
    shapes = shapes + NOISE * np.abs(shapes).max(0) * rng.normal(size=shapes.shape)
    which = sorted(rng.choice(len(chosen), 2, replace=False).tolist())
    if fault == "exchanged":
        shapes[which] = shapes[which[::-1]]
    elif fault:
        which = which[:1]
        shapes[which] *= GAINS.get(fault, -1.0)
    apart = true.frequencies[0, :m] * (1 + 1e-5 * np.arange(m))
    test = ef.Measurements(apart, shapes, dofs=dofs[chosen])
    count = min(2 * m, true.frequencies.shape[1])
    paired = ef.PairedModel(model, test, candidates=count)
    if fault and paired(at).mac.mean() > VISIBLE:
        return None
    low, high = 1 - SPREAD, 1 + SPREAD
    box = {n: (low * value, high * value) for n, value in nominal.items()}
    term = ef.FrequencyTerm(test, relative_sd=0.01)
    found = ef.check_test(ef.LogPosterior(paired, term, ef.IndependentPrior(box)))
    if not fault:
        return not found.suspects, bool(found.suspects)
    labels = [
        str(d) if isinstance(d, str) else f"s{i + 1}"
        for i, d in enumerate(test.dofs.tolist())
    ]
    wanted = fault.split()[0], tuple(labels[i] for i in which)
    named = wanted in [(s.kind, s.sensors) for s in found.suspects]
    return named, bool(found.suspects) and not named


def main(right: int = 200, wrong: int = 50, first: int = 10_000):
    """Print the table, and return it: right tests, and of each fault, by structure."""
    rows = []
    for fault in (None, *FAULTS):
        for name in STRUCTURES:
            count, results, seed = wrong if fault else right, [], first
            while len(results) < count:
                if (result := examine(name, fault, seed)) is not None:
                    results.append(result)
                seed += 1
            shares = 100 * np.mean(results, axis=0)
            rows.append((name, fault or "none", count, *shares))
    title = "Tests of which the wrong sensor is found (or none, where none is wrong)"
    return tabulate(title, COLUMNS, rows)


if __name__ == "__main__":
    command(main)
