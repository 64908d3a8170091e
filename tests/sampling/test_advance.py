"""A run without steps= ends by its own verdict, and is the same however it is made."""

import time
import warnings
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from support.free_posterior import box, free_posterior

import emcee_femu as ef
from emcee_femu.search.settings import SETTINGS
from emcee_femu.verdict.verdict import SD_KNOWN_TO

OPTIONS = {"nwalkers": 8, "ensembles": 4, "seed": 1}


def gaussian(x):
    return -0.5 * (x**2).sum(axis=1)


POSTERIOR = free_posterior(gaussian, box(-9, 9, 2))
WIDE = ef.IndependenceMove([1.0], [[0.0, 0.0]], [2.0 * np.eye(2)])


def run(**changes):
    return ef.run(POSTERIOR, **{"moves": WIDE} | OPTIONS | changes)


def chains(found):
    return np.stack([sampler.get_chain() for sampler in found])


LONG_RUN = "emcee_femu.sampling.run.LONG_RUN"
LOOKS = [30]
while LOOKS[-1] < 5_000:
    LOOKS.append(int(np.ceil(1.15 * LOOKS[-1])))


@pytest.fixture(scope="module")
def ended():
    return run(ess=2_000)


def test_it_ends_when_it_has_converged_and_is_long_enough(ended):
    found = ef.diagnose(ended)
    assert ended.stopped == "converged" and found.converged
    assert min(found.ess_bulk.min(), found.ess_tail.min()) >= 2_000
    assert ended.solves < 200_000
    # At the look before it was not: too few effective samples, or not converged.
    before = max([n for n in LOOKS if n < ended[0].iteration])
    shorter = run(steps=before)  # the same seed: the same chain
    assert shorter.stopped == "steps" and shorter[0].iteration == before
    earlier = ef.diagnose(shorter)
    least = min(earlier.ess_bulk.min(), earlier.ess_tail.min())
    assert not earlier.chains.status.startswith("converged") or least < 2_000


@pytest.mark.slow
def test_auto_ends_when_every_standard_deviation_is_known(monkeypatch):
    auto = {"seed": 2, "ess": 2_000}
    ended = ef.run(POSTERIOR, **auto)
    errors = ef.diagnose(ended).sd_error
    settings = replace(SETTINGS, sd_at_end=errors.mean())
    monkeypatch.setattr("emcee_femu.sampling.advance.SETTINGS", settings)
    longer = ef.run(POSTERIOR, **auto)  # one was known as well before, but not both
    assert longer[0].iteration > ended[0].iteration
    assert ef.diagnose(longer).sd_error.max() <= errors.mean() < errors.max()


def heavy(x):
    """The log-density of a Gaussian, 1.5 % of which is six times as wide."""
    squares = (x**2).sum(axis=1)
    return np.logaddexp(-squares / 2, np.log(0.015 / 6**2) - squares / 72)


def test_given_moves_end_as_soon_as_the_verdict_calls_them_converged():
    """They claim of a heavy tail what the verdict allows, and no less."""
    both = ef.IndependenceMove(
        [0.5, 0.5], np.zeros((2, 2)), [np.eye(2), 36 * np.eye(2)]
    )
    options = {"moves": both, **OPTIONS}
    posterior = free_posterior(heavy, box(-40, 40, 2))
    found = ef.run(posterior, ess=100, **options)
    assert found.stopped == "converged" and ef.diagnose(found).converged
    assert SETTINGS.sd_at_end < ef.diagnose(found).sd_error.max() <= SD_KNOWN_TO
    before = max(n for n in LOOKS if n < found[0].iteration)
    assert not ef.diagnose(ef.run(posterior, steps=before, **options)).converged


@pytest.mark.slow
def test_tails_are_as_well_known_as_the_centre_then():
    """Of a proposal that is too narrow: walkers wait in tails."""
    narrow = ef.IndependenceMove([1.0], [[0.0, 0.0]], [0.5 * np.eye(2)], 5.0)
    before = ef.diagnose(run(moves=narrow, ess=2_000))
    centre, tail = before.ess_bulk.min(), before.ess_tail.min()
    found = run(moves=narrow, ess=(centre + tail) / 2)
    assert tail < (centre + tail) / 2 <= ef.diagnose(found).ess_tail.min()


@pytest.mark.slow
def test_it_ends_when_its_solves_are_spent_and_goes_on_with_more(tmp_path, ended):
    file = {"backend": str(tmp_path / "run.chain"), "resume": True, "ess": 2_000}
    first = run(solves=2_000, **file)
    assert first.stopped == "solves" and first.solves <= 2_000
    assert ef.diagnose(file["backend"]).ess_bulk.min() < 2_000
    second = run(**file)
    assert second.stopped == "converged"
    for found in (second, run(**file)):  # which has ended already
        assert_array_equal(chains(found), chains(ended))


@pytest.mark.slow
def test_workers_change_nothing():
    one, two = (run(ess=400, workers=number) for number in (None, 2))
    assert one.stopped == "converged" and one[0].iteration > LOOKS[1]
    assert_array_equal(chains(one), chains(two))


def test_one_ensemble_ends_when_it_is_well_mixed():
    found = run(ensembles=1, ess=2_000)
    assert found.stopped == "converged"
    assert ef.diagnose(found).chains.status == "well mixed"


def test_auto_has_a_search_within_its_solves():
    found = ef.run(POSTERIOR, seed=2, ess=2_000)
    assert found.stopped == "converged" and found.search.solves < found.solves < 20_000
    with pytest.raises(ValueError, match="solves"):
        ef.run(POSTERIOR, seed=2, solves=500)


def sleepy(calls, slow):
    """Return a law whose first calls are slow."""

    def law(x):
        calls.append(len(x))
        if len(calls) <= slow:
            time.sleep(0.3)
        return gaussian(x)

    return law


@pytest.mark.parametrize("slow", [1, 2, 4])
def test_a_batch_is_timed_where_the_first_solve_looks_slow(slow, monkeypatch):
    """The fastest of three calls counts, each of half of the walkers, as in the run."""
    calls = []
    # Far from .3 s / 5 and from nothing, for so many evaluations.
    monkeypatch.setattr(LONG_RUN, 4 * 10 * 4 * 0.02)
    posterior = free_posterior(sleepy(calls, slow), box(-9, 9, 2))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        ef.run(posterior, ef.DEMCMove(), 10, 4, seed=1)
    assert calls[:4] == [1, 5, 5, 5]
    assert len(caught) == (slow == 4)


@pytest.mark.parametrize(("seconds", "timed"), [(0.02, 3), (0.12, 0)])
def test_a_function_of_one_point_is_timed_again_if_it_is_fast(
    seconds, timed, monkeypatch
):
    """So that what the first call loads is not taken for a solve, nor many solved."""
    calls = []

    def law(x):
        calls.append(x.tolist())
        if not timed or len(calls) == 1:
            time.sleep(seconds)
        return -0.5 * x @ x

    posterior = ef.LogPosterior.from_function(law, {"a": (-9, 9), "b": (-9, 9)})
    calls.clear()  # those by which blobs are known
    monkeypatch.setattr(LONG_RUN, 10 * 0.01)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        ef.run(posterior, ef.DEMCMove(), 10, 1, ensembles=1, seed=1)
    assert calls.count([0.0, 0.0]) == 1 + timed
    assert len(caught) == (not timed)
    for one in caught:  # neither an emulator nor a reduction knows a bare density
        assert "emulate" not in str(one.message) and "reduce" not in str(one.message)
        assert "minutes" in str(one.message)


def test_a_stopped_search_goes_on_with_its_budget(tmp_path, monkeypatch):
    budgets = []

    def stop(*arguments):
        budgets.append(arguments[5])
        raise RuntimeError("stopped")

    monkeypatch.setattr("emcee_femu.sampling.run.search_and_start", stop)
    file = {"backend": str(tmp_path / "run.chain"), "resume": True}
    for solves in (20_000, 100_000):
        with pytest.raises(RuntimeError, match="stopped"):
            ef.run(POSTERIOR, seed=1, solves=solves, **file)
    assert budgets == [10_000, 10_000]


def test_a_worker_that_imports_for_its_first_solve_is_timed_again(monkeypatch):
    calls, prior = [], {"a": (-9, 9), "b": (-9, 9)}
    law = sleepy(calls, 1)
    monkeypatch.setattr(LONG_RUN, 4 * 10 * 4 * 0.1)
    draws = ef.LogPosterior.from_function(lambda x: law(x[None])[0], prior)
    calls.clear()  # those by which blobs are known
    with ThreadPoolExecutor(2) as pool, warnings.catch_warnings():
        warnings.simplefilter("error")
        ef.run(draws, ef.DEMCMove(), 10, 4, seed=1, pool=pool)


def test_starts_are_drawn_until_they_are_possible():
    """A twentieth of the prior is possible: of 40 starts 20 draws would miss 14."""

    def lower(x):
        return np.where(x[:, 0] < 0.05, -x[:, 0], -np.inf)

    posterior = ef.LogPosterior.from_function(lower, {"a": (0, 1)}, vectorize=True)
    (found, *_) = ef.run(posterior, ef.DEMCMove(), 10, 2, seed=1)
    assert (found.get_chain() < 0.05).all()
