"""From acceleration records to a posterior: pyOMA2 identifies, emcee_femu updates.

Five floors of 25.91 kg on springs vibrate under wind and traffic, nobody knows how
much force. Five accelerometers record 300 s. How stiff is each storey?

1. pyOMA2 identifies frequencies, damping and shapes from the records alone, by
   covariance-driven stochastic subspace identification. With calc_unc=True it cuts the
   record into nb blocks and propagates their scatter: a standard deviation for each
   frequency, from one test.
2. `Measurements.from_pyoma2` takes frequencies, deviations and complex shapes, turns
   the shapes real, and says how complex they were (MPC; 1 = not at all).
3. The model is the chain of springs. Its stiffnesses are believed to be 12 kN/m, give
   or take 30 %. Frequencies weigh by their own deviations, shapes by the noise of a
   sensor, DELTA. Without shapes the stiffnesses come out two to six times less certain,
   and walkers get caught near frames that fit some of the frequencies. A chain's modes
   never change order, so no pairing is needed (otherwise: `PairedModel`).
4. `ef.run` samples two ensembles, which must agree before a table is believed.

The pyOMA2 package brings no records as files (`get_sample_data` fetches them from the
network), so these are from its own generator, `example_data`: white noise on a frame of
10 kN/m per storey, 10 % noise in each channel. The truth is thus known, and shown. A
real structure deviates from its model by more than 0.2 % in frequency, and then
`FrequencyTerm(measured, discrepancy="model error")` is the term to use.

Can the result be trusted? Over 60 simulated records such as this one, Fn_std was 0.9 to
1.1 times the scatter of the frequencies. In 12 of them the errors of the stiffnesses
were what the posterior says (mean chi-square 4.8 on 5 degrees of freedom). Inferring
delta made the posterior too sure (11.3, in 16): one number cannot stand for the first
mode's shape and for the fifth's, which is three times noisier. Phi_std, which
`from_pyoma2` leaves out unless told, was 1.3 to 9.5 times the scatter of the shapes
(pyOMA2 1.4.3).

For your own records copy `identify`; it needs `pip install "emcee_femu[oma]"`.

Run it:  python examples/ambient_vibration.py
"""

import argparse
import logging
from typing import Any

import numpy as np
from scipy import stats

import emcee_femu as ef
from emcee_femu.results.diagnostics import Diagnosis
from emcee_femu.table import Table

FLOORS, MASS = 5, 25.91  # -, kg
TRUTH = 1e4  # N/m, every storey
PEAKS = [0.9, 2.6, 4.1, 5.25, 6.0]  # Hz, as read off the stabilisation diagram
RATE = 100.0  # samples per second
DELTA = 0.01  # of a shape of unit length


def load_pyoma2() -> tuple[Any, Any, Any]:
    """Import what is needed of pyOMA2, or say what to do where it does not import."""
    try:
        from pyoma2.algorithms import SSI
        from pyoma2.functions.gen import example_data
        from pyoma2.setup import SingleSetup
    except ImportError as error:
        raise ImportError(
            f"pyOMA2 does not import ({error}). If it is not installed: pip install "
            '"emcee_femu[oma]" (on PyPI it is pyOMA_2, not PyOMA)'
        ) from error
    logging.getLogger("pyoma2").setLevel(logging.WARNING)  # it tells every step
    return SSI, SingleSetup, example_data


def identify(acceleration: np.ndarray, rate: float, peaks: list[float]) -> Any:
    """Return pyOMA2's modes near the peaks; records are ``(samples, channels)``."""
    SSI, SingleSetup, _ = load_pyoma2()
    setup = SingleSetup(acceleration, fs=rate)
    setup.decimate_data(q=5)  # to 20 samples per second: the highest mode is at 6 Hz
    method = SSI(name="SSI", method="cov", br=10, ordmax=20, calc_unc=True, nb=50)
    setup.add_algorithms(method)
    setup.run_by_name("SSI")
    # "find_min": the lowest model order at which all of these modes are stable.
    setup.mpe("SSI", sel_freq=peaks, order_in="find_min", rtol=0.1)
    return method.result


def posterior(measured: ef.Measurements) -> ef.LogPosterior:
    """Return that of the storeys' stiffnesses k1 (ground) to k5."""
    # Channel and node 1 are the roof, 5 the first floor; k1 stands on the ground.
    nodes = [0, *range(FLOORS, 0, -1)]
    springs = {
        f"k{i + 1}": (nodes[i], nodes[i + 1], 1.2 * TRUTH) for i in range(FLOORS)
    }
    stiffness = stats.lognorm(0.3, scale=1.2 * TRUTH)
    return ef.LogPosterior(
        ef.MassSpringModel([MASS] * FLOORS, springs, shapes=True),
        [ef.FrequencyTerm(measured), ef.ShapeTerm(measured, delta=DELTA)],
        ef.IndependentPrior(dict.fromkeys(springs, stiffness)),
    )


def main(
    generations: int = 3_000, ensembles: int = 2, seed: int = 4
) -> tuple[ef.Measurements, Table, Diagnosis]:
    """Identify, sample, print; return the modes, the parameters and the diagnosis."""
    acceleration, *_ = load_pyoma2()[2]()
    measured = ef.Measurements.from_pyoma2(
        identify(acceleration, RATE, PEAKS),
        sensors=["roof", "floor 4", "floor 3", "floor 2", "floor 1"],
    )
    target = posterior(measured)
    samplers = ef.run(target, nsteps=generations, ensembles=ensembles, seed=seed)
    burn_in = generations // 3
    idata = ef.to_inference_data(samplers, target, discard=burn_in)
    parameters = ef.parameter_table(idata, nominal=dict.fromkeys(target.names, TRUTH))
    diagnosis = ef.diagnose(samplers, discard=burn_in)
    print(measured, parameters, ef.frequency_table(idata), diagnosis, sep="\n\n")
    return measured, parameters, diagnosis


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--generations", type=int, default=3_000)
    parser.add_argument("--ensembles", type=int, default=2)
    parser.add_argument("--seed", type=int, default=4)
    main(**vars(parser.parse_args()))
