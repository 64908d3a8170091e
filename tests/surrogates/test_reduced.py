"""ReducedModel: its certificate against full solves, its estimate, its limits."""

import pickle

import numpy as np
import pytest
from scipy import sparse, stats
from support.modal_models import assert_batch_is_a_loop
from support.reduced_beam import BOUNDS, OPTIONS, beam, draws, error, reduce

import emcee_femu as ef
from emcee_femu.models.eigen.sparse import SparseEigenproblem
from emcee_femu.models.matrix import MatrixModel
from emcee_femu.surrogates.ritz_basis import Projection


@pytest.fixture(scope="module")
def full():
    return MatrixModel(*beam(), **OPTIONS)


@pytest.fixture(scope="module")
def reduced(full):
    return reduce(full, BOUNDS, 1e-4)


def test_fresh_points_err_less_than_the_tolerance_and_from_above(full, reduced):
    parameters = draws(60)
    theirs, ours = full(parameters), reduced(parameters)
    relative = ours.frequencies / theirs.frequencies - 1
    assert relative.max() <= 1e-4
    assert relative.min() > -1e-8  # Ritz values bound the true ones from above
    assert reduced.max_error <= reduced.tolerance == 1e-4
    assert relative.max() < 20 * reduced.max_error


def test_shapes_at_the_sensors_are_those_of_the_full_model(full, reduced):
    parameters = draws(20)
    theirs, ours = full(parameters).shapes, reduced(parameters).shapes
    assert ours.shape == (20, 3, 5) and reduced.shape_dofs == (10, 90, 150)
    assert reduced.variables == full.variables
    signs = np.sign((ours * theirs).sum(axis=1, keepdims=True))
    assert np.abs(ours * signs - theirs).max() < 0.02 * np.abs(theirs).max()
    assert 0 <= reduced.shape_error < 1e-3


def test_the_certificate_is_the_error_at_its_own_points(full):
    # Second route: the points of the certificate, drawn again from the same seed.
    model = reduce(full, BOUNDS, 1e-3, test_points=8)
    corner = {name: np.array(pair) for name, pair in BOUNDS.items()}
    grid = np.array(np.meshgrid(*corner.values())).reshape(3, -1)
    every = dict(zip(BOUNDS, grid, strict=True))
    at_corners = np.abs(model(every).frequencies / full(every).frequencies - 1).max(
        axis=1
    )
    assert at_corners.max() < 2e-3
    assert at_corners.min() <= model.max_error <= 1e-3


@pytest.mark.parametrize("tolerance", [1e-2, 1e-6])
def test_the_basis_grows_as_the_tolerance_falls(full, reduced, tolerance):
    model = reduce(full, BOUNDS, tolerance, test_points=10)
    assert model.max_error <= tolerance
    assert error(model, full, draws(30)) <= tolerance
    assert model.max_error > tolerance / 1000  # and no more than is needed
    assert (model.size > reduced.size) == (tolerance < 1e-4)


def test_a_batch_equals_a_loop_to_the_bit_and_so_does_a_small_pickle(reduced):
    assert_batch_is_a_loop(reduced, draws(7))
    assert len(pickle.dumps(reduced)) < 20 * 8 * reduced.size**2


def test_the_same_seed_gives_the_same_model(full, reduced):
    again, parameters = reduce(full, BOUNDS, 1e-4), draws(3)
    assert np.array_equal(
        again(parameters).frequencies, reduced(parameters).frequencies
    )


def test_dense_matrices_reduce_too(full):
    K0, M0, K = beam()
    dense = MatrixModel(
        K0.toarray(), M0.toarray(), {n: k.toarray() for n, k in K.items()}, **OPTIONS
    )
    model = reduce(dense, BOUNDS, 1e-4, test_points=10)
    assert error(model, full, draws(30)) <= 1e-4


def test_a_free_beam_keeps_its_rigid_motions():
    bounds = {"left": (0.5, 2.0), "middle": (0.5, 2.0)}
    full = MatrixModel(*beam(free=True), n_modes=4, skip=2)
    model = reduce(full, bounds, 1e-5, test_points=10)
    assert error(model, full, draws(30, bounds)) <= 1e-5


def test_shapes_keep_the_names_of_their_sensors():
    full = MatrixModel(*beam(), n_modes=3, shapes={"roof": 90, "12:uz": 10})
    reduced = reduce(full, BOUNDS, 1e-4, test_points=5)
    assert (*reduced.variables["shapes"].coords["dof"],) == ("roof", "12:uz")
    ours, theirs = (model(draws(3)).shapes for model in (reduced, full))
    np.testing.assert_allclose(abs(ours), abs(theirs), rtol=1e-2)


def test_massless_DOFs_stay():
    full = MatrixModel(*beam(lumped=True), n_modes=4)
    model = reduce(full, BOUNDS, 1e-4, test_points=10)
    assert error(model, full, draws(30)) <= 1e-4


def test_a_singular_mass_stays():
    K0, _, K = beam()
    B = sparse.eye_array(199, 200) + sparse.eye_array(199, 200, k=1)
    full = MatrixModel(K0, sparse.csc_array(B.T @ B), K, n_modes=3)
    model = reduce(full, BOUNDS, 1e-4, test_points=10)
    assert error(model, full, draws(30)) <= 1e-4


@pytest.mark.parametrize("tolerance", [1e-2, 1e-3])
def test_the_mass_of_massless_DOFs_hides_no_mode(tolerance):
    # Soft end springs far from their centre: the added mass lowers the first modes by
    # more than rounding, and nothing is amiss.
    K0, M0, K = beam(free=True, lumped=True)
    size = M0.shape[0]
    for i, name in ((0, "left end"), (size - 2, "right end")):
        K[name] = sparse.csc_array(([1.0], ([i], [i])), shape=(size, size))
    bounds = {name: (0.7, 1.3) for name in ("left", "middle")}
    bounds |= dict.fromkeys(("left end", "right end"), (0.1, 1000.0))
    full = MatrixModel(K0, M0, K, n_modes=2)
    model = reduce(full, bounds, tolerance, test_points=12)
    assert error(model, full, draws(20, bounds)) <= tolerance


def test_few_DOFs_with_mass_are_enough():
    K0, _, K = beam()
    masses = np.zeros(200)
    masses[[30, 62, 90, 120, 150, 190]] = [1.0, 2.0, 0.5, 1.0, 3.0, 1.0]
    full = MatrixModel(K0, sparse.diags_array(masses), K, n_modes=3)
    model = reduce(full, BOUNDS, 1e-4, test_points=10)
    assert error(model, full, draws(30)) <= 1e-4


def test_a_mass_may_vary_and_share_a_parameter_with_the_stiffness():
    K0, M0, K = beam()
    size = M0.shape[0]
    M = {
        "load": sparse.csc_array(([1.0], ([150], [150])), shape=(size, size)),
        "left": 0.1 * M0,
    }
    bounds = BOUNDS | {"load": (0.0, 0.5)}
    full = MatrixModel(K0, M0, K, M, n_modes=4)
    model = reduce(full, dict(reversed(bounds.items())), 1e-4, test_points=10)
    assert model.names == full.names == tuple(model.bounds)
    assert error(model, full, draws(30, bounds)) <= 1e-4


def test_crossing_modes_keep_their_order_and_their_shape_space():
    # Two equal cantilevers, independent: their frequencies cross inside the bounds.
    K0, M0, K = beam()
    k = K0 + K["left"] + K["middle"]
    empty = 0 * k
    full = MatrixModel(
        sparse.csc_array((2 * k.shape[0], 2 * k.shape[0])),
        sparse.block_diag([M0, M0]),
        {"a": sparse.block_diag([k, empty]), "b": sparse.block_diag([empty, k])},
        n_modes=5,
    )
    bounds = {"a": (0.8, 1.2), "b": (0.8, 1.2)}
    model = reduce(full, bounds, 1e-6, test_points=10)
    equal = {"a": np.array([1.0, 0.9]), "b": np.array([1.0, 0.9])}
    f = model(equal).frequencies
    np.testing.assert_allclose(f[:, 0], f[:, 1], rtol=1e-6)
    assert error(model, full, draws(20, bounds)) <= 1e-6
    assert model.shape_error < 1e-3


@pytest.mark.parametrize(
    ("name", "value"), [("left", 0.59), ("middle", 1.31), ("spring", np.nan)]
)
def test_a_parameter_outside_the_bounds_is_refused_by_name(reduced, name, value):
    parameters = draws(3)
    parameters[name][1] = value
    low, high = BOUNDS[name]
    message = rf"{name} = {value} of row 1 is outside the bounds \[{low:g}, {high:g}\]"
    with pytest.raises(ValueError, match=message):
        reduced(parameters)


def test_the_bounds_themselves_are_inside_and_a_missing_parameter_is_named(reduced):
    edge = {name: np.array(pair) for name, pair in BOUNDS.items()}
    assert np.isfinite(reduced(edge).frequencies).all()
    assert dict(reduced.bounds) == BOUNDS
    del edge["middle"]
    with pytest.raises(ValueError, match=r"no value for \['middle'\]"):
        reduced(edge)


def test_it_says_what_it_is(full, reduced):
    text = str(reduced)
    assert f"200 DOFs reduced to {reduced.size} basis vectors, 5 modes" in text
    assert f"{reduced.max_error:.1e} at 40 test points (tolerance 1e-04)" in text
    assert f"{reduced.full_solves} full solves; {reduced.speed_up:.0f} times" in text
    assert "not certified" in text
    assert reduced.names == reduced.required == full.names
    assert reduced.n_modes == 5 and reduced.full_size == 200
    assert reduced.full_solves > reduced.test_points == 40
    assert reduced.size < 60


def test_a_reduction_that_does_not_pay_is_a_warning():
    k = np.diag([1.0, 2.0, 3.0, 4.0])
    model = MatrixModel(k, np.eye(4), {"k": np.eye(4)}, n_modes=3)
    message = r"does not pay: \d basis vectors for 4 DOFs"
    with pytest.warns(UserWarning, match=message) as caught:
        ef.reduce_model(model, {"k": (1.0, 2.0)})
    assert caught[0].filename == __file__


def test_too_few_full_solves_are_an_error_with_a_remedy(full):
    message = r"tolerance was not reached: frequency error \S+ estimated.*max_solves"
    with pytest.raises(ValueError, match=message):
        ef.reduce_model(full, BOUNDS, 1e-6, test_points=4, max_solves=6)


def test_a_certificate_that_fails_is_an_error_in_the_end(full, monkeypatch):
    found = []

    def blind(self, k, m):
        found.append(len(k))
        return np.zeros((len(k), 5))  # an estimate that sees nothing

    monkeypatch.setattr(Projection, "estimate", blind)
    with pytest.raises(ValueError, match=r"not reached.*at the test points.*10 full"):
        ef.reduce_model(full, BOUNDS, 1e-6, test_points=4, max_solves=10)
    assert found


def test_an_estimate_that_is_far_too_small_is_made_up_for(full, monkeypatch):
    honest = Projection.estimate
    monkeypatch.setattr(
        Projection, "estimate", lambda self, k, m: 1e-3 * honest(self, k, m)
    )
    model = reduce(full, BOUNDS, 1e-5, test_points=10)
    assert model.full_solves >= 22  # more than one certificate
    monkeypatch.undo()
    assert error(model, full, draws(30)) <= 1e-5


def test_a_full_solve_that_misses_a_mode_is_found_out(full, monkeypatch):
    honest, calls = SparseEigenproblem.lowest, []

    def forgetful(self, k, m, count, where):
        calls.append(where)
        values, vectors = honest(self, k, m, count + 1, where)
        lost = 1 if len(calls) == 1 + 12 else count
        return np.delete(values, lost), np.delete(vectors, lost, axis=1)

    monkeypatch.setattr(SparseEigenproblem, "lowest", forgetful)
    with pytest.raises(ValueError, match=r"the full model missed a mode near .* Hz at"):
        ef.reduce_model(full, BOUNDS, 1e-2, test_points=30)


@pytest.mark.parametrize(
    ("changed", "exception", "message"),
    [
        ({"bounds": [(0, 1)]}, TypeError, r"bounds: expected \{name"),
        ({"bounds": {"left": (0.6, 1.4)}}, ValueError, "bounds: 'middle' has none"),
        ({"bounds": BOUNDS | {"x": (0, 1)}}, ValueError, r"no parameter \['x'\]"),
        ({"bounds": BOUNDS | {"left": (1, 1)}}, ValueError, r"'left'\]: .* low < high"),
        ({"bounds": BOUNDS | {"left": (1, 2, 3)}}, ValueError, r"'left'\]: expected"),
        ({"tolerance": 0}, ValueError, r"tolerance: expected 1e-9 .* to 0.1, got 0"),
        ({"test_points": 1}, ValueError, r"test_points: expected at least 2, got 1"),
        ({"max_solves": 41}, ValueError, r"max_solves: expected at least 42, got 41"),
    ],
)
def test_wrong_arguments_are_refused_by_name(full, changed, exception, message):
    with pytest.raises(exception, match=message):
        ef.reduce_model(full, **({"bounds": BOUNDS} | changed))


def test_a_model_without_parameters_is_not_reduced():
    model = MatrixModel(np.eye(3), np.eye(3), {}, n_modes=1)
    with pytest.raises(ValueError, match=r"the model has no parameters"):
        ef.reduce_model(model, {})


def test_the_posterior_is_that_of_the_full_model(full, reduced):
    sd = 0.005
    truth = {"left": 0.9, "middle": 1.1, "spring": 20.0}
    exact = full({name: np.array([value]) for name, value in truth.items()})
    measured = exact.frequencies[0] * (1 + sd * np.array([0.3, -1.1, 0.8, 0.2, -0.6]))
    prior = ef.IndependentPrior(
        {name: stats.uniform(low, high - low) for name, (low, high) in BOUNDS.items()}
    )
    term = ef.FrequencyTerm(measured, relative_sd=sd)
    small, large = (ef.LogPosterior(m, term, prior) for m in (reduced, full))
    samplers = ef.run(small, nwalkers=16, nsteps=600, seed=3)
    theta = samplers[0].get_chain(discard=200, thin=40, flat=True)
    difference = large(theta)[:, 0] - small(theta)[:, 0]
    assert difference.std() < 0.05
    weights = np.exp(difference - difference.max())
    weights /= weights.sum()
    shift = (weights @ theta - theta.mean(axis=0)) / theta.std(axis=0)
    assert np.abs(shift).max() < 0.02
