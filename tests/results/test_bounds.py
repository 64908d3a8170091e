"""Density at a bound by the highest: closed forms of distributions that end there."""

import numpy as np
import pytest
from scipy import stats

from emcee_femu.results.bounds import AT_THE_HIGHEST, find_density

Q = (np.arange(100_000) + 0.5) / 100_000
UNKNOWN = np.full((1, 1), np.nan)  # draws of a prior that nobody knows
WIDE = stats.norm(0.0, 100.0).ppf(Q)[:, None]


def density(law, low, high, before=UNKNOWN, weights=None):
    draws = law.ppf(Q)[:, None]
    weights = np.ones(len(draws)) if weights is None else weights
    at, pressed = find_density(np.array([[low, high]]), before, draws, weights)
    return at[0], pressed[0]


def test_a_half_normal_is_highest_at_its_end():
    law = stats.halfnorm(-3.0, 1.0)  # from -3 on
    at, pressed = density(law, -3.0, np.inf, WIDE)
    assert at[0] == pytest.approx(1.0, abs=0.02) and pressed.tolist() == [True, False]


@pytest.mark.parametrize("sds", [1.0, 2.0])
def test_a_gaussian_that_is_cut_has_its_own_density_there(sds):
    """Averaged over a tenth of the draws, at the cut and about the top."""
    law = stats.truncnorm(-sds, np.inf, loc=-9.0)
    at, pressed = density(law, -9.0 - sds, np.inf, WIDE)
    ends = law.ppf(np.linspace(0, 0.99, 1_000))
    tenths = [law.ppf(p + 0.1) - law.ppf(p) for p in np.linspace(0, 0.9, 400)]
    exact = min(tenths) / (law.ppf(0.1) - ends[0])
    assert at[0] == pytest.approx(exact, abs=0.06)
    assert pressed[0] == (exact > AT_THE_HIGHEST)


def test_where_the_prior_is_as_dense_the_data_press_nothing():
    law = stats.expon(-3.0, 1.0)
    assert density(law, -3.0, np.inf, WIDE)[1][0]
    assert not density(law, -3.0, np.inf, law.ppf(Q)[:, None])[1][0]


def test_weights_count_as_draws_do():
    uniform = stats.uniform(-3.0, 2.0)
    tilted = np.exp(-4 * (uniform.ppf(Q) + 3.0))  # falls from the lower bound
    at = density(uniform, -3.0, -1.0, WIDE, tilted)[0]
    assert at[0] == pytest.approx(1.0, abs=0.02) and at[1] < 0.05
