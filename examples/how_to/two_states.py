# %% [markdown]
# # Update one model from two states of a structure
#
# You will combine tests of one structure in two states, here empty and with a known mass
# on its roof, into one posterior. `python examples/how_to/two_states.py` runs this page
# (4 s).
#
# Frequencies of one state tell stiffness over mass, and no more. The same structure with
# a known mass on its roof tells both. The structure has two equal storeys of stiffness k
# and two equal floors of mass m; the test has two frequencies of each state.

# %%
import numpy as np
from scipy import stats

import emcee_femu as ef

K = 1e6 * np.array([[2.0, -1.0], [-1.0, 1.0]])  # two equal storeys of 1 MN/m
M = 1e3 * np.eye(2)  # two equal floors of 1 t


def model(added):  # kg on the roof
    return ef.MatrixModel(
        np.zeros((2, 2)), np.diag([0.0, added]), {"k": K}, {"m": M}, n_modes=2
    )


empty = ef.FrequencyTerm([6.03, 15.75], relative_sd=0.005)
loaded = ef.FrequencyTerm([5.55, 15.31], relative_sd=0.005)
prior = ef.IndependentPrior(
    {"k": stats.lognorm(0.5, scale=50), "m": stats.lognorm(0.5, scale=15)}
)

# %% [markdown]
# ## One state
#
# The prior's uncertainty of either parameter is about halved, no more, and the last sentence says
# why. This costs a few solves, see {doc}`first_look`.

# %%
alone = ef.LogPosterior(model(0.0), empty, prior)
one = ef.identifiability(ef.find_map(alone, seed=1))
one

# %% [markdown]
# ## Both states
#
# `LogPosterior.joint` sums the log-likelihoods of several experiments that share
# parameters: states of one structure (empty and loaded, at two temperatures), or tests of
# different kinds, see {doc}`static_test`.

# %%
posterior = ef.LogPosterior.joint(
    {"empty": (model(0.0), empty), "loaded": (model(4e3), loaded)}, prior
)
samplers = ef.run(posterior, "auto", nsteps=300, ensembles=2, seed=1)
idata = ef.to_inference_data(samplers, posterior)
ef.parameter_table(idata)

# %%
ef.frequency_table(idata, posterior, experiment="loaded")

# %% mystnb={"image": {"alt": "Two panels, one per state, each with measured frequencies inside the predicted intervals"}}
ef.plot_predictive(idata, posterior)

# %% [markdown]
# One panel per state. The prior owns all parameters; each model and each term reads those
# that it knows. Each model is solved once per parameter set, and pools, failures and
# reduced models work through it as for a single experiment. Whatever belongs to an
# experiment carries its name: the term `loaded.frequency`, the stored variable
# `empty.frequency`.

# %% tags=["remove-cell"]
assert "is known well, not k and m by themselves" in str(one)
assert min(one.table.column("sd/prior sd")) > 0.35
assert max(ef.parameter_table(idata).column("sd/prior sd")) < 0.2
assert ef.diagnose(samplers).short == "converged"
assert "empty.frequency" in idata.posterior_predictive.data_vars
