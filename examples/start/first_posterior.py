# %% [markdown]
# # A first posterior
#
# Two measured frequencies (simulated here) update two stiffnesses, in 15 lines. The
# model is a function from parameters to natural frequencies; it may call any solver.
# `python examples/start/first_posterior.py` runs this page, and leaves
# `first_posterior.png`.

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
posterior = ef.LogPosterior(model, term, prior, units={"k1": "MN/m", "k2": "MN/m"})
run = ef.run(posterior, seed=1)
idata = ef.to_inference_data(run)

# %% [markdown]
# The table shows what was learned. Its last column is the part of the prior's standard
# deviation that is left.

# %%
print(ef.parameter_table(idata))

# %% [markdown]
# Can the result be trusted? The last three lines say whether the chains converged, how
# small a mode may be missing, and whether the model fits ([the other
# lines](reading.md)).

# %%
print(ef.diagnose(run))

# %% mystnb={"image": {"alt": "Scatter of k1 and k2 with a 95 % ellipse that leans to the left"}}
ef.figures.plot_scatter(idata).savefig("first_posterior.png")

# %% [markdown]
# The ellipse is tilted: a stiffer lower storey and a softer upper one fit nearly as well.
#
# Next: [a modal test, from CSV to verdict](../tutorials/modal_test.py) updates a frame
# with mode shapes, [which model, which term](choose.md) helps with your own structure,
# and the [glossary](../reference/glossary.md) translates between engineers and
# statisticians.

# %% tags=["remove-cell"]
table = ef.parameter_table(idata)
assert ef.diagnose(run).converged
assert abs(table.column("mean")[0] - 54.3) < 0.5
