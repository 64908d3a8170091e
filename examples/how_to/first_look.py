# %% [markdown]
# # Take a first look, before any sampling
#
# Find the maxima of a posterior in a few dozen solves. They show whether model and test
# fit together, whether there is more than one explanation, and what the data (simulated
# here) will not tell. `python examples/how_to/first_look.py` runs this page (6 s).

# %%
import textwrap

import numpy as np

import emcee_femu as ef

problem = ef.paper.mass_spring()
found = ef.find_map(problem.posterior, seed=1)
found

# %% [markdown]
# {py:func}`~emcee_femu.find_map` climbs from 16 draws of the prior to the maxima of the
# posterior and fits a Gaussian to each (Laplace's approximation). The weight of a
# maximum is its share of the evidence. The second maximum is another explanation of the
# same data; a bound in its row means that a parameter ran into it. The numbers are in
# `found.maxima`, as `theta` and `covariance`.
#
# ## What the data inform, locally
#
# {py:func}`~emcee_femu.identifiability` accepts this result in place of samples. It
# gives the standard deviations over those of the prior, the correlations of the
# Gaussian about the heaviest maximum, cut at the bounds, and the sensitivities of the
# eigenvalues there.

# %%
ef.identifiability(found)

# %% [markdown]
# {doc}`/tutorials/what_is_learned` explains them. Before a test, use predicted
# frequencies as the measured ones: the result says what the test will not see.
#
# ## What it costs
#
# Each step goes to the maximum of a quadratic inside the bounds, with the Fisher
# information as its curvature. A climb ends when less than 0.001 of log-posterior is
# left to gain. A model with `jacobian` ({doc}`gradients`) takes one solve a step, a
# black box `d + 1`. A likelihood of unknown form takes `2 d` and, at start and top,
# `d (d - 1) / 2` for the curvature. With `workers=` or `pool=` all climbs advance in one
# batch. Under `on_failure="reject"`, a start that cannot be solved is dropped and
# reported.
#
# ## What it does not say
#
# - A maximum that no start leads to is missing. A narrow one may need `starts=200`.
# - Standard deviations and weights are those of Gaussians. `check=100` spends that many
#   solves on draws from them. Their importance weights (Pareto k, effective share) say
#   whether the posterior is Gaussian. Here they reveal a banana, of two parameters that
#   matter only together:

# %%
model = ef.FunctionModel(lambda p: [np.hypot(p["a"], p["b"])], n_modes=1)
prior = ef.GaussianPrior(["a", "b"], [1, 1], [2, 2], [(0, 9)] * 2)
term = ef.FrequencyTerm([3.0], relative_sd=0.01)
banana = ef.find_map(ef.LogPosterior(model, term, prior), seed=1, check=100)
print(textwrap.fill(banana.findings[-1], 80))

# %% [markdown]
# - Inferred model errors give a posterior with a long tail: sample it.

# %% tags=["remove-cell"]
assert len(found.maxima) == 2 and 0.95 < found.weights[0] < 1
assert 40 < found.solves < 100
assert banana.findings[-1].startswith("The posterior is not Gaussian")
assert banana.efficiency < 0.5
