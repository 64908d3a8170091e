# %% [markdown]
# # What R-hat over walkers means, and what it does not
#
# After this page you will know why `diagnose` prints two columns of R-hat, why only
# the one over *ensembles* can see a missed mode, and when even that one cannot.
# `python examples/explanation/r_hat.py` runs the page (5 s).
#
# R-hat compares chains that should have the same law: the variance $B$ of their means
# with the mean $W$ of their variances,
#
# $$ \hat R = \sqrt{\frac{n - 1}{n} + \frac{B}{W}} , $$
#
# each chain cut in two and its values replaced by normal scores of their ranks (Vehtari
# et al. 2021). It is 1 where the chains agree. Its logic is that of repeated tests:
# *independent* chains from *over-dispersed* starts that end in the same law have
# probably forgotten where they came from.
#
# The walkers of one ensemble are not independent. Each moves by the differences of the
# others. So R-hat over walkers says how well they have mixed *with one another*: it
# sees walkers that stay apart, or one that is stuck. It cannot say that all of them are
# where the posterior is.
#
# ## Two stiffness distributions that fit alike
#
# A two-storey frame with two measured frequencies has two explanations: a soft lower
# storey, or a soft upper one (the example of Beck and Au 2002). The prior allows both.

# %%
import emcee
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

# %% [markdown]
# Two parameters allow quadrature, so the truth is known: the share of the mode with a
# soft lower storey, $x_1 < 1$.

# %%
x1, x2 = np.linspace(0.1, 3.0, 300), np.linspace(0.05, 1.5, 300)
grid = np.stack(np.meshgrid(x1, x2, indexing="ij"), axis=-1).reshape(-1, 2)
values = np.concatenate([posterior(part)[:, 0] for part in np.array_split(grid, 20)])
density = np.exp(values - values.max()).reshape(300, 300).sum(axis=1)
density /= density.sum() * (x1[1] - x1[0])
exact = density[x1 < 1].sum() * (x1[1] - x1[0])
print(f"share of x1 < 1: {exact:.3f}")

# %% [markdown]
# ## One ensemble from a small ball
#
# A common habit: optimise, then start all walkers in a small ball about the optimum.
# {py:func}`~emcee_femu.find_map` finds two maxima. Which of them a single search meets
# depends on where it starts; here two ensembles of four start at each. First the
# ensembles one by one:

# %%
maxima = np.array([m.theta for m in ef.find_map(posterior, seed=1).maxima])
rng = np.random.default_rng(3)
ball = 0.01 * rng.standard_normal((4, 8, 2))
trapped = ef.run(
    posterior,
    nwalkers=8,
    nsteps=800,
    ensembles=4,
    seed=1,
    initial=maxima[[0, 1, 1, 0], None] + ball,
)
for sampler in trapped:
    found = ef.diagnose(sampler, discard=200)
    share = (sampler.get_chain(discard=200)[..., 0] < 1).mean()
    print(
        f"R-hat over walkers {found.rhat_within.max():.3f}, tau {found.tau.max():.0f}, "
        f"share {share:.2f}: {found.short}"
    )

# %% [markdown]
# Every ensemble is well mixed by R-hat over its walkers, and every one has half of the
# posterior with full confidence. This is why one ensemble never gets the verdict
# "converged", only "one ensemble". Side by side they cannot agree:

# %%
together = ef.diagnose(trapped, discard=200)
together

# %% [markdown]
# Now all four start at the *same* optimum. They agree, by every number, and are wrong
# together. No diagnosis from chains can see this, but the verdict knows that the starts
# were given:

# %%
alike = ef.run(
    posterior,
    nwalkers=8,
    nsteps=800,
    ensembles=4,
    seed=2,
    initial=maxima[:1, None] + ball,
)
agreed = ef.diagnose(alike, discard=200)
agreed

# %% [markdown]
# ## Starts from the prior, and a move between modes
#
# Without `initial` the starts are drawn from the prior, so that ensembles start further
# apart than the posterior is wide: that is what R-hat needs. `"auto"` looks for modes
# before it samples, and each ensemble starts where its own search ended.

# %%
samplers = ef.run(posterior, "auto", nsteps=300, ensembles=4, seed=1)
right = ef.diagnose(samplers)
right

# %% [markdown]
# The figure: left, each ensemble has one half of the posterior, and R-hat over walkers
# is as good as it gets. Right, all four have both, in the shares of the quadrature
# (dotted).

# %% mystnb={"image": {"alt": "Left: four histograms of x1, two at each of two separated peaks. Right: four histograms that all follow both peaks of the exact density"}}
figure, panels = plt.subplots(1, 2, figsize=(9, 3.4), sharey=True, layout="constrained")
runs = {"balls about an optimum": (trapped, 200), "auto": (samplers, 0)}
for axes, (title, (chains, discard)) in zip(panels, runs.items(), strict=True):
    found = ef.diagnose(chains, discard=discard)
    for sampler in chains:
        draws = sampler.get_chain(discard=discard)[..., 0].ravel()
        axes.hist(draws, np.linspace(0.3, 2.1, 120), density=True, histtype="step")
    axes.plot(x1, density, "k:")
    within, between = found.rhat_within.max(), found.rhat_between.max()
    axes.set_title(f"{title}\nR-hat: walkers {within:.2f}, ensembles {between:.2f}")
    axes.set(xlim=(0.3, 2.1), xlabel="x1")
panels[0].set_ylabel("density of x1")
plt.close(figure)  # shown once, by the next line
figure

# %% [markdown]
# ## The same R-hat, two thresholds
#
# R-hat over ensembles should be below 1.01, as Vehtari et al. advise. Over walkers
# `diagnose` only speaks above 1.05. One walker is a short chain: with $n$ steps and an
# autocorrelation time $\tau$ its mean has the variance $\tau / n$ of the posterior's,
# in halves twice that, so that R-hat of perfectly healthy walkers is about
# $\sqrt{1 + 2 \tau / n}$: 1.02 at the 50 $\tau$ that are asked for.

# %%
sampler = emcee.EnsembleSampler(
    20, 5, lambda x: -0.5 * (x**2).sum(axis=1), moves=ef.DEMCMove(), vectorize=True
)
stream = np.random.RandomState(1).get_state()
start = np.random.default_rng(1).standard_normal((20, 5))
sampler.run_mcmc(emcee.State(start, random_state=stream), 4_000)
tau = ef.diagnose(sampler).tau.max()
healthy = []
for lengths in (25, 50, 100):
    last = 4_000 - round(lengths * tau)
    rhat = ef.diagnose(sampler, discard=last).rhat_within.mean()
    healthy.append((rhat, np.sqrt(1 + 2 / lengths)))
    print(
        f"{lengths:3} tau: R-hat over walkers {rhat:.3f}, expected {healthy[-1][1]:.3f}"
    )

# %% [markdown]
# ## What to do
#
# - Run `ensembles=4` and give no `initial`: the starts come from the prior.
# - R-hat over walkers above 1.05: walkers stay apart. `DEMCMove(mode_jump=0.1)`, or
#   `"auto"`.
# - R-hat over ensembles above 1.01: they have seen different things. Run longer, or a
#   move between modes.
# - Both near 1: no chain contradicts another. A mode that neither a search nor a start
#   came near is still missing; [the verdict](verdict.py) says how small it may be.
#
# Sources: Beck and Au (2002),
# [doi:10.1061/(ASCE)0733-9399(2002)128:4(380)](https://doi.org/10.1061/(ASCE)0733-9399(2002)128:4(380));
# Vehtari et al. (2021), [doi:10.1214/20-BA1221](https://doi.org/10.1214/20-BA1221).

# %% tags=["remove-cell"]
assert abs(exact - 0.513) < 0.002
for sampler in trapped:
    found = ef.diagnose(sampler, discard=200)
    assert found.rhat_within.max() < 1.05 and found.short == "one ensemble"
    assert (sampler.get_chain(discard=200)[..., 0] < 1).mean() in (0.0, 1.0)
assert together.rhat_between.max() > 1.5 and not together.converged
assert agreed.short == "starts given" and agreed.rhat_between.max() < 1.01
assert right.converged
for sampler in samplers:
    assert abs((sampler.get_chain()[..., 0] < 1).mean() - exact) < 0.05
for rhat, expected in healthy:
    assert abs(rhat - expected) < 0.4 * (expected - 1)
