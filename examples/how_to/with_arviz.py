# %% [markdown]
# # ArviZ on your posterior
#
# Pass samples of this package to ArviZ, and samples of plain emcee to this package:
# which functions work on which, and what their numbers mean if walkers are chains.
# `python examples/how_to/with_arviz.py` runs this page (5 s).
#
# The structure has two storeys; its measured frequencies and mode shapes are simulated.
# In a second model class the upper stiffness is that of the drawings.

# %%
import arviz as az

import emcee_femu as ef

springs = {"k1": (0, 1, 50e3), "k2": (1, 2, 10e3)}  # kN/m
model = ef.MassSpringModel([16.5, 16.1], springs, shapes=True)  # t
terms = [ef.FrequencyTerm([3.13, 9.83], relative_sd=0.02)]
terms += [ef.ShapeTerm([[0.15, 1.0], [1.0, -0.15]], delta=0.02)]
bounds = [(2e4, 9e4), (1e3, 2e4)]
prior = ef.GaussianPrior(["k1", "k2"], [50e3, 10e3], [9e3, 3e3], bounds)
posterior = ef.LogPosterior(model, terms, prior, {"k1": "kN/m", "k2": "kN/m"})
run = ef.run(posterior, seed=1)
idata = ef.to_inference_data(run)

drawn = ef.GaussianPrior(["k1"], [50e3], [9e3], [(2e4, 9e4)])
smaller = ef.LogPosterior(model, terms, drawn)
others = ef.to_inference_data(ef.run(smaller, seed=1))

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
# ensembles. Plots with a line for each of 64 chains cannot be read: `combined=True` takes
# them as one, as in `az.plot_forest(idata, combined=True)`.
#
# ### Predictive checks
#
# The group `posterior_predictive` holds 500 new measurements, with their error:
# `arviz.plot_ppc`, since version 1 `plot_ppc_dist`, draws the density of all modes
# together. {py:func}`~emcee_femu.figures.plot_predictive` draws each mode; its draws, one
# for each sample, are in `new_measurement`. {doc}`prior_predictive` checks the prior.
#
# ### Cross-validation
#
# `arviz.loo` leaves one datum out after the other. The group `log_likelihood` has one
# variable with one number for each datum, whatever the number of terms. A term whose
# data are correlated counts as one datum, as here all shapes together. The model class
# with the lower `elpd` predicts worse. Here the drawings are wrong.

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
# These are converted, judged and tabulated, too: {doc}`/start/emcee_users`. What
# `arviz.from_emcee` returns is accepted as well.
#
# ## What does not work
#
# - `isel(draw=...)` and `isel(chain=...)` of ArviZ take the same places in every group,
#   and those of `prior` and `posterior_predictive` are not those of the chain. Give
#   `discard=` and `thin=` when you convert.
# - Draws that {py:func}`~emcee_femu.certify` corrected have weights. ArviZ ignores
#   them; tables, figures and the group `posterior_predictive` use them.
# - A tempered run is converted without its hot walkers.

# %% tags=["remove-cell"]
assert idata["posterior_predictive"]["frequency"].shape == (1, 500, 2)
assert list(ranking.index) == ["k1 and k2", "k1 alone"]
assert ef.parameter_table(idata).column("unit") == ["kN/m"] * 2
