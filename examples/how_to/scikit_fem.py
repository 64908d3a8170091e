# %% [markdown]
# # Update a scikit-fem model
#
# For those who assemble their model in scikit-fem: take K for parts of a mesh, and
# find the part that has lost stiffness. `python examples/how_to/scikit_fem.py` runs
# the page; it takes `pip install scikit-fem`.
#
# A plate clamped along one edge may have lost stiffness in any of four strips. Eight
# measured frequencies (simulated here) are to determine the bending stiffness of each.
# scikit-fem assembles a form whose coefficient is a field, one number for each element
# of the mesh; {py:func}`~emcee_femu.from_skfem` leaves the held DOFs out and names the
# others.

# %%
import numpy as np

import emcee_femu as ef

TRUTH = {"strip 1": 1.05, "strip 2": 0.7, "strip 3": 0.95, "strip 4": 1.1}
N_MODES, NOISE = 8, 0.005  # relative sd of a measured frequency
LENGTH, WIDTH, THICKNESS = 0.6, 0.25, 0.004  # m
E, NU, RHO = 70e9, 0.33, 2700.0  # Pa, -, kg/m3

# %% [markdown]
# ## The model
#
# Put your own script here. Parameters are factors in which K is linear, here the
# bending stiffness of a strip. For a thickness t, K grows with t³ and M with t:
# `K={"bending": (K3, lambda t: t**3)}, M={"mass": (M1, lambda t: t)}`. If K is no such
# sum, use {py:class}`~emcee_femu.AssembledModel`.


# %%
def plate(nx=8, ny=2):  # Bogner-Fox-Schmit rectangles
    from skfem import Basis, ElementQuadBFS, MeshQuad

    lines = np.linspace(0, LENGTH, nx + 1), np.linspace(0, WIDTH, ny + 1)
    strips = {
        name: lambda x, i=i: np.floor(len(TRUTH) * x[0] / LENGTH) == i
        for i, name in enumerate(TRUTH)
    }
    mesh = MeshQuad.init_tensor(*lines).with_subdomains(strips)
    mesh = mesh.with_boundaries({"root": lambda x: x[0] == 0})
    return Basis(mesh, ElementQuadBFS(), intorder=6)  # exact for these shapes


def forms():  # of stiffness and mass of a Kirchhoff plate
    from skfem import BilinearForm
    from skfem.helpers import dd, ddot, eye, trace

    rigidity = E * THICKNESS**3 / (12 * (1 - NU**2))

    @BilinearForm
    def bending(u, v, w):  # w.factor: a number, or a field over the mesh
        curvature = dd(u)
        moment = (1 - NU) * curvature + NU * eye(trace(curvature), 2)
        return w.factor * rigidity * ddot(moment, dd(v))

    @BilinearForm
    def inertia(u, v, w):
        return RHO * THICKNESS * u * v

    return bending, inertia


# %% [markdown]
# ## Its matrices
#
# - **Supports.** `get_dofs("root")` takes all DOFs of the clamped edge; a simply supported
#   one takes some, by name: `get_dofs("root").all(["u", "u_y"])`.
# - **Rows** are named by vertex and DOF: `"12:u"` is the deflection of vertex 12, u_x
#   and u_y are its slopes, u_xy is its twist. Find a vertex by its place,
#   `basis.mesh.nodes_satisfying(lambda x: ...)`. For a sensor between vertices, the
#   shape functions map the DOFs (`basis.probes`). Displacements of an `ElementVector`
#   are ux, uy and uz.
# - **Mass.** M comes from the same shape functions as K. A lumped M, with mass on the
#   deflections only, is singular: keep the consistent one.


# %%
def whole(basis, theta):  # K and M, the held DOFs included
    from skfem import ElementQuad0

    bending, inertia = forms()
    factor = np.empty(basis.mesh.nelements)
    for name, elements in basis.mesh.subdomains.items():
        factor[elements] = theta[name]
    field = basis.with_element(ElementQuad0()).interpolate(factor)
    return bending.assemble(basis, factor=field), inertia.assemble(basis)


def assemble(basis, theta):
    return ef.from_skfem(basis, *whole(basis, theta), held=basis.get_dofs("root"))


# %% [markdown]
# ## The split, and the update
#
# $K = \sum_j \theta_j K_j$: {py:meth}`MatrixModel.from_differences
# <emcee_femu.MatrixModel.from_differences>` makes the parts from one assembly with all
# factors 1 and one per strip doubled.


# %%
def frequencies(basis, theta):  # in Hz, by scikit-fem
    from skfem import condense, solve
    from skfem.utils import solver_eigen_scipy_sym

    system = condense(*whole(basis, theta), D=basis.get_dofs("root"))
    solver = solver_eigen_scipy_sym(k=N_MODES, sigma=0.0)
    return np.sqrt(np.sort(solve(*system, solver=solver)[0])) / (2 * np.pi)


# %% [markdown]
# Every element belongs to a strip, so $K_0$ is zero.

# %% tags=["result"]
if __name__ == "__main__":
    names, rng, basis = list(TRUTH), np.random.default_rng(1), plate()
    ones = dict.fromkeys(names, 1.0)
    doubled = {name: {2.0: assemble(basis, {**ones, name: 2.0})} for name in names}
    base = assemble(basis, ones)
    print(base)
    model = ef.MatrixModel.from_differences(base, doubled, n_modes=N_MODES)
    exact = frequencies(basis, TRUTH)
    found = model({name: np.array([x]) for name, x in TRUTH.items()}).frequencies[0]
    gap = np.abs(found / exact - 1).max()
    print(f"frequencies: off by {gap:.0e} from those of scikit-fem")
    measured = exact * (1 + NOISE * rng.standard_normal(N_MODES))
    term = ef.FrequencyTerm(measured, relative_sd=NOISE)
    prior = ef.GaussianPrior(names, [1.0] * 4, 0.2, [(0.4, 1.6)] * 4)
    run = ef.run(ef.LogPosterior(model, term, prior), seed=1)
    idata = ef.to_inference_data(run)
    print(ef.parameter_table(idata, true=TRUTH), ef.frequency_table(run), sep="\n\n")
    print(ef.diagnose(run).verdict)

# %% [markdown]
# Strip 2 has lost 30 % of its stiffness, and the data separate it from the others.

# %% tags=["remove-cell"]
if __name__ == "__main__":
    assert gap < 1e-7
    assert ef.diagnose(run).converged
    weak = idata.posterior["strip 2"].values
    for name in set(TRUTH) - {"strip 2"}:
        assert (weak < idata.posterior[name].values).mean() > 0.99
