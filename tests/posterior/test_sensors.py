"""A wrong sensor is named where the shapes show it, and no right one is."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import integrate, optimize, stats

import emcee_femu as ef
from emcee_femu.posterior import sensors

N = 6  # masses, all measured
SPRINGS = {f"k{i}": (i, i + 1, 1.0) for i in range(N)}
MODEL = ef.MassSpringModel([1.0] * N, SPRINGS, shapes=True)
PRIOR = ef.IndependentPrior(dict.fromkeys(SPRINGS, (0.8, 1.2)))
FAULTS = ("turned", "exchanged", "gain")


def measured(seed, fault=None, spread=0.2, noise=0.01, gain=1e3, n_modes=3):
    """Return a test of a chain up to 20 % off, and the sensors of its fault."""
    rng = np.random.default_rng(seed)
    true = MODEL({name: rng.uniform(1 - spread, 1 + spread, 1) for name in SPRINGS})
    shapes = true.shapes[0][:, :n_modes]
    shapes = shapes + noise * np.abs(shapes).max(0) * rng.normal(size=shapes.shape)
    which = sorted(rng.choice(N, 2, replace=False).tolist())
    if fault == "exchanged":
        shapes[which] = shapes[which[::-1]]
    else:
        which = which[:1]
        shapes[which] *= {None: 1.0, "turned": -1.0, "gain": gain}[fault]
    test = ef.Measurements(true.frequencies[0, :n_modes], shapes)
    return test, tuple(f"s{i + 1}" for i in which)


def posterior(test, model=MODEL, prior=PRIOR):
    paired = ef.PairedModel(model, test, candidates=min(2 * test.n_modes, N))
    return ef.LogPosterior(paired, ef.FrequencyTerm(test, relative_sd=0.01), prior)


def suspects(test, model=MODEL, prior=PRIOR):
    return ef.check_test(posterior(test, model, prior)).suspects


def test_no_right_test_is_suspect():
    assert [seed for seed in range(30) if suspects(measured(seed)[0])] == []


@pytest.mark.slow
@pytest.mark.parametrize("fault", FAULTS)
def test_of_wrong_sensors_nine_of_ten_are_named(fault):
    named = 0
    for seed in range(100, 120):
        test, which = measured(seed, fault)
        found = suspects(test)
        named += (fault, which) in [(s.kind, s.sensors) for s in found]
        assert all(s.after > s.before for s in found)
    assert named >= 18


@pytest.mark.parametrize("gain", [2.5, -3.0, 0.1])
def test_a_gain_is_that_of_the_sensor(gain):
    for seed in range(4):
        test, which = measured(seed, "gain", spread=0.0, noise=0.0, gain=gain)
        (found,) = [s for s in suspects(test) if s.sensors == which]
        assert found.kind == "gain" and found.after > 1 - 1e-5
        assert_allclose(found.gain, gain, rtol=5e-3)  # the prior's mean is sampled


@pytest.mark.parametrize(("gain", "kind"), [(0.0, "dead"), (1e-6, "gain")])
def test_a_sensor_that_reads_nothing_is_dead_and_one_of_another_unit_is_not(gain, kind):
    for seed in range(100, 104):
        test, which = measured(seed, "gain", gain=gain)
        assert (kind, which) in [(s.kind, s.sensors) for s in suspects(test)]


def test_scale_and_sign_of_measured_modes_change_nothing():
    test, _ = measured(100, "exchanged")
    scaled = ef.Measurements(test.frequencies, test.shapes * [-1.0, 30.0, -1e-4])
    for one, other in zip(suspects(test), suspects(scaled), strict=True):
        assert (one.kind, one.sensors) == (other.kind, other.sensors)
        assert_allclose([one.before, one.after], [other.before, other.after])


def test_a_sensor_that_some_modes_lack_is_named_by_the_others():
    test, which = measured(101, "turned")
    shapes = test.shapes.copy()
    shapes[int(which[0][1:]) - 1, 0] = np.nan
    shapes[int(which[0][1:]) % N, 2] = np.nan
    found = suspects(ef.Measurements(test.frequencies, shapes))
    assert ("turned", which) in [(s.kind, s.sensors) for s in found]


def test_an_exchange_that_changes_nothing_is_not_suspect():
    """In a symmetric chain left and right may be exchanged, and nothing is seen."""
    springs = SPRINGS | {"k": (N, 0, 1.0)}
    model = ef.MassSpringModel([1.0] * N, springs, shapes=True)
    solved = model({name: np.ones(1) for name in springs})
    shapes = solved.shapes[0][:, :3]
    prior = ef.IndependentPrior(dict.fromkeys(springs, (0.8, 1.2)))
    mirrored = ef.Measurements(solved.frequencies[0, :3], shapes[::-1])
    assert not suspects(mirrored, model, prior)


def test_of_two_sensors_that_point_apart_both_are_named():
    """Turning one is turning the other, but for the sign of a mode."""
    solved = MODEL({name: np.ones(1) for name in SPRINGS})
    shapes = solved.shapes[0][[3, 5], :1] * [[1.0], [-1.0]]
    test = ef.Measurements(solved.frequencies[0, :1], shapes, dofs=[3, 5])
    paired = ef.PairedModel(MODEL, test, candidates=1)
    term = ef.FrequencyTerm(test, relative_sd=0.01)
    check = ef.check_test(ef.LogPosterior(paired, term, PRIOR))
    turned = [s for s in check.suspects if s.kind == "turned"]
    assert {s.sensors for s in turned} == {("s1",), ("s2",)}
    assert_allclose(turned[0].after, turned[1].after)


@pytest.mark.parametrize(
    "moving", [pytest.param(n, marks=[pytest.mark.slow] * (n != 4)) for n in (2, 4, 15)]
)
def test_the_odds_are_those_of_errors_of_unknown_variance(moving):
    """By quadrature over the variance, of a scaled inverse chi^2 law."""
    test, _ = measured(0, n_modes=1)
    paired = ef.PairedModel(MODEL, test)
    count = len(sensors.list_alternatives(paired))
    dof, guess = sensors.USUAL_WEIGHT, sensors.USUAL_ERROR**2
    law = stats.invgamma(dof / 2, scale=dof * guess / 2)

    def evidence(mac):
        def density(log_variance):
            v = np.exp(log_variance)
            log = -0.5 * ((moving - 1) * log_variance + (1 - mac) / v)
            return np.exp(log + law.logpdf(v) + log_variance)

        return np.log(integrate.quad(density, -16, 3, limit=400, epsabs=0)[0])

    needed = np.log(count / sensors.FAULTY)
    before = 0.55

    def surplus(log_missing):
        return evidence(1 - np.exp(log_missing)) - evidence(before) - needed

    if surplus(np.log(1e-9)) < 0:  # so few data cannot tell
        ends = (1e-9,)
    else:
        exact = np.exp(optimize.brentq(surplus, np.log(1e-9), np.log(0.4)))
        ends = 1.02 * exact, 0.98 * exact
    for missing, found in zip(ends, (False, True), strict=False):
        macs = np.full((1, 1 + count, 1), before)
        macs[0, 3] = 1 - missing
        tried = np.ones((1, count)), macs, np.full((1, 1), moving)
        assert bool(sensors.weigh_sensors(paired, [tried], "")) == found
    assert moving == 2 or len(ends) == 2


def test_what_other_parameters_explain_is_not_suspect():
    """A prior mean far from the truth: draws come near, and no sensor is turned."""
    at = {name: np.ones(1) for name in SPRINGS}
    far = PRIOR.sample(np.random.default_rng(0), sensors.DRAWS_ASKED)[5]

    class Moved:
        """The chain, whose first sensor is turned near the prior mean alone."""

        variables, names = MODEL.variables, tuple(SPRINGS)

        def __call__(self, parameters):
            solved = MODEL(parameters)
            theta = np.stack([parameters[name] for name in SPRINGS], axis=1)
            near = np.abs(theta - far).max(axis=1) > 1e-9
            shapes = solved.shapes.copy()
            shapes[near, 4] *= -1
            return solved._replace(shapes=shapes)

    solved = MODEL(at | dict(zip(SPRINGS, far[:, None], strict=True)))
    test = ef.Measurements(solved.frequencies[0, :3], solved.shapes[0][:, :3])
    mean = np.ones((1, N))
    (found,), solves = sensors.suspect_sensors(posterior(test, Moved()), mean)
    assert not found and solves == 1 + sensors.DRAWS_ASKED


def test_draws_that_fail_are_done_without():
    test, which = measured(100, "turned")

    class Fails:
        variables, names = MODEL.variables, tuple(SPRINGS)

        def __call__(self, parameters):
            if len(parameters["k0"]) > 1:
                raise ef.contracts.SolveError("no luck", "it did not converge")
            return MODEL(parameters)

    found = suspects(test, Fails())
    assert ("turned", which) in [(s.kind, s.sensors) for s in found]
