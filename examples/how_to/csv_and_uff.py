# %% [markdown]
# # Read measured modes
#
# For everybody whose modes are in arrays, in a CSV file that you fill in yourself, in
# a universal file of a test system, in an identification by pyOMA2, or in several
# tests of one structure. What comes out is {py:class}`~emcee_femu.Measurements`, the
# one object that terms and pairing take. `python examples/how_to/csv_and_uff.py` runs
# the page. Its numbers are made up.
#
# ## From arrays
#
# Frequencies are in Hz and ascending. Shapes have one row per sensor, one column per
# mode, in any scale. `dofs` gives the sensors' places in the model, by number or by a
# label such as `"3:uy"`. A model that knows the DOFs of its shapes is matched by them,
# in any order; a missing DOF raises an error. A sensor that points backwards has a sign,
# `"3:-uy"`: its row of shapes is turned. NaN is what is not known: a sensor that was
# missing in one mode, or a standard deviation or damping ratio of one mode.

# %% tags=["result"]
import tempfile
import textwrap
from pathlib import Path

import numpy as np

import emcee_femu as ef

folder = Path(tempfile.mkdtemp())
shapes = [[1.0, -0.83], [0.45, 1.0]]
places = {"sensors": ["roof", "floor 1"], "dofs": ["3:uy", "1:uy"]}
test = ef.Measurements([2.35, 6.62], sd=[0.01, 0.03], shapes=shapes, **places)
test

# %% [markdown]
# ## From CSV
#
# The same test as a file, from any spreadsheet:

# %%
table = """quantity,sensor,dof,mode 1,mode 2
frequency [Hz],,,2.35,6.62
sd [Hz],,,0.01,0.03
shape,roof,3:uy,1.0,-0.83
shape,floor 1,1:uy,0.45,1.0
"""
(folder / "test.csv").write_text(table, encoding="utf-8")
read = ef.Measurements.from_csv(folder / "test.csv")
read

# %% [markdown]
# The first line has the titles `quantity,sensor,dof`, then one per mode. The first cell
# of a row says what it holds; only the frequencies are required.
#
# | row | how many | holds |
# |---|---|---|
# | `frequency [Hz]` | one | natural frequencies |
# | `sd [Hz]` | one | their standard deviations |
# | `covariance [Hz2]` | one per mode | in place of `sd [Hz]` |
# | `shape`, `shape sd` | one per sensor | shapes and their standard deviations |
# | `damping ratio`, `damping sd` | one | numbers, or percent as `damping [%]`; blank where not known |
# | `phase collinearity` | one | of shapes that were complex |
#
# `to_csv(path)` writes such a file with all digits. An unreadable cell raises an error
# with its line and column. Semicolons with decimal commas, and the usual words in any
# case (`Freq (Hz)`, `std`, `zeta`), are read too. If a sensor was missing in one mode,
# leave its cell of `shape` blank, or use NaN in an array: that mode is compared at the
# other sensors. A mode that was not identified has no column.
#
# ## From a universal file (UFF)
#
# Test systems export modes as data sets 55 of a universal file (UFF), FE programs as data
# sets 2414. Here are two complex modes at three nodes in x. They are written by pyuff;
# reading modes needs nothing.

# %% tags=["hide-input"]
import pyuff

modes = {2.35: [0.45, 0.83 + 0.02j, 1.0], 6.62: [1.0, 0.1 - 0.03j, -0.83]}
nothing = np.zeros(3, dtype=complex)
for number, (hertz, x) in enumerate(modes.items()):
    mode = pyuff.prepare_55(
        id1="Test of a frame", analysis_type=3, data_ch=2, spec_data_type=8,
        data_type=5, n_data_per_node=3, load_case=1, mode_n=number + 1,
        r1=np.array(x, dtype=complex), r2=nothing, r3=nothing,
        node_nums=np.array([1, 2, 3]), eig=2j * np.pi * hertz, modal_a=0j, modal_b=0j,
    )  # fmt: skip
    how = "overwrite" if number == 0 else "add"
    pyuff.UFF(str(folder / "test.uff")).write_sets(mode, how)

# %%
nodes = {"sensors": ["1:x", "2:x", "3:x"], "dofs": [0, 1, 2]}
from_uff = ef.Measurements.from_uff(folder / "test.uff", **nodes)
from_uff

# %% [markdown]
# A sensor is a node and a direction, `"2:x"`. If the model labels its DOFs, say which of
# its nodes are those of the file, in place of `dofs`:
# `Measurements.from_uff("test.uff", nodes={1: 0, 2: 4, 3: 8})`. The sensor `"2:x"` is then
# at `"4:ux"`. A file may define axes of their own for nodes (displacement coordinate
# systems, data sets 18 or 2420), and programs differ in whether they write shapes along
# these or along the global ones. You are then asked: with `axes="own"` a sensor is a
# combination by direction cosines, such as `"0.8*4:ux + 0.6*4:uy"`, with `axes="global"`
# it is left as it is. If you do not know, compare the MAC of both. Without `sensors=` all are used except
# those that are zero in all modes; a warning names them. `modes=[2, 3]` reads the second
# and third mode of the file only. Frequencies are undamped and in Hz whatever the units
# of the file, which holds no standard deviations: give them to the term,
# `ef.FrequencyTerm(test, relative_sd=0.01)`, or repeat the test (below).
#
# Complex shapes are made real, each by the phase at which its real part is largest. The
# column MPC, modal phase collinearity, says what this neglects: it is 1 if all sensors
# move in phase or in opposite phase. Below 0.9 there is a warning.
#
# ## From pyOMA2
#
# `Measurements.from_pyoma2(algorithm.result)`: {doc}`ambient_vibration`. Frequency
# response functions come from data sets 58: {doc}`frf`.
#
# ## From repeated tests
#
# Six tests of a frame on six days; the frequencies of a day rise and fall together,
# since temperature changes all of them.

# %%
frequencies = [  # Hz, one row per test, one column per mode
    [2.341, 6.601], [2.352, 6.644], [2.347, 6.615],
    [2.361, 6.663], [2.339, 6.587], [2.355, 6.638],
]  # fmt: skip
repeats = [  # (n_tests, n_sensors, n_modes), of any scale and sign
    [[1.00, -0.99], [0.74, 1.02]], [[1.01, -0.98], [0.75, 0.99]],
    [[-0.99, -1.01], [-0.73, 1.00]], [[1.02, -0.99], [0.74, 0.98]],
    [[1.00, -0.97], [0.76, 1.01]], [[0.98, 1.00], [0.75, -1.00]],
]  # fmt: skip
scattered = ef.Measurements.from_repeats(frequencies, repeats, **places)
scattered

# %%
sd = np.sqrt(np.diag(scattered.covariance))
(scattered.covariance / np.outer(sd, sd)).round(2)  # correlation of the two modes

# %% [markdown]
# The frequencies are the means, and the covariance is that *of one test*, not divided
# by the number of tests. Errors that all tests share, from mounting, temperature or the
# model, do not average out, and a posterior that shrinks as $1/\sqrt{N}$ would be
# overconfident. If your tests are truly independent and of the same state, divide
# yourself: `ef.Measurements(test.frequencies, covariance=test.covariance / 6)`. If the
# structure changes, each test has its own posterior: {doc}`/tutorials/many_tests`.
#
# A full covariance needs more tests than modes. With fewer, `correlated=False` gives
# one standard deviation per mode, for which two tests are enough. If a test missed a
# mode, write `nan` for its frequency, also with `correlated=False`. Each test's shape
# is scaled to unit length and given the sign of the others, real or complex; `shapes`
# is the mean and `shape_sd` the scatter. `ef.FrequencyTerm(test)` uses the covariance,
# and `ef.ShapeTerm(test)` the scatter, sensor by sensor. If the modes of a test are out
# of order, its shapes reveal it:

# %%
try:
    swapped = [*repeats[:5], [row[::-1] for row in repeats[5]]]
    ef.Measurements.from_repeats(frequencies, swapped)
except ValueError as error:
    message = str(error)
    print(textwrap.fill(message, 80))

# %% tags=["remove-cell"]
for name in ("frequencies", "sd", "shapes"):
    np.testing.assert_array_equal(getattr(read, name), getattr(test, name))
assert read.sensors == test.sensors and list(read.dofs) == list(test.dofs)
np.testing.assert_allclose(from_uff.frequencies, [2.35, 6.62], rtol=1e-6)
assert (from_uff.phase_collinearity > 0.99).all()
assert (from_uff.phase_collinearity < 1).all()
np.testing.assert_allclose(scattered.covariance, np.cov(np.transpose(frequencies)))
assert (scattered.covariance / np.outer(sd, sd))[0, 1] > 0.9  # they rise together
np.testing.assert_allclose(np.linalg.norm(scattered.shapes, axis=0), 1, atol=1e-3)
assert "mode 1 of test 6" in message
