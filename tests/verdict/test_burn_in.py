"""Burn-in: what a chain takes to forget its start is found, told, and left out."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from scipy import stats
from support.chains import ar1, backend, dataset, stored_and_read
from support.free_posterior import box, free_posterior
from support.stored import sampled

import emcee_femu as ef
from emcee_femu.evaluation.store import Store
from emcee_femu.verdict.burn_in import find_burn_in
from emcee_femu.verdict.statistics import find_drift
from emcee_femu.verdict.verdict import BEGINS_ELSEWHERE

PHIS = 0.9, 0.8, 0.5  # tau is 19, 9 and 3 steps
MIX = np.array([[1.0, 0.0, 0.0], [0.8, 0.6, 0.0], [-0.5, 0.5, 0.7]])
STEPS, ENSEMBLES, WALKERS = 600, 4, 8
EXACT, FEW = range(30), range(8)


def exact(seed, steps=STEPS, walkers=WALKERS):
    """Return correlated chains that begin in their target."""
    chains = ar1(PHIS, steps, ENSEMBLES * walkers, seed) @ MIX.T
    return chains.reshape(steps, ENSEMBLES, walkers, 3)


def shifted(chains, length, sds=8.0):
    """Return chains whose last parameter comes from so many sds away."""
    moved = chains.copy()
    moved[:length, ..., 2] += sds * chains[..., 2].std()
    return moved


def widened(chains, length, factor=6.0):
    """Return chains that begin as wide as a prior around them."""
    moved = chains.copy()
    moved[:length] *= factor
    return moved


@pytest.mark.parametrize(("walkers", "steps"), [(1, STEPS), (2, STEPS), (8, 150)])
def test_of_an_exact_start_little_is_left_out_and_no_drift_is_seen(walkers, steps):
    chains = [exact(seed, steps, walkers) for seed in EXACT]
    assert np.mean([find_burn_in(x) for x in chains]) < 0.1 * steps
    assert not any(find_drift(x) for x in chains)


@pytest.mark.parametrize("length", [20, 100, 250])
@pytest.mark.parametrize("way_in", [shifted, widened])
def test_a_way_in_is_left_out_and_not_much_more(way_in, length):
    found = [find_burn_in(way_in(exact(seed), length)) for seed in FEW]
    assert min(found) >= 0.9 * length
    assert np.mean(found) < length + 0.1 * STEPS
    assert all(find_drift(way_in(exact(seed), length)) for seed in FEW)


def test_what_is_left_has_the_moments_of_the_target():
    """Of a start that is forgotten slowly: errors as of a chain without one."""
    sd = np.sqrt((MIX**2).sum(axis=1))
    tau = (1 + np.array(PHIS)) / (1 - np.array(PHIS))  # of the parameters before MIX
    tau = (MIX**2 @ tau) / (MIX**2).sum(axis=1)
    fading = 10.0 * np.exp(-np.arange(STEPS) / 15.0)[:, None, None, None]
    z = []
    for seed in EXACT:
        chains = exact(seed) + fading
        left = chains[find_burn_in(chains) :]
        error = sd * np.sqrt(tau / (len(left) * ENSEMBLES * WALKERS))
        z.append(left.mean(axis=(0, 1, 2)) / error)
    low, high = stats.chi2.interval(0.999, np.size(z))
    assert low / np.size(z) < np.mean(np.square(z)) < 1.3 * high / np.size(z)


def test_a_chain_that_is_all_way_in_drifts():
    slope = np.linspace(6.0, 0.0, STEPS)[:, None, None, None]
    for seed in FEW:
        chains = exact(seed) + slope
        assert find_burn_in(chains) <= STEPS // 2
        assert find_drift(chains) == STEPS


def test_a_temperature_that_comes_from_elsewhere_counts_as_all():
    cold, hot = exact(1), shifted(exact(2), 90)
    both = np.concatenate([cold, hot], axis=2)
    assert find_burn_in(cold) < 45 <= 90 == find_burn_in(both, rungs=2)


@pytest.mark.parametrize("steps", range(1, 13))
def test_a_few_steps_are_all_left(steps):
    few = shifted(exact(1, 60), 4)[:steps]
    assert find_burn_in(few) <= max(steps - 8, 0) and find_drift(few) >= 0


def test_walkers_that_never_move_say_nothing():
    still = np.ones((40, 2, 4, 3))
    assert find_burn_in(still) == find_drift(still) == 0


def judged(chains, **options):
    return ef.diagnose([backend(x) for x in chains.swapaxes(0, 1)], **options)


def test_a_way_in_of_other_samplers_is_named_with_its_number():
    found = judged(shifted(exact(1, 2_000), 300))
    assert BEGINS_ELSEWHERE in found.chains.reasons[0] and found.drift == 300
    assert "discard=300" in found.verdict
    left = judged(shifted(exact(1, 2_000), 300), discard=300)
    assert left.converged and (left.drift, left.discard) == (0, 300)
    some = judged(shifted(exact(1, 2_000), 300), discard=100)
    assert some.drift == 200 and "discard=300" in some.verdict


def test_more_steps_are_asked_for_where_all_is_way_in():
    found = judged(exact(1) + np.linspace(6.0, 0.0, STEPS)[:, None, None, None])
    assert found.chains.reasons[0] == BEGINS_ELSEWHERE
    assert "discard=" not in found.verdict


def gaussian(x):
    return -0.5 * (x**2).sum(axis=1)


FAR = free_posterior(gaussian, box(-60, 60, 3))
OPTIONS = {"nwalkers": 8, "steps": 160, "ensembles": 2, "seed": 1}


@pytest.fixture(scope="module")
def stored(tmp_path_factory):
    path = tmp_path_factory.mktemp("burn_in") / "run.chain"
    return ef.run(FAR, ef.DEMCMove(), backend=path, **OPTIONS), path


def test_every_reader_leaves_it_out_and_says_so(stored, tmp_path):
    run, path = stored
    burn_in = run.burn_in
    assert 0 < burn_in == find_burn_in(np.stack([x.get_chain() for x in run], axis=1))
    assert f"{burn_in} of them burn-in" in str(run)
    assert run[0].get_chain().shape[0] == 160  # emcee's own has all
    idata = ef.to_inference_data(run)
    for source in (run, path, idata):
        found = ef.diagnose(source)
        assert (found.steps, found.discard) == (160 - burn_in, burn_in)
        assert f"burn-in of {burn_in}" in str(found)
    for source in (run, path):
        read = dataset(ef.to_inference_data(source), "posterior")
        assert_array_equal(read["step"], np.arange(burn_in, 160))
        assert read.attrs["discard"] == burn_in
        whole = dataset(ef.to_inference_data(source, discard=0), "posterior")
        assert whole.sizes["draw"] == 160 and ef.diagnose(source, 0).steps == 160
        assert ef.diagnose(source, 7).discard == 7
    sd = ef.parameter_table(run).column("sd/prior sd")
    assert sd == ef.parameter_table(idata).column("sd/prior sd")
    whole = ef.parameter_table(ef.to_inference_data(run, discard=0))
    assert sd != whole.column("sd/prior sd")
    read = stored_and_read(idata, tmp_path / "run.nc")
    assert str(ef.diagnose(run)) == str(ef.diagnose(idata)) == str(ef.diagnose(read))


@pytest.mark.slow
def test_a_search_leaves_nothing_to_burn():
    runs = [ef.run(FAR, nwalkers=8, ensembles=1, seed=s, steps=30) for s in range(8)]
    assert any(find_burn_in(run[0].get_chain()[:, None]) for run in runs)  # by chance
    for run in runs:
        assert run.burn_in == 0 and ef.diagnose(run).steps == 30


def test_a_file_of_a_version_that_kept_no_burn_in_is_read(stored):
    run, path = stored
    store = Store(str(path), read_only=False)
    kept = store["burn-in"]
    store["burn-in"] = None
    store.close()
    assert kept == [[160, run.burn_in]]
    assert ef.diagnose(path).discard == run.burn_in


@pytest.mark.slow
def test_a_run_that_goes_on_has_the_burn_in_of_a_whole_one(tmp_path):
    path = tmp_path / "run.chain"
    whole = sampled(None, steps=60)
    first = sampled(path, steps=30)
    assert ef.diagnose(path).discard == first.burn_in
    again = sampled(path, steps=60)
    assert_array_equal(again[0].get_chain(), whole[0].get_chain())
    assert again.burn_in == whole.burn_in == ef.diagnose(path).discard


@pytest.mark.slow
def test_given_starts_are_a_way_in_too():
    starts = np.full((2, 8, 3), 40.0) + np.random.default_rng(1).normal(size=(2, 8, 3))
    run = ef.run(FAR, ef.DEMCMove(), starts=starts, **OPTIONS | {"steps": 300})
    assert run.burn_in > 10 and ef.diagnose(run).drift == 0
    assert ef.diagnose(run, 0).chains.reasons[0] == BEGINS_ELSEWHERE
