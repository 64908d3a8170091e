"""Delayed acceptance keeps the target, however wrong the cheap posterior is."""

import emcee
import numpy as np
import pytest
from emcee.model import Model
from scipy.stats import uniform
from support.checks import LIMIT, BoundedTriangle, Gaussian, exact_start
from support.component_walk import ComponentWalk

import emcee_femu as ef
from emcee_femu import DEMCMove, IndependenceMove, MetropolisMove

TARGETS = {"gaussian": Gaussian, "bounded": BoundedTriangle}


def wrong(target, bounded=True):
    """Return a cheap log-density that is shifted, too wide and skew.

    That of a Gaussian falls off as it does; another has the target's bounds if asked.
    """

    def cheap(theta):
        x = theta / target.scale
        core = 0.6 * target(theta) if bounded or isinstance(target, Gaussian) else 0.0
        pair = x[:, 1] * x[:, 2] if x.shape[1] > 1 else 0.0
        return core + 0.7 * x[:, 0] - 0.4 * pair - 0.1 * x[:, -1] ** 2

    return cheap


def independence(target):
    return IndependenceMove.fit(target.sample(np.random.default_rng(5), (400,)))


def off(target):
    """Return proposals beside the target, of which many in a row are refused."""
    x = target.sample(np.random.default_rng(5), (400,))
    matrix = np.atleast_2d(0.7 * np.cov(x.T))
    return IndependenceMove([1.0], [x.mean(axis=0) + 0.3 * target.scale], [matrix], 5.0)


INNER = {
    "demc": lambda target: DEMCMove(live_dangerously=True),
    "demc, four splits": lambda target: DEMCMove(nsplits=4, randomize_split=False),
    "metropolis": lambda target: MetropolisMove(sd=0.5 * target.scale),
    "independence": independence,
    "independence, off": off,
    "component walk": lambda target: ComponentWalk(independence(target).mixture, 0.7),
}
CASES = [  # inner, target, walkers, dimension, steps
    *[(inner, "gaussian", 12, 3, steps) for inner in INNER for steps in (1, 3)],
    *[(inner, "bounded", 12, 3, 3) for inner in INNER],
    *[("demc", target, 4, 3, (1, 6)) for target in TARGETS],  # the fewest
    *[(inner, "gaussian", 1, 3, 5) for inner in ("metropolis", "independence")],
    *[("independence, off", target, 12, 3, 12) for target in TARGETS],
    *[(inner, "bounded", 4, 1, (2, 5)) for inner in ("demc", "metropolis")],
    *[(inner, "gaussian", 12, 1, 1) for inner in ("demc", "independence")],
]


def z_of(case, scale=(1.0, 1.0, 1.0), **effort):
    inner, kind, nwalkers, ndim, steps = case
    target = TARGETS[kind](scale, ndim)
    move = ef.moves.DelayedAcceptanceMove(INNER[inner](target), wrong(target), steps)
    z = exact_start(move, target, nwalkers, **effort)
    assert 0 < move.accepted < move.full_solves < 0.95 * move.proposed
    return z


@pytest.mark.parametrize("case", CASES, ids=str)
def test_a_wrong_cheap_posterior_leaves_the_target_exact(case):
    assert z_of(case, ensembles=60, steps=8) < LIMIT


def test_lengths_and_guides_that_depend_on_the_walkers_would_be_seen():
    alone = "metropolis", "bounded", 200, 3, 8
    assert z_of(alone, ensembles=60, steps=8) < LIMIT
    guided = "demc", "bounded", 4, 3, 4
    assert z_of(guided, ensembles=100, steps=24) < LIMIT


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES[1::6], ids=str)  # all would take minutes
def test_the_target_is_exact_at_high_power(case):
    assert z_of(case, ensembles=240, steps=32) < LIMIT


def test_the_target_is_exact_where_scales_differ_or_the_screen_knows_no_bounds():
    case = "demc", "gaussian", 8, 3, 4
    assert z_of(case, (1e-8, 1.0, 1e8), ensembles=100, steps=5) < LIMIT
    target = BoundedTriangle()
    move = ef.moves.DelayedAcceptanceMove(DEMCMove(), wrong(target, bounded=False))
    assert exact_start(move, target, 12) < LIMIT


def stepped(move, target, generations=1, nwalkers=12):
    """Move walkers from the target; return the state, and how many each solve was of.

    The rows of the state are held to those of the target.
    """

    def full(theta):
        solved.append(len(theta))
        return target(theta), None

    solved = []
    model = Model(None, full, map, np.random.RandomState(0))
    start = target.sample(np.random.default_rng(1), (nwalkers,))
    state = emcee.State(start, log_prob=target(start))
    for _ in range(generations):
        before = state.coords.copy()
        state, accepted = move.propose(model, state)
        np.testing.assert_array_equal((state.coords != before).any(axis=1), accepted)
        # Several points round otherwise than few.
        np.testing.assert_allclose(
            state.log_prob, target(state.coords), rtol=1e-9, atol=1e-9
        )
    return state, solved


class Asked:
    """A cheap density that knows how many points it was asked for at once."""

    def __init__(self, density):
        self.density, self.sizes = density, []

    def __call__(self, theta):
        self.sizes.append(len(theta))
        return self.density(theta)


@pytest.mark.parametrize("steps", [1, 7])
def test_one_evaluation_of_each_density_per_step_and_solve(steps):
    target = Gaussian()
    cheap = Asked(wrong(target))
    move = ef.moves.DelayedAcceptanceMove(DEMCMove(), cheap, steps)
    _, solved = stepped(move, target, 5)
    assert cheap.sizes == [12] + 5 * 2 * steps * [6]  # the start, then two halves
    assert sum(solved) == move.full_solves <= 60 and 0 not in solved
    assert move.proposed == 5 * 12 * steps
    assert f"{1 - move.full_solves / move.proposed:.1%} saved" in str(move)


def test_an_exact_cheap_posterior_accepts_all_that_it_passes():
    move = ef.moves.DelayedAcceptanceMove(DEMCMove(), Gaussian())
    stepped(move, Gaussian(), 100)
    assert 0 < move.accepted == move.full_solves < move.proposed


def test_a_walker_that_did_not_move_is_not_solved():
    target = Gaussian()
    move = ef.moves.DelayedAcceptanceMove(MetropolisMove(sd=1e6), wrong(target), 5)
    _, solved = stepped(move, target, 3)
    assert solved == [] and move.full_solves == 0 < move.proposed


def test_walkers_that_another_move_changed_are_screened_anew():
    target = Gaussian()
    cheap = Asked(wrong(target))
    move = ef.moves.DelayedAcceptanceMove(DEMCMove(), cheap)
    state, _ = stepped(move, target)
    state.coords[3] += 0.1
    state.log_prob[3] = target(state.coords[3:4])[0]
    model = Model(None, lambda q: (target(q), None), map, np.random.RandomState(0))
    move.propose(model, state)
    assert cheap.sizes == [12, 6, 6, 1, 6, 6]


def test_lengths_are_drawn_from_both_ends_and_all_between():
    target, lengths = Gaussian(), []
    move = ef.moves.DelayedAcceptanceMove(MetropolisMove(sd=1), wrong(target), (2, 4))
    state, _ = stepped(move, target)
    model = Model(None, lambda q: (target(q), None), map, np.random.RandomState(0))
    for _ in range(60):
        before = move.proposed
        state, _ = move.propose(model, state)
        lengths.append((move.proposed - before) // 12)
    counts = np.bincount(lengths, minlength=5)
    assert counts[:2].sum() == 0 and (counts[2:] > 10).all() and counts.sum() == 60


class Lines:
    """Frequencies that are linear in two parameters; some solves fail."""

    variables = ef.modal_variables(3)

    def __init__(self, shift=0.0, fails=False):
        self.shift, self.fails = shift, fails

    def __call__(self, parameters):
        a, b = parameters["a"] + self.shift, parameters["b"]
        frequencies = np.column_stack([100 + a, 150 + a + 2 * b, 200 - b])
        if self.fails:
            frequencies[a > 2.0] = np.nan
        return ef.ModalSolution(frequencies)


PRIOR = ef.IndependentPrior({"a": uniform(-6, 12), "b": uniform(-6, 12)})
TERM = ef.FrequencyTerm([101.0, 149.0, 201.0], sd=1.0)
CHEAP = ef.LogPosterior(Lines(shift=0.5), TERM, PRIOR)


def test_a_resumed_run_goes_on_to_the_bit_and_failed_solves_are_rejected(tmp_path):
    posterior = ef.LogPosterior(Lines(fails=True), TERM, PRIOR)
    options = {"seed": 3, "ensembles": 1, "on_failure": "reject", "max_failures": 1.0}

    def go(steps, file, resume=False):
        move = ef.moves.DelayedAcceptanceMove(DEMCMove(), CHEAP, (2, 9))
        file = {"backend": tmp_path / file, "resume": resume}
        return ef.run(posterior, move, 12, steps, **file, **options)[0]

    whole = go(40, "straight.h5")
    go(15, "broken.h5")
    resumed = go(40, "broken.h5", resume=True).get_chain()
    np.testing.assert_array_equal(resumed, whole.get_chain())
    assert 0.0 < resumed[..., 0].max() <= 2.0  # beyond which solves fail
    stored = whole.get_log_prob(flat=True), whole.get_blobs(flat=True)
    rows = posterior(resumed.reshape(-1, 2))
    np.testing.assert_allclose(np.column_stack(stored), rows, rtol=1e-12)


def test_a_move_is_shown_as_its_call_without_the_tables_of_the_cheap_posterior():
    cheap = ef.paper.mass_spring().posterior
    move = ef.moves.DelayedAcceptanceMove(ef.DEMCMove(), cheap, steps=3)
    assert repr(move).endswith("cheap=LogPosterior, steps=3)")
    assert "(inner=DEMCMove(" in repr(ef.moves.TemperedMove(move, [1.0, 0.5]))
