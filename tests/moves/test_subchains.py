"""Cheap steps between full solves keep the target, if the guides stand still."""

import numpy as np
import pytest
from support.cheap_laws import INNER, MORE, wrong
from support.checks import LIMIT, BoundedTriangle, Gaussian, exact_start

from emcee_femu import DelayedAcceptanceMove

TARGETS = {"gaussian": Gaussian, "bounded": BoundedTriangle}
FAR = (1e-8, 1.0, 1e8)
EVERY = {**INNER, **MORE}
CASES = [  # inner, target, walkers, dimension, steps
    *[(inner, "gaussian", 12, 3, 3) for inner in EVERY],
    *[(inner, "bounded", 12, 3, 3) for inner in INNER],
    *[("demc", target, 4, 3, (1, 6)) for target in TARGETS],  # the fewest
    ("snooker", "bounded", 6, 3, (1, 6)),
    *[(inner, "gaussian", 1, 3, 5) for inner in ("metropolis", "independence")],
    *[(inner, "bounded", 4, 1, (2, 5)) for inner in ("demc", "metropolis")],
    *[(inner, "gaussian", 6, 1, 3) for inner in ("snooker", "independence")],
]


def delayed(inner, law, steps, kind=DelayedAcceptanceMove):
    return kind(EVERY[inner](law), wrong(law, bounded=True), steps)


@pytest.mark.parametrize("case", CASES, ids=str)
def test_subchains_of_a_wrong_cheap_posterior_leave_the_target_exact(case):
    inner, target, nwalkers, ndim, steps = case
    law = TARGETS[target](ndim=ndim)
    move = delayed(inner, law, steps)
    assert exact_start(move, law, nwalkers, ensembles=60, steps=6) < LIMIT
    assert 0 < move.accepted < move.full_solves < 0.7 * move.proposed


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES[::3], ids=str)  # all would take minutes
def test_subchains_leave_the_target_exact_at_high_power(case):
    inner, target, nwalkers, ndim, steps = case
    law = TARGETS[target](ndim=ndim)
    move = delayed(inner, law, steps)
    assert exact_start(move, law, nwalkers, ensembles=240, steps=44) < LIMIT


def test_subchains_of_far_scales_leave_the_target_exact():
    law = Gaussian(FAR)
    move = delayed("demc", law, 4)
    assert exact_start(move, law, 8, ensembles=100, steps=5) < LIMIT


# Mutants: each breaks the subchain in one way, and the exact start must see it.


class MovingGuides(DelayedAcceptanceMove):
    """Lets both halves walk by the cheap density before any full solve."""

    def batches(self, coords, random):
        values, walked = self._cheap_at_walkers(coords), coords.copy()
        start = values.copy()
        for _ in range(self.steps):
            for walkers, propose in self._proposing.parts(walked, random):
                ends, new = walked[walkers], values[walkers]
                self._step(propose, ends, new, random)
                walked[walkers], values[walkers] = ends, new
        yield np.arange(len(coords)), walked, start - values


class NoRatio(DelayedAcceptanceMove):
    """Makes no amends for the cheap density."""

    def batches(self, coords, random):
        for walkers, proposed, _ in super().batches(coords, random):
            yield walkers, proposed, None


class Stale(DelayedAcceptanceMove):
    """Keeps the cheap density of where a walker was."""

    def batches(self, coords, random):
        before = self._cheap_at_walkers(coords)
        yield from super().batches(coords, random)
        self._known = coords.copy(), before


class UntilItMoves(DelayedAcceptanceMove):
    """Ends a subchain with the walker's first move: a length by the state."""

    def _walk(self, propose, theta, values, random):
        moved = np.zeros(len(theta), dtype=bool)
        for _ in range(self.steps):
            there, new = theta.copy(), values.copy()
            first = self._step(propose, there, new, random) & ~moved
            theta[first], values[first] = there[first], new[first]
            moved |= first
        return moved


class LongerOutside(DelayedAcceptanceMove):
    """Walks on only from where a walker is far out: another length by the state."""

    def _walk(self, propose, theta, values, random):
        moved = np.zeros(len(theta), dtype=bool)
        far = np.abs(theta[:, 0] - 3.0) > 0.8
        for step in range(self.steps):
            there, new = theta.copy(), values.copy()
            passed = self._step(propose, there, new, random) & (far | (step == 0))
            theta[passed], values[passed] = there[passed], new[passed]
            moved |= passed
        return moved


MUTANTS = {  # the mutant, inner, target, walkers, steps, ensembles, generations
    "guides that move": (MovingGuides, "demc", Gaussian, 4, 4, 150, 30),
    "no ratio": (NoRatio, "demc", Gaussian, 12, 4, 80, 6),
    "no ratio, bounded": (NoRatio, "metropolis", BoundedTriangle, 12, 4, 80, 6),
    "stale": (Stale, "metropolis", Gaussian, 99, 4, 60, 12),
    "until it moves": (UntilItMoves, "metropolis", BoundedTriangle, 200, 8, 60, 8),
    "longer outside": (LongerOutside, "metropolis", Gaussian, 200, 8, 60, 5),
}


@pytest.mark.parametrize("mutant", MUTANTS)
def test_the_check_catches_a_broken_subchain(mutant):
    kind, inner, target, nwalkers, steps, ensembles, generations = MUTANTS[mutant]
    law = target()
    move = delayed(inner, law, steps, kind)
    assert exact_start(move, law, nwalkers, ensembles, generations) > LIMIT
