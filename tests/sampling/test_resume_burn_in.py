"""The search of "auto" in files: a stop at any time costs one batch."""

import os
import re

import numpy as np
import pytest

import emcee_femu as ef

PROBLEM = ef.paper.mass_spring()
OPTIONS = {"nwalkers": 12, "nsteps": 40, "ensembles": 2, "seed": 1}


@pytest.fixture(autouse=True, scope="module")
def small_search():
    """A search that takes no seconds."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ef.sampling.auto, "FEWEST", 100)
        patch.setattr(ef.sampling.auto, "ROUND", 200)
        yield


class Counted:
    """The paper's model, which counts its calls and stops at one of them."""

    names, variables = PROBLEM.model.names, ef.modal_variables(5)

    def __init__(self):
        self.calls = 0

    def __call__(self, parameters):
        self.calls += 1
        if self.calls == int(os.environ.get("STOP_AT", "0")):
            raise KeyboardInterrupt
        return PROBLEM.model(parameters)


def sampled(stop=0, **options):
    """Return how often the model was called, and the samplers or what stopped them."""
    os.environ["STOP_AT"] = str(stop)  # it is no part of the model
    model = Counted()
    posterior = ef.LogPosterior(model, PROBLEM.posterior.terms, PROBLEM.posterior.prior)
    try:
        result = ef.run(posterior, "auto", **{**OPTIONS, **options})
    except KeyboardInterrupt as error:
        result = error
    finally:
        del os.environ["STOP_AT"]
    return model.calls, result


@pytest.fixture(scope="module")
def whole():
    return sampled()


def files(path):
    return sorted(file.name for file in path.parent.iterdir())


def test_a_stop_at_any_time_costs_a_batch(whole, tmp_path):
    calls, samplers = whole
    path = tmp_path / "run.chain"
    held = set()
    stops = [int(share * calls) for share in (0.02, 0.1, 0.2, 0.3, 0.2)]
    for stop in stops:  # counted anew each time
        _, stopped = sampled(stop, backend=path, resume=True)
        assert isinstance(stopped, KeyboardInterrupt)
        held.update(files(path))
    part, found = sampled(backend=path, resume=True)
    assert held == {"run.chain.burn-in", "run.chain"}
    assert files(path) == ["run.chain"]
    # Each stop: a probe of each ensemble, and what was lost with the batch.
    assert sum(stops) + part <= calls + len(stops) * (2 + 2) < 1.2 * calls
    for one, other in zip(samplers, found, strict=True):
        np.testing.assert_array_equal(one.get_chain(), other.get_chain())
        np.testing.assert_array_equal(one.get_blobs(), other.get_blobs())
        assert str(one.recipe) == str(other.recipe)
        assert one.recipe.record == other.recipe.record
        assert one.burn_in_evaluations == other.burn_in_evaluations


def test_a_torn_batch_is_evaluated_again(whole, tmp_path):
    path, beside = tmp_path / "run.chain", tmp_path / "run.chain.burn-in"
    sampled(10, backend=path)
    content = beside.read_bytes()
    for cut in (1, 5, 200):
        beside.write_bytes(content[:-cut])
        assert isinstance(sampled(4, backend=path, resume=True)[1], KeyboardInterrupt)
    _, found = sampled(backend=path, resume=True)
    np.testing.assert_array_equal(found[0].get_chain(), whole[1][0].get_chain())


@pytest.mark.parametrize("byte", [-100, -2_000])
def test_a_damaged_batch_is_named_and_nothing_is_cut(byte, whole, tmp_path):
    path, beside = tmp_path / "run.chain", tmp_path / "run.chain.burn-in"
    sampled(10, backend=path)
    content = bytearray(beside.read_bytes())
    content[byte] ^= 1
    beside.write_bytes(content)
    with pytest.raises(ValueError, match=r"burn-in is damaged at byte (\d+)") as error:
        sampled(backend=path, resume=True)
    assert beside.read_bytes() == content
    os.truncate(beside, int(re.search(r"byte (\d+)", str(error.value))[1]))
    _, found = sampled(backend=path, resume=True)
    np.testing.assert_array_equal(found[0].get_chain(), whole[1][0].get_chain())


def test_a_search_that_takes_another_way_is_refused(tmp_path, monkeypatch):
    path = tmp_path / "run.chain"
    sampled(8, backend=path)
    monkeypatch.setattr(ef.sampling.search, "WIDER", 3.0)
    monkeypatch.setattr(ef.sampling.search, "FIRST_DF", 4.0)
    monkeypatch.setattr(
        ef.GaussianPrior, "sample", lambda self, rng, n: self.mean + np.zeros((n, 5))
    )
    with pytest.raises(ValueError, match=r"search does not take the way .*burn-in"):
        sampled(backend=path, resume=True)


def test_a_burn_in_that_was_stopped_is_not_run_over_and_not_mixed(tmp_path):
    path = tmp_path / "run.chain"
    sampled(8, backend=path)
    before = (tmp_path / "run.chain.burn-in").read_bytes()
    with pytest.raises(ValueError, match=r"run.chain.burn-in exists; go on .* resume"):
        sampled(backend=path)
    with pytest.raises(ValueError, match=r"burn-in holds a run of .*\n  seed: was 1"):
        sampled(backend=path, resume=True, seed=2)
    assert (tmp_path / "run.chain.burn-in").read_bytes() == before
    assert files(path) == ["run.chain.burn-in"]


def test_a_foreign_file_in_its_place_is_left_as_it_is(tmp_path):
    path, beside = tmp_path / "run.chain", tmp_path / "run.chain.burn-in"
    beside.write_text("mine")
    with pytest.raises(ValueError, match="expected the file of a run.*burn-in"):
        sampled(backend=path, resume=True)
    assert beside.read_text() == "mine"


def test_files_of_a_burn_in_that_a_kill_left_are_removed(tmp_path):
    path, beside = tmp_path / "run.chain", tmp_path / "run.chain.burn-in"
    sampled(8, backend=path)
    left = beside.read_bytes()
    sampled(backend=path, resume=True)
    beside.write_bytes(left)  # killed between making one and removing the other
    sampled(backend=path, resume=True)
    assert files(path) == ["run.chain"]
    beside.write_text("mine")
    with pytest.raises(ValueError, match="expected the file of a run.*burn-in"):
        sampled(backend=path, resume=True)
    assert beside.read_text() == "mine"
