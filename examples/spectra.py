"""One record, two identifications: spectra with emcee_femu, subspaces with pyOMA2.

Three floors vibrate under wind, 600 periods of their first mode. What are their
frequencies and damping ratios, and how certain are they?

- Bayesian: the FFTs of the record in a band about each peak, the posterior of the mode
  in it, and `modes_from_spectra`. The record's length and noise say how certain it is.
- pyOMA2: covariance-driven stochastic subspace identification, its deviations from the
  scatter of nb blocks of the record (calc_unc=True). Needs
  pip install "emcee_femu[oma]"; without it only the first half is shown.

Run it:  python examples/spectra.py
"""

import argparse
import logging

import numpy as np
from scipy import signal

import emcee_femu as ef
from emcee_femu.table import Table

F, ZETA = np.array([1.0, 2.8, 4.05]), np.array([0.01, 0.012, 0.015])
SHAPES = np.array(
    [[0.328, 0.737, 0.591], [0.591, 0.328, -0.737], [0.737, -0.591, 0.328]]
)
RATE, DURATION = 20.0, 600.0  # samples per second, s
FORCE, NOISE = 1e-4, 1e-5  # one-sided densities, (m/s^2)^2 / Hz


def record(seed: int) -> np.ndarray:
    """Return simulated accelerations of the floors, ``(samples, 3)``."""
    rng = np.random.default_rng(seed)
    n, run_in = round(RATE * DURATION), 2_000
    sd = np.sqrt(np.array([FORCE, NOISE]) * RATE / 2)  # of one sample
    modes = []
    for w, zeta in zip(2 * np.pi * F, ZETA, strict=True):
        own = ([1.0, 0.0, 0.0], [1.0, 2 * zeta * w, w * w])
        b, a, _ = signal.cont2discrete(own, 1 / RATE)
        force = sd[0] * rng.standard_normal(n + run_in)
        modes.append(signal.lfilter(b.ravel(), a, force)[run_in:])
    return np.transpose(modes) @ SHAPES.T + sd[1] * rng.standard_normal((n, 3))


def from_spectra(
    accelerations: np.ndarray, generations: int, seed: int
) -> ef.Measurements:
    """Return the modes, one band of six half widths after another."""
    found = {}
    for f, zeta in zip(F, ZETA, strict=True):  # as read off a plot of the spectrum
        band = (f * (1 - 6 * zeta), f * (1 + 6 * zeta))
        spectra = ef.Spectra.from_record(accelerations, RATE, band)
        model = ef.SpectrumModel(spectra)
        prior = ef.IndependentPrior(
            {name: ef.uniform_between(*own) for name, own in model.ranges.items()}
        )
        posterior = ef.LogPosterior(model, ef.SpectrumTerm(spectra), prior)
        samplers = ef.run(posterior, "auto", nsteps=generations, ensembles=1, seed=seed)
        found[f"{f:g} Hz"] = ef.to_inference_data(samplers, posterior)
    return ef.modes_from_spectra(found)


def from_subspaces(accelerations: np.ndarray) -> list[np.ndarray] | None:
    """Return pyOMA2's frequencies, damping ratios and deviations, None without it."""
    try:
        from pyoma2.algorithms import SSI
        from pyoma2.setup import SingleSetup
    except ImportError:
        return None
    logging.getLogger("pyoma2").setLevel(logging.WARNING)
    setup = SingleSetup(accelerations, fs=RATE)
    method = SSI(name="SSI", method="cov", br=15, ordmax=16, calc_unc=True, nb=30)
    setup.add_algorithms(method)
    setup.run_by_name("SSI")
    setup.mpe("SSI", sel_freq=F.tolist(), order_in="find_min", rtol=0.1)
    result = method.result
    found = (result.Fn, result.Fn_std, result.Xi, result.Xi_std)
    return [np.ravel(values) for values in found]


def main(generations: int = 200, seed: int = 7) -> Table:
    """Identify, print and return both."""
    accelerations = record(seed)
    modes = from_spectra(accelerations, generations, seed)
    columns = [
        ("f [Hz]", ".3f", F),
        ("spectra", ".4f", modes.frequencies),
        ("sd", ".4f", modes.sd),
        ("damping %", ".2f", 100 * ZETA),
        ("spectra %", ".2f", 100 * modes.damping),
        ("sd %", ".2f", 100 * modes.damping_sd),
    ]
    other = from_subspaces(accelerations)
    if other is not None:
        f, f_sd, zeta, zeta_sd = other
        columns[3:3] = [("SSI", ".4f", f), ("SSI sd", ".4f", f_sd)]
        columns += [("SSI %", ".2f", 100 * zeta), ("SSI sd %", ".2f", 100 * zeta_sd)]
    table = Table.from_columns("Identified from one record", columns)
    print(table)
    return table


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--generations", type=int, default=200)
    parser.add_argument("--seed", type=int, default=7)
    main(**vars(parser.parse_args()))
