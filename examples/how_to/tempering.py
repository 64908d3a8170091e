# %% [markdown]
# # Several maxima: jumps and tempering
#
# For posteriors with several maxima (statisticians call them modes): walkers stay at
# the maximum where they began, unless a move leads to the others. This page helps to choose such a move. `python
# examples/how_to/tempering.py` runs the page.
#
# For two storeys of equal mass, both frequencies were measured (here they are
# computed), but no shape. The stiffnesses k1 of the ground storey and k2 of the upper
# one give the same frequencies as 2 k2 and k1 / 2. So the soft storey may be the upper
# or the lower one:

# %%
import numpy as np

import emcee_femu as ef

frame = {"ground": (0, 1, 60.0), "upper": (1, 2, 60.0)}
model = ef.MassSpringModel([1.0, 1.0], frame)
truth = model({"ground": np.array([200.0]), "upper": np.array([20.0])})
term = ef.FrequencyTerm(truth.frequencies[0], relative_sd=0.01)
uniform = (5, 300)
prior = ef.IndependentPrior({"ground": uniform, "upper": uniform})
posterior = ef.LogPosterior(model, term, prior)
found = ef.find_map(posterior, seed=1, check=0)
for maximum in found.maxima:
    print(maximum.theta.round(1))


def shares(run, discard=100):  # of a stiff ground storey, by ensemble
    chains = (sampler.get_chain(discard=discard)[..., 0] for sampler in run)
    return [round(float((chain > 120).mean()), 2) for chain in chains]


# %% [markdown]
# ## Nothing known: "auto"
#
# `"auto"` searches for the maxima, and proposes jumps between them. It is the first
# choice, as always:

# %%
auto = ef.run(posterior, seed=1)
print("auto ", shares(auto, 0))

# %% [markdown]
# ## Maxima that both have walkers: `mode_jump`
#
# A step of DE-MC with $\gamma = 1$ leads from one maximum to the other if the two
# walkers of the difference are at them. `mode_jump=0.1` gives a tenth of the steps this
# $\gamma$. How often a walker crosses:

# %% tags=["result"]
crossings = {}
for jump in (0.0, 0.1):
    move = ef.DEMCMove(mode_jump=jump)
    (plain,) = ef.run(posterior, move, 32, steps=600, seed=1, ensembles=1)
    stiff = plain.get_chain(discard=100)[..., 0] > 120
    crossings[jump] = int((stiff[1:] != stiff[:-1]).sum())
    print(f"mode_jump={jump}: {crossings[jump]} times in {stiff.size} steps")

# %% [markdown]
# Between crossings an ensemble keeps the shares that its starts happened to have.
#
# ## Modes that a search may miss: `TemperedMove`
#
# Blocks of walkers sample powers of the likelihood, from 1, the posterior, to 0, the
# prior. Hot walkers roam everywhere and pass what they find to the cold ones. It costs
# as many evaluations as there are blocks, and gives the evidence.
#
# Neighbouring powers must overlap; how many powers that takes depends on the problem.
# `overlaps` of the evidence says how much they do: 1 is complete, below 0.1 is too
# little.

# %%
betas = np.linspace(1, 0, 8) ** 4
move = ef.moves.TemperedMove(ef.DEMCMove(mode_jump=0.1), betas=betas)
tempered = ef.run(posterior, move, steps=500, ensembles=1, seed=1)
idata = ef.to_inference_data(tempered, discard=100)  # the cold ones
evidence = ef.log_evidence(tempered, discard=100)
evidence

# %%
bridged = ef.log_evidence(auto)  # by a single bridge: it must agree
print(bridged)

# %% [markdown]
# A mean and a standard deviation do not describe such a posterior: report the maxima
# one by one. Conversion, tables, figures and `diagnose` use only the cold walkers.
#
# - `nwalkers` counts all blocks together, a multiple of the number of betas; the
#   default is as many for each as `run` would take.
# - No standard error of the evidence is claimed if two neighbouring powers hardly
#   overlap, or if the chain is shorter than 20 autocorrelation times of the evidence;
#   `problems` has the reason. Another seed or a larger population may have an error.
# - [Model classes](../tutorials/model_classes.py) are compared by their evidences.
#
# ## A population in one call: TMCMC
#
# {py:func}`~emcee_femu.anneal` moves a population from the prior through rising powers of
# the likelihood (Ching and Chen, 2007), and gives the evidence. Each power is chosen so
# that the weights have a coefficient of variation of 1. The whole population is one batch
# for `workers=`; tables and figures accept it like chains:

# %%
population = ef.anneal(posterior, 1_000, seed=1)
print(population)
ef.parameter_table(ef.to_inference_data(population, posterior))

# %% [markdown]
# A population is not a chain: there is no R-hat. Compare runs of several seeds instead.
# **A region that no early member came near is not found**, and the standard error does
# not include it: a narrow maximum in a wide prior needs a search, `find_map` or `"auto"`.
# [Moves measured](../explanation/moves_measured.md#annealed-populations) has figures.

# %% tags=["remove-cell"]
cold = idata.posterior["ground"].values
assert len(found.maxima) == 2 and crossings[0.1] > max(50, 5 * crossings[0.0])
exact = np.mean(shares(auto, 0))
assert abs((cold > 120).mean() - exact) < 0.12
gap = abs(bridged.log_evidence - evidence.log_evidence)
assert gap < 4 * np.hypot(bridged.log_evidence_error, evidence.log_evidence_error)
assert evidence.overlaps.min() > 0.1  # its chains are short: it claims no error
assert np.std(shares(auto, 0)) < 0.05
assert abs((population.theta[:, 0] > 120).mean() - exact) < 0.12
gap = population.log_evidence - bridged.log_evidence
error = np.hypot(population.log_evidence_error, bridged.log_evidence_error)
assert not population.problems and abs(gap) < 4 * error
assert ef.diagnose(population).chains.status == "none"
