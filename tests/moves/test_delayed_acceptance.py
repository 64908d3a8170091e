"""Delayed acceptance keeps the target, however wrong the cheap posterior is."""

import emcee
import numpy as np
import pytest
from emcee.model import Model
from support.checks import LIMIT, BoundedTriangle, Gaussian, exact_start

import emcee_femu as ef
from emcee_femu import DEMCMove, IndependenceMove, MetropolisMove

TARGETS = {"gaussian": Gaussian, "bounded": BoundedTriangle}


def wrong(target, bounded=True):
    """Return a cheap log-density: shifted, too wide, skew, perhaps without bounds."""

    def cheap(theta):
        x = theta / target.scale
        core = 0.6 * target(theta) if bounded or isinstance(target, Gaussian) else 0.0
        pair = x[:, 1] * x[:, 2] if x.shape[1] > 1 else 0.0
        return core + 0.7 * x[:, 0] - 0.4 * pair - 0.1 * x[:, -1] ** 2

    return cheap


def independence(target):
    return IndependenceMove.fit(target.sample(np.random.default_rng(5), (400,)))


INNER = {
    "demc": lambda target: DEMCMove(live_dangerously=True),
    "demc, four splits": lambda target: DEMCMove(nsplits=4, randomize_split=False),
    "metropolis": lambda target: MetropolisMove(sd=0.5 * target.scale),
    "independence": independence,
}
CASES = [  # inner, target, walkers, dimension, steps
    *[(inner, "gaussian", 12, 3, 1) for inner in INNER],
    *[(inner, "bounded", 12, 3, 3) for inner in INNER],
    *[("demc", target, 4, 3, (1, 6)) for target in TARGETS],  # the fewest
    *[(inner, "gaussian", 1, 3, 5) for inner in ("metropolis", "independence")],
    ("metropolis", "bounded", 4, 1, (2, 5)),
]


def z_of(case, scale=(1.0, 1.0, 1.0), bounded=True, **effort):
    inner, kind, nwalkers, ndim, steps = case
    target = TARGETS[kind](scale, ndim)
    cheap = wrong(target, bounded)
    move = ef.moves.DelayedAcceptanceMove(INNER[inner](target), cheap, steps)
    z = exact_start(move, target, nwalkers, **effort)
    assert 0 < move.accepted < move.full_solves < 0.95 * move.proposed
    return z


EFFORT = [(case, 50, 5) for case in CASES]
EFFORT += [pytest.param(case, 240, 32, marks=pytest.mark.slow) for case in CASES[1::4]]


@pytest.mark.parametrize(("case", "ensembles", "steps"), EFFORT, ids=str)
def test_a_wrong_cheap_posterior_leaves_the_target_exact(case, ensembles, steps):
    """The law, at a power that sees lengths or guides which depend on walkers."""
    assert z_of(case, ensembles=ensembles, steps=steps) < LIMIT


def test_the_target_is_exact_where_scales_differ_or_the_screen_knows_no_bounds():
    case, effort = ("demc", "gaussian", 8, 3, 4), {"ensembles": 50, "steps": 5}
    assert z_of(case, (1e-8, 1.0, 1e8), **effort) < LIMIT
    assert z_of(("demc", "bounded", 12, 3, 1), bounded=False, **effort) < LIMIT


def stepped(move, target, generations=1, state=None):
    """Move twelve walkers; return their state, and how many each solve was of."""

    def full(theta):
        solved.append(len(theta))
        return target(theta), None

    solved = []
    model = Model(None, full, map, np.random.RandomState(0))
    if state is None:
        start = target.sample(np.random.default_rng(1), (12,))
        state = emcee.State(start, log_prob=target(start))
    for _ in range(generations):
        before = state.coords.copy()
        state, accepted = move.propose(model, state)
        np.testing.assert_array_equal((state.coords != before).any(axis=1), accepted)
        # Several points round otherwise than few.
        np.testing.assert_allclose(state.log_prob, target(state.coords), 1e-9, 1e-9)
    return state, solved


def test_each_density_is_evaluated_once_a_step_and_anew_where_a_walker_was_changed():
    target, steps, sizes = Gaussian(), 3, []

    def cheap(theta):
        sizes.append(len(theta))
        return wrong(target)(theta)

    move = ef.moves.DelayedAcceptanceMove(DEMCMove(), cheap, steps)
    state, solved = stepped(move, target, 5)
    assert sizes == [12] + 5 * 2 * steps * [6]  # the start, then two halves
    assert sum(solved) == move.full_solves <= 60 and 0 not in solved
    assert move.proposed == 5 * 12 * steps
    assert f"{1 - move.full_solves / move.proposed:.1%} saved" in str(move)
    state.coords[3] += 0.1
    state.log_prob[3] = target(state.coords[3:4])[0]
    stepped(move, target, state=state)
    assert sizes[1 + 5 * 2 * steps :] == [1] + 2 * steps * [6]


def test_an_exact_screen_accepts_all_that_it_passes_and_none_that_did_not_move():
    move = ef.moves.DelayedAcceptanceMove(DEMCMove(), Gaussian())
    stepped(move, Gaussian(), 50)
    assert 0 < move.accepted == move.full_solves < move.proposed
    target = Gaussian()
    move = ef.moves.DelayedAcceptanceMove(MetropolisMove(sd=1e6), wrong(target), 5)
    _, solved = stepped(move, target, 3)
    assert solved == [] and move.full_solves == 0 < move.proposed


def test_lengths_are_drawn_from_both_ends_and_all_between():
    target, proposed = Gaussian(), [0]

    def cheap(theta):
        proposed.append(move.proposed)
        return wrong(target)(theta)

    move = ef.moves.DelayedAcceptanceMove(MetropolisMove(sd=1), cheap, (2, 4))
    stepped(move, target, 60)
    lengths = np.diff(np.unique([*proposed, move.proposed])) // 12
    counts = np.bincount(lengths, minlength=5)
    assert counts[:2].sum() == 0 and (counts[2:] > 10).all() and counts.sum() == 60
