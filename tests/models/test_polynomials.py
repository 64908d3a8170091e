"""Polynomials of matrices from exports at several values of the parameters."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy import sparse
from support.examples import TESTS
from support.exports import cantilever, write_calculix

import emcee_femu as ef

PLAIN = cantilever()[:2]
# Of frequencies: eigenvalues round by 1e-16 of the largest, 1e7 of the lowest.
ROUNDING = 1e-7


def read(folder, **factors):
    return ef.read_matrices(write_calculix(folder, *cantilever(**factors)))


def build(changes, base=PLAIN, **given):
    return ef.MatrixModel.from_differences(base, changes, n_modes=3, **given)


@pytest.mark.parametrize("kind", [np.array, sparse.csc_array])
def test_the_parts_of_a_beam_of_two_halves(kind):
    K, M = map(kind, PLAIN)
    changes = {"left": {2.0: kind(cantilever(left=2.0)[0])}}
    changes["mass"] = {3.0: (None, 3.0 * M)}
    model = build(changes, (K, M))
    assert [*model.K] == ["left"] and [*model.M] == ["mass"]
    own, _, _ = cantilever(left=1.0, right=0.0)
    as_array = np.asarray if kind is np.array else sparse.csc_array.toarray
    scale = abs(own).max()
    np.testing.assert_allclose(as_array(model.K["left"]), own, atol=1e-12 * scale)
    np.testing.assert_allclose(as_array(model.M0), 0.0, atol=1e-12)
    frequencies = model({"left": [0.7], "mass": [1.3]}).frequencies
    other = ef.MatrixModel(cantilever(left=0.7)[0], 1.3 * PLAIN[1], {}, n_modes=3)
    np.testing.assert_allclose(frequencies, other({}).frequencies, rtol=ROUNDING)


def test_values_are_those_of_the_parameters(tmp_path):
    E = 2.1e11
    base, soft = read(tmp_path), read(tmp_path, left=0.5)
    stiff = read(tmp_path, left=1.7)
    model = build({"E": {0.5 * E: soft, 1.7 * E: stiff}}, base, at={"E": E})
    other = ef.MatrixModel(*cantilever(left=1.2)[:2], {}, n_modes=3)
    frequencies = model({"E": [1.2 * E]}).frequencies
    np.testing.assert_allclose(frequencies, other({}).frequencies, rtol=ROUNDING)
    # The half that stands alone has no entries elsewhere: what rounding left is gone.
    rows = model.K["E"].nonzero()[0]
    assert rows.max() == base.dofs("19:ry") and model.M == {}


def test_exports_show_which_powers_of_a_parameter_there_are():
    (bent, M, _), membrane = cantilever(right=0.0), np.diag(np.arange(1.0, 17.0))
    values = 1.3, 1.7, 2.9

    def plate(t):
        return np.diag(np.full(16, 5e4)) + 3e4 * t * membrane + t**3 * bent, t * M

    with pytest.raises(ValueError, match=r"changes\['t'\]: K .*2 exp"):
        build({"t": {t: plate(t) for t in values[:2]}}, plate(1.0))
    for start in (1.0, -0.5):
        changes = {"t": {t: plate(t) for t in values}}
        model = build(changes, plate(start), at={"t": start})
        assert [*model.K] == ["t", "t^3"] and [*model.M] == ["t"]
        np.testing.assert_allclose(model.K["t^3"], bent, atol=1e-9 * bent.max())
        np.testing.assert_allclose(model.K["t"], 3e4 * membrane, atol=1e-2)
        assert model.names == ("t",)
    frequencies = model({"t": [1.7]}).frequencies
    other = ef.MatrixModel(*plate(1.7), {}, n_modes=3)
    np.testing.assert_allclose(frequencies, other({}).frequencies, rtol=ROUNDING)
    cubed = {t: cantilever(left=t**3)[0] for t in values[:2]}
    assert [*build({"t": cubed}).K] == ["t^3"]  # a power alone needs one export more
    nearly = {t: (t + 1e-7 * t**2) * PLAIN[0] for t in values}
    assert [*build({"t": nearly}).K] == ["t"]  # the fewest that fit


def test_a_parameter_of_which_a_matrix_is_no_polynomial_is_refused():
    K, M = PLAIN
    changes = {"a": {3.0: (3 * K, M), 2.0: (2 * K, 1.1 * M)}}
    with pytest.raises(ValueError, match=r"changes\['a'\]: M "):
        build(changes)
    roots = {t: t**0.5 * K for t in (0.25, 0.5, 1.5, 2.0, 3.0)}
    with pytest.raises(ValueError, match=r"changes\['t'\]: K "):
        build({"t": roots})


def test_exports_of_another_mesh_are_refused(tmp_path):
    base = read(tmp_path)
    K, M, dofs = cantilever(left=2.0)
    dofs[:, 0] += 1
    other = ef.read_matrices(write_calculix(tmp_path, K, M, dofs))
    with pytest.raises(ValueError, match=r"a'\]\[2\.0\]: .*nodes and directions of"):
        build({"a": {2.0: other}}, base)


@pytest.fixture(params=[1, 100], ids=["dense", "sparse"])
def exported(request):
    """Return matrices of a column of masses, by the factor of their stiffness."""
    base, n = ef.read_matrices(TESTS / "data" / "block.sti"), request.param
    column = ef.Geometry({i: (0, i) for i in range(3 * n)}, [(0, 1)])
    B = np.eye(3 * n) - np.eye(3 * n, k=-1)
    nodes = np.array([[str(i), "ux"] for i in range(3 * n)])

    def export(factor=1.0, massless=0):
        mass = np.diag(np.r_[np.ones(3 * n - massless), np.zeros(massless)])
        parts = {"K": sparse.csc_array(factor * B.T @ B), "M": sparse.csc_array(mass)}
        return type(base)(parts, nodes, "a program", column)

    return export


def test_any_object_with_matrices_labels_and_geometry_is_an_export():
    K, M = map(sparse.csc_array, PLAIN)
    drawn = ef.Geometry({0: (0, 0), 1: (0, 1)}, [(0, 1)])
    labels = tuple(f"{row}:uz" for row in range(K.shape[0]))

    def of(factor, labels):
        parts = {"K": factor * K, "M": M}
        return SimpleNamespace(matrices=parts, labels=labels, geometry=drawn)

    model = build({"k": {2.0: of(2.0, labels)}}, of(1.0, labels))
    assert model.geometry is drawn
    plain = build({"k": {2.0: 2.0 * K}}, (K, M))
    mixed = build({"k": {2.0: 2.0 * K}}, of(1.0, labels))  # its DOFs have no names
    *found, exact = (m({"k": [1.7]}).frequencies for m in (model, mixed, plain))
    np.testing.assert_allclose(found, [exact, exact], rtol=ROUNDING)
    with pytest.raises(ValueError, match="nodes and directions of the base"):
        build({"k": {2.0: of(2.0, labels[::-1])}}, of(1.0, labels))


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
    assert isinstance(model.K0, sparse.csc_array)
    condensed = K[:-1, :-1] - np.outer(K[:-1, -1], K[-1, :-1]) / K[-1, -1]
    exact = np.sqrt(2 * np.linalg.eigvalsh(condensed)[0]) / (2 * np.pi)
    np.testing.assert_allclose(model({"k": [2.0]}).frequencies, exact, rtol=1e-9)
