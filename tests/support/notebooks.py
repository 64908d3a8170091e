"""Notebooks made of cells, executed headless, and what their cells show."""

import os
from types import SimpleNamespace

import nbformat
from nbclient import NotebookClient

# A function, a lambda and a class of the notebook's own, and their serial chains
MODEL = """
import multiprocessing, os, time
import numpy as np
import emcee_femu as ef

solves, factor = 0, 1.0

def shear(k1, k2):
    A = np.array([[k1 + k2, -k2], [-k2, k2]]) / 16e3
    return factor * np.sqrt(np.linalg.eigvalsh(1e6 * A)) / (2 * np.pi)

def function(p):
    global solves
    solves += 1
    return shear(p["k1"], p["k2"])

class Model:
    names, variables = ("k1", "k2"), ef.modal_variables(2)

    def __call__(self, parameters):
        pairs = zip(parameters["k1"], parameters["k2"])
        return ef.ModalSolution(np.array([shear(*pair) for pair in pairs]))

prior = ef.GaussianPrior(["k1", "k2"], [50, 10], [9, 3], [(20, 90), (1, 15)])
term = ef.FrequencyTerm([3.13, 9.83], relative_sd=0.02)

def posterior_of(model):
    return ef.LogPosterior(model, term, prior)

posteriors = {
    "function": posterior_of(ef.FunctionModel(function)),
    "lambda": posterior_of(ef.FunctionModel(lambda p: shear(p["k1"], p["k2"]))),
    "class": posterior_of(Model()),
}
size = dict(nwalkers=8, steps=5, seed=1)

def chain(posterior, **where):
    options = {"moves": ef.DEMCMove(), "ensembles": 1, **size, **where}
    return ef.run(posterior, **options)[0].get_chain()

serial = {name: chain(posterior) for name, posterior in posteriors.items()}

def same(**where):
    return [
        bool((chain(posterior, **where) == serial[name]).all())
        for name, posterior in posteriors.items()
    ]

def children():
    return [p.name for p in multiprocessing.active_children()]
"""


def execute(cells, folder):
    """Return what ``{name: code}`` shows, executed in a folder by a new kernel."""
    notebook = nbformat.v4.new_notebook()
    notebook.cells = [nbformat.v4.new_code_cell(cell) for cell in cells.values()]
    client = NotebookClient(
        notebook,
        timeout=300,
        allow_errors=True,
        resources={"metadata": {"path": str(folder)}},
    )
    # The kernel chooses its own backend of matplotlib.
    kept = {name: value for name, value in os.environ.items() if name != "MPLBACKEND"}
    client.execute(env=kept)
    return {
        name: _show(cell.outputs)
        for name, cell in zip(cells, notebook.cells, strict=True)
    }


def _show(outputs):
    """Return streams, the name and text of an error, and all else by MIME type."""
    text = {"stdout": "", "stderr": "", "error": ""}
    data = [one.data for one in outputs if "data" in one]
    for one in outputs:
        if one.output_type == "stream":
            text[one.name] += one.text
        elif one.output_type == "error":
            text["error"] += f"{one.ename}: {one.evalue}"
    return SimpleNamespace(
        **text,
        pictures=sum("image/png" in one for one in data),
        pages=[one["text/html"] for one in data if "text/html" in one],
        types=sorted(kind for one in data for kind in one),
    )


def assert_quiet(shown):
    """Check that no cell failed, or wrote a warning."""
    for name, cell in shown.items():
        assert not cell.error and not cell.stderr, (name, cell.error, cell.stderr)
