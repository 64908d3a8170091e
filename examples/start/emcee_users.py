# %% [markdown]
# # The moves in your own emcee script
#
# The moves of this package are plain emcee moves and work with any log-probability. In a
# script with an `emcee.EnsembleSampler`, one line changes.
# `python examples/start/emcee_users.py` runs this page.

# %%
import emcee
import numpy as np

from emcee_femu import DEMCMove

NDIM, NWALKERS = 5, 20
covariance = 0.5 + 0.5 * np.eye(NDIM)  # all correlations 0.5
precision = np.linalg.inv(covariance)


def log_prob(x):  # yours: anything that emcee takes
    return -0.5 * x @ precision @ x


start = np.random.default_rng(1).normal(size=(NWALKERS, NDIM))
sampler = emcee.EnsembleSampler(NWALKERS, NDIM, log_prob, moves=DEMCMove())
sampler.random_state = np.random.RandomState(1).get_state()  # emcee's seed
state = sampler.run_mcmc(start, 2_000)
samples = sampler.get_chain(discard=500, flat=True)
print(np.cov(samples.T).diagonal().round(2))

# %% [markdown]
# `DEMCMove` replaces `emcee.moves.DEMove`. It proposes
# $\theta_i + \gamma(\theta_a - \theta_b) + \epsilon$ with
# $\gamma = 2.38/\sqrt{2d}$; emcee's move varies $\gamma$ at random and has no $\epsilon$.
# Mixtures, backends, pools, `vectorize=True`, blobs and `parameter_names` work as for
# emcee's own moves.
#
# ## A verdict, ArviZ, figures
#
# {py:func}`~emcee_femu.diagnose` accepts plain samplers. The walkers of one ensemble are
# not independent, so run several ensembles and pass all of them. A plain sampler holds no
# search and no data, and the statements on both say so.

# %%
import emcee_femu as ef

samplers = [sampler]
for seed in (2, 3, 4):
    other = emcee.EnsembleSampler(NWALKERS, NDIM, log_prob, moves=DEMCMove())
    other.random_state = np.random.RandomState(seed).get_state()
    other.run_mcmc(3 * np.random.default_rng(seed).normal(size=start.shape), 2_000)
    samplers.append(other)
ef.diagnose(samplers, discard=500)

# %% [markdown]
# ArviZ reads a sampler with `from_emcee`, and the figures of this package accept the
# result:

# %% tags=["remove-stderr"]
import arviz as az

idata = az.from_emcee(sampler, var_names=["a", "b", "c", "d", "e"])
az.summary(idata.isel(draw=slice(500, None)))

# %% mystnb={"image": {"alt": "Scatter of three parameters; their ellipses lean to the right, all correlations are 0.5"}}
ef.figures.plot_scatter(idata.isel(draw=slice(500, None)), var_names=["a", "b", "c"])

# %% [markdown]
# {py:func}`~emcee_femu.parameter_table` accepts it too, without the columns of the prior.
# A comparison with prior, data or model needs a {py:class}`~emcee_femu.LogPosterior`.
# {doc}`/how_to/with_arviz` has more, such as names for the parameters of a sampler.
#
# ## Compared with emcee's moves
#
# With more than a few parameters, differential evolution is more efficient than the
# stretch move. It is about as efficient as emcee's `DEMove`, with less overhead per
# generation. An independence move, `[(ef.IndependenceMove.fit(samples), 0.8),
# (DEMCMove(), 0.2)]`, is more efficient than both if the posterior is close to the
# distribution fitted to the burn-in. [Moves measured](../explanation/moves_measured.md)
# has the numbers, other packages included.
#
# Differences from emcee's own moves:
#
# - fewer than 2 walkers per dimension raise an error, as in emcee
#   (`live_dangerously=True` allows them);
# - an error is raised if all walkers start at a log-probability of -inf;
# - integer walkers raise an error, since emcee would truncate accepted values;
# - {py:class}`~emcee_femu.moves.TemperedMove` needs the log-prior as first blob, as a
#   {py:class}`~emcee_femu.LogPosterior` returns it, and
#   {py:class}`~emcee_femu.moves.HamiltonianMove` a function with the method
#   `gradient(theta)`; all others take any function.

# %% tags=["remove-cell"]
assert abs(np.cov(samples.T) - covariance).max() < 0.2
assert ef.diagnose(samplers, discard=500).converged
