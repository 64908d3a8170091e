# %% [markdown]
# # The first messages, and what they mean
#
# Five common messages of the first hour, each with its cause and its remedy. All of
# them come before or at the first solve, so that no long run is lost.
# `python examples/start/first_messages.py` runs this page. Its data are made up.

# %%
import sys
from textwrap import fill, shorten

import numpy as np

import emcee_femu as ef

said = []


def show(call):  # prints what a call raises
    try:
        call()
    except Exception as error:
        said.append(f"{type(error).__name__}: {error}")
        print(fill(shorten(said[-1], 400, placeholder=" ..."), 80))


# The example is a two-storey frame:
STOREYS = {"k1": np.diag([1.0, 0.0]), "k2": np.array([[1.0, -1.0], [-1.0, 1.0]])}
model = ef.MatrixModel(np.zeros((2, 2)), np.eye(2), STOREYS, n_modes=2)
term = ef.FrequencyTerm([0.45, 1.2], relative_sd=0.02)
bounds = [(1, 90), (1, 90)]
prior = ef.GaussianPrior(["k1", "k2"], [30, 20], [9, 6], bounds)
posterior = ef.LogPosterior(model, term, prior)

# %% [markdown]
# ## A missing extra
#
# Readers of measured FRFs, progress bars and FE programs are *extras*. Without `pyuff`:

# %%
sys.modules["pyuff"] = None  # as if it were not installed
show(lambda: ef.frf.FRFMeasurements.from_uff("test.uff"))

# %% [markdown]
# **Remedy.** Run the command in the message in the same environment. [Installing](
# install.md) lists all extras.
#
# ## Too few walkers
#
# Proposals are differences of other walkers. With fewer than two walkers per parameter,
# all differences may lie in a subspace that the ensemble then never leaves.

# %%
five = ef.paper.mass_spring().posterior  # has five parameters
show(lambda: ef.run(five, ef.DEMCMove(), nwalkers=8, seed=1))

# %% [markdown]
# **Remedy.** Use at least two, better four walkers per parameter, or omit `nwalkers`: the
# default is large enough.
#
# ## A stiffness without bounds
#
# A Gaussian prior extends below zero, where a structure has no natural frequencies.
# Walkers start from samples of the prior, so the message comes early:

# %%
unbounded = ef.GaussianPrior(["k1", "k2"], [30, 20], [20, 15])
show(lambda: ef.run(ef.LogPosterior(model, term, unbounded), seed=1))

# %% [markdown]
# **Remedy.** Give bounds, `GaussianPrior(..., bounds=[(1, 90), (1, 90)])`, or a prior of
# positive parameters, `ef.IndependentPrior({"k1": stats.lognorm(0.3, scale=30)})`.
#
# ## A different number of modes
#
# The model returns two frequencies; the test has three:

# %%
three = ef.FrequencyTerm([0.45, 1.2, 1.9], relative_sd=0.02)
show(lambda: ef.LogPosterior(model, three, prior))

function = ef.FunctionModel(lambda p: [p["k1"] ** 0.5, p["k2"] ** 0.5])
show(lambda: ef.run(ef.LogPosterior(function, three, prior), seed=1))

# %% [markdown]
# **Remedy.** Let the model compute as many modes as were measured (`n_modes=`), or
# compare fewer. If the test missed a mode in between, do not compare frequencies by
# number: {py:class}`~emcee_femu.PairedModel` pairs modes by their shapes.
#
# ## A start outside the bounds

# %%
outside = 95 + np.random.default_rng(1).random((8, 2))
options = {"nwalkers": 8, "ensembles": 1, "seed": 1}
show(lambda: ef.run(posterior, ef.DEMCMove(), **options, starts=outside))

# %% [markdown]
# **Remedy.** Omit `starts`: `run` starts from samples of the prior, so that independent
# ensembles can disagree if there is more than one mode. With plain emcee,
# `posterior.start(nwalkers, seed=1)` returns such samples.
#
# ## What is not an error
#
# - `Chains: not converged, ...` is a statement of {py:func}`~emcee_femu.diagnose`. It says
#   what to do, usually how many steps to run.
# - `UserWarning: frequency at the prior mean: model 3.56 Hz, measured 19.7 Hz: the
#   model is 5.91 times too low in the median; was rad/s given for Hz?` comes before
#   sampling. Check it: data and model may have different units, or the prior may be far
#   from the data.
# - `FutureWarning: ArviZ is undergoing a major refactor ...` is printed by ArviZ 0.23
#   whenever it is imported; ArviZ 1 has no such warning.

# %% tags=["remove-cell"]
expected = ["pip install pyuff", "expected at least 2 * ndim = 10"]
expected += ["give the prior bounds", "3", ", 2): one value", "starts: k1 = "]
assert len(said) == len(expected)
assert all(part in message for part, message in zip(expected, said, strict=True))
del sys.modules["pyuff"]
