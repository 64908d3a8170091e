"""Standard deviations of measurement errors, read off the terms."""

import numpy as np
import pytest
from scipy import stats

import emcee_femu as ef
from emcee_femu.posterior.units import find_units

HERTZ = np.array([3.0, 5.0, 9.0])
SHAPES = np.array([[1.0, 1.0, 1.0], [1.0, 0.5, -1.0], [1.0, -1.0, 0.5], [1, -1, -1.0]])
SOLVED = ef.ModalSolution(np.tile(HERTZ, (2, 1)), np.tile(2.0 * SHAPES, (2, 1, 1)))
NONE = {"k": np.ones(2)}


def test_of_frequencies_they_are_those_of_the_term():
    term = ef.FrequencyTerm(HERTZ[:2], sd=[0.1, 0.2])
    units = find_units(None, [term], NONE, SOLVED)
    # The third was not measured: three times the usual relative error.
    usual = np.median([0.1 / 3, 0.2 / 5])
    np.testing.assert_allclose(units["frequency"], [0.1, 0.2, 27 * usual], rtol=0.02)


def test_an_inferred_error_is_that_of_the_parameters():
    term = ef.FrequencyTerm(HERTZ, beta=1e6, discrepancy="sigma")
    units = find_units(None, [term], NONE | {"sigma": np.full(2, 0.05)}, SOLVED)
    np.testing.assert_allclose(units["frequency"], 0.05 * HERTZ, rtol=1e-3)


def test_of_shapes_they_are_delta_of_the_shapes_length():
    term = ef.ShapeTerm(SHAPES, delta=[0.1, 0.02, 0.03])
    units = find_units(None, [term], NONE, SOLVED)["shapes"]
    # One of four directions is the length of the shape, which does not matter.
    lengths = 2.0 * np.linalg.norm(SHAPES, axis=0) * np.sqrt(4 / 3)
    np.testing.assert_allclose(units, np.tile([0.1, 0.02, 0.03] * lengths, (4, 1)))


def test_candidates_have_those_of_the_measured_modes_they_are_paired_with():
    # The first measured mode looks like the third of the model, the second the first.
    measured = ef.Measurements([3.1, 8.0], shapes=SHAPES[:, [2, 0]])
    model = ef.PairedModel(lambda p: SOLVED, measured, candidates=3)
    terms = [
        ef.FrequencyTerm(measured.frequencies, sd=[0.1, 0.3]),
        ef.ShapeTerm(measured, delta=[0.1, 0.02]),
    ]
    units = find_units(model, terms, NONE, SOLVED)
    usual = np.median([0.3 / 3, 0.1 / 9])
    np.testing.assert_allclose(units["frequency"], [0.3, 15 * usual, 0.1], rtol=1e-6)
    lengths = 2.0 * np.linalg.norm(SHAPES, axis=0) * np.sqrt(4 / 3)
    assert units["shapes"].shape == (4, 3)
    np.testing.assert_allclose(
        units["shapes"][0, [0, 2]] / lengths[[0, 2]], [0.02, 0.1]
    )


class Written:
    """A term of a user: no slopes, two records."""

    reads = {"sag": ef.Variable({"point": [1, 2]})}

    def __call__(self, parameters, response):
        return stats.norm(1.0, [0.5, 0.25]).logpdf(response["sag"]).sum(axis=1)


def test_a_term_without_slopes_is_differenced():
    units = find_units(None, [Written()], NONE, {"sag": np.full((2, 2), 1.3)})
    np.testing.assert_allclose(units["sag"], [0.5, 0.25], rtol=1e-3)


def test_terms_that_tell_nothing_are_refused():
    term = Written()
    with pytest.raises(ValueError, match="give units"):
        find_units(None, [lambda p, r: np.zeros(2)], NONE, {"sag": np.ones((2, 2))})
    assert term.reads
