# %% [markdown]
# # Write a report to hand over
#
# For those who hand over a result: write one HTML file that says what was measured,
# what was assumed, what the result is and how far it can be trusted; or put tables
# and figures into your own document, and pass the samples to ArviZ. `python
# examples/how_to/report.py` runs the page; it takes `pip install jinja2`.
#
# A steel mast of 6 m bends in one plane. Frequencies and shapes of three modes are simulated
# here, with accelerometers at 2, 4 and 6 m. How stiff are its lower and upper half?

# %%
import tempfile
from pathlib import Path

import numpy as np

import emcee_femu as ef

nodes = [(0, 0, z) for z in range(7)]  # m
bars = [(i, i + 1, "lower" if i < 3 else "upper") for i in range(6)]
sections = {
    "lower": ef.Section("E lower", 4e6, 7850, 8e-3, 4e-5, 4e-5, (0, 1, 0)),
    "upper": ef.Section("E upper", 4e6, 7850, 6e-3, 2e-5, 2e-5, (0, 1, 0)),
}
held = {0: "all"} | dict.fromkeys(range(1, 7), ("uy", "rx", "rz"))
mast = ef.FrameModel(nodes, bars, sections, held, n_modes=6, shapes=True)
truth = {"E lower": 1.9e11, "E upper": 2.2e11}  # N/m2
solved = mast({name: np.array([value]) for name, value in truth.items()})
sensors = ["2:ux", "4:ux", "6:ux"]
rows = [mast.shape_dofs.index(sensor) for sensor in sensors]
rng = np.random.default_rng(1)
shapes = solved.shapes[0, rows, :3]
shapes = shapes / np.abs(shapes).max(axis=0) + 0.02 * rng.standard_normal((3, 3))
hertz = solved.frequencies[0, :3] * (1 + 0.003 * rng.standard_normal(3))
test = ef.Measurements(hertz, shapes, dofs=sensors, sensors=["2 m", "4 m", "6 m"])

terms = [ef.FrequencyTerm(test, relative_sd=0.01), ef.ShapeTerm(test, delta=0.05)]
prior = ef.GaussianPrior([*truth], [2.1e11] * 2, 2e10, [(1e11, 3e11)] * 2)
units = dict.fromkeys(truth, "N/m^2")
posterior = ef.LogPosterior(ef.PairedModel(mast, test), terms, prior, units)
run = ef.run(posterior, seed=1)

# %% [markdown]
# {py:func}`~emcee_femu.report` takes the run. Give units to the posterior and sensor
# names to the measurements: the reader sees them. `text=` has what only you can say, and
# `derived=` what follows from the parameters, each a function of them and a unit.

# %%
path = Path(tempfile.mkdtemp(), "mast.html")
text = {
    "project": "Mast 12",
    "author": "A. Engineer",
    "structure": "Steel mast of 6 m, clamped at its foot; accelerometers at 2, 4 and 6 m.",
    "question": "Is one of its halves softer than the drawings say (210 GPa)?",
    "conclusion": "The lower half is softer. We recommend an inspection of its welds.",
}
derived = {"fall of E lower": (lambda p: 100 - 100 * p["E lower"] / 2.1e11, "%")}
title = "Mast: stiffness of its two halves"
ef.report(run, path, title=title, text=text, derived=derived).name

# %% [markdown]
# This is the file. The first page has the question, the result and how far it can be
# trusted; how to repeat it is at the end. Its pictures are inside, so you can send it.

# %%
import html


class Page(str):
    _repr_html_ = str.__str__  # a notebook shows it as HTML


page = html.escape(path.read_text(encoding="utf-8"))
style = "width: 100%; height: 40rem; border: 1px solid #888"
Page(f'<div><iframe title="The report" srcdoc="{page}" style="{style}"></iframe></div>')

# %% [markdown]
# For saved samples write `ef.report(idata, "mast.html", posterior=posterior)`: the
# likelihood in words and the mode shapes need the model. To a model without a geometry
# give one before pairing, `model.geometry = ef.Geometry(...)`. Results of
# {py:func}`~emcee_femu.certify` and {py:func}`~emcee_femu.pool_tests` have reports, too.
#
# ## Tables and figures in your own document
#
# A table prints itself, rounded; `to_frame` has all digits, and pandas writes CSV, LaTeX
# or Markdown. `table.column("mean")` is one column. {doc}`/start/reading` defines the
# columns. `true=` adds known values and the errors against them.

# %%
frame = ef.parameter_table(run, true=truth).to_frame()
frame.to_csv(path.with_name("parameters.csv"), index=False)
print(frame[["parameter", "mean", "sd/prior sd"]].to_latex(index=False))

# %% [markdown]
# Each function of `ef.figures` returns a matplotlib figure, with the units of the
# posterior ({doc}`gallery`). You can change its axes, and save it for print; text stays
# text. `truths=` marks values in blue, `var_names=` chooses the parameters, and a
# quantity that you write into the ArviZ object is one of them:

# %% tags=["result"] mystnb={"image": {"alt": "Histograms and scatter of the modulus of the lower half and of its ratio to that of the upper half"}}
idata = ef.to_inference_data(run)
samples = idata["posterior"]
samples["lower / upper"] = samples["E lower"] / samples["E upper"]
figure = ef.figures.plot_scatter(idata, var_names=["E lower", "lower / upper"])
figure.savefig(path.with_name("scatter.pdf"), bbox_inches="tight")
figure

# %% [markdown]
# In {py:func}`~emcee_femu.figures.plot_mac` a number near 1 outside the frames means
# that these sensors cannot distinguish two modes.
#
# Save the samples with `idata.to_netcdf("run.nc")`, and read them with
# `arviz.from_netcdf`: tables and figures can be made again without a solve. (ArviZ 1
# needs `pip install h5netcdf h5py` for this.)
#
# ## ArviZ
#
# `idata` is an ArviZ object, before or since version 1. Its groups are listed at
# {py:func}`~emcee_femu.to_inference_data`; each walker is a chain.

# %%
import arviz as az

az.summary(idata)

# %% [markdown]
# - ArviZ's `r_hat` compares walkers. Those of one ensemble are not independent, so it
#   shows only how well they mix. {py:func}`~emcee_femu.diagnose` compares ensembles.
# - Plots with a line for each of 64 chains cannot be read: `combined=True` takes them
#   as one, as in `az.plot_forest(idata, combined=True)`.
# - The group `posterior_predictive` holds 500 new measurements, with their error:
#   `arviz.plot_ppc`, since version 1 `plot_ppc_dist`, draws the density of all modes
#   together; {py:func}`~emcee_femu.figures.plot_predictive` draws each.
# - `isel(draw=...)` and `isel(chain=...)` take the same places in every group, and
#   those of `prior` and `posterior_predictive` are not those of the chain. Give
#   `discard=` and `thin=` when you convert.
# - Draws that {py:func}`~emcee_femu.certify` corrected have weights, which ArviZ
#   ignores. A tempered run is converted without its hot walkers.
# - Cross-validation: {doc}`/tutorials/model_classes`. Samples of plain emcee, also by
#   `arviz.from_emcee`: {doc}`/start/emcee_users`.

# %% tags=["remove-cell"]
page = path.read_text(encoding="utf-8")
table = ef.parameter_table(run)
assert table._repr_html_() in page
assert page.count("<img") == 6  # first page, fit, MAC, shapes, parameters, pairs
assert "http" not in page
assert page.index(text["conclusion"]) < page.index("Prior and posterior")
low, high = (np.array(table.column(name)) for name in ("2.5 %", "97.5 %"))
assert (np.abs([*truth.values()] - (low + high) / 2) < 1.5 * (high - low)).all()
assert list(frame.columns) == list(ef.parameter_table(run, true=truth).columns)
assert path.with_name("scatter.pdf").stat().st_size > 10_000
assert idata["posterior_predictive"]["frequency"].shape == (1, 500, 3)
