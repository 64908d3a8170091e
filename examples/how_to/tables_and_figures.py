# %% [markdown]
# # Use tables and figures in a report
#
# Turn any table into a pandas frame, and so into CSV, LaTeX or Markdown. Give figures
# units and reference values, and save them for print. Pass the samples to ArviZ, corner and netCDF.
# `python examples/how_to/tables_and_figures.py` runs this page (10 s).

# %%
import tempfile
from pathlib import Path

import emcee_femu as ef

folder = Path(tempfile.mkdtemp())
problem = ef.paper.mass_spring()
posterior = problem.posterior
run = ef.run(posterior, seed=1)
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
# replace the ellipse; `ellipse=True` draws ellipses everywhere. {doc}`gallery` has all
# figures, each with the line that draws it.
#
# For print, save a vector format; text stays text. You can change the axes first, as of
# any figure.

# %%
figure.savefig(folder / "scatter.pdf", bbox_inches="tight")
figure.savefig(folder / "scatter.png", dpi=300, bbox_inches="tight")
sorted(path.name for path in folder.iterdir())

# %% [markdown]
# A script that draws many figures closes each, `plt.close(figure)`.
#
# {py:func}`~emcee_femu.figures.plot_shapes` needs the nodes and the lines that join
# them. A frame has them, and so have matrices of OpenSees, PyNite and scikit-fem. To
# others give `geometry=ef.Geometry(nodes, lines, sensors)`, which also places sensors
# whose DOF is not named by its node, or set `model.geometry` before pairing. With
# `shapes=True` the model returns its shapes at all nodes, so the whole structure moves;
# with shapes at the sensors only, it moves only there.
#
# In {py:func}`~emcee_femu.figures.plot_mac` a framed cell is a pair, with the 95 %
# interval of its MAC. A number near 1 outside the frames means that these sensors cannot
# distinguish two modes.
#
# ## ArviZ, corner and your own
#
# `idata` is an ArviZ object in which each walker is a chain: all functions of ArviZ work on
# it ({doc}`with_arviz` says what their results mean).
#
# corner, or anything else that takes an array, gets one column per parameter. A
# quantity computed from parameters is a column too, here a ratio of two stiffnesses:

# %% mystnb={"image": {"alt": "Corner plot of k1 and of the ratio k2 to k1"}}
import arviz
import corner
import numpy as np

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
