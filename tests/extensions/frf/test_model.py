"""FRFs of modal models, against closed forms and direct solutions."""

import numpy as np
import pytest
from scipy.sparse import csc_array
from support.derivatives import differences

import emcee_femu as ef

LINES = np.linspace(0.4, 12.0, 40)
W = 2 * np.pi * LINES
CHANNELS = [(0, 2), (2, 2), (1, 0)]
KINDS = {"receptance": 0, "mobility": 1, "accelerance": 2}
RNG = np.random.default_rng(5)


def one_mass(**options):
    model = ef.MatrixModel(
        np.zeros((1, 1)), 2 * np.eye(1), {"k": np.eye(1)}, n_modes=1, shapes=True
    )
    return ef.frf.FRFModel(model, LINES, [(0, 0)], damping="zeta", **options)


def test_damping_in_percent_is_doubted_where_the_model_is_made():
    with pytest.warns(UserWarning, match=r"damping: .*damping=0\.01") as caught:
        ef.frf.FRFModel(chain(), LINES, CHANNELS, damping=[1.5, "zeta", 2.0])
    assert [warning.filename for warning in caught] == [__file__]


@pytest.mark.parametrize("kind", KINDS)
def test_one_degree_of_freedom(kind):
    k, zeta = np.array([800.0, 1500.0]), np.array([0.01, 0.2])
    found = one_mass(kind=kind)({"k": k, "zeta": zeta})[kind]
    c = 2 * zeta * np.sqrt(2 * k)
    exact = (1j * W) ** KINDS[kind] / (k[:, None] - 2 * W**2 + 1j * c[:, None] * W)
    np.testing.assert_allclose(found[:, 0, :, 0], exact.real, rtol=1e-9)
    np.testing.assert_allclose(found[:, 0, :, 1], exact.imag, rtol=1e-9)


def chain(kind=np.array, n_modes=3):
    """Return three masses on a chain of springs k1, k2, k3."""
    ends = np.eye(3) - np.eye(3, k=1)
    K = {f"k{i}": kind(np.outer(e, e)) for i, e in enumerate(ends.T, 1)}
    M = kind(np.diag([2.0, 1.5, 1.0]))
    return ef.MatrixModel(kind(np.zeros((3, 3))), M, K, n_modes=n_modes, shapes=True)


THETA = RNG.uniform(300, 900, (4, 3))
RAYLEIGH = {"mass": 0.8, "stiffness": 4e-4}


def named(theta):
    return {f"k{i}": column for i, column in enumerate(theta.T[:3], 1)}


def direct(theta, a, b):
    """Return the receptances ``(n, channels, lines)``, each line solved."""
    model, found = chain(), []
    for row in theta:
        K = sum(k * unit for k, unit in zip(row, model.K.values(), strict=True))
        C = a * model.M0 + b * K
        H = [np.linalg.inv(K - w * w * model.M0 + 1j * w * C) for w in W]
        found.append([[h[r, s] for h in H] for r, s in CHANNELS])
    return np.array(found)


def parts(H):
    return np.stack([H.real, H.imag], axis=-1)


@pytest.mark.parametrize("kind", [np.array, csc_array])
def test_proportional_damping_against_direct_solutions(kind):
    model = ef.frf.FRFModel(chain(kind), LINES, CHANNELS, damping=RAYLEIGH)
    found = model(named(THETA))["receptance"]
    exact = parts(direct(THETA, 0.8, 4e-4))
    np.testing.assert_allclose(found, exact, rtol=1e-6, atol=1e-9)


def test_the_residual_of_modes_that_were_left_out():
    low = LINES < 2.5  # well below the third mode
    exact = parts(direct(THETA, 0.0, 0.0))[:, :, low]
    errors = {}
    for residual in (True, False):
        model = ef.frf.FRFModel(
            chain(n_modes=2), LINES[low], CHANNELS, damping=0.0, residual=residual
        )
        error = model(named(THETA))["receptance"] - exact
        errors[residual] = np.abs(error).max()
    w3 = 2 * np.pi * chain()(named(THETA)).frequencies[:, 2].min()
    # The dynamic part of the rest: (w / w3)^2 of what it is statically.
    bound = 1.5 * (2 * np.pi * 2.5 / w3) ** 2 / (1 - (2 * np.pi * 2.5 / w3) ** 2)
    assert errors[True] < bound * errors[False]


DAMPINGS = {
    "one": ("zeta", {"zeta": 0.02}),
    "each": (["z1", 0.02], {"z1": 0.03}),
    "proportional": ({"mass": "a", "stiffness": "b"}, {"a": 0.7, "b": 5e-4}),
}


@pytest.mark.parametrize("residual", [True, False])
@pytest.mark.parametrize("damping", DAMPINGS)
def test_derivatives(damping, residual):
    given, values = DAMPINGS[damping]
    options = {"damping": given, "kind": "accelerance", "residual": residual}
    model = ef.frf.FRFModel(chain(n_modes=2), LINES, CHANNELS, **options)
    own = {name: np.full(4, value) for name, value in values.items()}
    parameters = named(THETA) | own
    response, slopes = model.jacobian(parameters)
    called = model(parameters)
    for key, value in response.items():
        np.testing.assert_array_equal(value, called[key])
    for name in parameters:
        expected = differences(model, parameters, name, "accelerance", 1e-4)
        found, scale = slopes["accelerance"][name], np.abs(expected).max()
        np.testing.assert_allclose(found / scale, expected / scale, atol=1e-6)


def test_parameters_are_those_of_the_model_and_of_the_damping():
    springs = {"k1": (0, 1, 10.0)}  # whose default makes k1 no parameter that is needed
    model = ef.MassSpringModel([1.0], springs, shapes=True)
    frf = ef.frf.FRFModel(model, LINES, [(0, 0)], damping="zeta")
    assert (frf.names, one_mass().names) == (("zeta",), ("k", "zeta"))
