# %% [markdown]
# # A population in one call: TMCMC
#
# TMCMC (Ching and Chen, 2007) gives a population of the posterior and its evidence,
# moved from the prior through rising powers of the likelihood.
# {py:func}`~emcee_femu.anneal` does this in one call.
# `python examples/how_to/annealing.py` runs this page in some 5 s.

# %%
import emcee_femu as ef

problem = ef.paper.mass_spring()  # five masses, ten springs
posterior = problem.posterior
population = ef.anneal(posterior, 500, seed=1)
population

# %% [markdown]
# Each power is chosen so that the weights have a coefficient of variation of 1. The
# whole population is one batch for a `pool=` or `workers=`; `on_failure`, `backend` and
# `resume` are those of {py:func}`~emcee_femu.run`. The result has `theta`, `powers`,
# `log_evidence` with its standard error, effective sizes and the number of solves.
#
# Tables and figures accept it like chains:

# %%
idata = ef.to_inference_data(population, posterior)
ef.parameter_table(idata)

# %% mystnb={"image": {"alt": "Scatter of the five updated stiffnesses of 500 members, most ellipses tilted"}}
ef.figures.plot_scatter(idata)

# %% [markdown]
# ## How far to trust it
#
# A population is not a chain: there is no R-hat, and `diagnose` says what to judge by.
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
# **A region that no early member came near is not found**, and the standard error does
# not include it. A narrow mode in a wide prior needs many members, or a search: use
# `find_map` or `"auto"`. [Moves
# measured](../explanation/moves_measured.md#tmcmc-how-many-members) has figures,
# including a funnel, whose neck it misses.
#
# No error is claimed if the last proposals, fitted to the population, have heavy-tailed
# weights, or if their mean weight, a second estimate of the evidence, differs from the
# first by more than 2.5 standard errors; `problems` says why. Another seed, or a larger
# size, may have an error then.
#
# Use the evidence in [a comparison of model classes](../tutorials/model_classes.py):
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
