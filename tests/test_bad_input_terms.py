"""Malformed likelihood terms, MAC and pairing."""

from collections import defaultdict

import numpy as np
from border import Target, arguments, properties
from kinds import either, floats, none, one_of, text, unless, unsaid, whole
from scipy import stats
from test_bad_input_data import HERTZ, SHAPES, shapes

import emcee_femu as ef
from emcee_femu import pairing

MODES = ef.ModalSolution(np.array([[3.2, 9.5]]), (SHAPES + 0.05)[None])
MEASURED = ef.Measurements(HERTZ, shapes=SHAPES, sd=[0.1, 0.2])
SOLVER = ef.FunctionModel(lambda p: MODES, n_modes=4)
ANY = defaultdict(lambda: np.array([0.1]))


def term_value(term):
    return term({}, MODES)


def gaussian_term(measured, relative_sd, name):
    r = MODES.frequencies[0] / measured - 1
    return [stats.norm.logpdf(r, 0, relative_sd).sum() - np.log(measured).sum()]


TARGETS = {
    "FrequencyTerm": Target(
        ef.FrequencyTerm,
        arguments(
            measured=(HERTZ, floats((2,), above=0.0)),
            relative_sd=(
                np.array([0.01, 0.02]),
                floats((), (2,), above=0.0),
            ),
            name=("frequency", text),
        ),
        probe=term_value,
        truth=gaussian_term,
        words=("beta",),
        tied=("measured", "relative_sd"),
        examples=120,
    ),
    **{
        f"FrequencyTerm of {which}": Target(
            ef.FrequencyTerm,
            arguments(
                **{
                    which: (
                        value,
                        either(none, unless(floats((), (2,), (2, 2), above=least))),
                    )
                },
                discrepancy=("sigma", either(none, text)),
            ),
            fixed={"measured": HERTZ},
            probe=lambda term: term(ANY, MODES),
            examples=80,
        )
        for which, value, least in (
            ("beta", np.array([1e4, 2e4]), 0.0),
            ("sd", np.array([0.1, 0.2]), 0.0),
            ("covariance", np.array([[0.1, -0.02], [-0.02, 0.3]]), -np.inf),
        )
    },
    "ShapeTerm of sd": Target(
        ef.ShapeTerm,
        arguments(
            sd=(
                0.1 * SHAPES**2,
                unless(floats((), (2,), (1, 2), (3, 1), (3, 2), above=0.0)),
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
            measured=(SHAPES, shapes(2)),
            delta=(
                np.array([0.1, 0.2]),
                either(floats((), (2,), (1,), above=0.0), text),
            ),
        ),
        probe=lambda term: term(ANY, MODES),
        tied=("measured", "delta"),
        late=("dofs", "measured"),
    ),
    "mac": Target(
        pairing.mac,
        arguments(a=(SHAPES, unsaid), b=(SHAPES + 0.1, unsaid)),
        examples=120,
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
