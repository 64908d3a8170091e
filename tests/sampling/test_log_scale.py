"""Parameters over decades, and draws of which one has all weight."""

import numpy as np
import pytest
from scipy import integrate, stats
from support.few_solves import Gaussian, posed

import emcee_femu as ef
from emcee_femu.sampling.emulate_draws import Explorer, temper
from emcee_femu.sampling.emulate_problem import EmulationProblem
from emcee_femu.sampling.importance import kish_share
from emcee_femu.sampling.log_scale import LogScale

SPRING = stats.loguniform(1e3, 1e9)


@pytest.mark.parametrize(
    ("law", "expected"),
    [
        (SPRING, True),
        (stats.lognorm(1.5, scale=1e6), True),
        (stats.lognorm(0.3, scale=1e6), False),
        (stats.halfnorm(scale=0.01), False),
        (stats.uniform(0.0, 1e9), False),
        (stats.norm(0.0, 1.0), False),
    ],
)
def test_logarithms_are_taken_of_what_spans_decades(law, expected):
    prior = ef.IndependentPrior({"a": stats.norm(5.0, 1.0), "k": law})
    scale = LogScale.of(prior)
    assert scale.logs.tolist() == [False, expected]
    theta = prior.sample(np.random.default_rng(1), 200)
    x = scale.coordinates(theta)
    np.testing.assert_allclose(scale.parameters(x), theta, rtol=1e-12)
    # The density of the coordinates: its mass over a histogram of ln k is one.
    if expected:
        line = np.linspace(*np.log(law.ppf([1e-9, 1 - 1e-9])), 20_001)
        grid = np.column_stack([np.full(len(line), 5.0), line])
        density = scale.log_volume(grid) + law.logpdf(scale.parameters(grid)[:, 1])
        assert abs(integrate.trapezoid(np.exp(density), line) - 1) < 1e-3


def support(x):
    """Return frequencies of a beam on a spring that is soft, middling or fixed."""
    fixed = x[1] / (x[1] + 1e6)
    return np.sqrt(x[0]) * np.array([3 + 2 * fixed, 9 + 1.5 * fixed**1.5, 17 + fixed])


@pytest.mark.slow
def test_a_spring_over_six_decades_takes_few_solves():
    prior = ef.IndependentPrior({"e": ef.uniform_between(0.5, 1.5), "k": SPRING})
    term = Gaussian(np.array([4.0, 9.6, 17.4]), 0.04)
    posterior = posed(support, term=term, prior=prior)
    emulated = ef.emulate(posterior, 22, seed=1)
    axes = np.linspace(0.9, 1.1, 61), np.log(10.0) * np.linspace(3, 9, 241)
    grid = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
    theta = np.column_stack([grid[:, 0], np.clip(np.exp(grid[:, 1]), 1e3, 1e9)])
    exact = np.array([support(row) for row in theta])
    log_p = prior.logpdf(theta) - 0.5 * (((exact - term.data) / 0.04) ** 2).sum(axis=1)
    found = emulated.posterior(theta)[:, 0]
    shares = [np.exp(p + grid[:, 1] - (p + grid[:, 1]).max()) for p in (log_p, found)]
    exact, near = (share / share.sum() for share in shares)
    assert 0.5 * abs(exact - near).sum() < 0.03  # total variation
    # The derivatives are those by the spring, not by its logarithm.
    at = {"e": np.array([1.0]), "k": np.array([1e6])}
    step = {**at, "k": np.array([1e6 + 100.0])}
    slope = emulated.jacobian(at)[1]["y"]["k"]
    change = (emulated(step)["y"] - emulated(at)["y"]) / 100.0
    np.testing.assert_allclose(slope, change, rtol=1e-3)


def test_densities_are_those_of_the_logarithms():
    prior = ef.IndependentPrior({"e": ef.uniform_between(0.5, 1.5), "k": SPRING})
    posterior = posed(support, prior=prior)
    explorer = Explorer(EmulationProblem.of(posterior), LogScale.of(prior))
    explorer._posterior = posterior  # whose model is asked one point at a time
    x = explorer.scale.sample(np.random.default_rng(1), 1)
    rows = explorer.rows(x)
    # Uniform in ln k: 1 / ln 1e6, and 1 for e.
    np.testing.assert_allclose(rows[:, 1], -np.log(6 * np.log(10.0)))
    likelihood = posterior(explorer.scale.parameters(x))[:, 2]
    np.testing.assert_allclose(rows[:, 0], rows[:, 1] + likelihood)


def test_weights_of_one_draw_are_tempered_until_more_count():
    log_weights = np.append(-np.arange(0.0, 5000.0, 10.0), -np.inf)
    each = np.arange(len(log_weights))
    assert kish_share(log_weights) * len(log_weights) < 1.01
    tempered = temper(log_weights, 5, each)
    assert kish_share(tempered) * len(log_weights) >= 5
    assert tempered[-1] == -np.inf
    assert (temper(log_weights, 1, each) == log_weights).all()
    alone = np.array([0.0, -np.inf])
    assert (temper(alone, 5, np.arange(2)) == alone).all()


def test_copies_of_a_draw_count_as_one():
    log_weights = np.repeat(-np.arange(0.0, 500.0, 10.0), 10)
    tempered = temper(log_weights, 5, np.repeat(np.arange(50), 10))
    assert kish_share(log_weights) * 500 > 5  # as if they were draws of their own
    assert kish_share(tempered[::10]) * 50 >= 5
