"""The report: what stands in it, what it leaves out, and that it needs nothing else."""

import hashlib
import html
import re
import runpy
import shutil
import subprocess
import sys
from pathlib import Path

import emcee
import numpy as np
import pytest
from matplotlib import pyplot as plt
from numpy.testing import assert_allclose
from PIL import Image
from scipy import stats
from support.chains import stored_and_read
from support.figures import leave_undrawn

import emcee_femu as ef
from emcee_femu.digits import show

# A tower of two unit masses, whose modes are known: k1 = k2 = 10 N/m.
GOLDEN = (1 + 5**0.5) / 2
HERTZ = np.sqrt([10 / GOLDEN**2, 10 * GOLDEN**2]) / (2 * np.pi)
SHAPES = np.array([[1.0, -1.1], [1.7, 0.6]])
SPRINGS = {"k1": (0, 1, 10.0), "k2": (1, 2, 10.0)}
TEST = ef.Measurements(HERTZ, SHAPES, sd=0.01 * HERTZ, dofs=[0, 1])
TOWER = ef.Geometry(
    {0: (0, 0), 1: (0, 3), 2: (0, 6)}, [(0, 1), (1, 2)], {0: (1, "ux"), 1: (2, "ux")}
)
ROOT = ef.FunctionModel(lambda p: [p["k"] ** 0.5], n_modes=1)
NORMAL = ef.GaussianPrior(["k"], [8.0], [2.0], [(1.0, 20.0)])
TERM = ef.FrequencyTerm([3.0], relative_sd=0.01)
PLAIN = ef.LogPosterior(ROOT, TERM, NORMAL)


TOLD = "How much the test tells about each parameter"


def sample(posterior):
    return ef.run(posterior, ef.DEMCMove(), 16, 60, ensembles=1, seed=1)


@pytest.fixture(scope="module")
def plain():
    return sample(PLAIN)


@pytest.fixture
def unseen(monkeypatch):
    """Draw no picture of a report of which words alone are read."""
    monkeypatch.setattr("emcee_femu.figures.style.draw_png", leave_undrawn)


@pytest.fixture
def write(tmp_path):
    """Return the page of a report, all of whose figures are closed."""

    def write(source, **options):
        path = ef.report(source, tmp_path / "report.html", **options)
        assert not plt.get_fignums()
        return path.read_text(encoding="utf-8")

    return write


def headings(page):
    return re.findall("<h2[^>]*>(.*?)</h2>", page)


def said(page):
    """Return the text of a page without its marks."""
    body = re.sub("</?(i|b|sub|sup)>", "", page.partition("<body>")[2])
    return " ".join(html.unescape(re.sub("<[^>]*>", " ", body)).split())


def test_all_that_is_known_of_a_run_is_in_its_report_and_nothing_is_elsewhere(write):
    """Of paired modes: tables, digests of the data, and pictures inside the page."""
    model = ef.MassSpringModel([1.0, 1.0], SPRINGS, shapes=True)
    model.geometry = TOWER
    laws = {"k1": stats.norm(12, 3), "k2": stats.norm(8, 3)}
    laws["noise"] = stats.halfnorm(scale=0.02)
    prior = ef.IndependentPrior(laws, {"k1": (1, 30), "k2": (1, 30)})
    frequencies = ef.FrequencyTerm(TEST, discrepancy="noise")
    terms = [frequencies, ef.ShapeTerm(TEST, delta=0.05)]
    paired = ef.PairedModel(model, TEST, candidates=2)
    run = sample(ef.LogPosterior(paired, terms, prior))
    page, idata = write(run, discard=10), ef.to_inference_data(run, discard=10)
    for table in (
        ef.parameter_table(idata),
        ef.frequency_table(idata),
        ef.predictive_table(idata, run.posterior),
        ef.pairing_table(idata),
        ef.identifiability(idata),
        ef.diagnose(run, discard=10),
    ):
        assert table._repr_html_() in page
    for values in (HERTZ, TEST.shapes):
        assert hashlib.sha256(values.tobytes()).hexdigest() in page
    assert not re.findall(r"https?:|<link|<script|<iframe|@import|url\(", page)
    inside = page.count('src="data:image/png;base64,')
    assert inside == page.count("<img") == page.count("src=") == 5
    # Of a normal prior the mean and the interval are known.
    cells = said(page).partition("Parameters before the test")[2]
    cells = cells.partition("k1 ")[2].split()
    expected = stats.norm(12, 3).ppf([0.025, 0.975])
    assert_allclose([float(x) for x in cells[1:3]], expected, rtol=0.03)


def test_the_call_of_a_report_repeats_it(plain, write, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    page = write(plain, title="A 'tower' & <more>", discard=5)
    assert "Mode shapes" not in headings(page)
    assert "<h1>A &#39;tower&#39; &amp; &lt;more&gt;</h1>" in page
    call = html.unescape(re.findall("<pre><code>(.*?)</code></pre>", page, re.S)[0])
    (tmp_path / "report.html").write_text("nothing")
    exec(call, {"run": plain})
    again = (tmp_path / "report.html").read_text(encoding="utf-8")
    day = re.compile("20[0-9-]{8}")
    assert day.sub("", again) == day.sub("", page)


@pytest.mark.slow
def test_each_experiment_of_a_joint_posterior_has_its_tables_and_figures(write):
    loaded = ef.FunctionModel(lambda p: [(p["k"] / 2) ** 0.5], n_modes=1)
    half = ef.FrequencyTerm([2.1], relative_sd=0.01)
    tests = {"empty": (ROOT, TERM), "loaded": (loaded, half)}
    run = sample(ef.LogPosterior.joint(tests, NORMAL))
    page = write(run)
    assert ef.frequency_table(run)._repr_html_() in page
    for name in tests:
        assert ef.figures.plot_predictive(run, experiment=name).axes
    with pytest.raises(ValueError, match="experiment: .*'other'.*empty.frequency"):
        ef.figures.plot_predictive(run, experiment="other")


@pytest.mark.usefixtures("unseen")
def test_the_first_page_has_ones_own_words_and_derived_quantities(plain, write):
    text = {"author": "A. <B>", "structure": "a mast", "question": "is it soft"}
    text |= {"conclusion": "it is", "project": "bridge 7", "date": "in May"}
    derived = {"fall": (lambda p: 100 * (1 - p["k"] / 12), "%")}
    page = write(plain, text=text, derived=derived)
    first, _, then = said(page).partition("The test")
    assert [fact for fact in text.values() if fact not in first] == []
    found = ef.diagnose(plain)
    for statement in (found.chains, found.search, found.fit):
        assert statement.sentence in then
    fall = 100 * (1 - ef.to_inference_data(plain)["posterior"]["k"].values / 12)
    ends = fall.mean(), *np.quantile(fall, [0.025, 0.975])
    assert f"fall % {' '.join(show(ends, fall.std()))}" in first


@pytest.mark.parametrize(
    ("options", "error", "named"),
    [
        ({"text": {"auther": "A"}}, ValueError, "text.*'auther'"),
        ({"text": {"author": 3}}, TypeError, r"text\['author'\].*3"),
        ({"derived": {"fall": np.log}}, TypeError, r"derived\['fall'\]"),
        ({"derived": {"fall": (3, "%")}}, TypeError, r"derived\['fall'\]"),
        ({"derived": {"a": (lambda p: p["k"][:3], "")}}, ValueError, r"derived\['a'\]"),
    ],
)
def test_words_and_quantities_that_cannot_be_shown_are_refused(
    options, error, named, plain, write
):
    with pytest.raises(error, match=named):
        write(plain, **options)


@pytest.mark.slow
def test_samples_are_reported_with_what_they_know(plain, write, tmp_path):
    """Of a file, with and without the posterior, and of plain emcee."""
    idata = stored_and_read(ef.to_inference_data(plain), tmp_path / "run.nc")
    for given in ({}, {"posterior": PLAIN}):
        page = write(idata, **given)
        assert f"{plain.solves:,} times" in said(page)
        assert ef.parameter_table(plain)._repr_html_() in page
    sampler = emcee.EnsembleSampler(8, 2, lambda x: -0.5 * float(x @ x))
    sampler.run_mcmc(np.random.default_rng(1).normal(size=(8, 2)), 60)
    whole, bare = {*headings(page)}, {*headings(write(sampler))}
    assert whole - bare == {"Predictions", TOLD} and not bare - whole


@pytest.mark.slow
@pytest.mark.parametrize(("off", "short"), [(0.0, "certified"), (0.01, "corrected")])
def test_a_certificate_is_reported_with_its_verdict(off, short, write):
    near = ef.FunctionModel(lambda p: [3 + off + (p["k"] - 9) / 6], n_modes=1)
    emulated = ef.LogPosterior(near, TERM, NORMAL)
    run = ef.run(emulated, ef.DEMCMove(), 20, 300, ensembles=1, seed=1)
    sealed = ef.certify(ef.to_inference_data(run, discard=100), PLAIN, 100, seed=2)
    assert sealed.short == short
    page = write(sealed)
    assert sealed.verdict in said(page)
    assert (f"{run.solves:,} times" in said(page)) == (short == "certified")
    assert ef.parameter_table(sealed.idata)._repr_html_() in page


@pytest.mark.slow
def test_populations_are_reported_with_their_tables(plain, write):
    annealed = ef.anneal(PLAIN, 200, seed=1)
    assert f"{annealed.solves:,} times" in said(write(annealed, posterior=PLAIN))
    idata = ef.to_inference_data(plain)
    normal, tests = ef.population.NormalPopulation(["k"]), {"May": idata, "June": idata}
    pooled = ef.pool_tests(tests, normal, seed=1, steps=50, ensembles=1, draws=100)
    assert pooled._repr_html_() in write(pooled)


def deflection(p):
    return {"displacement": np.tile(p["k"][:, None, None], (1, 1, 60))}


STRUCTURE = ef.MatrixModel(
    np.zeros((1, 1)), np.eye(1), {"k": np.eye(1)}, n_modes=1, shapes=True
)
FRF = ef.frf.FRFModel(STRUCTURE, [0.3, 0.4], [(0, 0)], damping=0.05)
LINES = ef.frf.FRFMeasurements([0.3, 0.4], [[1 + 1j, 2]], [(0, 0)], kind="receptance")
TERMS = {
    "a function": (ROOT, lambda p, _: -0.5 * (p["k"] - 9) ** 2),
    "displacement": (deflection, ef.DisplacementTerm(np.full((1, 60), 9.0), sd=0.1)),
    "receptance": (FRF, ef.frf.FRFTerm(LINES, sd=0.5, amplitude=True)),
}
SOME, *OTHERS = TERMS


@pytest.mark.parametrize(
    "kind", [SOME, *(pytest.param(k, marks=pytest.mark.slow) for k in OTHERS)]
)
def test_terms_of_every_kind_are_described(kind, write):
    page = write(sample(ef.LogPosterior(*TERMS[kind], NORMAL)))
    assert "Assumptions" in headings(page)
    assert page.count("<tr>") < 40  # many values are counted and not listed


def test_without_jinja_its_package_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "jinja2", None)
    with pytest.raises(ImportError, match=r"pip install jinja2"):
        ef.report(None, tmp_path / "report.html")


def trust(page):
    return re.findall('<p class="trust">(.*?)</p>', page, re.S)[0]


@pytest.mark.slow
@pytest.mark.usefixtures("unseen")
def test_trust_is_said_in_one_plain_sentence_that_follows_the_diagnosis(plain, write):
    """Of one ensemble, of several that agree, of a wrong model, and of two maxima."""
    assert "runs agree" not in trust(write(plain))  # there is but one
    agreed = trust(write(ef.run(PLAIN, seed=1)))
    assert agreed == (
        "4 independent runs agree; the model reproduces 1 of 1 measured values; no "
        "second solution was found."
    )
    off = ef.FrequencyTerm([3.0, 4.0], relative_sd=0.01)
    both = ef.FunctionModel(lambda p: [p["k"] ** 0.5, p["k"] ** 0.5], n_modes=2)
    run = ef.run(ef.LogPosterior(both, off, NORMAL), seed=1)
    said = trust(write(run))
    assert "the model reproduces 0 of 2 measured values" in said
    assert "do not use these numbers yet" in said.lower()  # though chains converged
    mirrored = ef.FunctionModel(lambda p: [(p["a"] - p["b"]) ** 2], n_modes=1)
    prior = ef.GaussianPrior(["a", "b"], [0.0, 0.0], 1.0)
    run = ef.run(ef.LogPosterior(mirrored, TERM, prior), seed=1)
    assert "2 different solutions were found" in trust(write(run))
    short = ef.run(PLAIN, ef.DEMCMove(), 16, 20, ensembles=2, seed=1)
    assert "do not use these numbers yet" in trust(write(short)).lower()


@pytest.mark.usefixtures("unseen")
def test_the_model_is_described_by_its_own_numbers(write):
    nodes = [(0, 0), (0, 3), (4, 3), (4, 0)]
    bars = [(0, 1, "leg"), (1, 2, "leg"), (2, 3, "leg")]
    leg = {"leg": ef.Section("E", rho=2.0, A=0.5, I=0.1)}
    held = {0: "all", 3: "pinned"}
    frame = ef.FrameModel(nodes, bars, leg, held, plane="xz", n_modes=1)
    test = ef.FrequencyTerm(frame({"E": np.array([9.0])}).frequencies[0], beta=1e3)
    prior = ef.GaussianPrior(["E"], [9.0], 1.0, [(1.0, 20.0)])
    page = said(write(sample(ef.LogPosterior(frame, test, prior))))
    for fact in (
        "4 nodes, 3 elements",
        "Free DOFs 7",
        "node 0 (held), node 3 (ux, uz)",
    ):
        assert fact in page
    (mass,) = re.findall(r"Moving mass ([\d.]+)", page)
    # The beam, and of each leg what its cubic moves of a top that does not turn: 13/35.
    assert float(mass) == pytest.approx(4 + 2 * 3 * 13 / 35, rel=1e-3)


class OwnFRFModel:
    """One frequency, of the sum of all parameters."""

    def __call__(self, parameters):
        return {"frequency": sum(parameters.values())[:, None] ** 0.5}


@pytest.mark.usefixtures("unseen")
def test_a_model_is_called_by_the_words_of_its_class_and_pairs_by_what_is_drawn(write):
    for count, caption in ((2, "Samples"), (5, "Correlations")):
        prior = ef.IndependentPrior({f"k{i}": (0.1, 9.0) for i in range(count)})
        term = ef.FrequencyTerm([3.0], sd=0.25)
        posterior = ef.LogPosterior(OwnFRFModel(), term, prior)
        run = ef.run(posterior, ef.DEMCMove(), 16, 200, ensembles=1, seed=1)
        page = said(write(run))
        assert "Model Own FRF model" in page
        assert f"{caption} of the posterior by pairs of parameters" in page


@pytest.mark.slow
def test_a_printed_report_has_no_page_that_is_less_than_half_full(tmp_path):
    """The portal frame of the tutorial, on four pages of A4."""
    chromium = shutil.which("chromium") or shutil.which("google-chrome")
    if chromium is None or shutil.which("pdftoppm") is None:
        pytest.skip("no Chromium, or no pdftoppm (poppler), on this machine")
    tutorials = Path(__file__).parents[3] / "examples/tutorials"
    run = runpy.run_path(str(tutorials / "portal_frame.py"))["run"]
    path = ef.report(run, tmp_path / "report.html")
    options = ["--headless", "--no-sandbox", "--disable-gpu", "--no-pdf-header-footer"]
    printed = f"--print-to-pdf={tmp_path / 'report.pdf'}"
    subprocess.run([chromium, *options, printed, path.as_uri()], check=True, timeout=99)
    draw = ["pdftoppm", "-r", "40", "-gray", "-png", "report.pdf", "page"]
    subprocess.run(draw, cwd=tmp_path, check=True)
    pages = [np.array(Image.open(p)) for p in sorted(tmp_path.glob("page*.png"))]
    assert len(pages) == 4
    for page in pages:
        dark = np.flatnonzero((page < 200).any(axis=1)) / len(page)
        assert dark[dark < 0.95].max() > 0.5  # below it are the numbers of pages


@pytest.mark.usefixtures("unseen")
def test_a_report_of_several_experiments_has_contents_that_lead_to_its_headings(write):
    tests = {"first": (ROOT, TERM), "second": (ROOT, TERM)}
    page = write(sample(ef.LogPosterior.joint(tests, NORMAL)))
    links = re.findall('<li><a href="#(.*?)">(.*?)</a>', page)
    assert len(links) > 5
    for anchor, title in links:
        assert f'<h2 id="{anchor}">{title}</h2>' in page
