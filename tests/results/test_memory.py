"""Sampling into a file keeps memory flat; a conversion takes a few times its result."""

import tracemalloc

import numpy as np
import pytest
from support.chains import dataset

import emcee_femu as ef

NDIM, NWALKERS, STEPS = 2, 128, 50
PRIOR = ef.GaussianPrior([f"k{i}" for i in range(NDIM)], np.zeros(NDIM), 1.0)


def model(parameters):
    return ef.ModalSolution(np.arange(1, 21) + 0.01 * parameters["k0"][:, None])


POSTERIOR = ef.LogPosterior(model, ef.FrequencyTerm(np.arange(1, 21), beta=1e2), PRIOR)


def peak_of(function, *arguments, **options):
    """Return what a call adds to memory at most, in bytes, and its result."""
    tracemalloc.start()
    result = function(*arguments, **options)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak, result


@pytest.mark.slow
def test_memory_stays_flat_while_a_file_grows(tmp_path):
    options = {"moves": ef.DEMCMove(), "nwalkers": NWALKERS, "seed": 1}
    peaks = []
    for steps in (2, 15, STEPS):  # the first one pays for imports
        file = tmp_path / f"{steps}.run"
        peaks.append(
            peak_of(ef.run, POSTERIOR, steps=steps, backend=file, **options)[0]
        )
    added = (STEPS - 15) * NWALKERS * (NDIM + 1 + 2 + 20) * 8
    assert peaks[2] - peaks[1] < 0.1 * added


@pytest.fixture(scope="module")
def samplers():
    return ef.run(
        POSTERIOR,
        nwalkers=NWALKERS,
        steps=STEPS,
        ensembles=3,
        seed=1,
        moves=ef.DEMCMove(),
    )


@pytest.mark.parametrize("options", [{}, {"thin": 3}, {"discard": 40}], ids=str)
@pytest.mark.parametrize("ensembles", [1, 3])
def test_a_conversion_holds_a_few_times_the_chain(samplers, ensembles, options):
    runs = samplers[:ensembles]
    convert = ef.to_inference_data
    convert(runs, POSTERIOR, discard=STEPS - 1)  # imports
    least, _ = peak_of(convert, runs, POSTERIOR, discard=STEPS - 1)  # of the prior
    peak, idata = peak_of(convert, runs, POSTERIOR, **options)
    kept = sum(dataset(idata, group).nbytes for group in ("posterior", "response"))
    assert kept < peak < 1.5 * least + 10 * kept  # 5 times it with NumPy 2.4
