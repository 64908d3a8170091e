"""When a refinement ends: by what the chain would pay, and by who may do better."""

from types import SimpleNamespace

import pytest

from emcee_femu.search.adapt import _is_enough
from emcee_femu.search.settings import SETTINGS


@pytest.mark.parametrize(
    ("shares", "bendable", "enough"),
    [
        ([0.2, 0.95], False, True),  # nothing is left to gain
        ([0.5, 0.85, 0.85, 0.84], True, True),  # good already
        ([0.5, 0.6, 0.6, 0.6], True, False),  # the chain would pay for the rest
        ([0.5, 0.6, 0.6, 0.6], False, False),
        ([0.2, 0.3, 0.3, 0.3], True, True),  # polynomials will do better
        ([0.2, 0.3, 0.3, 0.3], False, False),  # of which there are none
        ([0.5, 0.6, 0.7, 0.85], True, False),  # it still gains
    ],
)
def test_a_refinement_that_gains_nothing_ends_only_where_little_is_lost(
    shares, bendable, enough
):
    rounds = [SimpleNamespace(efficiency=share) for share in shares]
    campaign = SimpleNamespace(bendable=bendable, settings=SETTINGS)
    assert _is_enough(campaign, rounds) == enough
