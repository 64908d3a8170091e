"""The site's pages have the form that the site promises; its build executes them."""

import ast
import pkgutil
import re
from pathlib import Path

import pytest
from support.public import public_names

ROOT = Path(__file__).parents[2]
DOCS, EXAMPLES = ROOT / "docs", ROOT / "examples"
SECTIONS = ("start", "tutorials", "how_to", "explanation")
SCRIPTS = [p for name in SECTIONS for p in sorted((EXAMPLES / name).glob("*.py"))]
MEASURED = sorted((EXAMPLES / "benchmarks" / "measured").glob("*.txt"))
MOST_WORDS = 700  # of a page that says how something works or how good it is
FOR_USERS = ("auto", "verdict", "calibration", "moves_measured", "few_solves_measured")
TEXTS = sorted(p for p in DOCS.rglob("*.md") if "_build" not in p.parts)


@pytest.mark.parametrize("page", SCRIPTS, ids=lambda p: f"{p.parent.name}-{p.stem}")
def test_a_page_of_code_is_a_script_with_its_command_and_its_checks(page):
    text = page.read_text(encoding="utf-8")
    ast.parse(text)
    assert text.startswith("# %% [markdown]\n# # ")
    command = f"python {page.relative_to(ROOT).as_posix()}"
    assert command in re.sub(r"\n# ", " ", text)
    checks = text.rpartition("\n# %%")[2]
    assert 'tags=["remove-cell"]' in checks.partition("\n")[0]
    assert "assert" in checks, "the last cell checks what the page says"
    plots = re.findall(
        r"^# %%(.*)\n(?:(?!# %%).*\n)*?(?:\w+ = )?ef\.figures\.plot_", text, re.M
    )
    for options in plots:
        assert '"alt": "' in options or "remove-" in options, "no text of a figure"


@pytest.mark.parametrize("page", SCRIPTS + TEXTS, ids=lambda p: p.stem)
def test_each_page_of_a_section_is_in_a_table_of_contents(page):
    section = page.parent
    if page.stem == "index" or section == DOCS:
        return
    index = DOCS / section.name / "index.md"
    entries = index.read_text(encoding="utf-8").splitlines()
    assert page.stem in [line.strip() for line in entries]


@pytest.mark.parametrize("page", TEXTS, ids=lambda p: p.stem)
def test_a_page_of_text_shows_no_python_that_is_not_executed(page):
    if page.parent != DOCS:  # the old ones are executed by test_readme.py
        assert "```python" not in page.read_text(encoding="utf-8")


def test_the_reference_has_every_public_name():
    pages = [p.read_text(encoding="utf-8") for p in (DOCS / "reference").glob("*.md")]
    tables = [part for page in pages for part in page.split(":nosignatures:")[1:]]
    listed = re.findall(r"^   ([\w.]+)$", "\n".join(tables), re.M)
    assert set(public_names()) <= set(listed) and len(listed) == len(set(listed))
    for name in listed:  # autosummary imports them
        assert callable(pkgutil.resolve_name(f"emcee_femu.{name}")), name


@pytest.mark.parametrize(
    "page",
    [p for p in SCRIPTS if p.parent.name in ("tutorials", "how_to")],
    ids=lambda p: p.stem,
)
def test_a_page_begins_with_what_comes_out(page):
    """One cell's output is shown at the head; or the first cell that is seen draws."""
    cells = re.findall(r"^# %%(?! \[markdown\])(.*)$", page.read_text("utf-8"), re.M)
    results = sum('"result"' in options for options in cells)
    seen = [c for c in cells if not re.search('"(hide-input|remove-cell)"(?!.*alt)', c)]
    assert results == 1 or (results == 0 and "hide-input" in seen[0])


@pytest.mark.parametrize("name", FOR_USERS)
def test_a_page_of_what_a_user_decides_by_is_short(name):
    (page,) = [p for p in SCRIPTS + TEXTS if p.stem == name]
    text = page.read_text(encoding="utf-8")
    if page.suffix == ".py":  # its cells of text
        cells = [cell.partition("\n") for cell in text.split("# %%")]
        text = "\n".join(rest for head, _, rest in cells if "[markdown]" in head)
    prose = re.sub(r"```.*?```", "", text, flags=re.S)
    assert len([w for w in prose.split() if re.search(r"\w", w)]) <= MOST_WORDS


@pytest.mark.parametrize("file", MEASURED, ids=lambda p: p.stem)
def test_a_measured_table_names_its_script_version_and_day(file):
    text = file.read_text(encoding="utf-8")
    command, made = text.splitlines()[:2]
    found = re.match(r"\$ OMP_NUM_THREADS=1 python (\S+)(.*)", command)
    script = ast.parse((ROOT / found[1]).read_text(encoding="utf-8"))
    (main,) = [d for d in script.body if getattr(d, "name", "") == "main"]
    options = {argument.arg for argument in main.args.args}
    assert set(re.findall(r"--(\w+)", found[2])) <= options
    assert re.match(r"emcee_femu \d+\.\d+\.\d+( \(\w+\))?, \d{4}-\d\d-\d\d", made)


def test_each_measured_table_is_shown_on_a_page():
    texts = "".join(p.read_text(encoding="utf-8") for p in [*TEXTS, *SCRIPTS])
    texts += (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    assert [file.name for file in MEASURED if file.name not in texts] == []


def test_the_gallery_draws_every_figure():
    page = (EXAMPLES / "how_to" / "gallery.py").read_text(encoding="utf-8")
    figures = [name for name in public_names() if "plot_" in name]
    assert figures and [name for name in figures if f"ef.{name}(" not in page] == []
