# %% [markdown]
# # What the verdict means
#
# After this page you will know what each statement of {py:func}`~emcee_femu.diagnose` has
# seen, why R-hat over walkers is not convergence, what to do about a complaint, and what
# none can see. `python examples/explanation/verdict.py` runs the page (10 s).
#
# `diagnose(run)` ends in three statements, each with a status of its own. *Chains*: did
# they converge, by which number, and how many steps does it take? *Search*: what was
# found, and how small a mode may be missing? *Fit*: is what was measured inside the
# posterior predictive? Chains of a wrong model converge too, so look at all three. The
# example is a two-storey frame with a soft lower or a soft upper storey, which have the
# same two frequencies (Beck and Au 2002): two modes far apart.

# %%
from textwrap import fill, indent

import matplotlib.pyplot as plt
import numpy as np

import emcee_femu as ef

lower, upper = np.diag([29.7e6, 0.0]), 29.7e6 * np.array([[1.0, -1.0], [-1.0, 1.0]])
model = ef.MatrixModel(
    np.zeros((2, 2)), np.diag([16.5e3, 16.1e3]), {"x1": lower, "x2": upper}, n_modes=2
)
term = ef.FrequencyTerm([3.13, 9.83], relative_sd=0.01)
prior = ef.GaussianPrior(
    ["x1", "x2"], [1.2, 0.6], [0.6, 0.3], bounds=[(0.1, 3.0), (0.05, 1.5)]
)
posterior = ef.LogPosterior(model, term, prior)
run = ef.run(posterior, steps=300, seed=1)
good = ef.diagnose(run)
good

# %% [markdown]
# ## Chains
#
# The first check that speaks withholds "converged"; `diagnosis.chains.short` is its name,
# and `diagnosis.chains.sentence` has the number, its limit, and one action. Where a longer
# chain is the cure it says which `steps` will do for all that spoke; with `backend=` and
# `resume=True` a run goes on to there.
#
# | `chains.short` | what was seen | what to do |
# |---|---|---|
# | N walkers stuck | a parameter of a walker never changed | look at the starts, and at failed solves |
# | too short | fewer than 50 autocorrelation times | run the steps that it says |
# | walkers stay apart | R-hat over walkers above 1.05 | run the steps; far above, `moves="auto"` |
# | sd unknown | a standard deviation is uncertain by 10 % or more (`sd_error`), as in heavy tails | run the steps; sample the logarithm of a scale |
# | ensembles disagree | R-hat over ensembles above 1.01, or means or variances scatter more than their own errors allow | run the steps; far above, `moves="auto"` |
# | a mode is lost | a search ended, or walkers started, where the chain has none | more walkers |
# | weights disagree | a mode weighs otherwise in the chain than by importance sampling | run the steps |
# | weights unknown | neither chain nor importance sampling knows a weight to within 0.05 | run the steps |
# | proposal too narrow | Pareto k above 0.7 of weights p / q that are half or less efficient; or too few accepted proposals from a mode (20), or, with k above 0.5, from the worst place reached (10) | run the steps |
# | one ensemble, starts given | nothing, but nothing could have been seen: the status is "well mixed" | `ensembles=4`, starts from the prior |
#
# ## R-hat over walkers is mixing, not convergence
#
# R-hat compares chains that should have the same distribution: the variance $B$ of
# their means with the mean $W$ of their variances,
#
# $$ \hat R = \sqrt{\frac{n - 1}{n} + \frac{B}{W}} , $$
#
# each chain cut in two and its values replaced by normal scores of their ranks (Vehtari
# et al. 2021). It is 1 where the chains agree. *Independent* chains from
# *over-dispersed* starts that end in the same distribution have probably forgotten where
# they came from. The walkers of one ensemble are not independent: each moves by the
# differences of the others. R-hat over walkers sees walkers that stay apart; it cannot
# say that all of them are where the posterior is.
#
# A common habit: optimise, then start all walkers in a small ball about the optimum.
# {py:func}`~emcee_femu.find_map` finds two maxima, and which of them a single climb meets
# depends on where it starts. Here the ensembles begin in either or in the same, among
# other faults:

# %%
maxima = np.array([m.theta for m in ef.find_map(posterior, seed=1).maxima])
ball = 0.005 * np.random.default_rng(1).standard_normal((4, 8, 2))
same, own = maxima[[0, 0, 0, 0], None] + ball, maxima[[0, 1, 1, 0], None] + ball
both = maxima[[0, 1] * 4] + ball  # of the walkers of each ensemble
settings = {
    "60 steps": dict(steps=60, starts=same),
    "walkers in both modes": dict(
        moves=ef.MetropolisMove(sd=0.02), steps=2_500, starts=both
    ),
    "each in its own mode": dict(steps=800, starts=own),
    "all in one mode": dict(steps=800, starts=same),
    "one ensemble in one mode": dict(steps=800, starts=same[0], ensembles=1),
}
runs, shorts = {}, {}
for title, setting in settings.items():
    options = {"moves": ef.DEMCMove(), "nwalkers": 8, "seed": 1} | setting
    runs[title] = ef.run(posterior, **options)
    diagnosis = ef.diagnose(runs[title], discard=setting["steps"] // 6)
    shorts[title] = diagnosis.chains.short
    print(f"{title}:\n{indent(fill(diagnosis.chains.sentence, 76), '  ')}\n")

# %% [markdown]
# Those in their own modes are well mixed, one by one, by R-hat over their walkers, and
# each has half of the posterior with full confidence; only side by side they cannot
# agree. Those in one mode agree by every number, and are wrong together. No diagnosis of
# chains sees this, but the statement knows that the starts were given. Without `starts`
# they are drawn from the prior, further apart than the posterior is wide: that is what
# R-hat needs. The share of $x_1 < 1$ by quadrature is the dotted density below:

# %% mystnb={"image": {"alt": "Left: four histograms of x1, two at each of two separated peaks. Right: four histograms that all follow both peaks of the exact density"}}
x1, x2 = np.linspace(0.1, 3.0, 300), np.linspace(0.05, 1.5, 300)
grid = np.stack(np.meshgrid(x1, x2, indexing="ij"), axis=-1).reshape(-1, 2)
values = posterior(grid)[:, 0]
density = np.exp(values - values.max()).reshape(300, 300).sum(axis=1)
density /= density.sum() * (x1[1] - x1[0])
figure, panels = plt.subplots(1, 2, figsize=(9, 3.4), sharey=True, layout="constrained")
compared = {"balls about optima": runs["each in its own mode"][:], "auto": run}
for axes, (title, chains) in zip(panels, compared.items(), strict=True):
    for sampler in chains:
        draws = sampler.get_chain(discard=100, flat=True)[:, 0]
        axes.hist(draws, np.linspace(0.3, 2.1, 120), density=True, histtype="step")
    axes.plot(x1, density, "k:")
    axes.set(xlim=(0.3, 2.1), xlabel="x1", title=title)
panels[0].set_ylabel("density of x1")
plt.close(figure)  # shown once, by the next line
figure

# %% [markdown]
# R-hat over ensembles should be below 1.01, as Vehtari et al. advise; over walkers
# `diagnose` only speaks above 1.05. One walker is a short chain: with $n$ steps and an
# autocorrelation time $\tau$ its mean has the variance $\tau / n$ of the posterior's, in
# halves twice that, so that R-hat of perfectly healthy walkers is about
# $\sqrt{1 + 2 \tau / n}$: 1.02 at the 50 $\tau$ that are asked for.

# %% [markdown]
# ## What "auto" adds
#
# The checks from "a mode is lost" to "proposal too narrow" need what `"auto"` found
# (`run.search`) and no solve. The frozen proposal q is an importance sampler beside the
# chain: it knows the weights of separated modes by itself. And at the chain's own draws
# p / q says how long a walker waits there. These numbers are in `diagnose(...).modes`,
# printed as a table where there are several separated modes (above), and work from the
# ArviZ object too. Pareto k of draws of q is k / (1 - k) of draws of p, and is converted.
#
# ## Search: what no diagnosis sees
#
# No diagnosis sees what neither a search nor a walker has visited. The search of
# `"auto"` sees by points, a fifth as many as the chain has evaluations and at least
# 1,000: half of them draws of the prior, half about the modes found. A mode from whose
# region a climb would lead to it may be missed where that region holds less than about
# 3 / points both of the prior and of the surroundings of the found modes (of 3 expected
# hits none is made with a chance of 5 %). The statement says how small that is:

# %%
points = good.modes.searched
print(f"{points} points: a region of {3 / points:.1e} may be missed")

# %% [markdown]
# More steps search more; other seeds and starts (`starts=`, which are searched too)
# are the other remedy, and [tempering](../how_to/tempering.py).
#
# ## Fit: the right posterior of a wrong model
#
# `diagnosis.fit` compares what was measured with new measurements drawn from the
# posterior, as {py:func}`~emcee_femu.predictive_table` does: its status is "fits", "at a
# bound" (a parameter is pressed against one), "does not fit", or "not checked" where data
# or posterior are not known, as of plain samplers. A single value outside of 95 % of five
# is no alarm, two are, and so is one at four standard deviations. An error that is
# inferred more than two prior standard deviations above its prior mean does not fit
# either. Here are the same frequencies in rad/s, a mistake that no chain minds:

# %%
import warnings

in_rad = ef.FrequencyTerm(2 * np.pi * np.array([3.13, 9.83]), relative_sd=0.01)
with warnings.catch_warnings(record=True) as caught:
    warnings.simplefilter("always")
    wrong = ef.run(ef.LogPosterior(model, in_rad, prior), steps=100, seed=1)
doubt = str(caught[0].message)
unfit = ef.diagnose(wrong).fit
print(fill(f"Warning: {doubt}", 80), fill(f"Fit: {unfit.sentence}", 80), sep="\n\n")

# %% [markdown]
# The warning comes before any sampling: `run` solves the model at the prior mean, and if
# all values of a variable are off by more than a factor of 3, to the same side, there and
# at 16 draws of the prior, it names both numbers.
#
# The cure that Fit names is one: units; or, where a term with five times as many values
# infers its own error and outvotes the one that does not fit, known standard
# deviations; or an error of the model, if there is none yet.
# {py:func}`~emcee_femu.identifiability` says in a sentence for each parameter whether
# the data informed it. How often "converged" was right on targets of known answer is on
# the page [How often is a converged run right?](calibration.md).
#
# Sources: Beck and Au (2002),
# [doi:10.1061/(ASCE)0733-9399(2002)128:4(380)](https://doi.org/10.1061/(ASCE)0733-9399(2002)128:4(380));
# Vehtari et al. (2021), [doi:10.1214/20-BA1221](https://doi.org/10.1214/20-BA1221).

# %% tags=["remove-cell"]
assert good.converged and len(good.modes.importance) == 2
assert good.search.status == "searched" and good.fit.status == "fits"
assert "rad/s instead of Hz?" in doubt and unfit.status == "does not fit"
assert "rad/s instead of Hz?" in unfit.sentence
assert shorts["60 steps"] == "too short"
assert shorts["walkers in both modes"] == "walkers stay apart"
assert shorts["each in its own mode"] == "ensembles disagree"
assert shorts["all in one mode"] == "starts given"
assert shorts["one ensemble in one mode"] == "one ensemble"
exact = density[x1 < 1].sum() * (x1[1] - x1[0])
assert abs(exact - 0.513) < 0.002
for sampler in run:
    assert abs((sampler.get_chain()[..., 0] < 1).mean() - exact) < 0.05
