"""Your own model: a function of parameters, or matrices of any FE program.

A cantilever of length L and mass mu per length has the bending frequencies

    f_j = (b_j / L)^2 sqrt(EI / mu) / (2 pi),    b = 1.8751, 4.6941, 7.8548.

At its tip sits an unknown point mass m. Three measured frequencies shall tell EI and
m. The same structure is given twice: as a Python function that solves one parameter
set at a time (any solver can stand there), and as matrices K = EI K_1 and
M = M_0 + m M_1, which are solved for all walkers at once. Both give the same chain.

Run it:  python examples/own_model.py
"""

import argparse
import time
from collections.abc import Mapping

import numpy as np
from scipy import stats
from scipy.linalg import eigh

import emcee_femu as ef
from emcee_femu.models.frame.beam_element import mass_matrices, stiffness_matrices

LENGTH, ELEMENTS, MU = 1.2, 8, 0.81  # m, -, kg/m
MEASURED = [9.62, 66.1, 192.5]  # Hz


def bending_matrices() -> tuple[np.ndarray, np.ndarray]:
    """Return K for EI = 1 N m2 and M of the bare cantilever, both ``(16, 16)``."""
    bending = [1, 5, 7, 11]  # displacement and rotation at both ends of an element
    h = LENGTH / ELEMENTS
    stiffness = stiffness_matrices(h)["EIz"][np.ix_(bending, bending)]
    mass = MU * mass_matrices(h)["rhoA"][np.ix_(bending, bending)]
    K, M = np.zeros((2, 2 * ELEMENTS + 2, 2 * ELEMENTS + 2))
    for e in range(ELEMENTS):
        K[2 * e : 2 * e + 4, 2 * e : 2 * e + 4] += stiffness
        M[2 * e : 2 * e + 4, 2 * e : 2 * e + 4] += mass
    return K[2:, 2:], M[2:, 2:]  # clamped at the first node


K1, M0 = bending_matrices()
M1 = np.zeros_like(M0)
M1[-2, -2] = 1.0  # the tip's displacement carries the point mass


def solver(parameters: Mapping[str, float]) -> np.ndarray:
    """Return three frequencies in Hz: put the call of your own program here."""
    K, M = parameters["EI"] * K1, M0 + parameters["m"] * M1
    omega_squared = eigh(K, M, eigvals_only=True, subset_by_index=(0, 2))
    return np.sqrt(omega_squared) / (2 * np.pi)


def main(generations: int = 2_000, seed: int = 7) -> dict[str, np.ndarray]:
    """Sample both posteriors; return their means and standard deviations."""
    prior = ef.IndependentPrior(
        {"EI": stats.lognorm(0.3, scale=700.0), "m": stats.uniform(0.0, 0.5)}
    )
    term = ef.FrequencyTerm(MEASURED, relative_sd=0.01)
    zero = np.zeros_like(K1)
    models = {
        "function": ef.FunctionModel(solver),
        "matrices": ef.MatrixModel(zero, M0, {"EI": K1}, {"m": M1}, n_modes=3),
    }
    result = {}
    for name, model in models.items():
        posterior = ef.LogPosterior(model, term, prior)
        begin = time.perf_counter()
        samplers = ef.run(posterior, nwalkers=16, nsteps=generations, seed=seed)
        seconds = time.perf_counter() - begin
        idata = ef.to_inference_data(samplers, posterior, discard=generations // 5)
        print(f"\n{name}: {seconds:.1f} s")
        print(ef.parameter_table(idata))
        print(ef.frequency_table(idata, posterior))
        draws = samplers[0].get_chain(discard=generations // 5, flat=True)
        result[name] = np.array([draws.mean(axis=0), draws.std(axis=0)])
    return result


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--generations", type=int, default=2_000)
    parser.add_argument("--seed", type=int, default=7)
    main(**vars(parser.parse_args()))
