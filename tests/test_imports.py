"""Two rings and their rules (CONTRIBUTING.md), and importing stays light."""

import ast
import re
import subprocess
import sys
from functools import cache
from pathlib import Path

from support.public import SUBJECTS, public_names

import emcee_femu

PACKAGE = Path(emcee_femu.__file__).parent
# The core is a pipeline: a folder imports from those before it, never from those after.
ORDER = (
    "checks contracts digits table measurements models likelihoods posterior "
    "evaluation moves search verdict sampling results figures extensions"
).split()
LAZY = {"", "figures", "moves"}  # these import names of extensions when asked for them
ALONE = {"contracts", "checks", "digits", "table", "moves"}  # all that moves may import


FILES = {
    ".".join(p.relative_to(PACKAGE).with_suffix("").parts): p
    for p in PACKAGE.rglob("*.py")
}
FILES = {name.removesuffix("__init__").rstrip("."): p for name, p in FILES.items()}


@cache
def nodes():
    """Return imports and calls in all modules, read when a test needs them."""
    kinds, found = (ast.Import, ast.ImportFrom, ast.Call), {}
    for name, path in FILES.items():
        tree = ast.parse(path.read_text("utf-8"))
        found[name] = [node for node in ast.walk(tree) if isinstance(node, kinds)]
    return found


def imports(module):
    """Yield the modules of the package that a module imports, anywhere in it."""
    package = module.split(".") if module else []
    if FILES[module].name != "__init__.py":
        package = package[:-1]
    for node in nodes()[module]:
        if isinstance(node, ast.ImportFrom) and node.level:
            base = package[: len(package) - node.level + 1]
            base += node.module.split(".") if node.module else []
            for alias in node.names:
                full = ".".join([*base, alias.name])
                yield full if full in FILES else ".".join(base)


@cache
def arrows():
    """Return which module imports which other."""
    return {
        (module, other)
        for module in FILES
        for other in imports(module)
        if other != module and not module.startswith(f"{other}.")
    }


def extension(module):
    """Return which extension a module belongs to, None for the core."""
    first, *rest = module.split(".")
    return rest[0] if first == "extensions" and rest else None


def test_the_core_knows_no_extension_and_no_extension_another():
    wrong = {
        (module, other)
        for module, other in arrows()
        if extension(other) not in (None, extension(module)) and module not in LAZY
    }
    assert wrong == set()


def test_folders_import_upwards_only():
    place = {folder: number for number, folder in enumerate(ORDER)}
    wrong = {
        (module, other)
        for module, other in arrows()
        if module not in LAZY
        and place[module.split(".")[0]] < place[other.split(".")[0]]
    }
    assert wrong == set()


def test_no_files_import_each_other_in_circles():
    left = {name: {b for a, b in arrows() if a == name} for name in FILES if name}
    while ends := [name for name, others in left.items() if not others & {*left}]:
        for name in ends:
            del left[name]
    assert sorted(left) == []  # what is left leads back to itself


def test_moves_stand_alone():
    folders = {b.split(".")[0] for a, b in arrows() if a.startswith("moves.")}
    assert folders <= ALONE


def test_nothing_is_imported_in_another_way():
    """The package never imports its own top level, and names no module in a string."""
    wrong = []
    for name, found in nodes().items():
        for node in found:
            whole = isinstance(node, ast.Import)
            whole = whole and any("emcee_femu" in a.name for a in node.names)
            whole |= isinstance(node, ast.ImportFrom) and (
                not node.level and (node.module or "").split(".")[0] == "emcee_femu"
            )
            named = getattr(node, "func", None)
            named = getattr(named, "attr", getattr(named, "id", ""))
            called = named in ("import_module", "__import__")
            call = ast.unparse(node) if called else ""
            other = re.search(r"\(['\"](?!\.|emcee_femu)", call)  # another package
            if whole or (called and not other and name not in LAZY):
                wrong.append((name, node.lineno))
    assert wrong == []


def test_importing_the_package_loads_no_plotting_no_arviz_and_no_program():
    code = "import sys, emcee_femu; print(*sys.modules)"
    loaded = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stdout.split()
    assert "emcee_femu.results.tables" in loaded
    assert not {"arviz", "corner", "matplotlib", "xarray", "pandas"} & set(loaded)
    assert not {"openseespy", "Pynite", "skfem"} & set(loaded)


def test_completion_offers_the_public_names_and_no_others():
    def offered(module):
        return {name for name in dir(module) if name[:2] != "__"}

    public = {*public_names()}
    assert offered(emcee_femu) == {n for n in public if "." not in n} | {*SUBJECTS}
    figures = {f"figures.{name}" for name in offered(emcee_femu.figures)}
    assert figures == {name for name in public if name.startswith("figures.")}
    assert offered(emcee_femu.moves) >= {"DEMCMove", "TemperedMove"}
    assert all(name.endswith("Move") for name in offered(emcee_femu.moves))
