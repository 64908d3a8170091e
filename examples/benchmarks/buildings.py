"""Simulated tests of structures, for the benchmarks: shear buildings, and their data.

Print the frequencies of one:  python examples/benchmarks/buildings.py
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

import emcee_femu as ef

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
    model = ef.MatrixModel(
        np.zeros((n, n)), mass * np.eye(n), dict(zip(names, units, strict=True)),
        n_modes=n_modes, shapes=list(floors) or False,
    )  # fmt: skip
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
    delta: float = DELTA,
) -> ef.Measurements:
    """Return a simulated test of the lowest modes, and shapes if the model has them."""
    solved = model(truth)
    noise = 1 + RELATIVE_SD * rng.standard_normal(n_modes)
    frequencies = solved.frequencies[0, :n_modes] * noise
    if solved.shapes is None:
        return ef.Measurements(frequencies)
    shapes = solved.shapes[0, :, :n_modes]
    shapes = shapes / np.linalg.norm(shapes, axis=0)
    shapes += delta * rng.standard_normal(shapes.shape)
    dofs = model.variables["shapes"].coords["dof"]
    return ef.Measurements(frequencies, shapes=shapes, dofs=dofs)


def terms_of(measured: ef.Measurements) -> list[Any]:
    """Return the likelihoods of a test with these errors."""
    terms: list[Any] = [ef.FrequencyTerm(measured, relative_sd=RELATIVE_SD)]
    if measured.shapes is not None:
        terms.append(ef.ShapeTerm(measured, delta=DELTA))
    return terms


def main(storeys: int = 10) -> ef.Measurements:
    """Print and return a test of a building."""
    names, rng = [f"k{i}" for i in range(1, storeys + 1)], np.random.default_rng(1)
    model, prior = shear_building(names, 2e5, storeys // 2, range(1, storeys, 2))
    measured = measure(model, draw(prior, rng), storeys // 2, rng)
    print(measured)
    return measured


if __name__ == "__main__":
    main()
