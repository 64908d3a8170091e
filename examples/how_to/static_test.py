# %% [markdown]
# # Combine a static and a modal test
#
# For those who have deflections under known loads beside natural frequencies: one
# model is updated from both. `python examples/how_to/static_test.py` runs the page (4
# s) on made-up tests.
#
# Frequencies determine stiffness over mass, deflections under known loads stiffness
# alone. Neither test determines the mass; both together do.
#
# {py:class}`~emcee_femu.StaticModel` solves $K(\theta)\,u = f$ for several load cases with
# the matrices of a {py:class}`~emcee_femu.MatrixModel`: dense in one batch, or sparse with
# one factorisation per parameter set. It has derivatives. Loads are given by DOF, or as a
# vector.

# %%
import textwrap

import numpy as np
from scipy import stats

import emcee_femu as ef

STOREYS = np.array([[2.0, -1.0], [-1.0, 1.0]])  # two of 1 MN/m, i.e. 1 kN/mm
FLOORS = np.eye(2)  # two of 1 t
NONE = np.zeros((2, 2))

loads = {"roof": {1: 10.0}, "both": [5.0, 5.0]}  # kN
points = {"floor": 0, "roof": 1}
static = ef.StaticModel(NONE, loads, {"k": STOREYS}, points=points, unit="mm")

# %% [markdown]
# {py:class}`~emcee_femu.DisplacementTerm` compares the readings of the gauges: one row
# per load case, one column per gauge, in the unit of the model. Names of cases and
# points are checked against the model's.

# %%
readings = [[0.202, 0.398], [0.203, 0.299]]  # mm
gauges = ef.DisplacementTerm(readings, sd=0.004, cases=[*loads], points=[*points])
modal = ef.MatrixModel(NONE, NONE, {"k": 1e6 * STOREYS}, {"m": 1e3 * FLOORS}, n_modes=2)
frequencies = ef.FrequencyTerm([6.03, 15.75], relative_sd=0.005)
priors = {"k": stats.lognorm(0.5, scale=50), "m": stats.lognorm(0.5, scale=15)}
prior = ef.IndependentPrior(priors)

# %% [markdown]
# ## The modal test alone, and both
#
# {doc}`What frequencies leave open </tutorials/what_is_learned>`, in a few solves:

# %%
alone = ef.LogPosterior(modal, frequencies, prior)
one = ef.identifiability(ef.find_map(alone, seed=1))
print(textwrap.fill(one.findings[-1], 80))

# %%
both = {"static": (static, gauges), "modal": (modal, frequencies)}
posterior = ef.LogPosterior.joint(both, prior)
run = ef.run(posterior, seed=1)
idata = ef.to_inference_data(run)
ef.parameter_table(idata)

# %% tags=["result"] mystnb={"image": {"alt": "Two panels: displacements of the static test by load case and gauge, and frequencies of the modal test, measured against predicted"}}
ef.figures.plot_predictive(idata, posterior)

# %% [markdown]
# `LogPosterior.joint` takes any experiments that share parameters: states of one
# structure (empty and with a known mass on its roof, {doc}`/tutorials/what_is_learned`;
# at two temperatures), or tests of different kinds. The prior has all parameters; each
# model and each term reads those that it knows, and each model is solved once per
# parameter set.
#
# If solves are slow, `ef.emulate(posterior, 60, seed=1, cheap=["static"])` emulates
# each model from solves of its own, except those in `cheap`. The attribute `.posterior`
# of the result is ready to run. Parts of an experiment carry its name: the term
# `modal.frequency`, the argument `experiment="modal"` of tables and figures.
#
# `ef.DisplacementTerm(..., discrepancy="name")` infers a model error.

# %% tags=["remove-cell"]
assert "is known well, not k and m by themselves" in str(one)
table = ef.parameter_table(idata)
assert max(table.column("sd/prior sd")) < 0.05
assert ef.diagnose(run).converged
