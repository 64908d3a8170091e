"""pyOMA2 and a posterior on many simulated records: are they as sure as they may be?

The record, its identification and the posterior are those of the page
``examples/how_to/ambient_vibration.py``. Of each record: the error
of the stiffnesses as chi-square, with delta as on the page and inferred. Of all: what
pyOMA2 states as standard deviations over the scatter.

Run it:  python examples/benchmarks/ambient_records.py
"""

import argparse
import runpy
from pathlib import Path
from unittest import mock

import numpy as np
from scipy import stats

import emcee_femu as ef
from emcee_femu.table import Table

PAGE = Path(__file__).parents[1] / "how_to" / "ambient_vibration.py"


def main(records: int = 16) -> Table:
    """Identify and update each record; print and return the means over all."""
    page = runpy.run_path(str(PAGE))
    example_data = page["load_pyoma2"]()[2]
    generator = np.random.RandomState  # example_data has a seed of its own
    chi_square, found = [], []
    for seed in range(records):
        with mock.patch("numpy.random.RandomState", lambda _, s=seed: generator(s)):
            acceleration = example_data()[0]
        result = page["identify"](acceleration, page["RATE"], page["PEAKS"])
        measured = ef.Measurements.from_pyoma2(result)
        fixed = page["posterior"](measured)
        springs = [stats.lognorm(0.3, scale=1.2 * page["TRUTH"])] * len(fixed.names)
        prior = dict(zip(fixed.names, springs, strict=True))
        inferred = ef.LogPosterior(
            fixed.model,
            [fixed.terms[0], ef.ShapeTerm(measured, discrepancy="delta")],
            ef.IndependentPrior({**prior, "delta": stats.halfnorm(scale=0.1)}),
        )
        own = []
        for target in (fixed, inferred):
            samplers = ef.run(target, "auto", nsteps=100, ensembles=1, seed=seed)
            draws = samplers[0].get_chain(flat=True)[:, : len(springs)]
            z = np.linalg.solve(
                np.linalg.cholesky(np.cov(draws.T)), draws.mean(axis=0) - page["TRUTH"]
            )
            own.append(z @ z)
        chi_square.append(own)
        length = np.linalg.norm(result.Phi, axis=0)
        top = np.sign(measured.shapes[0]) / np.linalg.norm(measured.shapes, axis=0)
        unit = (measured.shapes * top).ravel()
        found.append(
            (result.Fn, result.Fn_std, unit, (result.Phi_std / length).ravel())
        )
    f, f_sd, shape, shape_sd = (np.array(column) for column in zip(*found, strict=True))
    ratio = np.median(f_sd, axis=0) / f.std(axis=0, ddof=1)
    others = np.median(shape_sd, axis=0) / shape.std(axis=0, ddof=1)
    scatter = shape.std(axis=0, ddof=1).reshape(-1, f.shape[1]).mean(axis=0)
    fixed_mean, inferred_mean = np.mean(chi_square, axis=0)
    rows = [
        ("chi-square of 5 stiffnesses, delta fixed", fixed_mean),
        ("chi-square of 5 stiffnesses, delta inferred", inferred_mean),
        ("Fn_std over scatter, least", ratio.min()),
        ("Fn_std over scatter, most", ratio.max()),
        ("Phi_std over scatter, median", np.median(others)),
        ("scatter of the fifth shape over that of the first", scatter[-1] / scatter[0]),
    ]
    names, values = zip(*rows, strict=True)
    columns = [("of all records", "s", [*names]), ("mean", ".2f", [*values])]
    table = Table.from_columns(f"{records} records", columns)
    print(table)
    return table


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--records", type=int, default=16)
    main(**vars(parser.parse_args()))
