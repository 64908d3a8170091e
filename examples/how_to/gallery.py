# %% [markdown]
# # A gallery of figures
#
# For those who look for a figure: every figure of the package, with the line that
# draws it. `python examples/how_to/gallery.py` runs the page. Each function
# returns a matplotlib figure: save it with `figure.savefig("name.pdf")`.
# {doc}`report` explains more.
#
# The structure is a simulated shear building of three storeys with two measured modes.

# %%
import numpy as np

import emcee_femu as ef

springs = {"k1": (0, 1, 20e3), "k2": (1, 2, 20e3), "k3": (2, 3, 20e3)}  # kN/m
model = ef.MassSpringModel([20.0, 20.0, 20.0], springs, shapes=True)
nodes = {i: (0, 3.0 * i) for i in range(4)}
lines = [(i, i + 1) for i in range(3)]
model.geometry = ef.Geometry(nodes, lines, {i: (i + 1, "ux") for i in range(3)})
truth = {"k1": 18e3, "k2": 21e3, "k3": 20e3}
solved = model({name: np.array([value]) for name, value in truth.items()})
test = ef.Measurements(solved.frequencies[0, :2], solved.shapes[0, :, :2])
paired = ef.PairedModel(model, test, candidates=3)
terms = [ef.FrequencyTerm(test, relative_sd=0.01), ef.ShapeTerm(test, delta=0.03)]
bounds = [(5e3, 40e3)] * 3
prior = ef.GaussianPrior([*truth], [20e3] * 3, 3e3, bounds)
posterior = ef.LogPosterior(paired, terms, prior, dict.fromkeys(truth, "kN/m"))
run = ef.run(posterior, steps=150, ensembles=2, seed=1)

# %% [markdown]
# ## Parameters

# %% mystnb={"image": {"alt": "Prior and posterior density of each of three stiffnesses"}}
ef.figures.plot_prior_posterior(run, truths=truth)

# %% mystnb={"image": {"alt": "Samples of all pairs of three stiffnesses with ellipses of 95 %"}}
ef.figures.plot_scatter(run, truths=truth)

# %% mystnb={"image": {"alt": "Matrix of the correlations of three stiffnesses"}}
ef.figures.plot_correlation(run)

# %% [markdown]
# ## Fit and mode shapes

# %% mystnb={"image": {"alt": "Deviations of two frequencies before and after updating, and their MAC"}}
ef.figures.plot_predictive(run)

# %% tags=["result"] mystnb={"image": {"alt": "Two measured mode shapes on the building and those of the updated model"}}
ef.figures.plot_shapes(run)

# %% mystnb={"image": {"alt": "MAC of two measured and three model modes, before and after updating"}}
ef.figures.plot_mac(run)

# %% mystnb={"image": {"alt": "Total average error of the running mean over the generations"}}
ef.figures.plot_tae(run)

# %% [markdown]
# ## Frequency response functions

# %%
channel = [(2, 2)]
frequencies = np.linspace(1.0, 12.0, 80)
units = {"unit": "m/kN"}
response = ef.frf.FRFModel(model, frequencies, channel, damping=0.02, **units)
H = response({n: np.array([x]) for n, x in truth.items()})["receptance"][0] @ [1, 1j]
measured = ef.frf.FRFMeasurements(frequencies, H, channel, kind="receptance", **units)
term = ef.frf.FRFTerm(measured, sd=0.5 * np.abs(H))
frf_run = ef.run(ef.LogPosterior(response, term, prior), steps=60, seed=1)

# %% mystnb={"image": {"alt": "Measured amplitudes of an FRF and the band of the updated model"}}
ef.frf.plot_frf(frf_run)

# %% [markdown]
# ## Many tests

# %%
tests = {}
for day, shift in {"May": 0.99, "June": 1.0, "July": 1.01}.items():
    term = ef.FrequencyTerm(shift * test.frequencies, relative_sd=0.01)
    of_day = ef.LogPosterior(model, term, prior, dict.fromkeys(truth, "kN/m"))
    tests[day] = ef.to_inference_data(ef.run(of_day, steps=60, ensembles=2, seed=1))
population = ef.population.NormalPopulation(["k1", "k3"])
pooled = ef.pool_tests(tests, population, seed=1, steps=40, ensembles=1, draws=200)

# %% mystnb={"image": {"alt": "Two stiffnesses of three tests, each alone and given all, their mean and the next test"}}
ef.figures.plot_population(pooled)

# %% [markdown]
# ## Comparisons

# %%
moves = {"DE-MC": ef.DEMCMove(), "auto": "auto"}
compared = ef.compare_moves(posterior, moves, 12, steps=100, ensembles=2, seed=2)

# %% mystnb={"image": {"alt": "Effective samples per evaluation of two moves, and the error of each running mean"}}
ef.figures.plot_comparison(compared)

# %%
narrow = ef.GaussianPrior([*truth], [20e3] * 3, 1e3, bounds)
sure = ef.LogPosterior(paired, terms, narrow)
other = ef.run(sure, steps=60, ensembles=2, seed=1)
classes = ef.compare_models({"prior 15 %": run, "prior 5 %": other})

# %% mystnb={"image": {"alt": "Log evidence of two models with error bars, and their probabilities"}}
ef.figures.plot_model_comparison(classes)

# %% tags=["remove-cell"]
assert ef.diagnose(run).converged and len(classes.standings) == 2
