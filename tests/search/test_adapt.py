"""When a refinement ends: by what the chain would pay, and by who may do better."""

from types import SimpleNamespace

import numpy as np
import pytest
from support.free_posterior import box, free_posterior

import emcee_femu as ef
from emcee_femu.search.adapt import PERFECT_CHAIN, _is_enough
from emcee_femu.search.auto import ROUND
from emcee_femu.search.settings import SETTINGS


@pytest.mark.parametrize(
    ("shares", "bendable", "enough"),
    [
        ([0.95], False, True),  # nothing is left to gain
        ([0.5, 0.6, 0.6], True, False),  # a perfect proposal would save much
        ([0.5, 0.6, 0.75, 0.75], True, True),  # it would save less than is spent
        ([0.2, 0.3, 0.5, 0.75], True, False),  # but not while rounds bring gains
        ([0.2, 0.3, 0.3, 0.3], True, True),  # polynomials will do better
        ([0.2, 0.3, 0.3, 0.3], False, False),  # of which there are none
        ([0.2, 0.3, 0.4, 0.45], True, False),  # it still gains
        ([0.2, 0.0], True, False),  # no draw has a weight
    ],
)
def test_a_refinement_ends_where_the_next_round_costs_more_than_it_saves(
    shares, bendable, enough
):
    rounds = [SimpleNamespace(efficiency=share) for share in shares]
    sizes = SimpleNamespace(batch=300, chain=10_000)
    campaign = SimpleNamespace(bendable=bendable, settings=SETTINGS, sizes=sizes)
    further = 300 * max(2, len(rounds)) // 2
    assert _is_enough(campaign, rounds, further) == enough


@pytest.mark.parametrize(
    ("shares", "steps", "enough"),
    [
        ([0.5, 0.6, 0.75, 0.75], 100_000, False),  # a long chain would pay for it
        ([0.5, 0.6, 0.75, 0.75], 10_000, True),  # a short one would not
        ([0.5, 0.75, 0.75, 0.75], 100_000, True),  # two rounds without gain
        ([0.95, 0.999], 100_000, True),  # nothing is left to gain
    ],
)
def test_a_refinement_for_a_long_chain_goes_on_while_it_gains(shares, steps, enough):
    rounds = [SimpleNamespace(efficiency=share) for share in shares]
    sizes = SimpleNamespace(batch=300, chain=steps)
    campaign = SimpleNamespace(bendable=True, settings=SETTINGS, sizes=sizes)
    assert _is_enough(campaign, rounds, 300 * len(rounds) // 2) == enough


def test_a_chain_takes_what_the_rule_reckons_with():
    """Law: by the mean wait of a walker, what a perfect proposal would take."""
    posterior = free_posterior(lambda x: -0.5 * (x**2).sum(axis=1), box(-9, 9, 3))
    taken = []
    for seed in (1, 2, 3):
        run = ef.run(posterior, seed=seed)
        wait = 2 / run.search.efficiency - 1
        taken.append((run.solves - run.search.solves) / ROUND / wait)
    assert np.mean(taken) == pytest.approx(PERFECT_CHAIN, rel=0.25)
