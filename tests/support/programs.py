"""FE programs that tests call."""

import doctest
import inspect

import pytest

from .examples import load


def opensees():
    """Return OpenSeesPy, or skip the test."""
    try:
        return load("how_to/opensees").load_opensees()
    except ImportError as error:
        pytest.skip(str(error))


def run_example(function):
    """Run the example of a docstring, which is skipped where the program is missing."""
    text = inspect.getdoc(function).replace("# doctest: +SKIP", "")
    name = function.__name__
    test = doctest.DocTestParser().get_doctest(text, {}, name, None, 0)
    assert len(test.examples) > 1
    assert doctest.DocTestRunner().run(test).failed == 0
