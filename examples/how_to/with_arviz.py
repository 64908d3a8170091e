# %% [markdown]
# # ArviZ on your posterior
#
# Pass samples of this package to ArviZ, and samples of plain emcee to this package:
# which functions work on which, and what their numbers mean if walkers are chains.
# `python examples/how_to/with_arviz.py` runs this page (10 s).
#
# The structure has two storeys; its frequencies and mode shapes were measured. One
# model class has two unknown stiffnesses. In the other, the upper stiffness is that of
# the drawings.

# %%
import arviz as az
import matplotlib.pyplot as plt
import numpy as np

import emcee_femu as ef

masses = [16.5, 16.1]  # t
springs = {"k1": (0, 1, 50e3), "k2": (1, 2, 10e3)}  # kN/m
model = ef.MassSpringModel(masses, springs, shapes=True)
terms = [
    ef.FrequencyTerm([3.13, 9.83], relative_sd=0.02),
    ef.ShapeTerm([[0.15, 1.0], [1.0, -0.15]], delta=0.02),
]
prior = ef.GaussianPrior(
    ["k1", "k2"], [50e3, 10e3], [9e3, 3e3], [(2e4, 9e4), (1e3, 2e4)]
)
units = {"k1": "kN/m", "k2": "kN/m"}
posterior = ef.LogPosterior(model, terms, prior, units)
idata = ef.to_inference_data(ef.run(posterior, steps=400, seed=1))

drawn = ef.GaussianPrior(["k1"], [50e3], [9e3], [(2e4, 9e4)])
smaller = ef.LogPosterior(model, terms, drawn)
others = ef.to_inference_data(ef.run(smaller, steps=400, seed=1))

# %% [markdown]
# ## What works
#
# `idata` is an ArviZ object, before or since version 1. Its groups are listed at
# {py:func}`~emcee_femu.to_inference_data`; each walker is a chain.

# %%
az.summary(idata)

# %% [markdown]
# ArviZ's `r_hat` compares walkers. Those of one ensemble are not independent, so it
# shows only how well they mix. {py:func}`~emcee_femu.diagnose` compares whole
# ensembles.
#
# ### Predictive checks
#
# The group `posterior_predictive` holds 500 new measurements, with their error, for
# `arviz.plot_ppc`. It draws all measured values of a variable as one density, which
# says little of two frequencies. Draw them by mode, as
# {py:func}`~emcee_femu.figures.plot_predictive` does:

# %% mystnb={"image": {"alt": "Two histograms of new measurements, one for each mode, with a line at the measured frequency inside each"}}
new, measured = idata["posterior_predictive"], idata["observed_data"]["frequency"]
figure, panels = plt.subplots(1, 2, figsize=(7, 2.8), layout="constrained")
for i, axes in enumerate(panels):
    values = new["frequency"].values[..., i].ravel()
    axes.hist(values, 25, color="0.75", label="new measurements")
    axes.axvline(float(measured[i]), color="black", label="measured")
    axes.set(xlabel=f"frequency of mode {i + 1} [Hz]", yticks=[])
keys = panels[0].get_legend_handles_labels()
figure.legend(*keys, loc="outside lower center", ncols=2, frameon=False)
plt.close(figure)  # shown once, by the next line
figure

# %% [markdown]
# ### Cross-validation
#
# `arviz.loo` leaves one datum out after the other. The group `log_likelihood` has one
# variable with one number for each datum, whatever the number of terms. A term whose
# data are correlated counts as one datum, as here all shapes together.

# %% tags=["remove-stderr"]
az.loo(idata)

# %%
idata["log_likelihood"]["data"].datum.values.tolist()

# %% [markdown]
# The model class with the lower `elpd` predicts worse. Here the drawings are wrong.

# %% tags=["remove-stderr"]
ranking = az.compare({"k1 and k2": idata, "k1 alone": others})
ranking

# %% [markdown]
# Mind the warning. A modal test has few data, and leaving one out changes the posterior
# much: a Pareto k above 0.7 means that the samples cannot give the result.
# {py:func}`~emcee_femu.compare_models` ranks by the evidence, which has no such limit
# but depends on the prior.
#
# ## Samples of plain emcee
#
# A sampler of any log-probability can be converted with names, then judged and
# tabulated. Without a {py:class}`~emcee_femu.LogPosterior`, prior, data and model are
# unknown, so comparisons with them are left out.

# %%
import emcee


def log_probability(theta):
    return -0.5 * float(np.sum(((theta - [53e3, 7.4e3]) / [2e3, 300]) ** 2))


sampler = emcee.EnsembleSampler(16, 2, log_probability, moves=ef.DEMCMove())
sampler.run_mcmc(posterior.start(16, seed=1), 1_000)
plain = ef.to_inference_data(sampler, discard=200, names=["k1", "k2"])
ef.parameter_table(plain)

# %%
ef.diagnose(plain)

# %% [markdown]
# The result of `arviz.from_emcee` works as well:

# %% tags=["remove-stderr"]
theirs = az.from_emcee(sampler, var_names=["k1", "k2"])
ef.parameter_table(theirs)

# %% [markdown]
# ## What does not work
#
# - `isel(draw=...)` and `isel(chain=...)` of ArviZ take the same places in every group,
#   and those of `prior` and `posterior_predictive` are not those of the chain. Give
#   `discard=` and `thin=` when you convert.
# - Draws that {py:func}`~emcee_femu.certify` corrected have weights. ArviZ ignores
#   them; tables and figures here use them. The group `posterior_predictive` is drawn by
#   weight.
# - A tempered run is converted without its hot walkers.

# %% tags=["remove-cell"]
assert idata["log_likelihood"]["data"].datum.values.tolist()[:2] == [
    "frequency[1]",
    "frequency[2]",
]
assert idata["posterior_predictive"]["frequency"].shape == (1, 500, 2)
assert list(ranking.index) == ["k1 and k2", "k1 alone"]
assert ef.parameter_table(idata).column("unit") == ["kN/m"] * 2
assert abs(ef.parameter_table(plain).column("mean")[0] / 53e3 - 1) < 0.01
