# %% [markdown]
# # Take tables and figures into a report
#
# You will turn any table into a pandas frame, and so into CSV, LaTeX or Markdown, give
# figures units and reference values, save them for print, and hand the samples to ArviZ, corner and
# netCDF. `python examples/how_to/tables_and_figures.py` runs this page (5 s).

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
# A table prints itself, and shows itself in a notebook. {doc}`/start/reading` defines the
# columns. `nominal=` adds the true or assumed values and the errors against them.

# %%
table = ef.parameter_table(idata, nominal=problem.nominal)
table

# %% [markdown]
# What you see is rounded; `to_frame` has all digits, and pandas writes them:

# %%
frame = table.to_frame()
frame.to_csv(folder / "parameters.csv", index=False)
print(frame[["parameter", "mean", "sd/prior sd"]].to_latex(index=False))

# %% [markdown]
# `table.column("mean")` is one column. The other tables are made alike:
# {py:func}`~emcee_femu.frequency_table`, {py:func}`~emcee_femu.predictive_table`,
# {py:func}`~emcee_femu.pairing_table`; what {py:func}`~emcee_femu.diagnose` and
# {py:func}`~emcee_femu.identifiability` return has its table in the attribute `table`.
#
# ## Figures
#
# Each function returns a matplotlib figure. `units` label the axes, `truths` mark values
# in blue, `var_names` choose the parameters.

# %% mystnb={"image": {"alt": "Three parameters in pairs: samples in grey, 95 % ellipses in red, reference values in blue near the middle of the ellipses"}}
figure = ef.figures.plot_scatter(
    idata,
    var_names=["k1", "k2", "k4"],
    units=dict.fromkeys(["k1", "k2", "k4"], "N/m"),
    truths={name: problem.nominal[name] for name in ("k1", "k2", "k4")},
)
figure

# %% [markdown]
# For print save a vector format, in the width of the column; the text stays text. Axes can
# be changed before, as of any figure.

# %%
figure.set_size_inches(5.5, 5.5)
figure.savefig(folder / "scatter.pdf", bbox_inches="tight")
figure.savefig(folder / "scatter.png", dpi=300, bbox_inches="tight")
sorted(path.name for path in folder.iterdir())

# %% [markdown]
# {py:func}`~emcee_femu.figures.plot_tae`, {py:func}`~emcee_femu.figures.plot_correlation`,
# {py:func}`~emcee_femu.figures.plot_predictive` and the others in {doc}`/reference/index` work
# alike. A script that draws many figures closes each, `plt.close(figure)`.
#
# ## ArviZ, corner and your own
#
# `idata` is an ArviZ object, before or since version 1, in which each walker is a chain. All
# that ArviZ draws and computes is yours:

# %%
import arviz

arviz.summary(idata, var_names=["k1", "k2"])[["mean", "sd"]]

# %% [markdown]
# corner, or whatever else takes an array, gets one column per parameter. What you compute
# from parameters is a column as well, here a ratio of two stiffnesses:

# %% mystnb={"image": {"alt": "Corner plot of k1 and of the ratio k2 to k1"}}
import corner
import numpy as np

draws = {name: idata.posterior[name].values.ravel() for name in posterior.names}
columns = np.column_stack([draws["k1"], draws["k2"] / draws["k1"]])
corner_figure = corner.corner(columns, labels=["k1", "k2 / k1"])

# %% [markdown]
# Save the run itself with `idata.to_netcdf`, and read it with `arviz.from_netcdf`: tables and
# figures are made again without a solve. (With ArviZ 1 it takes `pip install h5netcdf`.)

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
