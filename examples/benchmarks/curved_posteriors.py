"""Curved posteriors of realistic size, and how "auto" does on them.

building    ten storey stiffnesses from eight frequencies to 0.5 %, without shapes
tower       eighteen storey stiffnesses, four modes with shapes at seven floors
footbridge  a 3-D frame of 268 DOFs: the moduli of fourteen groups of members, a density
            and two errors, from five modes at 58 sensors, paired by shape
springs     the paper's five springs from the prior, with few evaluations

Data are simulated with parameters drawn from the prior, anew with each seed. The
effective sample size is the bulk ESS of the worst parameter, over all solves,
including those of the search and of gradients.

Run it:  OMP_NUM_THREADS=1 python examples/benchmarks/curved_posteriors.py
"""

import argparse
import time

import numpy as np
from buildings import SPREAD, STIFFNESS, draw, measure, shear_building, terms_of
from scipy import stats

import emcee_femu as ef
from emcee_femu.table import Table

SENSORS = [2, 4, 7, 9, 12, 14, 17]  # floors of the tower
Problem = tuple[ef.LogPosterior, dict[str, float]]  # and the true parameters


def storeys(seed: int, number: int, floors: list[int], modes: int) -> Problem:
    """Return a building, with shapes at some floors or without."""
    names, rng = [f"k{i}" for i in range(1, number + 1)], np.random.default_rng(seed)
    model, prior = shear_building(names, 2e5, modes, floors)
    if floors:
        laws = dict.fromkeys(names, stats.lognorm(SPREAD, scale=STIFFNESS))
        prior = ef.IndependentPrior(laws)
    truth = draw(prior, rng)
    terms = terms_of(measure(model, truth, modes, rng))
    posterior = ef.LogPosterior(model, terms, prior)
    return posterior, {name: value.item() for name, value in truth.items()}


def footbridge(seed: int, bays: int = 22) -> Problem:
    """Return two girders with cross beams and bracing, 44 m long and 3 m wide."""
    along = np.linspace(0.0, 44.0, bays + 1)
    nodes = [(x, y, 0.0) for y in (0.0, 3.0) for x in along]
    right = bays + 1
    elements = []
    for i in range(bays):
        zone = 5 * i // bays + 1
        elements += [(i, i + 1, f"girder L{zone}")]
        elements += [(right + i, right + i + 1, f"girder R{zone}")]
    for i in range(bays + 1):
        where = "middle" if bays // 4 <= i < 3 * bays // 4 else "ends"
        elements.append((i, right + i, f"beams {where}"))
        if i < bays:
            elements.append((i, right + i + 1, f"braces {where}"))
    sections = {
        name: ef.Section(name, 4e6, "density", 0.03, 2.2e-3, 2.2e-2)
        if name.startswith("girder")
        else ef.Section(name, 2e5, 7850.0, 0.006, 1e-5, 3e-5)
        for name in sorted({name for *_, name in elements})
    }
    corners = {0: ["ux", "uy", "uz"], right: ["ux", "uz"]}
    corners |= {bays: ["uy", "uz"], right + bays: ["uz"]}
    inner = [node for node in range(2 * right) if node not in corners]
    sensors = [f"{node}:uz" for node in inner]
    sensors += [f"{node}:uy" for node in inner][: 58 - len(sensors)]
    model = ef.FrameModel(nodes, elements, sections, corners, n_modes=7, shapes=sensors)
    laws = {name: stats.lognorm(0.15, scale=2.1e11) for name in sections}
    laws["density"] = stats.lognorm(0.1, scale=9_000.0)
    rng = np.random.default_rng(seed)
    truth = {name: law.rvs(1, random_state=rng) for name, law in laws.items()}
    measured = measure(model, truth, 5, rng, delta=0.008)
    paired = ef.PairedModel(model, measured, candidates=7)
    laws["frequency error"] = stats.halfnorm(scale=0.02)
    laws["shape error"] = stats.halfnorm(scale=0.1)
    terms = [
        ef.FrequencyTerm(measured, relative_sd=0.002, discrepancy="frequency error"),
        ef.ShapeTerm(measured, discrepancy="shape error"),
    ]
    posterior = ef.LogPosterior(paired, terms, ef.IndependentPrior(laws))
    return posterior, {name: value.item() for name, value in truth.items()}


def springs(seed: int) -> Problem:
    """Return the paper's mass-spring example, whose data are always the same."""
    problem = ef.paper.mass_spring()
    return problem.posterior, problem.target


PROBLEMS = {  # and steps, walkers of each ensemble, ensembles
    "building": (lambda seed: storeys(seed, 10, [], 8), 1_000, 40, 4),
    "tower": (lambda seed: storeys(seed, 18, SENSORS, 4), 450, 40, 4),
    "footbridge": (footbridge, 400, 36, 2),
    "springs": (springs, 10, 50, 4),
}


def run(name: str, seed: int, steps: int | None = None) -> tuple[object, ...]:
    """Return a row of the table."""
    problem, usual, nwalkers, number = PROBLEMS[name]
    posterior, truth = problem(seed)
    begun = time.process_time()
    found = ef.run(
        posterior, "auto", nwalkers, steps or usual, ensembles=number, seed=seed
    )
    seconds = time.process_time() - begun
    diagnosis = ef.diagnose(found)
    samples = np.concatenate([sampler.get_chain(flat=True) for sampler in found])
    low, high = np.quantile(samples, [0.025, 0.975], axis=0)
    true = np.array([truth.get(name, np.nan) for name in posterior.names])
    inside = f"{np.sum((low < true) & (true < high))}/{len(truth)}"
    ess = diagnosis.ess_bulk.min()
    efficiency, said = 1e3 * ess / found.solves, diagnosis.chains.short
    return seed, found.solves, ess, efficiency, said, inside, seconds


def main() -> None:
    """Print a table for each problem."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--problem", choices=PROBLEMS, nargs="*", default=[*PROBLEMS])
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--steps", type=int)
    asked = parser.parse_args()
    heads = "seed", "solves", "ESS", "ESS/1000", "chains", "truths inside", "s"
    formats = "", ",d", ",.0f", ".1f", "", "", ".0f"
    for name in asked.problem:
        rows = tuple(run(name, seed, asked.steps) for seed in range(asked.seeds))
        print(Table(name, heads, formats, rows), flush=True)


if __name__ == "__main__":
    main()
