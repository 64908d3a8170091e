"""The layers import downwards only, and importing the package stays light."""

import ast
import subprocess
import sys
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
    "surrogates",
    "likelihoods",
    "posterior",
    "moves",
    "sampling",
    "results",
    "population",
    "comparison",
    "figures",
    "paper",
]


def imported_stages(path):
    package = ["emcee_femu", *path.relative_to(PACKAGE).parts[:-1]]
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.level:
            base = package[: len(package) - node.level + 1]
            full = [*base, *(node.module or "").split(".")]
            names = [full[1]] if len(full) > 1 and full[1] else []
            yield from names or [alias.name for alias in node.names]


@pytest.mark.parametrize("stage", ORDER)
def test_a_stage_imports_only_earlier_ones(stage):
    single = PACKAGE / f"{stage}.py"
    files = [single] if single.exists() else sorted((PACKAGE / stage).rglob("*.py"))
    assert files
    allowed = set(ORDER[: ORDER.index(stage) + 1])
    for file in files:
        assert set(imported_stages(file)) <= allowed, file.name


def test_every_module_has_its_place_in_the_pipeline():
    found = {p.stem for p in PACKAGE.glob("*.py")} | {
        p.parent.name for p in PACKAGE.glob("*/__init__.py")
    }
    assert found - {"__init__"} == set(ORDER)


def test_importing_the_package_loads_no_plotting_and_no_arviz():
    code = "import sys, emcee_femu; print(*sys.modules)"
    loaded = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stdout.split()
    assert "emcee_femu.figures" in loaded
    assert not {"arviz", "corner", "matplotlib", "xarray", "pandas"} & set(loaded)


@pytest.mark.parametrize(
    ("library", "modules"),
    [
        ("arviz", {"results", "sampling"}),  # there Pareto k
        ("xarray", {"results"}),
        ("matplotlib", {"figures"}),
        ("corner", {"figures"}),
    ],
)
def test_no_other_module_uses_a_heavy_library(library, modules):
    users = {
        p.relative_to(PACKAGE).with_suffix("").parts[0]
        for p in PACKAGE.rglob("*.py")
        if f"import {library}" in (text := p.read_text(encoding="utf-8"))
        or f"from {library}" in text
    }
    assert users == modules


def test_public_names_are_importable():
    for name in (
        "LogPosterior FrequencyTerm GaussianPrior IndependentPrior ModalSolution "
        "MassSpringModel FrameModel MatrixModel FunctionModel run to_inference_data "
        "diagnose parameter_table frequency_table plot_scatter plot_tae "
        "plot_correlation compare_moves plot_comparison DEMCMove MetropolisMove "
        "TemperedMove log_evidence paper ShapeTerm Measurements ReducedModel "
        "PairedModel DelayedAcceptanceMove identifiability EvaluationPool "
        "plot_predictive pool_tests NormalPopulation plot_population"
    ).split():
        assert hasattr(emcee_femu, name), name


def test_the_version_is_that_of_the_installed_package():
    from importlib.metadata import version

    assert emcee_femu.__version__ == version("emcee-femu")
