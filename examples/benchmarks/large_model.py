"""What a large solid costs: to factor, to solve, to reduce; SuperLU beside PARDISO.

A concrete block of 8-node bricks, fixed at its foot. The moduli of its four quarters,
one above the other, are unknown. Six modes are wanted, and reduced to a relative
frequency error of 1e-4, unless a solve takes more than 100 s. Every row is a process of
its own, so that the memory is its peak. PARDISO takes part if it is installed:
``pip install pypardiso``.

Run it:  OMP_NUM_THREADS=1 python examples/benchmarks/large_model.py
"""

import importlib.util
import multiprocessing
import os
import sys
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from typing import Any

import numpy as np
from commands import command, tabulate
from scipy import sparse

import emcee_femu as ef
from emcee_femu.models.factorization import factor_definite
from emcee_femu.table import Table

E, NU, RHO = 30e9, 0.2, 2500.0  # Pa, -, kg/m3
SIZES = np.array([6.0, 8.0, 24.0])  # m
BOUNDS = dict.fromkeys(["E1", "E2", "E3", "E4"], (0.5, 1.5))  # times E, from the foot
PATIENCE = 100.0  # seconds of a solve
COLUMNS = {
    "DOFs": "d", "solver": "", "factor (s)": ".2f", "six modes (s)": ".1f",
    "peak (GB)": ".1f", "reduced (min)": ".1f", "full solves": ".0f", "basis": ".0f",
    "error": ".1e", "peak then (GB)": ".1f", "reduced solve (ms)": ".2f",
}  # fmt: skip


def brick(sides: np.ndarray) -> np.ndarray:
    """Return the stiffness ``(24, 24)`` of a brick with sides ``(3,)`` in m."""
    corners = np.array([[x, y, z] for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)])
    shear = E / (2 * (1 + NU))
    D = np.diag([2 * shear] * 3 + [shear] * 3)
    D[:3, :3] += E * NU / ((1 + NU) * (1 - 2 * NU))
    k = np.zeros((24, 24))
    for point in corners / np.sqrt(3):  # of Gauss
        f = 1 + corners * point
        slopes = corners * f[:, [1, 0, 0]] * f[:, [2, 2, 1]] / (4 * sides)
        B = np.zeros((6, 24))
        for row, (i, j) in enumerate([(0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (2, 0)]):
            B[row, i::3] = slopes[:, j]
            B[row, j::3] = slopes[:, i]
        k += B.T @ D @ B * sides.prod() / 8
    return k


def solid(dofs: int) -> tuple[sparse.csc_array, dict[str, sparse.csc_array]]:
    """Return the mass, lumped, and the stiffness of each quarter, of about ``dofs``."""
    n = round((dofs / 6) ** (1 / 3))  # nodes along a side; 2 n bricks upwards
    sides = SIZES / [n - 1, n - 1, 2 * n]
    node = np.arange((2 * n + 1) * n * n).reshape(2 * n + 1, n, n)
    ends = slice(None, -1), slice(1, None)
    corners = np.stack([node[z, y, x] for z in ends for y in ends for x in ends], -1)
    free = slice(3 * n * n, None)
    parts = {}
    for name, layers in zip(BOUNDS, np.array_split(corners, len(BOUNDS)), strict=True):
        at = (3 * layers.reshape(-1, 8, 1) + np.arange(3)).reshape(-1, 24)
        where = np.repeat(at, 24, axis=1).ravel(), np.tile(at, 24).ravel()
        values = np.tile(brick(sides).ravel(), len(at))
        K = sparse.coo_array((values, where), (3 * node.size, 3 * node.size)).tocsc()
        parts[name] = K[free, free]
    shares = np.full(corners.size, RHO * sides.prod() / 8)
    mass = np.repeat(np.bincount(corners.ravel(), shares), 3)[free]
    return sparse.diags_array(mass).tocsc(), parts


def timed(call: Callable[[], Any]) -> tuple[Any, float]:
    """Return what a call returns, and its wall-clock time in seconds."""
    start = time.perf_counter()
    return call(), time.perf_counter() - start


def peak() -> float:
    """Return the most memory that this process has held, in GB."""
    from resource import RUSAGE_SELF, getrusage  # not on Windows

    unit = 1 if sys.platform == "darwin" else 1024
    return unit * getrusage(RUSAGE_SELF).ru_maxrss / 1e9


def measure(dofs: int, solver: str, tolerance: float = 1e-4) -> tuple[object, ...]:
    """Return a row of the table."""
    if solver == "SuperLU":
        sys.modules["pypardiso"] = None  # as if it were not installed
    M, parts = solid(dofs)
    full = ef.MatrixModel(0 * M, M, parts, n_modes=6)
    factor_definite(sparse.eye_array(10_000, format="csc"))  # MKL is loaded once
    K = sum(parts.values()).tocsc()
    factor, factoring = timed(lambda: factor_definite(K))
    del factor  # and its memory
    _, modes = timed(lambda: full({name: np.ones(1) for name in parts}))
    row = M.shape[0], solver, factoring, modes, peak()
    if modes > PATIENCE:
        return *row, *[np.nan] * 6
    small, reducing = timed(lambda: ef.reduce_model(full, BOUNDS, tolerance))
    rng = np.random.default_rng(1)
    draws = {name: rng.uniform(*ends, 100) for name, ends in BOUNDS.items()}
    each = min(timed(lambda: small(draws))[1] for _ in range(3)) / 100
    size, solves, error = small.size, small.full_solves, small.max_error
    return *row, reducing / 60, solves, size, error, peak(), 1e3 * each


def main(
    dofs: tuple[int, ...] = (20_000, 70_000),
    solvers: tuple[str, ...] = ("SuperLU", "PARDISO"),
    threads: int = 1,
) -> Table:
    """Print and return the table; the threads are those of PARDISO."""
    os.environ["MKL_NUM_THREADS"] = str(threads)  # PARDISO's, of the processes to come
    if not importlib.util.find_spec("pypardiso"):
        solvers = tuple(name for name in solvers if name != "PARDISO")
    cases = [(size, solver) for size in dofs for solver in solvers]
    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, spawn, max_tasks_per_child=1) as executor:
        rows = executor.map(measure, *zip(*cases, strict=True))
        title = f"Six modes of a solid; PARDISO on {threads} thread(s)"
        return tabulate(title, COLUMNS, rows)


if __name__ == "__main__":
    command(main)
