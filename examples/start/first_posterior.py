# %% [markdown]
# # A first posterior
#
# From two measured frequencies to the posterior of two stiffnesses, in 15 lines. Any
# function from parameters to natural frequencies will do; it may call any solver.
# `python examples/start/first_posterior.py` runs this page.

# %%
import numpy as np

import emcee_femu as ef


def frequencies(p):  # two-storey shear frame: 16.5 t and 16.1 t; k1, k2 in MN/m
    K = 1e6 * np.array([[p["k1"] + p["k2"], -p["k2"]], [-p["k2"], p["k2"]]])
    A = K / np.sqrt(np.outer([16.5e3, 16.1e3], [16.5e3, 16.1e3]))
    return np.sqrt(np.linalg.eigvalsh(A)) / (2 * np.pi)


model = ef.FunctionModel(frequencies)
term = ef.FrequencyTerm([3.13, 9.83], relative_sd=0.02)
prior = ef.GaussianPrior(["k1", "k2"], [50, 10], [9, 3], bounds=[(20, 90), (1, 15)])
posterior = ef.LogPosterior(model, term, prior)
run = ef.run(posterior, steps=500, seed=1)
idata = ef.to_inference_data(run)

# %% [markdown]
# What was learned. The last column says how much of the prior's uncertainty is left.

# %%
ef.parameter_table(idata)

# %% [markdown]
# May it be believed? The last lines say whether the chains converged, how small a mode
# the search may have missed, and whether the model fits; [reading the
# tables](reading.md) explains the rest.

# %%
ef.diagnose(run)

# %% mystnb={"image": {"alt": "Scatter of k1 and k2 with a 95 % ellipse that leans to the left"}}
ef.figures.plot_scatter(idata, units={"k1": "MN/m", "k2": "MN/m"})

# %% [markdown]
# The ellipse leans: a stiffer lower storey and a softer upper one fit nearly as well.
#
# Where to go on: [a modal test, from CSV to verdict](../tutorials/modal_test.py) is the
# whole way with a frame and mode shapes, [which model, which term](choose.md) finds
# what suits your own structure, and the [glossary](../reference/glossary.md)
# translates between engineers and statisticians.

# %% tags=["remove-cell"]
table = ef.parameter_table(idata)
assert ef.diagnose(run).converged
assert abs(table.column("mean")[0] - 54.3) < 0.5
