"""The report: what stands in it, what it leaves out, and that it needs nothing else."""

import hashlib
import html
import re
import shutil
import sys
from functools import cache

import arviz
import emcee
import numpy as np
import pytest
from matplotlib import pyplot as plt
from scipy import stats
from support.chains import dataset

import emcee_femu as ef

# A tower of two unit masses, whose modes are known: k1 = k2 = 10 N/m.
GOLDEN = (1 + 5**0.5) / 2
HERTZ = np.sqrt([10 / GOLDEN**2, 10 * GOLDEN**2]) / (2 * np.pi)
SHAPES = np.array([[1.0, -1.1], [1.7, 0.6]])
SPRINGS = {"k1": (0, 1, 10.0), "k2": (1, 2, 10.0)}
TEST = ef.Measurements(
    HERTZ, SHAPES, sd=0.01 * HERTZ, sensors=["half way", "roof"], dofs=[0, 1]
)
TOWER = ef.Geometry(
    {0: (0, 0), 1: (0, 3), 2: (0, 6)}, [(0, 1), (1, 2)], {0: (1, "ux"), 1: (2, "ux")}
)
STIFFNESS = ef.GaussianPrior(["k1", "k2"], [12.0, 8.0], 3.0, [(1, 30), (1, 30)])
ROOT = ef.FunctionModel(lambda p: [p["k"] ** 0.5], n_modes=1)
NORMAL = ef.GaussianPrior(["k"], [8.0], [2.0], [(1.0, 20.0)])
TERM = ef.FrequencyTerm([3.0], relative_sd=0.01)
ALWAYS = ["What was measured", "Model and parameters", "Likelihood", "Solves"]
ALWAYS += ["Can the result be trusted?", "Parameters before and after"]
ALWAYS += ["Prior and posterior", "How to repeat this"]
CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")


def sample(posterior, **options):
    return ef.run(posterior, ef.DEMCMove(), 16, 60, ensembles=1, seed=1, **options)


@cache
def paired_run(geometry=None):
    model = ef.MassSpringModel([1.0, 1.0], SPRINGS, shapes=True)
    model.geometry = geometry
    noise = {"noise": stats.halfnorm(scale=0.02)}
    normals = {"k1": stats.norm(12, 3), "k2": stats.norm(8, 3)}
    prior = ef.IndependentPrior(normals | noise, {"k1": (1, 30), "k2": (1, 30)})
    terms = [
        ef.FrequencyTerm(TEST, discrepancy="noise"),
        ef.ShapeTerm(TEST, delta=0.05),
    ]
    paired = ef.PairedModel(model, TEST, candidates=2)
    units = {"k1": "N/m", "k2": "N/m"}
    return sample(ef.LogPosterior(paired, terms, prior, units))


def joint_run():
    loaded = ef.FunctionModel(lambda p: [(p["k"] / 2) ** 0.5], n_modes=1)
    tests = {
        "empty": (ROOT, TERM),
        "loaded": (loaded, ef.FrequencyTerm([2.1], relative_sd=0.01)),
    }
    return sample(ef.LogPosterior.joint(tests, NORMAL))


@pytest.fixture(scope="module")
def drawn(tmp_path_factory):
    """The report of paired modes on a known geometry, without a burn-in of ten."""
    return write(tmp_path_factory.mktemp("report"), paired_run(TOWER), discard=10)


def write(tmp_path, source, **options):
    path = ef.report(source, tmp_path / "report.html", **options)
    return path.read_text(encoding="utf-8")


def headings(page):
    return re.findall("<h2>(.*?)</h2>", page)


def pictures(page):
    return re.findall('<img alt="(.*?)" src="data:image/png;base64,', page)


def said(page):
    """Return the text of a page without its marks."""
    body = re.sub("</?(i|b|sub|sup)>", "", page.partition("<body>")[2])
    return " ".join(html.unescape(re.sub("<[^>]*>", " ", body)).split())


def test_the_tables_and_statements_of_a_run_are_in_its_report(drawn):
    run, page = paired_run(TOWER), drawn
    idata = ef.to_inference_data(run, discard=10)
    for table in (
        ef.parameter_table(idata),
        ef.frequency_table(idata, run.posterior),
        ef.predictive_table(idata, run.posterior),
        ef.pairing_table(idata),
        ef.identifiability(idata),
        ef.diagnose(run, discard=10),
    ):
        assert table._repr_html_() in page
    draws = dataset(idata, "posterior")["k1"].values
    assert f"<td>{draws.mean():.5g}</td>" in page
    error = ef.frequency_table(idata, run.posterior).column("error % ")[-1]
    assert f"The mean error of the frequencies is {error:.2f} %" in page
    text = said(page)
    assert f"solved {run.solves:,} times" in text
    assert "norm(12, 3)" in text and "N/m" in text and "Here δ is 0.05." in text
    assert "[(1 − MACi) / (2 δ2) + ½ (ns − 1) ln 2π δ2]" in text
    assert "Model: MassSpringModel. Its modes are paired with the measured" in text
    assert "half way 1.000 -1.100" in text
    assert "Seed 1 " in text and "50 steps after 10 of burn-in" in text
    assert f"emcee {emcee.__version__}" in text


def test_the_digests_are_those_of_the_data(drawn):
    for values in (HERTZ, TEST.shapes):
        assert hashlib.sha256(values.tobytes()).hexdigest() in drawn


def test_pictures_are_inside_and_nothing_comes_from_elsewhere(drawn):
    assert not re.findall(r"https?:|<link|<script|<iframe|@import|url\(", drawn)
    assert len(pictures(drawn)) == drawn.count("<img") == drawn.count("src=") == 5


def test_shapes_are_drawn_where_the_geometry_is_known(drawn, tmp_path):
    page = write(tmp_path, paired_run())
    assert not plt.get_fignums()  # all of them are closed
    assert "Mode shapes" in headings(page) and "Mode shapes" in headings(drawn)
    assert [alt[:8] for alt in pictures(page)][1:-2] == ["MAC of m"]
    assert [alt[:8] for alt in pictures(drawn)][1:-2] == ["MAC of m", "Measured"]


def test_a_run_without_pairing_has_no_mode_shapes_and_one_parameter_no_pairs(tmp_path):
    page = write(tmp_path, sample(ef.LogPosterior(ROOT, TERM, NORMAL)))
    assert {*headings(page)} == {*ALWAYS, "Fit before and after", "What the data say"}


def test_each_experiment_of_a_joint_posterior_has_its_tables_and_terms(tmp_path):
    run = joint_run()
    text = said(write(tmp_path, run))
    for name in ("empty", "loaded"):
        table = ef.frequency_table(ef.to_inference_data(run), experiment=name)
        assert table.title in text
        assert f"Measured: {name}.frequency" in text
        assert f"Model of {name}: FunctionModel." in text
        assert f"{name}.frequency. The relative deviations" in text


@pytest.mark.slow
def test_a_file_of_samples_says_what_it_does_not_know(tmp_path):
    model = ef.MassSpringModel([1.0, 1.0], SPRINGS, shapes=True)
    prior = ef.GaussianPrior(["k1"], [12.0], [3.0], [(1, 30)])
    term = ef.FrequencyTerm(TEST)
    paired = ef.PairedModel(model, TEST, candidates=2)
    run = sample(ef.LogPosterior(paired, term, prior))
    ef.to_inference_data(run).to_netcdf(tmp_path / "run.nc")
    idata = arviz.from_netcdf(tmp_path / "run.nc")
    page = write(tmp_path, idata)
    text = said(page)
    assert "The samples alone do not know the terms of the likelihood" in text
    assert f"solved {run.solves:,} times" in text and "prior mean" in text
    assert ef.pairing_table(idata)._repr_html_() in page
    assert not [alt for alt in pictures(page) if alt.startswith("MAC")]
    assert hashlib.sha256(HERTZ.tobytes()).hexdigest() in page


def test_samples_are_reported_with_their_posterior(tmp_path):
    run = sample(ef.LogPosterior(ROOT, TERM, NORMAL))
    page = write(tmp_path, ef.to_inference_data(run), posterior=run.posterior)
    assert "σd is zero" in said(page)
    assert said(page).endswith("posterior=posterior)")


def test_samples_of_plain_emcee_have_neither_prior_nor_fit(tmp_path):
    sampler = emcee.EnsembleSampler(8, 2, lambda x: -0.5 * float(x @ x))
    sampler.run_mcmc(np.random.default_rng(1).normal(size=(8, 2)), 60)
    page = write(tmp_path, sampler)
    assert {*headings(page)} == {*ALWAYS, "Correlations"}
    for unknown in ("what was measured", "the prior", "how often the model was solved"):
        assert unknown in said(page)


def certificate(model):
    emulated = ef.LogPosterior(ef.FunctionModel(model, n_modes=1), TERM, NORMAL)
    run = ef.run(emulated, ef.DEMCMove(), 20, 300, ensembles=1, seed=1)
    idata = ef.to_inference_data(run, discard=100)
    true = ef.LogPosterior(ROOT, TERM, NORMAL)
    return run, ef.certify(idata, true, 100, seed=2)


def test_a_certificate_says_which_solves_were_full(tmp_path):
    run, sealed = certificate(lambda p: [3 + (p["k"] - 9) / 6])
    assert sealed.short == "certified"
    text = said(write(tmp_path, sealed))
    assert f"The emulated model was solved {run.solves:,} times" in text
    assert f"the samples are certified by {sealed.solves} full solves" in text
    assert sealed.verdict in text and "ef.report(certificate, " in text


def test_an_emulated_model_says_what_it_was_made_of(tmp_path):
    emulated = ef.emulate(ef.LogPosterior(ROOT, TERM, NORMAL), 8, seed=1)
    run = sample(emulated.posterior)
    text = said(write(tmp_path, run))
    assert f"{emulated.solves} full solves" in text
    assert "the likelihood is averaged over that" in text
    assert f"The emulated model was solved {run.solves:,} times" in text


def test_weighted_draws_are_reported_by_their_full_solves(tmp_path):
    _, sealed = certificate(lambda p: [3.01 + (p["k"] - 9) / 6])
    assert sealed.short == "corrected"
    page = write(tmp_path, sealed)
    assert f"full model was solved {sealed.solves} times" in said(page)
    assert ef.parameter_table(sealed.idata)._repr_html_() in page


def test_an_annealed_population_is_reported_with_its_posterior(tmp_path):
    posterior = ef.LogPosterior(ROOT, TERM, NORMAL)
    annealed = ef.anneal(posterior, 200, seed=1)
    text = said(write(tmp_path, annealed, posterior=posterior))
    assert f"solved {annealed.solves:,} times" in text and "200 draws" in text


def test_a_population_has_its_tests_and_no_solve(tmp_path):
    tests = {}
    for name, f in {"May": 2.95, "June": 3.05}.items():
        posterior = ef.LogPosterior(ROOT, ef.FrequencyTerm([f], sd=0.01), NORMAL)
        tests[name] = ef.to_inference_data(sample(posterior), discard=30)
    population = ef.population.NormalPopulation(["k"])
    pooled = ef.pool_tests(tests, population, seed=1, steps=50, ensembles=1, draws=100)
    page = write(tmp_path, pooled)
    assert pooled._repr_html_() in page and "The population" in headings(page)
    assert "2 tests of one structure: May, June." in said(page)
    assert "drawn from the population; φ are the parameters" in said(page)
    assert "None: the draws of the tests are weighed again" in said(page)
    assert pictures(page)[0].startswith("The parameters of each test")


def deflection(p):
    return {"displacement": p["k"][:, None, None]}


def quadratic(p, _):
    return -0.5 * (p["k"] - 9) ** 2


STRUCTURE = ef.MatrixModel(
    np.zeros((1, 1)), np.eye(1), {"k": np.eye(1)}, n_modes=1, shapes=True
)
FRF = ef.frf.FRFModel(STRUCTURE, [0.3, 0.4], [(0, 0)], damping=0.05)
LINES = ef.frf.FRFMeasurements([0.3, 0.4], [[1 + 1j, 2]], [(0, 0)], kind="receptance")
TERMS = [
    (ROOT, TERM, "(fi(θ) − fim) / fim ~ N(0, R + σd2 I)"),
    (ROOT, quadratic, "a function returns the log-likelihood"),
    (deflection, ef.DisplacementTerm([[9.0]], sd=0.1), "N(0, σi2 + (σd uim)2)"),
    (FRF, ef.frf.FRFTerm(LINES, sd=0.5), "in their real and imaginary parts"),
    (FRF, ef.frf.FRFTerm(LINES, sd=0.5, amplitude=True), "ln |Hl(θ)| − ln |Hlm|"),
]


@pytest.mark.parametrize(("model", "term", "words"), TERMS)
def test_each_term_is_described_in_words_and_by_its_formula(
    model, term, words, tmp_path
):
    text = said(write(tmp_path, sample(ef.LogPosterior(model, term, NORMAL))))
    likelihood = text.partition("of the likelihood:")[2].partition("Solves")[0]
    assert words in likelihood
    assert ("σd is zero" in likelihood) == (term is not quadratic)


def test_many_values_are_counted_and_not_listed(tmp_path):
    many = ef.DisplacementTerm(np.full((1, 60), 9.0), sd=1.0)

    def model(p):
        return {"displacement": np.tile(p["k"][:, None, None], (1, 1, 60))}

    page = write(tmp_path, sample(ef.LogPosterior(model, many, NORMAL)))
    assert "values" in said(page) and page.count("<tr>") < 40


def test_the_call_at_the_end_writes_the_same_report(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    run = sample(ef.LogPosterior(ROOT, TERM, NORMAL))
    page = write(tmp_path, run, title="A 'tower' & <more>", discard=5)
    assert "<h1>A &#39;tower&#39; &amp; &lt;more&gt;</h1>" in page
    call = html.unescape(re.findall("<pre><code>(.*?)</code></pre>", page, re.S)[0])
    (tmp_path / "report.html").write_text("nothing")
    exec(call, {"run": run})
    again = (tmp_path / "report.html").read_text(encoding="utf-8")
    day = re.compile("Written on [^<]*")
    assert day.sub("", again) == day.sub("", page)


def test_without_jinja_the_extra_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "jinja2", None)
    with pytest.raises(ImportError, match=r"pip install \"emcee_femu\[report\]\""):
        ef.report(None, tmp_path / "report.html")


@pytest.mark.slow
def test_a_browser_shows_it_without_a_fault_on_a_phone_and_on_a4(tmp_path):
    playwright = pytest.importorskip("playwright.sync_api", exc_type=ImportError)
    if CHROMIUM is None:
        pytest.skip("no Chromium on this machine")
    springs = {f"k{i}": (i, i + 1, 10.0) for i in range(14)}
    chain = ef.MassSpringModel([1.0] * 14, springs)
    hertz = chain({}).frequencies[0]
    prior = ef.GaussianPrior([*springs], [10.0] * 14, 1.0, [(1, 30)] * 14)
    wide = ef.LogPosterior(chain, ef.FrequencyTerm(hertz, relative_sd=0.05), prior)
    run = ef.run(wide, ef.DEMCMove(), 32, 60, ensembles=1, seed=1)
    faults, asked = [], []
    with playwright.sync_playwright() as running:
        flags = ["--no-sandbox", "--disable-gpu"]
        browser = running.chromium.launch(executable_path=CHROMIUM, args=flags)
        page = browser.new_page()
        page.on("console", lambda message: faults.append(message.text))
        page.on("pageerror", lambda error: faults.append(str(error)))
        page.on("request", lambda request: asked.append(request.url[:5]))
        for source in (paired_run(TOWER), run):
            path = ef.report(source, tmp_path / "report.html")
            for media, width in (("screen", 390), ("screen", 1280), ("print", 658)):
                page.set_viewport_size({"width": width, "height": 900})
                page.emulate_media(media=media, color_scheme="dark")
                page.goto(path.as_uri(), wait_until="load")
                right = page.evaluate(
                    """paper => Math.max(document.documentElement.scrollWidth,
                    ...[...document.querySelectorAll(paper ? 'table, img' : 'img')]
                    .map(e => e.getBoundingClientRect().right))""",
                    media == "print",
                )
                assert right <= width + 1, (media, width)
                colours = page.evaluate("getComputedStyle(document.body).color")
                light = min(map(int, re.findall(r"\d+", colours))) > 128
                assert light == (media == "screen")
        browser.close()
    assert faults == [] and {*asked} <= {"file:", "data:"}
