"""What "auto" found goes with the chain into an ArviZ file, and the verdict with it."""

import json

import arviz as az
import numpy as np
import pytest
from numpy.testing import assert_array_equal
from support.free_posterior import box, free_posterior

import emcee_femu as ef
from emcee_femu.results.arviz_objects import dataset
from emcee_femu.sampling import auto


def two_modes(x):
    """Return the log-density of a wide and a narrow mode, 0.7 and 0.3 of the whole."""
    apart = ((x[:, None, :] - [[0.0], [6.0]]) ** 2).sum(axis=2)
    return np.logaddexp(*(np.log([0.7, 30.0]) - apart / [2.0, 0.02]).T)


@pytest.mark.parametrize("steps", [60, 400])
def test_a_stored_run_has_the_verdict_and_the_groups_of_its_samplers(
    steps, tmp_path, monkeypatch
):
    monkeypatch.setattr(auto, "FEWEST", 400)
    monkeypatch.setattr(auto, "ROUND", 300)
    posterior = free_posterior(two_modes, box(-8, 12, 2))
    samplers = ef.run(posterior, "auto", 16, steps, ensembles=3, seed=1)
    idata = ef.to_inference_data(samplers, posterior)
    idata.to_netcdf(str(tmp_path / "run.nc"))
    before, after = (
        ef.diagnose(each)
        for each in (samplers, az.from_netcdf(str(tmp_path / "run.nc")))
    )
    recipe = samplers[0].recipe
    attrs = dataset(az.from_netcdf(str(tmp_path / "run.nc")), "posterior").attrs
    assert json.loads(attrs["recipe"]) == recipe.record
    assert attrs["burn_in"] == str(recipe)
    assert (after.short, after.verdict) == (before.short, before.verdict)
    assert before.converged == (steps == 400)
    assert before.groups.weights.shape == (3, 2)
    for name in ("weights", "errors", "acceptance", "importance", "found", "slowest"):
        assert_array_equal(getattr(after.groups, name), getattr(before.groups, name))
    assert str(after.groups.table) == str(before.groups.table)
