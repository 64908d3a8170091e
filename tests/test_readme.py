"""The code of README, docs and CONTRIBUTING runs as they say; their links exist."""

import importlib.util
import inspect
import re
import sys
from pathlib import Path

import pytest
from scipy import stats

import emcee_femu as ef

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
TEXT = {page: page.read_text(encoding="utf-8") for page in PAGES}
README = TEXT[PAGES[0]]
BLOCK = re.compile(r"```python\n(.*?)```(?:\n\n```text\n(.*?)```)?", re.S)
BLOCKS = [*dict.fromkeys(b for text in TEXT.values() for b in BLOCK.findall(text))]
NUMBER = re.compile(r"(?<![\w.])[+-]?\d[\d,]*(?:\.\d+)?(?:e[+-]?\d+)?")


def assert_alike(printed, promised):
    """Compare words exactly, numbers to 2 % or a unit of their last digit."""
    shapes = [NUMBER.sub("#", text).split() for text in (printed, promised)]
    assert shapes[0] == shapes[1]
    found = zip(NUMBER.findall(printed), NUMBER.findall(promised), strict=True)
    for one, other in found:
        unit = 10.0 ** -len(other.partition(".")[2].partition("e")[0])
        number = float(other.replace(",", ""))
        tolerance = {"rel": 0.02, "abs": 1.01 * unit}
        assert float(one.replace(",", "")) == pytest.approx(number, **tolerance)


@pytest.mark.parametrize("number", range(len(BLOCKS)))
def test_blocks_print_what_is_shown(number, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)  # one writes a file
    (code, promised), names = BLOCKS[number], {"__name__": "page"}
    exec(compile(code, "page", "exec"), names)
    if promised:
        assert_alike(capsys.readouterr().out, promised)
    if number == 0:  # the own model's lines and solves, as the README counts them
        lines = [line for line in code.splitlines() if line and line[0] != "#"]
        assert "in eight lines" in README and len(lines) == 8
        (said,) = re.findall(r"These are ([\d,]+) solves, search included", README)
        assert names["run"].solves == pytest.approx(int(said.replace(",", "")), 0.02)


def test_the_front_page_says_what_the_readme_says():
    """The sentence, the line that installs, and the lines with what they print."""
    front = TEXT[ROOT / "docs" / "index.md"]
    assert BLOCK.findall(front)[0] == BLOCK.findall(README)[0]
    for part in (
        r"\*\*You bring.*?\*\*",
        r"```bash\ngit clone.*?```",
        r"\*Torsion.*?\.",
    ):
        said, again = (re.search(part, text, re.S)[0] for text in (README, front))
        assert said == again


def test_every_python_command_names_an_existing_example():
    texts = [p for p in (ROOT / "docs").rglob("*.md") if "_build" not in p.parts]
    pages = [ROOT / "README.md", *texts, *(ROOT / "examples").rglob("*.py")]
    text = "\n".join(page.read_text(encoding="utf-8") for page in pages)
    named = set(re.findall(r"python\s(?:# )?(examples/[\w/]+\.py)", text))
    assert len(named) > 40
    for path in named:
        assert (ROOT / path).exists(), path


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_and_pictures_exist(page):
    for link in re.findall(r"\]\((?!https?:)([^)#]+)", TEXT[page]):
        places = page.parent / link, ROOT / "examples" / link  # copied by the build
        assert any(place.exists() for place in places), link


def test_ci_runs_the_readmes_test_command():
    commands = [line for line in README.splitlines() if "[test]" in line]
    assert len(commands) == 1 and "pytest" in commands[0]
    for runner in (".ci/run", ".github/workflows/ci.yml"):
        assert "README.md" in (ROOT / runner).read_text(encoding="utf-8")


CONTRIBUTING = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
EXAMPLES = re.findall(r"```python\n(.*?)```", CONTRIBUTING, re.S)


@pytest.fixture
def modules(tmp_path, monkeypatch):
    """Return the blocks as modules, which can be pickled."""
    loaded = []
    for number, code in enumerate(EXAMPLES):
        path = tmp_path / f"contributed_{number}.py"
        path.write_text(code, encoding="utf-8")
        spec = importlib.util.spec_from_file_location(path.stem, path)
        loaded.append(importlib.util.module_from_spec(spec))
        monkeypatch.setitem(sys.modules, path.stem, loaded[-1])
        spec.loader.exec_module(loaded[-1])
    return loaded


@pytest.mark.parametrize("number", range(len(EXAMPLES)))
def test_an_example_passes_its_own_tests(number, modules, tmp_path, monkeypatch):
    named = vars(modules[number]).items()
    tests = [test for name, test in named if name.startswith("test_")]
    given = {"tmp_path": tmp_path, "monkeypatch": monkeypatch}
    for test in tests:
        test(**{name: given[name] for name in inspect.signature(test).parameters})
    assert tests and len(EXAMPLES) > 7


def test_move_model_and_term_work_together(modules):
    made = {name: thing for module in modules for name, thing in vars(module).items()}
    (code,) = re.findall(r"`ef\.(LogPosterior\(.*\))`", CONTRIBUTING)
    posterior = eval(f"ef.{code}", made | {"ef": ef, "stats": stats})
    moves = [(made["ScaleMove"](), 0.2), (ef.DEMCMove(), 0.8)]
    run = ef.run(posterior, moves, 12, 50, ensembles=1, seed=1)
    idata = ef.to_inference_data(run)
    assert "EI" in str(ef.parameter_table(idata))
    assert "deflection" in idata["observed_data"]


def test_files_that_are_named_exist():
    named = re.findall(r"`((?:tests|docs|\.github|\.ci)/[\w./-]+)`", CONTRIBUTING)
    assert len(named) > 6
    for name in {*named} - {"docs/SECTION/NAME.md", "docs/SECTION/index.md"}:
        assert (ROOT / name).exists(), name
