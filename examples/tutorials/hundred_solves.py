# %% [markdown]
# # A posterior in a hundred solves
#
# Your model is a program. It takes minutes for a solve, it gives no matrices and no
# derivatives. You will learn its response from some twenty solves, sample what was
# learned, and spend sixty more to find out whether the result may be believed; and you
# will see what to do when it may not. `python examples/tutorials/hundred_solves.py` runs
# this page (14 s of processor time).
#
# | a solve takes | and you have | use | true solves |
# |---|---|---|---|
# | microseconds | K and M, a small model | `run(posterior, seed=1)` | 10,000 and more |
# | milliseconds to seconds | K and M whose parts functions of the parameters multiply | `reduce_model`, then `run`: {doc}`large_models` | some tens |
# | the same | an FE program that writes K and M | `read_matrices`, `MatrixModel.from_differences`, then as above: {doc}`/how_to/matrices` | 1 to 3 per parameter |
# | seconds to hours | a program that gives only results | `emulate`, `run` on what it returns, `certify` | about 10 per parameter, and 100 |
# | the same | one that gives derivatives, too | the same: `FunctionModel(..., jacobian=)` | about 3 per parameter, and 100 |
# | the same | an emulator that `certify` refuses | more `solves` from the same file; else `DelayedAcceptanceMove(..., steps=100)` | 1 per walker and step |
#
# ## The program
#
# A footbridge slab of 30 m on three elastic bearings. The modulus, the thickness and the
# stiffness of the bearings are unknown. Stiffness goes with the cube of the thickness, so
# the matrices are no sum of parts, even if you had them. The function below takes well
# under a millisecond; let it stand for an hour, and count its calls.

# %%
import tempfile
import textwrap
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
# Four frequencies were measured, each to 0.5 %. (They are simulated: those of E = 33 GPa,
# 0.82 m and 70 MN/m, with noise.) A {py:class}`~emcee_femu.FunctionModel` is all that the
# package needs of a program; {doc}`/how_to/black_box` starts a real one.

# %%
model = ef.FunctionModel(solve, n_modes=4)
term = ef.FrequencyTerm([3.702, 4.692, 8.673, 12.571], relative_sd=0.005)
prior = ef.GaussianPrior(
    names=["E", "thickness", "bearing"],
    mean=[30, 0.80, 60],
    sd=[4, 0.04, 20],
    bounds=[(15, 45), (0.6, 1.0), (10, 150)],
)
units = {"E": "GPa", "thickness": "m", "bearing": "MN/m"}
posterior = ef.LogPosterior(model, term, prior, units)

# %% [markdown]
# ## Emulate
#
# {py:func}`~emcee_femu.emulate` may spend 40 solves. With `backend=` every solve is on disk
# as it arrives.

# %%
folder = tempfile.TemporaryDirectory()  # yours is where you keep your results
file = Path(folder.name) / "bridge.sqlite"
emulated = ef.emulate(posterior, solves=40, seed=1, backend=file)
print(f"{len(calls)} calls of the program")
emulated

# %% [markdown]
# How to read it (in a script, `print(emulated)` says the same):
#
# - Not the log-posterior is emulated but the response: here four eigenvalues, else shapes
#   at the sensors or any real vector that a term reads, each in units of its measurement
#   error. *Leaving one out* predicts each solved point from the others. Points of the whole
#   prior are among them, so this is worse than what counts.
# - The first d + 4 = 7 solves are spread over the prior (or about `starts=`, such as a
#   maximum of {py:func}`~emcee_femu.find_map`). Then batches of d / 2 + 1 go where the
#   emulator is in most doubt among draws of the posterior that it gives. A model with
#   `jacobian` is learned with its derivatives: half as many points do for either, and a
#   third of the solves in the end.
# - **Errors are those of the data**: the distance between the emulated and the full
#   response, every datum in units of its own measurement error, the root of the sum of
#   squares. An error of 0.1 shifts a posterior mean by a tenth of its standard
#   deviation at most, and usually by far less.
# - The *predicted error* is what the emulator expects at draws of its posterior. The
#   *true error* is that times the factor by which the new solves exceeded what was
#   predicted for them. Two rounds below `tolerance` (0.1) end it; `tolerance=0` spends
#   all `solves`. About 10 solves a parameter are usual.
#
# The likelihood carries the emulator's own variance, so while little is known the
# posterior is broad, not wrong. The first point of each batch is drawn from a wider posterior,
# whose emulator errs twice as much as it says, and the draws begin again at the whole prior
# whenever the solves have grown by half: a mode that an early emulator excluded is found
# by a later one. What no emulator ever suspects stays unseen, and `certify` weighs only
# what was drawn: in doubt run it again with another seed.
#
# ## Run
#
# The emulated posterior costs next to nothing, so let "auto" take what it wants.

# %%
run = ef.run(emulated.posterior, steps=400, ensembles=2, seed=2)
idata = ef.to_inference_data(run)
ef.diagnose(run)

# %% [markdown]
# The statements are on the chain of the emulated posterior, not on the emulator. That is
# the next step's business.
#
# ## Certify
#
# {py:func}`~emcee_femu.certify` solves in full at draws of the emulated posterior. If both
# posteriors are one, every draw gets the same weight.

# %%
certificate = ef.certify(idata, posterior, solves=60, seed=3)
spent = len(calls)
print(f"{spent} calls of the program, all told")
certificate

# %% [markdown]
# - *emulated mean* and *mean*: of the emulated posterior, and of the true one, as the
#   weights correct it; *shift/sd* is their difference in posterior standard deviations.
#   The next columns say the same of standard deviations.
# - **Efficiency** is the effective share of the weights, 1 where all are equal. **Pareto k**
#   tells how heavy the tail of the weights is; above 0.7 no mean over them can be
#   believed, unless they are nearly equal (efficiency above 0.9).
# - The verdict is *certified*, *corrected* (the weights repair what is wrong; tables and
#   figures of `certificate.idata` use them) or *refused*, with what to do.
# - A quarter of the solves climb the true posterior from draws of the prior that lie away
#   from the chain: they look for what the emulator has missed. The last sentence says how
#   far they came.
#
# Go on with `certificate.idata`; the tables and figures made of it say what it is worth.

# %%
ef.parameter_table(certificate.idata)

# %% mystnb={"image": {"alt": "Three histograms and three scatter plots of modulus, thickness and bearing stiffness, with long ellipses: modulus falls with both others, which rise together"}}
ef.figures.plot_scatter(certificate.idata)

# %% [markdown]
# The data inform the bearings best. All ellipses are long: a thicker slab of a softer
# concrete on stiffer bearings has nearly the same frequencies.
#
# ## When it is refused
#
# Suppose that you knew much less before the test, and that nine solves were all that you
# had allowed: the first design and one batch.

# %%
wide = ef.GaussianPrior(
    names=prior.names,
    mean=[30, 0.80, 60],
    sd=[12, 0.15, 60],
    bounds=[(5, 80), (0.3, 1.4), (5, 300)],
)
vague = ef.LogPosterior(model, term, wide, units)
file = Path(folder.name) / "short.sqlite"


def learn(solves):
    """Emulate with a file, run, certify."""
    before = len(calls)
    emulated = ef.emulate(vague, solves, seed=2, backend=file, resume=True)
    new = len(calls) - before
    run = ef.run(emulated.posterior, steps=3_000, ensembles=2, seed=2)
    certificate = ef.certify(ef.to_inference_data(run), vague, solves=60, seed=3)
    print(f"{emulated.solves} solves, {new} of them new")
    print(textwrap.fill(certificate.verdict, 80))
    return emulated, certificate


poor, refused = learn(9)

# %% [markdown]
# `poor.history` told as much: a true error of the size of the measurement's. The verdict
# names what to do: more solves for the emulator, a few more for the certificate, which
# then corrects the draws, or a chain of full solves.
#
# **More solves from the same file.** Nothing that was solved is lost. The same call with
# more solves and `resume=True` goes on where it ended, and the result is that of one call,
# to the bit. So it does after a kill, or when a licence server was down
# ({doc}`/how_to/failing_solves`). Some solves are repeated each time, to see that the model
# is still the same.

# %%
better, certified = learn(40)

# %% [markdown]
# **Or a chain of full solves, led by the emulator.** Where no number of solves that you can
# pay settles the emulator, a {py:class}`~emcee_femu.moves.DelayedAcceptanceMove` walks many steps
# by the emulated posterior between two full solves, and the full one decides. The chain
# is that of the true posterior, whatever the emulator is worth; a poor one costs
# acceptance ({doc}`large_models`).
#
# `certify` and {py:func}`~emcee_femu.run` take `backend=` too. `workers=8` solves a batch at
# once: eight points of `emulate` (d / 2 + 1 if that is more), all draws of `certify`. `emulate`
# then takes fewer rounds, which are what you wait for, and the file can only be gone on with by
# eight.
#
# Next: {doc}`/how_to/black_box` for a program that is started from the command line,
# {doc}`/how_to/failing_solves` for solves that fail, {doc}`/how_to/emulated_crossing_modes`
# for modes that cross, and {doc}`/explanation/few_solves_measured` for how often all this
# was right.

# %% tags=["remove-cell"]
assert spent <= 100 and emulated.solves < 40
assert certificate.short == "certified"
assert ef.diagnose(run).converged
true, sd = np.array([33, 0.82, 70]), certificate.sd
assert np.all(np.abs(certificate.mean - true) < 3 * sd)
assert (sd / [4, 0.04, 20]).argmin() == 2
assert poor.solves == 9 and better.solves < 40
assert refused.short == "refused" and certified.short == "certified"
