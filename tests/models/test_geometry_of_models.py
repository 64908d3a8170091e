"""Models know where their nodes are, and those around them pass it on."""

import numpy as np
import pytest
from scipy.sparse import csc_array
from support.examples import TESTS

import emcee_femu as ef


@pytest.fixture(params=[1, 100], ids=["dense", "sparse"])
def exported(request):
    """Return matrices of a column of masses, by the factor of their stiffness."""
    base, n = ef.read_matrices(TESTS / "data" / "block.sti"), request.param
    column = ef.Geometry({i: (0, i) for i in range(3 * n)}, [(0, 1)])
    B = np.eye(3 * n) - np.eye(3 * n, k=-1)
    nodes = np.array([[str(i), "ux"] for i in range(3 * n)])

    def export(factor=1.0, massless=0):
        mass = np.diag(np.r_[np.ones(3 * n - massless), np.zeros(massless)])
        parts = {"K": csc_array(factor * B.T @ B), "M": csc_array(mass)}
        return type(base)(parts, nodes, "a program", column)

    return export


def test_a_frame_knows_its_nodes_and_elements():
    bar = ef.Section(E=7e10, GJ=700.0, rho=2700.0, A=3e-4, Iy=2e-9, Iz="Iz")
    points = [(0.0, 0.0, 0.0), (0.5, 0.0, 0.1), (1.0, 0.0, 0.0)]
    lines = [(0, 1, "bar"), (1, 2, "bar")]
    beam = ef.FrameModel(points, lines, {"bar": bar}, {0: "all"}, n_modes=2)
    nodes = {node: place.tolist() for node, place in beam.geometry.nodes.items()}
    assert nodes == {i: list(point) for i, point in enumerate(points)}
    assert beam.geometry.lines == [(0, 1), (1, 2)]
    node, along = beam.geometry.locate("2:uy")
    assert node == 2 and along.tolist() == [0.0, 1.0, 0.0]


@pytest.mark.filterwarnings("ignore:the reduction does not pay")
def test_what_is_made_of_exports_has_the_geometry_of_the_base(exported):
    base, make = exported(), ef.MatrixModel.from_differences
    dofs = ["0:ux", "1:ux"]
    options = {"n_modes": 1, "shapes": base.sensors(dofs)}
    model = make(base, {"k": {2.0: exported(2.0)}}, **options)
    assert model.geometry is base.geometry
    assert isinstance(model.K0, np.ndarray) == (base.size < 200)
    measured = ef.Measurements([0.2], shapes=[[0.5], [1.0]], dofs=dofs)
    assert ef.PairedModel(model, measured, candidates=1).geometry is base.geometry
    small = ef.reduce_model(model, {"k": (0.5, 2.0)}, test_points=2)
    assert small.geometry is base.geometry
    pair = make((base.K, base.M), {"k": {2.0: (2 * base.K, base.M)}}, n_modes=1)
    plain = ef.MatrixModel(base.K, base.M, {}, n_modes=1)
    unknown = ef.FunctionModel(lambda p: ef.ModalSolution(np.ones(1), np.ones((2, 1))))
    around = ef.PairedModel(unknown, measured, candidates=1)
    assert pair.geometry is plain.geometry is around.geometry is None


def test_DOFs_without_mass_are_left_to_the_sparse_solver(exported):
    base, K = exported(massless=1), exported().K.toarray()
    doubled = {"k": {2.0: exported(2.0, massless=1)}}
    model = ef.MatrixModel.from_differences(base, doubled, n_modes=1)
    assert isinstance(model.K0, csc_array)
    condensed = K[:-1, :-1] - np.outer(K[:-1, -1], K[-1, :-1]) / K[-1, -1]
    exact = np.sqrt(2 * np.linalg.eigvalsh(condensed)[0]) / (2 * np.pi)
    np.testing.assert_allclose(model({"k": [2.0]}).frequencies, exact, rtol=1e-9)
