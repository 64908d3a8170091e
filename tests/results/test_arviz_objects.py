"""Notes and judgements that any extension stores with samples, and weighted draws."""

import json

import numpy as np
import pytest
import xarray
from numpy.testing import assert_allclose
from support.chains import stored_and_read

import emcee_femu as ef
from emcee_femu.results.arviz_objects import (
    Groups,
    dataset,
    groups,
    judgement_of,
    note_of,
    wrap,
)

SAID = {"verdict": "the sensors were frozen.", "refused": 1}


@pytest.fixture(scope="module")
def idata():
    posterior = ef.paper.mass_spring().posterior
    run = ef.run(posterior, ef.DEMCMove(), 12, 60, ensembles=2, seed=1)
    return ef.to_inference_data(run, discard=10)


def judged(idata, attributes, group):
    """Return samples with a note and a group that judges them."""
    held = groups(idata)
    held["posterior"] = held["posterior"].assign_attrs(attributes)
    values = {"wind": ("hour", [3.0])}  # an empty group is none to ArviZ
    return wrap(held | {group: xarray.Dataset(values, {}, SAID)})


@pytest.mark.parametrize(
    ("attributes", "group"),
    [
        ({"note": "frozen", "judged_in": "weather"}, "weather"),
        ({"certificate": "frozen"}, "certificate"),  # of version 0.5
    ],
)
def test_what_an_extension_notes_is_read_by_tables_and_diagnose(
    attributes, group, idata
):
    told = judged(idata, attributes, group)
    assert note_of(told) == "frozen"
    assert "frozen" in ef.parameter_table(told).title
    assert ef.identifiability(told).note == "frozen"
    assert ef.diagnose(told).chains.status == "refused"
    assert SAID["verdict"] in ef.diagnose(told).chains.sentence


def test_samples_without_a_note_are_judged_by_their_chains(idata):
    assert (note_of(idata), judgement_of(idata)) == ("", {})
    assert ef.diagnose(idata).chains.status != "refused"


def test_weighted_draws_have_the_moments_of_their_weights(idata):
    held = groups(idata)
    lp = held["sample_stats"]["lp"]
    weight = np.random.default_rng(0).random(lp.shape) ** 4
    some = {n: g.isel(chain=[0]) for n, g in held.items() if "chain" in g.dims}
    some["posterior"] = some["posterior"].assign_attrs(kind="weighted")
    some["sample_stats"] = some["sample_stats"].assign(
        weight=(("chain", "draw"), weight[:1])
    )
    k1 = held["posterior"]["k1"].values[0]
    read = dataset(wrap(some), "posterior")["k1"].values.ravel()
    mean = np.average(k1, weights=weight[0])
    assert_allclose(read.mean(), mean, atol=1e-3 * k1.std())
    assert abs(k1.mean() - mean) > 0.01 * k1.std()


def test_an_attribute_is_kept_by_a_netcdf_file(tmp_path, idata):
    told = judged(idata, {"note": "frozen", "judged_in": "weather"}, "weather")
    read = stored_and_read(told, tmp_path / "told.nc")
    assert note_of(read) == "frozen"
    assert json.dumps(dict(judgement_of(read)), default=int) == json.dumps(SAID)


def test_a_group_is_made_once_and_only_if_it_is_asked_for():
    made = []

    def maker(name, group):
        def make():
            made.append(name)
            return group

        return make

    values = xarray.Dataset({"k": ("draw", [1.0])})
    parts = {"posterior": values, "response": None, "prior": values}
    lazy = Groups({name: maker(name, part) for name, part in parts.items()})
    assert lazy["posterior"] is lazy["posterior"] and made == ["posterior"]
    assert "response" not in lazy and "absent" not in lazy
    assert [*lazy] == ["posterior", "prior"] and len(lazy) == 2
    assert sorted(made) == sorted(parts)
    with pytest.raises(KeyError):
        lazy["response"]
