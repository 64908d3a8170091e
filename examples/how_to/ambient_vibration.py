# %% [markdown]
# # Ambient vibration: from records to a posterior
#
# For those who have acceleration records and no modes yet: pyOMA2 identifies modes
# and their uncertainties, and the model is updated with them. `python
# examples/how_to/ambient_vibration.py` runs the page; it takes `pip install
# pyOMA_2`.
#
# Five floors of 25.91 kg on springs vibrate under unmeasured wind and traffic. Five
# accelerometers record 300 s. How stiff is each storey?
#
# The pyOMA2 package contains no records (`get_sample_data` fetches them from the
# network), so its own generator, `example_data`, simulates them: white noise on a frame
# of 10 kN/m per storey, 10 % noise in each channel. The truth is thus known, and shown.

# %%
import logging
import textwrap

import numpy as np
from scipy import stats

import emcee_femu as ef

FLOORS, MASS = 5, 25.91  # -, kg
TRUTH = 1e4  # N/m, every storey
PEAKS = [0.9, 2.6, 4.1, 5.25, 6.0]  # Hz, off the stabilisation diagram
RATE = 100.0  # samples per second
DELTA = 0.01  # of a shape of unit length


def load_pyoma2():
    from pyoma2.algorithms import SSI  # on PyPI it is pyOMA_2, not PyOMA
    from pyoma2.functions.gen import example_data
    from pyoma2.setup import SingleSetup

    logging.getLogger("pyoma2").setLevel(logging.WARNING)  # tells every step
    return SSI, SingleSetup, example_data


# %% [markdown]
# ## Identification by pyOMA2
#
# pyOMA2 identifies frequencies, damping and shapes from the records alone, by
# covariance-driven stochastic subspace identification. With `calc_unc=True` it cuts the
# record into `nb` blocks and propagates their scatter: a standard deviation for each
# frequency, from one test. For your own records copy `identify`.


# %%
def identify(acceleration, rate, peaks):  # records are (samples, channels)
    SSI, SingleSetup, _ = load_pyoma2()
    setup = SingleSetup(acceleration, fs=rate)
    setup.decimate_data(q=5)  # to 20 per second: the highest mode is at 6 Hz
    options = {"method": "cov", "br": 10, "ordmax": 20, "calc_unc": True, "nb": 50}
    method = SSI(name="SSI", **options)
    setup.add_algorithms(method)
    setup.run_by_name("SSI")
    # "find_min": the lowest model order at which all these modes are stable.
    setup.mpe("SSI", sel_freq=peaks, order_in="find_min", rtol=0.1)
    return method.result


# %% [markdown]
# The cells that run the analysis are inside `if __name__ == "__main__":`, so that the
# functions can be imported without pyOMA2. {py:meth}`Measurements.from_pyoma2
# <emcee_femu.Measurements.from_pyoma2>` takes frequencies, standard deviations and
# complex shapes, makes the shapes real, and says how complex they were (MPC; 1 = not at
# all).

# %% tags=["remove-stderr"]
if __name__ == "__main__":
    acceleration, *_ = load_pyoma2()[2]()
    measured = ef.Measurements.from_pyoma2(
        identify(acceleration, RATE, PEAKS),
        sensors=["roof", "floor 4", "floor 3", "floor 2", "floor 1"],
    )
    print(measured)

# %% [markdown]
# ## The posterior
#
# The model is the chain of springs. Its stiffnesses are believed to be 12 kN/m, give or
# take 30 %. Frequencies have their own standard deviations, shapes the noise of a
# sensor, `DELTA`. The modes of a chain never change order, so no pairing is needed
# (otherwise: {py:class}`~emcee_femu.PairedModel`).


# %%
def posterior(measured):  # of the storeys' stiffnesses k1 (ground) to k5
    # Channel and node 1 are the roof, 5 the first floor; k1 is on the ground.
    nodes = [0, *range(FLOORS, 0, -1)]
    springs = {f"k{i}": (nodes[i - 1], nodes[i], 1.2 * TRUTH) for i in nodes[:0:-1]}
    stiffness = stats.lognorm(0.3, scale=1.2 * TRUTH)
    return ef.LogPosterior(
        ef.MassSpringModel([MASS] * FLOORS, springs, shapes=True),
        [ef.FrequencyTerm(measured), ef.ShapeTerm(measured, delta=DELTA)],
        ef.IndependentPrior(dict.fromkeys(springs, stiffness)),
    )


# %% [markdown]
# A real structure deviates from its model by more than 0.2 % in frequency: use
# `FrequencyTerm(measured, discrepancy="model error")`.

# %% tags=["result"]
if __name__ == "__main__":
    target = posterior(measured)
    run = ef.run(target, seed=4)
    idata = ef.to_inference_data(run)
    known = dict.fromkeys(target.names, TRUTH)
    parameters = ef.parameter_table(idata, true=known)
    diagnosis = ef.diagnose(run)
    print(parameters, ef.frequency_table(idata), sep="\n\n")
    print("\n" + textwrap.fill(diagnosis.verdict, 80))

# %% [markdown]
# ## Can the result be trusted?
#
# `tests/examples/test_ambient_vibration.py` repeats the identification for many
# records. `Fn_std` is near the scatter of the frequencies and can be used as it is.
# `Phi_std` of pyOMA2 is several times the scatter of the shapes, and `from_pyoma2`
# ignores it by default. Inferring delta makes the posterior overconfident: one number
# cannot stand for the first mode's shape and for the fifth's, which is much noisier.

# %% tags=["remove-cell"]
if __name__ == "__main__":
    assert diagnosis.converged
    mean = np.array(parameters.column("mean"))
    sd = mean * np.array(parameters.column("c.o.v. %")) / 100
    assert (np.abs(mean - TRUTH) < 3 * sd).all() and (sd < 0.02 * mean).all()
    assert (measured.phase_collinearity > 0.99).all()
