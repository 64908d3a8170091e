"""What a notebook shows, and how its own models reach the workers of a pool."""

import os
from types import SimpleNamespace

import nbformat
import pytest
from nbclient import NotebookClient

# The law of what a kernel shows and sends; it, and all it imports, takes seconds.
pytestmark = pytest.mark.slow

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


TABLES = {  # what a user prints, which has a table in its HTML
    "posterior": "posterior",
    "prior": "prior",
    "measurements": "ef.Measurements([3.13, 9.83], sd=[0.1, 0.1])",
    "first look": "ef.find_map(posterior, seed=1)",
    "parameters": "ef.parameter_table(idata)",
    "diagnosis": "ef.diagnose(run)",
    "weights": "ef.diagnose(run).maxima",
    "search": "run.search",
    "identifiability": "ef.identifiability(idata)",
    "hyperpriors": "ef.population.NormalPopulation(['k1'])",
    "frf": "ef.frf.FRFMeasurements([1.0, 2.0], [[1j, 2j]], [(1, 2)], kind='mobility')",
}
SENTENCES = {"run": "run"}  # and which has none
FIGURES = {  # how a figure comes to be shown, each once
    "last line": "ef.figures.plot_correlation(idata)",
    "kept and last line": "figure = ef.figures.plot_scatter(idata)\nfigure",
    "in the middle": "ef.figures.plot_predictive(idata)\nprint('after')",
    "display": "display(ef.figures.plot_correlation(idata))\nprint('after')",
    "pyplot's show": "f = ef.figures.plot_correlation(idata)\nplt.show()\nf = 0",
    "pickled": "import pickle\nlen(pickle.dumps(ef.figures.plot_correlation(idata)))",
    "later": "kept = ef.figures.plot_correlation(idata)",
    "again": "kept",
}


@pytest.fixture(scope="module")
def shown(tmp_path_factory):
    cells = {
        "model": MODEL,
        "sampled": """
from matplotlib import pyplot as plt
posterior = posteriors["function"]
run = ef.run(posterior, steps=300, ensembles=2, seed=1)
idata = ef.to_inference_data(run)
""",
        **TABLES,
        **SENTENCES,
        **FIGURES,
        "open": "print(plt.get_fignums())",
        "forked": "print(same(workers=2), children())",
        "raises": """
class TooStiff(Exception):
    pass

def fails(p):
    if p["k1"] > 50:
        raise TooStiff("of the notebook")
    return function(p)

try:
    chain(posterior_of(ef.FunctionModel(fails)), workers=2)
except Exception as error:
    print("of the notebook" in str(error), error.__notes__[-1][:18])
    print(children(), same(workers=2))
""",
        "spawned": """
multiprocessing.set_start_method("spawn", force=True)
found = chain(posteriors["function"], workers=2)
print((found == serial["function"]).all(), children())
""",
        "improved": """
from concurrent.futures import ProcessPoolExecutor
executor = ProcessPoolExecutor(2)
print(same(pool=executor), same(pool=ef.EvaluationPool(executor)))

def function(p):  # the model was improved, and the pool is still that of before
    return 1.1 * shear(p["k1"], p["k2"])

improved = posterior_of(ef.FunctionModel(function))
new = chain(improved, pool=executor)
print((new == chain(improved)).all(), (new == serial["function"]).all())
executor.shutdown()
""",
        "bar": "found = chain(posterior, progress='notebook')",
        "no cloudpickle": """
import sys
there, sys.modules["cloudpickle"] = sys.modules["cloudpickle"], None
solves = 0
for find in (chain, lambda one, **where: ef.emulate(one, 12, seed=1, **where)):
    try:
        find(posterior, workers=2)
    except TypeError as error:
        print(solves, error)
""",
    }
    return execute(cells, tmp_path_factory.mktemp("notebook"))


def test_what_a_user_prints_is_html_and_figures_are_shown_once_and_closed(shown):
    for name, cell in shown.items():
        assert not cell.error and not cell.stderr, (name, cell.error, cell.stderr)
    for name in TABLES | SENTENCES:
        page = "\n".join(shown[name].pages)
        assert page and ("<table" in page) == (name in TABLES), name
    pictures = {name: shown[name].pictures for name in FIGURES}
    assert pictures == dict.fromkeys(FIGURES, 1)
    assert shown["open"].stdout == "[]\n"
    kinds = shown["bar"].types
    assert kinds.count("application/vnd.jupyter.widget-view+json") == 1


def test_workers_have_what_the_notebook_defines_and_its_exceptions_end_them(shown):
    assert shown["forked"].stdout == "[True, True, True] []\n"
    note = "True Raised on a worker\n[] [True, True, True]\n"
    assert shown["raises"].stdout == note
    assert shown["spawned"].stdout == "True []\n"
    pools = "[True, True, True] [True, True, True]\nTrue False\n"
    assert shown["improved"].stdout == pools
    lines = shown["no cloudpickle"].stdout.splitlines()
    assert len(lines) == 2
    for line in lines:  # refused before the first solve
        assert line.startswith("0 workers") and "pip install cloudpickle" in line
