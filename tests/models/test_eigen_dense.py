"""Derivatives of frequencies and shapes, of every modal model and of pairs."""

import pickle
from functools import cache

import numpy as np
import pytest
from scipy import sparse
from support.beams import BOUNDS, OPTIONS, draws, reduce, three_parts
from support.derivatives import assert_jacobian

import emcee_femu as ef
from emcee_femu.models.eigen_dense import BLURRED, find_ill_scaled

SIZE = 9


def spd(rng):
    root = rng.normal(size=(SIZE, SIZE))
    return root @ root.T + SIZE * np.eye(SIZE)


def draw(names, n=4, seed=5):
    rng = np.random.default_rng(seed)
    return {name: rng.uniform(0.5, 2.0, n) for name in names}


def chain(n, first=True):
    """The unit matrices of the springs of a chain that stands on the ground."""
    ends = np.eye(n) - np.eye(n, k=-1)
    return {f"k{i + 1}": np.outer(ends[i], ends[i]) for i in range(not first, n)}


def masses(n):
    return {f"m{i + 1}": np.diag(np.eye(n)[i]) for i in range(n)}


FREE = [*chain(7, first=False), *masses(7)]


def mass_spring():
    springs = {
        "k1": (0, 1, 1.0), "k2": (1, 2, 0.5), "k3": (2, 3, 0.7), "k4": (3, 4, 0.3),
        "k5": (1, 4, "k2"),
    }  # fmt: skip
    return ef.MassSpringModel([1.0, 2.0, 3.0, 1.5], springs, shapes=[2, 0])


def frame(supports, skip=0):
    twist = 50.0 if skip else "GJ"
    column = ef.Section(
        E="E", GJ=twist, rho="rho", A="A", Iy="I", Iz="I", orientation=(0, 1, 0.3)
    )
    beams = ef.Section(
        E="E", GJ=700.0, rho=2700.0, A="A2", Iy=2e-9, Iz="Iz", orientation=(1, 0, 0.3)
    )
    points = [(0, 0, 0), (0, 0, 0.2), (0.3, 0, 0.2), (0.3, 0.2, 0), (0.5, 0.1, 0.2)]
    elements = [(0, 1, "column"), (1, 2, "beam"), (2, 3, "column"), (2, 4, "beam")]
    return ef.FrameModel(
        points, elements, {"column": column, "beam": beams}, supports,
        modes=[1, 2, 4, 5], skip=skip, shapes=["1:ux", "2:uy", "4:uz", "4:rx"],
    )  # fmt: skip


def frame_parameters(free=False, n=3):
    middle = {"E": 7e10, "GJ": 50.0, "rho": 2700.0, "A": 3e-4, "I": 3e-9}
    middle |= {"A2": 3e-4, "Iz": 3e-9}
    if free:  # their lowest modes twist nothing
        del middle["GJ"]
    rng = np.random.default_rng(7)
    return {name: v * rng.uniform(0.8, 1.2, n) for name, v in middle.items()}


def dense(K_names, M_names, **options):
    rng = np.random.default_rng(6)
    K, M = ({name: spd(rng) for name in names} for names in (K_names, M_names))
    options = {"n_modes": 4, "shapes": [1, 5]} | options
    return ef.MatrixModel(30 * spd(rng), spd(rng), K, M, **options)


def free_chain(kind):
    n = 7
    K, M = (
        {name: kind(unit) for name, unit in units.items()}
        for units in (chain(n, first=False), masses(n))
    )
    K0, M0 = kind(np.zeros((n, n))), kind(0.5 * np.eye(n))
    return ef.MatrixModel(K0, M0, K, M, n_modes=4, skip=1, shapes=True)


def loaded_beam(lumped, free=False):
    K0, M0, K = three_parts(free, lumped)
    load = sparse.csc_array(([1.0], ([100], [100])), shape=K0.shape)
    return ef.MatrixModel(K0, M0, K, {"load": load}, skip=2 * free, **OPTIONS)


def beam_parameters(free=False):
    own = {k: pair for k, pair in BOUNDS.items() if not (free and k == "spring")}
    return draws(2, own | {"load": (0.05, 0.2)})


@cache
def reduced_beam():
    return reduce(ef.MatrixModel(*three_parts(), **OPTIONS), BOUNDS)


CASES = {
    "mass-spring": (mass_spring, lambda: draw(("k1", "k2", "k4"))),
    "dense K": (lambda: dense("ab", ""), lambda: draw("ab")),
    "dense K and M": (lambda: dense("abc", "bd"), lambda: draw("abcd")),
    "all modes": (
        lambda: dense("ab", "bc", n_modes=SIZE, shapes=True),
        lambda: draw("abc"),
    ),
    "dense, skip": (lambda: free_chain(np.asarray), lambda: draw(FREE)),
    "sparse": (lambda: loaded_beam(False), beam_parameters),
    "sparse, massless": (lambda: loaded_beam(True), beam_parameters),
    "sparse, free": (lambda: loaded_beam(True, True), lambda: beam_parameters(True)),
    "frame": (lambda: frame({0: "all", 3: "all"}), frame_parameters),
    "free frame": (lambda: frame(None, 6), lambda: frame_parameters(True)),
    "reduced": (reduced_beam, lambda: draws(3)),
}


@pytest.mark.parametrize("case", CASES)
def test_derivatives_are_those_of_differences(case):
    model, parameters = (make() for make in CASES[case])
    slender = isinstance(model, ef.FrameModel) or "left" in parameters
    step = 6e-3 if slender else 1e-3  # slender beams round more
    assert_jacobian(model, parameters, step)


def twins(kind, n_modes, tied, size=30):
    """Two equal chains side by side: all their modes are double."""
    one, zero = sum(chain(size).values()), np.zeros((size, size))
    left, right = (
        np.block([[a * one, zero], [zero, b * one]]) for a, b in ((1, 0), (0, 1))
    )
    K = {"k": kind(left + right)} if tied else {"a": kind(left), "b": kind(right)}
    M0, M = kind(np.eye(2 * size)), {"m": kind(np.eye(2 * size))}
    nothing = kind(np.zeros((2 * size, 2 * size)))
    return ef.MatrixModel(nothing, 0.5 * M0, K, M, n_modes=n_modes, shapes=True)


@pytest.mark.parametrize("kind", [np.asarray, sparse.csc_array])
def test_modes_that_coincide_and_stay_together_have_derivatives(kind):
    p = {"k": np.array([3.0, 5.0]), "m": np.array([0.5, 0.7])}
    response, derivatives = twins(kind, 4, tied=True).jacobian(p)
    f = response.frequency
    np.testing.assert_allclose(f[:, ::2], f[:, 1::2], rtol=1e-9)
    by_k, by_m = (derivatives["frequency"][name] for name in "km")
    np.testing.assert_allclose(by_k, f / (2 * p["k"])[:, None], rtol=1e-7)
    total = 0.5 + p["m"][:, None]
    np.testing.assert_allclose(by_m, -f / (2 * total), rtol=1e-7)
    # Nothing turns: stiffness leaves the shapes, mass scales them.
    np.testing.assert_allclose(derivatives["shapes"]["k"], 0.0, atol=1e-7)
    expected = -response.shapes / (2 * total[..., None])
    np.testing.assert_allclose(derivatives["shapes"]["m"], expected, atol=1e-7)


@pytest.mark.parametrize("n_modes", [1, 2])
@pytest.mark.parametrize("kind", [np.asarray, sparse.csc_array])
def test_modes_that_coincide_and_part_are_named(kind, n_modes):
    model = twins(kind, n_modes, tied=False)
    p = {"a": np.array([3.0, 5.0]), "b": np.array([4.0, 5.0]), "m": np.ones(2)}
    message = r"modes 1 and 2 coincide \(0.0\d+ Hz\) at \{'a': 5.0, .* as 'a' changes"
    if n_modes == 1 and kind is not np.asarray:
        message = r"mode 1 coincides with one above it, .* at \{'a': 5.0.*n_modes=2"
    with pytest.raises(ValueError, match=message):
        model.jacobian(p)
    near = p | {"b": p["b"] * (1 + 1e-6)}  # the remedy
    response, derivatives = model.jacobian(near)
    np.testing.assert_allclose(derivatives["shapes"]["a"], 0.0, atol=1e-3)
    first = response.frequency[1, 0] / (2 * 5.0)
    np.testing.assert_allclose(derivatives["frequency"]["a"][1, 0], first, rtol=1e-6)


EIGHT, SENSORS = 8, [6, 0, 3, 5, 2]
GAPS = {"apart": 0.2, "fading": 0.016, "together": 0.004}
# Rounding, 1e-16, is divided by the gaps between three modes and the steps.
CLOSE = {"alike": True, "tolerance": 1e-5, "alone_to": 1e-5}


def oscillators(gap, width):
    """Nearly equal oscillators, ``width`` of them a ``gap`` apart, weakly coupled."""
    rng = np.random.default_rng(3)
    basis = np.linalg.qr(rng.normal(size=(EIGHT, EIGHT)))[0]
    f = np.cumprod(np.r_[1.0, np.full(width - 1, 1 + gap), np.full(EIGHT - width, 1.4)])
    shapes = basis * f
    K = {name: np.outer(shapes[:, i], shapes[:, i]) for i, name in enumerate("abcd")}
    link = basis[:, 1] + basis[:, 2] - basis[:, 4] + 0.3 * basis[:, 5]
    K["link"] = 2e-3 * np.outer(link, link)
    M = {"m": 0.05 * np.diag(rng.uniform(0.9, 1.1, EIGHT))}
    K0 = shapes[:, 4:] @ shapes[:, 4:].T
    return ef.MatrixModel(K0, np.eye(EIGHT), K, M, n_modes=6, shapes=range(EIGHT))


def double():
    """A structure that is there twice: all its modes are double."""
    rng = np.random.default_rng(4)
    K, M = (
        {
            name: np.kron(root @ root.T, np.eye(2))
            for name, root in zip(names, rng.normal(size=(2, 4, 4)), strict=True)
        }
        for names in ("ab", "cd")
    )
    eye = np.eye(EIGHT)
    return ef.MatrixModel(eye, 9 * eye, K, M, n_modes=6, shapes=range(EIGHT))


def paired(model, **options):
    rng = np.random.default_rng(8)
    start = {name: np.array([1 + 1e-3 * i]) for i, name in enumerate(model.names)}
    shapes = model(start).shapes[0][SENSORS]
    mixed = shapes[:, [2, 0, 1]] + 0.2 * rng.normal(size=(5, 3))
    test = ef.Measurements([1.0, 1.1, 1.3], shapes=-3.0 * mixed, dofs=SENSORS)
    return ef.PairedModel(model, test, candidates=6, **options)


def near_one(model, n=4, spread=5e-4, seed=9):
    rng = np.random.default_rng(seed)
    return {name: 1 + spread * rng.uniform(-1, 1, n) for name in model.names}


def coupled(model, parameters):
    f = model.model(parameters).frequencies
    return np.diff(f) / f[:, :-1] < model.min_gap


@pytest.mark.parametrize("width", [2, 3])
@pytest.mark.parametrize("gap", list(GAPS))
def test_derivatives_of_paired_modes_are_those_of_differences(gap, width):
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
    model = paired(double())
    parameters = near_one(model)
    assert coupled(model, parameters)[:, ::2].all()
    assert_jacobian(model, parameters, step=1e-3, **CLOSE)


def test_only_a_model_with_derivatives_passes_them_on():
    with_them = paired(oscillators(GAPS["apart"], 2))
    copy = pickle.loads(pickle.dumps(with_them))
    one, other = (m.jacobian(near_one(m))[1]["mac"]["a"] for m in (with_them, copy))
    np.testing.assert_array_equal(one, other)
    function = ef.FunctionModel(lambda p: [1.0], variables=with_them.model.variables)
    assert ef.PairedModel(function, with_them.measurements).jacobian is None


@pytest.mark.parametrize("size", [1e-30, 1.0, 1e30])
def test_a_stiffness_is_large_beside_the_usual_one_if_there_is_one(size):
    """A mechanism is none of rounding, and the dense solver sees it best."""
    stiffness = [[1, 1, 1e13], [1, 2, 3], [0, 0, 1], [0, 0, 0], [-1, -1, 1]]
    stiffness, mass = size * np.array(stiffness), np.full((5, 3), 2.0)
    large = find_ill_scaled(stiffness, mass)
    assert large.tolist() == [True, False, False, False, False]
    assert not find_ill_scaled(stiffness[:1], stiffness[:1]).any()


def test_a_row_at_the_limit_of_large_stiffnesses_is_judged_as_if_alone():
    stiffness, mass = np.array([[1.0, 1.0, BLURRED], [1.0, 1.0, 1e36]]), np.ones((2, 3))
    alone = [find_ill_scaled(row[None], mass[:1]).item() for row in stiffness]
    assert find_ill_scaled(stiffness, mass).tolist() == alone
