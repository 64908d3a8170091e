"""A bare log-likelihood, as emcee takes it, with all that a posterior has."""

import numpy as np
import pytest
from scipy import stats
from support.runs import assert_same, failures

import emcee_femu as ef

CENTRE, SD = np.array([1.0, -2.0]), np.array([0.5, 2.0])
BOX = {"a": (-9.0, 9.0), "b": (-30.0, 30.0)}
LOG_BOX = np.log(18 * 60)
LOWEST = CENTRE[0] - SD[0]  # where right_part begins
CUT = stats.truncnorm(-1, np.inf)
of = ef.LogPosterior.from_function
DEMC = {"moves": ef.DEMCMove(), "nwalkers": 8, "steps": 30, "ensembles": 2, "seed": 1}


def gaussian(x, centre=CENTRE, *, sd=SD):
    """Return the density of a Gaussian, normalised, at one point."""
    z = (x - centre) / sd
    return -0.5 * (z[0] ** 2 + z[1] ** 2) - np.log(2 * np.pi * sd[0] * sd[1])


def gaussians(x, centre=CENTRE, *, sd=SD):
    """Return the same at many points."""
    return gaussian(x.T, centre[:, None], sd=sd[:, None])[:, None].ravel()


def right_part(x):
    """Return it right of a line with two blobs, and zero elsewhere, without."""
    if x[0] < LOWEST:
        return -np.inf
    return gaussian(x), x[0] * x[1], np.outer(x, x)


@pytest.fixture(scope="module")
def cut(tmp_path_factory):
    path = tmp_path_factory.mktemp("cut") / "run.sqlite"
    return ef.run(of(right_part, BOX), seed=1, backend=path), path


def test_moments_and_evidence_are_those_of_the_gaussian(cut):
    """Cut one standard deviation below its centre."""
    idata = ef.to_inference_data(cut[0])
    z = (np.stack([idata["posterior"][n] for n in BOX], -1) - CENTRE) / SD
    assert ef.diagnose(cut[0]).converged and (z[..., 0] >= -1).all()
    mean, variance = np.transpose([law.stats("mv") for law in (CUT, stats.norm(0, 1))])
    np.testing.assert_allclose(z.mean(axis=(0, 1)), mean, atol=0.12)
    np.testing.assert_allclose(z.var(axis=(0, 1)), variance, rtol=0.2)
    population = ef.anneal(of(right_part, BOX), 200, seed=1)
    assert f"{LOG_BOX:.4f}" in str(population)
    for source in (*cut, idata, population):
        found = ef.log_evidence(source)
        error = found.log_evidence - (stats.norm.logcdf(1.0) - LOG_BOX)
        assert abs(error) < 4 * found.log_evidence_error < 1.0
        assert found.log_box == pytest.approx(LOG_BOX)
        assert f"{LOG_BOX:.4f}" in str(found)


def test_a_prior_may_be_given_and_arguments_of_the_function():
    prior = ef.IndependentPrior({"a": stats.norm(0, 3), "b": (-30.0, 30.0)})
    posterior = of(gaussian, prior, args=(CENTRE + 1,), kwargs={"sd": 2 * SD})
    log_prior = stats.norm.logpdf(1.0, 0, 3) - np.log(60)
    expected = gaussian(CENTRE, CENTRE + 1, sd=2 * SD) + log_prior
    assert posterior(CENTRE)[0] == pytest.approx(expected)
    assert np.isnan(posterior.log_box)  # of no box
    assert np.isnan(of(gaussian, prior.marginals).log_box)


def test_blobs_are_stored_where_the_likelihood_is_not_zero(cut):
    idata = ef.to_inference_data(cut[0])
    a, b = (idata["posterior"][name] for name in BOX)
    np.testing.assert_array_equal(idata["response"]["blob0"], a * b)
    assert idata["response"]["blob1"].dims[2:] == ("blob1_dim_0", "blob1_dim_1")
    np.testing.assert_array_equal(idata["response"]["blob1"][..., 1, 0], a * b)
    row = of(right_part, BOX)([LOWEST - 0.1, 0.0])
    assert row[0] == row[2] == -np.inf and np.isnan(row[3:]).all()


def with_blob(x):
    return np.column_stack([gaussians(x), x[:, 0]])


@pytest.mark.parametrize(
    "function", [with_blob, lambda x: [*map(tuple, with_blob(x))], gaussians]
)
def test_all_points_at_once_are_the_points_one_by_one(function):
    posterior = of(function, BOX, vectorize=True)
    theta = posterior.start(7, 1)
    rows, one_by_one = posterior(theta), of(gaussian, BOX)(theta)
    np.testing.assert_allclose(rows[:, :3], one_by_one, rtol=1e-12)
    np.testing.assert_array_equal(rows[:, 3:].ravel(), theta[:, 0][: rows[:, 3:].size])


def test_the_chain_is_the_same_on_workers_and_when_it_goes_on(tmp_path):
    posterior, file = of(right_part, BOX), {"backend": tmp_path / "run"}
    whole = ef.run(posterior, **DEMC)
    assert_same(ef.run(posterior, **DEMC, workers=2), whole)
    ef.run(posterior, **DEMC | {"steps": 10}, **file)
    assert_same(ef.run(posterior, **DEMC, **file, resume=True), whole)


def test_no_data_is_what_tables_and_the_emulator_say(cut, tmp_path):
    """With blobs and without."""
    bare = ef.run(of(gaussian, BOX), **DEMC)
    for source in (cut[0], bare, ef.to_inference_data(bare)):
        for table in (ef.frequency_table, ef.predictive_table):
            with pytest.raises(ValueError, match="no data"):
                table(source)
        with pytest.raises(ValueError, match="'mac'"):
            ef.pairing_table(source)
        assert ef.diagnose(source).fit.status == "not checked"
        assert len(ef.identifiability(source).names) == 2
        assert ef.parameter_table(source).column("parameter") == ["a", "b"]
    assert ef.report(bare, tmp_path / "report.html").exists()
    with pytest.raises(ValueError, match="response"):
        ef.emulate(of(gaussian, BOX), 20, seed=1)


def test_nan_is_a_failed_solve():
    posterior = of(lambda x: np.nan if x[0] > 0 else gaussian(x), BOX)
    with pytest.raises(ValueError, match="'a': 1"):
        posterior([1.0, 0.0])
    options = DEMC | {"on_failure": "reject", "max_failures": 0.9}
    run = ef.run(posterior, **options)
    assert set(failures(run)[1]) == {"not finite"}
    assert all((sampler.get_chain()[..., 0] <= 0).all() for sampler in run)


@pytest.mark.parametrize(
    ("function", "options", "error", "named"),
    [
        (3, {}, TypeError, "log_likelihood.*3"),
        (gaussian, {"args": CENTRE}, TypeError, "args"),
        (gaussian, {"kwargs": [SD]}, TypeError, "kwargs"),
        (gaussian, {"vectorize": "yes"}, TypeError, "vectorize"),
        (gaussian, {"prior": [(0, 1)]}, TypeError, r"prior.*\{\"a\": \(0, 1\)"),
        (gaussian, {"prior": np.array([(-4, 4)] * 2)}, TypeError, r'"a": \(-4, 4\)'),
        (gaussian, {"prior": [1, 2]}, TypeError, "prior"),
        (gaussian, {"prior": {"a": (1, 0)}}, ValueError, "'a'"),
        (lambda x: None, {}, TypeError, "log_likelihood.*None"),
        (lambda x: (x, 1), {}, ValueError, r"log_likelihood.*\(2,\)"),
        (lambda x: [], {}, ValueError, r"log_likelihood.*\(0,\)"),
        (lambda x: (0.0, "left"), {}, TypeError, "blob 0"),
        (lambda x: -np.inf, {}, ValueError, "256 draws"),
        (lambda x: x[5], {}, IndexError, "5"),
        (lambda x: 0.0, {"vectorize": True}, ValueError, "vectorize"),
        (lambda x: np.zeros(3), {"vectorize": True}, ValueError, "vectorize"),
    ],
)
def test_what_is_wrong_is_named_before_any_sampling(function, options, error, named):
    with pytest.raises(error, match=named):
        of(function, **{"prior": BOX} | options)


def test_a_blob_of_another_shape_elsewhere_is_refused():
    posterior = of(lambda x: (0.0, np.zeros(1 if x[0] > 0 else 2)), BOX)
    with pytest.raises(ValueError, match="blob0"):
        posterior([[-1.0, 0.0], [1.0, 0.0]])


@pytest.mark.parametrize(
    ("function", "vectorize"),
    [(lambda x: -x @ np.eye(3) @ x, False), (lambda x: x @ np.ones(4), True)],
)
def test_a_box_of_too_few_names_is_named(function, vectorize):
    with pytest.raises(ValueError) as caught:
        of(function, BOX, vectorize=vectorize)
    assert any("2" in note and "'a', 'b'" in note for note in caught.value.__notes__)
