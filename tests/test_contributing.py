"""The code of CONTRIBUTING.md is test modules, and their tests pass."""

import importlib.util
import inspect
import re
import sys
from pathlib import Path

import pytest
from scipy import stats

import emcee_femu as ef

TEXT = (Path(__file__).parents[1] / "CONTRIBUTING.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"```python\n(.*?)```", TEXT, re.S)


@pytest.fixture
def modules(tmp_path, monkeypatch):
    """Return the blocks as modules, which can be pickled."""
    loaded = []
    for number, code in enumerate(BLOCKS):
        path = tmp_path / f"contributed_{number}.py"
        path.write_text(code, encoding="utf-8")
        spec = importlib.util.spec_from_file_location(path.stem, path)
        loaded.append(importlib.util.module_from_spec(spec))
        monkeypatch.setitem(sys.modules, path.stem, loaded[-1])
        spec.loader.exec_module(loaded[-1])
    return loaded


def test_the_examples_pass_their_own_tests(modules, tmp_path, monkeypatch):
    tests = [
        test for m in modules for name, test in vars(m).items() if name[:5] == "test_"
    ]
    given = {"tmp_path": tmp_path, "monkeypatch": monkeypatch}
    for test in tests:
        test(**{name: given[name] for name in inspect.signature(test).parameters})
    assert len(tests) >= len(modules) > 4


def test_move_model_and_term_work_together(modules):
    made = {name: thing for module in modules for name, thing in vars(module).items()}
    (code,) = re.findall(r"`ef\.(LogPosterior\(.*\))`", TEXT)
    posterior = eval(f"ef.{code}", made | {"ef": ef, "stats": stats})
    moves = [(made["ScaleMove"](), 0.2), (ef.DEMCMove(), 0.8)]
    run = ef.run(posterior, moves, 12, 50, ensembles=1, seed=1)
    idata = ef.to_inference_data(run)
    assert "EI" in str(ef.parameter_table(idata))
    assert "deflection" in idata["observed_data"]


def test_files_that_are_named_exist():
    root = Path(__file__).parents[1]
    named = re.findall(r"`((?:tests|docs|\.github|\.ci)/[\w./-]+)`", TEXT)
    assert len(named) > 6
    for name in {*named} - {"docs/SECTION/NAME.md", "docs/SECTION/index.md"}:
        assert (root / name).exists(), name
