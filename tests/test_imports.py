"""The layers import downwards only, and importing the package stays light."""

import ast
import re
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import pytest

import emcee_femu

PACKAGE = Path(emcee_femu.__file__).parent
# The pipeline: a module may import those before it, never those after.
ORDER = [
    "interfaces",
    "checks",
    "table",
    "measurements",
    "models",
    "fe_files",
    "fe_programs",
    "likelihoods",
    "posterior",
    "evaluation",
    "moves",
    "sampling",
    "surrogates",
    "results",
    "population",
    "comparison",
    "figures",
    "frf",
    "reports",
    "paper",
]


def imported_layers(path):
    """Yield the layers that a module imports as it is imported itself."""
    package = ["emcee_femu", *path.relative_to(PACKAGE).parts[:-1]]
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.ImportFrom) and node.level:  # not under TYPE_CHECKING
            base = package[: len(package) - node.level + 1]
            full = [*base, *(node.module or "").split(".")]
            names = [full[1]] if len(full) > 1 and full[1] else []
            yield from names or [alias.name for alias in node.names]


def test_every_module_has_its_place_in_the_pipeline():
    files = {p.stem for p in PACKAGE.glob("*.py")} - {"__init__"}
    assert files | {p.parent.name for p in PACKAGE.glob("*/__init__.py")} <= set(ORDER)


@pytest.mark.parametrize("layer", ORDER)
def test_a_layer_imports_only_earlier_ones(layer):
    single = PACKAGE / f"{layer}.py"
    files = [single] if single.exists() else sorted((PACKAGE / layer).rglob("*.py"))
    allowed = set(ORDER[: ORDER.index(layer) + 1])
    later = {
        (file.relative_to(PACKAGE).as_posix(), name)
        for file in files
        for name in set(imported_layers(file)) - allowed
    }
    assert later == set()


def test_importing_the_package_loads_no_plotting_no_arviz_and_no_program():
    code = "import sys, emcee_femu; print(*sys.modules)"
    loaded = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stdout.split()
    assert "emcee_femu.results.tables" in loaded
    assert not {"arviz", "corner", "matplotlib", "xarray", "pandas"} & set(loaded)
    assert not {"openseespy", "Pynite", "skfem"} & set(loaded)


@pytest.mark.parametrize(
    ("library", "layers"),
    [
        ("arviz", {"results", "sampling"}),  # there Pareto k
        ("xarray", {"results"}),
        ("matplotlib", {"figures"}),
        ("corner", {"figures"}),
    ],
)
def test_no_other_layer_uses_a_heavy_library(library, layers):
    users = {
        p.relative_to(PACKAGE).with_suffix("").parts[0]
        for p in PACKAGE.rglob("*.py")
        if re.search(rf"(import|from) {library}\b", p.read_text(encoding="utf-8"))
    }
    assert users <= layers


def test_the_version_is_that_of_the_installed_package():
    assert emcee_femu.__version__ == version("emcee-femu")
