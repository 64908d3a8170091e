# %% [markdown]
# # Read measured modes from a file
#
# Read the modes of a test into {py:class}`~emcee_femu.Measurements`, the one object
# that terms and pairing take. They come from arrays, a CSV file that you fill in
# yourself, a universal file of a test system, or an identification by pyOMA2.
# `python examples/how_to/csv_and_uff.py` runs this page (2 s). Its numbers are made up.
#
# ## From arrays
#
# Frequencies are in Hz and ascending. Shapes have one row per sensor, one column per
# mode, in any scale. `dofs` gives the sensors' places in the model, by number or by a
# label such as `"3:uy"`. A model that knows the DOFs of its shapes is matched by them,
# in any order; a missing DOF raises an error. A sensor that points backwards has a sign,
# `"3:-uy"`: its row of shapes is turned. NaN is what is not known: a sensor that was
# missing in one mode, or a standard deviation or damping ratio of one mode.

# %%
import tempfile
from pathlib import Path

import numpy as np

import emcee_femu as ef

folder = Path(tempfile.mkdtemp())
test = ef.Measurements(
    [2.35, 6.62],
    sd=[0.01, 0.03],
    shapes=[[1.0, -0.83], [0.45, 1.0]],
    sensors=["roof", "floor 1"],
    dofs=["3:uy", "1:uy"],
)
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
# ## From a universal file
#
# Test systems export modes as data sets 55 of a universal file (UFF), FE programs as data
# sets 2414. Here are two complex modes at three nodes in x. They are written by pyuff;
# reading modes needs nothing.

# %% tags=["hide-input"]
import pyuff

shapes = {2.35: [0.45, 0.83 + 0.02j, 1.0], 6.62: [1.0, 0.1 - 0.03j, -0.83]}
nothing = np.zeros(3, dtype=complex)
for number, (hertz, x) in enumerate(shapes.items()):
    mode = pyuff.prepare_55(
        id1="Test of a frame", analysis_type=3, data_ch=2, spec_data_type=8,
        data_type=5, n_data_per_node=3, load_case=1, mode_n=number + 1,
        r1=np.array(x, dtype=complex), r2=nothing, r3=nothing,
        node_nums=np.array([1, 2, 3]), eig=2j * np.pi * hertz, modal_a=0j, modal_b=0j,
    )  # fmt: skip
    how = "overwrite" if number == 0 else "add"
    pyuff.UFF(str(folder / "test.uff")).write_sets(mode, how)

# %%
from_uff = ef.Measurements.from_uff(
    folder / "test.uff", sensors=["1:x", "2:x", "3:x"], dofs=[0, 1, 2]
)
from_uff

# %% [markdown]
# A sensor is a node and a direction, `"2:x"`. Without `sensors=` all are used except
# those that are zero in all modes; a warning names them. `modes=[2, 3]` reads the second
# and third mode of the file only. Frequencies are undamped and in Hz whatever the units
# of the file, which holds no standard deviations: give them to the term,
# `ef.FrequencyTerm(test, relative_sd=0.01)`, or repeat the test, see
# {doc}`repeated_tests`.
#
# Complex shapes are made real, each by the phase at which its real part is largest. The
# column MPC, modal phase collinearity, says what this neglects: it is 1 if all sensors
# move in phase or in opposite phase. Below 0.9 there is a warning.
#
# ## From pyOMA2
#
# `Measurements.from_pyoma2(algorithm.result)`: {doc}`ambient_vibration`. Frequency
# response functions come from data sets 58, see {doc}`frf`.

# %% tags=["remove-cell"]
for name in ("frequencies", "sd", "shapes"):
    np.testing.assert_array_equal(getattr(read, name), getattr(test, name))
assert read.sensors == test.sensors and list(read.dofs) == list(test.dofs)
np.testing.assert_allclose(from_uff.frequencies, [2.35, 6.62], rtol=1e-6)
assert (from_uff.phase_collinearity > 0.99).all()
assert (from_uff.phase_collinearity < 1).all()
