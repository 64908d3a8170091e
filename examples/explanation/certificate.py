# %% [markdown]
# # Can I trust an emulated posterior?
#
# What does {py:func}`~emcee_femu.certify` prove about a posterior that was sampled with
# a stand-in for the model, what do its three verdicts mean, and what can it not see?
# `python examples/explanation/certificate.py` runs the page on made-up data.
#
# `certify` spends full solves on draws of the emulated posterior. At each draw the
# weight is the ratio of true to emulated density (of draws of a wider posterior, that of
# the true one to the law of all draws). If all weights are equal, the
# emulated posterior is the true one. If they differ, they correct it. If a few carry
# everything, it is useless.
#
# ## Three stand-ins
#
# The first has frequencies that are linear in the parameters, the second is off by
# less than a standard deviation of the measurement, the third by several.

# %%
import numpy as np
from scipy import stats

import emcee_femu as ef

full = ef.FunctionModel(lambda p: [(p["k"] / p["m"]) ** 0.5, (3 * p["k"]) ** 0.5])
term = ef.FrequencyTerm([3.0, 5.2], relative_sd=0.01)
prior = ef.GaussianPrior(["k", "m"], [8.0, 1.0], [2.0, 0.1], [(4.0, 15.0), (0.6, 1.4)])
true = ef.LogPosterior(full, term, prior)


def linear(p, off=0.0):
    """Return frequencies by a tangent, the first ``off`` standard deviations off."""
    first = 3 + (p["k"] - 9) / 6 - 1.5 * (p["m"] - 1) + 0.03 * off
    return [first, 5.196 + 0.2887 * (p["k"] - 9)]


certificates = {}
for title, off in {"linear": 0.0, "a little off": 0.7, "far off": 4.0}.items():
    cheap = ef.FunctionModel(lambda p, off=off: linear(p, off))
    emulated = ef.LogPosterior(cheap, term, prior)
    sampler = ef.run(emulated, ef.DEMCMove(), 20, 700, seed=1, ensembles=1)
    idata = ef.to_inference_data(sampler, emulated, discard=200)
    found = certificates[title] = ef.certify(idata, true, solves=100, seed=1)
    print(f"{title}: {found.short}, efficiency of the weights {found.efficiency:.2f}")

# %%
certificates["a little off"]

# %% [markdown]
# ## The verdicts
#
# | verdict | when | what to do |
# |---|---|---|
# | certified | efficiency of the weights (Kish) at least 0.9; means and standard deviations within a tenth of a standard deviation, the latter with two standard errors of the difference | use the emulated posterior: `certificate.idata` is its chain with a seal |
# | corrected | neither certified nor refused | use `certificate.mean`, `.sd` and `.idata`, whose draws are those solved in full, with weights |
# | refused | the weights are unreliable: Pareto k above 0.7 or, for n draws, above 1 - 1 / log10(n); unequal weights worth fewer than 50 independent draws, or nearly equal ones worth fewer than 25. Or the emulator did not settle, a part of the posterior is missing, or the chain has not converged (all below) | what the sentence says: more solves for the emulator or for the certificate, wider bounds, a start, a longer chain |
#
# Tables and figures of `certificate.idata` show the corrected posterior if there is
# one, and say so in their titles, even if it was read back from netCDF. Its group
# `certificate` holds the draws, weights and log-posteriors.

# %%
ef.parameter_table(certificates["a little off"].idata)

# %% [markdown]
# ## How it decides
#
# Pareto k describes the tail of the largest weights: above 0.7 their mean cannot be
# estimated, unless weights are nearly equal (efficiency above 0.9). With fewer than 100
# weights, estimates of k scatter by 0.2, so the limit is lower: 1 - 1 / log10(n).
#
# Means and standard deviations use the whole chain: a fit to ln w, made at other draws,
# predicts the weights everywhere, and the solved draws correct it. So the errors of a
# certified result are a few hundredths of a standard deviation, where 75 draws alone
# would know a mean to 0.12.
#
# ## Where the emulator puts no draws
#
# Weights show nothing there, however equal they are. So `certify` refuses an emulator
# that did not settle: {py:func}`~emcee_femu.emulate` had spent its solves before its
# errors were within its tolerance (`emulated.settled`, `certificate.settled`). The run on
# the emulated posterior knows this, and so does its ArviZ object, also if it was read
# back from netCDF. The paper's mass-spring problem shows why. A lobe at small k4 holds
# a few percent of its posterior. An emulator of 14 solves leaves it out. All weights are alike,
# and the standard deviation of k4 is too small:

# %%
paper = ef.paper.mass_spring().posterior
few = ef.emulate(paper, solves=14, seed=2, derivatives=False)
run = ef.run(few.posterior, steps=300, seed=1)
unsettled = ef.certify(ef.to_inference_data(run), paper, solves=100, seed=1)
long = ef.to_inference_data(ef.run(paper, steps=600, seed=1))
true_sd = float(long["posterior"]["k4"].std())
print(unsettled.verdict)
said, error = unsettled.sd[2], unsettled.sd_error[2]
print(f"sd of k4: {said:.0f} +- {error:.0f} by the weights, {true_sd:.0f} in truth")

# %% [markdown]
# Besides, it searches:
#
# - It refuses an emulated posterior whose bounds leave out more than 1 % of the prior's
#   probability, or whose draws press against a bound that the prior does not have.
#   Neither check costs a solve.
# - If it is given the run, a quarter of its draws are of a wider emulated posterior, of
#   the likelihood to the power 1/4, which is twice as wide. A lobe that the emulator
#   underrates has a larger share there, and its weights show it. Of an ArviZ object only
#   the chain is known, and a finding says so.
# - A quarter of the solves, at most 30, climb the true posterior from draws of the
#   prior far from the chain, if that is enough for three steps. A black box of d
#   parameters takes d + 1 solves a step, a model with `jacobian` one; positive
#   parameters climb by their logarithms. A maximum with more than 1 % of the posterior
#   where the chain has hardly a draw is refused, with its place; a climb that fails is
#   a finding.
#
# Here is the first: an emulator that was learned inside narrow bounds.

# %%
bounds = {"k": (8.8, 15.0), "m": (0.9, 1.4)}
narrow = ef.IndependentPrior({"k": stats.norm(8, 2), "m": stats.norm(1, 0.1)}, bounds)
cut = ef.LogPosterior(ef.FunctionModel(linear), term, narrow)
sampler = ef.run(cut, ef.DEMCMove(), 20, 300, seed=1, ensembles=1)
refused = ef.certify(ef.to_inference_data(sampler, cut, 100), true, solves=100, seed=1)
refused

# %% [markdown]
# A narrow maximum that no climb comes near stays unseen. So does a part of the posterior
# next to the draws, without a maximum of its own, that an emulator without `spread`
# cuts off smoothly.
#
# **Weights do not recover what the chain did not visit.** No certificate is better than
# its chain: one that `diagnose` calls not converged is refused, with the number of steps
# that it needs. The steps cost no solve, but a new chain needs a new certificate, so ask
# `diagnose` before `certify`.

# %% tags=["remove-cell"]
shorts = {title: found.short for title, found in certificates.items()}
assert [*shorts.values()] == ["certified", "corrected", "refused"]
assert refused.short == "refused"
assert unsettled.settled is False and unsettled.short == "refused"
assert said + 3 * error < true_sd
mean, sd = certificates["a little off"].mean, certificates["a little off"].sd
exact = certificates["linear"]
assert (np.abs(mean - exact.mean) < 0.3 * exact.sd).all()
