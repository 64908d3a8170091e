"""Doubts before a run: units, by predictions at the prior mean and at draws."""

import numpy as np
import pytest

from emcee_femu.posterior.plausibility import FAR_RATIO, doubt_units

MEASURED = np.array([3.0, 5.0, 9.0])
FAR = 2 * FAR_RATIO
OF_TURNS = 2 * np.pi


@pytest.mark.parametrize(
    ("times", "doubted"),
    [
        ([FAR], True),
        ([1 / FAR], True),
        ([FAR, 1.5 * FAR], True),
        ([FAR, 1.1], False),  # near at one of the points
        ([FAR, 1 / FAR], False),  # too high at one, too low at another
        ([0.9 * FAR_RATIO], False),
        ([FAR, np.nan], True),  # a failed solve says nothing
        ([np.nan, FAR], False),  # but of the first one all is said
    ],
)
def test_units_are_doubted_if_all_points_are_far_to_one_side(times, doubted):
    said = doubt_units(np.outer(times, MEASURED), MEASURED, "Hz")
    assert bool(said) == doubted


def test_one_prediction_on_the_other_side_is_enough_to_believe():
    predicted = FAR * MEASURED[None]
    predicted[0, 2] = 0.9 * MEASURED[2]
    assert not doubt_units(predicted, MEASURED, "Hz")


@pytest.mark.parametrize(("unit", "turns"), [("Hz", True), ("mm", False)])
def test_radians_are_asked_about_for_frequencies_alone(unit, turns):
    said = doubt_units(OF_TURNS * MEASURED[None], MEASURED, unit)
    assert ("rad/s" in said) == turns


@pytest.mark.parametrize(
    ("times", "doubted"),
    [([3.1], True), ([2.85, 1.9], True), ([2.85, 1.6], False), ([2.6], False)],
)
def test_weight_given_as_mass_is_doubted_a_little_below_the_limit(times, doubted):
    """It is 3.13 in frequencies, less what the prior mean is off."""
    said = doubt_units(np.outer(times, MEASURED), MEASURED, "Hz")
    assert bool(said) == doubted and ("weight" in said) == doubted
