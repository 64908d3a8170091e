"""The README's code runs, and its commands are those that CI runs."""

import re
from pathlib import Path

import pytest

import emcee_femu

ROOT = Path(__file__).parents[1]
PACKAGE = Path(emcee_femu.__file__).parent  # of the installed wheel in .ci/run
README = (ROOT / "README.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"```python\n(.*?)```", README, flags=re.S)


@pytest.mark.parametrize("block", BLOCKS, ids=range(len(BLOCKS)))
def test_python_blocks_run(block, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # one writes a file
    exec(compile(block, "README.md", "exec"), {"__name__": "readme"})


def test_the_own_model_example_takes_about_15_lines():
    assert len([line for line in BLOCKS[0].splitlines() if line]) <= 16


def test_every_python_command_names_an_existing_example():
    named = re.findall(r"python (examples/[\w/]+\.py)", README)
    assert named
    for path in named:
        assert (ROOT / path).exists(), path


def test_the_picture_exists():
    for image in re.findall(r"!\[.*?\]\((.*?)\)", README):
        assert (ROOT / image).exists(), image


def test_ci_runs_the_readmes_test_command():
    commands = [line for line in README.splitlines() if "[test]" in line]
    assert len(commands) == 1 and "pytest" in commands[0]
    for runner in (".ci/run", ".github/workflows/ci.yml"):
        assert "README.md" in (ROOT / runner).read_text(encoding="utf-8")
