# %% [markdown]
# # I have a log-probability
#
# You use emcee, and have a function of an array; there need be no FE model. With names
# and bounds it becomes a posterior, with a search for all modes, the evidence, and a
# verdict. `python examples/start/emcee_users.py` runs this page.
#
# ## The function
#
# Here a line is fitted to 20 simulated points, with an error of unknown size. What the
# function returns after its value is a blob, as in emcee: here the line at x = 10.

# %%
import emcee
import numpy as np

import emcee_femu as ef

rng = np.random.default_rng(1)
x = np.linspace(0, 5, 20)
y = 1.5 + 0.8 * x + 0.3 * rng.normal(size=20)


def log_likelihood(theta, x, y):
    intercept, slope, sigma = theta
    if sigma <= 0:
        return -np.inf, np.nan
    residual = (y - intercept - slope * x) / sigma
    value = -0.5 * residual @ residual - len(x) * np.log(sigma * np.sqrt(2 * np.pi))
    return value, intercept + 10 * slope


box = {"intercept": (0, 4), "slope": (0, 2), "sigma": (0, 1)}
posterior = ef.LogPosterior.from_function(log_likelihood, box, args=(x, y))
posterior

# %% [markdown]
# `box` holds uniform priors between bounds; {py:class}`~emcee_femu.IndependentPrior` has
# others. If the function returns -inf, the likelihood is zero there; NaN is an error.
# `vectorize=True` is for a function of all walkers at once, `(n, d)`.
# {py:meth}`LogPosterior.from_function <emcee_femu.LogPosterior.from_function>` has all
# arguments.
#
# ## Sample it
#
# {py:func}`~emcee_femu.run` searches for modes, then samples until the chains have
# converged. It returns emcee's own samplers.

# %%
run = ef.run(posterior, seed=1)
ef.parameter_table(run)

# %%
ef.diagnose(run)

# %% [markdown]
# The statement on the fit stays open, since the data are inside the function.
# `workers=8` evaluates in eight processes, for which the function must be defined in a
# module or script; `backend="run.sqlite", resume=True` keeps the run in a file.
#
# ## The evidence

# %%
evidence = ef.log_evidence(run)
evidence

# %% [markdown]
# This is the evidence with a prior that is uniform in the box. If your function already
# includes its prior, pass bounds only, and add the printed constant to the log evidence.
#
# ## The stretch move beside the others
#
# {py:func}`~emcee_femu.compare_moves` takes any emcee move, and starts all of them from
# the same walkers.

# %%
moves = {"stretch": emcee.moves.StretchMove(), "DE-MC": ef.DEMCMove(), "auto": "auto"}
comparison = ef.compare_moves(posterior, moves, 12, 250, seed=1)
comparison

# %% [markdown]
# {doc}`/tutorials/comparing_moves` explains the columns. The numbers of a move that is
# "too short" are rough.
#
# ## ArviZ
#
# The blob is in the group `response`.

# %%
idata = ef.to_inference_data(run)
at_ten = idata["response"]["blob0"]
print(f"the line at x = 10: {float(at_ten.mean()):.2f} +- {float(at_ten.std()):.2f}")

# %% [markdown]
# {doc}`/how_to/report` has more. {py:func}`~emcee_femu.find_map` and
# {py:func}`~emcee_femu.anneal` work too. Only {py:func}`~emcee_femu.emulate` and
# {py:func}`~emcee_femu.run_emulated` refuse: they learn the response of a model, and a
# log-probability has none.
#
# ## In your own emcee script
#
# The moves are plain emcee moves. One line changes, and
# {py:func}`~emcee_femu.diagnose` takes the samplers; several, since the walkers of one
# ensemble are not independent. Of samplers that `run` did not make nothing is left out
# unless you say so; if their first steps are still a way in, `diagnose` says how many.

# %%
samplers = []
for seed in (1, 2, 3, 4):
    options = {"args": (x, y), "moves": ef.DEMCMove()}
    sampler = emcee.EnsembleSampler(12, 3, log_likelihood, **options)
    sampler.random_state = np.random.RandomState(seed).get_state()  # emcee's seed
    start = np.random.default_rng(seed).normal([1.5, 0.8, 0.5], 0.1, size=(12, 3))
    sampler.run_mcmc(start, 1_500)
    samplers.append(sampler)
plain = ef.diagnose(samplers, discard=300)
plain

# %% [markdown]
# With names they are converted and tabulated, without comparisons with prior and data:

# %%
converted = ef.to_inference_data(samplers, discard=300, names=[*box])
ef.parameter_table(converted)

# %% [markdown]
# `DEMCMove` replaces `emcee.moves.DEMove`; {doc}`/how_to/choose_a_move` has the
# difference. An independence move,
# `[(ef.IndependenceMove.fit(samples), 0.8), (ef.DEMCMove(), 0.2)]`, is more efficient
# if the posterior is close to the distribution fitted to the burn-in. Mixtures,
# backends, pools, `vectorize=True`, blobs and `parameter_names` work as for emcee's own
# moves. An error is raised if all walkers start at a log-probability of -inf, and for
# integer walkers. {py:class}`~emcee_femu.moves.TemperedMove` needs the log-prior as
# first blob, as a {py:class}`~emcee_femu.LogPosterior` returns it, and
# {py:class}`~emcee_femu.moves.HamiltonianMove` a function with the method
# `gradient(theta)`; all others take any function.

# %% tags=["remove-cell"]
# A flat prior of a line: sigma by its exact marginal, the evidence by its integral.
design = np.column_stack([np.ones_like(x), x])
best, squares = np.linalg.lstsq(design, y)[:2]
grid = np.linspace(0.05, 1, 5_000)
log_density = -18 * np.log(grid) - squares / (2 * grid**2)
weights = np.exp(log_density - log_density.max())
log_integral = np.log(weights.sum() * (grid[1] - grid[0])) + log_density.max()
log_integral -= 9 * np.log(2 * np.pi) + 0.5 * np.linalg.slogdet(design.T @ design)[1]
exact = log_integral - np.log(4 * 2 * 1)
assert abs(evidence.log_evidence - exact) < 5 * evidence.log_evidence_error < 0.5
assert f"{np.log(4 * 2 * 1):.4f}" in str(evidence)
sigma = idata["posterior"]["sigma"].values
assert abs(sigma.mean() / np.average(grid, weights=weights) - 1) < 0.03
assert abs(float(at_ten.mean()) - best @ [1, 10]) < 0.1
assert ef.diagnose(run).converged and plain.converged and plain.plain
by_move = {label: value for label, (value, _) in comparison.efficiency.items()}
assert abs(converted["posterior"]["sigma"].values.mean() / sigma.mean() - 1) < 0.03
assert by_move["auto"] > 3 * max(by_move["DE-MC"], by_move["stretch"])
