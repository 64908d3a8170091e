"""The documentation site: ``python -m sphinx -W docs docs/_build/html``.

Pages with code are the percent scripts of ``examples/``: they are copied here and
executed, and their outputs are kept until the package changes.
"""

import hashlib
import os
import shutil
import sys
from functools import partial
from importlib.metadata import files as files_of
from importlib.metadata import version as version_of
from pathlib import Path
from typing import Any

import nbformat
from jupyter_cache import get_cache
from jupyter_cache.executors import utils as executors
from jupyter_client import KernelManager
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
    "logo": {"text": "emcee_femu"},
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
copy_mathjax()


def offer_notebook(app: Any, page: str, _: str, context: Any, doctree: Any) -> None:
    """Offer a page of code as the executed notebook, without its last cell, of checks.

    The theme has a button for it at the head of the page.
    """
    if doctree is None or not (HERE / f"{page}.py").exists():
        return
    out, name = Path(app.outdir), f"{page}.ipynb"
    notebook = nbformat.read(out.parent / "jupyter_execute" / name, as_version=4)
    if "remove-cell" in notebook.cells[-1].metadata.get("tags", []):
        del notebook.cells[-1]
    (out / "_sources" / name).parent.mkdir(parents=True, exist_ok=True)
    nbformat.write(notebook, out / "_sources" / name)
    context["ipynb_source"] = name


def find_anywhere(app: Any, env: Any, node: Any, text: Any) -> Any:
    """Resolve a bare name, such as ``run``, from a page of a module that has it not."""
    if node.get("refdomain") != "py":
        return None
    node["refspecific"] = True  # any object whose dotted name ends so
    where = node.get("refdoc", env.docname), app.builder, node["reftype"]
    return env.get_domain("py").resolve_xref(env, *where, node["reftarget"], node, text)


def mix(app: Any, env: Any, names: list[str]) -> None:
    """Spread the pages that compute over the parts that processes read one by one."""
    names.sort(key=lambda name: name[::-1])


def setup(app: Any) -> None:
    """Ask for names once more before a missing one is reported; offer notebooks."""
    app.connect("env-before-read-docs", mix)
    app.connect("missing-reference", find_anywhere)
    app.connect("html-page-context", offer_notebook, priority=400)  # before the theme
