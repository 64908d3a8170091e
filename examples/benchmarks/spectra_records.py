"""Spectra and subspaces on many simulated records: do they err as they say?

The records and both identifications are those of the page
``examples/how_to/spectra.py``.

Run it:  python examples/benchmarks/spectra_records.py
"""

import argparse
import runpy
from pathlib import Path

import numpy as np

import emcee_femu as ef
from emcee_femu.table import Table

PAGE = Path(__file__).parents[1] / "how_to" / "spectra.py"


def main(records: int = 24, first: int = 100, generations: int = 100) -> Table:
    """Identify each record by both; print and return their errors."""
    page = runpy.run_path(str(PAGE))
    truth = np.array([page["F"], page["ZETA"]])
    errors = []  # of spectra and SSI: deviations, and over what each says of itself
    for seed in range(first, first + records):
        accelerations = page["record"](seed)
        found = page["from_spectra"](accelerations, seed, generations)
        modes = ef.modes_from_spectra(found)
        f, f_sd, zeta, zeta_sd = page["from_subspaces"](accelerations)
        values = np.array([[modes.frequencies, modes.damping], [f, zeta]]) - truth
        sd = np.array([[modes.sd, modes.damping_sd], [f_sd, zeta_sd]])
        errors.append([values, values / sd])
    rms = np.sqrt(np.mean(np.square(errors), axis=0))  # (2, method, quantity, mode)
    columns = [("mode", ".2f", truth[0])]
    for i, method in enumerate(("spectra", "SSI")):
        columns += [
            (f"f by {method}", ".2f", rms[1, i, 0]),
            (f"damping by {method}", ".2f", rms[1, i, 1]),
            ("its error %", ".2f", 100 * rms[0, i, 1]),
        ]
    title = f"Root mean square of error over stated deviation, {records} records"
    table = Table.from_columns(title, columns)
    print(table)
    return table


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--records", type=int, default=24)
    parser.add_argument("--first", type=int, default=100)
    parser.add_argument("--generations", type=int, default=100)
    main(**vars(parser.parse_args()))
