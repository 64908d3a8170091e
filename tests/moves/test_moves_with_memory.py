"""Moves that remember: of each ensemble its own, kept in a file or refused there."""

import threading
from concurrent.futures import ThreadPoolExecutor

import emcee
import numpy as np
import pytest
from scipy import stats
from support.archive import (
    ArchiveMove,
    Forgetful,
    GuidedByThePast,
    GuidedByWhatIsKept,
    Impatient,
)
from support.free_posterior import box, free_posterior
from support.stored import bits, posed, sampled

import emcee_femu as ef

LADDER = [1.0, 0.3]
Delayed = ef.moves.DelayedAcceptanceMove


def cheap(theta):
    return -0.5 * (theta**2).sum(axis=1)


def tempered(inner):
    return ef.moves.TemperedMove(inner, LADDER)


SEQUENTIAL = emcee.moves.GaussianMove(0.1, mode="sequential")
REMEMBERING = {  # they say what
    "archive": ArchiveMove(),
    "beside another": [(ef.DEMCMove(), 0.5), (ArchiveMove(), 0.5)],
    "screened": Delayed(GuidedByWhatIsKept(), cheap, (1, 4)),
    "at powers": tempered(Delayed(GuidedByWhatIsKept(), cheap)),
}
FORGETFUL = {  # they do not
    "archive": Forgetful(),
    "beside another": [(ef.DEMCMove(), 0.5), (Forgetful(), 0.5)],
    "factor": Impatient(),
    "inner": GuidedByThePast(),
    "screened": Delayed(GuidedByThePast(), cheap),
    "at powers": tempered(GuidedByThePast()),
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


def by_function(theta, random):
    return theta + 0.1 * random.standard_normal(theta.shape), np.zeros(len(theta))


MEMORYLESS = {
    "counts": Own(),
    "KDE": emcee.moves.KDEMove(),
    "random": emcee.moves.GaussianMove([0.1, 0.2], mode="random"),
    "function": emcee.moves.MHMove(by_function),
    "all": [(emcee.moves.DEMove(), 0.5), (emcee.moves.StretchMove(), 0.5)],
}


@pytest.fixture
def path(tmp_path):
    return tmp_path / "run.chain"


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
    name = "Forgetful|Impatient|GuidedByThePast|GaussianMove"
    with pytest.raises(ValueError, match=rf"moves: .*({name})"):
        sampled(path, moves=move, steps=40)


@pytest.mark.parametrize("kept", [1, 2])
def test_memory_that_a_stored_step_does_not_need_is_not_refused(path, kept):
    """Of two parameters in turn, both are moved between the steps that are stored."""
    options = {"moves": SEQUENTIAL, "thin_by": 2 * kept}
    whole = bits(sampled(None, steps=6, **options))
    sampled(path, steps=3, **options)
    assert bits(sampled(path, steps=6, **options)) == whole


OWN = {
    "DE-MC": [(ef.DEMCMove(nsplits=4, mode_jump=0.3), 0.5),
              (ef.MetropolisMove(sd=20.0), 0.5)],
    "mixture": ef.IndependenceMove(
        [0.5, 0.5], [[3000.0] * 5] * 2, [2e6 * np.eye(5)] * 2
    ),
    "Hamiltonian": ef.moves.HamiltonianMove(steps=3),
    "screened": Delayed(ef.DEMCMove(), lambda x: -1e-8 * (x**2).sum(axis=1), (1, 5)),
    "at powers": tempered(ef.DEMCMove()),
}  # fmt: skip


@pytest.mark.parametrize("move", OWN.values(), ids=OWN)
def test_the_packages_own_moves_remember_nothing_that_decides(path, move):
    posterior = ef.paper.mass_spring().posterior
    options = {"nwalkers": 24, "ensembles": 2, "seed": 1}

    def chains(steps, **more):
        samplers = ef.run(posterior, move, steps=steps, **options, **more)
        return [sampler.get_chain() for sampler in samplers]

    whole = chains(8)
    chains(3, backend=path)
    np.testing.assert_array_equal(chains(8, backend=path, resume=True), whole)
    assert np.ptp(whole, axis=1).any()


def test_the_archive_of_every_ensemble_gives_the_law():
    posterior = free_posterior(cheap, box(-8, 8, 2))
    samplers = ef.run(posterior, ArchiveMove(10), 10, 150, ensembles=12, seed=1)
    x = np.stack([s.get_chain(discard=50, flat=True) for s in samplers])
    for values, expected in ((x, 0.0), (x**2, 1.0)):
        means = values.mean(axis=1)
        z = stats.ttest_1samp(means, expected).pvalue
        assert (z > 1e-5).all()


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
    def forbidden(p):
        raise AssertionError("solved")

    posterior = posed(model=ef.FunctionModel(forbidden, n_modes=3), term=lambda p, r: 0)
    with pytest.raises(TypeError, match="Locked.*lock"):
        ef.run(posterior, Locked(), seed=1)
