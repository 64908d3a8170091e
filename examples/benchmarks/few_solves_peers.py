"""PyVBMC and GPry, which emulate the log-posterior, on the few-solves problems.

Both run with their default settings. They want a box: the bounds of the prior, and
where there are none its 0.01 % and 99.99 % quantiles; the plausible box is that of its
16 % and 84 % quantiles. Means and standard deviations are compared with the references.
What does not import is said, not skipped in silence.

Run it:  pip install pyvbmc gpry
         OMP_NUM_THREADS=1 python examples/benchmarks/few_solves_peers.py --seeds 3
"""

import argparse
import importlib
import json
import os
import time
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from few_solves_problems import PROBLEMS, Problem

Floats = np.ndarray
REFERENCES = Path(__file__).with_name("few_solves_references.json")
DRAWS = 20_000


def boxes(problem: Problem) -> tuple[Floats, Floats]:
    """Return bounds and plausible bounds, each ``(2, d)``."""
    prior = problem.posterior.prior
    draws = prior.sample(np.random.default_rng(0), 100_000)
    wide, likely = np.quantile(draws, [[1e-4, 0.9999], [0.16, 0.84]], axis=0)
    return np.where(np.isfinite(prior.bounds.T), prior.bounds.T, wide), likely


def run_pyvbmc(problem: Problem, seed: int) -> tuple[Floats, str]:
    """Return draws of the variational posterior, and what is claimed."""
    from pyvbmc import VBMC

    (low, high), (soft_low, soft_high) = boxes(problem)
    rng = np.random.default_rng(seed)
    np.random.seed(seed)  # noqa: NPY002 - it draws from there
    start = rng.uniform(soft_low, soft_high)

    def log_density(theta: Floats) -> float:
        return float(problem.posterior(np.ravel(theta))[0])

    options = {"display": "off"}
    vbmc = VBMC(log_density, start, low, high, soft_low, soft_high, options)
    law, result = vbmc.optimize()
    return law.sample(DRAWS)[0], f"success_flag={result['success_flag']}"


def run_gpry(problem: Problem, seed: int) -> tuple[Floats, str]:
    """Return draws of the emulated posterior, and what is claimed."""
    from gpry import Runner

    (low, high), likely = boxes(problem)

    def log_density(theta: Floats) -> float:
        return float(problem.posterior(np.ravel(theta))[0])

    runner = Runner(
        log_density,
        np.column_stack([low, high]),
        np.column_stack(likely),
        params=list(problem.posterior.names),
        seed=seed,
        verbose=1,
    )
    runner.run()
    runner.generate_mc_sample()
    samples = runner.last_mc_samples(as_pandas=False)
    theta, weights = np.asarray(samples["X"]), samples["w"]
    weights = np.ones(len(theta)) if weights is None else np.asarray(weights)
    rng = np.random.default_rng(0)
    chosen = rng.choice(len(theta), DRAWS, p=weights / weights.sum())
    return theta[chosen], f"has_converged={runner.has_converged}"


PEERS = {"pyvbmc": run_pyvbmc, "gpry": run_gpry}


def judge(peer: str, name: str, seed: int) -> dict[str, Any]:
    """Run a peer on a problem, and compare with the reference."""
    problem = PROBLEMS[name]()
    known = json.loads(REFERENCES.read_text())[name]
    begin = time.perf_counter()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        theta, claim = PEERS[peer](problem, seed)
    sd = np.array(known["sd"])
    off = {"mean": (theta.mean(axis=0) - known["mean"]) / sd,
           "sd": theta.std(axis=0) / sd - 1}  # fmt: skip
    return {
        "solves": problem.box.solves,
        "mean off (sd)": float(np.abs(off["mean"]).max()),
        "sd off": float(np.abs(off["sd"]).max()),
        "first mode": float(problem.first(theta).mean()) if problem.first else None,
        "claims": claim,
        "seconds": time.perf_counter() - begin,
    }


def main() -> None:
    """Print a line a run, as it ends."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--peer", action="append", choices=list(PEERS))
    parser.add_argument("--problem", action="append", choices=list(PROBLEMS))
    given = parser.parse_args()
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    for peer in given.peer or PEERS:
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                version = getattr(importlib.import_module(peer), "__version__", "")
        except ImportError as error:
            print(f"{peer} is not installed, or does not import: {error}", flush=True)
            continue
        for name in given.problem or ("beck_au", "mass_spring"):
            for seed in range(1, given.seeds + 1):
                row = judge(peer, name, seed)
                shown = (
                    f"{v:.3g}" if isinstance(v, float) else v for v in row.values()
                )
                print(peer, version, name, seed, *shown, sep="  ", flush=True)


if __name__ == "__main__":
    main()
