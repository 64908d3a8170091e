"""The burn-in of "auto" in files: a stop at any time costs a generation or a trial."""

import os

import numpy as np
import pytest

import emcee_femu as ef

PROBLEM = ef.paper.mass_spring()
OPTIONS = {"nwalkers": 12, "nsteps": 40, "ensembles": 2, "seed": 1}


@pytest.fixture(autouse=True, scope="module")
def short_burn_in():
    """A burn-in that is doubled once or twice, and takes no seconds."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ef.sampling.auto, "FIRST", 32)
        patch.setattr(ef.sampling.auto, "ENOUGH_TAU", 6)
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


def test_a_stop_at_any_time_costs_a_generation_or_a_trial(whole, tmp_path):
    calls, samplers = whole
    path = tmp_path / "run.chain"
    spent, held = 0, set()
    for share in (0.01, 0.2, 0.25, 0.3, 0.2):  # of all calls, then to the end
        part, stopped = sampled(int(share * calls), backend=path, resume=True)
        assert isinstance(stopped, KeyboardInterrupt)
        assert len(stopped.samplers) == 2
        spent += part
        held.update(files(path))
    part, found = sampled(backend=path, resume=True)
    assert held == {"run.chain.burn-in", "run.chain"}
    assert files(path) == ["run.chain"]
    # Each stop: a probe of two ensembles, and the two calls of a generation.
    # The last one may have stopped the trial of the fit, which is not stored.
    trial = 2 * ef.sampling.auto.TRIAL
    assert calls < spent + part <= calls + 5 * (2 + 2) + trial < 1.2 * calls
    for one, other in zip(samplers, found, strict=True):
        np.testing.assert_array_equal(one.get_chain(), other.get_chain())
        np.testing.assert_array_equal(one.get_blobs(), other.get_blobs())
        assert one.recipe == other.recipe
        assert one.burn_in_evaluations == other.burn_in_evaluations


def test_a_burn_in_that_was_stopped_is_not_run_over_and_not_mixed(tmp_path):
    path = tmp_path / "run.chain"
    sampled(200, backend=path)
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
    sampled(200, backend=path)
    left = beside.read_bytes()
    sampled(backend=path, resume=True)
    beside.write_bytes(left)  # killed between making one and removing the other
    sampled(backend=path, resume=True)
    assert files(path) == ["run.chain"]
    beside.write_text("mine")
    with pytest.raises(ValueError, match="expected the file of a run.*burn-in"):
        sampled(backend=path, resume=True)
    assert beside.read_text() == "mine"


def test_without_a_file_the_burn_in_so_far_is_kept():
    _, stopped = sampled(60)
    chains = [sampler.get_chain() for sampler in stopped.samplers if sampler.iteration]
    assert len(chains) == 1 and 10 < len(chains[0]) <= 32
