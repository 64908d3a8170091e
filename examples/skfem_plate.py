"""scikit-fem: update a plate of four strips with K and M of scikit-fem.

A plate clamped along one edge may have lost stiffness in any of four strips. Eight
measured frequencies are to tell the bending stiffness of each. scikit-fem assembles
the matrices once, and the sampler works with these:

    pip install "emcee_femu[skfem]"

scikit-fem assembles a form on any part of the mesh, so that K_j needs no trick: it is
the form on subdomain j, and K = sum theta_j K_j. For your own model copy `matrices`.
Mind:

* Parameters are factors on what K is linear in, here the bending stiffness of a strip.
  A thickness t is not: K grows with t^3 and M with t.
* Parts. Assemble each on the basis of its subdomain, made of the same mesh and element:
  then all parts share one numbering of the DOFs. What no subdomain holds belongs to
  K_0. The split is checked below against one assembly of the whole mesh, with a
  stiffness that varies from element to element.
* Supports. `get_dofs("root")` takes all DOFs of the clamped edge; a simply supported
  one takes some, by name: `get_dofs("root").all(["u", "u_y"])`.
* Rows. Each row is labelled (x, y, name): the place of a node, and which of its DOFs,
  the deflection u, the slopes u_x and u_y or the twist u_xy. A sensor of deflection
  reads the row "u" of its node; to one between nodes, the shape functions map the DOFs
  (`basis.probes`).
* DOFs without mass do not occur, since M comes from the same shape functions as K. A
  lumped M, with mass on the deflections only, is singular: MatrixModel refuses it, and
  to condense the massless DOFs out is no remedy, for K_aa - K_ab K_bb^-1 K_ba is not
  affine in theta. Keep the consistent mass.

The measured frequencies are simulated: those of scikit-fem at true factors, which are
stated, with 0.5 % of noise. A real structure also deviates from its model, and 0.5 %
would then be too little.

Run it:  python examples/skfem_plate.py
"""

import argparse
import time
from collections.abc import Mapping
from typing import Any

import numpy as np

import emcee_femu as ef

TRUTH = {"strip 1": 1.05, "strip 2": 0.7, "strip 3": 0.95, "strip 4": 1.1}
N_MODES, NOISE = 8, 0.005  # relative standard deviation of a measured frequency
LENGTH, WIDTH, THICKNESS = 0.6, 0.25, 0.004  # m
E, NU, RHO = 70e9, 0.33, 2700.0  # Pa, -, kg/m3


def plate(nx: int = 8, ny: int = 2) -> Any:
    """Return the basis of Bogner-Fox-Schmit rectangles: here stands your own script."""
    from skfem import Basis, ElementQuadBFS, MeshQuad

    lines = np.linspace(0, LENGTH, nx + 1), np.linspace(0, WIDTH, ny + 1)
    strips = {
        name: lambda x, i=i: np.floor(len(TRUTH) * x[0] / LENGTH) == i
        for i, name in enumerate(TRUTH)
    }
    mesh = MeshQuad.init_tensor(*lines).with_subdomains(strips)
    mesh = mesh.with_boundaries({"root": lambda x: x[0] == 0})
    return Basis(mesh, ElementQuadBFS(), intorder=6)  # exact for bicubic shapes


def forms() -> tuple[Any, Any]:
    """Return the forms of stiffness and mass of a Kirchhoff plate."""
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


def matrices(basis: Any) -> tuple[dict[str, Any], Any, list[tuple[float, float, str]]]:
    """Return {subdomain: K_j} and M, sparse, and the (x, y, name) of each row."""
    bending, inertia = forms()
    free = basis.complement_dofs(basis.get_dofs("root"))
    parts = {
        name: bending.assemble(basis.with_elements(name), factor=1.0)[free][:, free]
        for name in basis.mesh.subdomains
    }
    M = inertia.assemble(basis)[free][:, free]
    labels = {
        dof: (*basis.doflocs[:, dof].tolist(), name)
        for name, dofs in zip(basis.elem.dofnames, basis.nodal_dofs, strict=True)
        for dof in dofs
    }
    return parts, M, [labels[dof] for dof in free]


def whole(basis: Any, theta: Mapping[str, float]) -> tuple[Any, Any]:
    """Return K and M of one assembly, the supported DOFs included."""
    from skfem import ElementQuad0

    bending, inertia = forms()
    factor = np.empty(basis.mesh.nelements)
    for name, elements in basis.mesh.subdomains.items():
        factor[elements] = theta[name]
    field = basis.with_element(ElementQuad0()).interpolate(factor)
    return bending.assemble(basis, factor=field), inertia.assemble(basis)


def frequencies(basis: Any, theta: Mapping[str, float]) -> np.ndarray:
    """Return the frequencies in Hz by the eigensolver that scikit-fem calls."""
    from skfem import condense, solve
    from skfem.utils import solver_eigen_scipy_sym

    system = condense(*whole(basis, theta), D=basis.get_dofs("root"))
    solver = solver_eigen_scipy_sym(k=N_MODES, sigma=0.0)
    return np.sqrt(np.sort(solve(*system, solver=solver)[0])) / (2 * np.pi)


def main(generations: int = 2_000, seed: int = 1, sets: int = 10) -> dict[str, Any]:
    """Check the split, time both models, update the plate; return the figures."""
    names, rng = list(TRUTH), np.random.default_rng(seed)
    basis = plate()
    parts, M, labels = matrices(basis)
    prior = ef.GaussianPrior(names, [1.0] * 4, 0.2, [(0.4, 1.6)] * 4)
    dense = {name: part.toarray() for name, part in parts.items()}
    nothing = np.zeros(M.shape)  # every element belongs to a strip
    model = ef.MatrixModel(nothing, M.toarray(), dense, n_modes=N_MODES)
    thetas = [dict(zip(names, t, strict=True)) for t in prior.sample(rng, sets)]
    free = basis.complement_dofs(basis.get_dofs("root"))
    K = whole(basis, thetas[0])[0][free][:, free]
    gap = K - sum(thetas[0][name] * part for name, part in parts.items())
    found = {"split": np.abs(gap).max() / np.abs(K).max()}
    print(f"{len(labels)} rows, the last one is {labels[-1]}")
    print(f"sum theta_j K_j: off by {found['split']:.0e} of the largest of K")

    errors, seconds = [], []  # both models in turn, at the same parameter sets
    for theta in thetas:
        batch = {name: np.full(16, value) for name, value in theta.items()}
        clock = [time.perf_counter()]
        own = frequencies(basis, theta)
        clock.append(time.perf_counter())
        ours = model(batch).frequencies
        clock.append(time.perf_counter())
        errors.append(np.abs(ours / own - 1).max())
        seconds.append(np.diff(clock) / (1, len(ours)))
    found["frequencies"] = np.max(errors)
    found["speed-up"] = np.median(np.divide(*np.transpose(seconds)))
    program, matrix = 1e3 * np.median(seconds, axis=0)
    print(f"frequencies: off by {found['frequencies']:.0e} from those of scikit-fem")
    print(
        f"one solve: scikit-fem {program:.1f} ms with the assembly, MatrixModel "
        f"{matrix:.3f} ms in a batch of 16, {found['speed-up']:.0f} times faster\n"
    )

    noise = 1 + NOISE * rng.standard_normal(N_MODES)
    measured = frequencies(basis, TRUTH) * noise
    term = ef.FrequencyTerm(measured, relative_sd=NOISE)
    posterior = ef.LogPosterior(model, term, prior)
    burn_in = generations // 4
    samplers = ef.run(posterior, ef.DEMCMove(), nsteps=generations, seed=seed)
    idata = ef.to_inference_data(samplers, posterior, discard=burn_in)
    print(ef.parameter_table(idata, nominal=TRUTH))
    print(ef.frequency_table(idata, posterior))
    draws = samplers[0].get_chain(discard=burn_in, flat=True)
    found |= {"mean": draws.mean(axis=0), "sd": draws.std(axis=0)}
    return {**found, "measured": measured}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--generations", type=int, default=2_000)
    parser.add_argument("--seed", type=int, default=1)
    main(**vars(parser.parse_args()))
