"""How much of the weights of a correction its draws can bear."""

from collections.abc import Sequence

import numpy as np

from ..interfaces import Floats
from ..sampling.importance import kish_share
from .draws import Drawn
from .normal_law import NormalLaw

EFFECTIVE = 10.0
NARROWEST = 0.3  # spread of the population, by that of the tests' own posteriors
HALVINGS = 20


def choose_powers(
    draws: Sequence[Drawn], laws: Sequence[NormalLaw], centred: Floats
) -> Floats:
    """Return the powers tau ``(T,)`` of the weights, 1 where 10 draws are effective.

    They are judged under a population found by moments: a line through the tests'
    means, and the scatter about it beyond that of the tests' own posteriors. Weights
    that no normal law controls keep the power 1.
    """
    means = np.stack([own.theta.mean(axis=0) for own in draws])
    within = np.stack([own.theta.var(axis=0) for own in draws])
    design = np.column_stack([np.ones(len(means)), *centred.T])
    fitted = design @ np.linalg.lstsq(design, means, rcond=None)[0]
    free = max(1, len(means) - design.shape[1])
    scatter = ((means - fitted) ** 2).sum(axis=0) / free
    own_variance = within.mean(axis=0)
    variance = np.maximum(scatter - own_variance, NARROWEST**2 * own_variance)
    powers = np.ones(len(draws))
    for t, (own, law) in enumerate(zip(draws, laws, strict=True)):
        if law.good:
            away = (own.theta - fitted[t]) ** 2 / variance
            powers[t] = _choose_power(-away.sum(axis=1) / 2 - own.log_prior)
    return powers


def _choose_power(log_weights: Floats) -> float:
    def enough(power: float) -> bool:
        share = kish_share(power * log_weights)
        return share * len(log_weights) >= min(EFFECTIVE, 0.5 * len(log_weights))

    low, high = 0.0, 1.0
    if enough(high):
        return high
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        low, high = (middle, high) if enough(middle) else (low, middle)
    return max(low, 1e-6)
