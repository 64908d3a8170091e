# %% [markdown]
# # Use tables and figures in a report
#
# Turn any table into a pandas frame, and so into CSV, LaTeX or Markdown. Give figures
# units and reference values, draw the structure and its mode shapes, and save figures
# for print. Pass the samples to ArviZ, corner and netCDF.
# `python examples/how_to/tables_and_figures.py` runs this page (10 s) on simulated
# data.

# %%
import tempfile
from pathlib import Path

import emcee_femu as ef

folder = Path(tempfile.mkdtemp())
problem = ef.paper.mass_spring()
posterior = problem.posterior
run = ef.run(posterior, steps=150, ensembles=2, seed=1)
idata = ef.to_inference_data(run)

# %% [markdown]
# ## Tables
#
# A table prints itself, in a notebook too. {doc}`/start/reading` defines the columns.
# `true=` adds known true values and the errors against them; `before=` takes the
# model before updating, if it was not the prior mean.

# %%
table = ef.parameter_table(idata, true=problem.nominal)
table

# %% [markdown]
# The display is rounded; `to_frame` has all digits, and pandas writes them:

# %%
frame = table.to_frame()
frame.to_csv(folder / "parameters.csv", index=False)
print(frame[["parameter", "mean", "sd/prior sd"]].to_latex(index=False))

# %% [markdown]
# `table.column("mean")` is one column. The other tables work in the same way:
# {py:func}`~emcee_femu.frequency_table`, {py:func}`~emcee_femu.predictive_table`,
# {py:func}`~emcee_femu.pairing_table`. The results of {py:func}`~emcee_femu.diagnose`
# and {py:func}`~emcee_femu.identifiability` have their table in the attribute `table`.
#
# ## Figures
#
# Each function returns a matplotlib figure. Axes and tables have the units of the
# posterior, `LogPosterior(model, terms, prior, units={"k1": "N/m"})`. `truths` mark
# values in blue, `var_names` choose the parameters.

# %% mystnb={"image": {"alt": "Three parameters in pairs: samples in grey, 95 % ellipses in red, reference values in blue near the middle of the ellipses"}}
figure = ef.figures.plot_scatter(
    idata,
    var_names=["k1", "k2", "k4"],
    truths={name: problem.nominal[name] for name in ("k1", "k2", "k4")},
)
figure

# %% [markdown]
# If samples are not Gaussian, the smallest regions that hold 95 % and 50 % of them
# replace the ellipse; `ellipse=True` draws ellipses everywhere.
#
# The prior beside the posterior, each scaled by its maximum, shows what the data say
# about each parameter:

# %% mystnb={"image": {"alt": "Five panels, one per stiffness: the prior is a wide grey hill, the posterior a narrow red peak, the reference value a blue line through it"}}
ef.figures.plot_prior_posterior(run, units=problem.units, truths=problem.nominal)

# %% [markdown]
# For print, save a vector format; text stays text. You can change the axes first, as of
# any figure.

# %%
figure.savefig(folder / "scatter.pdf", bbox_inches="tight")
figure.savefig(folder / "scatter.png", dpi=300, bbox_inches="tight")
sorted(path.name for path in folder.iterdir())

# %% [markdown]
# {py:func}`~emcee_femu.figures.plot_tae`,
# {py:func}`~emcee_femu.figures.plot_correlation`,
# {py:func}`~emcee_femu.figures.plot_predictive` and the others in
# {doc}`/reference/index` work in the same way. A script that draws many figures closes
# each, `plt.close(figure)`.
#
# ## The structure
#
# Mode shapes are drawn on the structure. This simulated test of a two-storey frame has
# six accelerometers; a DOF is named by its node and direction:

# %%
import numpy as np

corners = [(0, 0), (5, 0), (5, 4), (0, 4)]
nodes = [(x, y, z) for z in (0, 3, 6) for x, y in corners]
columns = [(i, i + 4, "column") for i in range(8)]
beams = [(s + i, s + (i + 1) % 4, "beam") for s in (4, 8) for i in range(4)]
frame_model = ef.FrameModel(
    nodes,
    columns + beams,
    {
        "column": ef.Section("E columns", 4e6, 7850, 1.2e-2, 9e-5, 4e-5, (0, 1, 0)),
        "beam": ef.Section("E beams", 4e6, 12000, 1e-2, 6e-5, 1.2e-4),
    },
    supports=dict.fromkeys(range(4), "all"),
    n_modes=8,
    shapes=True,
)
truth = {"E columns": 2.0e11, "E beams": 1.8e11}
solved = frame_model({name: np.array([value]) for name, value in truth.items()})
sensors = ["8:ux", "8:uy", "10:ux", "10:uy", "4:ux", "6:uy"]
rows = [frame_model.shape_dofs.index(sensor) for sensor in sensors]
rng = np.random.default_rng(3)
shapes = solved.shapes[0, rows, :4]
shapes = shapes / np.abs(shapes).max(axis=0) + 0.03 * rng.standard_normal(shapes.shape)
hertz = solved.frequencies[0, :4] * (1 + 0.003 * rng.standard_normal(4))
test = ef.Measurements(hertz, shapes=shapes, dofs=sensors)

terms = [ef.FrequencyTerm(test, relative_sd=0.01), ef.ShapeTerm(test, delta=0.05)]
prior = ef.GaussianPrior([*truth], [2.1e11, 2.1e11], 3e10, [(1e11, 3.5e11)] * 2)
of_frame = ef.LogPosterior(ef.PairedModel(frame_model, test), terms, prior)
frame_run = ef.run(of_frame, steps=150, ensembles=2, seed=1)

# %% [markdown]
# {py:func}`~emcee_femu.figures.plot_shapes` needs the nodes and the lines that join
# them. A frame has them, and so have matrices of OpenSees, PyNite and scikit-fem. For
# others give `geometry=ef.Geometry(nodes, lines, sensors)`, which also places sensors
# whose DOF is not named by its node. With `shapes=True` the model returns its shapes at
# all nodes, so the whole structure moves; with shapes at the sensors only, it moves
# only there, and `Geometry(..., supports)` names the nodes at rest. A geometry that you
# set before pairing, `model.geometry = ef.Geometry(...)`, is drawn in a report too.

# %% mystnb={"image": {"alt": "Four mode shapes of a frame of two storeys: grey at rest, blue the updated model, red dots what six sensors measured, next to the circles of the model"}}
shapes_figure = ef.figures.plot_shapes(frame_run)
shapes_figure

# %% [markdown]
# {py:func}`~emcee_femu.figures.plot_mac` draws the MAC of all measured and model modes,
# before and after updating. A framed cell is a pair, with the 95 % interval of its MAC.
# A number near 1 outside the frames means that these sensors cannot distinguish two
# modes: here the third and the eighth, which differ at the corners without a sensor.

# %% mystnb={"image": {"alt": "Two matrices of four measured and eight model modes: near one on the diagonal, framed in red, and for the third measured and the eighth mode of the model"}}
mac_figure = ef.figures.plot_mac(frame_run)
mac_figure

# %% [markdown]
# ## ArviZ, corner and your own
#
# `idata` is an ArviZ object, before or since version 1, in which each walker is a
# chain. All functions of ArviZ work on it ({doc}`with_arviz` says what their results
# mean):

# %%
import arviz

arviz.summary(idata, var_names=["k1", "k2"])[["mean", "sd"]]

# %% [markdown]
# corner, or anything else that takes an array, gets one column per parameter. A
# quantity computed from parameters is a column too, here a ratio of two stiffnesses:

# %% mystnb={"image": {"alt": "Corner plot of k1 and of the ratio k2 to k1"}}
import corner

draws = {name: idata.posterior[name].values.ravel() for name in posterior.names}
pairs = np.column_stack([draws["k1"], draws["k2"] / draws["k1"]])
corner_figure = corner.corner(pairs, labels=["k1", "k2 / k1"])

# %% [markdown]
# Save the run itself with `idata.to_netcdf`, and read it with `arviz.from_netcdf`:
# tables and figures can be made again without a solve. (ArviZ 1 needs a netCDF library
# for this: `pip install h5netcdf h5py`.)

# %%
idata.to_netcdf(folder / "run.nc")
again = arviz.from_netcdf(folder / "run.nc")
ef.parameter_table(again)

# %% tags=["remove-cell"]
import pandas

assert list(frame.columns) == list(table.columns)
read = pandas.read_csv(folder / "parameters.csv")
np.testing.assert_allclose(read["mean"], table.column("mean"), rtol=1e-14)
assert (folder / "scatter.pdf").stat().st_size > 10_000
assert str(ef.parameter_table(again)) == str(ef.parameter_table(idata))
for name, value in problem.nominal.items():
    assert abs(draws[name].mean() - value) < 4 * draws[name].std()
for name, value in truth.items():
    learned = ef.to_inference_data(frame_run).posterior[name].values
    assert abs(learned.mean() - value) < 4 * learned.std()
assert len(shapes_figure.axes) == 4
before, after = (axes.images[0].get_array() for axes in mac_figure.axes[:2])
assert (before.argmax(axis=1) == range(4)).all() and (
    after.argmax(axis=1) == range(4)
).all()
assert after[2, 7] > 0.95 > 0.3 > np.delete(after, [0, 1, 2, 3, 7], axis=1).max()
