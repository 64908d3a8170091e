# %% [markdown]
# # Go from records to a posterior with pyOMA2
#
# You will identify modes from acceleration records by pyOMA2, with their uncertainties, and
# update a model with them. `python examples/how_to/ambient_vibration.py` runs this page
# (4 s); it takes `pip install "emcee_femu[oma]"`.
#
# Five floors of 25.91 kg on springs vibrate under wind and traffic, whose
# forces nobody knows. Five accelerometers record 300 s. How stiff is each storey?
#
# The pyOMA2 package brings no records as files (`get_sample_data` fetches them from the
# network), so these are from its own generator, `example_data`: white noise on a frame of
# 10 kN/m per storey, 10 % noise in each channel. The truth is thus known, and shown.

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
    try:
        from pyoma2.algorithms import SSI
        from pyoma2.functions.gen import example_data
        from pyoma2.setup import SingleSetup
    except ImportError as error:
        raise ImportError(
            f"pyOMA2 does not import ({error}). If it is not installed: "
            'pip install "emcee_femu[oma]" (on PyPI it is pyOMA_2, not PyOMA)'
        ) from error
    logging.getLogger("pyoma2").setLevel(logging.WARNING)  # tells every step
    return SSI, SingleSetup, example_data


# %% [markdown]
# ## Identification
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
    method = SSI(
        name="SSI",
        method="cov",
        br=10,
        ordmax=20,
        calc_unc=True,
        nb=50,
    )
    setup.add_algorithms(method)
    setup.run_by_name("SSI")
    # "find_min": the lowest model order at which all these modes are stable.
    setup.mpe("SSI", sel_freq=peaks, order_in="find_min", rtol=0.1)
    return method.result


# %% [markdown]
# The cells that work stand under a guard, so that the functions can be imported without
# pyOMA2. {py:meth}`Measurements.from_pyoma2 <emcee_femu.Measurements.from_pyoma2>` takes
# frequencies, deviations and complex shapes, turns the shapes real, and says how complex
# they were (MPC; 1 = not at all).

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
# The model is the chain of springs. Its stiffnesses are believed to be 12 kN/m, give or take
# 30 %. Frequencies weigh by their own deviations, shapes by the noise of a sensor, `DELTA`.
# A chain's modes never change order, so
# no pairing is needed (otherwise: {py:class}`~emcee_femu.PairedModel`).


# %%
def posterior(measured):  # of the storeys' stiffnesses k1 (ground) to k5
    # Channel and node 1 are the roof, 5 the first floor; k1 is on the ground.
    nodes = [0, *range(FLOORS, 0, -1)]
    springs = {}
    for i in range(FLOORS):
        springs[f"k{i + 1}"] = (nodes[i], nodes[i + 1], 1.2 * TRUTH)
    stiffness = stats.lognorm(0.3, scale=1.2 * TRUTH)
    return ef.LogPosterior(
        ef.MassSpringModel([MASS] * FLOORS, springs, shapes=True),
        [ef.FrequencyTerm(measured), ef.ShapeTerm(measured, delta=DELTA)],
        ef.IndependentPrior(dict.fromkeys(springs, stiffness)),
    )


# %% [markdown]
# Two ensembles, which must agree before a table is believed. A real structure deviates from
# its model by more than 0.2 % in frequency, and then
# `FrequencyTerm(measured, discrepancy="model error")` is the term to use.

# %%
if __name__ == "__main__":
    target = posterior(measured)
    run = ef.run(target, steps=200, ensembles=2, seed=4)
    idata = ef.to_inference_data(run)
    known = dict.fromkeys(target.names, TRUTH)
    parameters = ef.parameter_table(idata, nominal=known)
    diagnosis = ef.diagnose(run)
    print(parameters, ef.frequency_table(idata), sep="\n\n")
    print("\n" + textwrap.fill(diagnosis.verdict, 80))

# %% [markdown]
# What do the shapes add? A climb to the maximum by frequencies alone, started at the mean,
# has the standard deviations without them:

# %%
if __name__ == "__main__":
    alone = ef.LogPosterior(target.model, target.terms[0], target.prior)
    mean = np.array(parameters.column("mean"))
    (best,) = ef.find_map(alone, mean, seed=1).maxima
    without = np.sqrt(np.diag(best.covariance))
    sd = mean * np.array(parameters.column("c.o.v. %")) / 100
    print("without shapes over with:", *(without / sd).round(1))

# %% [markdown]
# ## Can the result be trusted?
#
# Over 24 simulated records such as this one, whose truth is known, chi-square of the five
# stiffnesses has a mean of 4.6, 5 being that of a posterior as sure as it may be, and
# `Fn_std` is 0.87 to 1.12 of the scatter of the frequencies: it may be taken as it is.
# `Phi_std` of pyOMA2 1.4.3 is 4.5 times the scatter of the shapes, and `from_pyoma2` leaves it
# out unless told (`tests/examples/test_ambient_vibration.py` watches both). Inferring delta
# makes the posterior too sure: one number cannot stand for the first mode's shape and for
# the fifth's, which is four times noisier.
#
# For a posterior from the record itself, without a model order, see {doc}`spectra`.

# %% tags=["remove-cell"]
if __name__ == "__main__":
    assert diagnosis.converged
    assert (without > 1.2 * sd).all()
    assert (np.abs(mean - TRUTH) < 3 * sd).all() and (sd < 0.02 * mean).all()
    assert (measured.phase_collinearity > 0.99).all()
