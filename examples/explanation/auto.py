# %% [markdown]
# # What "auto" does
#
# For those who want to know what the solves of `run(posterior, seed=1)` are spent on,
# when its default move `"auto"` is not the best choice, and what is on record
# afterwards. In short: "auto" searches for the maxima of the posterior, fits a proposal
# to them, freezes it, and samples with it. `python examples/explanation/auto.py` runs
# the page.
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
# The search solves points: half of them are draws of the prior, half lie about the
# maxima found so far, nearer and farther. Each ensemble climbs from its best point, and
# then from points whose density is higher than the Gaussians at the known maxima
# explain, if a valley separates them from the nearest maximum. The climbs are those of
# {py:func}`~emcee_femu.find_map`. Where two parts of a posterior cross, the curvature at a
# maximum is that of neither. So mass beside a maximum that its Gaussian does not explain
# gets a Gaussian of its own, a *shoulder*.

# %%
search = run.search
print(f"{search.points} points, {search.climbs} climbs; ends at each maximum:")
print(search.found_by)  # one row per ensemble

# %% [markdown]
# ## 2. Proposal
#
# A mixture of Student-t components, at first one for each maximum, is fitted again and
# again to its own draws by their importance weights, until these are nearly equal or no
# longer improve. Each tail of the posterior is followed outwards until nothing there
# matters to a variance, and gets a component where it does.
#
# Data may know a product alone, such as that of a modulus and a thickness. Such a ridge
# is bent in the parameters and straight in their logarithms. So parameters whose prior
# has no density at zero or below are fitted in logarithms too, and the better fit is
# kept.
#
# If no mixture is good, as for a thin ridge that is bent, there are two more attempts:
#
# - With Gaussian terms and at most 30 parameters, "auto" learns the response as
#   polynomials of the parameters. This *response surface* screens proposals before each
#   solve ({py:class}`~emcee_femu.moves.DelayedAcceptanceMove`): the chain stays exact.
# - Each ensemble starts from a population that is annealed from the prior
#   ({py:func}`~emcee_femu.anneal`).

# %%
mixture = search.mixture
print(f"{len(mixture.weights)} components, {mixture.df} degrees of freedom")
print(f"efficiency {search.efficiency:.2f}, Pareto k {search.pareto_k:.2f}")

# %% [markdown]
# ## 3. Sampling
#
# The mixture (and the surface, if there is one) is frozen, so the chain is an ordinary
# Markov chain. Most proposals are independent draws of the mixture; the rest are moves
# of DE-MC. The worse the mixture fits, the more of these there are, or of [Hamiltonian
# moves](../how_to/hamiltonian.py) if the model has `jacobian`.

# %%
for move, share in run.moves:
    print(f"{100 * share:.0f} % {type(move).__name__}")

# %% [markdown]
# All ensembles share the proposal. But each starts from its own draws of it, in the
# maxima that its own climbs found, so that their agreement is evidence. The chain holds
# no part of the search, and nothing needs to be discarded.
#
# ## What you can decide
#
# | if | then |
# |---|---|
# | a solve takes minutes | {py:func}`~emcee_femu.emulate` first: {doc}`/tutorials/hundred_solves` |
# | the run may cost less | `solves=`: the search, too, becomes smaller, and may miss more |
# | you suspect another solution | `starts=` near it, which are searched too; other seeds |
# | there are some 30 parameters or more, and derivatives | {doc}`/how_to/hamiltonian` |
# | "auto" accepts few proposals (`print(run.search)` says how efficient they are) | {py:func}`~emcee_femu.compare_moves` with `DEMCMove()`, a longer run |
# | you want the sampler of the paper, or emcee's own | `moves=`: {doc}`/how_to/choose_a_move` |
#
# {doc}`/start/choose` has the number of points, and what the search may spend.
# {doc}`moves_measured` compares "auto" with other moves, {doc}`stages_measured` says what
# each stage buys for its solves, and {doc}`calibration` how often it was right.
#
# ## What is on record
#
# `run.search` has the proposal, the separated maxima of its components, and their
# weights by importance sampling with standard errors. Maxima with a shallow
# valley between them count as one, for walkers pass it easily. It also has how many
# climbs of each ensemble ended at each maximum, and where its walkers start. [The
# verdict](verdict.py) of {py:func}`~emcee_femu.diagnose` compares the chain with it. And
# it says which stage of the search spent which solves:

# %%
print(search)
print("weights of the maxima:", np.round(search.weights, 3))
print("their standard errors:", np.round(search.errors, 3))
ef.diagnose(run)

# %% [markdown]
# A maximum that no point of the search hit is not in the proposal.

# %%
chain = run[0].get_chain().shape
print(f"before: {run.evaluations}; each chain: {chain}")
evidence = ef.log_evidence(run)  # by the frozen proposal: no further solve
print(evidence)
idata = ef.to_inference_data(run)

# %% tags=["remove-cell"]
names = [type(move).__name__ for move, _ in run.moves]
assert names == ["IndependenceMove", "DEMCMove"] and abs(run.moves[0][1] - 0.9) < 1e-9
assert search.points >= 0.1 * 4 * chain[0] * chain[1] and search.pareto_k < 0.7
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
