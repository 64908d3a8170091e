"""A large finite element model, updated in seconds: sparse matrices, then a Ritz basis.

The model is a concrete frame building of 3 x 3 bays, of beam elements in space with
six degrees of freedom per node. Six factors multiply the stiffness of the columns and
of the beams in its lower, middle and upper storeys; they are unknown by +-30 %. Any FE
program can stand in for `building`: what is needed are K_i and M as scipy.sparse
matrices.

Sampling needs tens of thousands of solves. Three ways to do one are timed in turn on
the same factors, in process time (run it on one thread):

    eigsh     scipy.sparse.linalg.eigsh(K, 10, M, sigma=0), as in most scripts
    sparse    MatrixModel: symmetric ordering, no pivoting, one pattern for all factors
    reduced   reduce_model(model, bounds): a Ritz basis of full solves, whose error is
              known from full solves elsewhere; 16 walkers at once

Then eight measured frequencies, simulated with errors of 0.5 %, update the factors. A
model error of at most a tenth of the measurement's leaves the posterior unchanged, so
only the reduced model is sampled.

Run it:  OMP_NUM_THREADS=1 python examples/benchmarks/large_model.py
For 28,224 degrees of freedom instead of 4,704 add --segments 9.
"""

import argparse
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.sparse import coo_array, csc_array
from scipy.sparse.linalg import eigsh

import emcee_femu as ef
from emcee_femu.models.frame.beam_element import (
    local_axes,
    mass_matrices,
    stiffness_matrices,
)

BAYS, WIDTH_X, WIDTH_Y, HEIGHT = 3, 6.0, 5.0, 3.2  # -, m, m, m
E, G, RHO = 32e9, 13.3e9, 2500.0  # concrete: Pa, Pa, kg/m3
COLUMN = (0.50, 0.60, 0.0)  # m, m, kg/m of finishes and live load
BEAM = (0.30, 0.55, 2000.0)
LOW, HIGH = 0.7, 1.3
N_MODES, MEASURED, RELATIVE_SD = 10, 8, 0.005
WALKERS = 16


def members(storeys: int) -> list[tuple[str, np.ndarray, np.ndarray]]:
    """Return (group, start, end) of every column and beam; z = 0 is the ground."""
    result = []
    step = np.array([WIDTH_X, WIDTH_Y, HEIGHT])
    for i, j, s in np.ndindex(BAYS + 1, BAYS + 1, storeys):
        zone = ("lower", "middle", "upper")[3 * s // storeys]
        foot, top = np.array([i, j, s]), np.array([i, j, s + 1])
        result.append((f"columns_{zone}", foot * step, top * step))
        for along in ([1, 0, 0], [0, 1, 0]):
            end = top + along
            if max(end[:2]) <= BAYS:
                result.append((f"beams_{zone}", top * step, end * step))
    return result


def element(along: np.ndarray, section: tuple[float, float, float]) -> Any:
    """Return stiffness and mass ``(12, 12)`` in global axes."""
    b, h, load = section
    upright = np.array([0.0, 1.0, 0.0]) if along[1] == 0 else np.array([1.0, 0.0, 0.0])
    length, axes = local_axes(np.zeros(3), along, upright)
    T = np.kron(np.eye(4), axes)
    A, Iy, Iz = b * h, b * h**3 / 12, h * b**3 / 12
    J = h * b**3 * (1 / 3 - 0.21 * b / h)
    properties = {"EA": E * A, "GJ": G * J, "EIz": E * Iz, "EIy": E * Iy}
    line = {"rhoA": RHO * A + load, "rhoI": RHO * (Iy + Iz)}
    k = sum(properties[kind] * m for kind, m in stiffness_matrices(length).items())
    m = sum(line[kind] * m for kind, m in mass_matrices(length).items())
    return T.T @ k @ T, T.T @ m @ T


def building(storeys: int, segments: int) -> tuple[dict[str, csc_array], csc_array]:
    """Return the stiffness of each group and the mass, fixed at the ground."""
    nodes: dict[tuple[float, ...], int] = {}
    triplets: dict[str, list[np.ndarray]] = {"mass": []}
    for group, start, end in members(storeys):
        along = (end - start) / segments
        points = [start + along * i for i in range(segments + 1)]
        numbers = [
            nodes.setdefault(tuple(p.round(6).tolist()), len(nodes)) for p in points
        ]
        k, m = element(along, COLUMN if group.startswith("columns") else BEAM)
        for a, b in zip(numbers, numbers[1:], strict=False):
            dofs = np.r_[6 * a : 6 * a + 6, 6 * b : 6 * b + 6]
            where = np.repeat(dofs, 12), np.tile(dofs, 12)
            for name, matrix in ((group, k), ("mass", m)):
                triplets.setdefault(name, []).append(np.array([*where, matrix.ravel()]))
    size = 6 * len(nodes)
    free = np.flatnonzero(np.repeat([point[2] > 0 for point in nodes], 6))
    matrices = {}
    for name, parts in triplets.items():
        rows, columns, data = np.hstack(parts)
        whole = coo_array((data, (rows.astype(int), columns.astype(int))), (size, size))
        matrices[name] = whole.tocsc()[free][:, free]  # duplicates are added up
        matrices[name].eliminate_zeros()
    mass = matrices.pop("mass")
    return matrices, mass


def milliseconds(call: Callable[[Any], Any], argument: Any) -> float:
    """Return the process time of one call."""
    begin = time.process_time()
    call(argument)
    return 1e3 * (time.process_time() - begin)


def compare_solves(
    K: dict[str, csc_array], M: csc_array, full: Any, reduced: Any, rounds: int
) -> tuple[float, ...]:
    """Time the three ways in turn; return ms per solve by eigsh and its speed-ups."""

    def default(factors: np.ndarray) -> Any:
        stiffness = sum(f * k for f, k in zip(factors, K.values(), strict=True))
        return eigsh(stiffness, N_MODES, M, sigma=0)

    def batch(factors: np.ndarray) -> dict[str, np.ndarray]:
        return dict(zip(K, factors.T, strict=True))

    times = []
    rng = np.random.default_rng(1)
    for factors in rng.uniform(LOW, HIGH, (rounds, WALKERS, len(K))):
        many = [milliseconds(reduced, batch(factors)) for _ in range(5)]
        one = milliseconds(default, factors[0])
        times.append(
            (one, milliseconds(full, batch(factors[:1])), np.median(many) / WALKERS)
        )
    a, b, c = np.median(times, axis=0)
    ratios = np.median([(x / y, x / z, y / z) for x, y, z in times], axis=0)
    print(f"\none solve, median of {rounds} paired rounds, process time:")
    print(f"  eigsh with its defaults    {a:9.2f} ms")
    print(f"  MatrixModel, sparse        {b:9.2f} ms   {ratios[0]:8.1f} x faster")
    print(f"  ReducedModel, 16 walkers   {c:9.3f} ms   {ratios[1]:8.0f} x faster")
    print(f"  ReducedModel against MatrixModel: {ratios[2]:.0f} x faster")
    return float(a), float(ratios[0]), float(ratios[1])


def main(
    storeys: int = 14, segments: int = 2, rounds: int = 9, nsteps: int = 2_000
) -> dict[str, Any]:
    """Time the three ways, update the factors; return ratios, model and draws."""
    K, M = building(storeys, segments)
    size, names = M.shape[0], tuple(K)
    print(f"{size} degrees of freedom, {len(names)} factors, {N_MODES} modes")
    begin, cpu = time.perf_counter(), time.process_time()
    full = ef.MatrixModel(csc_array((size, size)), M, K, n_modes=N_MODES)
    reduced = ef.reduce_model(full, dict.fromkeys(names, (LOW, HIGH)), tolerance=1e-4)
    cpu, offline = time.process_time() - cpu, time.perf_counter() - begin
    print(f"\n{reduced}\n({cpu:.1f} s of process time to make and to certify it)")
    by_eigsh, *ratios = compare_solves(K, M, full, reduced, rounds)

    rng = np.random.default_rng(2)
    true = rng.uniform(0.8, 1.2, len(names))
    exact = full(dict(zip(names, true[:, None], strict=True))).frequencies
    errors = RELATIVE_SD * rng.normal(size=MEASURED)
    begin = time.perf_counter() - offline
    posterior = ef.LogPosterior(
        reduced,
        ef.FrequencyTerm(exact[0, :MEASURED] * (1 + errors), relative_sd=RELATIVE_SD),
        ef.IndependentPrior(dict.fromkeys(names, ef.uniform_between(LOW, HIGH))),
    )
    samplers = ef.run(posterior, ef.DEMCMove(), nsteps=nsteps, seed=2)
    idata = ef.to_inference_data(samplers, posterior, discard=nsteps // 4)
    table = ef.parameter_table(idata)
    wall = time.perf_counter() - begin
    evaluations = (nsteps + 1) * samplers[0].nwalkers
    print(f"\n{table}")
    print("true factors:", dict(zip(names, true.round(3).tolist(), strict=True)))
    print(
        f"\n{wall:.1f} s from matrices to posterior, {offline:.1f} s of it for the "
        f"reduced model; {evaluations} evaluations, which by eigsh would take "
        f"{evaluations * by_eigsh / 3.6e6:.1f} h"
    )
    return {
        "reduced": reduced,
        "ratios": tuple(ratios),
        "draws": samplers[0].get_chain(discard=nsteps // 4, flat=True),
        "true": true,
    }


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--storeys", type=int, default=14)
    parser.add_argument("--segments", type=int, default=2, help="elements per member")
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--nsteps", type=int, default=2_000)
    main(**vars(parser.parse_args()))
