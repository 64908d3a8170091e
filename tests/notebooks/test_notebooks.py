"""What a notebook shows, and how its own models reach the workers of a pool."""

import pytest
from support.notebooks import MODEL, assert_quiet, execute

pytestmark = pytest.mark.slow  # a kernel, and all that it imports, take seconds

HTML = {  # what a user prints, and a sentence of it
    "posterior": ("posterior", "<p>FunctionModel; terms: frequency; stored: freq"),
    "prior": ("prior", "norm(50, 9)"),
    "problem": ("ef.paper.mass_spring()", "<p>Measured, in Hz: 3.507, 5.149"),
    "measurements": ("ef.Measurements([3.13, 9.83], sd=[0.1, 0.1])", "f [Hz]"),
    "first look": ("ef.find_map(posterior, seed=1)", "<p>"),
    "run": ("run", "<p>Moves: a search by"),
    "search": ("run.search", "<p>a search by"),
    "moves given": ("ef.run(posterior, ef.DEMCMove(), **size)", "DEMCMove"),
    "parameters": ("ef.parameter_table(idata)", "prior mean"),
    "frequencies": ("ef.frequency_table(idata)", "<caption"),
    "predictive": ("ef.predictive_table(idata)", "<caption"),
    "diagnosis": ("ef.diagnose(run)", "<p>Chains: converged"),
    "weights": ("ef.diagnose(run).modes", "importance"),
    "identifiability": ("ef.identifiability(idata)", "sd ratio"),
    "evidence": ("ef.log_evidence(run)", "<p>log evidence (natural)"),
    "hyperpriors": ("ef.population.NormalPopulation(['k1'])", "by the tests"),
    "frf": (
        "ef.frf.FRFMeasurements([1.0, 2.0], [[1j, 2j]], [(1, 2)], kind='mobility')",
        "excitation",
    ),
}
SENTENCES = {"run", "search", "moves given", "evidence"}  # and no table

FIGURES = {  # how a figure comes to be shown, each once
    "last line": "ef.figures.plot_correlation(idata)",
    "kept": "figure = ef.figures.plot_tae(idata, posterior)",
    "kept and last line": "figure = ef.figures.plot_scatter(idata)\nfigure",
    "in the middle": "ef.figures.plot_predictive(idata)\nprint('after')",
    "with a semicolon": "ef.figures.plot_correlation(idata);",
    "display": "display(ef.figures.plot_correlation(idata))\nprint('after')",
    "pyplot's show": "f = ef.figures.plot_correlation(idata)\nplt.show()\nf = 0",
    "saved": "ef.figures.plot_correlation(idata).savefig('figure.pdf')",
    "pickled": "import pickle\nlen(pickle.dumps(ef.figures.plot_correlation(idata)))",
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
        **{name: code for name, (code, _) in HTML.items()},
        **FIGURES,
        "later": "kept = ef.figures.plot_correlation(idata)",
        "again": "kept",
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


def test_nothing_fails_and_nothing_warns(shown):
    assert_quiet(shown)


@pytest.mark.parametrize("name", HTML)
def test_what_a_user_prints_is_shown_as_html(shown, name):
    page = "\n".join(shown[name].pages)
    assert HTML[name][1] in page
    assert ("<table" in page) == (name not in SENTENCES)


@pytest.mark.parametrize("name", [*FIGURES, "later", "again"])
def test_a_figure_is_shown_once(shown, name):
    assert shown[name].pictures == 1


def test_no_figure_stays_open(shown):
    assert shown["open"].stdout == "[]\n"


def test_forked_workers_have_what_the_notebook_defines(shown):
    assert shown["forked"].stdout == "[True, True, True] []\n"


def test_an_exception_of_the_notebook_ends_the_processes_and_not_the_kernel(shown):
    note = "True Raised on a worker\n[] [True, True, True]\n"
    assert shown["raises"].stdout == note


def test_spawned_workers_get_what_the_notebook_defines(shown):
    assert shown["spawned"].stdout == "True []\n"


def test_without_cloudpickle_that_is_refused_before_the_first_solve(shown):
    lines = shown["no cloudpickle"].stdout.splitlines()
    assert len(lines) == 2
    for line in lines:
        assert line.startswith("0 workers: the function cannot be pickled")
        assert "pip install 'emcee-femu[notebooks]'" in line
