# %% [markdown]
# # Sensors that are no DOF
#
# For tests with a sensor that is skew, a strain gauge, or the difference of two
# points: each is a **combination of DOFs**, `{DOF: factor}`, and is given wherever a
# DOF is. `python examples/how_to/sensors.py` runs the page; its numbers are
# simulated.
#
# | sensor | `dofs=[...]` of the measurements |
# |---|---|
# | along an axis of the model | `"2:ux"` |
# | turned round | `"2:-ux"` |
# | skew, by the cosines of its direction | `{"2:ux": 0.8, "2:uy": 0.6}` |
# | a difference of two points | `"4:uy - 2:uy"`, or `{"4:uy": 1, "2:uy": -1}` |
# | the mean of two points | `{"2:ux": 0.5, "3:ux": 0.5}` |
# | on a rigid arm, 0.2 m above the node | `{"3:ux": 1, "3:rz": -0.2}` |
# | a strain gauge of a beam | `{"2:rz": -h / L, "1:rz": h / L}` |
#
# The strain at the distance `h` from the axis of a beam is $-h\,\partial^2 u_y/\partial
# x^2$, and the curvature between nodes 1 and 2, `L` apart, is the difference of their
# rotations by `L`. In a CSV file write the combination as a text, in the column `dof`:
# `0.8*2:ux + 0.6*2:uy`.

# %% tags=["result"]
import numpy as np

import emcee_femu as ef

nodes = [(0.0, 0.0), (0.3, 0.4), (0.6, 0.8), (1.0, 1.1), (1.5, 1.1)]
bar = ef.Section(E=(2.1e11, "stiffness"), rho=7850, A=1e-3, I=2e-7)
bars = [(i, i + 1, "bar") for i in range(4)]
options = {"plane": "xy", "n_modes": 6, "shapes": True}
model = ef.FrameModel(nodes, bars, {"bar": bar}, {0: "fixed"}, **options)

skew = {"1:ux": 0.8, "1:uy": -0.6}  # across the first bar
test = ef.Measurements(
    [10.7, 57.7],
    dofs=[skew, "3:uy", "4:uy - 2:uy"],
    shapes=[[-0.18, -0.23], [0.75, -0.05], [1.00, -1.00]],
    sensors=["across", "right", "opening"],
)
paired = ef.PairedModel(model, test)
print(paired({"stiffness": np.array([1.0])}).mac.round(3))

# %% [markdown]
# The model returns shapes at all its DOFs (`shapes=True`), and the pairing takes the
# combinations from them. Any model that returns shapes will do: a
# {py:class}`~emcee_femu.MatrixModel`, with numbers of DOFs in place of labels; a function;
# an [FE program](fe_programs.md). A model can also combine them itself and give the sensor
# a name, `FrameModel(..., shapes={"across": {"1:ux": 0.8, "1:uy": -0.6}})`; the
# measurements then have `dofs=["across"]`. `points` of a
# {py:class}`~emcee_femu.StaticModel` take the same.
#
# ## Strains
#
# **A strain is not a displacement.** A MAC over both would depend on the unit of length.
# Strains and rotations are therefore left out of the MAC beside translations, and a
# {py:class}`~emcee_femu.ShapeTerm` asks for `sd=`, one standard deviation for each
# sensor. A combination counts as a strain if rigid motions leave it at zero and its
# factors are not those of a plain difference. A strain over a length of exactly 1 looks
# like a plain difference; no factor tells the two apart. A sensor that the model has named
# is refused where its unit differs.
#
# In a drawing, a sensor that combines DOFs of one node is drawn along its axis. One that
# combines several nodes is compared, but has no place to be drawn.

# %% tags=["remove-cell"]
unit = {"stiffness": np.array([1.0])}
assert paired(unit).mac.min() > 0.99
shapes, rows = model(unit).shapes[0], {dof: i for i, dof in enumerate(model.dofs)}
across = 0.8 * shapes[rows["1:ux"]] - 0.6 * shapes[rows["1:uy"]]
seen = paired(unit).shapes[0, 0]
np.testing.assert_allclose(seen, across[:2])
gauge = {"2:rz": -0.01 / 0.5, "1:rz": 0.01 / 0.5}
with_gauge = ef.Measurements(
    test.frequencies,
    dofs=[skew, "3:uy", "4:uy - 2:uy", gauge],
    shapes=[*test.shapes, [7.0, 8.0]],
)
np.testing.assert_allclose(
    ef.PairedModel(model, with_gauge)(unit).mac, paired(unit).mac
)
