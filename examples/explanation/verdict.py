# %% [markdown]
# # What the verdict means
#
# After this page you will know what each verdict of {py:func}`~emcee_femu.diagnose` has
# seen, what to do about it, and what no verdict can see.
# `python examples/explanation/verdict.py` runs the page (5 s).
#
# `diagnose(samplers)` reports autocorrelation time, ESS, acceptance, stuck walkers and
# R-hat, and ends in one sentence. The first check that speaks withholds "Converged by
# every check", and the sentence says what to do.

# %%
from textwrap import fill, indent

import matplotlib.pyplot as plt
import numpy as np

import emcee_femu as ef

# A two-storey frame with a soft lower or a soft upper storey: two modes far apart
lower, upper = np.diag([29.7e6, 0.0]), 29.7e6 * np.array([[1.0, -1.0], [-1.0, 1.0]])
model = ef.MatrixModel(
    np.zeros((2, 2)), np.diag([16.5e3, 16.1e3]), {"x1": lower, "x2": upper}, n_modes=2
)
term = ef.FrequencyTerm([3.13, 9.83], relative_sd=0.005)
prior = ef.GaussianPrior(
    ["x1", "x2"], [1.2, 0.6], [0.6, 0.3], bounds=[(0.1, 3.0), (0.05, 1.5)]
)
posterior = ef.LogPosterior(model, term, prior)
samplers = ef.run(posterior, "auto", nsteps=200, ensembles=4, seed=1)
good = ef.diagnose(samplers)
good

# %% [markdown]
# ## The verdicts, in the order of the checks
#
# :::{list-table}
# :header-rows: 1
# :widths: 20 45 35
#
# * - `short`
#   - what was seen
#   - what to do
# * - N walkers stuck
#   - a parameter of a walker never changed
#   - look at the starts, and at failed solves
# * - too short
#   - fewer than 50 autocorrelation times
#   - run longer
# * - walkers stay apart
#   - R-hat over walkers above 1.05
#   - a move between modes: `DEMCMove(mode_jump=0.1)`
# * - sd unknown
#   - the ESS of squared deviations leaves a standard deviation 10 % or more uncertain
#     (`sd_error`)
#   - run longer; sample the logarithm of a scale
# * - ensembles disagree
#   - R-hat over ensembles above 1.01
#   - run longer, or a move between modes
# * - ensembles scatter
#   - of three ensembles or more, means or variances scatter more than their own errors
#     allow (`scatter` above 1: a chi-square)
#   - run longer: something is slower than tau says
# * - a mode is lost
#   - a search ended, or walkers started, where the chain has none
#   - more walkers, or `TemperedMove`
# * - weights disagree
#   - a separated group weighs otherwise in the chain than by importance sampling, or
#     than in other ensembles, by four standard errors
#   - run longer, and with another seed
# * - weights unknown
#   - neither chain nor importance sampling knows a group's weight to within 0.05
#   - run longer
# * - a group is left too rarely
#   - from a group the frozen proposal is accepted fewer than 20 times in a run
#   - run longer, or `TemperedMove`
# * - proposal too narrow
#   - Pareto k above 0.7 of the weights p / q, where they are half or less efficient, at
#     the proposal's own draws or the chain's
#   - more walkers or steps, or `DEMCMove()`
# * - walkers wait too long
#   - fewer than 10 accepted proposals to be expected in the run from the worst place
#     that a walker reached, such as the end of a tail that q lacks
#   - run longer, or `DEMCMove()`
# * - one ensemble, starts given
#   - nothing, but nothing could have been seen
#   - `ensembles=4`, starts from the prior
# :::
#
# Walkers of one ensemble are not independent: R-hat over them shows mixing, not
# convergence. [R-hat over walkers](r_hat.py) has the reasons.
#
# ## Some of them, live
#
# The same frame, with runs that are too short, too narrow, or alone:

# %%
starts = np.array([m.theta for m in ef.find_map(posterior, seed=1).maxima])
ball = 0.005 * np.random.default_rng(1).standard_normal((4, 8, 2))
same, own = starts[[0, 0, 0, 0], None] + ball, starts[[0, 1, 0, 1], None] + ball
both = starts[[0, 1] * 4] + ball  # of the walkers of each ensemble
settings = {
    "60 steps": dict(nsteps=60, initial=same),
    "walkers in both modes": dict(
        moves=ef.MetropolisMove(sd=0.02), nsteps=2_500, initial=both
    ),
    "each in its own mode": dict(nsteps=600, initial=own),
    "all in one mode": dict(nsteps=600, initial=same),
    "one ensemble in one mode": dict(nsteps=600, initial=same[0], ensembles=1),
}
shorts = {}
for title, setting in settings.items():
    runs = ef.run(posterior, nwalkers=8, **({"ensembles": 4, "seed": 1} | setting))
    found = ef.diagnose(runs, discard=setting["nsteps"] // 6)
    shorts[title] = found.short
    print(f"{title}: {found.short}\n{indent(fill(found.verdict, 76), '  ')}\n")

# %% [markdown]
# ## What "auto" adds
#
# The six verdicts from "a mode is lost" to "walkers wait too long" need what `"auto"`
# found (`sampler.recipe.record`) and no solve. The frozen proposal q is an importance
# sampler beside the chain: it knows the weights of separated groups by itself. And at
# the chain's own draws p / q says how long a walker waits there. These numbers are in
# `diagnose(...).groups`, printed as a table where there are several separated groups
# (above), and work from the ArviZ object too. Pareto k of draws of q is k / (1 - k) of
# draws of p, and is converted.

# %% mystnb={"image": {"alt": "Two groups, each with four dots for the ensembles' weights and a bar for the weight by importance sampling; they agree"}}
groups = good.groups
figure, axes = plt.subplots(figsize=(5.5, 3), layout="constrained")
for g in range(2):
    axes.errorbar(
        g, groups.importance[g], 2 * groups.importance_errors[g], fmt="ks", capsize=4
    )
    axes.plot(g + np.linspace(0.1, 0.25, 4), groups.weights[:, g], "C0o")
axes.set(xticks=[0, 1], xticklabels=["group 1", "group 2"], ylabel="weight")
axes.set(xlim=(-0.5, 1.5), title="squares: importance sampling; dots: four ensembles")
plt.close(figure)  # shown once, by the next line
figure

# %% [markdown]
# ## What no diagnosis sees
#
# No diagnosis sees what neither a search nor a walker has visited. The search of
# `"auto"` sees by points, a fifth as many as the chain has evaluations and at least
# 1,000: half of them draws of the prior, half about the modes found. A mode from whose
# region a climb would lead to it may be missed where that region holds less than about
# 3 / points both of the prior and of the surroundings of the found modes (of 3 expected
# hits none is made with a chance of 5 %). The sentence says how small that is:

# %%
print(f"{groups.searched} points: a region of {3 / groups.searched:.1e} may be missed")
print(f"chance that 3 expected hits are none: {np.exp(-3):.3f}")

# %% [markdown]
# More steps search more; other seeds and starts (`initial=`, which are searched too)
# are the other remedy, and [tempering](../how_to/tempering.py). Starts that were all
# given in one place show nothing about other modes, which the verdict says.
#
# ## Converged, and then?
#
# A converged chain has the right posterior of a model that may be wrong.
# {py:func}`~emcee_femu.identifiability` says in a sentence for each parameter whether
# the data informed it, also before any sampling, [from a
# maximum](../how_to/first_look.py).
# {py:func}`~emcee_femu.predictive_table` and {py:func}`~emcee_femu.plot_predictive` show
# whether the updated model predicts what was measured. How often "converged" was right
# on targets of known answer is on the page [Is what is called converged also
# right?](calibration.md).

# %% tags=["remove-cell"]
assert good.converged and len(groups.importance) == 2
assert shorts["60 steps"].startswith("too short")
assert shorts["walkers in both modes"] == "walkers stay apart"
assert shorts["each in its own mode"] == "ensembles disagree"
assert shorts["all in one mode"] == "starts given"
assert shorts["one ensemble in one mode"] == "one ensemble"
errors = np.hypot(groups.importance_errors, 0.02)
assert (np.abs(groups.weights.mean(axis=0) - groups.importance) < 4 * errors).all()
