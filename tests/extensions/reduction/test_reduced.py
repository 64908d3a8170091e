"""ReducedModel: its certificate against full solves, its limits, what it refuses."""

import numpy as np
import pytest
from scipy import sparse
from scipy.linalg import eigh
from support.beams import BOUNDS, OPTIONS, draws, error, reduce, three_parts
from support.contracts import assert_model, assert_shapes

import emcee_femu as ef
from emcee_femu import MatrixModel
from emcee_femu.models.eigen_sparse import lowest_modes

CORNERS = dict(
    zip(BOUNDS, np.array(np.meshgrid(*BOUNDS.values())).reshape(3, -1), strict=True)
)


@pytest.fixture(scope="module")
def full():
    return MatrixModel(*three_parts(), **OPTIONS)


@pytest.fixture(scope="module")
def reduced(full):
    return reduce(full, BOUNDS, 1e-4)


def test_fresh_points_err_less_than_the_tolerance_and_from_above(full, reduced):
    parameters = draws(60)
    relative = reduced(parameters).frequencies / full(parameters).frequencies - 1
    assert relative.max() <= 1e-4
    assert relative.min() > -1e-8  # Ritz values bound the true ones from above
    assert reduced.max_error <= reduced.tolerance == 1e-4
    assert relative.max() < 20 * reduced.max_error


def test_shapes_at_the_sensors_are_those_of_the_full_model(full, reduced):
    parameters = draws(20)
    assert_model(reduced, parameters)
    theirs, ours = full(parameters).shapes, reduced(parameters).shapes
    assert ours.shape == (20, 3, 5) and reduced.variables == full.variables
    assert_shapes(ours, theirs, atol=0.02 * np.abs(theirs).max())
    assert 0 <= reduced.shape_error < 1e-3
    named = MatrixModel(*three_parts(), n_modes=3, shapes={"roof": 90, "12:uz": 10})
    labels = reduce(named, BOUNDS, test_points=5).variables["shapes"].coords["dof"]
    assert (*labels,) == ("roof", "12:uz")


def test_the_certificate_holds_the_errors_at_all_corners():
    """Second route: scipy, at the corners, which are half of the 16 points."""
    K0, M0, K = three_parts()
    whole = MatrixModel(K0, M0, K, n_modes=5, shapes=True)
    model = reduce(whole, BOUNDS, 1e-2, test_points=16)
    modes, errors, lost = model(CORNERS), [], []
    for i, row in enumerate(zip(*CORNERS.values(), strict=True)):
        stiffness = K0 + sum(c * unit for c, unit in zip(row, K.values(), strict=True))
        values, exact = eigh(stiffness.toarray(), M0.toarray())
        f, g = np.sqrt(values) / (2 * np.pi), modes.frequencies[i]
        errors.append(np.abs(g / f[:5] - 1).max())
        mac = (exact.T @ (M0 @ modes.shapes[i])) ** 2
        close = np.abs(f[:, None] / g - 1) < 0.02  # what no close mode explains
        lost.append((1 - (mac * close).sum(axis=0)).max())
    assert max(errors) * (1 - 1e-6) <= model.max_error <= 1e-2
    assert max(lost) * (1 - 1e-3) <= model.shape_error <= 5 * max(lost)
    assert max(lost) > 1e-6


def test_the_basis_grows_as_the_tolerance_falls(full, reduced):
    model = reduce(full, BOUNDS, 1e-6, test_points=10)
    assert error(model, full, draws(30)) <= 1e-6
    assert 1e-9 < model.max_error <= 1e-6  # and no more than is needed
    assert model.size > reduced.size and model.full_solves <= 10 + 12


def free():
    bounds = {"left": (0.5, 2.0), "middle": (0.5, 2.0)}
    return MatrixModel(*three_parts(free=True), n_modes=4, skip=2), bounds, 1e-5


def singular_mass():
    K0, _, K = three_parts()
    B = sparse.eye_array(199, 200) + sparse.eye_array(199, 200, k=1)
    return MatrixModel(K0, sparse.csc_array(B.T @ B), K, n_modes=3), BOUNDS, 1e-4


def soft_ends(tolerance):
    # Springs far from their centre: the mass added to massless DOFs lowers the first
    # modes by more than rounding, and nothing is amiss.
    K0, M0, K = three_parts(free=True, lumped=True)
    size = M0.shape[0]
    for i, name in ((0, "left end"), (size - 2, "right end")):
        K[name] = sparse.csc_array(([1.0], ([i], [i])), shape=(size, size))
    bounds = {name: (0.7, 1.3) for name in ("left", "middle")}
    bounds |= dict.fromkeys(("left end", "right end"), (0.1, 1000.0))
    return MatrixModel(K0, M0, K, n_modes=2), bounds, tolerance


def varying_mass():
    """One parameter is in K and in M; the bounds are in another order."""
    K0, M0, K = three_parts()
    load = sparse.csc_array(([1.0], ([150], [150])), shape=M0.shape)
    bounds = dict(reversed((BOUNDS | {"load": (0.0, 0.5)}).items()))
    M = {"load": load, "left": 0.1 * M0}
    return MatrixModel(K0, M0, K, M, n_modes=4), bounds, 1e-4


def crossing():
    """Two equal cantilevers, independent: their frequencies cross."""
    K0, M0, K = three_parts()
    k = K0 + K["left"] + K["middle"]
    units = {
        name: sparse.kron(np.diag(here), k)
        for name, here in {"a": [1.0, 0.0], "b": [0.0, 1.0]}.items()
    }
    M0, bounds = sparse.block_diag([M0, M0]), {"a": (0.8, 1.2), "b": (0.8, 1.2)}
    return MatrixModel(0 * M0, M0, units, n_modes=5), bounds, 1e-6


@pytest.mark.parametrize(
    "make", [free, singular_mass, varying_mass, crossing, lambda: soft_ends(1e-3)]
)
def test_models_of_any_kind_keep_the_tolerance(make):
    whole, bounds, tolerance = make()
    model = reduce(whole, bounds, tolerance, test_points=12)
    assert model.names == whole.names == tuple(model.bounds)
    assert error(model, whole, draws(25, bounds)) <= tolerance
    if make is crossing:
        equal = {"a": np.array([1.0, 0.9]), "b": np.array([1.0, 0.9])}
        f = model(equal).frequencies
        np.testing.assert_allclose(f[:, 0], f[:, 1], rtol=1e-6)
        assert model.shape_error < 1e-3


def test_a_reduction_that_does_not_pay_is_a_warning():
    model = MatrixModel(np.diag([1, 2, 3, 4]), np.eye(4), {"k": np.eye(4)}, n_modes=3)
    with pytest.warns(UserWarning, match="4 DOFs") as caught:
        ef.reduce_model(model, {"k": (1.0, 2.0)})
    assert caught[0].filename == __file__


def test_a_parameter_outside_the_bounds_is_refused_by_name(reduced):
    parameters = draws(3)
    parameters["left"][1] = 0.59
    with pytest.raises(ValueError, match="left = 0.59 of row 1"):
        reduced(parameters)
    assert np.isfinite(reduced(CORNERS).frequencies).all()


def test_a_certificate_that_fails_is_made_up_for_or_an_error():
    whole, bounds, tolerance = soft_ends(1e-2)
    model = reduce(whole, bounds, tolerance)
    assert model.full_solves > 2 * 40  # what the first found joined the basis
    with pytest.raises(ValueError, match="after [45]. full solves"):
        ef.reduce_model(whole, bounds, tolerance, max_solves=80)


@pytest.mark.parametrize("call", [3, 9])  # while the basis grows, and at its end
def test_a_full_solve_that_misses_a_mode_is_found_out(full, monkeypatch, call):
    calls = []

    def forget(K, M, count, *args):
        calls.append(count)
        values, vectors = lowest_modes(K, M, count + 1, *args)
        lost = 1 if len(calls) == call else count
        return np.delete(values, lost), np.delete(vectors, lost, axis=1)

    monkeypatch.setattr(
        "emcee_femu.extensions.reduction.ritz_basis.lowest_modes", forget
    )
    with pytest.raises(ValueError, match="missed a mode"):
        ef.reduce_model(full, BOUNDS, 1e-2)
    assert len(calls) == call


def test_a_mass_that_is_not_positive_inside_the_bounds_is_refused():
    K0 = sparse.diags_array([np.full(40, 2.0), -np.ones(39), -np.ones(39)],
                            offsets=[0, 1, -1])  # fmt: skip
    off = sparse.diags_array([np.ones(39), np.ones(39)], offsets=[1, -1])
    model = MatrixModel(K0, sparse.eye_array(40), {}, {"m": off}, n_modes=2)
    with pytest.raises(ValueError, match="mass matrix"):
        ef.reduce_model(model, {"m": (-1.0, 1.0)}, test_points=4)
