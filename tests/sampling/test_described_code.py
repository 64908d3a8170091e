"""Functions and classes in a fingerprint: no change of code escapes it."""

import os
import sys
import types

import numpy as np
import pytest

from emcee_femu.sampling.fingerprint import differences, fingerprint


def of(value):
    """Return the fingerprint of one value."""
    return fingerprint(None, None, value=value)


def compiled(source, name="f", **names):
    """Return a function or class of a user's module that is written as source."""
    module = {"__name__": "users_script", "np": np, **names}
    exec(compile(source, "users_script.py", "exec"), module)
    return module[name]


def used(value, *arguments):
    value(*arguments)
    return value


SOURCES = {
    "a constant": ("def f(p): return p * 2.0", "def f(p): return p * 3.0", "value"),
    "an operation": ("def f(p): return p * 2", "def f(p): return p + 2", "value"),
    "a method's name": ("def f(p): return p.a()", "def f(p): return p.b()", "value"),
    "a default": ("def f(p, k=1): return k", "def f(p, k=2): return k",
                  "value(default)[0]"),
    "a keyword": ("def f(*, k=1): return k", "def f(*, k=2): return k",
                  "value(default)[k]"),
    "a global": ("K = 1\ndef f(p): return K", "K = 2\ndef f(p): return K",
                 "value(global).K"),
    "a global array": ("K = np.ones(99)\ndef f(p): return K",
                       "K = np.ones(98)\ndef f(p): return K", "value(global).K"),
    "a helper": ("def g(p): return 1\ndef f(p): return g(p)",
                 "def g(p): return 2\ndef f(p): return g(p)", "value(global).g"),
    "an inner function": ("def f(p): return map(lambda x: x + 1, p)",
                          "def f(p): return map(lambda x: x + 2, p)", "value"),
    "a set of constants": ("def f(p): return p in {'a', 'b'}",
                           "def f(p): return p in {'a', 'c'}", "value"),
    "a lambda": ("f = lambda p: 'a'", "f = lambda p: 'b'", "value"),
    "a class": ("class f:\n def g(self): return 1", "class f:\n def g(self): return 2",
                "value.g"),
    "a property": ("class f:\n @property\n def g(self): return 1",
                   "class f:\n @property\n def g(self): return 2", "value.g"),
    "a class method": ("class f:\n @classmethod\n def g(cls): return 1",
                       "class f:\n @classmethod\n def g(cls): return 2", "value.g"),
    "a class's number": ("class f:\n k = 1", "class f:\n k = 2", "value.k"),
    "a base": ("class g:\n k = 1\nclass f(g): pass",
               "class g:\n k = 2\nclass f(g): pass", "value(base)[0].k"),
    "the class of an object": ("class g:\n def h(self): return 1\nf = g()",
                               "class g:\n def h(self): return 2\nf = g()",
                               "value(class).h"),
}  # fmt: skip


@pytest.mark.parametrize("change", SOURCES)
def test_every_change_of_code_is_seen_and_named(change):
    one, other, path = SOURCES[change]
    lines = differences(of(compiled(one)), of(compiled(other)))
    assert len(lines) == 1 and lines[0].startswith(f"{path}: ")
    assert of(compiled(one)) == of(compiled(one))


COUNTER = """
calls = 0
def f(p):
    global calls
    calls += 1
    return calls
"""
OUTER = """
def g():
    calls = 0
    def f(p):
        nonlocal calls
        calls += 1
    return f
f = g()
"""


SAME = {
    "a docstring": (
        compiled("def f(p):\n 'One.'\n return p"),
        compiled("def f(p):\n 'Two.'\n return p"),
    ),
    "a global counter": (compiled(COUNTER), used(compiled(COUNTER), 1)),
    "an outer counter": (compiled(OUTER), used(compiled(OUTER), 1)),
}


@pytest.mark.parametrize("case", SAME)
def test_what_does_not_change_the_result_does_not_count(case):
    one, other = SAME[case]
    assert differences(of(one), of(other)) == []


def test_a_function_of_a_users_own_module_is_followed(monkeypatch):
    source = "import my_solver\ndef f(p): return my_solver.solve(p)"
    module = types.ModuleType("my_solver")
    monkeypatch.setitem(sys.modules, "my_solver", module)
    found = []
    for constant in (1, 2):
        module.solve = compiled(f"def f(p): return {constant}")
        found.append(of(compiled(source)))
    (line,) = differences(*found)
    assert line.startswith("value(global).my_solver.solve: was function")


def test_an_installed_package_is_named_with_its_version(monkeypatch):
    module = types.ModuleType("solver")
    module.__file__ = os.path.join("lib", "site-packages", "solver", "__init__.py")
    monkeypatch.setitem(sys.modules, "solver", module)
    function = compiled("def f(p): return 1")
    function.__module__ = "solver"
    module.__version__ = "1.2"
    assert of(function)["value"] == "function solver.f (solver 1.2)"
    other = compiled("def f(p): return 2")
    other.__module__ = "solver"
    assert of(other) == of(function)  # its code is that of its version
