# %% [markdown]
# # DE-MC, and why not all walkers may move at once
#
# What the paper's sampler does, where its factor $2.38 / \sqrt{2d}$ comes from, and why
# half of the walkers stand still while the others move: to move all at once gives wrong
# variances. `python examples/explanation/de_mc.py` runs the page.
#
# ## The proposal
#
# Metropolis-Hastings needs a step that fits the posterior. If it is too small, the
# chain creeps; if it is too large, nothing is accepted. If parameters are correlated,
# the step must be correlated too. Differential evolution Markov chain (DE-MC) takes the
# step from the ensemble itself (Eq. 3.2 of the paper):
#
# $$ \theta^* = \theta_i + \gamma (\theta_a - \theta_b) + \varepsilon, \qquad
#    r = \min\Big\{1, \frac{p(\theta^*)}{p(\theta_i)}\Big\} . $$
#
# The difference of two other walkers, drawn at random, has the scales and correlations
# of the posterior, with nothing to tune.

# %%
import emcee
import matplotlib.pyplot as plt
import numpy as np
from emcee.model import Model

import emcee_femu as ef

# %% mystnb={"image": {"alt": "An ellipse of grey walkers: an arrow from one walker to another, and the same arrow, longer, from a third walker to its proposal"}}
rng = np.random.default_rng(3)
walkers = rng.multivariate_normal([0, 0], [[1, 0.8], [0.8, 1]], 60)
here, a, b = np.array([[-1.3, -0.9], [1.4, 1.0], [0.3, -0.4]])
figure, axes = plt.subplots(figsize=(4.6, 4.2), layout="constrained")
axes.plot(*walkers.T, "o", color="0.8", ms=4)
axes.set(aspect="equal", xlabel=r"$\theta_1$", ylabel=r"$\theta_2$")
step = here + 2.38 / np.sqrt(2 * 2) * (a - b)
for end, start, color in ((a, b, "C0"), (step, here, "C3")):
    axes.annotate("", end, start, arrowprops={"arrowstyle": "-|>", "color": color})
places = {r"$\theta_a$": a, r"$\theta_b$": b, r"$\theta_i$": here, r"$\theta^*$": step}
for label, place in places.items():
    axes.annotate(label, place, (5, -14), textcoords="offset points", fontsize=13)
plt.close(figure)  # shown once, by the next line
figure

# %% [markdown]
# ## Where gamma comes from
#
# For a Gaussian posterior of covariance $\Sigma$ in many dimensions, the best Gaussian
# random walk has steps of covariance $(2.38^2 / d) \Sigma$ (Roberts, Gelman and Gilks
# 1997). The difference of two independent walkers has covariance $2 \Sigma$. Equating
# $2 \gamma^2 \Sigma$ with the former gives $\gamma = 2.38 / \sqrt{2 d}$.
#
# With it, about a third of the proposals are accepted in few dimensions, about a
# quarter in many. The rule is for one mode that is nearly Gaussian. Between modes a
# step must be as long as the distance of two walkers in them: $\gamma = 1$, which
# `mode_jump=0.1` of {py:class}`~emcee_femu.DEMCMove` uses for one walker in ten.
#
# ## What the noise is for
#
# Differences of walkers stay in the plane that the walkers span. With too few walkers,
# or walkers that start in a plane, the chain never leaves it. The noise $\varepsilon$
# makes every place reachable, and is too small to cost acceptance. By default it is a
# hundredth of the spread of the walkers at rest, for each parameter by itself, so areas
# of 1e-4 and stiffnesses of 1e10 can stand side by side.
#
# A jitter of gamma, as in `emcee.moves.DEMove`, stays in the plane too. A parameter in
# which all walkers agree to the last digit gets no noise by default: give `sigma`.
#
# ## Why the target is preserved
#
# $N$ walkers have the joint density $p(\theta_1) \cdots p(\theta_N)$. Move walker $i$
# while all others stand still. The pairs $(a, b)$ and $(b, a)$ are equally likely, and
# so are $\varepsilon$ and $-\varepsilon$: the way back is proposed as often as the way
# there. So Metropolis' rule preserves the joint density (detailed balance), exactly and
# for any $N$. It is not an approximation for many walkers.
#
# The paper moves one walker after the other, so its FE solves cannot run in parallel.
# It is tempting to compute all $N$ proposals from the present generation and to accept
# each by itself, and some programs do. But then $\theta_a$ and $\theta_b$ move in the
# same step as $\theta_i$: to come back, walker $i$ would need the difference of their
# *new* places. The way back is not proposed as often: the joint density changes.
#
# `DEMCMove` splits the walkers into two halves and moves one half while the other, its
# guides, stands still. So detailed balance holds, and a whole half is one batch of
# solves. `nsplits=nwalkers` is the paper's sweep.
#
# ## Exact start: how wrong is it?
#
# Draw many ensembles from a Gaussian of variance 1 in three dimensions, and move them.
# A correct move keeps the variance at 1. First the wrong move:


# %%
def move_at_once(theta, rng):
    """Move all walkers of ``theta (ensembles, N, d)`` from one generation: wrong."""
    e, n, d = theta.shape
    first, second = rng.integers(1, n, (e, n)), rng.integers(1, n - 1, (e, n))
    second += second >= first  # two distinct others, counted from the walker itself
    rows = np.arange(e)[:, None]
    a, b = (theta[rows, (np.arange(n) + k) % n] for k in (first, second))
    step = 2.38 / np.sqrt(2 * d) * (a - b)
    proposed = theta + step + 0.01 * rng.standard_normal(theta.shape)
    change = -0.5 * (proposed**2 - theta**2).sum(axis=2)
    accepted = np.log(rng.random((e, n))) < change
    return np.where(accepted[..., None], proposed, theta)


def wrong_variances(n, ensembles, steps=150, d=3, seed=1):
    """Return the mean square of each ensemble after each step."""
    rng = np.random.default_rng(seed)
    theta = rng.standard_normal((ensembles, n, d))
    found = []
    for _ in range(steps):
        theta = move_at_once(theta, rng)
        found.append((theta**2).mean(axis=(1, 2)))
    return np.array(found)


# %% [markdown]
# Then `DEMCMove` as emcee calls it, ensemble by ensemble:


# %%
def demc_variances(n, ensembles, steps=100, seed=1):
    """Return the same for DEMCMove."""
    random = np.random.RandomState(seed)

    def solve(theta):
        return -0.5 * (theta**2).sum(axis=1), None

    model, move = Model(None, solve, map, random), ef.DEMCMove(live_dangerously=True)
    found = np.empty((steps, ensembles))
    for e in range(ensembles):
        theta = random.standard_normal((n, 3))
        state = emcee.State(theta, log_prob=solve(theta)[0])
        for step in range(steps):
            state, _ = move.propose(model, state)
            found[step, e] = (state.coords**2).mean()
    return found


def ratio(found):
    """Return the variance over the truth in the last 50 steps, and its error."""
    by_ensemble = found[-50:].mean(axis=0)
    return by_ensemble.mean(), by_ensemble.std() / np.sqrt(len(by_ensemble))


sizes = {4: 250, 6: 120, 12: 60, 24: 30}  # walkers, ensembles of DEMCMove
wrong = {n: wrong_variances(n, 12_000 // n) for n in sizes}
right = {n: demc_variances(n, ensembles) for n, ensembles in sizes.items()}
print("walkers      all at once           DEMCMove")
for n in sizes:
    one, other = (f"{m:.3f} +- {e:.3f}" for m, e in map(ratio, (wrong[n], right[n])))
    print(f"{n:7}  {one}  {other:>18}")
paper = ratio(wrong_variances(10, 2_000, d=5))
print(f"\n10 walkers, 5 parameters, all at once: {paper[0]:.3f} +- {paper[1]:.3f}")

# %% [markdown]
# The first column is the variance over the truth when all move at once. With four walkers
# it is far too small, and more steps make it worse. The error shrinks with the number of
# walkers; from 4 $d$ on it is hardly visible, which is why the mistake has survived in
# programs. With 2 $d$ walkers, the usual number and that of the paper, variances are a
# few percent too small. `pytest -m "slow or not slow" tests/moves/test_moves_law.py` is
# the same test for all moves of the package, with broken moves that must fail it.
#
# Sources: the paper's Eqs. 3.2 and 3.3; ter Braak (2006),
# [doi:10.1007/s11222-006-8769-1](https://doi.org/10.1007/s11222-006-8769-1); ter Braak
# and Vrugt (2008),
# [doi:10.1007/s11222-008-9104-9](https://doi.org/10.1007/s11222-008-9104-9), for at
# least 2 $d$ chains; Roberts, Gelman and Gilks (1997), *Annals of Applied Probability*
# 7, 110-120, for 2.38.

# %% tags=["remove-cell"]
for n in sizes:
    mean, error = ratio(right[n])
    assert abs(mean - 1) < 4 * error < 0.12, (n, mean, error)
mean, error = ratio(wrong[4])
assert 0.75 < mean < 0.83 and error < 0.01
assert ratio(wrong[6])[0] < 0.98 < ratio(wrong[24])[0] < 1.02
assert 0.94 < paper[0] < 1 - 4 * paper[1]
