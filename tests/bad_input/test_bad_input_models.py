"""Malformed sections, frames, springs and matrices."""

import warnings
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from unittest import mock

import numpy as np
from scipy.linalg import eigh
from scipy.sparse import csc_array, issparse
from support.border import Target, arguments, properties
from support.kinds import (
    ascending,
    by_name,
    either,
    flag,
    floats,
    listed,
    moderate,
    none,
    numbers,
    one_of,
    text,
    unless,
    whole,
)

import emcee_femu as ef
from emcee_femu.models.frame.section import KINDS

ANY = defaultdict(lambda: np.ones(2))
BAR = {"E": 7e10, "GJ": 700.0, "rho": 2700.0, "A": 3e-4, "Iy": 2e-9, "Iz": "Iz"}
SECTION = ef.Section(**BAR)
NODES = np.array([[0.0, 0.0, 0.0], [0.5, 0.0, 0.1], [1.0, 0.0, 0.0]])
ELEMENTS = [(0, 1, "bar"), (1, 2, "bar")]
IZ = {"Iz": np.array([1e-8, 2e-8])}
K0, M0 = np.diag([9.0, 4.0]), np.array([[2.0, 0.5], [0.5, 1.0]])
K2 = np.array([[1.0, -1.0], [-1.0, 1.0]])
STIFF = {"k2": np.array([4.0, 5.0])}
SPRINGS = {"k1": (0, 1, 10.0), "k2": (1, 2, 5.0), "k3": (0, 2, "k1")}
PAIR = np.array([1.0, 2.0])
LATE = ("mode", "skip", "the mass matrix", "stiffness", "section property")


def positive_or_name():
    return either(text, moderate(floats((), above=0.0)))


def direction(value):
    found = floats((3,), low=-1e100, high=1e100)(value)
    return found and bool(np.any(numbers(value))) and found


def section_value(section):
    return [section.coefficient(kind, ANY) for kind in KINDS]


def springs_by_hand(masses, springs, shapes):
    n = len(masses)
    K = np.zeros((n + 1, n + 1))
    for first, second, k in springs.values():
        k = springs[k][2] if isinstance(k, str) else k
        K[first, first] += k
        K[second, second] += k
        K[first, second] -= k
        K[second, first] -= k
    squares = eigh(K[1:, 1:], np.diag(masses), eigvals_only=True)
    return [np.sqrt(squares) / (2 * np.pi)]


def matrices_by_hand(K0, M0, K, n_modes, skip, shapes):
    del skip, shapes
    squares = [
        eigh(K0 + k * np.asarray(K["k2"]), M0, eigvals_only=True)[:n_modes]
        for k in STIFF["k2"]
    ]
    return np.sqrt(squares) / (2 * np.pi)


def positive_definite(value):
    found = symmetric(value)
    if not found:
        return found
    lowest, highest = np.linalg.eigvalsh(numbers(value))[[0, -1]]
    return found if lowest > 1e-6 * highest else None if lowest > -1e-6 else False


def symmetric(value):
    if issparse(value):
        return sparse(value)
    found = floats((2, 2))(value)
    if not found:
        return found
    array = numbers(value)
    gap = np.abs(array - array.T).max() / np.abs(array).max(initial=1e-300)
    return None if gap == 0 else False if gap > 1e-7 else None


def spring_frequencies(model):
    return model({}).frequencies


def matrix_frequencies(model):
    return model(STIFF).frequencies


MATRIX = ef.MatrixModel(K0, M0, {"k2": K2}, n_modes=1)


two = floats((2,), above=0.0, huge=1e5)
more = unless(floats((None,), above=0.0))  # masses may be too few for the springs


def element(value):
    """Two different nodes and the section; what else can be unpacked is not judged."""
    if not isinstance(value, list | tuple):
        return None if isinstance(value, Iterable) else False
    if len(value) != 3 or not all(whole(0, 2)(node) for node in value[:2]):
        return False
    return None if value[0] != value[1] and value[2] == "bar" else False


def supports(value):
    if not isinstance(value, Mapping) or not all(whole(0, 2)(key) for key in value):
        return False
    names = {"ux", "uy", "uz", "rx", "ry", "rz"}
    for held in value.values():
        if isinstance(held, str) and held not in names | {"all"}:
            return False
        if isinstance(held, list | tuple) and not set(map(str, held)) <= names:
            return False
        if not isinstance(held, Iterable):
            return False
    return None


def spring(value):
    if not isinstance(value, Sequence) or isinstance(value, str) or len(value) != 3:
        return False
    if not all(whole(0, 2)(node) for node in value[:2]) or value[0] == value[1]:
        return False
    stiffness = value[2]
    if isinstance(stiffness, str):
        return stiffness in SPRINGS or False
    return moderate(floats((), above=0.0))(stiffness)


def sensors(value):
    if isinstance(value, np.ndarray) and value.ndim == 1:
        value = [*value]
    found = listed(whole(0, 1))(value)
    return found if found is False or len(set(value)) == len(value) else False


def interval(value):
    found = floats((2,))(value)
    return found if found is False or np.diff(numbers(value))[0] > 0 else False


def sparse(value):
    """Symmetric and finite, of the right size."""
    return unless(symmetric)(value.toarray()) if issparse(value) else False


def reduced(**given):
    with warnings.catch_warnings():  # of two DOFs no reduction pays
        warnings.filterwarnings("ignore", "the reduction does not pay", UserWarning)
        with mock.patch("emcee_femu.surrogates.ritz_greedy._seconds", return_value=1.0):
            return ef.reduce_model(MATRIX, **given)


TARGETS = {
    "Section": Target(
        ef.Section,
        arguments(
            **{name: (value, positive_or_name()) for name, value in BAR.items()},
            orientation=(np.array([0.0, 0.0, 1.0]), direction),
        ),
        probe=section_value,
    ),
    "FrameModel": Target(
        ef.FrameModel,
        arguments(
            nodes=(NODES, moderate(unless(floats((3, 3))))),
            elements=(ELEMENTS, listed(element)),
            sections=(
                {"bar": SECTION},
                by_name(one_of(ef.Section), ["bar"], every=True),
            ),
            supports=({0: "all", 2: ["uz", "uy"]}, unless(either(none, supports))),
            modes=((1, 3), ascending(10)),
            skip=(0, unless(whole(0))),
            shapes=(False, flag),
        ),
        probe=lambda model: model(IZ),
        late=(*LATE, "parameters"),
        tied=("nodes", "elements", "sections"),
        words=("n_modes",),
        examples=40,
    ),
    "FrameModel of n_modes": Target(
        ef.FrameModel,
        arguments(n_modes=(2, whole(1, 12))),
        fixed={
            "nodes": NODES,
            "elements": ELEMENTS,
            "sections": {"bar": SECTION},
            "supports": {0: "all"},
        },
        probe=lambda model: model(IZ),
        words=("modes",),
        alias={"n_modes": "n_modes|modes"},
    ),
    "MassSpringModel": Target(
        ef.MassSpringModel,
        arguments(
            masses=(np.array([1.0, 2.0]), moderate(either(two, more))),
            springs=(SPRINGS, by_name(spring)),
            shapes=(False, flag),
        ),
        probe=spring_frequencies,
        truth=springs_by_hand,
        late=LATE,
        tied=("masses", "springs"),
        examples=40,
    ),
    "MatrixModel": Target(
        ef.MatrixModel,
        arguments(
            K0=(K0, symmetric),
            M0=(M0, positive_definite),
            K=({"k2": K2}, by_name(symmetric)),
            n_modes=(2, whole(1, 2)),
            skip=(0, unless(whole(0, 1))),
            shapes=(False, either(flag, sensors)),
        ),
        probe=matrix_frequencies,
        truth=matrices_by_hand,
        late=(*LATE, "parameters"),
        tied=("K0", "M0", "K", "n_modes", "skip"),
        examples=40,
    ),
    "MatrixModel of shapes": Target(
        ef.MatrixModel,
        arguments(shapes=([1, 0], either(flag, sensors))),
        fixed={"K0": K0, "M0": M0, "K": {"k2": K2}, "n_modes": 1},
        probe=lambda model: model(STIFF).shapes,
    ),
    "MatrixModel of a mass": Target(
        ef.MatrixModel,
        arguments(M=({"m": 0.1 * M0}, either(none, by_name(symmetric)))),
        fixed={"K0": K0 + K2, "M0": M0, "K": {}, "n_modes": 1},
        probe=lambda model: model({name: PAIR for name in model.names}),
        late=LATE,
        words=("K",),
        examples=40,
    ),
    "reduce_model": Target(
        reduced,
        arguments(
            bounds=({"k2": (3.0, 5.0)}, by_name(interval, ["k2"], every=True)),
            tolerance=(1e-4, unless(floats((), above=0.0))),
            test_points=(4, unless(whole(1))),
            max_solves=(20, unless(whole(1))),
            seed=(0, whole(0)),
        ),
        probe=matrix_frequencies,
        late=(*LATE, "parameters"),
        words=("mode",),
        alias={"bounds": "bounds|k2"},
        tied=("test_points", "max_solves"),
        examples=6,
    ),
    "MatrixModel of sparse matrices": Target(
        lambda K0, M0: ef.MatrixModel(K0, M0, {"k2": csc_array(K2)}, n_modes=1),
        arguments(
            K0=(csc_array(K0), sparse), M0=(csc_array(M0), either(sparse, symmetric))
        ),
        probe=matrix_frequencies,
        late=LATE,
        tied=("K0", "M0"),
        words=("K", "n_modes"),
    ),
}
test_a_malformed_argument = properties(TARGETS)
