"""Malformed input: that all of the package is thrown at, and no file is unpickled."""

import ast
import inspect
from pathlib import Path

import pytest
import test_bad_input_called as called
import test_bad_input_data as data
import test_bad_input_files as files
import test_bad_input_models as models
import test_bad_input_moves as moves
import test_bad_input_results as results
import test_bad_input_runs as runs
import test_bad_input_terms as terms
from support.border import SHARE, judge

import emcee_femu as ef
from emcee_femu import paper
from emcee_femu.models import pairing
from emcee_femu.posterior import priors

PARTS = (data, terms, models, called, moves, runs, results, files)
TARGETS = {name: target for part in PARTS for name, target in part.TARGETS.items()}
PACKAGE = Path(ef.__file__).parent
# Records that the package fills in. What a user's model returns in a ModalSolution is
# thrown at LogPosterior and FunctionModel; MatrixModel.reduced makes ReducedModels.
RECORDS = {"ModalSolution", "ReducedModel", "Published", "Problem"}
# They get bytes from the pool that the caller made, and read no file.
FROM_POOLS = {"worker.py", "pickling.py"}
LOADERS = {"pickle", "cPickle", "_pickle", "cloudpickle", "dill", "joblib", "shelve"}
LOADERS |= {"marshal", "pandas"}


def public():
    """Return the names of all public classes, functions and class methods."""
    for module in (ef, paper, pairing, priors):
        for name, value in vars(module).items():
            own = getattr(value, "__module__", "").startswith("emcee_femu")
            if name.startswith("_") or not callable(value) or not own:
                continue
            if module is not ef and value.__module__ != module.__name__:
                continue
            if name in RECORDS or name in INTERNAL:
                continue
            prefix = "paper." if module is paper else ""
            yield prefix + name
            if inspect.isclass(value):
                for method in vars(value).values():
                    if isinstance(method, classmethod):
                        yield f"{name}.{method.__name__}"


# Of pairing and priors, what takes arrays that the package has checked.
INTERNAL = {"at_sensors", "one_to_one", "cluster_bases", "checked_bounds", "inside"}
INTERNAL |= {"prior_summary"}


def test_every_public_name_is_thrown_at():
    named = {name.split(" ")[0] for name in TARGETS}
    assert set(public()) - named == set()
    more = {"reduce_model", "LogPosterior.start", "Measurements.to_csv", "mac"}
    assert more < named and "LogPosterior called" in TARGETS


def test_every_argument_of_every_public_name_is_thrown_at():
    """Also of those that are added later: their names are read from the signatures."""
    thrown = {}
    for name, target in TARGETS.items():
        seen = {*target.arguments, *target.fixed}
        thrown.setdefault(name.split(" ")[0], set()).update(seen)
    missing = {}
    for name in sorted(set(public())):
        owner, _, method = name.removeprefix("paper.").partition(".")
        module = paper if name.startswith("paper.") else ef
        value = getattr(module, owner, None) or getattr(priors, owner, None)
        value = value or getattr(pairing, owner)
        given = inspect.signature(getattr(value, method) if method else value)
        left = set(given.parameters) - thrown[name]
        if left:
            missing[name] = left
    assert missing == {}


def test_ten_thousand_malformed_inputs_are_thrown_by_default():
    """Each property asserts that it threw its share of what it planned."""
    planned = sum(target.planned for target in TARGETS.values())
    assert SHARE * planned + 2 * files.FILES >= 10_000


@pytest.mark.slow
@pytest.mark.parametrize("name", TARGETS)
def test_every_malformed_input(name):
    """All that the properties choose from: another hypothesis chooses others."""
    for argument, own in TARGETS[name].arguments.items():
        telling, others = own.malformed()
        for bent in (*telling, *(bent for group in others for bent in group)):
            judge(TARGETS[name], argument, bent)


def calls_and_imports(tree):
    """Return the imported modules and the names of keywords of all calls."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name.split(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and not node.level:
            yield (node.module or "").split(".")[0]
        elif isinstance(node, ast.Call):
            yield from (k.arg for k in node.keywords if k.arg == "allow_pickle")
            function = node.func
            name = getattr(function, "attr", getattr(function, "id", ""))
            if name in ("load", "loads", "read_pickle", "eval", "exec"):
                owner = getattr(function, "value", None)
                yield f"{ast.unparse(owner)}.{name}" if owner is not None else name
            if name == "import_module" and isinstance(node.args[0], ast.Constant):
                yield node.args[0].value.split(".")[0]


FORBIDDEN = LOADERS | {"allow_pickle", "np.load", "numpy.load", "eval", "exec"}
DUMPS_ONLY = {"back_ends.py": {"pickle", "cloudpickle"}}


@pytest.mark.parametrize(
    "path",
    [p for p in PACKAGE.rglob("*.py") if p.name not in FROM_POOLS],
    ids=lambda path: path.name,
)
def test_no_module_reads_a_file_by_pickle(path):
    found = set(calls_and_imports(ast.parse(path.read_text(encoding="utf-8"))))
    forbidden = found & FORBIDDEN - DUMPS_ONLY.get(path.name, set())
    loads = {name for name in found if name.split(".")[-1] in ("load", "loads")}
    assert forbidden == set() and loads <= {"json.loads", "json.load"}


@pytest.mark.parametrize("name", sorted(FROM_POOLS))
def test_what_unpickles_opens_no_file(name):
    (path,) = PACKAGE.rglob(name)
    tree = ast.parse(path.read_text(encoding="utf-8"))
    called = {
        getattr(node.func, "id", getattr(node.func, "attr", ""))
        for node in ast.walk(tree)
        if isinstance(node, ast.Call)
    }
    files_of = {"open", "load", "read", "read_bytes", "read_text", "fromfile"}
    assert called.isdisjoint(files_of)


@pytest.mark.parametrize(
    "text",
    [
        "import pickle",
        "from joblib import load",
        "numpy.load('a.npy', allow_pickle=True)",
        "import_module('dill')",
        "np.load('a')",
    ],
)
def test_the_search_finds_what_it_is_for(text):
    assert set(calls_and_imports(ast.parse(text))) & FORBIDDEN
