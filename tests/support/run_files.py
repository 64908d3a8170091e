"""What the tests of run files share: a small run, and how two of them compare."""

import emcee
import numpy as np

from emcee_femu.sampling.run_file import RunFile

W, D = 8, 3


def log_prob(theta, blobs):
    return np.column_stack(
        [-0.5 * np.square(theta).sum(axis=1), *[theta[:, 0]] * blobs]
    )


def advance(backend, nsteps, blobs=2, thin_by=1):
    """Run a sampler for nsteps more and return the backend."""
    sampler = emcee.EnsembleSampler(
        W, D, log_prob, args=[blobs], vectorize=True, backend=backend
    )
    if sampler.iteration:
        state = sampler.get_last_sample()
    else:
        random = np.random.RandomState(7)  # noqa: NPY002 - what emcee uses
        start = random.standard_normal((W, D))
        state = emcee.State(start, random_state=random.get_state())
    sampler.run_mcmc(state, nsteps, thin_by=thin_by)
    return backend


def create(path, nsteps=10, blobs=2, **options):
    options = {"fingerprint": {}, **options}
    return RunFile.create(path, W, D, nsteps, blobs=blobs, **options)[0]


def assert_same(one, other):
    for backend in (one, other):
        assert backend.iteration > 0
    for get in ("get_chain", "get_log_prob", "get_blobs"):
        np.testing.assert_array_equal(getattr(one, get)(), getattr(other, get)())
    np.testing.assert_array_equal(one.accepted, other.accepted)
    for a, b in zip(one.random_state, other.random_state, strict=True):
        np.testing.assert_array_equal(a, b)
    assert one.iteration == other.iteration
