# %% [markdown]
# # Many parameters: Hamiltonian moves
#
# For models with ten parameters and more and with derivatives. Random walks need more
# solves the more parameters there are. If a model has `jacobian`, as all of this
# package have, a gradient comes with a solve, and
# {py:class}`~emcee_femu.moves.HamiltonianMove` follows it. This page tunes and runs
# it. `python examples/how_to/hamiltonian.py` runs the page.
#
# Each proposal is the end of a trajectory of `steps` leapfrog steps, one solve each.
#
# A ten-storey tower has a weak fourth storey; five frequencies and shapes at every
# second floor are measured (all simulated):

# %%
import numpy as np

import emcee_femu as ef

names = [f"k{i}" for i in range(1, 11)]
tower = {name: (i, i + 1, 100.0) for i, name in enumerate(names)}
model = ef.MassSpringModel(np.ones(10), tower, shapes=range(1, 10, 2))
test = model({"k4": np.array([70.0])})
terms = [ef.FrequencyTerm(test.frequencies[0, :5], relative_sd=0.01)]
terms += [ef.ShapeTerm(test.shapes[0, :, :5], delta=0.03)]
prior = ef.GaussianPrior(names, np.full(10, 100.0), 25.0, [(10.0, 300.0)] * 10)
posterior = ef.LogPosterior(model, terms, prior)

# %% [markdown]
# ## 1. A maximum, and the covariance there
#
# The *metric*, a covariance near that of the posterior, makes all directions alike.
# With `metric=None`, the variances of the prior, many more steps are needed.
# {py:func}`~emcee_femu.find_map` gives a metric with few solves.

# %%
found = ef.find_map(posterior, 4, seed=1, check=0)
best = found.maxima[0]
samples = found.draw(12, seed=1)
print(f"{found.solves} solves; maximum", best.theta.round())

# %% [markdown]
# ## 2. Tune
#
# `tuned` chooses step size and number of steps, with some 70 gradients per sample. Then
# both are frozen, and the chain is exact.

# %%
move = ef.moves.HamiltonianMove.tuned(posterior, samples, best.covariance, seed=1)
print(move.steps, "steps of", round(move.step_size, 2))

# %% [markdown]
# ## 3. Run
#
# Walkers move independently, so a few are enough. Start them at a maximum or after a
# burn-in: from draws of the prior the move is slow.

# %% tags=["result"]
starts = found.draw(4 * 8, seed=2).reshape(4, 8, 10)
run = ef.run(posterior, move, nwalkers=8, steps=100, seed=1, starts=starts)
diagnosis = ef.diagnose(run, discard=20)
diagnosis

# %% [markdown]
# The chains are only called well mixed, since starts in one place see no other mode;
# `find_map` looked for one. A step of the chain costs `steps` evaluations. [Moves
# measured](../explanation/moves_measured.md) has buildings of 20, 30 and 50 storeys.
#
# The move does not cross between modes: mix it with one that does. [What "auto"
# does](../explanation/auto.py) says when it uses Hamiltonian moves by itself.

# %% tags=["remove-cell"]
assert diagnosis.rhat_between.max() < 1.05
mean = run[0].get_chain(discard=20, flat=True).mean(axis=0)
assert abs(mean[3] - 70) < 12 and best.converged
assert 0.6 < run[0].acceptance_fraction.mean() < 0.98
