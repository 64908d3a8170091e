"""EmulatedModel: its mean, its slopes, its doubt against draws, its limits."""

import pickle

import numpy as np
import pytest
from support.crossing import respond

import emcee_femu as ef
from emcee_femu.surrogates.emulated import fit_emulated

RNG = np.random.default_rng(2)
SCALE = np.array([1e-3, 1e10])  # of the parameters, far apart
POINTS = RNG.standard_normal((18, 2))
BOUNDS = {"E": (-5e-3, 5e-3), "t": (-5e10, 5e10)}
UNITS = {"frequency": np.full(3, 0.002), "shapes": np.full((5, 3), 0.02)}


def emulate(names=("frequency", "shapes"), rows=18, **options):
    units = {name: UNITS[name] for name in names}
    points = POINTS[:rows]
    response = respond(points, seed=3)
    return fit_emulated(points * SCALE, response, units, BOUNDS, **options)


MODEL = emulate()
FRESH = dict(zip(BOUNDS, (RNG.standard_normal((6, 2)) * SCALE).T, strict=True))


def test_it_is_a_modal_model_that_a_posterior_takes():
    assert MODEL.names == MODEL.required == ("E", "t")
    assert MODEL.n_modes == 3 and MODEL.solves == 18
    assert [*MODEL.variables] == ["frequency", "shapes"]
    assert isinstance(MODEL(FRESH), ef.ModalSolution)
    prior = ef.GaussianPrior([*BOUNDS], [0.0, 0.0], SCALE, [*BOUNDS.values()])
    term = ef.FrequencyTerm(respond(np.zeros((1, 2)))["frequency"][0], sd=0.002)
    posterior = ef.LogPosterior(MODEL, term, prior)
    theta = np.column_stack([FRESH["E"], FRESH["t"]])
    assert np.isfinite(posterior(theta)[:, 0]).all()
    assert "18 full solves" in str(MODEL)


def test_the_solved_points_come_back():
    found = MODEL(dict(zip(BOUNDS, (POINTS * SCALE).T, strict=True)))
    truth = respond(POINTS)["frequency"]
    np.testing.assert_allclose(found.frequencies, truth, atol=0.1 * 0.002)


def test_jacobian_is_the_slope_of_a_call():
    response, slopes = MODEL.jacobian(FRESH)
    np.testing.assert_array_equal(response.frequencies, MODEL(FRESH).frequencies)
    for name, scale in zip(BOUNDS, SCALE, strict=True):
        step = 1e-5 * scale
        ends = [MODEL({**FRESH, name: FRESH[name] + s * step}) for s in (1.0, -1.0)]
        for key, variable in (("frequency", "frequencies"), ("shapes", "shapes")):
            ahead, behind = (getattr(end, variable) for end in ends)
            expected = (ahead - behind) / (2 * step)
            found, size = slopes[key][name], np.abs(expected).max()
            np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-6 * size)


def test_spread_is_the_scatter_of_sampled_outputs():
    # Second route: draw the outputs, decode each draw. Few points: much doubt.
    model = emulate(rows=9)
    far = {name: 2.0 * value for name, value in FRESH.items()}
    points = model.coordinates(np.column_stack([far["E"], far["t"]]))
    mean, _ = model.processes.predict(points)
    doubt = model.processes.doubt(points)
    n, draws = len(points), 4000
    covariance = model.processes.covariance
    factor = np.linalg.cholesky(covariance + 1e-12 * np.eye(len(covariance)))
    z = np.random.default_rng(0).standard_normal((n, draws, len(mean.T)))
    values = mean[:, None] + doubt[:, None, None] * (z @ factor.T)
    decoded = model.outputs.decode(values.reshape(n * draws, -1))["frequency"]
    expected = decoded.reshape(n, draws, 3).std(axis=1)
    response, moves = model.spread(far)
    found = np.sqrt(sum(move**2 for move in moves["frequency"].values()))
    np.testing.assert_array_equal(response.frequencies, model(far).frequencies)
    assert np.count_nonzero(expected > 0.1 * 0.002) > 3
    np.testing.assert_allclose(found, expected, rtol=0.1, atol=0.02 * 0.002)


def test_the_errors_of_fresh_points_are_about_those_of_the_spread():
    ratios = []
    for seed in range(8):
        rng = np.random.default_rng(seed)
        x, fresh = rng.standard_normal((15, 2)), rng.standard_normal((60, 2))
        units = {"frequency": UNITS["frequency"]}
        bounds = dict.fromkeys("ab", (-9.0, 9.0))
        model = fit_emulated(x, respond(x, seed=seed), units, bounds)
        parameters = dict(zip("ab", fresh.T, strict=True))
        response, moves = model.spread(parameters)
        sd = np.sqrt(sum(move**2 for move in moves["frequency"].values()))
        error = response.frequencies - respond(fresh)["frequency"]
        ratios.append(np.sqrt((error**2).mean() / (sd**2).mean()))
    assert 0.3 < np.median(ratios) < 3.0  # they understate it


def test_it_refuses_what_lies_outside_by_name():
    outside = {**FRESH, "t": FRESH["t"].copy()}
    outside["t"][2] = 6e10
    for call in (MODEL, MODEL.jacobian, MODEL.spread):
        with pytest.raises(ValueError, match=r"t = 6e\+10 of row 2 is outside"):
            call(outside)
    with pytest.raises(ValueError, match=r"no value for \['t'\]"):
        MODEL({"E": FRESH["E"]})


def test_a_pickle_gives_the_same():
    again = pickle.loads(pickle.dumps(MODEL))
    np.testing.assert_array_equal(again(FRESH).shapes, MODEL(FRESH).shapes)
    assert again.n_modes == 3


def test_the_whitening_is_that_of_mean_and_covariance():
    covariance = np.array([[4.0, 1.0], [1.0, 2.0]]) * np.outer(SCALE, SCALE)
    model = emulate(whiten=(SCALE, covariance))
    draws = np.random.default_rng(1).multivariate_normal(
        [1.0, 1.0], [[4.0, 1.0], [1.0, 2.0]], 4000
    )
    white = model.coordinates(draws * SCALE)
    np.testing.assert_allclose(white.mean(axis=0), 0.0, atol=0.1)
    np.testing.assert_allclose(np.cov(white.T), np.eye(2), atol=0.1)


def test_a_later_fit_begins_where_the_last_one_ended():
    later = emulate(start=MODEL, solves=30)
    assert later.solves == 30
    np.testing.assert_allclose(
        later(FRESH).frequencies, MODEL(FRESH).frequencies, atol=2e-4
    )


def test_frequencies_alone_have_no_shapes_and_other_responses_are_mappings():
    model = emulate(["frequency"])
    assert model(FRESH).shapes is None and [*model.variables] == ["frequency"]
    sag = {"sag": POINTS @ [[1.0, 2.0], [0.5, 1.0]]}
    other = fit_emulated(POINTS * SCALE, sag, {"sag": np.full(2, 0.1)}, BOUNDS)
    expected = np.column_stack([FRESH["E"] / 1e-3, FRESH["t"] / 1e10])
    found = other(FRESH)["sag"]
    np.testing.assert_allclose(found, expected @ [[1.0, 2.0], [0.5, 1.0]], atol=1e-4)
    assert not hasattr(other, "n_modes")
