# %% [markdown]
# # Give the derivatives of your model
#
# Pass the derivatives of an FE program to the posterior, so that its gradient costs one
# solve, and see what happens without them. `python examples/how_to/gradients.py` runs
# this page (2 s). The data are made up.
#
# Searches for maxima ({doc}`/tutorials/what_is_learned`), `"auto"`, and
# {py:class}`~emcee_femu.moves.HamiltonianMove` for ten parameters and more use
# derivatives. All models of this package have them already, see below.
#
# ## A solver with derivatives
#
# Many FE programs give the derivatives of their results. Those of the eigenvalues of
# symmetric matrices cost a few products: $d\lambda = \phi^T (dK - \lambda\, dM)\, \phi$
# with $\phi^T M \phi = 1$. If you have derivatives, pass them:

# %%
import numpy as np

import emcee_femu as ef

np.set_printoptions(suppress=True)  # no exponents below


def solve(p):  # one parameter set; may start any program
    return [np.sqrt(p["k"] / p["m"]) / (2 * np.pi)]


def solve_with_derivatives(p):  # and {variable: {parameter: array}}
    (f,) = solve(p)
    slopes = {"k": [f / (2 * p["k"])], "m": [-f / (2 * p["m"])]}
    return [f], {"frequency": slopes}


model = ef.FunctionModel(solve, n_modes=1, jacobian=solve_with_derivatives)
prior = ef.GaussianPrior(["k", "m"], [40, 0.1], [8, 0.01], [(10, 90), (0.05, 0.2)])
term = ef.FrequencyTerm([3.2], relative_sd=0.01)
posterior = ef.LogPosterior(model, term, prior)

# %% [markdown]
# `posterior.gradient` gives the rows of the posterior and the gradient, here of four
# points from four solves. `posterior.linearize` adds the *information*: Fisher's
# information of the likelihood and the curvature of the log-prior. Its inverse is a
# covariance where the model is nearly linear:

# %%
theta = posterior.start(4, seed=1)  # (4, 2)
rows, gradient, information = posterior.linearize(theta)
print(gradient.round(3))
print(np.linalg.inv(information[0]).round(4))

# %% [markdown]
# If a row is -inf (out of bounds, or a rejected failed solve), gradient and information
# are NaN.
#
# ## Without derivatives
#
# The gradient is then computed by central differences: `2 d + 1` solves for each point,
# in one batch for the workers. `posterior.differentiable` says which of the two
# applies.

# %%
plain = ef.LogPosterior(ef.FunctionModel(solve, n_modes=1), term, prior)
print(posterior.differentiable, plain.differentiable)
differences = plain.gradient(theta)[1]
print(f"largest difference {np.abs(differences - gradient).max():.0e}")

# %% [markdown]
# No difference is taken across a bound. The steps suit solvers with frequencies good to
# nine digits or more; searches for maxima need six.
#
# ## Models, terms and priors of your own
#
# - **A model** that solves all walkers at once has a method `jacobian(parameters)`. It
#   returns the response and the derivatives of its variables, each `(n, *shape)`. A
#   parameter that is left out changes nothing.
# - **A term** may have `linearize` or, for Gaussian errors, `deviations`, which is
#   easier: residuals r and their standard deviations sd. With neither, it is
#   differenced without another solve, and `linearize` of the posterior has no
#   information.
# - **A prior** may have `gradient`; otherwise its `logpdf` is differenced.
#
# ## The models of this package
#
# All models of this package have derivatives, reduced ones too, and so has a
# {py:class}`~emcee_femu.PairedModel` of any model that has them; it keeps the pairing
# fixed, because it changes in steps. Those of frequencies and shapes are exact for every
# parameter and cost one to two solves with vectors: `model.jacobian({"k":
# np.array([9.0])})`.
#
# Where modes coincide, sorted frequencies have a kink: a `ValueError` names the modes and
# the parameter that separates them. In a building that is the same in both directions, no
# parameter does. Frequencies then have derivatives, and those of the shapes are without a
# rotation within the space that the two modes span.

# %% tags=["remove-cell"]
assert posterior.differentiable and not plain.differentiable
np.testing.assert_allclose(differences, gradient, rtol=1e-5, atol=1e-5)
