"""Pareto k and the effective share of importance weights, by laws of known k."""

import numpy as np
import pytest

from emcee_femu.sampling.importance import kish_share, pareto_k


@pytest.mark.parametrize("k", [0.2, 0.5, 0.9])
def test_the_tail_of_pareto_weights_has_their_k(k):
    rng = np.random.default_rng(3)
    found = [pareto_k(-k * np.log(rng.random(4_000))) for _ in range(20)]
    assert np.mean(found) == pytest.approx(k, abs=0.06)


def test_no_tail_and_no_weights():
    assert pareto_k(np.zeros(100)) == -np.inf
    assert pareto_k(np.full(100, -np.inf)) == np.inf
    some = np.where(np.arange(1_000) % 2, -np.inf, 0.01 * np.arange(1_000.0) % 1)
    assert pareto_k(some) < 0.5


def test_the_share_of_a_few_equal_weights_is_their_share():
    weights = np.where(np.arange(8) < 2, 3.0, -np.inf)
    assert kish_share(weights) == pytest.approx(0.25)
    assert kish_share(np.full(3, -np.inf)) == 0.0
