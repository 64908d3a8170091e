"""Matrices that functions of the parameters multiply, against direct solutions."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import sparse
from support.derivatives import assert_jacobian

import emcee_femu as ef

N, SIDES = 12, ("E", "t", "rho")
RNG = np.random.default_rng(5)
BENDING = np.diag(np.full(N, 6.0)) - 4.0 * (np.eye(N, k=1) + np.eye(N, k=-1))
BENDING += np.eye(N, k=2) + np.eye(N, k=-2)
MEMBRANE = np.diag(RNG.uniform(0.1, 0.3, N))
SUPPORT, MASS = np.diag(np.arange(N) == 0).astype(float), np.diag(np.ones(N))
AT = {"E": [2.0, 1.3], "t": [0.8, 1.2], "rho": [1.1, 0.7], "k": [0.5, 2.0]}


def arrays(values):
    return {name: np.array(value) for name, value in values.items()}


def bending(E, t):
    return E * t**3


def plate(kind=np.array, **given):
    """Return a strip whose thickness is in stiffness and mass."""
    K = {
        "bending": (kind(BENDING), bending),
        "membrane": (kind(MEMBRANE), lambda t, E: E * t),
        "k": kind(SUPPORT),
    }
    M = {"mass": (kind(MASS), lambda rho, t: rho * t)}
    zero = kind(np.zeros((N, N)))
    return ef.MatrixModel(zero, zero, K, M, n_modes=3, **given)


def solve_directly(E, t, rho, k):
    K = E * t**3 * BENDING + E * t * MEMBRANE + k * SUPPORT
    return ef.MatrixModel(K, rho * t * MASS, {}, n_modes=3, shapes=True)({})


KINDS = pytest.mark.parametrize("kind", [np.array, sparse.csc_array])


@KINDS
def test_functions_of_parameters_multiply_matrices(kind):
    model = plate(kind, shapes=True)
    assert model.names == ("E", "t", "k", "rho")
    solution = model(AT)
    for i, values in enumerate(zip(*AT.values(), strict=True)):
        exact = solve_directly(*values)
        assert_allclose(solution.frequencies[i], exact.frequencies[0], rtol=1e-9)
        mac = np.abs(np.diagonal(solution.shapes[i].T @ exact.shapes[0]))
        own = (exact.shapes[0] ** 2).sum(axis=0)
        assert_allclose(mac, own, rtol=1e-6)
    assert_jacobian(plate(kind, shapes=[2, 7]), arrays(AT))


def test_slopes_of_polynomials_up_to_degree_four_are_exact():
    powers = {str(p): (MASS, lambda x, p=p: x**p) for p in (1, 2, 3, 4)}
    model = ef.MatrixModel(MASS, MASS, powers, n_modes=1)
    x = np.array([-2.0, 0.0, 3e-7, 1e9])
    (slopes, _) = model.coefficients.slopes({"x": x})["x"]
    exact = np.array([p * x ** (p - 1) for p in (1, 2, 3, 4)]).T
    assert_allclose(slopes, exact, rtol=1e-11, atol=1e-11)


def test_static_models_take_them():
    K = {"bending": (BENDING, bending), "k": SUPPORT}
    static = ef.StaticModel(0 * MASS, {"tip": {N - 1: 1.0}}, K)
    at = {name: np.array(AT[name]) for name in ("E", "t", "k")}
    stiffness = [
        bending(E, t) * BENDING + k * SUPPORT
        for E, t, k in zip(*at.values(), strict=True)
    ]
    exact = np.linalg.inv(stiffness)[:, :, -1]
    assert_allclose(static(at)["displacement"][:, 0], exact, rtol=1e-8)
    assert_jacobian(static, at)


def test_the_flexibility_of_frfs_takes_them():
    options = {"damping": 0.01, "residual": True}
    named = plate(shapes={"left": 2, "right": 5})
    frf = ef.frf.FRFModel(named, [0.01, 0.02], [("left", "right")], **options)
    first = {name: value[:1] for name, value in AT.items()}
    E, t, rho, k = (value[0] for value in AT.values())
    K = E * t**3 * BENDING + E * t * MEMBRANE + k * SUPPORT
    summed = ef.MatrixModel(K, rho * t * MASS, {}, n_modes=3, shapes=True)
    whole = ef.frf.FRFModel(summed, [0.01, 0.02], [(2, 5)], **options)
    H = frf(arrays(first))["receptance"]
    assert_allclose(H, whole({})["receptance"], rtol=1e-8)


@pytest.mark.parametrize(
    ("unit", "message"),
    [
        ((MASS, np.sqrt), r"K\['a'\]: .*arguments are parameters"),
        ((MASS, lambda: 1.0), "arguments are parameters"),
        ((MASS, lambda *x: 1.0), "arguments are parameters"),
        ((MASS, bending, 1.0), r"expected \(matrix, function\), got"),
        ((MASS, lambda t: 1.0), r"function of 'a': .*\(2,\).*got \(\)"),
        ((MASS, lambda t: np.log(t - 1.0)), r"got -?(nan|inf) at \{'t': 0\.8"),
        ((MASS, lambda t: t + 1j), "function of 'a': expected real numbers"),
    ],
)
@pytest.mark.filterwarnings("ignore:(invalid|divide)")  # which is what is tested
def test_functions_of_other_forms_are_refused(unit, message):
    with pytest.raises((ValueError, TypeError), match=message):
        ef.MatrixModel(MASS, MASS, {"a": unit}, n_modes=1)({"t": np.array([0.8, 1.2])})
