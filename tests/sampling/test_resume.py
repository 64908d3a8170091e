"""run(resume=True): the bits of a run that was never stopped, or a clear refusal."""

import subprocess
import sys
from pathlib import Path

import emcee
import numpy as np
import pytest
from scipy import stats

import emcee_femu as ef
from emcee_femu import DEMCMove, IndependenceMove

PROBLEM = ef.paper.mass_spring()
OPTIONS = {"nwalkers": 12, "nsteps": 30, "seed": 1, "ensembles": 2}


def sampled(posterior=PROBLEM.posterior, **options):
    return ef.run(posterior, **{**OPTIONS, **options})


def assert_same(one, other):
    for a, b in zip(one, other, strict=True):
        np.testing.assert_array_equal(a.get_chain(), b.get_chain())
        np.testing.assert_array_equal(a.get_log_prob(), b.get_log_prob())
        np.testing.assert_array_equal(a.get_blobs(), b.get_blobs())


@pytest.fixture
def path(tmp_path):
    return tmp_path / "run.h5"


def killed(kind, path, kills, seed=0):
    script = Path(__file__).parents[1] / "support" / "killed_twice.py"
    command = [sys.executable, str(script), kind, str(path), str(kills), str(seed)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    assert done.stdout.endswith("the same to the bit\n")
    return int(done.stdout.split()[0])


def test_kills_at_random_times_leave_the_bits_of_an_uninterrupted_run(path):
    assert killed("tempered and mixed", path, 6) >= 3


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["tempered", "mixed", "tempered and mixed", "auto"])
def test_twenty_kills_at_random_times(kind, path):
    assert killed(kind, path, 24, seed=1) >= 20


def test_a_longer_run_goes_on_from_a_shorter_one(path):
    sampled(backend=path, nsteps=10)
    longer = sampled(backend=path, resume=True)
    assert_same(longer, sampled())
    again = sampled(backend=path, resume=True)  # nothing is left to do
    assert_same(longer, again)


@pytest.mark.slow
def test_what_auto_found_is_not_sought_again(path, monkeypatch):
    whole = sampled(moves="auto", ensembles=1)
    first = sampled(moves="auto", backend=path, nsteps=10, ensembles=1)

    def never(*arguments):
        raise AssertionError("a second burn-in")

    monkeypatch.setattr(ef.sampling.starts, "burn_in_and_fit", never)
    longer = sampled(moves="auto", backend=path, resume=True, ensembles=1)
    assert_same(longer, whole)
    assert longer[0].recipe == first[0].recipe != ""


def test_a_mixture_made_of_its_own_numbers_is_the_same_to_the_bit():
    draws = np.random.default_rng(0).normal(size=(400, 3))
    draws[:150] += 6
    fitted = IndependenceMove.fit(draws, components=3)
    copy = IndependenceMove(
        fitted.weights.tolist(), fitted.means.tolist(), fitted.scale_matrices.tolist()
    )
    np.testing.assert_array_equal(copy.weights, fitted.weights)
    np.testing.assert_array_equal(copy.log_density(draws), fitted.log_density(draws))


def test_an_interrupted_run_goes_on(path):
    class Interrupted:
        names, variables = PROBLEM.model.names, ef.modal_variables(5)

        def __init__(self):
            self.calls = 0

        def __call__(self, parameters):
            self.calls += 1
            if self.calls == 40:
                raise KeyboardInterrupt
            return PROBLEM.model(parameters)

        def __getstate__(self):  # the count is no part of the model
            return {}

    posterior = PROBLEM.posterior
    stopping = ef.LogPosterior(Interrupted(), posterior.terms, posterior.prior)
    with pytest.raises(KeyboardInterrupt):
        sampled(stopping, backend=path)
    longer = sampled(stopping, backend=path, resume=True)
    assert_same(longer, sampled())


def test_without_a_file_a_new_run_begins(path):
    assert_same(sampled(backend=path, resume=True), sampled())


def test_the_samplers_of_a_file_convert_like_those_in_memory(path):
    sampled(backend=path, nsteps=10)
    idata = ef.to_inference_data(
        sampled(backend=path, resume=True), PROBLEM.posterior, discard=5
    )
    memory = ef.to_inference_data(sampled(), PROBLEM.posterior, discard=5)
    table = str(ef.parameter_table(idata))
    assert table == str(ef.parameter_table(memory))
    own = emcee.backends.HDFBackend(str(path), name="ensemble_1", read_only=True)
    assert own.get_chain().shape == (30, 12, 5)


def changed_prior():
    prior = PROBLEM.posterior.prior
    sd = np.array(prior.sd) * [1, 1, 1.01, 1, 1]
    new = ef.GaussianPrior(prior.names, prior.mean, sd, prior.bounds)
    return ef.LogPosterior(PROBLEM.model, PROBLEM.posterior.terms, new)


def changed_data():
    term = ef.FrequencyTerm(PROBLEM.measured * 1.001, beta=6.8e5)
    return ef.LogPosterior(PROBLEM.model, term, PROBLEM.posterior.prior)


@pytest.mark.parametrize(
    ("change", "difference"),
    [
        ({"posterior": changed_prior()}, r"prior\.sd"),
        ({"posterior": changed_data()}, r"terms\[0\]\.measured"),
        ({"posterior": ef.paper.mass_spring(1e5).posterior}, r"terms\[0\]\.beta"),
        ({"moves": DEMCMove(sigma=0.1)}, "moves"),
        ({"moves": "auto"}, "moves"),
        ({"seed": 2}, "seed: was 1, is 2"),
        ({"nwalkers": 14}, "nwalkers: was 12, is 14"),
        ({"thin_by": 2}, "thin_by: was 1, is 2"),
    ],
)
def test_another_run_is_refused_with_the_difference_named(path, change, difference):
    sampled(backend=path, nsteps=3)
    before = path.read_bytes()
    with pytest.raises(
        ValueError, match=f"holds a run of something else:\n.*{difference}"
    ):
        sampled(backend=path, resume=True, **change)
    assert path.read_bytes() == before


def test_another_version_is_refused(path, monkeypatch):
    sampled(backend=path, nsteps=3)
    real = ef.sampling.fingerprint.sampled.version
    monkeypatch.setattr(
        ef.sampling.fingerprint.sampled,
        "version",
        lambda name: "0" if name == "numpy" else real(name),
    )
    with pytest.raises(ValueError, match=r"numpy version: was .*, is 0"):
        sampled(backend=path, resume=True)


def test_a_file_is_never_run_over(path):
    sampled(backend=path, nsteps=3)
    with pytest.raises(ValueError, match="exists; go on with it by resume=True"):
        sampled(backend=path)
    with pytest.raises(ValueError, match="nsteps: expected at least the 3 steps"):
        sampled(backend=path, resume=True, nsteps=2)
    with pytest.raises(ValueError, match="holds 2 ensembles"):
        sampled(backend=path, resume=True, ensembles=3)


@pytest.mark.parametrize("content", [b"", b"no HDF5", "another HDF5"])
def test_a_foreign_file_is_refused_and_left_as_it_is(path, content):
    if isinstance(content, bytes):
        path.write_bytes(content)
    else:
        backend = emcee.backends.HDFBackend(str(path), name="ensemble_0")
        backend.reset(12, 5)
    before = path.read_bytes()
    with pytest.raises(ValueError, match="expected the file of a run of emcee_femu"):
        sampled(backend=path, resume=True)
    assert path.read_bytes() == before


def test_a_truncated_file_is_refused_and_left_as_it_is(path):
    sampled(backend=path)
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(ValueError, match="truncated"):
        sampled(backend=path, resume=True)
    assert path.read_bytes() == whole[: len(whole) // 2]


@pytest.mark.parametrize("backend", [None, emcee.backends.Backend()])
def test_resume_needs_the_name_of_a_file(backend):
    with pytest.raises(TypeError, match="resume: expected backend to be the name"):
        sampled(backend=backend, resume=True, ensembles=1)


def test_nothing_is_written_for_a_run_that_is_refused(path):
    prior = ef.IndependentPrior({"a": stats.norm(0, 1)})
    model = ef.FunctionModel(lambda p: [10.0 + p["a"]], n_modes=1)
    posterior = ef.LogPosterior(model, ef.FrequencyTerm([10.0], sd=1.0), prior)
    with pytest.raises(ValueError, match="initial"):
        sampled(posterior, backend=path, initial=np.zeros((2, 12, 3)))
    assert not path.exists()
