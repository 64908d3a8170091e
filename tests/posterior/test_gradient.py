"""Gradient and information of the posterior: analytic, by differences, and beside."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy import stats

import emcee_femu as ef
from emcee_femu.interfaces import PairedSolution, Pairing
from tests.support.gradients import (
    MEASURED,
    SHAPES,
    Derived,
    Solver,
    modes,
    numerical,
)

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
    """A term of the user with deviations, but without linearize."""

    name, names = "declared", ("s",)

    def __call__(self, parameters, response):
        r, sd = self.deviations(parameters, response)
        return stats.norm.logpdf(r, 0, sd).sum(axis=1)

    def deviations(self, parameters, response):
        r = np.log(response.frequencies / MEASURED)
        return r, np.tile(0.03 + parameters["s"][:, None], 3)


TERMS = {
    "frequency": [FREQUENCY],
    "both": [FREQUENCY, SHAPE],
    "a function": [SHAPE, cubic],
    "deviations": [Declared(), SHAPE],
}


def both(terms, prior=PRIOR):
    return [ef.LogPosterior(model(), terms, prior) for model in (Derived, Solver)]


@pytest.mark.parametrize("terms", TERMS.values(), ids=TERMS)
def test_gradients_are_those_of_the_log_posterior(terms):
    derived, black_box = both(terms)
    assert derived.differentiable
    assert not black_box.differentiable
    expected = numerical(lambda theta: derived(theta)[:, 0], THETA, 1e-6)
    largest = np.abs(expected).max()
    for posterior in (derived, black_box):
        rows, gradient = posterior.gradient(THETA)
        assert_array_equal(rows, posterior(THETA))
        assert_allclose(gradient, expected, rtol=1e-6, atol=1e-6 * largest)


@pytest.mark.parametrize("terms", TERMS.values(), ids=TERMS)
def test_information_is_the_same_with_and_without_a_jacobian(terms):
    analytic, by_differences = (p.linearize(THETA) for p in both(terms))
    assert_allclose(analytic.gradient, by_differences.gradient, rtol=1e-6, atol=1e-6)
    if cubic in terms:  # which does not tell
        assert analytic.information is by_differences.information is None
        return
    assert_allclose(analytic.information, by_differences.information, rtol=1e-6)


def test_signs_and_lengths_of_shapes_may_differ_from_solve_to_solve():
    """As those of any eigensolver do."""
    rng = np.random.default_rng(0)

    class Arbitrary(Solver):
        def __call__(self, parameters):
            frequencies, shapes = super().__call__(parameters)
            factors = rng.uniform(0.5, 2, (len(shapes), 1, 3))
            return ef.ModalSolution(
                frequencies, shapes * rng.choice([-1.0, 1.0], factors.shape) * factors
            )

    for term in SHAPE, ef.ShapeTerm(SHAPES, sd=0.2):
        expected = ef.LogPosterior(Derived(), [FREQUENCY, term], PRIOR).linearize(THETA)
        found = ef.LogPosterior(Arbitrary(), [FREQUENCY, term], PRIOR).linearize(THETA)
        assert_allclose(found.gradient, expected.gradient, rtol=1e-6, atol=1e-6)
        information = expected.information
        assert_allclose(found.information, information, rtol=1e-6, atol=1e-6)


def test_one_solve_per_point_or_one_batch_of_differences():
    derived, black_box = both([FREQUENCY, SHAPE])
    derived.gradient(THETA), derived.linearize(THETA)
    assert derived.model.solved == [6, 6]
    black_box.gradient(THETA), black_box.linearize(THETA)
    assert black_box.model.solved == [6 * 7, 6 * 7]


class Linear:
    """f = A theta + 5, for a posterior that is Gaussian."""

    matrix = np.array([[1.0, 0.5, 0.0], [0.3, -1.0, 2.0]])
    variables = {"frequency": ef.Variable({"mode": [1, 2]}, "Hz")}

    def __call__(self, parameters):
        theta = np.stack([parameters[name] for name in ("x", "y", "z")], axis=1)
        return {"frequency": 5 + theta @ self.matrix.T}

    def jacobian(self, parameters):
        response = self(parameters)
        columns = zip(("x", "y", "z"), self.matrix.T, strict=True)
        tile = {k: np.tile(v, (len(parameters["x"]), 1)) for k, v in columns}
        return response, {"frequency": tile}


@pytest.mark.parametrize("analytic", [True, False])
def test_a_conjugate_gaussian_is_exact(analytic):
    mean, sd = np.array([0.1, -0.2, 0.3]), np.array([1.0, 0.5, 2.0])
    model = Linear() if analytic else Linear().__call__
    term = ef.FrequencyTerm([5.2, 4.7], sd=[0.1, 0.3])
    posterior = ef.LogPosterior(
        model, term, ef.GaussianPrior("x y z".split(), mean, sd)
    )
    precision = Linear.matrix.T @ np.diag([1 / 0.01, 1 / 0.09]) @ Linear.matrix
    precision += np.diag(1 / sd**2)
    right = Linear.matrix.T @ ([0.2, -0.3] / np.array([0.01, 0.09])) + mean / sd**2
    top = np.linalg.solve(precision, right)
    theta = posterior.start(5, seed=0)
    found = posterior.linearize(theta)
    tolerance = 1e-10 if analytic else 1e-8
    expected = (top - theta) @ precision
    assert_allclose(found.gradient, expected, atol=tolerance * np.abs(expected).max())
    assert_allclose(found.information, np.tile(precision, (5, 1, 1)), rtol=1e-8)


def test_nothing_is_solved_out_of_bounds_and_differences_stay_inside():
    """Points on a bound, in a corner, and outside."""
    prior = ef.GaussianPrior(["a", "b"], [1, 1], [0.2, 0.2], [(0.5, 1.5)] * 2)
    term = ef.FrequencyTerm(MEASURED, sd=0.05)
    theta = np.array([[0.5, 1.0], [1.5, 1.5], [0.4, 1.0], [1.2, 0.5], [np.inf, 1.0]])
    derived, black_box = both(term, prior)
    expected = derived.gradient(theta)
    assert_array_equal(expected[0], derived(theta))
    outside = [False, False, True, False, True]
    assert_array_equal(np.isnan(expected[1]).all(axis=1), outside)
    assert_array_equal(np.isnan(expected[1]).any(axis=1), outside)
    assert derived.model.solved[0] == 3

    class Within(Solver):
        def __call__(self, parameters):
            for value in parameters.values():
                assert ((value >= 0.5) & (value <= 1.5)).all()
            return super().__call__(parameters)

    inside = ef.LogPosterior(Within(), term, prior)
    rows, gradient = inside.gradient(theta)
    assert_array_equal(rows, expected[0])
    assert_allclose(gradient, expected[1], rtol=1e-6)
    assert inside.model.solved == [3 * 5]
    nothing = inside.linearize(theta[2:3])
    assert nothing.rows[0, 0] == -np.inf
    assert np.isnan(nothing.gradient).all()
    assert inside.model.solved == [3 * 5]


@pytest.mark.parametrize("model", [Derived, Solver])
def test_where_a_term_rejects_there_is_no_gradient(model):
    class Rejecting:
        def __call__(self, parameters, response):
            return np.where(parameters["a"] > 1, -np.inf, 0.0)

        def linearize(self, parameters, response, tangents):
            return np.zeros((len(parameters["a"]), 3)), None

    terms = [FREQUENCY, Rejecting()]
    rows, gradient = ef.LogPosterior(model(), terms, PRIOR).gradient(THETA)
    rejected = THETA[:, 0] > 1
    assert 0 < rejected.sum() < len(THETA)
    assert_array_equal(rows[:, 0] == -np.inf, rejected)
    assert_array_equal(np.isnan(gradient).all(axis=1), rejected)
    assert_array_equal(np.isnan(gradient).any(axis=1), rejected)


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
    found, other = derived.linearize(theta), black_box.linearize(theta)
    likelihood = numerical(lambda x: derived(x)[:, 2], theta[:1])
    assert_allclose(found.gradient[:1], likelihood - 6 * (theta[:1] - 1), rtol=1e-6)
    assert_allclose(other.gradient[0], found.gradient[0], rtol=1e-6)
    flat = both(term, ef.IndependentPrior({k: stats.uniform(0, 2) for k in "ab"}))[0]
    fisher = flat.linearize(theta).information
    assert_allclose(found.information[0], fisher[0] + 6 * np.eye(2), rtol=1e-6)


def test_a_joint_posterior_adds_its_experiments():
    term = ef.FrequencyTerm(MEASURED, sd=0.05)
    names, bounds = ["a", "b", "s"], [(0.1, 2), (0.1, 2), (0.01, 1)]
    prior = ef.GaussianPrior(names, [1, 1, 0.1], [0.2, 0.2, 0.01], bounds)
    theta = prior.sample(np.random.default_rng(1), 4)
    two = {"one": (Derived(), [term, SHAPE]), "two": (Derived(), FREQUENCY)}
    mixed = {"one": (Derived(), [term, SHAPE]), "two": (Solver(), FREQUENCY)}
    joint = ef.LogPosterior.joint(two, prior)
    same = ef.FrequencyTerm(MEASURED, sd=0.05, name="same")
    single = ef.LogPosterior(Derived(), [same, SHAPE, FREQUENCY], prior)
    assert joint.differentiable
    found, expected = joint.linearize(theta), single.linearize(theta)
    assert_allclose(found.gradient, expected.gradient, rtol=1e-12)
    assert_allclose(found.information, expected.information, rtol=1e-12)
    half = ef.LogPosterior.joint(mixed, prior)
    assert not half.differentiable
    assert_allclose(half.gradient(theta)[1], expected.gradient, rtol=1e-6)


class Pairs(Derived):
    """Answers with the response of a paired model."""

    def __call__(self, parameters):
        frequencies, shapes = modes(parameters["a"], parameters["b"])
        n = len(frequencies)
        pairing = Pairing(np.ones((n, 3)), np.ones((n, 3), int), np.zeros((n, 3), bool))
        self.solved.append(n)
        return PairedSolution(frequencies, shapes, pairing)


@pytest.mark.parametrize("convert", ["mapping", "paired", "object"])
def test_functions_are_differenced_on_any_response(convert):
    """Along the tangents, without a solve, whatever the response is."""

    class Converted(Pairs if convert == "paired" else Derived):
        variables = ef.modal_variables(3, range(4))

        def jacobian(self, parameters):
            response, derivatives = super().jacobian(parameters)
            return self.convert(response), derivatives

        def convert(self, response):
            if convert == "paired":
                return response
            parts = {"frequency": response.frequency, "shapes": response.shapes}
            return parts if convert == "mapping" else Response(**parts)

    def term(parameters, response):
        mapping = convert == "mapping"
        frequency = response["frequency"] if mapping else response.frequency
        if convert == "paired":
            frequency = np.where(response.unpaired, 1.0, frequency)
        return -((frequency - 1) ** 2).sum(axis=1) * np.exp(parameters["s"])

    term.names = ("s",)
    posterior = ef.LogPosterior(Converted(), term, PRIOR)
    gradient = posterior.gradient(THETA)[1]
    assert posterior.model.solved == [6]

    def density(theta):
        frequency = modes(theta[:, 0], theta[:, 1])[0]
        squares = ((frequency - 1) ** 2).sum(axis=1)
        return PRIOR.logpdf(theta) - squares * np.exp(theta[:, 2])

    numbers = numerical(density, THETA, 1e-6)
    assert_allclose(gradient, numbers, rtol=1e-6, atol=1e-6 * np.abs(numbers).max())


def test_a_function_near_a_bound_and_of_a_steep_response_is_differenced():
    """As log(s) near zero, and with a response that is doubled by a tiny step."""

    class Steep(Derived):
        def __call__(self, parameters):
            self.solved.append(len(parameters["a"]))
            return ef.ModalSolution(np.exp(1e6 * (parameters["a"][:, None] - 1)))

        def jacobian(self, parameters):
            response = self(parameters)
            return response, {"frequency": {"a": 1e6 * response.frequencies}}

    def term(parameters, response):
        return np.log(parameters["s"]) - np.log1p(response.frequencies[:, 0] ** 2)

    model, names = Steep(), ["a", "b", "s"]
    model.names, model.n_modes, term.names = ("a", "b"), 1, ("s",)
    prior = ef.IndependentPrior({name: stats.uniform(0, 2) for name in names})
    posterior = ef.LogPosterior(model, term, prior)
    found = posterior.gradient(np.array([[1 + 1e-7, 1.0, 1e-6]]))[1][0]
    square = np.exp(0.2)
    assert_allclose(found, [-2e6 * square / (1 + square), 0, 1e6], rtol=1e-6)


class Response:
    def __init__(self, **parts):
        vars(self).update(parts)


MARGINALS = {
    "norm": stats.norm(3, 2),
    "truncnorm": stats.truncnorm(-1, 2, loc=3, scale=2),
    "uniform": stats.uniform(1, 4),
    "halfnorm": stats.halfnorm(scale=0.02),
    "expon": stats.expon(scale=5),
    "lognorm": stats.lognorm(s=0.3, scale=1e9),
    "t": stats.t(3, 1, 2),
    "gamma": stats.gamma(2.5, scale=3),
    "invgamma": stats.invgamma(3, scale=2),
    "beta": stats.beta(2, 5, loc=-1, scale=3),
    "weibull": stats.weibull_min(1.8, scale=4),
    "logistic": stats.logistic(2, 0.5),
}


@pytest.mark.parametrize("cut", [False, True], ids=["whole", "cut"])
@pytest.mark.parametrize("marginal", MARGINALS.values(), ids=MARGINALS)
def test_gradients_of_marginals_with_and_without_a_closed_form(marginal, cut):
    low, high = marginal.ppf([0.1, 0.8])
    bounds = {"x": (low, high)} if cut else None
    prior = ef.IndependentPrior({"x": marginal}, bounds)
    theta = np.linspace(low, high, 7)[1:-1, None]
    scaled = numerical(lambda z: prior.logpdf(z * high), theta / high) / high
    found = prior.gradient(theta)
    assert_allclose(found, scaled, rtol=1e-6, atol=1e-8 / (high - low))


@pytest.mark.parametrize(
    ("marginal", "expected"),
    [(stats.gamma(1, scale=2), -0.5), (stats.beta(1, 3), -2.0), (stats.expon(), -1.0)],
)
def test_a_marginal_has_a_gradient_on_its_bound(marginal, expected):
    gradient = ef.IndependentPrior({"x": marginal}).gradient(np.array([[0.0]]))
    assert_array_equal(gradient, [[expected]])


def test_wrong_derivatives_are_refused_by_name():
    def refuses(kind, message, change):
        class Wrong(Derived):
            def jacobian(self, parameters):
                return change(*super().jacobian(parameters))

        with pytest.raises(kind, match=message):
            ef.LogPosterior(Wrong(), [FREQUENCY, SHAPE], PRIOR).gradient(THETA)

    refuses(TypeError, r"jacobian: expected \{variable", lambda r, d: (r, 3.0))
    refuses(ValueError, "no parameter .'c'", lambda r, d: (
        r, d | {"frequency": {"c": d["frequency"]["a"]}}))  # fmt: skip
    refuses(ef.interfaces.SolveError, "derivative of 'shapes' by 'b'", lambda r, d: (
        r, d | {"shapes": {"b": d["shapes"]["b"][:, :2]}}))  # fmt: skip
    refuses(ValueError, "no derivatives of .'shapes'.*term 'shape'", lambda r, d: (
        r, {"frequency": d["frequency"]}))  # fmt: skip
    refuses(ef.interfaces.SolveError, "gradient of the log-posterior is", lambda r, d: (
        r, d | {"frequency": {"a": np.nan * r.frequencies}}))  # fmt: skip
