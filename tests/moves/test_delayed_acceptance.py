"""Delayed acceptance keeps the target, however wrong the cheap posterior is."""

import emcee
import numpy as np
import pytest
from emcee.model import Model
from scipy.stats import uniform
from support.cheap_laws import INNER, wrong
from support.checks import LIMIT, BoundedTriangle, Gaussian, exact_start

import emcee_femu as ef
from emcee_femu import DelayedAcceptanceMove, ModalSolution
from emcee_femu.moves import DEMCMove, TemperedMove

TARGETS = {"gaussian": Gaussian, "bounded": BoundedTriangle}


@pytest.mark.parametrize("target", TARGETS)
@pytest.mark.parametrize("inner", INNER)
def test_a_wrong_cheap_posterior_leaves_the_target_exact(inner, target):
    law = TARGETS[target]()
    move = DelayedAcceptanceMove(INNER[inner](law), wrong(law))
    assert exact_start(move, law, 12) < LIMIT
    assert 0 < move.accepted < move.full_solves < move.proposed


@pytest.mark.parametrize("inner", ["demc", "metropolis", "independence"])
def test_the_target_is_exact_in_one_dimension(inner):
    law = Gaussian(ndim=1)
    move = DelayedAcceptanceMove(INNER[inner](law), wrong(law))
    assert exact_start(move, law, 12) < LIMIT


class OneStage(DelayedAcceptanceMove):
    """Makes no amends for the screen: the ratio c / c is left out."""

    def batches(self, coords, random):
        for walkers, proposed, _ in super().batches(coords, random):
            yield walkers, proposed, None


def test_without_the_second_stage_the_wrong_target_is_sampled():
    law = Gaussian()
    move = OneStage(DEMCMove(), wrong(law))
    assert exact_start(move, law, 12) > 2 * LIMIT


def test_an_exact_cheap_posterior_accepts_all_that_it_passes():
    law = Gaussian()
    move = DelayedAcceptanceMove(DEMCMove(), law)
    exact_start(move, law, 10, ensembles=50, steps=10)
    assert move.accepted == move.full_solves < move.proposed
    assert f"{1 - move.full_solves / move.proposed:.1%} saved" in str(move)


def test_as_many_solves_as_it_reports():
    law, solved = Gaussian(), []

    def full(theta):
        solved.append(len(theta))
        return law(theta), None

    model = Model(None, full, map, np.random.RandomState(0))
    start = law.sample(np.random.default_rng(1), (12,))
    state = emcee.State(start, log_prob=law(start))
    move = DelayedAcceptanceMove(DEMCMove(), wrong(law))
    for _ in range(50):
        before = state.coords.copy()
        state, accepted = move.propose(model, state)
        np.testing.assert_array_equal((state.coords != before).any(axis=1), accepted)
        np.testing.assert_allclose(state.log_prob, law(state.coords))
    assert sum(solved) == move.full_solves and 0 not in solved
    assert move.proposed == 600


def test_walkers_that_another_move_changed_are_screened_anew():
    law, asked = Gaussian(), []

    def cheap(theta):
        asked.append(len(theta))
        return wrong(law)(theta)

    move = DelayedAcceptanceMove(DEMCMove(), cheap)
    model = Model(None, lambda q: (law(q), None), map, np.random.RandomState(0))
    start = law.sample(np.random.default_rng(1), (12,))
    state = emcee.State(start, log_prob=law(start))
    state, _ = move.propose(model, state)
    assert asked == [12, 6, 6]  # the start, then both halves
    state.coords[3] += 0.1
    state.log_prob[3] = law(state.coords[3:4])[0]
    move.propose(model, state)
    assert asked[3:] == [1, 6, 6]
    np.testing.assert_allclose(move._known[1], cheap(move._known[0]))


class Lines:
    """Three frequencies that are linear in two parameters, all off by a shift."""

    variables = ef.modal_variables(3)

    def __init__(self, shift=0.0):
        self.shift = shift

    def __call__(self, parameters):
        a, b = parameters["a"] + self.shift, parameters["b"]
        frequencies = np.column_stack([100 + a, 150 + a + 2 * b, 200 - b])
        return ModalSolution(frequencies)


PRIOR = ef.IndependentPrior({"a": uniform(-6, 12), "b": uniform(-6, 12)})
TERM = ef.FrequencyTerm([101.0, 149.0, 201.0], sd=1.0)
POSTERIOR = ef.LogPosterior(Lines(), TERM, PRIOR)
DESIGN = np.array([[1, 0], [1, 2], [0, -1]])
MEAN = np.linalg.lstsq(DESIGN, np.array([1.0, -1.0, 1.0]))[0]
COVARIANCE = np.linalg.inv(DESIGN.T @ DESIGN)


def assert_exact_moments(draws):
    error = draws.mean(axis=1).std(axis=0) * np.sqrt(30 / len(draws))  # tau below 30
    assert (np.abs(draws.mean(axis=(0, 1)) - MEAN) < 3 * error).all()
    found = np.cov(draws.reshape(-1, 2).T)
    np.testing.assert_allclose(found, COVARIANCE, atol=0.15 * COVARIANCE.max())


def test_a_run_with_a_biased_model_has_the_moments_of_the_full_one():
    cheap = ef.LogPosterior(Lines(shift=0.5), TERM, PRIOR)
    move = DelayedAcceptanceMove(DEMCMove(), cheap)
    (sampler,) = ef.run(POSTERIOR, move, 20, 1_200, seed=1)
    assert_exact_moments(sampler.get_chain(discard=200))
    assert move.full_solves < 0.7 * move.proposed


@pytest.mark.slow
def test_inside_a_tempered_move_the_cold_walkers_keep_the_posterior():
    cheap = ef.LogPosterior(Lines(shift=0.5), TERM, PRIOR)
    move = TemperedMove(DelayedAcceptanceMove(DEMCMove(), cheap), [1.0, 0.3])
    (sampler,) = ef.run(POSTERIOR, move, 40, 2_000, seed=2)
    assert_exact_moments(sampler.get_chain(discard=200)[:, move.cold(40)])


def test_a_solver_that_raises_leaves_the_screen_consistent():
    law = Gaussian()

    def cheap(theta):  # nearly flat, so that every half has proposals to solve
        return 0.05 * law(theta)

    start = law.sample(np.random.default_rng(1), (12,))
    state = emcee.State(start, log_prob=law(start))
    move, calls = DelayedAcceptanceMove(DEMCMove(), cheap), []

    def breaks_in_the_second_half(theta):
        calls.append(1)
        if len(calls) == 4:
            raise RuntimeError("solver")
        return law(theta), None

    model = Model(None, breaks_in_the_second_half, map, np.random.RandomState(0))
    state, _ = move.propose(model, state)
    before = state.coords.copy()
    with pytest.raises(RuntimeError, match="solver"):
        move.propose(model, state)
    assert (state.coords != before).any()  # the first half had moved
    np.testing.assert_allclose(move._known[1], cheap(move._known[0]))


def test_the_cheap_posterior_must_be_finite_where_the_walkers_are():
    law = BoundedTriangle()

    def narrow(theta):
        return np.where(theta[:, 0] < 0.5, 0.0, -np.inf)

    move = DelayedAcceptanceMove(DEMCMove(), narrow)
    with pytest.raises(ValueError, match="cheap: -inf at walker .* narrower"):
        exact_start(move, law, 10, ensembles=2)


@pytest.mark.parametrize(
    ("cheap", "message"),
    [
        (lambda x: np.zeros(3), r"expected 10 log-probabilities .* shape \(3,\)"),
        (lambda x: np.full(len(x), np.nan), "cheap: nan at"),
        (lambda x: np.full(len(x), np.inf), "cheap: inf at"),
    ],
)
def test_what_the_cheap_posterior_returns_is_checked(cheap, message):
    with pytest.raises(ValueError, match=message):
        exact_start(DelayedAcceptanceMove(DEMCMove(), cheap), Gaussian(), 10, 2)


def test_arguments_are_checked():
    cheap = Gaussian()
    with pytest.raises(TypeError, match="cheap: expected a callable"):
        DelayedAcceptanceMove(DEMCMove(), 3)
    tempered = TemperedMove(DEMCMove(), [1.0, 0.0])
    for inner in (tempered, DelayedAcceptanceMove(DEMCMove(), cheap), DEMCMove, None):
        with pytest.raises(TypeError, match="inner: expected"):
            DelayedAcceptanceMove(inner, cheap)
    with pytest.raises(ValueError, match="nwalkers"):
        DelayedAcceptanceMove(DEMCMove(), cheap).check(2, 3)
    with pytest.raises(RuntimeError, match=r"\(DEMove\(live_dangerously=True\) allows"):
        DelayedAcceptanceMove(emcee.moves.DEMove(), cheap).check(4, 3)
