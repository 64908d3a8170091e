# %% [markdown]
# # Several setups of one structure (PoSER)
#
# For tests that were made in several setups, because there were fewer accelerometers
# than places. To merge the shapes by the reference sensors (PoSER) is not needed:
# **each setup is an experiment**, with its own pairing, and all experiments share the
# parameters. `python examples/how_to/setups.py` runs the page on simulated
# tests.
#
# Here there are six places and four accelerometers. Two sensors stay where they are,
# the reference; two others rove. Each setup has frequencies of its own, and shapes on
# a scale of its own.
#
# ## Two setups
#
# A concrete cantilever, 3 m long, whose lower and upper half may have different moduli:
# 27 and 34 GPa in the simulation. For each setup there are frequencies in Hz, their
# standard deviations, and shapes with one row per sensor. The reference sensors are at
# nodes 3 and 6.

# %%
import numpy as np
from scipy import stats

import emcee_femu as ef

first = ef.Measurements(
    [5.99, 38.28, 110.3],
    sd=[0.03, 0.19, 0.55],
    dofs=["3:uy", "6:uy", "1:uy", "4:uy"],
    shapes=[
        [-0.34, 0.72, 0.03],
        [-1.00, -1.00, -1.00],
        [0.03, 0.25, -0.51],
        [-0.53, 0.39, 0.61],
    ],
)
second = ef.Measurements(
    [5.92, 38.96, 109.96],
    sd=[0.03, 0.19, 0.55],
    dofs=["3:uy", "6:uy", "2:uy", "5:uy"],
    shapes=[
        [0.34, 0.77, 0.05],
        [1.00, -1.00, -1.00],
        [0.12, 0.62, -0.73],
        [0.74, -0.26, 0.18],
    ],
)

# %% [markdown]
# ## One posterior
#
# {py:meth}`~emcee_femu.LogPosterior.joint` takes a model and its terms for each setup.
# {py:class}`~emcee_femu.ShapeTerm` compares the shapes at the four sensors of a setup,
# whatever their scale and sign.

# %%
beam = {"rho": 2500, "A": 0.2 * 0.1, "I": 0.2 * 0.1**3 / 12}
sections = {half: ef.Section(E=(1e9, half), **beam) for half in ("lower", "upper")}
nodes = [(0.5 * i, 0) for i in range(7)]
bars = [(i, i + 1, "lower" if i < 3 else "upper") for i in range(6)]
held, options = {0: "fixed"}, {"plane": "xy", "n_modes": 6, "shapes": True}
model = ef.FrameModel(nodes, bars, sections, held, **options)
experiments = {}
for name, test in {"first": first, "second": second}.items():
    terms = [ef.FrequencyTerm(test), ef.ShapeTerm(test, delta=0.02)]
    experiments[name] = ef.PairedModel(model, test), terms
moduli = dict.fromkeys(model.names, stats.lognorm(0.2, scale=30))  # GPa
prior = ef.IndependentPrior(moduli)
posterior = ef.LogPosterior.joint(experiments, prior)
run = ef.run(posterior, seed=1)
ef.parameter_table(run)

# %% [markdown]
# Frequencies of the setups are separate data, each with its standard deviation. If all
# setups share an error, as from one temperature on one day, they do not average out:
# infer it, `FrequencyTerm(test, discrepancy="error")`, with the same name in all.
#
# ## All setups in one call
#
# Without `experiment=`, tables and figures show all of them; `experiment="first"` shows
# one.

# %%
ef.frequency_table(run)

# %%
ef.pairing_table(run)

# %% tags=["result"] mystnb={"image": {"alt": "Mode shapes of the cantilever in two rows, one for each setup; red dots of four sensors each lie near the blue model, at other nodes in the second setup"}}
ef.figures.plot_shapes(run)

# %% [markdown]
# The same holds for any tests of one structure: several days, an empty and a loaded
# state, [a static and a modal test](static_test.py). If the structure itself changes from
# test to test, see [many tests](../tutorials/many_tests.py).

# %% tags=["remove-cell"]
assert ef.diagnose(run).converged
draws = ef.to_inference_data(run)["posterior"]
for name, true in {"lower": 27.0, "upper": 34.0}.items():
    values = draws[name].values
    assert abs(values.mean() - true) < 3 * values.std()
alone = ef.LogPosterior(*experiments["first"], prior)
of_one = ef.to_inference_data(ef.run(alone, seed=1))["posterior"]
both, one = (
    np.array([d[n].values.std() for n in model.names]) for d in (draws, of_one)
)
assert (both < one).all()  # the second setup says something too
