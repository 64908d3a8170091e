"""How honest certificates are: Gaussians in d = 3 with emulated variances too small.

Each emulated posterior has a share of the true variances. Independent chains of it are
certified by 75 full solves each; counted are the verdicts, and the root mean square of
the z-scores of means and standard deviations, which is 1 where errors are honest.

Run it:  OMP_NUM_THREADS=1 python examples/benchmarks/certificates.py
"""

import argparse
from collections import Counter
from dataclasses import dataclass
from typing import Any

import numpy as np

import emcee_femu as ef
from emcee_femu.table import Table

C = np.array([[1.0, 0.6, 0.0], [0.6, 1.0, -0.3], [0.0, -0.3, 1.0]])
WIDE = [(-12.0, 12.0)] * 3


@dataclass(frozen=True)
class Gaussian:
    """The likelihood of a share of the covariance, of any response."""

    share: float

    def __call__(self, parameters: Any, response: Any) -> Any:
        """Return the log density, ``(n,)``."""
        theta = np.column_stack([parameters[name] for name in "xyz"])
        squares = np.einsum("ni,ij,nj->n", theta, np.linalg.inv(C), theta)
        return -0.5 * (squares / self.share + 3 * np.log(self.share))


@dataclass(frozen=True)
class Nothing:
    """No FE model: one frequency that nobody reads."""

    n_modes: int = 1

    def __call__(self, parameters: Any) -> Any:
        """Return a frequency of 1 Hz."""
        return ef.ModalSolution(np.ones((len(parameters["x"]), 1)))


def posterior(share: float) -> ef.LogPosterior:
    """Return the posterior of a Gaussian in a wide box."""
    prior = ef.GaussianPrior(list("xyz"), [0.0] * 3, 1e6, WIDE)
    return ef.LogPosterior(Nothing(), Gaussian(share), prior)


def judge(share: float, chains: int) -> list[Any]:
    """Return a row of the table."""
    true, emulated = posterior(1.0), posterior(share)
    verdicts: Counter[str] = Counter()
    z = []
    for seed in range(chains):
        start = np.random.default_rng(seed).multivariate_normal(
            np.zeros(3), share * C, 40
        )
        move = ef.DEMCMove()
        (sampler,) = ef.run(emulated, move, 40, 250, seed=seed, initial=start)
        idata = ef.to_inference_data(sampler, emulated)
        found = ef.certify(idata, true, solves=75, seed=seed)
        verdicts[found.short] += 1
        if found.short != "refused":
            z.append([found.mean / found.mean_error, (found.sd - 1) / found.sd_error])
    sizes = np.sqrt(np.mean(np.square(z), axis=(0, 2))) if z else [np.nan] * 2
    counts = [verdicts[short] for short in ("certified", "corrected", "refused")]
    return [share, *counts, *sizes]


def main(chains: int = 200) -> Table:
    """Print and return the table."""
    columns = ("variances", "certified", "corrected", "refused", "rms z mean", "sd")
    rows = tuple(tuple(judge(share, chains)) for share in (0.85, 0.7, 0.5))
    table = Table(
        f"{chains} chains each, 75 solves",
        columns,
        (".2f", "", "", "", ".2f", ".2f"),
        rows,
    )
    print(table)
    return table


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--chains", type=int, default=200)
    main(parser.parse_args().chains)
