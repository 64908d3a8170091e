"""Malformed sections, frames, springs, matrices, functions and parameters."""

import warnings
from collections import defaultdict

import numpy as np
from border import Target, arguments, properties
from kinds import either, flag, floats, none, numbers, text, unless, unsaid, whole
from scipy.linalg import eigh
from scipy.sparse import csc_array, issparse

import emcee_femu as ef
from emcee_femu.models.section import KINDS

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
    return either(text, floats((), above=0.0))


def direction(value):
    found = floats((3,))(value)
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
        return None
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


SPRING_MODEL = ef.MassSpringModel([1.0, 2.0], SPRINGS)
FRAME = ef.FrameModel(NODES, ELEMENTS, {"bar": SECTION}, {0: "all"}, n_modes=2)
MATRIX = ef.MatrixModel(K0, M0, {"k2": K2}, n_modes=1)
SUMS = ef.FunctionModel(lambda p: [p.get("k1", 1.0), p.get("k2", 1.0)])


def pending(value):
    """Not yet refused by name: whatever is no mapping."""
    return not isinstance(value, dict)


def reduced(**given):
    with warnings.catch_warnings():  # of two DOFs no reduction pays
        warnings.filterwarnings("ignore", "the reduction does not pay", UserWarning)
        return MATRIX.reduced(**given)


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
            nodes=(NODES, unless(floats((3, 3)))),
            elements=(ELEMENTS, unsaid),
            sections=({"bar": SECTION}, unsaid),
            supports=({0: "all", 2: ["uz", "uy"]}, unsaid),
            modes=((1, 3), unsaid),
            skip=(0, unless(whole(0))),
            shapes=(False, flag),
        ),
        probe=lambda model: model(IZ),
        late=(*LATE, "parameters"),
        tied=("nodes", "elements", "sections"),
        words=("n_modes",),
        examples=80,
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
            masses=(np.array([1.0, 2.0]), floats((2,), above=0.0, huge=1e5)),
            springs=(SPRINGS, unsaid),
            shapes=(False, flag),
        ),
        probe=spring_frequencies,
        truth=springs_by_hand,
        late=LATE,
        tied=("masses", "springs"),
        examples=120,
    ),
    "MatrixModel": Target(
        ef.MatrixModel,
        arguments(
            K0=(K0, symmetric),
            M0=(M0, positive_definite),
            K=({"k2": K2}, unsaid),
            n_modes=(2, whole(1, 2)),
            skip=(0, unless(whole(0, 1))),
            shapes=(False, either(flag, unsaid), lambda v: v is np.ma.masked),
        ),
        probe=matrix_frequencies,
        truth=matrices_by_hand,
        late=(*LATE, "parameters"),
        tied=("K0", "M0", "K", "n_modes", "skip"),
        examples=120,
    ),
    "MatrixModel of a mass": Target(
        ef.MatrixModel,
        arguments(M=({"m": 0.1 * M0}, unsaid, pending)),
        fixed={"K0": K0 + K2, "M0": M0, "K": {}, "n_modes": 1},
        probe=lambda model: model({name: PAIR for name in model.names}),
        late=LATE,
        words=("K",),
        examples=120,
    ),
    "MatrixModel.reduced": Target(
        reduced,
        arguments(
            bounds=({"k2": (3.0, 5.0)}, unsaid),
            tolerance=(1e-4, unless(floats((), above=0.0))),
            test_points=(4, unless(whole(1))),
            max_solves=(20, unless(whole(1))),
            seed=(0, whole(0)),
        ),
        probe=matrix_frequencies,
        late=(*LATE, "parameters"),
        tied=("test_points", "max_solves"),
        examples=6,
    ),
    "FunctionModel": Target(
        ef.FunctionModel,
        arguments(
            function=(lambda p: PAIR, callable), n_modes=(2, either(none, whole(1)))
        ),
        probe=lambda model: model.n_modes,
        examples=100,
    ),
    "FunctionModel of a bad function": Target(
        lambda result: ef.FunctionModel(lambda p: result, n_modes=2)({"k1": PAIR}),
        arguments(result=(np.array([3.0, 4.0]), unsaid)),
        alias={"result": "function"},
        examples=120,
    ),
    "FunctionModel of bad shapes": Target(
        lambda result: ef.FunctionModel(lambda p: ef.ModalSolution(PAIR, result))({}),
        arguments(result=(np.ones((3, 2)), either(none, unless(floats((None, 2)))))),
        alias={"result": "function"},
        examples=120,
    ),
    "MassSpringModel called": Target(
        lambda parameters: SPRING_MODEL(parameters).frequencies,
        arguments(parameters=({"k1": PAIR, "k2": PAIR + 1}, unsaid)),
        words=("mode",),
        alias={"parameters": "parameters|k1"},
        examples=150,
    ),
    "FrameModel called": Target(
        lambda parameters: FRAME(parameters).frequencies,
        arguments(parameters=(IZ, unsaid)),
        words=("mode", "the"),
        alias={"parameters": "parameters|Iz"},
        examples=100,
    ),
    "FunctionModel called": Target(
        lambda parameters: SUMS(parameters).frequencies,
        arguments(parameters=({"k1": PAIR, "k2": PAIR + 1}, unsaid)),
        examples=100,
    ),
    "MatrixModel of sparse matrices": Target(
        lambda K0, M0: ef.MatrixModel(K0, M0, {"k2": csc_array(K2)}, n_modes=1),
        arguments(K0=(csc_array(K0), unsaid), M0=(csc_array(M0), unsaid)),
        probe=matrix_frequencies,
        late=LATE,
        tied=("K0", "M0"),
        words=("K", "n_modes"),
    ),
}
test_a_malformed_argument = properties(TARGETS)
