# %% [markdown]
# # A plate whose thickness is unknown
#
# This page updates a thickness, a modulus and the stiffness of a support. Thickness and
# modulus are not simple factors of K and M, so you say what multiplies each matrix,
# reduce the model, and sample. `python examples/tutorials/plate_thickness.py` runs this
# page (10 s).
#
# An aluminium plate is bolted to a wall along one edge. Its thickness was not measured, the
# bolts give way a little, and a shaker of 0.3 kg hangs at a free corner.

# %%
import numpy as np
from scipy import sparse, stats

import emcee_femu as ef

LENGTH, WIDTH = 0.6, 0.25  # m
NU, RHO, SHAKER = 0.33, 2700.0, 0.3  # -, kg/m3, kg
TRUTH = {"E": 68.2, "t": 4.21, "k": 8.1}  # GPa, mm, kN m/rad per m of the edge
N_MODES, NOISE = 6, 0.003  # relative sd of a measured frequency

# %% [markdown]
# ## The matrices
#
# Any program can export them ({doc}`/how_to/fe_programs`). Here they are products of
# beams along and across the plate, by cubic Hermite polynomials:


# %%
def integrals(length, n):
    """Return integrals of products of derivatives (0, 1, 2) of n elements' shapes."""
    x, weights = np.polynomial.legendre.leggauss(4)
    s, h = (x + 1) / 2, length / n
    shapes = np.array([1 - 3 * s**2 + 2 * s**3, h * (s - 2 * s**2 + s**3),
                       3 * s**2 - 2 * s**3, h * (s**3 - s**2)])  # fmt: skip
    slopes = np.array([6 * s**2 - 6 * s, h * (1 - 4 * s + 3 * s**2),
                       6 * s - 6 * s**2, h * (3 * s**2 - 2 * s)]) / h  # fmt: skip
    bends = np.array([12 * s - 6, h * (6 * s - 4),
                      6 - 12 * s, h * (6 * s - 2)]) / h**2  # fmt: skip
    by_order = [shapes, slopes, bends]

    def assemble(a, b):
        whole = np.zeros((2 * n + 2, 2 * n + 2))
        for i in range(n):
            rows = slice(2 * i, 2 * i + 4)
            products = (by_order[a] * weights) @ by_order[b].T
            whole[rows, rows] += h / 2 * products
        return whole

    return {(a, b): assemble(a, b) for a, b in ((0, 0), (1, 1), (2, 2), (2, 0))}


def plate(nx=20, ny=8):
    """Return bending and support stiffness, mass, and the shaker's; for E = t = 1."""
    x, y = integrals(LENGTH, nx), integrals(WIDTH, ny)
    free = np.arange(1, 2 * nx + 2)  # no deflection at the wall, but a slope
    x = {key: matrix[free][:, free] for key, matrix in x.items()}
    mixed = sparse.kron(x[2, 0], y[2, 0].T)
    bending = (
        sparse.kron(x[2, 2], y[0, 0])
        + sparse.kron(x[0, 0], y[2, 2])
        + NU * (mixed + mixed.T)
        + 2 * (1 - NU) * sparse.kron(x[1, 1], y[1, 1])
    ) / (12 * (1 - NU**2))
    slope = np.diag(np.arange(len(free)) == 0).astype(float)
    corner = np.zeros((bending.shape[0], 1))
    corner[-2] = 1.0  # the deflection of the last node
    support = sparse.kron(slope, y[0, 0])
    return bending, support, sparse.kron(x[0, 0], y[0, 0]), corner @ corner.T


# %% [markdown]
# ## What multiplies them
#
# Bending stiffness grows with $E t^3$ and the mass with $\rho t$; the support's
# stiffness k is a factor. A function's arguments are parameters. It is called with all
# walkers at once, and its derivatives take no solve.

# %%
bending, support, mass, corner = plate()
model = ef.MatrixModel(
    sparse.csc_array(bending.shape),
    SHAKER * sparse.csc_array(corner),
    K={
        "bending": (bending, lambda E, t: E * t**3),
        "k": 1e3 * support,
    },  # GPa mm3 is N m
    M={"plate": (mass, lambda t: 1e-3 * RHO * t)},
    n_modes=N_MODES,
)
print(f"{bending.shape[0]} DOFs; parameters {', '.join(model.names)}")

# %% [markdown]
# If K is not a sum of given matrices (the place of a spring), use
# {py:class}`~emcee_femu.AssembledModel`, a function from one parameter set to K and M.
#
# ## A small model
#
# Inside the bounds a few shapes are enough. Full solves that were not used for them
# check the error of their frequencies.

# %%
bounds = {"E": (60, 80), "t": (3.4, 4.8), "k": (1, 100)}
reduced = ef.reduce_model(model, bounds, tolerance=1e-4, seed=1)
reduced

# %% [markdown]
# ## The posterior
#
# Six frequencies were measured to 0.3 %, here simulated by the full model. The drawings
# say 4 mm and a handbook 70 GPa; hardly anything is known about the bolts.

# %%
rng = np.random.default_rng(3)
solved = model({name: np.array([value]) for name, value in TRUTH.items()})
measured = solved.frequencies[0] * (1 + NOISE * rng.standard_normal(N_MODES))
known = {"E": stats.norm(70, 2), "t": stats.norm(4, 0.2), "k": stats.loguniform(1, 100)}
prior = ef.IndependentPrior(known, bounds=bounds)
term = ef.FrequencyTerm(measured, relative_sd=NOISE)
posterior = ef.LogPosterior(reduced, term, prior)
run = ef.run(posterior, seed=1)
ef.diagnose(run)

# %%
ef.parameter_table(run)

# %% mystnb={"image": {"alt": "Scatter of modulus, thickness and support stiffness: modulus and thickness lie along a falling line, the support's stiffness is told apart from both"}}
ef.figures.plot_scatter(run)

# %% [markdown]
# Modulus and thickness lie along a line. A bare plate would determine only $E t^2$,
# since all its frequencies are proportional to $t \sqrt{E / \rho}$. The known mass of
# the shaker separates them. {py:func}`~emcee_femu.identifiability` shows this before a
# test is made: {doc}`what_is_learned`.

# %% tags=["remove-cell"]
draws = np.concatenate([sampler.get_chain(flat=True) for sampler in run])
inside = np.abs(draws.mean(axis=0) - [*TRUTH.values()]) / draws.std(axis=0)
assert (inside < 3).all(), inside
correlation = np.corrcoef(draws[:, 0], draws[:, 1])[0, 1]
assert correlation < -0.7 and draws[:, 1].std() < 0.1, correlation
assert reduced.max_error < 1e-4 and reduced.size < 60
assert ef.diagnose(run).converged
