"""Every public name says what it takes, returns, raises, and shows how it is used."""

import ast
import builtins
import doctest
import importlib
import inspect
import re

import pytest
from support.examples import load
from support.public import public_names

import emcee_femu as ef

# What the package hands out already made: these constructors check nothing.
RECORDS = {"ModalSolution", "Problem", "Published", "Table"}
PUBLIC = {name.rpartition(".")[2]: own for name, own in public_names().items()}
PUBLIC |= {"Table": ef.table.Table}
METHODS = {
    f"{owner.__name__}.{name}": getattr(owner, name)
    for owner in filter(inspect.isclass, PUBLIC.values())
    for name in vars(owner)
    if name[0] != "_" and inspect.isroutine(getattr(owner, name))
}
CONSTRUCTORS = {label: own for label, own in METHODS.items() if inspect.ismethod(own)}
USED = PUBLIC | CONSTRUCTORS


def sections(thing):
    """Return ``{title: lines}`` of a docstring."""
    found, title = {}, ""
    for line in inspect.getdoc(thing).splitlines():
        if head := re.fullmatch(r"([A-Z]\w+):", line):
            title = head[1]
        found.setdefault(title, []).append(line)
    return found


def entries(thing, title):
    """Return what a section describes, in order."""
    found = (
        re.match(r"    \*{0,2}(\w+): ", line) for line in sections(thing).get(title, [])
    )
    return [match[1] for match in found if match]


def parameters(thing):
    names = inspect.signature(thing).parameters
    return [name for name in names if name[0] != "_" and name != "self"]


@pytest.mark.parametrize("label", USED)
def test_an_example_runs_wherever_it_is_pasted(label):
    text = "\n".join(sections(USED[label]).get("Examples", []))
    source = "".join(e.source for e in doctest.DocTestParser().get_examples(text))
    assert source
    names = [n for n in ast.walk(ast.parse(source)) if isinstance(n, ast.Name)]
    made = {n.id for n in names if not isinstance(n.ctx, ast.Load)} | set(dir(builtins))
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.ImportFrom | ast.Import):
            made |= {alias.asname or alias.name for alias in node.names}
        elif isinstance(node, ast.arg):
            made.add(node.arg)
        elif isinstance(node, ast.FunctionDef | ast.ClassDef):
            made.add(node.name)
    assert {n.id for n in names} <= made


PROGRAMS = {  # whose examples doctest skips
    "from_opensees": lambda: load("how_to/opensees").load_opensees(),
    "from_pynite": lambda: importlib.import_module("Pynite"),
    "from_skfem": lambda: importlib.import_module("skfem"),
}


@pytest.mark.parametrize("name", PROGRAMS)
def test_the_example_of_an_fe_program_runs_where_there_is_one(name):
    try:
        PROGRAMS[name]()
    except ImportError as error:
        pytest.skip(str(error))
    text = inspect.getdoc(PUBLIC[name]).replace("# doctest: +SKIP", "")
    test = doctest.DocTestParser().get_doctest(text, {}, name, None, 0)
    assert len(test.examples) > 1
    assert doctest.DocTestRunner().run(test).failed == 0


@pytest.mark.parametrize("label", USED | METHODS)
def test_arguments_results_and_errors_are_described(label):
    thing = (USED | METHODS)[label]
    if label in RECORDS:
        assert entries(thing, "Attributes") == parameters(thing)
    elif label in USED or "Args" in sections(thing):
        assert entries(thing, "Args") == parameters(thing)
    if label in USED:
        assert inspect.isclass(thing) or "Returns" in sections(thing)
        described = label in RECORDS or "Raises" in sections(thing)
        assert described or not parameters(thing)
