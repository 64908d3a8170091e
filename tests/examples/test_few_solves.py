"""The problems of the few-solves benchmark are those that they are said to be."""

import numpy as np
import pytest
from support.examples import load

import emcee_femu as ef

PROBLEMS = load("few_solves_problems")


@pytest.mark.parametrize("name", PROBLEMS.PROBLEMS)
def test_few_solves_problems(name):
    problem = PROBLEMS.PROBLEMS[name]()
    theta = problem.posterior.prior.sample(np.random.default_rng(1), 4)
    rows = problem.posterior(theta)
    assert np.isfinite(rows[:, 0]).all()
    assert problem.box.solves == 4  # the black box counts by itself
    assert not problem.posterior.differentiable


@pytest.mark.parametrize(
    ("name", "given"),
    [
        ("beck_au", lambda: PROBLEMS.beck_au_exactly().posterior),
        ("h_500", lambda: ef.paper.h_structure(500.0).posterior),
        ("h_50000", lambda: ef.paper.h_structure(5e4).posterior),
    ],
)
def test_their_posteriors_are_the_published_ones(name, given):
    theta = given().prior.sample(np.random.default_rng(2), 5)
    exact = given()(theta)[:, 0]
    found = PROBLEMS.PROBLEMS[name]().posterior(theta)[:, 0]
    np.testing.assert_allclose(np.diff(found), np.diff(exact), rtol=1e-9)
