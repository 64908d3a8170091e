"""Simulated tests of shear buildings, for the benchmarks, and how "auto" does on them.

Ten storey stiffnesses from eight frequencies to 0.5 %, without shapes, are a curved
posterior. The true ones are drawn from the prior, anew with each seed. The effective
sample size is the bulk ESS of the worst parameter, over all solves, including those of
the search.

Run it:  OMP_NUM_THREADS=1 python examples/benchmarks/buildings.py
"""

import functools
import time
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from commands import command, draws_of, tabulate

import emcee_femu as ef
from emcee_femu.table import Table

Floats = np.ndarray
RELATIVE_SD, DELTA = 0.005, 0.02  # of frequencies, of shapes of unit length
STIFFNESS, SPREAD, BOUNDS = 2e8, 0.2, [0.1, 3.0]  # N/m of a storey; of its prior


def shear_building(
    names: Sequence[str],
    mass: float,
    n_modes: int,
    floors: Sequence[int],
    nominal: float = STIFFNESS,
) -> tuple[ef.MatrixModel, ef.GaussianPrior]:
    """Return a model and a prior of storeys, with shapes at some floors or without."""
    n = len(names)
    drift = np.eye(n) - np.eye(n, k=-1)
    units = [STIFFNESS / nominal * np.outer(b, b) for b in drift]
    K = dict(zip(names, units, strict=True))
    options = {"n_modes": n_modes, "shapes": list(floors) or False}
    model = ef.MatrixModel(np.zeros((n, n)), mass * np.eye(n), K, **options)
    mean = np.full(n, nominal)
    return model, ef.GaussianPrior(names, mean, SPREAD * mean, np.outer(mean, BOUNDS))


def draw(prior: ef.GaussianPrior, rng: np.random.Generator) -> dict[str, Floats]:
    """Return true parameters, each ``(1,)``."""
    return dict(zip(prior.names, prior.sample(rng, 1).T, strict=True))


def measure(
    model: ef.MatrixModel,
    truth: Mapping[str, Floats],
    n_modes: int,
    rng: np.random.Generator,
) -> ef.Measurements:
    """Return a simulated test of the lowest modes, and shapes if the model has them."""
    solved = model(truth)
    noise = 1 + RELATIVE_SD * rng.standard_normal(n_modes)
    frequencies = solved.frequencies[0, :n_modes] * noise
    if solved.shapes is None:
        return ef.Measurements(frequencies)
    shapes = solved.shapes[0, :, :n_modes]
    shapes = shapes / np.linalg.norm(shapes, axis=0)
    shapes += DELTA * rng.standard_normal(shapes.shape)
    dofs = model.variables["shapes"].coords["dof"]
    return ef.Measurements(frequencies, shapes=shapes, dofs=dofs)


def terms_of(measured: ef.Measurements) -> list[Any]:
    """Return the likelihoods of a test with these errors."""
    terms: list[Any] = [ef.FrequencyTerm(measured, relative_sd=RELATIVE_SD)]
    if measured.shapes is not None:
        terms.append(ef.ShapeTerm(measured, delta=DELTA))
    return terms


def run(steps: int, seed: int) -> tuple[object, ...]:
    """Return a row of the table."""
    names, rng = [f"k{i}" for i in range(1, 11)], np.random.default_rng(seed)
    model, prior = shear_building(names, 2e5, 8, [])
    truth = draw(prior, rng)
    terms = terms_of(measure(model, truth, 8, rng))
    posterior = ef.LogPosterior(model, terms, prior)
    begun = time.process_time()
    found = ef.run(posterior, "auto", nwalkers=40, steps=steps, seed=seed)
    seconds = time.process_time() - begun
    diagnosis = ef.diagnose(found)
    low, high = np.quantile(draws_of(found), [0.025, 0.975], axis=0)
    true = np.concatenate([truth[name] for name in posterior.names])
    inside = f"{np.sum((low < true) & (true < high))}/{len(truth)}"
    ess = diagnosis.ess_bulk.min()
    efficiency, said = 1e3 * ess / found.solves, diagnosis.chains.short
    return seed, found.solves, ess, efficiency, said, inside, seconds


COLUMNS = {"seed": "", "solves": ",d", "ESS": ",.0f", "ESS/1000": ".1f"}
COLUMNS |= {"chains": "", "truths inside": "", "s": ".0f"}


def main(seeds: int = 10, steps: int = 250) -> Table:
    """Print and return the table."""
    rows = map(functools.partial(run, steps), range(seeds))
    return tabulate("A building without shapes", COLUMNS, rows)


if __name__ == "__main__":
    command(main)
