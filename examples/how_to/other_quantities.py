# %% [markdown]
# # Models, terms and derivatives of your own
#
# For those who measured something else than modes, or have a likelihood or
# derivatives of their own. A model is updated from any measured quantity, with the
# same tables and figures as for modes; the derivatives of an FE program make a
# gradient cost one solve. `python examples/how_to/other_quantities.py` runs the page.
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
UNIT = LOAD * X**2 * (3 * LENGTH - X) / 6  # mm kN m2


def cantilever(p):  # for all walkers at once; EI in kN m2, (n,)
    return {"deflection": UNIT / p["EI"][:, None]}  # mm, (n, 3)


# %% [markdown]
# A term is any callable from parameters and response to log-likelihoods `(n,)`. The
# attributes are optional. With `reads`, a missing variable raises an error before the
# first solve; with `observed`, tables and figures show what was measured; with
# `deviations`, for Gaussian errors, `arviz.loo` and derivatives work too.


# %%
class StaticTerm:
    name = "static"
    names = ("EI",)  # of the parameters
    reads = {"deflection": ef.Variable({"x": X}, "mm")}
    observed = {"deflection": MEASURED}

    def deviations(self, parameters, response):
        r = response["deflection"] - MEASURED
        return r, np.full(r.shape, SD)

    def __call__(self, parameters, response):
        r, sd = self.deviations(parameters, response)
        return -0.5 * ((r / sd) ** 2).sum(axis=1)


prior = ef.IndependentPrior({"EI": stats.lognorm(0.3, scale=1_000)})
run = ef.run(ef.LogPosterior(cantilever, StaticTerm(), prior), seed=1)
ef.parameter_table(run)

# %%
ef.diagnose(run)

# %% tags=["result"] mystnb={"image": {"alt": "Measured deflections at three places, and the intervals that the model predicts"}}
ef.figures.plot_predictive(run)

# %% [markdown]
# {doc}`/reference/contracts` lists all optional attributes of models and terms.
#
# ## A solver with derivatives
#
# Searches for maxima ({doc}`/tutorials/what_is_learned`), `"auto"`, and
# {py:class}`~emcee_femu.moves.HamiltonianMove` for ten parameters and more use
# derivatives. Many FE programs give those of their results. Those of the eigenvalues of
# symmetric matrices cost a few products: $d\lambda = \phi^T (dK - \lambda\, dM)\, \phi$
# with $\phi^T M \phi = 1$.
#
# {py:class}`~emcee_femu.FunctionModel` makes a model of a solver that takes one
# parameter set at a time; `variables` declare what it returns. If you have derivatives,
# pass them:


# %%
def solve(p):  # one parameter set; may start any program
    return {"deflection": UNIT / p["EI"]}


def solve_with_derivatives(p):  # and {variable: {parameter: array}}
    return solve(p), {"deflection": {"EI": -UNIT / p["EI"] ** 2}}


declared = {"variables": StaticTerm.reads}
model = ef.FunctionModel(solve, **declared, jacobian=solve_with_derivatives)
posterior = ef.LogPosterior(model, StaticTerm(), prior)

# %% [markdown]
# `posterior.gradient` gives the rows of the posterior and the gradient, here of four
# points from four solves. `posterior.linearize` adds the *information*: Fisher's
# information of the likelihood and the curvature of the log-prior. Its inverse is a
# covariance where the model is nearly linear. If a row is -inf (out of bounds, or a
# rejected failed solve), gradient and information are NaN.

# %%
theta = posterior.start(4, seed=1)  # (4, 1)
rows, gradient, information = posterior.linearize(theta)
print("gradients: ", gradient[:, 0].round(4))
print("by the information the sd is", (information[:, 0, 0] ** -0.5).round(1))

# %% [markdown]
# Without derivatives the gradient is computed by central differences: `2 d + 1` solves
# for each point, in one batch for the workers. `posterior.differentiable` says which of
# the two applies.

# %%
plain = ef.LogPosterior(ef.FunctionModel(solve, **declared), StaticTerm(), prior)
print(posterior.differentiable, plain.differentiable)
differences = plain.gradient(theta)[1]
print(f"largest difference {np.abs(differences - gradient).max():.0e}")

# %% [markdown]
# No difference is taken across a bound. The steps suit solvers with results good to
# nine digits or more; searches for maxima need six.
#
# - **A model** that solves all walkers at once has a method `jacobian(parameters)`. It
#   returns the response and the derivatives of its variables, each `(n, *shape)`. A
#   parameter that is left out changes nothing.
# - **A term** may have `linearize` or, easier, `deviations`: residuals r and their
#   standard deviations. With neither, it is differenced without another solve, and
#   `linearize` of the posterior has no information.
# - **A prior** may have `gradient`; otherwise its `logpdf` is differenced.
# - **All models of this package** have derivatives, exact ones of frequencies and
#   shapes, at one to two solves with vectors: `model.jacobian({"k": np.array([9.0])})`.
#   So has a {py:class}`~emcee_femu.PairedModel` of any model that has them; it keeps
#   the pairing fixed, because it changes in steps.
#
# Where modes coincide, sorted frequencies have a kink: a `ValueError` names the modes
# and the parameter that separates them. If no parameter does, frequencies have
# derivatives, and those of the shapes are without a rotation in the space of both.

# %% tags=["remove-cell"]
EI = np.concatenate([sampler.get_chain(flat=True) for sampler in run])
# In 1 / EI the likelihood is Gaussian: least squares, hardly moved by the prior.
assert abs(EI.mean() / ((UNIT @ UNIT) / (UNIT @ MEASURED)) - 1) < 0.005
assert ef.diagnose(run).converged
assert posterior.differentiable and not plain.differentiable
np.testing.assert_allclose(differences, gradient, rtol=1e-5, atol=1e-5)
