# %% [markdown]
# # What "auto" does
#
# `run(posterior, seed=1)` with its default `"auto"` searches for the maxima of a
# posterior, fits a proposal to them, freezes it, and samples with it. This page says
# how, and shows what is on record. `python examples/explanation/auto.py` runs it in
# some 4 s.
#
# The simulated example has two maxima. Two storeys of equal mass have the same
# frequencies with stiffnesses k1 (ground) and k2 (upper) as with 2 k2 and k1 / 2:

# %%
import numpy as np

import emcee_femu as ef

frame = {"ground": (0, 1, 60.0), "upper": (1, 2, 60.0)}
model = ef.MassSpringModel([1.0, 1.0], frame)
truth = model({"ground": np.array([200.0]), "upper": np.array([20.0])})
term = ef.FrequencyTerm(truth.frequencies[0], relative_sd=0.01)
uniform = (5, 300)
prior = ef.IndependentPrior({"ground": uniform, "upper": uniform})
posterior = ef.LogPosterior(model, term, prior)
run = ef.run(posterior, seed=1)
run

# %% [markdown]
# ## 1. Search
#
# The search solves 2,000 points; with `steps=`, a fifth as many as the chain has
# evaluations, from 1,000 to 10,000. A bare log-likelihood, whose climbs are dear, gets as
# many as the chain, up to 10,000. Half of them are draws of the prior; half are about the
# maxima found so far, at 2, 4, 8 times their widths and so on. Each ensemble climbs from
# its best point. It then climbs from points whose density is higher than that of the
# Gaussians fitted at the known maxima. If the posterior is not Gaussian, there are many
# such points, and a climb starts only from those that are separated from the nearest
# maximum by a valley (checked at four points on the way). The climbs are those of
# {py:func}`~emcee_femu.find_map`: one solve per step with `jacobian`, `d + 1` without.
#
# Where two parts of a posterior cross, the curvature at a maximum is that of the thinner
# one along each axis, and the Gaussian there is narrower than both. So each Gaussian is
# compared with the density three standard deviations away along its principal axes. From
# the highest point that no Gaussian explains, a Gaussian with the density's gradient and
# curvature there is added, a *shoulder*; it counts no more than the density at its mean
# allows.

# %%
search = run.search
print(f"{search.points} points, {search.climbs} climbs; ends at each maximum:")
print(search.found_by)  # one row per ensemble

# %% [markdown]
# ## 2. Refinement
#
# The proposal has a Student-t component for each maximum and shoulder. "auto" draws from
# it and fits it again to all draws so far by their importance weights. It stops when these
# are nearly equal or no longer improve, after 12 rounds at most. If it then never reaches
# a maximum that a climb found, which holds 3 % of the evidence or more, it goes on with a
# component there. One wide component for gaps and tails (the *defensive* one) has a tenth
# of the weight. Then each tail is followed outwards, by climbs within slabs, until nothing
# there matters to a variance; slabs that draws have hardly seen get components, and so do
# places where ten draws hold much of a variance.
#
# Data may know a product alone, such as that of a modulus and a thickness. Such a ridge is
# bent in the parameters and straight in their logarithms. So each fit is made twice if
# parameters are positive: to the parameters, and to the logarithms of all that are. Akaike's
# criterion chooses between the densities, both of the parameters. A posterior that is a
# small part of its prior looks alike in both.
#
# The posterior of ten stiffnesses from eight frequencies is a bent ridge that no
# mixture follows, in logarithms neither, but the frequencies themselves are smooth. So "auto" learns
# deviations as polynomials of the parameters or of their logarithms. It does so if
# the draws of a mixture are less than half effective, all terms are Gaussian, and
# there are at most 30 parameters. The degree is 4 up to 8 parameters, 3 up to 12,
# then 2. The fit uses some 4,000 solves where walkers on this *response surface* go.
#
# A new mixture is fitted to draws of the density that the surface predicts, of its
# square root and of its fourth root; the roots are wider and cover the tails. If more of
# the proposals that the surface lets pass would be accepted than of the first mixture's,
# and at least 0.2, it screens ten to a hundred of them before each solve
# ({py:class}`~emcee_femu.moves.DelayedAcceptanceMove`): the chain stays exact.
# {doc}`moves_measured` has the gain.

# %%
mixture = search.mixture
print(f"{len(mixture.weights)} components, {mixture.df} degrees of freedom")
print(f"in logarithms: {mixture.logs is not None}")
print(f"efficiency {search.efficiency:.2f}, Pareto k {search.pareto_k:.2f}")

# %% [markdown]
# ## 3. Sampling
#
# The mixture (and the surface, if there is one) is frozen, so the chain is an ordinary
# Markov chain. It has 90 % independence proposals from the mixture, or 60 or 20 % if
# fewer than 0.2 or 0.05 of them would be accepted; 80 % with a surface. The rest is
# `DEMCMove(mode_jump=0.1)`. If fewer than 0.2 would be accepted and the model has
# `jacobian`, it has 80 % [Hamiltonian moves](../how_to/hamiltonian.py) instead, and 10
# % independence proposals if there are several separated maxima.

# %%
for move, share in run.moves:
    print(f"{100 * share:.0f} % {type(move).__name__}")

# %% [markdown]
# All ensembles share the proposal. But each starts from its own draws of it, in the
# maxima that its own climbs found, so that their agreement is evidence. If the proposal
# is poor (Pareto k above 0.7, less than half efficient, and fewer than 0.2 of its proposals
# would be accepted), as with most of 14 parameters at their bounds, each starts from its
# own annealed population ({py:func}`~emcee_femu.anneal`).
#
# Climbs and annealing stop when the search has spent what it may
# ({doc}`/start/choose`).
#
# ## What is on record
#
# `run.search` has the proposal, the separated maxima of its components, and their
# weights by importance sampling with standard errors. It also has how many climbs of
# each ensemble ended at each maximum, and where its walkers start. [The
# verdict](verdict.py) of {py:func}`~emcee_femu.diagnose` compares the chain with it. And it
# says which stage of the search spent which solves:

# %%
print(search)
print("weights of the maxima:", np.round(search.weights, 3))
print("their standard errors:", np.round(search.errors, 3))
ef.diagnose(run)

# %% [markdown]
# A maximum that no point of the search hit is not in the proposal. The chain holds no
# part of the search, so that nothing needs to be discarded. Runs by other moves, which start
# from the prior, find their own burn-in, and all that reads them leaves it out:

# %%
chain = run[0].get_chain().shape
print(f"before: {run.evaluations}; each chain: {chain}")
evidence = ef.log_evidence(run)  # by the frozen proposal: no further solve
print(evidence)
print("burn-in:", run.burn_in)
idata = ef.to_inference_data(run)

# %% [markdown]
# ## What its numbers are worth
#
# `OMP_NUM_THREADS=1 python examples/benchmarks/constants.py` halves and doubles each
# number that steers a search or a chain, one at a time. Each row has ten runs of six
# targets with known answers, and of a seventh, a bent ridge, for the settings and for
# the numbers that it reads; the head of the script describes them. The ten numbers that
# matter are fields of one frozen `Settings`, whose docstring says what each does. Solves are relative to
# those of then, as a geometric mean. "Conv." and "wrong" count the runs that converged
# and those that are wrong. (Measured in the morning of 2026-11-28. Since then numbers that
# changed nothing are gone, and logarithms and shoulders came.)
#
# | | value | halved: solves | conv. | wrong | doubled: solves | conv. | wrong |
# |---|---|---|---|---|---|---|---|
# | today | | 1.00 | 10 | 0 | 1.00 | 10 | 0 |
# | `Settings.sized_for` | 10000 | 0.72 | 10 | 0 | 1.10 | 10 | 0 |
# | `advance.LOOK_FURTHER` | 1.15 | 0.95 | 10 | 0 | 0.98 | 10 | 0 |
# | `Settings.sd_at_end` | 0.05 | 1.15 | 10 | 0 | 0.92 | 10 | 0 |
# | `Settings.least_budget` | 30000 | 1.13 | 10 | 0 | 1.00 | 10 | 0 |
# | `Settings.searched_share` | 0.2 | 0.89 | 10 | 0 | 1.10 | 10 | 0 |
# | `Settings.most_searched` | 10000 | 0.78 | 10 | 0 | 1.00 | 10 | 0 |
# | `auto.ROUND` | 300 | 0.87 | 10 | 0 | 0.98 | 10 | 0 |
# | `Settings.bent` | 0.5 | 1.14 | 10 | 0 | 1.08 | 10 | 0 |
# | `Settings.independence_shares` | several | 1.34 | 10 | 0 | 0.93 | 10 | 0 |
# | `Settings.untested` | 2 | 1.00 | 10 | 0 | 1.02 | 10 | 1 |
# | `Settings.fruitless` | 4 | 1.19 | 9 | 1 | 1.00 | 10 | 0 |
# | `explore.SCAN_WIDENS` | 2 | 1.05 | 10 | 0 | 0.90 | 10 | 0 |
# | `Settings.dfs` | several | 1.00 | 10 | 0 | 1.20 | 9 | 0 |
# | `adapt.HELD_BY_TERMS` | 0.08 | 1.04 | 10 | 0 | 1.01 | 10 | 0 |
#
# The last two rows were measured a day before, when runs ended at 50 autocorrelation
# times, and so were the other numbers: 41 changed none of these runs; 66 changed solves
# by 3 % at most, and no verdict. `WEIGHED_WHERE_BENT` was tried on ten storeys alone
# ({doc}`moves_measured`).
#
# No number is on an edge. Of 48 changes, 46 leave all ten runs converged
# and right. `fruitless` halved or `untested` doubled makes the two equal: the search
# ends before it asks for valleys, and one of two runs on ten maxima is wrong. With `dfs`
# doubled no tail is heavy enough for Student's t, which spends all 120,000 solves.
#
# A smaller search is cheaper (`sized_for`, `most_searched`, `searched_share`), but none
# of these targets hides a narrow maximum that it would miss. A few percent are chance. So
# the table says which numbers matter, not which values are best.
#
# Of the 41 numbers that changed nothing here, 24 changed something in cases of the tests:
# few solves or few steps, annealing, gradients, ten storeys, or a solver that prints
# few digits.

# %% tags=["remove-cell"]
names = [type(move).__name__ for move, _ in run.moves]
assert names == ["IndependenceMove", "DEMCMove"] and abs(run.moves[0][1] - 0.9) < 1e-9
assert search.points >= 0.2 * 4 * chain[0] * chain[1] and search.pareto_k < 0.7
assert search.found_by.shape == (4, 2) and max(search.errors) < 0.05
stiff = search.label(np.array([[200.0, 20.0]]))[0]
share = (idata.posterior["ground"].values > 120).mean()
# Two estimates of a weight differ by no more than their errors say.
errors = [
    search.errors[stiff],
    (share * (1 - share) / ef.diagnose(run).ess_bulk[0]) ** 0.5,
]
assert abs(share - search.weights[stiff]) < 3 * np.hypot(*errors)
assert ef.diagnose(run).converged
assert run.evaluations > search.points and evidence.log_evidence_error < 0.1
