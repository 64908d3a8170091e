"""What was measured, by experiment, quantity and term: also of files of names."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from support.chains import stored_and_read

import emcee_femu as ef
from emcee_femu.results.measured import (
    find_pairs,
    measured_frequencies,
    read_measured,
    with_frequencies,
)

PRIOR = ef.GaussianPrior(["k"], [10.0], [2.0], [(1.0, 30.0)])
HERTZ = np.array([0.26, 0.7])


def model(shapes=False):
    springs = {"k": (0, 1, 10.0), "k2": (1, 2, 10.0)}
    return ef.MassSpringModel([1.0, 1.0], springs, shapes=shapes)


class OfK(ef.FunctionModel):
    """Two frequencies of one spring."""

    def __init__(self):
        super().__init__(lambda p: np.sqrt(p["k"] * np.array([0.4, 2.6])) / 6.28, 2)


@pytest.fixture(scope="module")
def run():
    twice = [
        ef.FrequencyTerm(HERTZ, relative_sd=0.02),
        ef.FrequencyTerm(HERTZ, relative_sd=0.05, name="b"),
    ]
    tests = {
        "empty": (OfK(), twice),
        "full": (OfK(), ef.FrequencyTerm(HERTZ, relative_sd=0.02)),
    }
    posterior = ef.LogPosterior.joint(tests, PRIOR)
    return ef.run(posterior, ef.DEMCMove(), 8, 30, ensembles=1, seed=1)


@pytest.mark.parametrize("kept", ["run", "ArviZ", "netCDF"])
def test_each_measurement_knows_its_experiment_quantity_and_term(run, kept, tmp_path):
    idata = ef.to_inference_data(run)
    if kept == "netCDF":
        idata = stored_and_read(idata, tmp_path / "run.nc")
    if kept == "run":
        from emcee_femu.results.to_arviz import read_samples

        idata = read_samples(run)[0]
    found = {(m.experiment, m.quantity, m.again): m for m in read_measured(idata)}
    names = {"empty.frequency", "empty.frequency[b]", "full.frequency"}
    assert {m.name for m in found.values()} == names
    again = found["empty", "frequency", "b"]
    assert again.variable == "empty.frequency" and again.labels == ("1", "2")
    assert_allclose(again.values, HERTZ)
    first = found["full", "frequency", ""]
    exact = np.sqrt(np.array([0.4, 2.6])) / 6.28
    k = np.concatenate([s.get_chain(discard=run.burn_in, flat=True) for s in run])
    means = np.sqrt(k).mean() * exact
    assert_allclose(first.updated, means, rtol=1e-6)
    assert [m.experiment for m in with_frequencies(found.values())] == ["empty", "full"]
    posterior = run.posterior
    assert_allclose(first.sd(posterior), 0.02 * HERTZ)
    assert_allclose(again.sd(posterior), 0.05 * HERTZ)
    assert measured_frequencies(idata, "full").experiment == "full"
    with pytest.raises(ValueError, match="name one of the experiments"):
        measured_frequencies(idata)
    assert find_pairs(idata) == []


def test_experiments_that_pair_modes_are_found():
    test = ef.Measurements(HERTZ, shapes=[[1.0, 1.0], [1.6, -0.6]])
    paired = ef.PairedModel(model(shapes=True), test, candidates=2)
    terms = ef.FrequencyTerm(test, relative_sd=0.02)
    plain = OfK(), ef.FrequencyTerm(HERTZ, relative_sd=0.02)
    prior = ef.IndependentPrior({"k": (5.0, 20.0), "k2": (5.0, 20.0)})
    posterior = ef.LogPosterior.joint({"a": plain, "b": (paired, terms)}, prior)
    run = ef.run(posterior, ef.DEMCMove(), 8, 10, ensembles=1, seed=1)
    idata = ef.to_inference_data(run)
    assert find_pairs(idata) == ["b"]
    of_a, of_b = with_frequencies(read_measured(idata))
    assert of_a.mac is None and of_b.mac.shape == of_b.predicted.shape
