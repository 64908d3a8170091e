"""The moves keep their target: exact-start tests, and mutants that must fail them."""

import emcee
import numpy as np
import pytest
from support.checks import LIMIT, BoundedTriangle, Gaussian, exact_start

from emcee_femu.moves import DEMCMove, MetropolisMove
from emcee_femu.moves.red_blue import VectorizedRedBlueMove

TARGETS = {"gaussian": Gaussian, "bounded": BoundedTriangle}
SCALES = {"unit": (1.0, 1.0, 1.0), "areas beside stiffnesses": (1e-8, 1.0, 1e8)}
SETTINGS = {
    "default": {},
    "fixed noise": {"sigma": 0.05},
    "noise a parameter": {"sigma": [0.0, 0.02, 0.3]},
    "no noise": {"sigma": 0.0},
    "short steps": {"gamma0": 0.4},
    "mode jumps": {"mode_jump": 0.5},
    "four splits": {"nsplits": 4},
    "one after another": {"nsplits": "nwalkers"},
    "fixed splits": {"randomize_split": False},
}


def demc(nwalkers, **settings):
    if settings.get("nsplits") == "nwalkers":
        settings["nsplits"] = nwalkers
    return DEMCMove(live_dangerously=True, **settings)


@pytest.mark.parametrize("target", TARGETS)
@pytest.mark.parametrize("nwalkers", [4, 6, 10, 32])
def test_demc_keeps_the_target_for_any_number_of_walkers(target, nwalkers):
    assert exact_start(demc(nwalkers), TARGETS[target](), nwalkers) < LIMIT


@pytest.mark.parametrize("target", TARGETS)
@pytest.mark.parametrize("setting", SETTINGS)
def test_demc_keeps_the_target_with_every_setting(target, setting):
    move = demc(6, **SETTINGS[setting])
    assert exact_start(move, TARGETS[target](), 6, steps=6) < LIMIT


@pytest.mark.parametrize("target", TARGETS)
def test_demc_keeps_targets_whose_axes_differ_by_1e16(target):
    scaled = TARGETS[target](SCALES["areas beside stiffnesses"])
    assert exact_start(demc(10), scaled, 10) < LIMIT


@pytest.mark.parametrize("scale", SCALES)
@pytest.mark.parametrize("target", TARGETS)
@pytest.mark.parametrize("shape", ["sd", "covariance", "tuned"])
@pytest.mark.parametrize("nwalkers", [1, 6])
def test_metropolis_keeps_the_target(scale, target, shape, nwalkers):
    law = TARGETS[target](SCALES[scale])
    if shape == "tuned":
        move = MetropolisMove.tuned(law.sample(np.random.default_rng(5), (500,)))
    else:
        sd = 0.6 * law.scale
        covariance = np.outer(sd, sd) * (0.5 + 0.5 * np.eye(3))
        given = {"sd": sd} if shape == "sd" else {"cov": covariance}
        move = MetropolisMove(**given)
    assert exact_start(move, law, nwalkers) < LIMIT


def test_scaled_axes_give_the_same_chain_as_unit_axes():
    # The default noise follows the walkers, so a change of units changes nothing.
    def chain(scale):
        target = Gaussian(scale)
        start = target.sample(np.random.default_rng(1), (10,))
        sampler = emcee.EnsembleSampler(10, 3, target, moves=DEMCMove(), vectorize=True)
        sampler.run_mcmc(
            emcee.State(start, random_state=np.random.RandomState(1).get_state()), 200
        )
        return sampler.get_chain() / target.scale

    scale = 2.0 ** np.array([-27.0, 0.0, 27.0])  # exact in floating point
    np.testing.assert_allclose(chain(scale), chain((1, 1, 1)), rtol=1e-9)


# Mutants: each breaks the move in one way, and the test above must see it.


class Synchronous(DEMCMove):
    """Moves all walkers from one generation."""

    def propose(self, model, state):
        frozen = state.coords.copy()
        nwalkers = len(frozen)
        proposed = np.empty_like(frozen)
        for i in range(nwalkers):
            others = [np.delete(frozen, i, axis=0)]
            proposed[i], _ = self.get_proposal(frozen[i : i + 1], others, model.random)
        log_prob, _ = model.compute_log_prob_fn(proposed)
        uniform = np.log(model.random.rand(nwalkers))
        accepted = log_prob - state.log_prob > uniform
        state.coords[accepted] = proposed[accepted]
        state.log_prob[accepted] = log_prob[accepted]
        return state, accepted


class GuidedByItself(DEMCMove):
    """May take the walker that it moves for one of the pair."""

    def get_proposal(self, s, c, random):
        proposed = [
            super(GuidedByItself, self).get_proposal(
                one[None], [np.vstack([*c, one])], random
            )[0]
            for one in s
        ]
        return np.vstack(proposed), None


class OneSign(DEMCMove):
    """Takes differences of one sign only along the first axis."""

    def get_proposal(self, s, c, random):
        proposed, _ = super().get_proposal(s, c, random)
        step = proposed - s
        return s + np.where(step[:, :1] < 0, -step, step), None


class AcceptsWithoutLimit(DEMCMove):
    """Accepts what ``wrong`` says, whatever the Metropolis ratio."""

    def __init__(self, wrong, **settings):
        super().__init__(**settings)
        self.wrong = wrong

    def propose(self, model, state):
        def generous(q):
            log_prob, blobs = model.compute_log_prob_fn(q)
            return np.where(self.wrong(log_prob).astype(bool), 1e300, log_prob), blobs

        state, accepted = super().propose(
            model._replace(compute_log_prob_fn=generous), state
        )
        state.log_prob[:] = model.compute_log_prob_fn(state.coords)[0]
        return state, accepted


class AsymmetricMetropolis(MetropolisMove):
    """Steps by a scale that depends on where the walker is."""

    def propose(self, model, state):
        scaled = MetropolisMove(sd=0.1 + 0.5 * np.abs(state.coords[0, 0] - 3))
        return scaled.propose(model, state)


MUTANTS = {
    "all from one generation": (Synchronous(live_dangerously=True), Gaussian, 4),
    "guided by itself": (GuidedByItself(live_dangerously=True), Gaussian, 4),
    "differences of one sign": (OneSign(), Gaussian, 6),
    "-inf accepted": (AcceptsWithoutLimit(np.isneginf), BoundedTriangle, 6),
    "all accepted": (AcceptsWithoutLimit(np.ones_like), Gaussian, 6),
    "asymmetric steps": (AsymmetricMetropolis(sd=0.5), Gaussian, 1),
}


@pytest.mark.parametrize("mutant", MUTANTS)
def test_the_check_catches_a_broken_move(mutant):
    move, target, nwalkers = MUTANTS[mutant]
    # The bias of the first is the smallest, 13 % of a variance.
    ensembles = 6_000 if isinstance(move, Synchronous) else 2_000
    z = exact_start(move, target(), nwalkers, ensembles=ensembles, steps=15)
    assert z > LIMIT


@pytest.mark.slow
@pytest.mark.parametrize("target", TARGETS)
@pytest.mark.parametrize("nwalkers", [4, 6])
def test_demc_keeps_the_target_at_high_power(target, nwalkers):
    # Twenty times the ensembles, where a bias of the synchronous kind cannot hide.
    move = demc(nwalkers)
    law = TARGETS[target]()
    assert exact_start(move, law, nwalkers, ensembles=12_000, steps=25) < LIMIT


def test_the_base_class_offers_emcees_contract():
    assert issubclass(VectorizedRedBlueMove, emcee.moves.RedBlueMove)
