# %% [markdown]
# # What the verdict means
#
# For those who must decide whether to trust a result: what the three statements of
# `diagnose(run)` are based on, what to do about a complaint, and what no diagnosis can
# see. Chains of a wrong model converge too, so look at all three. `python examples/explanation/verdict.py` runs the page.
#
# The example is a simulated two-storey frame: with a soft lower or a soft upper storey
# it has the same two frequencies (Beck and Au 2002).

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
# ## Convergence of chains
#
# The first check that fails withholds "converged". `diagnosis.chains.short` is its
# name; `diagnosis.chains.sentence` has the number, its limit, and what to do, such as
# roughly how many `steps` are needed in all.
#
# | `chains.short` | what was seen | what to do |
# |---|---|---|
# | the chain begins elsewhere | its first steps have another distribution than its second half | `discard=` as it says, or more steps |
# | N walkers stuck | a parameter of a walker never changed | look at starts and failed solves |
# | too short | fewer than 25 autocorrelation times | the steps that it says |
# | walkers stay apart | R-hat over walkers above 1.05 (1.1 in short chains) | more steps; far above, `moves="auto"` |
# | sd unknown | a standard deviation is uncertain by 10 % or more | more steps; sample the logarithm of a scale |
# | ensembles disagree | R-hat over ensembles above 1.01, or their means differ too much | more steps; far above, `moves="auto"` |
# | a mode is lost | the search found a mode that the chain does not have | more walkers |
# | weights disagree, weights unknown | chain and importance sampling disagree on the weight of a mode, or neither knows it | more steps |
# | proposal too narrow | walkers wait where the proposal hardly goes | more steps |
# | one ensemble, starts given | nothing could have been seen: the status is "well mixed" | `ensembles=4`, starts from the prior |
#
# ## Burn-in
#
# Runs by moves other than "auto" start from the prior and find their burn-in
# (`run.burn_in`); tables and figures leave it out.
#
# ## R-hat
#
# R-hat (Vehtari et al. 2021) is 1 if chains agree. *Independent* chains from
# *over-dispersed* starts that do have probably forgotten their starts. The walkers of
# one ensemble are not independent: R-hat over walkers does not show whether all of them
# are where the posterior is.
#
# A common habit is to optimise, and to start all walkers in a small ball about the
# optimum. Here the ensembles begin about either optimum or the same, among other faults:

# %%
maxima = np.array([m.theta for m in ef.find_map(posterior, seed=1).maxima])
ball = 0.005 * np.random.default_rng(1).standard_normal((4, 8, 2))
same, own = maxima[[0, 0, 0, 0], None] + ball, maxima[[0, 1, 1, 0], None] + ball
both = maxima[[0, 1] * 4] + ball  # of the walkers of each ensemble
small = ef.MetropolisMove(sd=0.04)
settings = {
    "60 steps": dict(steps=60, starts=same),
    "walkers in both modes": dict(steps=1_000, starts=both, moves=small),
    "each in its own mode": dict(steps=400, starts=own),
    "all in one mode": dict(steps=400, starts=same),
    "one ensemble in one mode": dict(steps=400, starts=same[0], ensembles=1),
}
runs, shorts = {}, {}
for title, setting in settings.items():
    options = {"moves": ef.DEMCMove(), "nwalkers": 8, "seed": 1} | setting
    runs[title] = ef.run(posterior, **options)
    diagnosis = ef.diagnose(runs[title])
    shorts[title] = diagnosis.chains.short
    print(f"{title}:\n{indent(fill(diagnosis.chains.sentence, 76), '  ')}\n")

# %% [markdown]
# In different modes each ensemble is well mixed and reports half of the posterior with
# full confidence; only a comparison shows it. In the same mode they agree in every
# number and are all wrong. No diagnosis of chains detects this, but the statement says
# that the starts were given. The dotted density of $x_1$ is by quadrature:

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
# ## Search
#
# No diagnosis sees what neither the search nor a walker has visited. The search of
# ["auto"](auto.py) may miss a mode if the region from which a climb leads there is too
# small, and the statement says how small:

# %%
points = good.maxima.searched
print(f"{points} points: a region of {3 / points:.1e} may be missed")

# %% [markdown]
# Remedies are more `steps=`, other seeds, your own `starts=`, which are searched too, and
# [tempering](../how_to/tempering.py).
#
# ## Fit
#
# The statement compares the data with new measurements drawn from the posterior, and
# residuals with what a right model gives, as a whole and by mode, sensor and channel
# (`diagnosis.data_table`). It names what is farthest out with its likeliest cause: a
# sensor ({py:func}`~emcee_femu.check_test`), a spurious mode, pairing, units, then the
# model and its error. And it names what could not be judged.
#
# | `fit.status` | what was seen |
# |---|---|
# | fits | nothing out of the ordinary; one of five values outside its interval is no alarm |
# | doubtful | a parameter very far from its prior mean; modes that changed places unpaired; the same response at all samples; a warning before the run |
# | at a bound | a parameter is pressed against its bound |
# | does not fit | data farther out than chance allows, or an inferred error far above its prior |
# | not checked | data or posterior are unknown, as for plain samplers |
#
# Here are the same frequencies in rad/s, a mistake that chains cannot show:

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
# The warning comes before any sampling. How often the verdict was right is measured in
# [How often is a converged run right?](calibration.md)
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
