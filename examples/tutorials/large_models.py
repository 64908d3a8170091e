# %% [markdown]
# # Large models
#
# A mesh of a hundred thousand degrees of freedom cannot be solved fifty thousand times.
# If its matrices are sums of parts, each times a parameter, it need not be: some tens of
# full solves make a small model that takes its place, with a certificate of its error.
# You will reduce a model, read the certificate, sample the small model, and correct a
# coarse one by full solves. `python examples/tutorials/large_models.py` runs this page
# (10 s of processor time).
#
# ## The matrices
#
# The structure is a concrete pier, 24 m high and 6 m wide, of plane-stress squares. Its
# lower, middle and upper third have unknown stiffness. Your FE program will export such
# matrices for you ({doc}`/how_to/matrices`); here 30 lines of NumPy assemble them. The mesh is small, so that
# this page runs in seconds. All that follows is the same for a large one.

# %%

import numpy as np
from scipy import sparse

import emcee_femu as ef

E, NU, RHO, SIZE = 30e9, 0.2, 2500.0, 0.5  # Pa, -, kg/m3, m
NX, NY = 12, 48  # squares


def square():
    """Return the stiffness (8, 8) of a square of unit thickness."""
    shear = (1 - NU) / 2
    D = E / (1 - NU**2) * np.array([[1, NU, 0], [NU, 1, 0], [0, 0, shear]])
    k = np.zeros((8, 8))
    for x, y in np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) / np.sqrt(3):
        dx = np.array([y - 1, 1 - y, 1 + y, -1 - y]) / (2 * SIZE)
        dy = np.array([x - 1, -1 - x, 1 + x, 1 - x]) / (2 * SIZE)
        B = np.zeros((3, 8))
        B[0, ::2], B[1, 1::2], B[2, ::2], B[2, 1::2] = dx, dy, dy, dx
        k += SIZE**2 / 4 * B.T @ D @ B
    return k


# %%
def part(rows):
    """Return stiffness and nodal masses of some rows; the foot is fixed."""
    node = np.arange((NX + 1) * (NY + 1)).reshape(NY + 1, NX + 1)
    corners = [node[:-1, :-1], node[:-1, 1:], node[1:, 1:], node[1:, :-1]]
    corners = np.stack(corners, axis=-1)[rows].reshape(-1, 4)
    dofs = np.stack([2 * corners, 2 * corners + 1], axis=-1).reshape(-1, 8)
    where = np.repeat(dofs, 8, axis=1).ravel(), np.tile(dofs, 8).ravel()
    values = np.tile(square().ravel(), len(dofs))
    N = 2 * node.size
    K = sparse.coo_matrix((values, where), (N, N)).tocsc()
    m = np.bincount(dofs.ravel(), np.full(dofs.size, RHO * SIZE**2 / 4), N)
    free = slice(2 * (NX + 1), None)
    return K[free, free], m[free]


third = NY // 3
parts = {
    name: part(slice(i * third, (i + 1) * third))
    for i, name in enumerate(["lower", "middle", "upper"])
}
K = {name: k for name, (k, _) in parts.items()}
M = sparse.diags(sum(m for _, m in parts.values()), format="csc")

# %% [markdown]
# {py:class}`~emcee_femu.MatrixModel` takes dense or `scipy.sparse` matrices: a constant
# part of the stiffness, here empty, the mass, and one matrix for each parameter. Sparse
# ones are solved by shift-invert, with a symmetric ordering and one sparsity pattern for
# all parameter sets.

# %%
zero = sparse.csc_matrix(M.shape)
full = ef.MatrixModel(zero, M, K, n_modes=6)
ones = {name: np.ones(1) for name in K}
print(f"{M.shape[0]} degrees of freedom")
print("frequencies in Hz:", full(ones).frequencies[0].round(2))

# %% [markdown]
# ## Reduce it
#
# {py:func}`~emcee_femu.reduce_model` needs the bounds within which the parameters will
# be, and the largest relative error of a frequency that you accept.

# %%
bounds = dict.fromkeys(K, (0.6, 1.4))
small = ef.reduce_model(full, bounds, tolerance=1e-4)
print(f"{small.full_size} DOFs reduced to {small.size} basis vectors")
print(f"largest frequency error {small.max_error:.1e}", end=" ")
print(f"at {small.test_points} test points")
print(f"largest 1 - MAC of a shape there {small.shape_error:.1e}")
print(f"{small.full_solves} full solves")

# %% [markdown]
# `print(small)` says the same, and how many times faster the small model is on your
# machine. It is a Ritz basis: the mode shapes of full solves at points that a search adds
# one by one, each where the error is estimated to be largest, until the estimate is below
# the tolerance.
#
# The **certificate** is the second line. The reduced frequencies were compared with those
# of full solves at 40 points that the basis was not made from, half of them corners of the
# bounds. So the error is measured, not estimated. Three things to know:
#
# - It is no bound over all of the box: after n points drawn at random, with 95 %
#   confidence less than 3 / n of the box errs more.
# - Frequencies are certified; shapes are measured, and not held below the tolerance.
# - Where a reduction does not pay, a warning says so.
#
# Outside its bounds the small model knows nothing, so it refuses.
#
# ## Sample the small model
#
# Five frequencies were measured, here simulated with errors of 0.5 %. The prior must stay
# within the bounds of the reduction. A law of infinite range is truncated and normalised
# again by `IndependentPrior({"lower": stats.lognorm(0.1)}, bounds={"lower": (0.6, 1.4)})`.

# %%
truth = {"lower": 0.82, "middle": 1.05, "upper": 0.93}
exact = full({name: np.array([x]) for name, x in truth.items()}).frequencies[0]
noise = 0.005 * np.random.default_rng(1).standard_normal(5)
term = ef.FrequencyTerm((exact[:5] * (1 + noise)).round(3), relative_sd=0.005)
prior = ef.GaussianPrior([*K], [1.0] * 3, [0.15] * 3, [*bounds.values()])

posterior = ef.LogPosterior(small, term, prior)
run = ef.run(posterior, steps=1_000, ensembles=2, seed=1)
idata = ef.to_inference_data(run)
ef.parameter_table(idata, truth)

# %%
ef.diagnose(run)

# %% [markdown]
# What it cost, counted in solves, which is what does not depend on the machine:

# %%
chain = sum(s.iteration * s.nwalkers for s in run)
evaluations = run.evaluations + chain
print(f"{evaluations} evaluations of the posterior")
print(f"{small.full_solves} full solves,", end=" ")
print(f"{evaluations / small.full_solves:.0f} times fewer")

# %% [markdown]
# ## How small an error is small enough?
#
# A frequency error below a tenth of the measurement error needs no correction: here it is a
# fiftieth.
#
# ## A coarse model, corrected
#
# Suppose the cheap model is coarser than that: a reduction to 3 %, a coarser mesh, an
# emulator. {py:class}`~emcee_femu.moves.DelayedAcceptanceMove` screens every proposal by the
# cheap posterior, and solves the full model only for those that pass. The chain is that
# of the full model, however wrong the cheap one is; a bad one costs acceptance.

# %%
coarse = ef.reduce_model(full, bounds, tolerance=0.03, test_points=10)
print(f"{coarse.size} basis vectors, frequency error {coarse.max_error:.1e}")
cheap = ef.LogPosterior(coarse, term, prior)
exactly = ef.LogPosterior(full, term, prior)
(first,) = ef.run(cheap, ef.DEMCMove(), 16, 200, ensembles=1, seed=2)
starts = first.get_last_sample().coords

for steps in (1, 20):
    move = ef.moves.DelayedAcceptanceMove(ef.DEMCMove(), cheap, steps=steps)
    (sampler,) = ef.run(exactly, move, 16, steps=20, starts=starts, seed=3, ensembles=1)
    print(f"steps={steps}: {move.proposed} proposals", end=", ")
    print(f"{move.full_solves} solved in full, {move.accepted} of these accepted")

# %% [markdown]
# With `steps=20` each walker walks 20 steps by the cheap posterior, while the walkers that
# guide it stand still, and one full solve decides on where it arrived. The longer the
# subchain, the less one solve depends on the last; what is left is the error of the
# cheap posterior. `steps=(10, 30)` draws the length anew each time. Where the cheap
# posterior is much narrower than the full one, walkers wait long in its tails, and long
# subchains do not help: mend the cheap model. (Twenty steps of the chain show how it
# is used; they are too few for a result.)
#
# Take subchains where `certify` refuses ({doc}`hundred_solves`).
#
# Where a program gives only results, no matrices, go on with {doc}`hundred_solves`.

# %% tags=["remove-cell"]
assert small.max_error <= 1e-4 and small.size < 40 and small.full_solves <= 100
assert evaluations > 100 * small.full_solves
assert ef.diagnose(run).converged
table = ef.parameter_table(idata, truth)
draws = np.array([idata.posterior[name].values.ravel() for name in K])
z = (draws.mean(axis=1) - [*truth.values()]) / draws.std(axis=1)
assert np.abs(z).max() < 3
assert small.max_error < 0.1 * 0.005 < coarse.max_error
assert move.full_solves <= 16 * 20 and move.proposed == 20 * 16 * 20
