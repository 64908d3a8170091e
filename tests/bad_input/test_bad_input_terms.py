"""Malformed likelihood terms, MAC and pairing."""

from collections import defaultdict

import numpy as np
from scipy import stats
from support.border import Target, arguments, properties
from support.kinds import (
    either,
    floats,
    moderate,
    none,
    of_complex,
    one_of,
    shaped,
    text,
    unless,
    whole,
)
from test_bad_input_data import HERTZ, SHAPES, covariance, real_shapes

import emcee_femu as ef
from emcee_femu.models import pairing

MODES = ef.ModalSolution(np.array([[3.2, 9.5]]), (SHAPES + 0.05)[None])
MEASURED = ef.Measurements(HERTZ, shapes=SHAPES, sd=[0.1, 0.2])
SOLVER = ef.FunctionModel(lambda p: MODES, n_modes=4)
ANY = defaultdict(lambda: np.array([0.1]))


def term_value(term):
    return term({}, MODES)


def gaussian_term(measured, relative_sd, name):
    r = MODES.frequencies[0] / measured - 1
    return [stats.norm.logpdf(r, 0, relative_sd).sum() - np.log(measured).sum()]


def columns(value):
    """Shapes of three sensors; of complex ones nothing is said."""
    if of_complex(value):
        return None
    return unless(floats((3, None), (None, 3, None)))(value)


TARGETS = {
    "FrequencyTerm": Target(
        ef.FrequencyTerm,
        arguments(
            measured=(HERTZ, moderate(floats((2,), above=0.0))),
            relative_sd=(
                np.array([0.01, 0.02]),
                moderate(floats((), (2,), above=0.0)),
            ),
            name=("frequency", text),
        ),
        probe=term_value,
        truth=gaussian_term,
        words=("beta",),
        tied=("measured", "relative_sd"),
        examples=40,
    ),
    **{
        f"FrequencyTerm of {which}": Target(
            ef.FrequencyTerm,
            arguments(
                **{
                    which: (
                        value,
                        either(none, moderate(unless(kind))),
                    )
                },
                discrepancy=("sigma", either(none, text)),
            ),
            fixed={"measured": HERTZ},
            probe=lambda term: term(ANY, MODES),
            examples=80,
        )
        for which, value, kind in (
            ("beta", np.array([1e4, 2e4]), floats((), (2,), above=0.0)),
            ("sd", np.array([0.1, 0.2]), floats((), (2,), above=0.0)),
            ("covariance", np.array([[0.1, -0.02], [-0.02, 0.3]]), covariance),
        )
    },
    "FrequencyTerm of two descriptions": Target(
        ef.FrequencyTerm,
        arguments(sd=(None, none)),
        fixed={"measured": HERTZ, "relative_sd": 0.1},
        probe=term_value,
        words=("beta",),
    ),
    "ShapeTerm of sd": Target(
        ef.ShapeTerm,
        arguments(
            sd=(
                0.1 * SHAPES**2,
                moderate(unless(floats((), (2,), (1, 2), (3, 1), (3, 2), above=0.0))),
            ),
            name=("shape", text),
        ),
        fixed={"measured": SHAPES},
        probe=term_value,
        words=("delta",),
    ),
    "ShapeTerm": Target(
        ef.ShapeTerm,
        arguments(
            measured=(
                SHAPES,
                either(real_shapes(3, 2), unless(real_shapes(None, None))),
            ),
            delta=(
                np.array([0.1, 0.2]),
                either(moderate(floats((), (2,), (1,), above=0.0)), text),
            ),
        ),
        probe=lambda term: term(ANY, MODES),
        tied=("measured", "delta"),
        late=("dofs", "measured"),
    ),
    "mac": Target(
        pairing.mac,
        arguments(a=(SHAPES, columns), b=(SHAPES + 0.1, columns)),
        examples=40,
    ),
    "PairedModel of a bad model": Target(
        lambda result: ef.PairedModel(lambda p: result, MEASURED, candidates=2)({}),
        arguments(result=(MODES, unless(one_of(ef.ModalSolution)))),
        alias={"result": "model"},
        examples=40,
    ),
    "PairedModel of bad shapes": Target(
        lambda frequencies, shapes: ef.PairedModel(
            lambda p: ef.ModalSolution(frequencies, shapes), MEASURED, candidates=2
        )({}),
        arguments(
            frequencies=(MODES.frequencies, shaped((1, 2))),
            shapes=(MODES.shapes, unless(floats((1, 3, 2)))),
        ),
        alias={"frequencies": "model", "shapes": "model|dofs"},
        words=("dofs",),
        examples=60,
    ),
    "PairedModel": Target(
        ef.PairedModel,
        arguments(
            model=(SOLVER, callable),
            measurements=(MEASURED, one_of(ef.Measurements)),
            candidates=(3, either(none, whole(2, 4))),
            min_mac=(0.5, floats((), low=0.0, high=1.0)),
            min_gap=(0.02, floats((), low=0.0)),
        ),
        probe=lambda model: vars(model),
    ),
}
test_a_malformed_argument = properties(TARGETS)
