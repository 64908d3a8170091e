# %% [markdown]
# # Compare quantities other than modes
#
# Update a model from any measured quantity, with a likelihood of your own, and get the
# same tables and figures as for modes. `python examples/how_to/other_quantities.py`
# runs this page (4 s).
#
# A model may return any response: an object with attributes, or a mapping, each value
# an array with one row per walker. A term lists in `reads` what it needs from it. The
# declared names, dimensions, coordinates and units go into the ArviZ object, the tables
# and the figures.
#
# Here the deflections of a cantilever under a load at its tip determine its bending
# stiffness; they are made up. (For linear static tests there are a model and a term
# already: {doc}`static_test`.)

# %%
import numpy as np
from scipy import stats

import emcee_femu as ef

MEASURED, SD = np.array([0.62, 1.60, 2.88]), 0.03  # mm
X, LENGTH, LOAD = np.array([0.8, 1.4, 2.0]), 2.0, 1e3  # m, m, N


def cantilever(p):  # for all walkers at once; EI in kN m2, (n,)
    w = LOAD * X**2 * (3 * LENGTH - X) / (6e3 * p["EI"][:, None])
    return {"deflection": 1e3 * w}  # mm, (n, 3)


# %% [markdown]
# A term is any callable from parameters and response to log-likelihoods `(n,)`. The
# attributes are optional. With `reads`, a missing variable raises an error before the
# first solve; with `observed`, tables and figures show what was measured.


# %%
class StaticTerm:
    name = "static"
    names = ("EI",)  # of the parameters
    reads = {"deflection": ef.Variable({"x": X}, "mm")}
    observed = {"deflection": MEASURED}

    def __call__(self, parameters, response):
        residuals = (response["deflection"] - MEASURED) / SD
        return -0.5 * (residuals**2).sum(axis=1)


prior = ef.IndependentPrior({"EI": stats.lognorm(0.3, scale=1_000)})
posterior = ef.LogPosterior(cantilever, StaticTerm(), prior)
run = ef.run(posterior, seed=1)
idata = ef.to_inference_data(run)
ef.parameter_table(idata)

# %%
ef.diagnose(run)

# %% mystnb={"image": {"alt": "Measured deflections at three places, and the intervals that the model predicts"}}
ef.figures.plot_predictive(idata)

# %% [markdown]
# A solver that takes one parameter set at a time becomes a model by
# `ef.FunctionModel(function, variables=StaticTerm.reads)`, which declares what it
# returns; the labels of the points are those that the term reads.
#
# All optional attributes of models and terms are listed in
# {doc}`/reference/contracts`. With `deviations`, for Gaussian errors, `arviz.loo`
# works too; derivatives are in {doc}`gradients`.

# %% tags=["remove-cell"]
EI = idata.posterior["EI"].values
# In 1 / EI the likelihood is Gaussian: least squares, hardly moved by the prior.
unit = LOAD * X**2 * (3 * LENGTH - X) / 6
fit = (unit @ unit) / (unit @ MEASURED)
assert abs(EI.mean() / fit - 1) < 0.005
assert ef.diagnose(run).converged
