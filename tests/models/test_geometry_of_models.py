"""Models know where their nodes are, and those around them pass it on."""

import numpy as np
from scipy.sparse import csc_array

import emcee_femu as ef
from emcee_femu.models.exports import Matrices
from emcee_femu.models.geometry import Geometry

BAR = ef.Section(E=7e10, GJ=700.0, rho=2700.0, A=3e-4, Iy=2e-9, Iz="Iz")
POINTS = [(0.0, 0.0, 0.0), (0.5, 0.0, 0.1), (1.0, 0.0, 0.0)]
COLUMN = Geometry({0: (0, 0), 1: (0, 3)}, [(0, 1)])
K = csc_array([[3.0, -1.0], [-1.0, 2.0]])
M = csc_array(np.eye(2))


def exported(factor=1.0, rotation=1.0):
    """Return matrices of a column: translation and rotation of node 1."""
    nodes = np.array([["1", "ux"], ["1", "rz"]])
    mass = csc_array(np.diag([1.0, rotation]))
    return Matrices({"K": csc_array(factor * K), "M": mass}, nodes, "a program", COLUMN)


def test_a_frame_knows_its_nodes_and_elements():
    beam = ef.FrameModel(
        POINTS, [(0, 1, "bar"), (1, 2, "bar")], {"bar": BAR}, {0: "all"}, n_modes=2
    )
    nodes = {node: place.tolist() for node, place in beam.geometry.nodes.items()}
    assert nodes == {i: list(point) for i, point in enumerate(POINTS)}
    assert beam.geometry.lines == [(0, 1), (1, 2)]
    node, along = beam.geometry.locate("2:uy")
    assert node == 2 and along.tolist() == [0.0, 1.0, 0.0]


def test_a_model_of_differences_has_that_of_the_base_alone():
    base, doubled = exported(), {"k": {2.0: exported(2.0)}}
    make = ef.MatrixModel.from_differences
    assert make(base, doubled, n_modes=1).geometry is COLUMN
    pair = make((K, M), {"k": {2.0: (2 * K, M)}}, n_modes=1)
    assert pair.geometry is None
    assert ef.MatrixModel(K, M, {}, n_modes=1).geometry is None


def test_pairing_passes_it_on():
    base, doubled = exported(), {"k": {2.0: exported(2.0)}}
    model = ef.MatrixModel.from_differences(
        base, doubled, n_modes=1, shapes=base.sensors(["1:ux", "1:rz"])
    )
    measured = ef.Measurements([0.2], shapes=[[1.0], [0.5]], dofs=["1:ux", "1:rz"])
    assert ef.PairedModel(model, measured, candidates=1).geometry is COLUMN
    unknown = ef.FunctionModel(lambda p: ef.ModalSolution(np.ones(1), np.ones((1, 1))))
    assert ef.PairedModel(unknown, measured, candidates=1).geometry is None


def test_a_reduced_model_has_that_of_the_full_one():
    # 300 masses in a row, sparse
    n = 300
    B = np.eye(n) - np.eye(n, k=-1)
    nodes = np.array([[str(i), "ux"] for i in range(n)])
    row = Geometry({i: (i, 0.0) for i in range(n)})

    def chain(factor):
        parts = {"K": csc_array(factor * B.T @ B), "M": csc_array(np.eye(n))}
        return Matrices(parts, nodes, "a program", row)

    full = ef.MatrixModel.from_differences(
        chain(1.0), {"k": {2.0: chain(2.0)}}, n_modes=1
    )
    small = ef.reduce_model(full, {"k": (0.5, 2.0)}, test_points=2)
    assert small.geometry is row and isinstance(full.K0, csc_array)


def test_few_DOFs_that_all_have_mass_are_dense():
    model = ef.MatrixModel.from_differences(
        exported(), {"k": {2.0: exported(2.0)}}, n_modes=1
    )
    assert isinstance(model.K0, np.ndarray)
    lumped = ef.MatrixModel.from_differences(
        exported(rotation=0.0), {"k": {2.0: exported(2.0, rotation=0.0)}}, n_modes=1
    )
    assert isinstance(lumped.K0, csc_array)
    # Condensed by hand: 3 - 1 / 2 for a mass of 1, times the factor.
    found = lumped({"k": np.array([2.0])}).frequencies.item()
    assert np.isclose(found, np.sqrt(2 * 2.5) / (2 * np.pi), rtol=1e-9)
