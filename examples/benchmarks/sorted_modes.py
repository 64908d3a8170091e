"""Modes that cross: emulated as sorted numbers, or as modes with their shapes.

The paper's H structure, whose modes cross inside the bounds, is emulated twice from as
many full solves: once as it is, with frequencies and shapes, and once with its
frequencies under another name, which `emulate` takes as plain numbers, kinks and all.
Both are held to full solves at draws of the posterior of the better emulator: the root
mean square error in measurement errors, and the effective share of the weights of
`certify`, of each emulator's own draws.

Run it:  OMP_NUM_THREADS=1 python examples/benchmarks/sorted_modes.py
"""

import argparse
from collections.abc import Mapping
from typing import Any

import numpy as np
from few_solves_problems import RatioTerm, h_structure

import emcee_femu as ef
from emcee_femu.table import Table


class Plain:
    """A modal model whose frequencies are not known to be any."""

    def __init__(self, model: Any) -> None:
        self.model = model
        self.variables = {"sorted": ef.Variable({"mode": range(model.n_modes)}, "Hz")}
        self.names = model.names

    def __call__(self, parameters: Mapping[str, Any]) -> dict[str, Any]:
        """Return the same frequencies under another name."""
        return {"sorted": self.model(parameters).frequencies}


class PlainTerm:
    """The term of these numbers."""

    name = "sorted"

    def __init__(self, term: RatioTerm, reads: Mapping[str, Any]) -> None:
        self.term, self.reads = term, reads

    def __call__(self, parameters: Any, response: Any) -> Any:
        """Return the log-likelihood."""
        return self.term(parameters, {"frequency": response["sorted"]})

    def deviations(self, parameters: Any, response: Any) -> Any:
        """Return deviations and standard deviations (interfaces.py)."""
        return self.term.deviations(parameters, {"frequency": response["sorted"]})


def main(
    beta: float = 500, solves: int = 75, nsteps: int = 500, seed: int = 1
) -> Table:
    """Print and return errors and efficiencies of both."""
    full = h_structure(beta).posterior
    (term,), plain = full.terms, Plain(full.model)
    numbers = ef.LogPosterior(plain, PlainTerm(term, plain.variables), full.prior)
    rows, theta = [], None
    for name, posterior in (("modes", full), ("sorted numbers", numbers)):
        emulated = ef.emulate(posterior, solves, seed=seed, tolerance=0)
        samplers = ef.run(emulated.posterior, "auto", nsteps=nsteps, seed=seed)
        idata = ef.to_inference_data(samplers, emulated.posterior)
        certificate = ef.certify(idata, posterior, 200, seed=seed)
        if theta is None:
            theta = np.random.default_rng(seed).choice(
                samplers[0].get_chain(flat=True), 300, replace=False
            )
        given = posterior.parameters(theta)
        true, sd = posterior.terms[0].deviations(given, posterior.model(given))
        own, _ = posterior.terms[0].deviations(given, emulated(given))
        rms = np.sqrt((((own - true) / sd) ** 2).mean())
        rows.append((name, emulated.solves, rms, certificate.efficiency))
    names, spent, errors, efficiencies = zip(*rows, strict=True)
    table = Table.from_columns(
        f"H structure, beta = {beta:g}, emulated",
        [
            ("emulated as", "", [*names]),
            ("solves", "d", [*spent]),
            ("error", ".2f", [*errors]),
            ("efficiency", ".2f", [*efficiencies]),
        ],
    )
    print(table)
    return table


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--beta", type=float, default=500)
    parser.add_argument("--solves", type=int, default=75)
    parser.add_argument("--nsteps", type=int, default=500)
    parser.add_argument("--seed", type=int, default=1)
    main(**vars(parser.parse_args()))
