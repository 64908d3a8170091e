"""scikit-fem: rows by node and name, frequencies and shapes of its own solvers."""

import numpy as np
import pytest
from scipy.linalg import eigh
from support.examples import load

import emcee_femu as ef

skfem = pytest.importorskip("skfem", reason="pip install 'emcee_femu[skfem]'")
ROOT = {"root": lambda x: x[0] == 0}


def assemble(mesh, element):
    """Return a basis, and stiffness and mass of an elastic body with units of 1."""
    from skfem.models.elasticity import lame_parameters, linear_elasticity

    basis = skfem.Basis(mesh.with_boundaries(ROOT), element)
    inertia = skfem.BilinearForm(lambda u, v, w: 3.0 * sum(u * v))
    K = linear_elasticity(*lame_parameters(1.0, 0.3)).assemble(basis)
    return basis, K, inertia.assemble(basis)


SOLIDS = {
    "quadratic triangles": lambda: assemble(
        skfem.MeshTri().refined(2), skfem.ElementVector(skfem.ElementTriP2())
    ),
    "linear tetrahedra": lambda: assemble(
        skfem.MeshTet().refined(1), skfem.ElementVector(skfem.ElementTetP1())
    ),
    "quadratic bricks": lambda: assemble(
        skfem.MeshHex(), skfem.ElementVector(skfem.ElementHex2())
    ),
}


@pytest.mark.parametrize("name", SOLIDS)
def test_rows_frequencies_and_mass_of_solids(name):
    """A linear field has its values at all nodes, those of edges and faces too."""
    from skfem.utils import solver_eigen_scipy_sym

    basis, K, M = SOLIDS[name]()
    held = basis.get_dofs("root")
    base = ef.from_skfem(basis, K, M, held=held)
    assert len({*base.labels}) == base.size == basis.N - len(np.asarray(held))

    def field(x):
        return [(1 + i) * x[0] - 0.5 * i * x[1] for i in range(len(x))]

    expected = {}
    for node, place in base.geometry.nodes.items():
        values = field(place[: basis.mesh.dim()])
        for axis, value in zip(("ux", "uy", "uz"), values, strict=False):
            expected[f"{node}:{axis}"] = value
    u = np.array([expected[label] for label in base.labels])
    whole = basis.project(lambda x: np.array(field(x)))
    np.testing.assert_allclose(u, whole[basis.complement_dofs(held)], atol=1e-9)
    system = skfem.condense(K, M, D=held)
    squares = skfem.solve(*system, solver=solver_eigen_scipy_sym(k=4, sigma=0.0))[0]
    found = eigh(base.K.toarray(), base.M.toarray(), eigvals_only=True)[:4]
    np.testing.assert_allclose(np.sqrt(found), np.sqrt(np.sort(squares)), rtol=1e-7)
    mass = ef.from_skfem(basis, K, M).moving_mass  # free, of density 3
    assert mass == pytest.approx(dict.fromkeys(mass, 3.0), rel=1e-12)


def test_a_plate_moves_out_of_its_plane():
    page = load("how_to/scikit_fem")
    basis = page.plate()
    base = page.assemble(basis, dict.fromkeys(page.TRUTH, 1.0))
    assert base.size == 96 and base.moving_mass == {}
    (tip,) = basis.mesh.nodes_satisfying(
        lambda x: np.isclose(x[0], page.LENGTH) & np.isclose(x[1], page.WIDTH)
    )
    node, along = base.geometry.locate(f"{tip}:u")
    assert base.geometry.nodes[node].tolist() == [page.LENGTH, page.WIDTH, 0.0]
    assert along.tolist() == [0.0, 0.0, 1.0]
    assert base.geometry.locate(f"{tip}:u_x") is None
    assert len(base.geometry.lines) == basis.mesh.facets.shape[1]
    # A force at the tip moves the node as the flexibility says.
    force, own = basis.zeros(), np.zeros(base.size)
    force[basis.nodal_dofs[0, tip]] = own[base.dofs(f"{tip}:u")] = 7.0
    K = page.whole(basis, dict.fromkeys(page.TRUTH, 1.0))[0]
    moved = skfem.solve(*skfem.condense(K, force, D=basis.get_dofs("root")))
    found = np.linalg.solve(base.K.toarray(), own)
    for number, dof in enumerate(("u", "u_x", "u_y", "u_xy")):
        theirs = moved[basis.nodal_dofs[number, tip]]
        assert found[base.dofs(f"{tip}:{dof}")] == pytest.approx(theirs, rel=1e-8)


def test_a_uniform_square_plate_has_the_published_frequencies(monkeypatch):
    page = load("how_to/scikit_fem")
    for constant, value in (
        ("LENGTH", 1.0),
        ("WIDTH", 1.0),
        ("NU", 0.3),
        ("N_MODES", 5),
    ):
        monkeypatch.setattr(page, constant, value)
    found = page.frequencies(page.plate(8, 8), dict.fromkeys(page.TRUTH, 1.0))
    D = page.E * page.THICKNESS**3 / (12 * (1 - page.NU**2))
    factors = 2 * np.pi * found * np.sqrt(page.RHO * page.THICKNESS / D)
    # Leissa 1973, doi 10.1016/S0022-460X(73)80371-2: upper bounds by the Ritz method.
    published = np.array([3.4917, 8.5246, 21.429, 27.331, 31.111])
    assert (factors < published).all()
    np.testing.assert_allclose(factors, published, rtol=0.01)


def test_names_are_those_by_which_scikit_fem_finds_DOFs():
    """Edges and faces of a solid with other DOFs each."""
    element = skfem.ElementTetN0() * skfem.ElementTetRT0()
    basis = skfem.Basis(skfem.MeshTet(), element)
    unit = np.eye(basis.N)
    labels = ef.from_skfem(basis, unit, unit).labels
    view = basis.get_dofs(elements=True)
    assert {*view.edge} != {*view.facet}
    for name, dofs in (view.edge | view.facet).items():
        assert {labels[dof].partition(":")[2] for dof in dofs} == {name}


@pytest.mark.parametrize(
    ("bend", "message"),
    [
        (lambda K, M: (K[1:, 1:], M, ()), r"K: expected 16 rows, .*no condensed"),
        (lambda K, M: (K, M[1:, 1:], ()), r"M: expected 16 rows, .* got 15"),
        (lambda K, M: (K, M, [16]), r"held: expected DOFs of the basis, 0 to 15"),
        (lambda K, M: (K, M, np.arange(16)), r"held: no DOF is left free"),
    ],
)
def test_what_is_not_of_the_basis_is_refused(bend, message):
    basis = skfem.Basis(skfem.MeshTri(), skfem.ElementTriP3())
    K, M = (form.assemble(basis) for form in (skfem.models.laplace, skfem.models.mass))
    K, M, held = bend(K.tocsc(), M.tocsc())
    with pytest.raises(ValueError, match=message):
        ef.from_skfem(basis, K, M, held=held)
