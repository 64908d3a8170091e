"""What a subchain costs, stores and refuses."""

import emcee
import numpy as np
import pytest
from emcee.model import Model
from scipy.stats import uniform
from support.cheap_laws import wrong
from support.checks import Gaussian

import emcee_femu as ef
from emcee_femu import DelayedAcceptanceMove
from emcee_femu.moves import DEMCMove, MetropolisMove, TemperedMove


def stepped(move, law, generations=1, nwalkers=12):
    """Move walkers from the law; return the state, and how many each solve was for."""

    def full(theta):
        solved.append(len(theta))
        return law(theta), None

    solved = []
    model = Model(None, full, map, np.random.RandomState(0))
    start = law.sample(np.random.default_rng(1), (nwalkers,))
    state = emcee.State(start, log_prob=law(start))
    for _ in range(generations):
        state, _ = move.propose(model, state)
    return state, solved


def test_one_evaluation_of_each_density_per_step_and_solve():
    law, asked = Gaussian(), []

    def cheap(theta):
        asked.append(len(theta))
        return wrong(law)(theta)

    move = DelayedAcceptanceMove(DEMCMove(), cheap, 7)
    state, solved = stepped(move, law, 5)
    assert asked == [12] + 5 * 14 * [6]  # the start, then two halves of seven steps
    assert len(solved) == 10 and sum(solved) == move.full_solves <= 60
    assert move.proposed == 5 * 12 * 7
    np.testing.assert_array_equal(state.log_prob, law(state.coords))
    np.testing.assert_allclose(move._known[1], wrong(law)(state.coords))


def test_a_walker_that_did_not_move_is_not_solved():
    law = Gaussian()
    move = DelayedAcceptanceMove(MetropolisMove(sd=1e6), wrong(law), 5)
    before = law.sample(np.random.default_rng(1), (12,))
    state, solved = stepped(move, law, 3)
    assert solved == [] and move.full_solves == 0
    np.testing.assert_array_equal(state.coords, before)


def test_lengths_are_drawn_from_both_ends_and_all_between():
    law = Gaussian()
    move, lengths = DelayedAcceptanceMove(DEMCMove(), wrong(law), (2, 4)), []
    for seed in range(60):
        before = move.proposed
        state = emcee.State(law.sample(np.random.default_rng(seed), (12,)))
        batches = move.batches(state.coords, np.random.RandomState(seed))
        next(batches)
        lengths.append((move.proposed - before) // 6)
    counts = np.bincount(lengths, minlength=5)
    assert counts[:2].sum() == 0 and (counts[2:] > 10).all() and counts.sum() == 60


@pytest.mark.parametrize("steps", [(1, 1), [1, 1], np.int64(1), np.array([1, 1])])
def test_one_step_is_one_step_however_it_is_written(steps):
    law = Gaussian()
    kinds = [
        DelayedAcceptanceMove(DEMCMove(), wrong(law), given) for given in (1, steps)
    ]
    one, other = (stepped(move, law, 20)[0].coords for move in kinds)
    np.testing.assert_array_equal(one, other)
    assert kinds[1].steps == 1


def test_guides_stand_still_until_the_solve_has_decided():
    law, seen = Gaussian(), []

    class Recorded(DEMCMove):
        def get_proposal(self, s, c, random):
            seen.append(c[0].copy())
            return super().get_proposal(s, c, random)

    move = DelayedAcceptanceMove(Recorded(nsplits=3), wrong(law), 4)
    move._trusted = True  # no trial of what proposes
    stepped(move, law, 2)
    parts = np.reshape(seen, (2, 3, 4, 8, 3))
    np.testing.assert_array_equal(parts, parts[:, :, :1].repeat(4, axis=2))
    assert (parts[0, 0, 0] != parts[0, 1, 0]).any()


class Coupled(DEMCMove):
    """Steps by the spread of the walkers that move."""

    def get_proposal(self, s, c, random):
        return s + 0.1 * s.std(axis=0) * random.standard_normal(s.shape), None


def coupled_walk(coords, random):
    step = 0.3 * coords.std(axis=0) * random.standard_normal(coords.shape)
    return coords + step, np.zeros(len(coords))


@pytest.mark.parametrize("inner", [Coupled(), emcee.moves.MHMove(coupled_walk)])
def test_a_move_that_reads_the_walkers_that_move_is_refused(inner):
    law = Gaussian()
    move = DelayedAcceptanceMove(inner, wrong(law), 3)
    with pytest.raises(ValueError, match="inner: expected proposals from a walker's"):
        stepped(move, law)


def test_the_trial_of_a_move_leaves_the_chain_as_it_is():
    law = Gaussian()
    kinds = [DelayedAcceptanceMove(DEMCMove(), wrong(law), 3) for _ in range(2)]
    kinds[1]._trusted = True
    tried, trusted = (stepped(move, law, 10)[0].coords for move in kinds)
    np.testing.assert_array_equal(tried, trusted)


def test_a_move_that_counts_its_steps_is_refused_where_several_are_made():
    counting = emcee.moves.GaussianMove(0.2, mode="sequential")
    DelayedAcceptanceMove(counting, len)
    with pytest.raises(ValueError, match="inner: GaussianMove.mode='sequential'"):
        DelayedAcceptanceMove(counting, len, (1, 2))


@pytest.mark.parametrize(
    ("steps", "error"),
    [
        (0, "steps: expected at least 1, got 0"),
        ((0, 3), "steps: expected at least 1, got 0"),
        ((3, 2), "low <= high"),
        ((1, 2, 3), r"an interval \(low, high\)"),
        ([], r"an interval \(low, high\)"),
        (2.0, "steps: expected a whole number"),
        (True, "steps: expected a whole number"),
        ("12", "steps: expected a whole number"),
        ((1, 2.5), "steps: expected a whole number"),
        (None, "steps: expected a whole number"),
    ],
)
def test_steps_are_checked(steps, error):
    with pytest.raises((TypeError, ValueError), match=error):
        DelayedAcceptanceMove(DEMCMove(), len, steps)


def test_the_text_tells_the_steps():
    move = DelayedAcceptanceMove(DEMCMove(), len, [2, 9])
    assert repr(move).endswith("steps=(2, 9))") and move.steps == (2, 9)


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
DESIGN = np.array([[1, 0], [1, 2], [0, -1]])
MEAN = np.linalg.lstsq(DESIGN, np.array([1.0, -1.0, 1.0]))[0]


@pytest.mark.parametrize("betas", [None, (1.0, 0.3)])
def test_a_run_stores_the_rows_of_the_full_posterior(betas):
    posterior = ef.LogPosterior(Lines(), TERM, PRIOR)
    move = DelayedAcceptanceMove(DEMCMove(), CHEAP, (5, 15))
    whole = move if betas is None else TemperedMove(move, betas)
    law = np.random.default_rng(1)
    initial = law.multivariate_normal(MEAN, np.linalg.inv(DESIGN.T @ DESIGN), 24)
    (sampler,) = ef.run(posterior, whole, 24, 100, seed=1, initial=initial)
    draws = sampler.get_chain()[:, : 24 // len(betas or (1,))]
    scatter = draws.mean(axis=1).std(axis=0) * np.sqrt(4 / len(draws))  # tau below 4
    assert (np.abs(draws.mean(axis=(0, 1)) - MEAN) < 5 * scatter).all()
    rows = posterior(sampler.get_chain(flat=True)[-240:])
    stored = sampler.get_log_prob(flat=True)[-240:], sampler.get_blobs(flat=True)[-240:]
    np.testing.assert_array_equal(np.column_stack(stored), rows)


def test_a_resumed_run_goes_on_to_the_bit_and_failed_solves_are_rejected(tmp_path):
    posterior = ef.LogPosterior(Lines(fails=True), TERM, PRIOR)

    def go(nsteps, file, resume=False):
        move = DelayedAcceptanceMove(DEMCMove(), CHEAP, (2, 9))
        return ef.run(
            posterior,
            move,
            12,
            nsteps,
            seed=3,
            backend=tmp_path / file,
            resume=resume,
            on_failure="reject",
            max_failures=1.0,
        )[0].get_chain()

    chain = go(40, "straight.h5")
    go(15, "broken.h5")
    np.testing.assert_array_equal(go(40, "broken.h5", resume=True), chain)
    assert (
        chain[..., 0].max()
        <= 2.0
        < ef.LogPosterior(Lines(), TERM, PRIOR).prior.bounds[0][1]
    )
