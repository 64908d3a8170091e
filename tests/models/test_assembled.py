"""Functions that assemble K and M, against models of the same matrices."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import sparse
from support.contracts import assert_model, assert_shapes
from support.derivatives import assert_jacobian
from support.exports import LENGTH, cantilever

import emcee_femu as ef

AT = {"x": np.array([1.1, 0.62]), "k": np.array([4e4, 9e4]), "m": np.array([0.7, 1.2])}


def beam(p, elements=8):
    """Return a beam on a spring at x, in whatever element that is."""
    K, M, _ = cantilever(elements)
    L = LENGTH / elements
    element, s = divmod(p["x"] / L, 1.0)
    a = np.array([1 - 3 * s**2 + 2 * s**3, -L * (s - 2 * s**2 + s**3),
                  3 * s**2 - 2 * s**3, L * (s**2 - s**3)])  # fmt: skip
    first = 2 * int(element) - 2  # the clamped node has no rows
    K[first : first + 4, first : first + 4] += p["k"] * np.outer(a, a)
    return K, p["m"] * M


def sparse_beam(p):
    return tuple(map(sparse.csr_array, beam(p)))


KINDS = pytest.mark.parametrize("assemble", [beam, sparse_beam])


@KINDS
def test_modes_are_those_of_the_matrices(assemble):
    model = ef.AssembledModel(assemble, AT, n_modes=3, shapes={"tip": 14, "root": 2})
    assert_model(model, AT)
    solution = model(AT)
    assert model.variables["shapes"].coords["dof"] == ("tip", "root")
    for i in range(2):
        row = {name: value[i] for name, value in AT.items()}
        exact = ef.MatrixModel(*assemble(row), {}, n_modes=3, shapes=[14, 2])({})
        assert_allclose(solution.frequencies[i], exact.frequencies[0], rtol=1e-9)
        assert_shapes(solution.shapes[i], exact.shapes[0], rtol=1e-6)


@KINDS
def test_derivatives_take_assemblies_and_no_solve(assemble):
    model = ef.AssembledModel(assemble, AT, n_modes=2, shapes=[14, 2])
    assert_jacobian(model, AT, tolerance=1e-5)
    calls = []
    count = ef.AssembledModel(lambda p: calls.append(1) or assemble(p), AT, n_modes=2)
    count.jacobian(AT)
    assert len(calls) == 2 * (1 + 2 * len(AT))


@pytest.mark.filterwarnings("ignore:the reduction does not pay")
def test_reduced_each_assembly_is_projected():
    """Against a full solve, at points that were not used."""

    def assemble(p):
        K, M = map(sparse.csc_array, beam(p, 24))
        M = sparse.diags_array(M.diagonal())
        M.data[:, 1::2] = 0.0  # rotations have no mass
        return K, M

    bounds = {"x": (0.6, 1.2), "k": (3e4, 1e5), "m": (0.6, 1.4)}
    full = ef.AssembledModel(assemble, bounds, n_modes=3, shapes=[46, 20])
    reduced = ef.reduce_model(full, bounds, 1e-5, test_points=6)
    assert reduced.max_error < 1e-5 and reduced.size < 30
    assert reduced.one_by_one
    assert reduced.shape_dofs == full.variables["shapes"].coords["dof"]
    exact, near = full(AT), reduced(AT)
    assert_allclose(near.frequencies, exact.frequencies, rtol=1e-5)
    assert (near.frequencies > exact.frequencies * (1 - 1e-6)).all()
    assert_shapes(near.shapes, exact.shapes, rtol=1e-3, atol=1e-4)
    assert_jacobian(reduced, AT, tolerance=1e-4)
    with pytest.raises(ValueError, match="x = 1.3 of row 0 is outside the bounds"):
        reduced({"x": [1.3], "k": [4e4], "m": [1.0]})


@pytest.mark.parametrize(
    ("result", "message"),
    [
        (np.eye(3), r"assemble: expected \(K, M\)"),
        ((np.eye(3), np.eye(2)), "assemble: M: expected K0's shape"),
        ((np.eye(3), -np.eye(3)), r"mass matrix at \{'a': 1.0\}"),
        ((sparse.eye_array(3), -sparse.eye_array(3)), r"mass matrix at \{'a': 1.0\}"),
        ((np.triu(np.ones((3, 3))), np.eye(3)), "K: expected a symmetric"),
        ((np.full((3, 3), np.nan), np.eye(3)), "assemble: K"),
        ((np.eye(1), np.eye(1)), r"skip \+ n_modes = 2 rows, got"),
        ((np.eye(2), np.eye(2)), "DOF 2 of shapes"),
    ],
)
def test_what_may_not_be_assembled(result, message):
    model = ef.AssembledModel(lambda p: result, ["a"], n_modes=2, shapes=[2])
    with pytest.raises((TypeError, ValueError), match=message):
        model({"a": np.array([1.0])})
    with pytest.raises(TypeError, match="shapes: .*got True"):
        ef.AssembledModel(beam, ["x"], n_modes=2, shapes=True)


def flagpole(p):
    """A bar of length x with a mass at its end, and a sensor across it."""
    bar = ef.Section(E=(2e11, "E"), rho=7800, A=1e-3, I=1e-6)
    nodes = np.linspace([0, 0], [p["x"] * np.cos(0.4), p["x"] * np.sin(0.4)], 7)
    bars = [(i, i + 1, "bar") for i in range(6)]
    return ef.FrameModel(
        nodes, bars, {"bar": bar}, {0: "fixed"}, n_modes=3, plane="xy",
        shapes={"across": {"6:ux": -np.sin(0.4), "6:uy": np.cos(0.4)}, "turn": "6:rz"},
    )  # fmt: skip


def test_frequencies_of_a_cantilever_fall_with_the_square_of_its_length():
    """Mass-normalised shapes of length L are L^(-1/2) and their slopes L^(-3/2)."""
    model = ef.AssembledModel.from_frame(flagpole, {"E": 1.0, "x": 2.0})
    assert model.names == ("E", "x") and "6:uy" in model.dofs
    p = {"E": np.array([1.0, 1.0, 4.0]), "x": np.array([1.0, 3.0, 2.0])}
    solved, slopes = model.jacobian(p)
    closed = 1.8751041**2 / (2 * np.pi) * np.sqrt(p["E"] * 2e11 * 1e-6 / 7.8)
    assert_allclose(solved.frequencies[:, 0], closed / p["x"] ** 2, rtol=1e-4)
    assert_allclose(
        slopes["frequency"]["x"][:, 0],
        -2 * solved.frequencies[:, 0] / p["x"],
        rtol=1e-5,
    )
    size = np.abs(solved.shapes[:, :, 0])
    assert_allclose(size[1] / size[0], [3**-0.5, 3**-1.5], rtol=1e-9)
    assert_allclose(
        slopes["shapes"]["x"][:, :, 0],
        solved.shapes[:, :, 0] * [-0.5, -1.5] / p["x"][:, None],
        rtol=1e-5,
    )


def test_a_roller_is_found_where_it_stands():
    """By the frequencies of a beam on a finer mesh, built for that place."""

    def beam(p, elements=4):
        bar = ef.Section(E=2e11, rho=7800, A=1e-3, I=1e-6)
        first, last = np.linspace(0, p["x"], elements + 1), np.linspace(p["x"], 4, 3)
        nodes = [(x, 0) for x in [*first, *last[1:]]]
        bars = [(i, i + 1, "bar") for i in range(len(nodes) - 1)]
        supports = {0: "fixed", elements: "roller"}
        return ef.FrameModel(nodes, bars, {"bar": bar}, supports, n_modes=3, plane="xy")

    measured = beam({"x": 2.7}, elements=12)({}).frequencies[0]
    model = ef.AssembledModel.from_frame(beam, {"x": 2.0})
    term = ef.FrequencyTerm(measured, relative_sd=0.01)
    prior = ef.IndependentPrior({"x": (2.0, 3.5)})
    found = ef.find_map(ef.LogPosterior(model, term, prior), 4, seed=1)
    assert_allclose(found.maxima[0].theta, 2.7, atol=0.01)


def test_a_frame_that_changes_its_dofs_is_refused():
    def held(p):
        supports = {0: "fixed", 1: "roller"} if p["x"] > 2.5 else {0: "fixed"}
        bar = ef.Section(E=2e11, rho=7800, A=1e-3, I=1e-6)
        nodes = [(0, 0), (p["x"], 0)]
        return ef.FrameModel(
            nodes, [(0, 1, "bar")], {"bar": bar}, supports, n_modes=1, plane="xy"
        )

    model = ef.AssembledModel.from_frame(held, {"x": 2.0})
    with pytest.raises(ValueError, match="frame: .*first 3 DOFs at .*3.0"):
        model({"x": np.array([2.0, 3.0])})
    with pytest.raises(ValueError, match=r"at: no value of \['E'\]"):
        ef.AssembledModel.from_frame(flagpole, {"x": 2.0})
    with pytest.raises(TypeError, match="frame: expected a AffineModel, got tuple"):
        ef.AssembledModel.from_frame(lambda p: (1, 2), {"x": 2.0})
