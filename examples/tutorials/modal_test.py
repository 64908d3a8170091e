# %% [markdown]
# # A modal test, from CSV to verdict
#
# For everybody with a table of measured frequencies and mode shapes: this page
# updates a frame model with it, checks whether the result can be trusted, and reports
# it. `python examples/tutorials/modal_test.py` runs the page: it prints the tables, and
# leaves the file, the figures and a report in `figures/modal_test`.
#
# The test is simulated: the structure is a two-storey steel frame of one bay, 6.0 m
# by 5.6 m; eight accelerometers found six modes. The stiffnesses of the columns, of
# the beams along x and of the beams along y are unknown.
#
# ## What was measured
#
# Write the test report as a CSV file. `sensor` is any name; `dof` is its place in the
# model: `8:ux` is the displacement of node 8 along x. [Measured
# modes](../how_to/csv_and_uff.py) has all rows.

# %%
from pathlib import Path

import numpy as np
from scipy import stats

import emcee_femu as ef

directory = Path("figures/modal_test")
directory.mkdir(parents=True, exist_ok=True)
(directory / "test.csv").write_text("""\
quantity,sensor,dof,mode 1,mode 2,mode 3,mode 4,mode 5,mode 6
frequency [Hz],,,1.684,1.742,2.103,5.077,5.147,6.279
sd [Hz],,,0.003,0.003,0.004,0.010,0.010,0.013
shape,A1x,4:ux,-0.01,0.38,0.52,0.04,0.76,1.00
shape,A1y,4:uy,0.54,0.04,-0.47,0.98,0.10,-0.84
shape,C1x,6:ux,0.02,0.52,-0.30,-0.02,1.00,-0.63
shape,C1y,6:uy,0.55,-0.05,0.46,1.00,-0.14,0.90
shape,A2x,8:ux,0.09,0.80,1.00,0.01,-0.44,-0.54
shape,A2y,8:uy,0.93,0.14,-0.84,-0.60,-0.07,0.50
shape,C2x,10:ux,0.02,1.00,-0.61,-0.00,-0.52,0.31
shape,C2y,10:uy,1.00,-0.08,0.86,-0.54,0.05,-0.50
""")
test = ef.Measurements.from_csv(directory / "test.csv")
print(test)

# %% [markdown]
# The standard deviations are 0.2 %, the scatter of a good modal test. The numbers are
# simulated, so the truth is known: columns, beams x and beams y have 0.95, 1.15 and
# 0.85 of their nominal stiffness. **The floors of the true frame are heavier on one
# side**, which the model below does not know. So no parameters make it fit exactly.
#
# ## The model
#
# Any consistent units will do. Here they are GN, m, s and, therefore, 10⁶ t; E is in
# GPa. Each property of a section is a number or the name of a parameter.

# %%
WIDTH_X, WIDTH_Y, HEIGHT = 6.0, 5.6, 3.5  # m
COLUMN = {"A": 9e-3, "Iy": 4e-5, "Iz": 4e-5, "orientation": (1, 0, 0)}
BEAM = {"A": 2e-2, "Iy": 9e-4, "Iz": 1.2e-4}


def frame(light, heavy):  # density of beams with floors, at either side
    rho = {"x light": light, "x heavy": heavy, "y": (light + heavy) / 2}
    E = {"x light": "beams x", "x heavy": "beams x", "y": "beams y"}
    sections = {n: ef.Section(E=E[n], GJ=4e-5, rho=rho[n], **BEAM) for n in E}
    sections["column"] = ef.Section(E="columns", GJ=4e-5, rho=7.85e-6, **COLUMN)
    plan = [(0, 0), (WIDTH_X, 0), (WIDTH_X, WIDTH_Y), (0, WIDTH_Y)]
    nodes = [(x, y, HEIGHT * storey) for storey in range(3) for x, y in plan]
    columns = [(i, i + 4, "column") for i in range(8)]
    sides = ["x light", "y", "x heavy", "y"] * 2
    ends = [5, 6, 7, 4, 9, 10, 11, 8]
    beams = [(i + 4, ends[i], sides[i]) for i in range(8)]
    bars, supports = columns + beams, dict.fromkeys(range(4), "all")
    return ef.FrameModel(nodes, bars, sections, supports, n_modes=12, shapes=True)


model = frame(4e-5, 4e-5)
nominal = {name: np.array([210.0]) for name in model.names}
print(model(nominal).frequencies[0, :6].round(3), "Hz, nominal")

# %% [markdown]
# ## Which mode is which
#
# Sway along x and sway along y have close frequencies, and may change order as the
# stiffnesses change. For each parameter set, {py:class}`~emcee_femu.PairedModel` pairs
# every measured mode with the mode of the model that looks like it (the largest MAC,
# one to one). It searches twice as many modes as were measured. [Crossing
# modes](crossing_modes.py) shows what happens without pairing.

# %%
paired = ef.PairedModel(model, test)
pairing = paired(nominal)
print("measured modes", np.arange(1, 7))
print("model's modes ", pairing.model_mode[0])
print("MAC           ", pairing.mac[0].round(2))

# %% [markdown]
# Check this line before any sampling. A MAC below 0.9 for all modes points to wrong
# sensor positions or signs, which no parameter can repair.
#
# ## What is known before the test
#
# A lognormal prior keeps a stiffness positive: here 210 GPa, known to about 20 %. Two
# more parameters describe the error of the model itself: `frequency error` is its
# relative standard deviation in frequencies, on top of the measured 0.2 %, and
# `shape error` the standard deviation at one sensor for a shape of unit length.

# %%
priors = dict.fromkeys(model.names, stats.lognorm(0.2, scale=210))  # GPa
priors |= {"frequency error": stats.halfnorm(scale=0.02)}
priors |= {"shape error": stats.halfnorm(scale=0.1)}
prior = ef.IndependentPrior(priors)
terms = [ef.FrequencyTerm(test, discrepancy="frequency error")]
terms += [ef.ShapeTerm(test, discrepancy="shape error")]
units = dict.fromkeys(model.names, "GPa")
posterior = ef.LogPosterior(paired, terms, prior, units)

# %% [markdown]
# ## Sampling, and the verdict
#
# {py:func}`~emcee_femu.run` first searches for all maxima of the posterior and builds a
# proposal from them. Four independent ensembles of walkers then sample with it, since
# only chains with separate starts can disagree. It ends when they have converged.

# %%
run = ef.run(posterior, seed=2)
idata = ef.to_inference_data(run)
diagnosis = ef.diagnose(run)
print(diagnosis)

# %% [markdown]
# Read the last three lines first. Go on only if they say "Chains: converged". "Search"
# says how small a maximum may be missing, "Fit" whether the updated model predicts what
# was measured. [Reading the tables](../start/reading.md) explains the columns, [the
# verdict](../explanation/verdict.py) what to do if a statement is another.
#
# ## What was learned

# %%
print(ef.parameter_table(idata))

# %% [markdown]
# The model's own error is inferred at 0.7 % in frequency, more than three times the
# scatter of the test. With the 0.2 % alone the intervals would be far too narrow: see
# [noise and model error](noise_and_model_error.py).

# %% mystnb={"image": {"alt": "Scatter of three stiffnesses with 95 % ellipses, and of two errors, whose regions have a tail upwards; lines mark the true stiffnesses, inside each ellipse"}}
truth = {"columns": 0.95 * 210, "beams x": 1.15 * 210, "beams y": 0.85 * 210}
ef.figures.plot_scatter(idata, truths=truth).savefig(directory / "scatter.png")

# %% [markdown]
# If the columns are stiffer, the beams must be softer for the same frequency. The true
# values, in blue, lie inside.
#
# ## Does the updated model fit?
#
# Frequencies before and after, with their errors and the total average error:

# %%
print(ef.frequency_table(idata))

# %% mystnb={"image": {"alt": "Deviations of six frequencies in percent before and after updating, and their MAC"}}
ef.figures.plot_predictive(idata, posterior).savefig(directory / "fit.png")

# %% [markdown]
# A new measurement should lie on the thin line with 95 % probability, model error
# included; zero is the measured value. The MAC is about 0.97 for the modes that the
# uneven floors twist, so that the shape error is inferred at 0.06, three times the 0.02
# with which the sensors were simulated.
#
# The measured shapes (red) and the updated model (blue): sway along y, x, and torsion.

# %% tags=["result"] mystnb={"image": {"alt": "Three mode shapes of the frame: grey at rest, blue the updated model, red lines with dots what eight sensors measured; the dots are near the model"}}
ef.figures.plot_shapes(run, modes=[1, 2, 3]).savefig(directory / "shapes.png")

# %%
print(ef.pairing_table(idata))

# %% [markdown]
# In some samples the sway modes have changed places (last column). If the fit is bad,
# do not report numbers: look at the inferred errors, and at the sentences of
# {py:func}`~emcee_femu.identifiability`:

# %%
print(*ef.identifiability(idata).findings, sep="\n")

# %% [markdown]
# ## Hand it over
#
# One HTML page has all of it ({doc}`/how_to/report`; `pip install jinja2`):

# %%
print(ef.report(run, directory / "report.html", title="Two-storey frame"))

# %% [markdown]
# A few lines say how it was done:
#
# *Prior: lognormal, 210 GPa, 20 %, for each stiffness; half-normal for the errors.
# Likelihood: six frequencies with 0.2 % of measurement error and an inferred model
# error; six shapes at eight sensors. Modes paired by MAC. Four ensembles, run until
# they had converged.* A colleague needs no more to repeat it.
#
# Next: [which parameters can be learned](what_is_learned.py), before and after a test;
# or [your own FE program](../how_to/fe_programs.md) in place of the frame.

# %% tags=["remove-cell"]
assert diagnosis.converged
draws = idata["posterior"]
true = frame(3.4e-5, 4.6e-5)({name: np.array([x]) for name, x in truth.items()})
off = (true.frequencies[0, :6] - test.frequencies) / test.sd
assert np.abs(off).max() < 3  # the file is a test of the true frame, scattered by 0.2 %
for name, value in truth.items():
    x = draws[name].values
    assert abs(x.mean() - value) < 2.5 * x.std()
left = ef.parameter_table(idata).column("sd/prior sd")  # columns, beams x, beams y
assert left[0] < 0.1 < left[2] < left[1] < 0.4
assert 0.006 < draws["frequency error"].values.mean() < 0.009
assert set(ef.predictive_table(idata, posterior).column("inside")) == {"yes"}
assert "The data inform every parameter" in ef.identifiability(idata).findings[0]
assert 0.04 < draws["shape error"].values.mean() < 0.08
assert pairing.mac.min() > 0.9 and [*pairing.model_mode[0]] == [2, 1, 3, 5, 4, 6]
wrong = ef.pairing_table(idata).column("wrong by index in %")
assert 0.2 < wrong[-1] < 10
