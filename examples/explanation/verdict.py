# %% [markdown]
# # What the verdict means
#
# This page explains what each statement of {py:func}`~emcee_femu.diagnose` is based on,
# why R-hat over walkers is not convergence, what to do about a complaint, and what no
# diagnosis can see. `python examples/explanation/verdict.py` runs the page (10 s).
#
# `diagnose(run)` ends in three statements, on the chains, the search and the fit, each
# with a status of its own. Chains of a wrong model converge too, so look at all three.
#
# The example is a simulated two-storey frame with a soft lower or a soft upper storey,
# which have the same two frequencies (Beck and Au 2002): two modes far apart.

# %%
from textwrap import fill, indent

import matplotlib.pyplot as plt
import numpy as np

import emcee_femu as ef

lower, upper = np.diag([29.7e6, 0.0]), 29.7e6 * np.array([[1.0, -1.0], [-1.0, 1.0]])
K, M = {"x1": lower, "x2": upper}, np.diag([16.5e3, 16.1e3])
model = ef.MatrixModel(np.zeros((2, 2)), M, K, n_modes=2)
term = ef.FrequencyTerm([3.13, 9.83], relative_sd=0.01)
bounds = [(0.1, 3.0), (0.05, 1.5)]
prior = ef.GaussianPrior([*K], [1.2, 0.6], [0.6, 0.3], bounds)
posterior = ef.LogPosterior(model, term, prior)
run = ef.run(posterior, seed=1)
good = ef.diagnose(run)
good

# %% [markdown]
# ## Chains
#
# The first check that fails withholds "converged". `diagnosis.chains.short` is its
# name; `diagnosis.chains.sentence` has the number, its limit, and one action. If a
# longer chain helps, it says how many `steps` are enough for all failed checks. With
# `backend=` and `resume=True` a run continues to there.
#
# | `chains.short` | what was seen | what to do |
# |---|---|---|
# | the chain begins elsewhere | the first steps are another distribution than the second half | `discard=` the number that it says, or run the steps |
# | N walkers stuck | a parameter of a walker never changed | look at the starts, and at failed solves |
# | too short | fewer than 25 autocorrelation times | run the steps that it says |
# | walkers stay apart | R-hat over walkers above 1.05, in shorter chains above 1.1 | run the steps; far above, `moves="auto"` |
# | sd unknown | a standard deviation is uncertain by 10 % or more (`sd_error`), as in heavy tails, or where walkers wait | run the steps; sample the logarithm of a scale |
# | ensembles disagree | R-hat over ensembles above 1.01, or means or variances scatter more than their own errors allow | run the steps; far above, `moves="auto"` |
# | a mode is lost | a search ended, or walkers started, where the chain has none | more walkers |
# | weights disagree | the weight of a mode differs between the chain and importance sampling | run the steps |
# | weights unknown | neither the chain nor importance sampling determines a weight to within 0.05 | run the steps |
# | proposal too narrow | there are several modes, and Pareto k is above 0.7 of weights p / q that are half or less efficient; or too few accepted proposals from a mode (20); or waits that make the error of a mean, or of a weight, larger than 0.05 sd | run the steps |
# | one ensemble, starts given | nothing, but nothing could have been seen: the status is "well mixed" | `ensembles=4`, starts from the prior |
#
# Runs by moves other than "auto" start from the prior. Such a run finds its own burn-in
# (`run.burn_in`, at most half of the steps: those without which the means of all
# parameters and of their squares have the smallest standard errors, by the marginal
# standard error rule of White, 1997), and the verdict, tables and figures leave it out
# unless `discard=` says otherwise. `run[0].get_chain()` is emcee's own and has all steps.
#
# ## R-hat over walkers is mixing, not convergence
#
# R-hat compares chains that should have the same distribution. It compares the variance
# $B$ of their means with the mean $W$ of their variances,
#
# $$ \hat R = \sqrt{\frac{n - 1}{n} + \frac{B}{W}} , $$
#
# where each chain is cut in two and its values are replaced by normal scores of their
# ranks (Vehtari et al. 2021). It is 1 if the chains agree. *Independent* chains from
# *over-dispersed* starts that end in the same distribution have probably forgotten
# their starts. The walkers of one ensemble are not independent: each moves by the
# differences of the others. So R-hat over walkers shows walkers that stay apart, but
# not whether all of them are where the posterior is.
#
# A common habit is to optimise, and then to start all walkers in a small ball about the
# optimum. {py:func}`~emcee_femu.find_map` finds two maxima; the start of a climb
# decides which one it reaches. Here the ensembles begin in either or in the same, among
# other faults:

# %%
maxima = np.array([m.theta for m in ef.find_map(posterior, seed=1).maxima])
ball = 0.005 * np.random.default_rng(1).standard_normal((4, 8, 2))
same, own = maxima[[0, 0, 0, 0], None] + ball, maxima[[0, 1, 1, 0], None] + ball
both = maxima[[0, 1] * 4] + ball  # of the walkers of each ensemble
small = ef.MetropolisMove(sd=0.04)
settings = {
    "60 steps": dict(steps=60, starts=same),
    "walkers in both modes": dict(steps=2_000, starts=both, moves=small),
    "each in its own mode": dict(steps=800, starts=own),
    "all in one mode": dict(steps=800, starts=same),
    "one ensemble in one mode": dict(steps=800, starts=same[0], ensembles=1),
}
runs, shorts = {}, {}
for title, setting in settings.items():
    options = {"moves": ef.DEMCMove(), "nwalkers": 8, "seed": 1} | setting
    runs[title] = ef.run(posterior, **options)
    diagnosis = ef.diagnose(runs[title])
    shorts[title] = diagnosis.chains.short
    print(f"{title}:\n{indent(fill(diagnosis.chains.sentence, 76), '  ')}\n")

# %% [markdown]
# If the ensembles are in different modes, each is well mixed according to R-hat over its
# walkers, and reports half of the posterior with full confidence. They disagree only
# when they are compared. If all are in the same mode, they agree in every number and are
# all wrong. No diagnosis of chains detects this, but the statement says that the starts
# were given. Without `starts` they are drawn from the prior, further apart than the
# posterior is wide, as R-hat needs. The dotted density of $x_1$ is by quadrature:

# %% mystnb={"image": {"alt": "Left: four histograms of x1, two at each of two separated peaks. Right: four histograms that all follow both peaks of the exact density"}}
x1, x2 = np.linspace(0.1, 3.0, 300), np.linspace(0.05, 1.5, 300)
grid = np.stack(np.meshgrid(x1, x2, indexing="ij"), axis=-1).reshape(-1, 2)
values = posterior(grid)[:, 0]
density = np.exp(values - values.max()).reshape(300, 300).sum(axis=1)
density /= density.sum() * (x1[1] - x1[0])
figure, panels = plt.subplots(1, 2, figsize=(9, 3.4), sharey=True, layout="constrained")
compared = {"balls about optima": runs["each in its own mode"][:], "auto": run}
for axes, (title, chains) in zip(panels, compared.items(), strict=True):
    for number, sampler in enumerate(chains):
        draws = sampler.get_chain(discard=chains.burn_in, flat=True)[:, 0]
        name, bins = f"ensemble {number + 1}", np.linspace(0.3, 2.1, 120)
        axes.hist(draws, bins, density=True, histtype="step", label=name)
    axes.plot(x1, density, "k:", label="exact")
    axes.set(xlim=(0.3, 2.1), xlabel="x1", title=title)
panels[0].set_ylabel("density of x1")
panels[0].legend()
plt.close(figure)  # shown once, by the next line
figure

# %% [markdown]
# R-hat over ensembles should be below 1.01, as Vehtari et al. advise; over walkers,
# `diagnose` complains only above 1.05, or up to 1.1 if the chain is shorter than 50
# autocorrelation times. One walker is a short chain: with $n$ steps and an
# autocorrelation time $\tau$, R-hat of perfectly healthy walkers is about
# $\sqrt{1 + 2 \tau / n}$.
#
# ## Why 25 autocorrelation times, where emcee asks for 50
#
# emcee's estimate of $\tau$ is too small in a short chain, because each walker is
# centred on its own mean: at $25 \tau$ by 30 %, at $50 \tau$ by 17 %. Here the largest
# of all ensembles and parameters decides. Of four ensembles and five parameters it is
# 4 % too small at $25 \tau$, and 10 % too large at $50 \tau$; with one parameter it is
# 16 % too small at $25 \tau$. With a single ensemble nothing makes up for it, and the
# status is at most "well mixed". Errors of means and of standard deviations are from
# the ESS of all ensembles, which does not depend on this $\tau$.
# `tests/results/test_diagnostics.py` holds these numbers.
#
#
# ## What "auto" adds
#
# The checks from "a mode is lost" to "proposal too narrow" need what `"auto"` found
# (`run.search`), and no solve. The frozen proposal q is an importance sampler beside
# the chain, so it gives the weights of separated modes independently. At the chain's
# own draws, p / q says how long a walker waits there. A place that holds the share m of
# the mass at z standard deviations, from which a proposal is accepted with probability a,
# adds 2 m z^2 / (a n) to the squared error of a mean by n draws, and a quarter of
# 2 m z^4 / (a n), nearly, to that of a standard deviation. So a long wait matters only
# where much of a variance is. `diagnose(...).maxima` has these numbers (`mean_error`,
# `sd_error`); weights are printed if there are several separated modes (above).
#
# ## Search: what no diagnosis sees
#
# No diagnosis sees what neither a search nor a walker has visited. The search of
# `"auto"` ([how many points, and where](auto.py)) may miss a mode if the region from
# which a climb would lead there is too small: if it holds less than about 3 / points
# both of the prior and of the surroundings of the found modes. (Where 3 hits are
# expected, the chance of none is 5 %.) The statement says how small that is:

# %%
points = good.maxima.searched
print(f"{points} points: a region of {3 / points:.1e} may be missed")

# %% [markdown]
# Remedies are a longer run by `steps=`, other seeds, your own starts (`starts=`, which
# are searched too), and [tempering](../how_to/tempering.py).
#
# ## Fit: the right posterior of a wrong model
#
# `diagnosis.fit` compares the measurement with new measurements drawn from the
# posterior, as {py:func}`~emcee_femu.predictive_table` does. And every term with
# residuals is judged by their chi-squared, as a whole and by mode, sensor, channel and
# so on: `diagnosis.data_table` prints it beside what a right model gives. Shapes that do
# not fit are tried with each sensor put right ({py:func}`~emcee_femu.check_test`), and
# what could not be judged is named. The status is "fits",
# "doubtful" (all is inside, but a parameter is more than four prior standard deviations
# from its prior mean, as with frequencies in rad/s; the response is the same at all
# samples; modes of the structure have changed places since the prior mean, by the
# model's own shapes, while frequencies are compared in ascending order; or there was a
# warning before the run), "at a bound" (a parameter is pressed against one), "does not
# fit" (which includes an inferred error more than two prior standard deviations above
# its prior mean), or "not checked" if data or posterior are unknown, as for plain
# samplers. One of five values outside its 95 % interval is no cause for alarm. Two are,
# and so is a single one at four standard deviations. Here are the same frequencies in
# rad/s, a mistake that chains cannot show:

# %%
import warnings

in_rad = ef.FrequencyTerm(2 * np.pi * np.array([3.13, 9.83]), relative_sd=0.01)
with warnings.catch_warnings(record=True) as caught:
    warnings.simplefilter("always")
    wrong = ef.run(ef.LogPosterior(model, in_rad, prior), steps=100, seed=1)
unfit = ef.diagnose(wrong).fit
said = f"Warning: {caught[0].message}", f"Fit: {unfit.sentence}"
print(*(fill(sentence, 80) for sentence in said), sep="\n\n")

# %% [markdown]
# The warning comes before any sampling ({doc}`/start/choose` says when). The statement
# on the fit names what is farthest out and the likeliest cause: a sensor, a spurious
# mode, pairing, units, then the model and its error. How often both statements were
# right is on the page [How often is a converged run right?](calibration.md).
#
# Sources: Beck and Au (2002),
# [doi:10.1061/(ASCE)0733-9399(2002)128:4(380)](https://doi.org/10.1061/(ASCE)0733-9399(2002)128:4(380));
# Vehtari et al. (2021), [doi:10.1214/20-BA1221](https://doi.org/10.1214/20-BA1221).

# %% tags=["remove-cell"]
assert good.converged and len(good.maxima.importance) == 2
assert good.search.status == "searched" and good.fit.status == "fits"
assert unfit.status == "does not fit" and all("rad/s" in s for s in said)
expected = ["too short", "walkers stay apart", "ensembles disagree", "starts given"]
assert [*shorts.values()] == [*expected, "one ensemble"]
exact = density[x1 < 1].sum() * (x1[1] - x1[0])
assert abs(exact - 0.513) < 0.002
for sampler in run:
    assert abs((sampler.get_chain()[..., 0] < 1).mean() - exact) < 0.05
