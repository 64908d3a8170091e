"""Gradient and information of the posterior: analytic, by differences, and beside."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy import stats
from support.gradients import MEASURED, SHAPES, Derived, Solver, numerical

import emcee_femu as ef

PRIOR = ef.IndependentPrior(
    {"a": stats.norm(1, 0.2), "b": stats.lognorm(0.2), "s": stats.halfnorm(0, 0.1)},
    bounds={"a": (0.5, 1.6)},
)
FREQUENCY = ef.FrequencyTerm(MEASURED, sd=0.05, discrepancy="s")
SHAPE = ef.ShapeTerm(SHAPES, delta=0.2)
THETA = PRIOR.sample(np.random.default_rng(0), 6)


def cubic(parameters, response):
    """A term that is only a function, of response and parameters."""
    return -(np.abs(response.frequencies[:, 1]) ** 3) - 4 * parameters["s"] ** 2


cubic.names = ("s",)


class Declared:
    """A term of the user with deviations, but without derivatives."""

    name, names = "declared", ("s",)

    def __call__(self, parameters, response):
        r, sd = self.deviations(parameters, response)
        return stats.norm.logpdf(r, 0, sd).sum(axis=1)

    def deviations(self, parameters, response):
        r = np.log(response.frequencies / MEASURED)
        return r, np.tile(0.03 + parameters["s"][:, None], 3)


def rejecting(parameters, response):
    return np.where(parameters["a"] > 1, -np.inf, 0.0)


TERMS = {
    "both": [FREQUENCY, SHAPE],
    "a function": [SHAPE, cubic],
    "deviations": [Declared(), SHAPE],
    "rejects": [FREQUENCY, rejecting],
}


def both(terms, prior=PRIOR):
    return [ef.LogPosterior(model(), terms, prior) for model in (Derived, Solver)]


@pytest.mark.parametrize("scale", [1e-9, 1.0, 1e9])
def test_a_parameter_that_only_terms_read_may_have_any_unit(scale):
    """The gradient in it is the exact one, although the prior has no bounds."""

    def shifted(parameters, response):
        return -0.5 * (parameters["shift"] / scale - 1) ** 2

    shifted.names = ("shift",)
    laws = {"a": stats.norm(1, 0.2), "b": stats.lognorm(0.2)}
    prior = ef.IndependentPrior(laws | {"shift": stats.norm(0.0, scale)})
    term = ef.FrequencyTerm(MEASURED, sd=0.05)
    posterior = ef.LogPosterior(Derived(), [term, shifted], prior)
    theta = np.array([[1.0, 1.0, 3.0 * scale]])
    slope = posterior.gradient(theta)[1][0, 2] * scale
    assert slope == pytest.approx(-3.0 - 2.0, rel=1e-6)  # of prior and term


@pytest.mark.parametrize("terms", TERMS.values(), ids=TERMS)
def test_gradient_and_information_are_those_of_the_log_posterior(terms):
    derived, black_box = both(terms)
    assert derived.differentiable and not black_box.differentiable
    rows = derived(THETA)
    there = rows[:, 0] > -np.inf
    assert there.all() == (rejecting not in terms) and there.any()
    expected = numerical(lambda theta: derived(theta)[:, 0], THETA[there], 1e-6)
    largest = np.abs(expected).max()
    for posterior, each in ((derived, 1), (black_box, 1 + 2 * 3)):
        posterior.model.solved.clear()
        found, gradient = posterior.gradient(THETA)
        if rejecting not in terms:  # one solve, or those of central differences
            assert sum(posterior.model.solved) == len(THETA) * each
        assert_allclose(found, rows, rtol=1e-12)
        assert_allclose(gradient[there], expected, rtol=1e-6, atol=1e-6 * largest)
        assert np.isnan(gradient[~there]).all()
    analytic, by_differences = derived.linearize(THETA), black_box.linearize(THETA)
    assert_allclose(analytic.gradient, by_differences.gradient, rtol=1e-6, atol=1e-6)
    if cubic in terms or rejecting in terms:  # which do not tell
        assert analytic.information is by_differences.information is None
        return
    assert_allclose(
        analytic.information, by_differences.information, rtol=1e-6, atol=1e-6
    )  # some are zero


def test_signs_and_lengths_of_shapes_may_differ_from_solve_to_solve():
    """As those of any eigensolver do."""
    rng = np.random.default_rng(0)

    class Arbitrary(Solver):
        def __call__(self, parameters):
            frequencies, shapes = super().__call__(parameters)
            factors = rng.uniform(0.5, 2, (len(shapes), 1, 3))
            factors *= rng.choice([-1.0, 1.0], factors.shape)
            return ef.ModalSolution(frequencies, shapes * factors)

    for term in SHAPE, ef.ShapeTerm(SHAPES, sd=0.2):
        local, exact = (
            ef.LogPosterior(model, [FREQUENCY, term], PRIOR).linearize(THETA)
            for model in (Arbitrary(), Derived())
        )
        assert_allclose(local.gradient, exact.gradient, rtol=1e-6, atol=1e-6)
        assert_allclose(local.information, exact.information, rtol=1e-6, atol=1e-6)


def test_nothing_is_solved_out_of_bounds_and_differences_stay_inside():
    """Points on a bound, in a corner, and outside."""
    prior = ef.GaussianPrior(["a", "b"], [1, 1], [0.2, 0.2], [(0.5, 1.5)] * 2)
    term = ef.FrequencyTerm(MEASURED, sd=0.05)
    theta = np.array([[0.5, 1.0], [1.5, 1.5], [0.4, 1.0], [1.2, 0.5], [np.inf, 1.0]])
    outside = [False, False, True, False, True]

    class Inside(Solver):
        def __call__(self, parameters):
            for value in parameters.values():
                assert ((value >= 0.5) & (value <= 1.5)).all()
            return super().__call__(parameters)

    derived = ef.LogPosterior(Derived(), term, prior)
    black_box = ef.LogPosterior(Inside(), term, prior)
    (rows, gradient), (same, close) = (p.gradient(theta) for p in (derived, black_box))
    assert sum(derived.model.solved) == 3 and sum(black_box.model.solved) == 3 * 5
    for slopes in (gradient, close):
        assert_array_equal(np.isnan(slopes), np.tile(outside, (2, 1)).T)
    assert_allclose(rows, derived(theta))
    assert_allclose(same, rows)
    assert_allclose(close, gradient, rtol=1e-6)


class Ring:
    """A prior without gradient whose support is a thin disc about (1, 1)."""

    names, bounds = ("a", "b"), np.array([[0.0, 2.0]] * 2)

    def logpdf(self, theta):
        square = ((theta - 1) ** 2).sum(axis=1)
        return np.where(square < 0.25, -3 * square, -np.inf)

    def sample(self, rng, n):
        return 1 + rng.uniform(-0.3, 0.3, (n, 2))


def test_a_prior_needs_no_gradient_and_no_rectangle():
    theta = np.array([[1.1, 0.8], [1.0, 1.5 - 1e-7]])  # the second at the rim
    term = ef.FrequencyTerm(MEASURED, sd=0.05)
    derived, black_box = both(term, Ring())
    local, other = derived.linearize(theta), black_box.linearize(theta)
    likelihood = numerical(lambda x: derived(x)[:, 2], theta[:1])
    assert_allclose(local.gradient[:1], likelihood - 6 * (theta[:1] - 1), rtol=1e-6)
    assert_allclose(other.gradient[0], local.gradient[0], rtol=1e-6)
    flat = both(term, ef.IndependentPrior({k: stats.uniform(0, 2) for k in "ab"}))[0]
    fisher = flat.linearize(theta).information
    assert_allclose(local.information[0], fisher[0] + 6 * np.eye(2), rtol=1e-6)


def test_a_joint_posterior_adds_its_experiments():
    term = ef.FrequencyTerm(MEASURED, sd=0.05)
    names, bounds = ["a", "b", "s"], [(0.1, 2), (0.1, 2), (0.01, 1)]
    prior = ef.GaussianPrior(names, [1, 1, 0.1], [0.2, 0.2, 0.01], bounds)
    theta = prior.sample(np.random.default_rng(1), 4)
    two = {"one": (Derived(), [term, SHAPE]), "two": (Derived(), FREQUENCY)}
    mixed = two | {"two": (Solver(), FREQUENCY)}
    joint = ef.LogPosterior.joint(two, prior)
    half = ef.LogPosterior.joint(mixed, prior)
    assert joint.differentiable and not half.differentiable
    same = ef.FrequencyTerm(MEASURED, sd=0.05, name="same")
    single = ef.LogPosterior(Derived(), [same, SHAPE, FREQUENCY], prior)
    local, expected = joint.linearize(theta), single.linearize(theta)
    assert_allclose(local.gradient, expected.gradient, rtol=1e-12)
    assert_allclose(local.information, expected.information, rtol=1e-12)
    assert_allclose(half.gradient(theta)[1], expected.gradient, rtol=1e-6)


def test_a_function_near_a_bound_and_of_a_steep_response_is_differenced():
    """As log(s) near zero, and with a response that is doubled by a tiny step."""

    class Steep:
        names, variables = ("a", "b", "s"), ef.modal_variables(1)
        solves = 0

        def __call__(self, parameters):
            self.solves += 1
            return ef.ModalSolution(np.exp(1e6 * (parameters["a"][:, None] - 1)))

        def jacobian(self, parameters):
            response = self(parameters)
            return response, {"frequency": {"a": 1e6 * response.frequencies}}

    def term(parameters, response):
        return np.log(parameters["s"]) - np.log1p(response.frequencies[:, 0] ** 2)

    term.names = ("s",)
    prior = ef.IndependentPrior({name: stats.uniform(0, 2) for name in Steep.names})
    posterior = ef.LogPosterior(Steep(), term, prior)
    gradient = posterior.gradient(np.array([[1 + 1e-7, 1.0, 1e-6]]))[1][0]
    square = np.exp(0.2)
    assert_allclose(gradient, [-2e6 * square / (1 + square), 0, 1e6], rtol=1e-6)
    assert posterior.model.solves == 1


@pytest.mark.parametrize(
    ("change", "named"),  # what a jacobian returns of its derivatives
    [
        (lambda d: {"shapes": {"b": d["shapes"]["b"][:, :2]}}, "'shapes'.*'b'"),
        (lambda d: {"shapes": None}, "'shapes'"),
        (lambda d: {"frequency": {"a": np.nan * THETA}}, "gradient"),
    ],
)
def test_wrong_derivatives_are_refused_by_name(change, named):
    class Wrong(Derived):
        def jacobian(self, parameters):
            response, slopes = super().jacobian(parameters)
            slopes |= change(slopes)
            return response, {k: v for k, v in slopes.items() if v is not None}

    with pytest.raises(ValueError, match=named):
        ef.LogPosterior(Wrong(), [FREQUENCY, SHAPE], PRIOR).gradient(THETA)
