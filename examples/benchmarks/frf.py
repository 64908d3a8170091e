"""FRFs of many walkers: one batch against loops over the walkers.

Six masses on a chain, four channels, 400 lines, 64 walkers. "Direct" inverts the
dynamic stiffness of each walker line by line, as scripts do; "one by one" calls the
batched model with one walker at a time. Ratios of paired runs.

Run it:  OMP_NUM_THREADS=1 python examples/benchmarks/frf.py
"""

import argparse
import time

import numpy as np

import emcee_femu as ef

WALKERS, DOFS = 64, 6
LINES = np.linspace(0.5, 20.0, 400)
CHANNELS = [(0, 5), (2, 5), (4, 5), (5, 5)]
DAMPING = 0.01


def build() -> ef.FRFModel:
    """Return the FRF model of the chain."""
    ends = np.eye(DOFS) - np.eye(DOFS, k=-1)
    K = {f"k{i}": np.outer(end, end) for i, end in enumerate(ends, 1)}
    chain = ef.MatrixModel(
        np.zeros((DOFS, DOFS)), np.eye(DOFS), K, n_modes=DOFS, shapes=True
    )
    return ef.FRFModel(chain, LINES, CHANNELS, damping={"stiffness": DAMPING})


def solve_directly(model: ef.FRFModel, row: np.ndarray) -> np.ndarray:
    """Return the FRFs of one walker ``(channels, lines)``, line by line."""
    K = sum(k * unit for k, unit in zip(row, model.model.K.values(), strict=True))
    M, found = model.model.M0, []
    for w in 2 * np.pi * LINES:
        inverse = np.linalg.inv(K - w * w * M + 1j * w * DAMPING * K)
        found.append([inverse[r, s] for r, s in CHANNELS])
    return np.transpose(found)


def main(repeats: int = 7) -> dict[str, float]:
    """Time both, print and return how many times faster the batch is."""
    model = build()
    theta = np.random.default_rng(1).uniform(1_000, 5_000, (WALKERS, DOFS))
    names = model.names or ()

    def batch(rows: np.ndarray) -> np.ndarray:
        return model(dict(zip(names, rows.T, strict=True)))["receptance"] @ [1, 1j]

    loops = {
        "direct, line by line": lambda: [solve_directly(model, row) for row in theta],
        "modes, one by one": lambda: [batch(row[None])[0] for row in theta],
    }
    times: dict[str, list[float]] = {name: [] for name in loops}
    for _ in range(repeats):
        start = time.perf_counter()
        together = batch(theta)
        own = time.perf_counter() - start
        for name, loop in loops.items():
            start = time.perf_counter()
            found = loop()
            times[name].append((time.perf_counter() - start) / own)
            np.testing.assert_allclose(found, together, rtol=1e-6)
    ratios = {name: float(np.median(ratio)) for name, ratio in times.items()}
    for name, ratio in ratios.items():
        print(f"{name}: one batch is {ratio:.0f} times faster")
    return ratios


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=7)
    main(**vars(parser.parse_args()))
