"""Malformed parameters of a model that is called, and functions that return junk."""

import numpy as np
from support.border import Target, arguments, properties
from support.kinds import (
    either,
    equal_lengths,
    floats,
    none,
    positive,
    shaped,
    unless,
    whole,
)
from test_bad_input_models import (
    ELEMENTS,
    IZ,
    MATRIX,
    NODES,
    PAIR,
    SECTION,
    SPRINGS,
    STIFF,
    reduced,
)

import emcee_femu as ef

SPRING_MODEL = ef.MassSpringModel([1.0, 2.0], SPRINGS)
FRAME = ef.FrameModel(NODES, ELEMENTS, {"bar": SECTION}, {0: "all"}, n_modes=2)
REDUCED = reduced(bounds={"k2": (3.0, 5.0)}, test_points=4, max_solves=20)
SUMS = ef.FunctionModel(lambda p: [p.get("k1", 1.0), p.get("k2", 1.0)])
TARGETS = {
    "FunctionModel": Target(
        ef.FunctionModel,
        arguments(
            function=(lambda p: PAIR, callable), n_modes=(2, either(none, whole(1)))
        ),
        probe=lambda model: model.n_modes,
        examples=40,
    ),
    "FunctionModel of a bad function": Target(
        lambda result: ef.FunctionModel(lambda p: result, n_modes=2)({"k1": PAIR}),
        arguments(result=(np.array([3.0, 4.0]), shaped((2,)))),
        alias={"result": "function"},
        examples=40,
    ),
    "FunctionModel of bad shapes": Target(
        lambda result: ef.FunctionModel(lambda p: ef.ModalSolution(PAIR, result))({}),
        arguments(result=(np.ones((3, 2)), either(none, unless(floats((None, 2)))))),
        alias={"result": "function"},
        examples=40,
    ),
    "MassSpringModel called": Target(
        lambda parameters: SPRING_MODEL(parameters).frequencies,
        arguments(parameters=({"k1": PAIR, "k2": PAIR + 1}, positive("k1", "k2"))),
        words=("mode",),
        alias={"parameters": "parameters|k1"},
        examples=40,
    ),
    "FrameModel called": Target(
        lambda parameters: FRAME(parameters).frequencies,
        arguments(parameters=(IZ, positive("Iz"))),
        words=("mode", "the"),
        alias={"parameters": "parameters|Iz"},
        examples=40,
    ),
    "MatrixModel called": Target(
        lambda parameters: MATRIX(parameters).frequencies,
        arguments(parameters=(STIFF, equal_lengths)),
        words=("mode",),
        alias={"parameters": "parameters|k2"},
        examples=40,
    ),
    "ReducedModel called": Target(
        lambda parameters: REDUCED(parameters).frequencies,
        arguments(parameters=(STIFF, equal_lengths)),
        alias={"parameters": "parameters|k2"},
        examples=40,
    ),
    "FunctionModel called": Target(
        lambda parameters: SUMS(parameters).frequencies,
        arguments(parameters=({"k1": PAIR, "k2": PAIR + 1}, equal_lengths)),
        examples=40,
    ),
}
test_a_malformed_argument = properties(TARGETS)
