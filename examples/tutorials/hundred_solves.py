# %% [markdown]
# # A posterior in a hundred solves
#
# For those whose model is a program that takes minutes for a solve and gives no
# matrices and no derivatives. One call learns its response from some twenty solves,
# samples what was learned, and spends some fifty more solves to check the result. This page
# makes it, takes it step by step, and shows what to do if the check fails.
# `python examples/tutorials/hundred_solves.py` runs the page. Structure and data
# are simulated; {doc}`/start/choose` says when this is the way to go.
#
# ## The program
#
# A footbridge slab of 30 m rests on three elastic bearings. The modulus, the thickness
# and the stiffness of the bearings are unknown. Stiffness grows with the cube of the
# thickness. The function below takes well under a millisecond; imagine an hour, and
# count its calls.

# %%
import tempfile
from pathlib import Path

import numpy as np
from scipy.linalg import eigh

import emcee_femu as ef

N, SPAN, WIDTH, RHO = 12, 30.0, 4.0, 2500.0  # elements, m, m, kg/m3
calls = []


def solve(p):
    """Return frequencies in Hz; E in GPa, thickness in m, bearing in MN/m."""
    calls.append(p)
    a, area = SPAN / N, WIDTH * p["thickness"]
    EI = 1e9 * p["E"] * area * p["thickness"] ** 2 / 12
    k = [[12, 6 * a, -12, 6 * a], [6 * a, 4 * a * a, -6 * a, 2 * a * a]]
    k += [[-12, -6 * a, 12, -6 * a], [6 * a, 2 * a * a, -6 * a, 4 * a * a]]
    m = [[156, 22 * a, 54, -13 * a], [22 * a, 4 * a * a, 13 * a, -3 * a * a]]
    m += [[54, 13 * a, 156, -22 * a], [-13 * a, -3 * a * a, -22 * a, 4 * a * a]]
    K, M = np.zeros((2, 2 * N + 2, 2 * N + 2))
    for first in range(0, 2 * N, 2):
        own = slice(first, first + 4)
        K[own, own] += EI / a**3 * np.array(k)
        M[own, own] += RHO * area * a / 420 * np.array(m)
    for support in (0, N, 2 * N):
        K[support, support] += 1e6 * p["bearing"]
    found = eigh(K, M, eigvals_only=True, subset_by_index=[0, 3])
    return np.sqrt(found) / (2 * np.pi)


# %% [markdown]
# Four frequencies were measured, each to 0.5 %. (They are simulated with E = 33 GPa,
# 0.82 m and 70 MN/m, plus noise.) The package needs only a
# {py:class}`~emcee_femu.FunctionModel` around a program; {doc}`/how_to/black_box`
# starts a real one.

# %%
model = ef.FunctionModel(solve, n_modes=4)
term = ef.FrequencyTerm([3.702, 4.692, 8.673, 12.571], relative_sd=0.005)
names, mean = ["E", "thickness", "bearing"], [30, 0.80, 60]
bounds = [(15, 45), (0.6, 1.0), (10, 150)]
prior = ef.GaussianPrior(names, mean, sd=[4, 0.04, 20], bounds=bounds)
units = {"E": "GPa", "thickness": "m", "bearing": "MN/m"}
posterior = ef.LogPosterior(model, term, prior, units)

# %% [markdown]
# ## In one call
#
# {py:func}`~emcee_femu.run_emulated` may spend 100 solves, and takes what it needs.
# `backend=` stores every solve as it arrives: if it is stopped, the same call with
# `resume=True` continues, and with more `solves` too.

# %% tags=["result"]
folder = Path(tempfile.mkdtemp())
found = ef.run_emulated(posterior, solves=100, seed=1, backend=folder / "one.chain")
print(f"{len(calls)} calls of the program")
found

# %% [markdown]
# All tables, figures, {py:func}`~emcee_femu.diagnose` and {py:func}`~emcee_femu.report`
# take it, and state the verdict:

# %%
ef.parameter_table(found)

# %% [markdown]
# The rest of this page makes the same three steps one by one.
#
# ## Emulate
#
# {py:func}`~emcee_femu.emulate` may spend 40 solves.

# %%
in_one_call = len(calls)
file = folder / "bridge.chain"
emulated = ef.emulate(posterior, solves=40, seed=1, backend=file)
print(f"{len(calls) - in_one_call} calls of the program")
emulated

# %% [markdown]
# - *Leaving one out* predicts each solved point from the others. Some of these are spread
#   over the whole prior, so this error is larger than the one that counts.
# - The first d + 4 = 7 solves are spread over the prior. Then batches of d / 2 + 1 go
#   where they lower the error of the posterior most.
# - **Errors** are distances between the emulated and the full response, in units of the
#   measurement error. An error of 0.1 shifts a posterior mean by a tenth of its standard
#   deviation at most. The *predicted error* is what the emulator expects at draws of its
#   posterior; the *true error* is corrected by the new solves. `emulate` stops after two
#   rounds below `tolerance` (0.1).
#
# The likelihood includes the emulator's own variance, so with few solves the posterior
# is broad, not wrong: {doc}`/explanation/few_solves_measured`.
#
# ## Run
#
# The emulated posterior costs next to nothing.

# %%
run = ef.run(emulated.posterior, seed=2)
ef.diagnose(run)

# %% [markdown]
# These statements are about the chain, not about the emulator.
#
# ## Certify
#
# {py:func}`~emcee_femu.certify` makes full solves at draws of the emulated posterior.
# If both posteriors are the same, every draw gets the same weight.

# %%
certificate = ef.certify(run, posterior, solves=60, seed=3)
spent = len(calls) - in_one_call
print(f"{spent} calls of the program, all told")
certificate

# %% [markdown]
# - *emulated mean* is that of the emulated posterior, and *mean* is that of the true
#   one, by the weights. *shift/sd* is their difference in posterior standard deviations.
# - **Efficiency** is the effective share of the weights, 1 if all are equal; **Pareto k**
#   describes how heavy their tail is.
# - {doc}`/explanation/certificate` has the verdicts.
#
# ## When it is refused
#
# **More solves from the same file**: no solve is lost. The same call, of
# `run_emulated` or of `emulate`, with more solves and `resume=True` continues, and the
# result is exactly that of one call, also after a crash. Some solves are repeated each
# time, to check that the model is still the same:

# %%
before = len(calls)
better = ef.emulate(posterior, 60, seed=1, backend=file, resume=True, tolerance=0.01)
print(f"{better.solves} solves, by {len(calls) - before} new calls of the program")

# %% [markdown]
# **Or a chain of full solves, led by the emulator**: a
# {py:class}`~emcee_femu.moves.DelayedAcceptanceMove` walks many steps by the emulated
# posterior between two full solves, and the full one decides ({doc}`large_models`).
#
# `workers=8` solves a batch at once: eight points of `emulate`, all draws of `certify`.
#
# Next: {doc}`/how_to/black_box` starts a program from the command line, and handles
# solves that fail; {doc}`/how_to/emulated_crossing_modes` has modes that cross.

# %% tags=["remove-cell"]
assert found.short == "certified" and found.solves == in_one_call <= 100
assert spent <= 100 and emulated.solves < 40
assert certificate.short == "certified"
assert ef.diagnose(run).converged
true, sd = np.array([33, 0.82, 70]), certificate.sd
assert np.all(np.abs(certificate.mean - true) < 3 * sd)
assert (sd / [4, 0.04, 20]).argmin() == 2
assert emulated.solves < better.solves <= 60
