# %% [markdown]
# # Use a test that was repeated
#
# Turn several tests of one structure into one {py:class}`~emcee_femu.Measurements`,
# with the scatter of the tests as its error, covariance included.
# `python examples/how_to/repeated_tests.py` runs this page (3 s).
#
# Six tests of a frame on six days (made-up numbers); the frequencies of a day rise and
# fall together, since temperature changes all of them.

# %%
import textwrap

import numpy as np
from scipy import stats

import emcee_femu as ef

frequencies = [  # Hz, one row per test, one column per mode
    [2.341, 6.601],
    [2.352, 6.644],
    [2.347, 6.615],
    [2.361, 6.663],
    [2.339, 6.587],
    [2.355, 6.638],
]
shapes = [  # (n_tests, n_sensors, n_modes), of any scale and sign
    [[0.74, 1.02], [1.00, -0.99]],
    [[0.75, 0.99], [1.01, -0.98]],
    [[-0.73, 1.00], [-0.99, -1.01]],
    [[0.74, 0.98], [1.02, -0.99]],
    [[0.76, 1.01], [1.00, -0.97]],
    [[0.75, -1.00], [0.98, 1.00]],
]
places = {"sensors": ["floor 1", "roof"], "dofs": [0, 1]}
test = ef.Measurements.from_repeats(frequencies, shapes, **places)
test

# %% [markdown]
# `test.frequencies` are the means, `test.covariance` is the covariance *of one test*:

# %%
sd = np.sqrt(np.diag(test.covariance))
(test.covariance / np.outer(sd, sd)).round(2)  # correlation of the two modes

# %% [markdown]
# It is not divided by the number of tests. Errors that all tests share, from mounting,
# temperature or the model, do not average out, and a posterior that shrinks as
# $1/\sqrt{N}$ would be overconfident. If your tests are truly independent and of the
# same state, divide yourself: `ef.Measurements(test.frequencies,
# covariance=test.covariance / 6)`.
#
# If a test missed a mode, write `nan` for its frequency and give `correlated=False`: mean
# and standard deviation are those of the tests that found it.
#
# Each test's shape is scaled to unit length and given the sign of the others, real or
# complex; `shapes` is the mean and `shape_sd` the scatter. If the modes of a test are
# out of order, its shapes reveal it:

# %%
swapped = [*shapes[:5], [row[::-1] for row in shapes[5]]]
try:
    ef.Measurements.from_repeats(frequencies, swapped)
except ValueError as error:
    message = str(error)
    print(textwrap.fill(message, 80))

# %% [markdown]
# A full covariance needs more tests than modes. With fewer, `correlated=False` gives
# one standard deviation per mode, for which two tests are enough.
#
# ## In a posterior
#
# {py:class}`~emcee_femu.FrequencyTerm` uses the covariance,
# {py:class}`~emcee_femu.ShapeTerm` the scatter of the shapes, sensor by sensor.

# %%
storeys = {"k1": (0, 1, 7e3), "k2": (1, 2, 7e3)}  # kN/m
model = ef.MassSpringModel([12.0, 9.0], storeys, shapes=True)  # t
terms = [ef.FrequencyTerm(test), ef.ShapeTerm(test)]
prior = ef.IndependentPrior(dict.fromkeys(storeys, stats.lognorm(0.3, scale=7e3)))
run = ef.run(ef.LogPosterior(model, terms, prior), seed=1)
ef.parameter_table(run)

# %% [markdown]
# If each test deserves its own posterior, because the structure changes from test to
# test, {py:func}`~emcee_femu.pool_tests` infers what varies: [many
# tests](../tutorials/many_tests.py).

# %% tags=["remove-cell"]
mean = np.mean(frequencies, axis=0)
np.testing.assert_allclose(test.frequencies, mean)
np.testing.assert_allclose(test.covariance, np.cov(np.transpose(frequencies)))
assert (test.covariance / np.outer(sd, sd))[0, 1] > 0.9  # they rise together
np.testing.assert_allclose(np.linalg.norm(test.shapes, axis=0), 1, atol=1e-3)
assert "mode 1 of test 6" in message
assert ef.diagnose(run).converged
