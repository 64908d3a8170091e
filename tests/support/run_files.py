"""What the tests of run files share: a small run, and how two of them compare."""

import emcee
import numpy as np

from emcee_femu.sampling.run_file import RunFile

W, D = 8, 3


def log_prob(theta, blobs):
    return np.column_stack(
        [-0.5 * np.square(theta).sum(axis=1), *[theta[:, 0]] * blobs]
    )


def first_state(blobs=2):
    random = np.random.RandomState(7)  # noqa: NPY002 - what emcee uses
    start = random.standard_normal((W, D))
    rows = log_prob(start, blobs)
    own = rows[:, 1:] if blobs else None
    return emcee.State(start, rows[:, 0], own, random.get_state())


def advance(backend, nsteps, blobs=2, thin_by=1):
    """Run a sampler for nsteps more and return the backend."""
    sampler = emcee.EnsembleSampler(
        W, D, log_prob, args=[blobs], vectorize=True, backend=backend
    )
    state = sampler.get_last_sample() if sampler.iteration else first_state(blobs)
    sampler.run_mcmc(state, nsteps, thin_by=thin_by)
    return backend


def create(path, blobs=2, ensembles=1):
    return RunFile.create(path, [first_state(blobs)] * ensembles, {"seed": 7})[0]


def assert_same(one, other):
    """Compare backends, or samplers, in all that a run leaves."""
    for get in ("get_chain", "get_log_prob", "get_blobs"):
        np.testing.assert_array_equal(getattr(one, get)(), getattr(other, get)())
    one, other = (getattr(run, "backend", run) for run in (one, other))
    np.testing.assert_array_equal(one.accepted, other.accepted)
    for a, b in zip(one.random_state, other.random_state, strict=True):
        np.testing.assert_array_equal(a, b)
    assert one.iteration == other.iteration > 0
