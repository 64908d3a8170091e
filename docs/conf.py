"""The documentation site: ``python -m sphinx -W docs docs/_build/html``.

Pages with code are the percent scripts of ``examples/``: they are copied here and
executed, and their outputs are kept until the package changes.
"""

import hashlib
import html
import io
import os
import re
import shutil
import sys
from base64 import b64decode
from functools import partial
from importlib.metadata import files as files_of
from importlib.metadata import version as version_of
from pathlib import Path
from typing import Any

import nbformat
from docutils import nodes
from jupyter_cache import get_cache
from jupyter_cache.executors import utils as executors
from jupyter_client import KernelManager
from PIL import Image
from traitlets.config import Config

import emcee_femu

# One thread for each page: two are executed side by side, and matrices are small.
for library in ("OMP", "OPENBLAS", "MKL"):
    os.environ.setdefault(f"{library}_NUM_THREADS", "1")

# A kernel whose ports are not encrypted warns of it, once for each page.
if hasattr(KernelManager, "transport_encryption"):
    encrypted = Config({"KernelManager": {"transport_encryption": "required"}})
    executors.executenb = partial(executors.executenb, config=encrypted)

# Subjects that are imported when they are asked for: the reference has these names.
for subject in ("frf", "paper", "population"):
    sys.modules[f"emcee_femu.{subject}"] = getattr(emcee_femu, subject)

HERE = Path(__file__).parent
ROOT = HERE.parent
SECTIONS = ["start", "tutorials", "how_to", "explanation"]
FIGURES = "how_to/gallery"  # the page that draws every figure of the package
# A cell with a picture: its options, the text of the picture, and its code.
PICTURE = re.compile(
    r'^# %%(.*?) mystnb={"image": {"alt": "(.*?)"}}\n((?:(?!# %%).*\n)+)',
    re.M,
)

project = "emcee_femu"
author = "The emcee_femu developers"
project_copyright = author
release = version = version_of("emcee-femu")

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.napoleon",
    "sphinx_copybutton",
    "sphinx_design",
]
templates_path = ["_templates"]
exclude_patterns = ["_build", "_templates", "conf.py"]
nitpicky = True  # a name that is nowhere documented is a warning, and an error under -W
nitpick_ignore_regex = [
    # Names of other packages: their sites cannot be asked while this one is built.
    ("py:.*", r"(numpy|np|scipy|emcee|matplotlib|arviz|pandas|xarray|collections)\..*"),
]

# Notebooks
# .rst comes first: autosummary writes its pages so
source_suffix = {".rst": "restructuredtext", ".md": "myst-nb", ".py": "myst-nb"}
nb_custom_formats = {".py": ["jupytext.reads", {"fmt": "py:percent"}]}
nb_execution_mode = "cache"
nb_execution_raise_on_error = True
nb_execution_in_temp = True  # pages write files
nb_execution_timeout = 900  # s for a cell: machines are busy at times
nb_merge_streams = True
nb_output_stderr = "warn"  # a page that prints a warning fails the build (-W)
# Pages show no bars; and where tests ask for Agg, they would show no figure.
os.environ["TQDM_DISABLE"] = "1"
os.environ["MPLBACKEND"] = "module://matplotlib_inline.backend_inline"
myst_enable_extensions = ["amsmath", "colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 3
copybutton_prompt_text = r">>> |\.\.\. |\$ "
copybutton_prompt_is_regexp = True

# The reference
autodoc_member_order = "bysource"
autodoc_typehints = "none"  # the docstrings say what arguments are
autosummary_generate = True
add_module_names = False
napoleon_google_docstring = True
napoleon_numpy_docstring = False
napoleon_use_rtype = False
napoleon_use_ivar = True  # attributes are listed once, by their class
napoleon_attr_annotations = False  # as for arguments

# Formulas
mathjax_path = "mathjax/tex-chtml.js"  # of this site: see copy_mathjax

# Looks
html_theme = "sphinx_book_theme"
html_title = f"emcee_femu {release}"
html_logo = html_favicon = "_static/mark.svg"
html_static_path = ["_static", "_build/mathjax"]
html_css_files = ["site.css"]
html_search_scorer = str(HERE / "_static" / "scorer.js")
html_show_copyright = False
html_context = {"default_mode": "auto"}
html_theme_options = {
    "logo": {"text": "emcee_femu", "alt_text": "The mark: a beam bends into a density"},
    "repository_url": "https://github.com/emcee-femu/emcee_femu",
    "use_repository_button": True,
    "use_issues_button": True,
    "use_download_button": True,
    "home_page_in_toc": True,
    "navbar_persistent": [],  # the search is above the table of contents
    "show_toc_level": 2,
}


def package_hash() -> str:
    """Name the state of the package: outputs of another state are stale."""
    files = sorted((ROOT / "emcee_femu").rglob("*.py"))
    return hashlib.sha256(b"".join(f.read_bytes() for f in files)).hexdigest()[:12]


def copy_pages() -> None:
    """Bring the scripts of ``examples`` here, and remove those that are gone."""
    for section in SECTIONS:
        sources = {f.name: f for f in (ROOT / "examples" / section).glob("*.py")}
        for old in (HERE / section).glob("*.py"):
            if old.name not in sources:
                old.unlink()
        for name, source in sources.items():
            page = HERE / section / name
            if not page.exists() or page.read_bytes() != source.read_bytes():
                page.parent.mkdir(exist_ok=True)
                shutil.copyfile(source, page)


def list_names() -> None:
    """Write what the reference's first page includes: all names, by the lists of pages.

    The lists are those of the pages in its table of contents, in this order, without
    the table of contents that each page makes of its own.
    """
    reference, parts = HERE / "reference", []
    pages = (reference / "index.md").read_text("utf-8").partition("```{toctree}")[2]
    for page in pages.partition("```")[0].split("\n")[3:]:
        file = reference / f"{page}.md"
        text = file.read_text("utf-8") if page else ""
        title, _, rest = text.partition("\n")
        blocks = re.findall(r"```\{eval-rst\}\n.*?```", rest, re.S)
        # Without what a page describes once: a module, and the pages of its names.
        once = r"   :toctree: generated\n|\.\. automodule::.*\n"
        names = "\n\n".join(re.sub(once, "", block) for block in blocks)
        if blocks:
            parts.append(f"## [{title[2:]}]({page}.md)\n\n{names}\n")
    place = HERE / "_build" / "names.md"
    place.parent.mkdir(exist_ok=True)
    if not place.exists() or place.read_text("utf-8") != "\n".join(parts):
        place.write_text("\n".join(parts), encoding="utf-8")


def find_pictures() -> list[tuple[str, str, str]]:
    """Return page, name and alternative text of each picture that pages draw.

    A cell has the text of its picture; it is named by its function in the page of all
    figures, and by its page elsewhere, of which its result or the first picture is
    taken.
    """
    found = []
    for section in SECTIONS:
        for source in sorted((ROOT / "examples" / section).glob("*.py")):
            page, text = f"{section}/{source.stem}", source.read_text("utf-8")
            title = text.partition("# # ")[2].partition("\n")[0]
            cells = PICTURE.findall(text)
            telling = [cell for cell in cells if '"result"' in cell[0]] or cells
            for _, alt, code in cells if page == FIGURES else telling[:1]:
                drawn = re.findall(r"plot_\w+", code)
                found.append((page, drawn[0] if page == FIGURES else title, alt))
    return found


def list_pictures() -> None:
    """Write what the gallery includes: a card for each figure and for each page."""
    cards: dict[bool, list[str]] = {True: [], False: []}
    for page, name, alt in find_pictures():
        file = f"_static/thumbnails/{name_thumbnail(page, name)}"
        picture = f'<img class="thumbnail" src="{file}" alt="{html.escape(alt)}">'
        cards[page == FIGURES].append(
            f":::{{grid-item-card}} {name}\n:link: {page}\n:link-type: doc\n"
            f"```{{raw}} html\n{picture}\n```\n:::\n"
        )
    grids = [
        f"## {title}\n\n::::{{grid}} 2 2 3 3\n:gutter: 3\n\n{''.join(part)}::::\n"
        for title, part in (("Pages", cards[False]), ("Figures", cards[True]))
    ]
    (HERE / "_build" / "cards.md").write_text("\n".join(grids), encoding="utf-8")


def name_thumbnail(page: str, name: str) -> str:
    """Return the file of a thumbnail."""
    return f"{name if page == FIGURES else page.replace('/', '-')}.png"


def read_executed(page: str) -> nbformat.NotebookNode:
    """Return the notebook of a page with its outputs, of this build or an earlier."""
    file = HERE / "_build" / "jupyter_execute" / f"{page}.ipynb"
    notebook = nbformat.read(file, as_version=4)
    try:
        return get_cache(nb_execution_cache_path).merge_match_into_notebook(notebook)[1]
    except KeyError:  # a page that was not executed
        return notebook


def draw_thumbnails(app: Any, error: Exception | None) -> None:
    """Make the gallery's thumbnails of the pictures in executed pages."""
    if error or app.builder.name != "html":
        return
    place = Path(app.outdir) / "_static" / "thumbnails"
    place.mkdir(parents=True, exist_ok=True)
    for page, name, alt in find_pictures():
        data = next(
            output.data["image/png"]
            for cell in read_executed(page).cells
            if alt in str(cell.metadata)
            for output in cell.get("outputs", [])
            if "image/png" in output.get("data", {})
        )
        picture = Image.open(io.BytesIO(b64decode(data))).convert("RGB")
        picture.thumbnail((480, 360))
        picture.save(place / name_thumbnail(page, name), optimize=True)


def copy_mathjax() -> None:
    """Bring what formulas need here: pages ask no other site for it."""
    needed = "tex-chtml.js", "input/tex/", "output/chtml/"
    for file in files_of("sphinx-mathjax-offline"):
        path = file.as_posix().partition("/static/mathjax/")[2]
        if path.startswith(needed):
            place = HERE / "_build" / "mathjax" / "mathjax" / path
            place.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(file.locate(), place)


def find_calculix() -> list[str]:
    """Return the page to leave unexecuted where CalculiX is missing, and say so."""
    from calculix_program import find_command

    try:
        find_command()
    except FileNotFoundError as error:
        print(f"NOT EXECUTED: how_to/calculix.py. {error}", file=sys.stderr)
        return ["*calculix.py"]
    return []


# Pages import the driver of CalculiX, in this process and in their own
sys.path.append(str(ROOT / "examples"))
search = [str(ROOT / "examples"), os.environ.get("PYTHONPATH", "")]
os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, search))
nb_execution_excludepatterns = find_calculix()
suppress_warnings = ["myst-nb.lexer"]  # a page that was not executed has no language
nb_execution_cache_path = str(HERE / "_build" / "cache" / package_hash())
# Made here, once: two processes that make it at the same time collide.
get_cache(nb_execution_cache_path).list_cache_records()
copy_pages()
list_names()
list_pictures()
copy_mathjax()


def offer_notebook(app: Any, page: str, _: str, context: Any, doctree: Any) -> None:
    """Offer a page of code as the executed notebook, without its last cell, of checks.

    The theme has a button for it at the head of the page.
    """
    if doctree is None or not (HERE / f"{page}.py").exists():
        return
    out, name = Path(app.outdir), f"{page}.ipynb"
    notebook = read_executed(page)
    if "remove-cell" in notebook.cells[-1].metadata.get("tags", []):
        del notebook.cells[-1]
    (out / "_sources" / name).parent.mkdir(parents=True, exist_ok=True)
    nbformat.write(notebook, out / "_sources" / name)
    context["ipynb_source"] = name


def begin_with_result(_: Any, doctree: nodes.document) -> None:
    """Show what the cell tagged "result" gives below its page's first paragraph."""
    for cell in [*doctree.findall(nodes.container)]:
        if "tag_result" in cell["classes"]:
            begin = doctree.next_node(nodes.section).next_node(nodes.paragraph)
            output = cell[-1].deepcopy()
            result = nodes.container("", output, classes=["cell", "result"])
            begin.parent.insert(begin.parent.index(begin) + 1, result)


def find_anywhere(app: Any, env: Any, node: Any, text: Any) -> Any:
    """Resolve a bare name, such as ``run``, from a page of a module that has it not."""
    if node.get("refdomain") != "py":
        return None
    node["refspecific"] = True  # any object whose dotted name ends so
    where = node.get("refdoc", env.docname), app.builder, node["reftype"]
    return env.get_domain("py").resolve_xref(env, *where, node["reftarget"], node, text)


def mix(app: Any, env: Any, names: list[str]) -> None:
    """Spread the pages that compute over the parts that processes read one by one."""
    pages = sorted(names, key=lambda name: name[::-1])  # also over the sections
    code = [name for name in pages if (HERE / f"{name}.py").exists()]
    groups = code, [name for name in pages if name not in code]
    place = {name: i / len(group) for group in groups for i, name in enumerate(group)}
    names.sort(key=place.__getitem__)


def setup(app: Any) -> None:
    """Ask for names once more before a missing one is reported; offer notebooks."""
    app.connect("env-before-read-docs", mix)
    app.connect("doctree-read", begin_with_result)
    app.connect("missing-reference", find_anywhere)
    app.connect("build-finished", draw_thumbnails)
    app.connect("html-page-context", offer_notebook, priority=400)  # before the theme
