"""The moves keep their target: exact starts, and mutants that must fail them."""

import emcee
import numpy as np
import pytest
from support.checks import LIMIT, BoundedTriangle, Gaussian, exact_start

from emcee_femu import DEMCMove, IndependenceMove, MetropolisMove
from emcee_femu.moves.independence import ComponentWalk  # of anneal, not public

TARGETS = {"gaussian": Gaussian, "bounded": BoundedTriangle}
UNIT, FAR = (1.0, 1.0, 1.0), (1e-8, 1.0, 1e8)  # areas beside stiffnesses
BOLD = {"live_dangerously": True}
SLOW = pytest.mark.slow  # of a small bias


def correlated(target):
    sd = 0.6 * target.scale
    return MetropolisMove(cov=np.outer(sd, sd) * (0.5 + 0.5 * np.eye(target.ndim)))


def badly_fitted(components):
    """Return what fits shifted draws: it must only be slower, never wrong."""

    def make(target):
        draws = target.sample(np.random.default_rng(1), (2_000,)) + 0.3 * target.scale
        return IndependenceMove.fit(draws, components)

    return make


def unequal(target):
    """Return a mixture whose weights sum to five; it must not propose by these."""
    means = target.sample(np.random.default_rng(1), (2,))
    return IndependenceMove([4.0, 1.0], means, [np.diag(target.scale**2)] * 2)


def in_logarithms(target):
    """Return a mixture of logarithms of all parameters but the last."""
    draws = target.sample(np.random.default_rng(1), (2_000,))
    draws = draws[(draws > 0).all(axis=1)]
    logs = np.arange(target.ndim) < max(target.ndim - 1, 1)
    seen = np.where(logs, np.log(draws), draws)
    middle, matrix = seen.mean(axis=0), np.atleast_2d(1.5 * np.cov(seen.T))
    return IndependenceMove([0.5, 0.5], [middle, 1.1 * middle], [matrix] * 2, logs=logs)


def walk(target):
    """Return a walk by a narrow and a wide component, beside each other."""
    draws = target.sample(np.random.default_rng(1), (2_000,))
    near = np.diag((0.25 * target.scale) ** 2)
    means = draws.mean(axis=0) + np.outer([0.8, -0.8], target.scale)
    mixture = IndependenceMove([0.5, 0.5], means, [near, 9.0 * near])
    return ComponentWalk(mixture.mixture, scale=0.8)


CASES = [  # move, or what makes it for a target; walkers; dimension; scale
    (DEMCMove(**BOLD), 4, 3, UNIT),
    (DEMCMove(**BOLD), 10, 3, FAR),
    (DEMCMove([0.0, 0.02, 0.3], gamma0=0.4, mode_jump=0.5, **BOLD), 6, 3, UNIT),
    (DEMCMove(nsplits=4, randomize_split=False, **BOLD), 6, 3, UNIT),
    *[
        (make, n, 3, scale)
        for make in (correlated, badly_fitted(3), walk)
        for n, scale in ((1, UNIT), (6, FAR))
    ],
    (unequal, 6, 3, UNIT),
    (in_logarithms, 6, 3, UNIT),
    (in_logarithms, 1, 3, FAR),
    # In one dimension, where constants have values of their own.
    (DEMCMove(), 6, 1, UNIT),
    *[(make, 3, 1, UNIT) for make in (correlated, badly_fitted(1), in_logarithms)],
]


def z_of(case, kind, **effort):
    make, nwalkers, ndim, scale = case
    target = TARGETS[kind](scale, ndim)
    move = make if isinstance(make, emcee.moves.Move) else make(target)
    return exact_start(move, target, nwalkers, **effort)


@pytest.mark.parametrize("target", TARGETS)
@pytest.mark.parametrize("case", CASES)
def test_the_move_keeps_the_target(case, target):
    assert z_of(case, target, ensembles=80, steps=8) < LIMIT


@pytest.mark.slow
@pytest.mark.parametrize("case", [(DEMCMove(**BOLD), 4, 3, UNIT), (walk, 99, 3, UNIT)])
def test_the_target_is_kept_at_high_power(case):
    """The law at a power before which a bias of the synchronous kind cannot hide."""
    assert z_of(case, "gaussian", ensembles=600, steps=30) < LIMIT


# Mutants: each breaks a move in one way, and the exact start must see it.


class Synchronous(DEMCMove):
    """Moves all walkers from one generation."""

    def propose(self, model, state):
        others = [np.delete(state.coords, i, axis=0) for i in range(len(state.coords))]
        proposed = np.vstack(
            [
                self.get_proposal(walker[None], [guides], model.random)[0]
                for walker, guides in zip(state.coords, others, strict=True)
            ]
        )
        log_prob, _ = model.compute_log_prob_fn(proposed)
        moved = log_prob - state.log_prob > np.log(model.random.random(len(log_prob)))
        state.coords[moved], state.log_prob[moved] = proposed[moved], log_prob[moved]
        return state, moved


class GuidedByItself(DEMCMove):
    """May take the walker that it moves for one of a pair."""

    def get_proposal(self, s, c, random):
        propose = super().get_proposal
        proposed = [propose(x[None], [np.vstack([*c, x])], random)[0] for x in s]
        return np.vstack(proposed), None


class Warm(Gaussian):
    """As a move takes it that samples at a temperature of 1.44."""

    def __call__(self, theta):
        return super().__call__(theta) / 1.44


MUTANTS = {  # move, walkers, ensembles, steps
    # The bias of the first is the smallest, and grows for 30 steps.
    "all from one generation": (Synchronous(**BOLD), 4, 450, 30),
    "guided by itself": (GuidedByItself(**BOLD), 4, 80, 8),
    "too warm": (DEMCMove(), 6, 160, 12),
}


@pytest.mark.parametrize(
    "mutant", [pytest.param(m, marks=SLOW) if m[:3] == "all" else m for m in MUTANTS]
)
def test_the_check_catches_a_broken_move(mutant):
    """The power of the law; the bias of one mutant is small."""
    move, *effort = MUTANTS[mutant]
    target = Warm() if mutant == "too warm" else Gaussian()
    assert exact_start(move, target, *effort) > LIMIT
