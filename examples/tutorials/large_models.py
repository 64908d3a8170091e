# %% [markdown]
# # Large models
#
# For those whose mesh has too many degrees of freedom to be solved thousands of
# times. It need not be: some fifty full solves make a small model that replaces it,
# with a certificate of its error. `python examples/tutorials/large_models.py` runs
# the page. Structure and data are simulated.
#
# ## The matrices
#
# The structure is a concrete pier, 24 m high and 6 m wide, of plane-stress squares. Its
# lower, middle and upper third have unknown stiffness. Your FE program exports such
# matrices ({doc}`/how_to/matrices`); here they are Kronecker products of those of bars.
# The mesh is small, so that the page runs in seconds.

# %%
import numpy as np
from scipy import sparse

import emcee_femu as ef

E, NU, RHO, SIZE = 30e9, 0.2, 2500.0, 0.5  # Pa, -, kg/m3, m
NX, NY, PARTS = 12, 48, ("lower", "middle", "upper")  # squares

# Of a bar: integrals of values, of slopes, and of slopes times values.
VALUES = SIZE / 6 * np.array([[2.0, 1.0], [1.0, 2.0]])
SLOPES = np.array([[1.0, -1.0], [-1.0, 1.0]]) / SIZE
MIXED = np.array([[-0.5, -0.5], [0.5, 0.5]])


def line(bar, on):
    """Return the matrix of a row of bars, of which some are on."""
    n = len(on)
    ends = sparse.vstack([sparse.eye_array(n, n + 1, k=k) for k in (0, 1)])
    return (ends.T @ sparse.kron(bar, sparse.diags_array(on)) @ ends).tocsc()


def stiffness(on):
    """Return that of the rows of squares that are on; the foot is fixed."""
    x, xx, dx = (line(bar, np.ones(NX)) for bar in (VALUES, SLOPES, MIXED))
    y, yy, dy = (line(bar, on)[1:, 1:] for bar in (VALUES, SLOPES, MIXED))
    level, upright, shear = sparse.kron(y, xx), sparse.kron(yy, x), (1 - NU) / 2
    both = NU * sparse.kron(dy.T, dx) + shear * sparse.kron(dy, dx.T)
    K = [[level + shear * upright, both], [both.T, upright + shear * level]]
    return E / (1 - NU**2) * sparse.block_array(K, format="csc")


thirds = np.repeat(np.eye(3), NY // 3, axis=1)
K = {name: stiffness(on) for name, on in zip(PARTS, thirds, strict=True)}
along, up = (line(VALUES, np.ones(n)).sum(axis=0) for n in (NX, NY))
M = sparse.diags_array(RHO * np.tile(np.kron(up[1:], along), 2), format="csc")

# %% [markdown]
# {py:class}`~emcee_femu.MatrixModel` takes the constant part of the stiffness, here
# empty, the mass, and one matrix for each parameter. If a parameter is not a factor of
# a matrix, {py:class}`~emcee_femu.AssembledModel` takes a function that assembles them.

# %%
zero = sparse.csc_matrix(M.shape)
full = ef.MatrixModel(zero, M, K, n_modes=6)
ones = {name: np.ones(1) for name in K}
print(f"{M.shape[0]} degrees of freedom")
print("frequencies in Hz:", full(ones).frequencies[0].round(2))

# %% [markdown]
# ## Reduce it
#
# {py:func}`~emcee_femu.reduce_model` needs the bounds of the parameters and the largest
# relative frequency error that you accept. A tenth of the measurement error is small
# enough; here it is a fiftieth.

# %% tags=["result"]
bounds = dict.fromkeys(K, (0.6, 1.4))
small = ef.reduce_model(full, bounds, tolerance=1e-4)
print(f"{small.full_size} DOFs reduced to {small.size} basis vectors")
print(f"largest frequency error {small.max_error:.1e}", end=" ")
print(f"at {small.test_points} test points")
print(f"largest 1 - MAC of a shape there {small.shape_error:.1e}")
print(f"{small.full_solves} full solves")

# %% [markdown]
# The small model is a Ritz basis of mode shapes, from full solves at points far from each
# other, until a few in a row add nothing new. The second line is the **certificate**. At
# 40 points that were not used for the basis, half of them corners of the bounds, the
# frequencies were compared with those of full solves. After n points drawn at random,
# with 95 % confidence less than 3 / n of the box has a larger error. Errors of shapes are
# measured, but not held below the tolerance. Outside its bounds the small model raises
# an error.
#
# ## Sample it
#
# Five frequencies were measured, with errors of 0.5 %. The prior must stay within the
# bounds of the reduction.

# %%
truth = {"lower": 0.82, "middle": 1.05, "upper": 0.93}
exact = full({name: np.array([x]) for name, x in truth.items()}).frequencies[0]
noise = 0.005 * np.random.default_rng(1).standard_normal(5)
term = ef.FrequencyTerm((exact[:5] * (1 + noise)).round(3), relative_sd=0.005)
prior = ef.GaussianPrior([*K], [1.0] * 3, [0.15] * 3, [*bounds.values()])

posterior = ef.LogPosterior(small, term, prior)
run = ef.run(posterior, seed=1)
idata = ef.to_inference_data(run)
ef.parameter_table(idata, truth)

# %%
ef.diagnose(run)

# %% [markdown]
# ## A faster factorisation
#
# A full solve of a large model spends most of its time on factoring K. For solids,
# PARDISO takes a small part of SuperLU's time (`pip install pypardiso`, on
# Linux on x86-64; it brings MKL, 0.6 GB).
#
# PARDISO is used if it is installed, for models from 5,000 DOFs on. It takes as many
# threads as `MKL_NUM_THREADS` says, or else `OMP_NUM_THREADS`.
#
# The table is for a block of 8-node bricks with four unknown moduli and six modes,
# reduced to 1e-4, on two cores that were busy with other work, too. "peak" is memory:
#
# ```{literalinclude} ../../examples/benchmarks/measured/large_model.txt
# :language: text
# ```
#
# ## A million degrees of freedom
#
# By the growth in this table a million DOFs of a solid take a quarter of an hour and 30
# GB to factor. So leave the large eigenproblem to your FE program, in one of two ways:
#
# - **Its modal basis.** Solve at the centre and at the corners of the bounds, and export
#   these modes beside K and M. In the basis V of all of them, `V.T @ K @ V` and
#   `V.T @ M @ V` are the matrices of a small `MatrixModel`. Check it at a few more solved
#   points that it was not made from.
# - **Its frequencies alone.** {py:func}`~emcee_femu.emulate` learns them from some tens
#   of its solves, without matrices ({doc}`hundred_solves`).
#
# ## A coarse model, corrected
#
# If the error of the cheap model (a coarser mesh, an emulator) is larger than that of
# the measurement, {py:class}`~emcee_femu.moves.DelayedAcceptanceMove` lets each walker
# walk 20 steps by the cheap posterior, and one full solve accepts or rejects where it
# arrived. The chain is that of the full model, however wrong the cheap one is.

# %%
coarse = ef.reduce_model(full, bounds, tolerance=0.03, test_points=10)
print(f"{coarse.size} basis vectors, frequency error {coarse.max_error:.1e}")
cheap = ef.LogPosterior(coarse, term, prior)
exactly = ef.LogPosterior(full, term, prior)
(first,) = ef.run(cheap, ef.DEMCMove(), 16, 200, ensembles=1, seed=2)
starts = first.get_last_sample().coords

move = ef.moves.DelayedAcceptanceMove(ef.DEMCMove(), cheap, steps=20)
delayed = ef.run(exactly, move, 16, steps=20, starts=starts, seed=3, ensembles=1)
move = delayed.moves[0][0]  # the copy of the run, which has counted
print(f"{move.proposed} proposals", end=", ")
print(f"{move.full_solves} solved in full, {move.accepted} of these accepted")

# %% [markdown]
# If the cheap posterior is much narrower than the full one, walkers wait in its tails.

# %% tags=["remove-cell"]
assert small.max_error <= 1e-4 and small.size < 40 and small.full_solves <= 100
assert run.solves > 50 * small.full_solves
assert ef.diagnose(run).converged
draws = np.array([idata.posterior[name].values.ravel() for name in K])
z = (draws.mean(axis=1) - [*truth.values()]) / draws.std(axis=1)
assert np.abs(z).max() < 3
assert small.max_error < 0.1 * 0.005 < coarse.max_error
assert move.full_solves <= 16 * 20 and move.proposed == 20 * 16 * 20
