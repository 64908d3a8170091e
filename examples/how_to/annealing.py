# %% [markdown]
# # A population in one call: TMCMC
#
# Users of TMCMC (Ching and Chen, 2007) look for a population of the posterior and its
# evidence, carried from the prior through rising powers of the likelihood. That is
# {py:func}`~emcee_femu.anneal`. `python examples/how_to/annealing.py` runs this page
# in some 5 s.

# %%
import emcee_femu as ef

problem = ef.paper.mass_spring()  # five masses, ten springs
posterior = problem.posterior
population = ef.anneal(posterior, 500, seed=1)
population

# %% [markdown]
# Each power is so far above the last that the weights have a coefficient of variation
# of 1. The whole population is one batch for a `pool=` or `workers=`; `on_failure`,
# `backend` and `resume` are those of {py:func}`~emcee_femu.run`. The result has
# `theta`, `powers`, `log_evidence` with its standard error, effective sizes and the
# solves spent.
#
# Tables and figures take it as they take chains:

# %%
idata = ef.to_inference_data(population, posterior)
ef.parameter_table(idata)

# %% mystnb={"image": {"alt": "Scatter of the five updated stiffnesses of 500 members, most ellipses tilted"}}
ef.figures.plot_scatter(idata)

# %% [markdown]
# ## How far to trust it
#
# It is a population, not a chain: there is no R-hat, and `diagnose` says what to judge by.
# Compare runs of several seeds instead:

# %%
for seed in (2, 3, 4):
    other = ef.anneal(posterior, 500, seed=seed)
    shift = (other.theta.mean(axis=0) - population.theta.mean(axis=0)) / (
        population.theta.std(axis=0)
    )
    print(
        f"seed {seed}: ln Z {other.log_evidence:.2f} +- "
        f"{other.log_evidence_error:.2f}, means within {abs(shift).max():.2f} sd"
    )

# %% [markdown]
# **What no early member came near is not found**, and the standard error does not know
# of it. A narrow mode in a wide prior needs many members, or a search: `find_map` and
# `"auto"` look for what is narrow. [Moves measured](
# ../explanation/moves_measured.md#tmcmc-how-many-members) has figures, also of a
# funnel, whose neck it misses. There no error is claimed, and `problems` says why: the
# last proposals, fitted to the population, have weights of a heavy tail. Nor is one
# claimed where the mean weight of these proposals, a second estimate of the evidence,
# differs from the first by more than 2.5 standard errors. Chance alone does that to one
# or two populations in a hundred; another seed, or a larger size, has an error then.
#
# Moves are independence proposals and random walks, fitted by each half of the
# population to the other half; a population that is fitted to itself has an evidence
# that is too large. They are made in logits of parameters between two bounds, and in
# logarithms of those above zero, so that a posterior pressed to a bound is no edge.
# At each power sweeps end by the slowest quarter of the members, not by the average.
#
# The evidence goes to [a comparison of model classes](../tutorials/model_classes.py):
# `compare_models({"A": population_a, "B": population_b})`.

# %% tags=["remove-cell"]
import numpy as np

table = ef.parameter_table(idata)
assert abs(table.column("mean")[0] / 4000 - 1) < 0.005
assert abs(shift).max() < 0.4 and not population.problems
assert abs(other.log_evidence - population.log_evidence) < 5 * np.hypot(
    other.log_evidence_error, population.log_evidence_error
)
assert ef.diagnose(population).chains.status == "none"
