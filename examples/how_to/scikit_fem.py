# %% [markdown]
# # Update a scikit-fem model
#
# You will assemble K by parts of a mesh in scikit-fem, and find the part that has lost
# stiffness. `python examples/how_to/scikit_fem.py` runs this page (6 s); it takes
# `pip install "emcee_femu[skfem]"`.
#
# A plate clamped along one edge may have lost stiffness in any of four strips. Eight
# measured frequencies are to tell the bending stiffness of each. scikit-fem assembles a
# form on any part of the mesh, so that $K_j$ needs no trick: it is the form on subdomain j,
# and $K = \sum_j \theta_j K_j$. For your own model copy `matrices`.

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
# Here stands your own script. Parameters are factors on what K is linear in, here the
# bending stiffness of a strip. For a thickness t say that K grows with t³ and M with t:
# `K={"bending": (K3, lambda t: t**3)}, M={"mass": (M1, lambda t: t)}`. What is no such sum
# goes through {py:class}`~emcee_femu.AssembledModel`.


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
# - **Parts.** Assemble each on the basis of its subdomain, made of the same mesh and
#   element: then all parts share one numbering of the DOFs. What no subdomain holds belongs
#   to $K_0$.
# - **Supports.** `get_dofs("root")` takes all DOFs of the clamped edge; a simply supported
#   one takes some, by name: `get_dofs("root").all(["u", "u_y"])`.
# - **Rows.** Each row is labelled (x, y, name): the place of a node, and which of its DOFs,
#   the deflection u, the slopes u_x and u_y or the twist u_xy. A sensor of deflection reads
#   the row "u" of its node; to one between nodes, the shape functions map the DOFs
#   (`basis.probes`).


# %%
def matrices(basis):  # {subdomain: K_j}, M, and (x, y, name) of each row
    bending, inertia = forms()
    free = basis.complement_dofs(basis.get_dofs("root"))
    parts = {}
    for name in basis.mesh.subdomains:
        own = basis.with_elements(name)
        parts[name] = bending.assemble(own, factor=1.0)[free][:, free]
    M = inertia.assemble(basis)[free][:, free]
    labels = {}
    kinds = zip(basis.elem.dofnames, basis.nodal_dofs, strict=True)
    for name, dofs in kinds:
        for dof in dofs:
            labels[dof] = (*basis.doflocs[:, dof].tolist(), name)
    return parts, M, [labels[dof] for dof in free]


# %% [markdown]
# DOFs without mass do not occur, since M comes from the same shape functions as K. A lumped
# M, with mass on the deflections only, is singular, and refused: keep the consistent one.
#
# To check the split: one assembly of the whole mesh, with a stiffness that varies from
# element to element, and the eigensolver that scikit-fem calls.


# %%
def whole(basis, theta):  # K and M, the supported DOFs included
    from skfem import ElementQuad0

    bending, inertia = forms()
    factor = np.empty(basis.mesh.nelements)
    for name, elements in basis.mesh.subdomains.items():
        factor[elements] = theta[name]
    field = basis.with_element(ElementQuad0()).interpolate(factor)
    return bending.assemble(basis, factor=field), inertia.assemble(basis)


def frequencies(basis, theta):  # in Hz, by scikit-fem
    from skfem import condense, solve
    from skfem.utils import solver_eigen_scipy_sym

    system = condense(*whole(basis, theta), D=basis.get_dofs("root"))
    solver = solver_eigen_scipy_sym(k=N_MODES, sigma=0.0)
    return np.sqrt(np.sort(solve(*system, solver=solver)[0])) / (2 * np.pi)


# %% [markdown]
# The cells from here on work; they stand under a guard, so that the functions above can be
# imported without scikit-fem. Every element belongs to a strip, so $K_0$ is zero, and with
# a hundred DOFs dense matrices are faster.

# %%
if __name__ == "__main__":
    names, rng, basis = list(TRUTH), np.random.default_rng(1), plate()
    parts, M, labels = matrices(basis)
    print(f"{len(labels)} rows, the last one is {labels[-1]}")
    dense = {name: part.toarray() for name, part in parts.items()}
    model = ef.MatrixModel(np.zeros(M.shape), M.toarray(), dense, n_modes=N_MODES)
    prior = ef.GaussianPrior(names, [1.0] * 4, 0.2, [(0.4, 1.6)] * 4)
    random = dict(zip(names, prior.sample(rng, 1)[0], strict=True))
    free = basis.complement_dofs(basis.get_dofs("root"))
    K = whole(basis, random)[0][free][:, free]
    rest = K - sum(random[name] * part for name, part in parts.items())
    off = np.abs(rest).max() / np.abs(K).max()
    print(f"sum theta_j K_j: off by {off:.0e} of the largest of K")
    batch = {name: np.array([x]) for name, x in random.items()}
    theirs = frequencies(basis, random)
    gap = np.abs(model(batch).frequencies[0] / theirs - 1).max()
    print(f"frequencies: off by {gap:.0e} from those of scikit-fem")

# %% [markdown]
# ## The update
#
# The measured frequencies are simulated: those of scikit-fem at true factors, with 0.5 % of
# noise. A real structure also deviates from its model:
# `ef.FrequencyTerm(..., discrepancy="model error")`, see
# {doc}`/tutorials/noise_and_model_error`. The run is short, for this page; a study takes
# `ensembles=4`, and looks at {py:func}`~emcee_femu.diagnose`.

# %%
if __name__ == "__main__":
    noise = 1 + NOISE * rng.standard_normal(N_MODES)
    measured = frequencies(basis, TRUTH) * noise
    term = ef.FrequencyTerm(measured, relative_sd=NOISE)
    posterior = ef.LogPosterior(model, term, prior)
    run = ef.run(posterior, steps=200, ensembles=1, seed=1)
    idata = ef.to_inference_data(run)
    print(ef.parameter_table(idata, nominal=TRUTH))
    print(ef.frequency_table(idata, posterior))

# %% [markdown]
# Strip 2 has lost 30 % of its stiffness, and the others are told apart from it.

# %% tags=["remove-cell"]
if __name__ == "__main__":
    assert off < 1e-12 and gap < 1e-9
    for name, value in TRUTH.items():
        draws = idata.posterior[name].values
        assert abs(draws.mean() - value) < 3 * draws.std() < 3 * 0.1
    weak = idata.posterior["strip 2"].values
    for name in set(TRUTH) - {"strip 2"}:
        assert (weak < idata.posterior[name].values).mean() > 0.99
