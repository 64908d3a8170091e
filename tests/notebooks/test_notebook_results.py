"""The results that take longer, their figures, and progress bars, in a notebook."""

import pytest
from support.notebooks import MODEL, assert_quiet, execute

pytestmark = pytest.mark.slow  # a kernel, and results that take minutes

RESULTS = {  # code, and whether there is a table in its HTML
    "emulate": ("emulated", True),
    "certify": ("ef.certify(of_emulated, posterior, 50, seed=1)", True),
    "anneal": ("ef.anneal(posterior, 200, seed=1)", True),
    "moves": ("compared", True),
    "models": ("classes", True),
    "tests": ("pooled", True),
    "delayed": ("move", False),
    "reduced": ("reduced", False),
    "matrices": ("ef.read_matrices({'K': 'K.mtx', 'M': 'K.mtx'})", False),
    "frf": ("measured", True),
}
FIGURES = {
    "of moves": "ef.figures.plot_comparison(compared)",
    "of models": "ef.figures.plot_model_comparison(classes)",
    "of tests": "ef.figures.plot_population(pooled)",
    "of FRFs": "ef.frf.plot_frf(of_frf, frf)",
}
BARS = {
    "by itself": "chain(posterior, progress=True)",
    "widget": "chain(posterior, progress='notebook')",
    "widget of emulate": "ef.emulate(posterior, 12, seed=1, progress='notebook')",
}


@pytest.fixture(scope="module")
def shown(tmp_path_factory):
    cells = {
        "model": MODEL,
        "found": """
from scipy.io import mmwrite
from scipy.sparse import coo_array
posterior = posteriors["function"]
emulated = ef.emulate(posterior, 20, seed=1)
of_emulated = ef.to_inference_data(ef.run(emulated.posterior, steps=200, seed=1))
moves = {"DE-MC": ef.DEMCMove(), "jumps": ef.DEMCMove(mode_jump=0.1)}
compared = ef.compare_moves(posterior, moves, steps=100, ensembles=2, seed=1)
runs = ef.run(posterior, steps=200, ensembles=2, seed=1)
classes = ef.compare_models({"one": runs, "other": runs})
idata = ef.to_inference_data(runs)
tests = {name: idata for name in ("May", "June", "July")}
pooled = ef.pool_tests(tests, ef.population.NormalPopulation(["k1"]), seed=1)
move = ef.moves.DelayedAcceptanceMove(ef.DEMCMove(), emulated.posterior, steps=5)
ef.run(posterior, move, steps=20, seed=1, ensembles=1)
n = 200
K = 2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
parts = {"lower": np.diag([1.0] * 100 + [0.0] * 100), "upper": K}
model = ef.MatrixModel(np.zeros((n, n)), np.eye(n), parts, n_modes=3)
reduced = ef.reduce_model(model, {"lower": (0.5, 2.0), "upper": (0.5, 2.0)})
mmwrite("K.mtx", coo_array(K), symmetry="symmetric")
""",
        "FRFs": """
lines = np.linspace(0.5, 6.0, 40)
K = {"k1": np.diag([1.0, 0.0]), "k2": np.array([[1.0, -1.0], [-1.0, 1.0]])}
two = ef.MatrixModel(
    np.zeros((2, 2)), np.eye(2), K, n_modes=2, shapes={"floor": 0, "roof": 1}
)
model = ef.frf.FRFModel(two, lines, [("roof", "floor")], damping=0.02)
H = model({"k1": [550.0], "k2": [380.0]})["receptance"][0] @ [1, 1j]
measured = ef.frf.FRFMeasurements(lines, H, [("roof", "floor")], kind="receptance")
prior = ef.GaussianPrior(["k1", "k2"], [500, 400], [90, 90], [(100, 900)] * 2)
frf = ef.LogPosterior(model, ef.frf.FRFTerm(measured, sd=1e-4), prior)
of_frf = ef.to_inference_data(ef.run(frf, steps=50, ensembles=1, seed=1))
""",
        **{name: code for name, (code, _) in RESULTS.items()},
        **FIGURES,
        **{name: f"found = {code}" for name, code in BARS.items()},
        "no widgets": f"""
import sys
sys.modules["ipywidgets"], solves = None, 0
try:
    {BARS["widget"]}
except ImportError as error:
    print(solves, error)
""",
        "lines": f"found = {BARS['by itself']}",
    }
    return execute(cells, tmp_path_factory.mktemp("notebook"))


def test_results_are_shown_as_html_and_figures_once_without_a_warning(shown):
    assert_quiet({name: cell for name, cell in shown.items() if name != "lines"})
    for name, (_, table) in RESULTS.items():
        page = "\n".join(shown[name].pages)
        assert page and ("<table" in page) == table, name
    assert {shown[name].pictures for name in FIGURES} == {1}


def test_a_bar_is_one_widget_or_without_widgets_a_line_at_each_tenth(shown):
    for name in BARS:
        kinds = shown[name].types
        assert kinds.count("application/vnd.jupyter.widget-view+json") == 1
        assert kinds.count("text/plain") == 1
    said = [line.split("%")[0] for line in shown["lines"].stderr.splitlines()]
    assert said == [f"1 ensembles: {share}" for share in range(20, 101, 20)]  # 5 steps
    text = shown["no widgets"].stdout  # refused before the first solve
    assert text.startswith("0 progress") and "emcee-femu[notebooks]" in text
