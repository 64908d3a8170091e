"""Moves that remember: of each ensemble its own, kept in a file or refused there."""

import threading
from concurrent.futures import ThreadPoolExecutor

import emcee
import numpy as np
import pytest
from support.gradients import PRIOR, TERM, Failing
from support.runs import never
from support.stored import bits, posed, sampled

import emcee_femu as ef

LADDER = [1.0, 0.3]
Delayed = ef.moves.DelayedAcceptanceMove


def cheap(theta):
    return -0.5 * (theta**2).sum(axis=1)


def tempered(inner):
    return ef.moves.TemperedMove(inner, LADDER)


class Impatient(emcee.moves.MHMove):
    """Proposes as it ever did, and after some calls refuses all: a wrong factor."""

    def __init__(self):
        super().__init__(self.step)
        self.calls = 0

    def step(self, coords, rng):
        self.calls += 1
        proposed = coords + 0.1 * rng.standard_normal(coords.shape)
        return proposed, np.full(len(coords), -1e9 * (self.calls > 6))


class Forgetful(ef.DEMCMove):
    """DE-MC whose guides are past positions of the other walkers, not present ones."""

    def __init__(self):
        super().__init__()
        self.past = []

    def get_proposal(self, sample, complement, rng):
        self.past = [*self.past, *np.concatenate(complement).tolist()][-60:]
        return super().get_proposal(sample, [np.array(self.past)], rng)


class Remembering(Forgetful):
    """The same, which says what must be kept."""

    def state(self):
        return self.past

    def restore(self, state):
        self.past = state


SEQUENTIAL = emcee.moves.GaussianMove(0.1, mode="sequential")
REMEMBERING = {
    "alone": Remembering(),
    "beside another": [(ef.DEMCMove(), 0.5), (Remembering(), 0.5)],
    "screened": Delayed(Remembering(), cheap, (1, 4)),
    "at powers": tempered(Delayed(Remembering(), cheap)),
}
FORGETFUL = {
    "alone": Forgetful(),
    "beside another": [(ef.DEMCMove(), 0.5), (Forgetful(), 0.5)],
    "factor": Impatient(),
    "screened": Delayed(Forgetful(), cheap),
    "at powers": tempered(Forgetful()),
    "sequential": SEQUENTIAL,
}


class Own(emcee.moves.StretchMove):
    """Counts, and finds out at first what it needs, which decides nothing."""

    calls, size = 0, None

    def setup(self, coords):
        self.middle = coords.mean(axis=0)

    def propose(self, model, state):
        self.calls, self.size = self.calls + 1, len(state.coords)
        return super().propose(model, state)


MEMORYLESS = {
    "counts": Own(),
    "KDE": emcee.moves.KDEMove(),
    "random": emcee.moves.GaussianMove([0.1, 0.2], mode="random"),
    "function": emcee.moves.MHMove(
        lambda x, rng: (x + 0.1 * rng.standard_normal(x.shape), np.zeros(len(x)))
    ),
    "all": [(emcee.moves.DEMove(), 0.5), (emcee.moves.StretchMove(), 0.5)],
}


@pytest.mark.slow
@pytest.mark.parametrize("move", [*REMEMBERING.values(), *FORGETFUL.values()])
def test_ensembles_share_no_memory_whether_together_or_one_after_another(move):
    serial = bits(sampled(None, moves=move, steps=4))
    with ThreadPoolExecutor(2) as pool:  # nor do runs
        assert serial == bits(sampled(None, moves=move, steps=4, pool=pool))


@pytest.mark.parametrize("move", [*REMEMBERING.values(), *MEMORYLESS.values()])
def test_a_resumed_run_is_that_of_a_move_that_was_never_stopped(path, move):
    whole = bits(sampled(None, moves=move, steps=10))
    for steps in (1, 5, 10):
        resumed = sampled(path, moves=move, steps=steps)
    assert bits(resumed) == whole


@pytest.mark.parametrize("move", FORGETFUL.values())
def test_memory_that_a_file_would_lose_is_refused_by_name(path, move):
    with pytest.raises(ValueError, match="moves: .*(Forgetful|Impatient|Gaussian)"):
        sampled(path, moves=move, steps=40)


@pytest.mark.parametrize("kept", [1, 2])
def test_memory_that_a_stored_step_does_not_need_is_not_refused(path, kept):
    """Of two parameters in turn, both are moved between the steps that are stored."""
    options = {"moves": SEQUENTIAL, "thin_by": 2 * kept}
    whole = bits(sampled(None, steps=6, **options))
    sampled(path, steps=3, **options)
    assert bits(sampled(path, steps=6, **options)) == whole


OWN = {
    "DE-MC": [
        (ef.DEMCMove(nsplits=4, mode_jump=0.3), 0.5),
        (ef.MetropolisMove(sd=0.03), 0.5),
    ],
    "mixture": ef.IndependenceMove([0.5, 0.5], np.ones((2, 2)), [0.01 * np.eye(2)] * 2),
    "Hamiltonian": [
        (ef.moves.HamiltonianMove([0.01, 0.01]), 0.6),
        (ef.DEMCMove(), 0.4),
    ],
    "screened": Delayed(
        ef.DEMCMove(), lambda x: -40 * (x - 1).sum(axis=1) ** 2, (1, 5)
    ),
    "at powers": tempered(ef.DEMCMove()),
}


LONG = {"Hamiltonian"}


@pytest.mark.parametrize(
    "move",
    [
        pytest.param(move, marks=[pytest.mark.slow] * (name in LONG), id=name)
        for name, move in OWN.items()
    ],
)
def test_the_packages_own_moves_remember_nothing_that_decides(path, move):
    """A resumed run is that of one that was never stopped, though solves fail."""
    posterior = ef.LogPosterior(Failing(), TERM, PRIOR)
    options = {"moves": move, "nwalkers": 24}
    whole = sampled(None, posterior, steps=8, **options)
    assert whole.failures.causes["exception"] > 0
    for steps in (3, 8):
        resumed = sampled(path, posterior, steps=steps, **options)
    assert bits(resumed) == bits(whole)
    (first, _) = whole
    rows = posterior(first.get_chain(flat=True))
    stored = first.get_log_prob(flat=True), first.get_blobs(flat=True)
    np.testing.assert_allclose(np.column_stack(stored), rows, rtol=1e-9)
    assert np.ptp(first.get_chain(), axis=0).any()


def test_counts_are_those_of_the_first_ensemble_and_the_given_move_stays_as_it_was():
    move = Delayed(ef.DEMCMove(), cheap, steps=5)
    run = sampled(None, moves=move, steps=7)
    ((own, weight),) = run.moves
    assert own.proposed == 5 * 7 * 12 > own.full_solves >= own.accepted > 0
    assert move.proposed == 0 and weight == 1.0
    assert own.cheap is cheap  # a function, and perhaps a large one, is no memory


class Locked(emcee.moves.StretchMove):
    def __init__(self):
        super().__init__()
        self.lock = threading.Lock()


def test_what_cannot_be_copied_is_refused_by_name_before_a_solve():
    posterior = posed(model=ef.FunctionModel(never, n_modes=3), term=lambda p, r: 0)
    with pytest.raises(TypeError, match="Locked.*lock"):
        ef.run(posterior, Locked(), seed=1)
