"""Derivatives of paired modes, alone and where close modes share their space."""

import pickle

import numpy as np
import pytest
from support.derivatives import assert_jacobian

from emcee_femu import FunctionModel, MatrixModel, Measurements, PairedModel

SIZE, SENSORS = 8, [6, 0, 3, 5, 2]
GAPS = {"apart": 0.2, "fading": 0.016, "together": 0.004}
# Rounding, 1e-16, is divided by the gaps between three modes and the steps.
CLOSE = {"alike": True, "tolerance": 1e-5, "alone_to": 1e-5}


def oscillators(gap, width):
    """Nearly equal oscillators, ``width`` of them a ``gap`` apart, weakly coupled."""
    rng = np.random.default_rng(3)
    basis = np.linalg.qr(rng.normal(size=(SIZE, SIZE)))[0]
    f = np.cumprod(np.r_[1.0, np.full(width - 1, 1 + gap), np.full(SIZE - width, 1.4)])
    shapes = basis * f
    K = {name: np.outer(shapes[:, i], shapes[:, i]) for i, name in enumerate("abcd")}
    link = basis[:, 1] + basis[:, 2] - basis[:, 4] + 0.3 * basis[:, 5]
    K["link"] = 2e-3 * np.outer(link, link)
    M = {"m": 0.05 * np.diag(rng.uniform(0.9, 1.1, SIZE))}
    K0 = shapes[:, 4:] @ shapes[:, 4:].T
    return MatrixModel(K0, np.eye(SIZE), K, M, n_modes=6, shapes=range(SIZE))


def twins():
    """A structure that is there twice: all its modes are double."""
    rng = np.random.default_rng(4)
    K, M = (
        {
            name: np.kron(root @ root.T, np.eye(2))
            for name, root in zip(names, rng.normal(size=(2, 4, 4)), strict=True)
        }
        for names in ("ab", "cd")
    )
    eye = np.eye(SIZE)
    return MatrixModel(eye, 9 * eye, K, M, n_modes=6, shapes=range(SIZE))


def paired(model, **options):
    rng = np.random.default_rng(8)
    start = {name: np.array([1 + 1e-3 * i]) for i, name in enumerate(model.names)}
    shapes = model(start).shapes[0][SENSORS]
    mixed = shapes[:, [2, 0, 1]] + 0.2 * rng.normal(size=(5, 3))
    test = Measurements([1.0, 1.1, 1.3], shapes=-3.0 * mixed, dofs=SENSORS)
    return PairedModel(model, test, candidates=6, **options)


def near_one(model, n=4, spread=5e-4, seed=9):
    rng = np.random.default_rng(seed)
    return {name: 1 + spread * rng.uniform(-1, 1, n) for name in model.names}


def coupled(model, parameters):
    f = model.model(parameters).frequencies
    return np.diff(f) / f[:, :-1] < model.min_gap


@pytest.mark.parametrize("width", [2, 3])
@pytest.mark.parametrize("gap", list(GAPS))
def test_derivatives_are_those_of_differences(gap, width):
    model = paired(oscillators(GAPS[gap], width))
    parameters = near_one(model)
    close = coupled(model, parameters)
    assert (close.sum(axis=1) == (0 if gap == "apart" else width - 1)).all()
    assert_jacobian(model, parameters, step=1e-5, **CLOSE)


def test_a_row_of_close_modes_beside_rows_that_are_not():
    model = paired(oscillators(GAPS["fading"], 2))
    parameters = near_one(model)
    parameters["b"][2] = 1.3
    assert coupled(model, parameters).any(axis=1).tolist() == [True, True, False, True]
    assert_jacobian(model, parameters, step=1e-5, **CLOSE)


def test_modes_that_always_coincide_share_a_space_that_has_a_derivative():
    model = paired(twins())
    parameters = near_one(model)
    assert coupled(model, parameters)[:, ::2].all()
    assert_jacobian(model, parameters, step=1e-3, **CLOSE)


def test_only_a_model_with_derivatives_passes_them_on():
    with_them = paired(oscillators(GAPS["apart"], 2))
    copy = pickle.loads(pickle.dumps(with_them))
    one, other = (m.jacobian(near_one(m))[1]["mac"]["a"] for m in (with_them, copy))
    np.testing.assert_array_equal(one, other)
    function = FunctionModel(lambda p: [1.0], variables=with_them.model.variables)
    assert PairedModel(function, with_them.measurements).jacobian is None
