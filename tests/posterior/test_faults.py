"""A solve that fails, however it does: what is raised, and where it was."""

import numpy as np
import pytest
from support.faulty import FAULTS, MODELS, is_as_raised, posterior

import emcee_femu as ef


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("fault", FAULTS)
def test_an_evaluation_says_what_was_wrong_and_where(model, fault):
    log_posterior = posterior(model, fault, column=1)
    with pytest.raises((ValueError, RuntimeError, ArithmeticError)) as caught:
        log_posterior([1.5, 0.75])
    assert is_as_raised(caught.value, fault)
    text = "\n".join([str(caught.value), *getattr(caught.value, "__notes__", ())])
    assert 1 <= text.count("{'k': 1.5, 'm': 0.75}") <= 2
    assert np.isfinite(log_posterior([[1.0, 1.0], [1.0, 1.1]])).all()


def broken(parameters):
    raise ArithmeticError("singular")


TERM = ef.FrequencyTerm([10.0, 20.0], sd=[0.5, 0.5])
PRIOR = ef.GaussianPrior(["a", "b"], [0, 0], [1, 1])


@pytest.mark.parametrize("number", [2, 256])
def test_a_batch_that_fails_names_its_parameter_sets_but_not_hundreds(number):
    with pytest.raises(ArithmeticError, match="singular") as caught:
        ef.LogPosterior(broken, TERM, PRIOR)([[1.5, 0.25]] * number)
    assert 1 < caught.value.__notes__[0].count("'a': 1.5, 'b': 0.25") < 20


@pytest.mark.parametrize(
    "function",
    [lambda p: [float(p["a"]), 2.0], lambda p: [p["a"], p["b"]]],
)
def test_a_function_of_one_parameter_set_is_told_how_it_becomes_a_model(function):
    with pytest.raises(TypeError) as caught:
        ef.LogPosterior(function, TERM, PRIOR)([[0.0, 0.0], [1.5, 0.25]])
    text = "\n".join([str(caught.value), *caught.value.__notes__])
    assert "FunctionModel(function)" in text


@pytest.mark.parametrize(
    ("function", "remedied"),
    [
        (lambda p: p["A"], True),
        (lambda p: [p[0], p[1]], True),
        (lambda p: {}["a"], False),  # a fault of another kind
    ],
)
def test_a_model_that_asks_for_a_wrong_name_is_told_the_right_ones(function, remedied):
    with pytest.raises(KeyError) as caught:
        ef.LogPosterior(ef.FunctionModel(function), TERM, PRIOR)([1.0, 1.0])
    place, *names = caught.value.__notes__
    assert "'a': 1.0" in place
    assert ["a, b" in note for note in names] == [True] * remedied
