"""What messages and docstrings name exists, and public things go by their names."""

import ast
import builtins
import importlib
import inspect
import pkgutil
import re

import emcee
import pytest
from support.public import public_names

import emcee_femu as ef

MODULES = [
    importlib.import_module(info.name)
    for info in pkgutil.walk_packages(ef.__path__, "emcee_femu.")
]
PUBLIC = {name.rpartition(".")[2] for name in public_names()}
ROOTS = ["arviz", "concurrent.futures", "emcee", "multiprocessing", "numpy", "queue"]
ROOTS += ["numpy.random", "pandas", "scipy.sparse", "scipy.stats", "subprocess"]
ROOTS += ["tempfile", "types"]
OTHERS = {name: importlib.import_module(name) for name in (*ROOTS, "xarray")}
# Names of people, programs, formats and journals, and of optional dependencies.
WORDS = {"ArviZ", "LaTeX", "McLachlan", "NaN", "NumPy", "PhysRevLett", "PyDREAM"}
WORDS |= {
    "CalculiX",
    "MatrixMarket",
    "PyMAPDL",
    "EnsembleSamplers",
    "RdBu_r",
    "SuperLU",
}
WORDS |= {"SymmetricMode"}
WORDS |= {"OpenSees", "FullGeneral", "GimmeMCK", "PyNite", "FEModel3D"}
WORDS |= {"ElementVector", "ElementLineP1", "MeshLine"}  # of scikit-fem
WORDS |= {"InferenceData", "arviz.InferenceData", "DataTree", "xarray.DataTree"}
OPTIONAL = ("dask.", "distributed.", "loky.", "mpi4py.", "ray.", "schwimmbad.")
CAMEL = r"(?<![\w.])(?:[a-z]\w*\.)*[A-Z]\w*[a-z]\w*[A-Z]\w*"
ROLE = r":(?:class|func|meth|mod|attr):`([^`]+)`"
CALL = r"(?<![\w.])(\w+)\(([^()]*)\)"


def strings(module):
    for node in ast.walk(ast.parse(inspect.getsource(module))):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield node.value


def reach(owner, path):
    """Return what a dotted path means inside an owner, None if it means nothing."""
    for part in path.split("."):
        owner = getattr(owner, part, None)
    return owner


def exists(name, module):
    name = name.removeprefix("~")  # Sphinx then shows the last part
    if name.startswith("."):  # Sphinx looks for these everywhere
        return any(reach(other, name[1:]) is not None for other in (ef, *MODULES))
    own = [value for value in vars(module).values() if inspect.isclass(value)]
    fields = {key for value in own for key in getattr(value, "__annotations__", {})}
    owners = [ef, *MODULES, *own, builtins, emcee, emcee.moves, *OTHERS.values()]
    roots = ("emcee_femu", "ef", *OTHERS)
    paths = [name, *(name.removeprefix(f"{root}.") for root in roots)]
    found = any(reach(owner, path) is not None for owner in owners for path in paths)
    known = name in PUBLIC | WORDS | fields or name.startswith(OPTIONAL)
    return known or found


@pytest.mark.parametrize("module", MODULES, ids=lambda module: module.__name__)
def test_what_is_named_exists(module):
    missing = set()
    for text in strings(module):
        named = {*re.findall(ROLE, text), *re.findall(CAMEL, text)}
        missing |= {name for name in named if not exists(name, module)}
        for name, given in re.findall(CALL, text):
            if callable(getattr(ef, name, None)):
                known = inspect.signature(getattr(ef, name)).parameters
                words = re.findall(r"(\w+)=", given)
                missing |= {f"{name}({word}=)" for word in words if word not in known}
    assert missing == set()


LOST = ["pairing.PairedModel", "NoModel", ".nothing", "ef.NoModel"]


@pytest.mark.parametrize("name", LOST)
def test_the_search_finds_what_it_is_for(name):
    assert not exists(name, ef)


def test_what_a_contract_may_have_is_listed():
    """Whatever is asked of a model, term, prior, move or response, if it has it."""
    asked = set()
    for module in MODULES:
        for node in ast.walk(ast.parse(inspect.getsource(module))):
            function = getattr(getattr(node, "func", None), "id", "")
            if function in ("getattr", "hasattr"):
                owner, name = ast.unparse(node.args[0]), ast.unparse(node.args[1])
                if re.search(r"\b(model|term|reader|prior|move|response)$", owner):
                    asked.add(name.strip("'"))
    listed = {*re.findall(r"^(\w+) +\w", ef.contracts.__doc__, re.M)}
    of_emcee = {"betas", "check", "get_proposal", "inner", "propose"}
    # Of priors, terms and responses of this package; a user's need not have them.
    own = {"distributions", "error_sd", "logpdfs", "measured", "unpaired"}
    of_pynite = {"load_combos"}
    rest = {"__name__", "k", "name", "shapes"}
    assert asked - listed <= of_emcee | of_pynite | own | rest
