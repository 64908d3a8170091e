"""Each test's parameters once more, in the light of all the others."""

from typing import Any

import numpy as np

from ..interfaces import Floats
from ..results.arviz_objects import samples
from ..sampling.importance import GOOD_K, pareto_k
from .marginal import PopulationModel

DRAWS = 1_000  # of the population and of each test's parameters, together
BLOCK = 4_000_000  # weights at once
JUDGED = 32  # draws of the population under which weights are judged
QUARTILE = 0.25


def shrink(idata: Any, model: PopulationModel, rng: np.random.Generator) -> Any:
    """Draw the population's and each test's parameters together.

    Given the population the tests are independent: of each a draw is taken by its
    weights, or from its normal law where the draws do not reach.

    Returns:
        ``hyperdraws`` ``{name: (J,)}``, ``theta (J, T, d)``; and by test ``pareto_k``
        and ``effective``, the effective draws of its weights, each ``(T,)``.
    """
    names, chains = samples(idata)
    flat = chains.reshape(-1, len(names))
    chosen = flat[rng.choice(len(flat), DRAWS, replace=len(flat) < DRAWS)]
    hyperdraws = dict(zip(names, chosen.T, strict=True))
    longest = max(len(own.theta) for own in model.draws)
    tests = len(model.tests)
    padded = np.zeros((tests, longest, len(model.population.names)))
    for t, own in enumerate(model.draws):
        padded[t, : len(own.theta)] = own.theta
    theta = np.empty((DRAWS, tests, padded.shape[2]))
    step = max(1, BLOCK // (tests * longest))
    for start in range(0, DRAWS, step):
        block = {name: v[start : start + step] for name, v in hyperdraws.items()}
        cumulative = model.weights(block).cumsum(axis=2)
        level = rng.random((*cumulative.shape[:2], 1)) * cumulative[:, :, -1:]
        picked = (cumulative < level).sum(axis=2)
        theta[start : start + step] = padded[np.arange(tests), picked]
    k, effective = judge_weights(model, hyperdraws)
    by_law = np.array([law.good for law in model.laws]) & (k > GOOD_K)
    if by_law.any():
        drawn = _draw_inside(model, rng, hyperdraws)
        theta[:, by_law] = drawn[:, by_law]
    return {
        "hyperdraws": hyperdraws,
        "theta": theta,
        "pareto_k": k,
        "effective": effective,
    }


def judge_weights(
    model: PopulationModel, hyperdraws: dict[str, Floats]
) -> tuple[Floats, Floats]:
    """Return each test's Pareto k and effective draws, each ``(T,)``.

    Under the population for which, of some drawn from its posterior, a quarter leaves
    fewer draws effective.
    """
    some = {name: values[:JUDGED] for name, values in hyperdraws.items()}
    weights = np.concatenate(
        [
            model.weights({name: v[i : i + 1] for name, v in some.items()})
            for i in range(JUDGED)
        ]
    )
    effective = 1 / (weights**2).sum(axis=2)
    which = np.argsort(effective, axis=0)[int(QUARTILE * JUDGED)]
    each = np.arange(weights.shape[1])
    judged = weights[which, each]
    with np.errstate(divide="ignore"):
        logs = [
            np.log(own[: len(draws.theta)])
            for own, draws in zip(judged, model.draws, strict=True)
        ]
    return np.array([pareto_k(own) for own in logs]), effective[which, each]


def _draw_inside(
    model: PopulationModel, rng: np.random.Generator, hyperdraws: dict[str, Floats]
) -> Floats:
    drawn: Floats = model.draw_from_laws(rng, hyperdraws)
    return np.clip(drawn, model.bounds_of[:, 0], model.bounds_of[:, 1])
