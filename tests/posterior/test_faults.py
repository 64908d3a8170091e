"""A solve that fails, however it does: what is raised, and where it was."""

from functools import partial

import numpy as np
import pytest
from support.faulty import FAULTS, MODELS, is_as_raised, posterior

import emcee_femu as ef


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize("column", [0, 1])
def test_an_evaluation_says_what_was_wrong_and_where(model, fault, column):
    log_posterior = posterior(model, fault, column)
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


def test_a_batch_that_fails_names_its_parameter_sets_but_not_hundreds():
    batch = ef.LogPosterior(broken, TERM, PRIOR)
    with pytest.raises(ArithmeticError, match="singular") as caught:
        batch([[0.0, 0.0], [1.5, 0.25]])
    assert "'a': 1.5, 'b': 0.25" in caught.value.__notes__[0]
    with pytest.raises(ArithmeticError) as caught:
        batch([[1.5, 0.25]] * 256)
    assert 1 < caught.value.__notes__[0].count("'a': 1.5") < 20
    assert "more" in caught.value.__notes__[0]


def one_set(parameters):
    return [float(parameters["a"]), 2.0]


@pytest.mark.parametrize(
    "function", [one_set, lambda p: [p["a"], p["b"]], partial(list)]
)
def test_a_function_of_one_parameter_set_is_no_model_and_says_how_it_becomes_one(
    function,
):
    posterior = ef.LogPosterior(function, TERM, PRIOR)
    with pytest.raises(TypeError) as caught:
        posterior([[0.0, 0.0], [1.5, 0.25]])
    text = "\n".join([str(caught.value), *caught.value.__notes__])
    assert "becomes a model by FunctionModel(function)" in text


class Typo:
    variables = ef.modal_variables(2)

    def __call__(self, parameters):
        return parameters["A"]


@pytest.mark.parametrize(
    ("model", "remedied"),
    [
        (ef.FunctionModel(lambda p: p["A"]), True),
        (Typo(), True),
        (ef.FunctionModel(lambda p: [p[0], p[1]]), True),
        (ef.FunctionModel(lambda p: {}["a"]), False),  # a fault of another kind
        (ef.FunctionModel(lambda p: {}[3]), False),
    ],
)
def test_a_model_that_asks_for_a_wrong_name_is_told_the_right_ones(model, remedied):
    with pytest.raises(KeyError) as caught:
        ef.LogPosterior(model, TERM, PRIOR)([1.0, 1.0])
    place, *names = caught.value.__notes__
    assert "'a': 1.0" in place
    assert ["a, b" in note for note in names] == [True] * remedied
