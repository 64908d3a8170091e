"""Modes of the structure that change places between maxima, by the model's shapes."""

import numpy as np
import pytest
from support.chains import stored_and_read
from support.runs import Counting

import emcee_femu as ef
from emcee_femu.posterior.followed_modes import follow_modes

SPRINGS = {"k1": (0, 1, 1_000.0), "k2": (0, 2, 1_600.0)}  # two masses, each on its own
MODEL = ef.MassSpringModel([1.0, 1.0], SPRINGS, shapes=True)
FREE = [(200, 4_000), (200, 4_000), (0.1, 4_000)]
MEASURED = np.sqrt([1_000.0, 1_600.0]) / (2 * np.pi)
PRIOR = ef.GaussianPrior(["k1", "k2"], [1_200, 1_400], [400, 400], [(200, 4_000)] * 2)
ALIKE = ef.GaussianPrior(["k1", "k2"], [1_300, 1_300], [400, 400], PRIOR.bounds)


def run_of(model, steps=60, prior=PRIOR, **options):
    term = ef.FrequencyTerm(MEASURED, relative_sd=0.02)
    posterior = ef.LogPosterior(model, term, prior)
    return ef.run(posterior, nwalkers=16, steps=steps, seed=1, **options)


@pytest.fixture(scope="module")
def found():
    return run_of(MODEL)


def test_modes_that_change_places_are_named_where_they_do(found, tmp_path):
    (numbers,) = found.search.followed.values()
    assert sorted(numbers.tolist()) == [[1, 2], [2, 1]]
    swapped = 1 + int(np.argmax(numbers[:, 0]))
    x = found.search.mixture.means[found.search.maximum_of == swapped - 1]
    assert (x[:, 0] > x[:, 1]).all()  # against the order at the prior mean
    diagnosis = ef.diagnose(found)
    assert diagnosis.fit.status == "doubtful"
    assert f"maximum {swapped} " in diagnosis.fit.sentence
    assert f"maximum {3 - swapped} " not in diagnosis.fit.sentence
    read = stored_and_read(ef.to_inference_data(found), tmp_path / "run.nc")
    assert ef.diagnose(read).fit == diagnosis.fit


@pytest.mark.parametrize(
    "model",
    [
        ef.MassSpringModel([1.0, 1.0], SPRINGS),  # no shapes
        ef.PairedModel(
            MODEL, MEASURED, reference={"k1": 1_200.0, "k2": 1_400.0}, candidates=2
        ),
    ],
)
def test_nothing_is_said_without_shapes_or_of_paired_modes(model):
    found = run_of(model)
    assert not found.search.followed
    assert ef.diagnose(found).fit.status == "fits"


def test_modes_that_are_equal_at_the_prior_mean_have_no_order_to_lose():
    turn = np.array([[np.cos(1.2), -np.sin(1.2)], [np.sin(1.2), np.cos(1.2)]])
    units = {name: np.outer(q, q) for name, q in zip(PRIOR.names, turn.T, strict=True)}
    zero, mass = np.zeros((2, 2)), np.eye(2)
    model = ef.MatrixModel(zero, mass, units, n_modes=2, shapes=True)
    found = run_of(model, prior=ALIKE)
    (numbers,) = found.search.followed.values()
    assert numbers.shape == (2, 2) and not numbers.any()
    assert ef.diagnose(found).fit.status == "fits"


def test_a_mode_that_lost_its_shape_is_not_followed():
    springs = SPRINGS | {"k12": (1, 2, 1.0)}  # joins the masses
    model = ef.MassSpringModel([1.0, 1.0], springs, shapes=True)
    prior = ef.GaussianPrior([*springs], [1_200, 1_400, 1], [400, 400, 500], FREE)
    term = ef.FrequencyTerm(MEASURED, relative_sd=0.02)
    posterior = ef.LogPosterior(model, term, prior)
    apart, joined = [1_000.0, 1_600.0, 1.0], [1_300.0, 1_300.0, 400.0]
    (numbers,) = follow_modes(posterior, np.array([apart, joined])).values()
    assert numbers.tolist() == [[1, 2], [0, 0]]


@pytest.mark.slow
def test_following_is_counted_in_solves_also_in_a_file(tmp_path):
    model, path = Counting(MODEL), str(tmp_path / "run.chain")
    counted = run_of(model, 20)
    assert counted.search.followed and counted.solves == model.solves
    run_of(MODEL, 10, backend=path)
    again = run_of(MODEL, 20, backend=path, resume=True)
    told = int(ef.to_inference_data(path).posterior.attrs["solves"])
    assert again.solves == told == run_of(MODEL, 20).solves


@pytest.mark.slow
def test_mirrored_maxima_are_named_and_means_between_clouds(found):
    mirrored = run_of(MODEL, prior=ALIKE)
    np.testing.assert_allclose(mirrored.search.weights, 0.5, atol=0.05)
    for run, equal in ((mirrored, True), (found, False)):
        assert ("1 and 2" in ef.diagnose(run).search.sentence) == equal
    assert "k1, k2" in ef.parameter_table(mirrored).title
    one = ef.GaussianPrior(["k1", "k2"], [1_000, 1_600], [50, 50], PRIOR.bounds)
    assert "k1" not in ef.parameter_table(run_of(MODEL, prior=one)).title
