"""Every row of the contracts' table has an effect, of an object and of a function.

Each case asks for what the attribute is for; without it, the answer must be another.
"""

import re
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from scipy import stats
from support.figures import leave_undrawn

import emcee_femu as ef
from emcee_femu.models.sensors import Sensors
from emcee_femu.results.chains import read_chains
from emcee_femu.results.shapes import solve_shapes
from emcee_femu.results.to_arviz import read_samples_and_model

PACKAGE = Path(ef.__file__).parent
ROWS = re.findall(
    r"^(\w+) +(model, term|model|term|prior|move|result)  ", ef.contracts.__doc__, re.M
)
PAIRS = {(row, of) for row, owners in ROWS for of in owners.split(", ")}

MEASURED, SD = np.array([1.0, 2.0]), np.array([0.1, 0.2])
PLACES = ef.Variable({"gauge": ["half", "end"]}, "mm")
PRIOR = {"a": stats.norm(1.0, 0.3), "b": stats.norm(1.0, 0.3)}
THETA = np.array([[1.1, 0.8], [0.9, 1.2]])


def respond(parameters):
    return np.stack([parameters["a"], parameters["a"] + parameters["b"]], axis=1)


def solve(parameters):
    return {"u": respond(parameters), "other": parameters["a"][:, None]}


def r_and_sd(parameters, response):
    r = (response["u"] - MEASURED) * np.array([1.0, -2.0])  # no plain differences
    return r, np.broadcast_to(SD * [1.0, 2.0], r.shape)


def weigh(parameters, response):
    r, sd = r_and_sd(parameters, response)
    return stats.norm.logpdf(r, 0, sd).sum(axis=1)


def restored(deviations):
    return MEASURED + deviations / np.array([1.0, -2.0])


MODEL = {"variables": {"u": PLACES}, "names": ("a", "b")}
TERM = {
    "name": "gauges",
    "names": (),
    "reads": {"u": PLACES},
    "observed": {"u": MEASURED},
    "deviations": staticmethod(r_and_sd),
    "restore": staticmethod(restored),
}


def declare(function, attributes, kind):
    """Return the function with these attributes, or an object that is called."""
    if kind == "object":
        called = {"__call__": lambda self, *given: function(*given)}
        return type("Own", (), called | attributes)()

    def own(*given):
        return function(*given)

    plain = {k: getattr(v, "__func__", v) for k, v in attributes.items()}
    vars(own).update(plain)
    return own


def posterior_of(kind, model=None, term=None, prior=PRIOR, solver=solve):
    """Return a posterior whose model and term declare these; None takes one away."""
    chosen = []
    for function, usual, given in ((solver, MODEL, model), (weigh, TERM, term)):
        every = usual | (given or {})
        there = {k: v for k, v in every.items() if v is not None}
        chosen.append(declare(function, there, kind))
    return ef.LogPosterior(*chosen, ef.IndependentPrior(prior))


def sample(posterior):
    """Return an ArviZ object of a very short run."""
    move = ef.DEMCMove()
    run = ef.run(posterior, move, 8, 40, ensembles=1, seed=1, progress=False)
    return ef.to_inference_data(run, discard=0)


def refused(make):
    try:
        make()
    except (TypeError, ValueError):
        return True
    return False


def stored(kind, given):
    more = {"u": PLACES, "other": ef.Variable({"of": ["a"]})}
    at = posterior_of(kind, {"variables": more} if given else {"variables": None})
    return "other" in sample(at)["response"]


def known_names(kind, given, of):
    wanted = {"names": ("a", "b", "c") if of == "model" else ("c",)}
    return refused(lambda: posterior_of(kind, **{of: wanted if given else {}}))


def bounded(kind, given, of):
    inside = {"bounds": {"a": (0.0, np.inf)}} | (
        {"names": ("a",)} if of == "term" else {}
    )
    return refused(lambda: posterior_of(kind, **{of: inside if given else {}}))


def derivable(kind, given):
    def jacobian(parameters):
        slopes = np.array([[1.0, 1.0], [0.0, 1.0]])
        n = len(parameters["a"])
        each = {k: np.tile(s, (n, 1)) for k, s in zip("ab", slopes, strict=True)}
        return solve(parameters), {"u": each}

    calls = []

    def counted(parameters):
        calls.append(len(parameters["a"]))
        return solve(parameters)

    attributes = {"jacobian": staticmethod(jacobian)} if given else {}
    if not posterior_of(kind, attributes, solver=counted).differentiable:
        return False
    _, gradient = posterior_of(kind, attributes, solver=counted).gradient(THETA)
    at, h = posterior_of(kind), 1e-6
    steps = h * np.eye(2)
    ends = [at.stack(THETA + s, "rows")[:, 0] for s in (*steps, *-steps)]
    expected = np.stack([ends[0] - ends[2], ends[1] - ends[3]], axis=1) / (2 * h)
    np.testing.assert_allclose(gradient, expected, rtol=1e-5)
    return not calls


def uncertain(kind, given):
    def spread(parameters):
        u = respond(parameters)
        return {"u": u}, {"u": {"mesh": np.full_like(u, 0.3)}}

    attributes = {"spread": staticmethod(spread)} if given else {}
    wide = posterior_of(kind, attributes).stack(THETA, "rows")[:, 0]
    narrow = posterior_of(kind).stack(THETA, "rows")[:, 0]
    return not np.allclose(wide, narrow)


def alone(kind, given):
    sizes = []

    def counted(parameters):
        sizes.append(len(parameters["a"]))
        return solve(parameters)

    return posterior_of(kind, {"one_by_one": given or None}, solver=counted).one_by_one


def modal(kind, attributes):
    """Return a posterior whose model returns shapes at two DOFs."""
    declared = ef.modal_variables(1, ["1:ux", "2:ux"])

    def vibrate(parameters):
        shapes = respond(parameters)[:, :, None]
        return ef.ModalSolution(parameters["a"][:, None], shapes)

    model = declare(vibrate, {"variables": declared} | attributes, kind)
    dofs = ["1:ux", "2:ux"]
    test = ef.Measurements([1.0], sd=[0.1], shapes=[[1.0], [2.0]], dofs=dofs)
    paired = ef.PairedModel(model, test, candidates=1)
    return ef.LogPosterior(paired, ef.FrequencyTerm(test), ef.IndependentPrior(PRIOR))


NODES = {1: (0.0, 0.0), 2: (1.0, 0.0), 3: (2.0, 0.0)}


def drawn(kind, given):
    attributes = {"geometry": ef.Geometry(NODES, [(1, 2), (2, 3)])} if given else {}
    at = modal(kind, attributes)
    idata = sample(at)
    return not refused(lambda: ef.figures.plot_shapes(idata, at))


def all_dofs(kind, given):
    """A node without DOFs is a support, if the shapes have all that the model has."""
    attributes = {"dofs": ("1:ux", "2:ux")} if given else {}
    at = modal(kind, attributes)
    return solve_shapes(at, at.experiments[0], THETA[0]).complete


def combined(kind, given):
    """A sensor whose name hides that it is a strain is refused beside a translation."""
    strain = Sensors(("1:ux", "gauge"), (0, 1), np.array([[1.0, 0.0], [-10.0, 10.0]]))
    declared = ef.modal_variables(1, ["1:ux", "gauge"])
    attributes = {"sensors": strain, "dofs": ("1:ux", "2:ux")} if given else {}
    model = declare(lambda p: None, {"variables": declared} | attributes, kind)
    dofs = ["1:ux", "gauge"]
    test = ef.Measurements([1.0], sd=[0.1], shapes=[[1.0], [2.0]], dofs=dofs)
    return refused(lambda: ef.PairedModel(model, test, candidates=1))


def tabled(kind, term):
    posterior = posterior_of(kind, None, term)
    return ef.predictive_table(sample(posterior), posterior)


def labelled(kind, given):
    """A model that declares nothing is taken at the word of the terms."""
    term = {"reads": None, "observed": None, "deviations": None, "restore": None}
    asked = {} if given else term
    return not refused(lambda: posterior_of(kind, {"variables": None}, asked))


def observed(kind, given):
    term = {} if given else {"observed": None, "restore": None}
    return not refused(lambda: tabled(kind, term))


def drawable(kind, given):
    """New measurements have the variance of the model and of the error together."""
    term = {} if given else {"restore": None}
    table = tabled(kind, term)
    return "inside" in table.columns


def stated(kind, given):
    term = {"error_sd": {"u": SD}} if given else {}
    table = tabled(kind, term)
    return "sd mm" in table.columns and np.allclose(table.column("sd mm"), SD)


def report_of(posterior):
    """Return the HTML of a report without its pictures."""
    with TemporaryDirectory() as folder, pytest.MonkeyPatch.context() as patch:
        patch.setattr("emcee_femu.figures.style.draw_png", leave_undrawn)
        path = Path(folder) / "report.html"
        ef.report(sample(posterior), path, posterior=posterior)
        return path.read_text(encoding="utf-8")


@cache
def write_report(kind, given):
    """Return the HTML of a report, whose term says three things or nothing."""
    words = {name: f"Its {name}." for name in ("statement", "formula", "symbol")}
    return report_of(posterior_of(kind, None, words if given else {}))


def reported(kind, given, attribute):
    return f"Its {attribute}." in write_report(kind, given)


def inferred(kind, given):
    """The report names the parameter that is the error."""
    named = {"names": ("c",), "symbol": "s"} | ({"discrepancy": "c"} if given else {})
    at = posterior_of(kind, None, named, PRIOR | {"c": stats.halfnorm(scale=0.1)})
    text = report_of(at)
    assert "No error of the model" not in text
    return "it is the parameter" in text


def gaussian(kind, given):
    terms = {} if given else {"deviations": None, "restore": None}
    data = ef.diagnose(sample(posterior_of(kind, None, terms))).data
    return np.isfinite([record.chi2 for record in data]).any()


@cache
def run_of_own():
    posterior = posterior_of("object")
    move = ef.DEMCMove()
    return ef.run(posterior, move, 8, 40, ensembles=1, seed=1, progress=False)


def own_result(attributes):
    """Return a result of another package, which is no run and no ArviZ object."""
    return type("Own", (), attributes)()


def taken(given):
    idata = ef.to_inference_data(run_of_own(), discard=0)
    own = own_result({"idata": idata} if given else {})
    return not refused(lambda: ef.parameter_table(own))


def taken_as_chains(given):
    chains = read_chains(run_of_own(), discard=0)
    own = own_result({"as_chains": lambda self: chains} if given else {})
    return not refused(lambda: ef.diagnose(own))


def taken_with_posterior(given):
    run = run_of_own()
    held = {"idata": ef.to_inference_data(run, discard=0)}
    own = own_result(held | ({"posterior": run.posterior} if given else {}))
    return not refused(lambda: read_samples_and_model(own, None))


def reported_as_its_own(given):
    idata = ef.to_inference_data(run_of_own(), discard=0)
    said = ef.contracts.Reported("own", idata, "A section of its own")
    printed = {"_repr_html_": lambda self: "<p>Its numbers</p>"}
    told = {"reported": lambda self: said} if given else {}
    own = own_result({"idata": idata} | printed | told)
    with TemporaryDirectory() as folder:
        path = ef.report(own, Path(folder) / "report.html")
        text = path.read_text(encoding="utf-8")
    return "A section of its own" in text and "Its numbers" in text


def tempered(given):
    """Only the walkers that sample the posterior itself are kept."""

    class Own(ef.DEMCMove):
        betas = (1.0, 0.5)

    move = Own() if given else ef.DEMCMove()
    posterior = posterior_of("object")
    run = ef.run(posterior, move, 8, 40, ensembles=1, seed=1, progress=False)
    return ef.to_inference_data(run, discard=0)["posterior"].sizes["chain"] == 4


class Own:
    """A prior of a user, with what the contract demands."""

    names = "a", "b"
    bounds = np.array([[-9.0, 9.0]] * 2)
    laws = stats.norm(1.0, 0.3), stats.norm(1.0, 0.3)

    def logpdfs(self, theta):
        every = zip(self.laws, theta.T, strict=True)
        return np.stack([law.logpdf(x) for law, x in every], axis=1)

    def logpdf(self, theta):
        return Own.logpdfs(self, theta).sum(axis=1)

    def sample(self, rng, n):
        return np.stack([law.rvs(n, rng) for law in self.laws], axis=1)


def own_prior(attributes):
    posterior = posterior_of("object")
    prior = type("Told", (Own,), attributes)()
    return ef.LogPosterior(posterior.experiments[0].model, posterior.terms, prior)


def told_by_parameter(given):
    return "log_prior" in sample(own_prior({} if given else {"logpdfs": None}))


def named_in_tables(given):
    laws = dict(zip(Own.names, Own.laws, strict=True))
    at = own_prior({"marginals": laws} if given else {})
    return "norm(1, 0.3)" in str(at)


def of(owner, case):
    return lambda kind, given: case(kind, given, owner)


CASES = {
    ("variables", "model"): stored,
    ("names", "model"): of("model", known_names),
    ("names", "term"): of("term", known_names),
    ("bounds", "model"): of("model", bounded),
    ("bounds", "term"): of("term", bounded),
    ("jacobian", "model"): derivable,
    ("spread", "model"): uncertain,
    ("one_by_one", "model"): alone,
    ("geometry", "model"): drawn,
    ("dofs", "model"): all_dofs,
    ("sensors", "model"): combined,
    ("name", "term"): lambda kind, given: (
        posterior_of(kind, None, {} if given else {"name": None}).term_names
        == ("gauges",)
    ),
    ("reads", "term"): labelled,
    ("observed", "term"): observed,
    ("deviations", "term"): gaussian,
    ("restore", "term"): drawable,
    ("error_sd", "term"): stated,
    ("discrepancy", "term"): inferred,
    ("statement", "term"): of("statement", reported),
    ("formula", "term"): of("formula", reported),
    ("symbol", "term"): of("symbol", reported),
}
OF_RESULTS = {
    ("idata", "result"): taken,
    ("as_chains", "result"): taken_as_chains,
    ("posterior", "result"): taken_with_posterior,
    ("reported", "result"): reported_as_its_own,
    ("betas", "move"): tempered,
    ("logpdfs", "prior"): told_by_parameter,
    ("marginals", "prior"): named_in_tables,
}
OF_MOVES = {("state", "move"), ("restore", "move")}  # CONTRIBUTING.md has their test


# A report is written in a second; what it reads is the same of both.
REPORTED = {
    (name, "term") for name in ("discrepancy", "statement", "formula", "symbol")
}
EVERY = [
    pytest.param(
        row,
        kind,
        id=" ".join([*row, kind]),
        marks=[pytest.mark.slow] * (row in REPORTED and kind == "function"),
    )
    for row in CASES
    for kind in ("object", "function")
]


@pytest.mark.parametrize(("row", "kind"), EVERY)
def test_a_row_of_the_table_has_its_effect(row, kind):
    assert CASES[row](kind, True)
    assert not CASES[row](kind, False)


@pytest.mark.parametrize("row", OF_RESULTS, ids=" ".join)
def test_a_row_of_results_priors_and_tempering_has_its_effect(row):
    assert OF_RESULTS[row](True)
    assert not OF_RESULTS[row](False)


def test_the_table_has_all_that_is_read_and_each_row_a_case():
    assert PAIRS == CASES.keys() | OF_MOVES | OF_RESULTS.keys()
    text = "".join(path.read_text(encoding="utf-8") for path in PACKAGE.rglob("*.py"))
    read = set(re.findall(r'read_declared\([\w.]+, "(\w+)"\)', text))
    assert len(read) > 10
    assert read <= {row for row, _ in PAIRS}
