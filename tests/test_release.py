"""What a release needs: one version, sound metadata, workflows and recipe that fit."""

import datetime
import re
import runpy
import shutil
import tomllib
from pathlib import Path

import pytest
import yaml

import emcee_femu as ef

ROOT = Path(__file__).parents[1]
FILES = ("pyproject.toml", "CITATION.cff", "CHANGELOG.md")
PYPROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
PROJECT = PYPROJECT["project"]
VERSION = PROJECT["version"]
DATE = r"\d{4}-\d\d-\d\d"


def load(name):
    return yaml.safe_load((ROOT / name).read_text(encoding="utf-8"))


def sections():
    """Return versions and dates of the changelog, newest first, without the next."""
    text = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    return [line.split(" - ") for line in re.findall(r"^## (\[.+)", text, re.M)]


def test_every_file_has_the_version_and_date_of_the_package():
    (version, date), *older = sections()
    assert ef.__version__ == VERSION == load("CITATION.cff")["version"]
    assert version == f"[{VERSION}]"
    unreleased = re.fullmatch(f"unreleased, {DATE}", date)
    released = load("CITATION.cff").get("date-released")
    assert (released is None) if unreleased else (str(released) == date)
    dates = [datetime.date.fromisoformat(date[-10:]) for _, date in sections()]
    # A version may be counted on before it was released.
    assert all(re.fullmatch(f"(unreleased, )?{DATE}", date) for _, date in older)
    assert dates == sorted(dates, reverse=True)


def notes(tag, root):
    script = ROOT / ".github" / "release_notes.py"
    return runpy.run_path(str(script))["main"](tag, root)


@pytest.fixture
def released(tmp_path):
    """Copies of the files as they would be on the day of a release."""
    for name in FILES:
        shutil.copy(ROOT / name, tmp_path)
    date = sections()[0][1][-10:]
    change(tmp_path / "CHANGELOG.md", "] - unreleased, ", "] - ")
    cited = tmp_path / "CITATION.cff"
    if "date-released" not in cited.read_text(encoding="utf-8"):
        line = f"\nversion: {VERSION}\n"
        change(cited, line, f"{line}date-released: {date}\n")
    return tmp_path


def change(path, old, new):
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace(old, new, 1), encoding="utf-8")


def test_the_notes_of_a_release_are_the_newest_section(released):
    text = notes(f"v{VERSION}", released)
    whole = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert text and text in whole and "\n## " not in text


@pytest.mark.parametrize(
    ("file", "old", "new"),
    [
        ("pyproject.toml", f'version = "{VERSION}"', 'version = "9.9.9"'),
        ("CITATION.cff", f"version: {VERSION}", "version: 9.9.9"),
        ("CITATION.cff", "date-released: ", "not-released: "),
        ("CHANGELOG.md", f"## [{VERSION}] - ", f"## [{VERSION}] - unreleased, "),
    ],
)
def test_a_tag_of_files_that_disagree_is_refused(released, file, old, new):
    assert old in (released / file).read_text(encoding="utf-8")
    change(released / file, old, new)
    with pytest.raises(SystemExit):
        notes(f"v{VERSION}", released)


def test_ci_has_every_python_of_the_classifiers_on_three_systems():
    matrix = load(".github/workflows/ci.yml")["jobs"]["tests"]["strategy"]["matrix"]
    stated = re.findall(r"Python :: (3\.\d+)", " ".join(PROJECT["classifiers"]))
    assert sorted(matrix["python"]) == stated
    assert len({name.split("-")[0] for name in matrix["os"]}) == 3


def conda_name(requirement):
    """Return a requirement of PyPI as conda-forge writes it."""
    name, version = re.fullmatch(r"([\w-]+)(.*)", requirement).groups()
    return f"{name} {version}".strip()


def test_the_recipe_has_the_dependencies_and_the_version_of_the_package():
    recipe, requires = load(".github/conda/recipe.yaml"), PROJECT["requires-python"]
    oldest = requires.removeprefix(">=")
    assert recipe["context"] == {"version": VERSION, "python_min": oldest}
    needs, build = recipe["requirements"], PYPROJECT["build-system"]["requires"]
    python, *run = needs["run"]
    assert python == "python >=${{ python_min }}"
    assert sorted(run) == sorted(map(conda_name, PROJECT["dependencies"]))
    host = needs["host"][2:]  # after python and pip
    assert sorted(host) == sorted(map(conda_name, build))
    assert recipe["source"]["url"].endswith("emcee_femu-${{ version }}.tar.gz")
    assert re.fullmatch("[0-9a-f]{64}", recipe["source"]["sha256"])
