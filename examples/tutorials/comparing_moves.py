# %% [markdown]
# # Comparing moves
#
# For those who wonder which sampler is best for *their* posterior: this page measures
# it, explains the table, and shows how certain the answer is. `python
# examples/tutorials/comparing_moves.py` runs the page. Its building and
# frequencies are made up.
#
# ## What to measure
#
# In model updating the FE solve is what costs, and every proposal inside the bounds
# takes one, accepted or not. The benefit is *effective samples*: n correlated draws
# determine a mean as well as ESS = n / tau independent ones, where tau is the
# autocorrelation time. So the currency is
#
# $$e = \frac{1000 \min_j \mathrm{ESS}_j}{\text{evaluations}}$$
#
# that is, effective samples per 1000 evaluations of the log-posterior, for the worst
# parameter j. Two other numbers are often printed instead, and neither will do:
#
# - **Acceptance.** Small steps are nearly always accepted, and lead nowhere.
# - **The c.o.v. of the parameters.** It belongs to the posterior, not to the sampler; a
#   smaller one comes from walkers that have not yet spread (below).
#
# ## A posterior
#
# The first three natural frequencies of a five-storey building were measured. Five
# stiffnesses and three data: one storey can make up for what another loses, so the
# posterior is a thin, tilted ellipsoid.

# %%
import emcee
import numpy as np

import emcee_femu as ef

names = ["k1", "k2", "k3", "k4", "k5"]
storeys = {name: (i, i + 1, 9e6) for i, name in enumerate(names)}
model = ef.MassSpringModel(np.full(5, 5e3), storeys)
term = ef.FrequencyTerm([1.88, 5.63, 8.60], relative_sd=0.01)  # Hz
bounds = [(3e6, 18e6)] * 5
prior = ef.GaussianPrior(names, np.full(5, 9e6), 1.8e6, bounds)
posterior = ef.LogPosterior(model, term, prior)

# %% [markdown]
# ## The contest
#
# {py:func}`~emcee_femu.compare_moves` takes what {py:func}`~emcee_femu.run` takes: a
# move, a mixture, a move of emcee's, or "auto". A random walk tuned to the covariance
# of an earlier run needs that run first:

# %%
(first,) = ef.run(posterior, ef.DEMCMove(), nwalkers=20, steps=400, seed=2, ensembles=1)
draws = first.get_chain(discard=200, flat=True)
moves = {
    "M-H, small steps": ef.MetropolisMove(sd=np.full(5, 0.1e6)),
    "M-H, tuned": ef.MetropolisMove.tuned(draws),
    "emcee StretchMove": emcee.moves.StretchMove(),
    "DE-MC": ef.DEMCMove(),
    "auto": "auto",
}
compared = ef.compare_moves(posterior, moves, 20, steps=250, seed=2)
compared

# %% [markdown]
# All moves start from the same draws of the prior, in four independent ensembles. No
# random walk is long enough to be judged here: use five times as many steps.
#
# ## Reading the table
#
# | column | meaning |
# |---|---|
# | solves | of the whole run; proposals out of bounds cost none |
# | before chain | evaluations for the starts, and for the search of "auto" |
# | burn-in | steps that the run found to be its way in, and that are left out; "auto" has none |
# | acceptance | share of accepted proposals |
# | tau, steps/tau | autocorrelation time; how many of them the kept chain holds |
# | ESS bulk, ESS tail | effective samples of all ensembles, for means and for the ends of intervals |
# | ESS per 1000, +- | the currency e, and its standard error from the spread of the ensembles |
# | ESS per CPU s | the same by processor time: of interest where solves are cheap |
# | end to end | e with all evaluations counted: burn-in, starts and search |
# | verdict | that of {py:func}`~emcee_femu.diagnose` on the chains |
#
# A move wins only if its lead is more than two combined standard errors, and if it has
# converged: a chain of fewer than 25 autocorrelation times does not know its own tau,
# nor its ESS. The conclusion also says if burn-in and search reverse the order.

# %% tags=["result"] mystnb={"image": {"alt": "One row per move with its ESS per 1000 evaluations: auto far to the right, tuned M-H and DE-MC close to each other, the stretch move and small steps behind them; beside it the error of each running mean"}}
ef.figures.plot_comparison(compared)

# %% [markdown]
# Hatched bars have not converged. The right panel shows how soon each mean is known.
# Differential evolution and tuned Metropolis-Hastings are about equally efficient: the
# differences of walkers lie along the ellipsoid, so DE-MC saves the tuning run and no
# more. The independence proposal of "auto" can jump anywhere. Among the random walks,
# the one with the highest acceptance is the worst.
#
# ## Why not the c.o.v.
#
# The c.o.v. of k5, in percent, beside that of the converged chains. It is from four
# short runs whose walkers start close together, at the mean of the first run:


# %%
def cov(samples):  # in percent
    return 100 * samples.std() / samples.mean()


def early(move, start):  # over steps 50 to 100 of four ensembles
    run = ef.run(posterior, move, 20, 100, seed=3, starts=start)
    return [cov(own.get_chain(discard=50)[:, :, 4]) for own in run]


rng = np.random.default_rng(3)
together = draws.mean(axis=0) * (1 + 0.01 * rng.standard_normal((4, 20, 5)))
small = early(moves["M-H, small steps"], together)
demc = early(moves["DE-MC"], together)
exact = cov(compared.idata["auto"].posterior["k5"].values)
print("M-H, small steps:", np.round(small, 1))
print("DE-MC:           ", np.round(demc, 1))
print(f"converged:        {exact:.1f}")

# %% [markdown]
# The walkers with small steps have by far the smallest c.o.v., and it is wrong. Judged
# by it, the worst move would have won.
#
# `max_evaluations=100_000` in place of `steps` gives every move the same number of
# evaluations. [Moves measured](../explanation/moves_measured.md) has long runs.

# %% tags=["remove-cell"]
table = compared.table.to_frame().set_index("move")
e, verdict = table["ESS per 1000"], table["verdict"]
assert compared.winner == "auto" and verdict["auto"] == "converged"
assert e["auto"] > 3 * e["DE-MC"] > 4.5 * e["M-H, small steps"]
assert 0.5 < e["M-H, tuned"] / e["DE-MC"] < 2
assert table["acceptance"].iloc[:4].idxmax() == "M-H, small steps"
assert max(small) < 0.6 * exact and max(small) < min(demc)
