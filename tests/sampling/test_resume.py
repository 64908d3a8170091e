"""run(resume=True): the bits of a run that was never stopped, or a clear refusal."""

import logging
import threading

import emcee
import numpy as np
import pytest
from scipy import stats
from support.run_files import assert_same

import emcee_femu as ef
from emcee_femu import DEMCMove, IndependenceMove
from emcee_femu.sampling import manifest

PROBLEM = ef.paper.mass_spring()
OPTIONS = {"nwalkers": 12, "nsteps": 30, "seed": 1, "ensembles": 2}


def sampled(posterior=PROBLEM.posterior, **options):
    return ef.run(posterior, **{**OPTIONS, **options})


def all_same(one, other):
    for a, b in zip(one, other, strict=True):
        assert_same(a, b)


@pytest.fixture
def path(tmp_path):
    return tmp_path / "run.chain"


def test_a_longer_run_goes_on_from_a_shorter_one(path):
    sampled(backend=path, nsteps=10, resume=True)  # there is no file: it begins
    longer = sampled(backend=path, resume=True)
    all_same(longer, sampled())
    all_same(longer, sampled(backend=path, resume=True))  # nothing is left to do
    table, own = (
        str(ef.parameter_table(ef.to_inference_data(runs, PROBLEM.posterior, 5)))
        for runs in (longer, sampled())
    )
    assert table == own
    longer[0].run_mcmc(None, 2)  # emcee's own way to go on
    assert ef.sampling.run_file.RunFile(path).iteration == 32


@pytest.mark.slow
def test_what_auto_found_is_not_sought_again(path, monkeypatch):
    whole = sampled(moves="auto", ensembles=1)
    first = sampled(moves="auto", backend=path, nsteps=10, ensembles=1)

    def never(*arguments):
        raise AssertionError("a second search")

    monkeypatch.setattr(ef.sampling.resume, "find_recipe", never)
    longer = sampled(moves="auto", backend=path, resume=True, ensembles=1)
    all_same(longer, whole)
    assert str(longer[0].recipe) == str(first[0].recipe) != ""


def test_a_mixture_made_of_its_own_numbers_is_the_same_to_the_bit():
    draws = np.random.default_rng(0).normal(size=(400, 3))
    draws[:150] += 6
    fitted = IndependenceMove.fit(draws, components=3)
    copy = IndependenceMove(
        fitted.weights.tolist(), fitted.means.tolist(), fitted.scale_matrices.tolist()
    )
    np.testing.assert_array_equal(copy.weights, fitted.weights)
    np.testing.assert_array_equal(copy.log_density(draws), fitted.log_density(draws))


PRIOR = PROBLEM.posterior.prior
SD = np.array(PRIOR.sd)
LAWS = {"a": stats.norm(0, 1), "b": stats.uniform(-1, 2)}
RENAMED = {"k1": "kx", **{name: name for name in PRIOR.names[1:]}}


def with_prior(sd=SD, bounds=PRIOR.bounds, names=PRIOR.names):
    prior = ef.GaussianPrior(names, PRIOR.mean, sd, bounds)
    back = dict(zip(names, PRIOR.names, strict=True))
    model = ef.FunctionModel(
        lambda p: PROBLEM.model({back[k]: np.array([v]) for k, v in p.items()})[0][0],
        n_modes=5,
    )
    return ef.LogPosterior(
        PROBLEM.model if names == PRIOR.names else model,
        PROBLEM.posterior.terms,
        prior,
    )


def with_term(*terms):
    return ef.LogPosterior(PROBLEM.model, terms, PRIOR)


def frequency(scale=1.0, beta=6.8e5, **options):
    return ef.FrequencyTerm(PROBLEM.measured * scale, beta=beta, **options)


def simple(laws=LAWS, slope=1.0, **sizes):
    """A posterior whose model is a function: of it nothing can be read."""
    model = ef.FunctionModel(
        lambda p: [10.0 + slope * p["a"], 20.0 + p["b"], 30.0], n_modes=3
    )
    term = ef.FrequencyTerm([10.0, 20.0, 30.0][: sizes.get("n", 2)], sd=0.5)
    return ef.LogPosterior(model, term, ef.IndependentPrior(laws))


STARTS = [PROBLEM.posterior.start(12, seed=seed) for seed in (1, 2)]
NEW_BOUNDS = PRIOR.bounds + np.array([[0.0, 1.0]] * 5)
CHANGES = {
    "data": ({}, {"posterior": with_term(frequency([1, 1, 1.001, 1, 1]))},
             r"terms\.frequency\.measured\[2\]: was 7\.083, is 7\.09"),
    "noise": ({}, {"posterior": with_term(frequency(beta=1e5))},
              r"terms\.frequency\.beta.*: was .*, is 100000"),
    "term": ({}, {"posterior": with_term(frequency(name="f"))},
                    "terms.frequency: was .*, is absent\n  terms.f: was absent"),
    "prior": ({}, {"posterior": with_prior(SD * [1, 1, 1.01, 1, 1])},
              r"prior\.sd\[2\]: was"),
    "law": ({"posterior": simple()},
            {"posterior": simple(LAWS | {"a": stats.norm(0, 2)})},
            r"prior\.marginals\.a\.args\[1\]: was 1, is 2"),
    "family": ({"posterior": simple()},
               {"posterior": simple(LAWS | {"a": stats.logistic(0, 1)})},
               r"prior\.marginals\.a\.type: was norm, is logistic"),
    "bounds": ({}, {"posterior": with_prior(bounds=NEW_BOUNDS)},
               r"bounds\.k1\[1\]: was 4800.*, is 4801"),
    "names": ({}, {"posterior": with_prior(names=tuple(RENAMED.values()))},
              r"parameters\[0\]: was k1, is kx"),
    "modes": ({"posterior": simple()}, {"posterior": simple(n=3)},
              "terms.frequency.measured: was"),
    "moves": ({}, {"moves": DEMCMove(sigma=0.1)}, r"moves\.sigma: was None, is 0\.1"),
    "stock moves": ({"moves": emcee.moves.StretchMove(2.0)},
                    {"moves": emcee.moves.StretchMove(2.5)},
                    r"moves\.a: was 2\.0, is 2\.5"),
    "weights": ({"moves": [(DEMCMove(), 0.9), (ef.SnookerMove(), 0.1)]},
                {"moves": [(DEMCMove(), 0.8), (ef.SnookerMove(), 0.2)]},
                r"moves\[0\]\[1\]: was 0\.9, is 0\.8"),
    "auto": ({}, {"moves": "auto"}, "moves: was .*, is auto"),
    "seed": ({}, {"seed": 2}, "seed: was 1, is 2"),
    "walkers": ({}, {"nwalkers": 14}, "nwalkers: was 12, is 14"),
    "ensembles": ({}, {"ensembles": 3}, "ensembles: was 2, is 3"),
    "thin_by": ({}, {"thin_by": 2}, "thin_by: was 1, is 2"),
    "starts": ({"initial": STARTS}, {"initial": STARTS[::-1]}, "initial.sha256: was"),
    "no starts": ({"initial": STARTS}, {"initial": None}, "initial: was .*, is None"),
}  # fmt: skip


GAUSSIAN = {"mode": "random", "factor": 2.0}
STOCK = emcee.moves
for name, before, after, difference in [
    ("splits", STOCK.StretchMove(), STOCK.StretchMove(nsplits=4), "nsplits: was 2"),
    ("random splits", STOCK.DEMove(), STOCK.DEMove(randomize_split=False),
     "randomize_split: was True"),
    ("factor", STOCK.GaussianMove(0.1, **GAUSSIAN),
     STOCK.GaussianMove(0.1, **GAUSSIAN | {"factor": 3.0}), "_log_factor: was 0.69"),
]:  # fmt: skip
    CHANGES[name] = {"moves": before}, {"moves": after}, rf"moves\..*{difference}"


@pytest.mark.parametrize("what", CHANGES)
def test_another_run_is_refused_by_every_entry_that_differs(path, what):
    before, after, difference = CHANGES[what]
    sampled(backend=path, nsteps=2, **before)
    content = path.read_bytes()
    with pytest.raises(
        ValueError, match=f"resume: .*holds a run of something else:\n.*{difference}"
    ):
        sampled(backend=path, resume=True, **{**before, **after})
    assert path.read_bytes() == content


class Solver:
    """A model that reads a file, which no look at its code would tell."""

    names, variables = ("a", "b"), ef.modal_variables(2)

    def __init__(self, folder, scatter=0.0):
        self.file, self.scatter, self.calls = folder / "deck", scatter, 0
        self.made = np.random.default_rng().random()  # as a time or a folder would be

    def __call__(self, p):
        self.calls += len(p["a"])
        noise = self.scatter * np.random.default_rng().normal()
        slope = float(self.file.read_text()) + noise
        return ef.ModalSolution(np.stack([10 + slope * p["a"], 20 + p["b"]], axis=1))


def solved(folder, deck="1.0", scatter=0.0, **options):
    (folder / "deck").write_text(deck)
    known = simple()
    model = Solver(folder, scatter)
    posterior = ef.LogPosterior(model, known.terms, known.prior)
    runs = sampled(posterior, backend=folder / "run.chain", resume=True, **options)
    return model.calls, runs


@pytest.mark.parametrize("vectorize", [True, False])
def test_the_probe_costs_a_generation_said_before(tmp_path, caplog, vectorize):
    solved(tmp_path, nsteps=5)
    caplog.set_level(logging.INFO, "emcee_femu")
    calls, _ = solved(tmp_path, nsteps=5, vectorize=vectorize)
    assert calls == 24 and "24 evaluations tell whether" in caplog.text
    assert solved(tmp_path, nsteps=9)[1][1].iteration == 9


def test_a_file_that_the_solver_reads_was_changed(tmp_path):
    _, runs = solved(tmp_path, nsteps=5)
    with pytest.raises(ValueError, match="of another posterior") as caught:
        solved(tmp_path, "1.001", nsteps=9)
    message = str(caught.value)
    last = runs[0].get_last_sample()
    a, b = last.coords[0].tolist()
    now = 10 + 1.001 * a
    likelihood = -0.5 * ((now - 10) ** 2 + (20 + b - 20) ** 2) / 0.25
    assert "in ensemble 1 log_likelihood[frequency] of walker 0 was" in message
    assert f"{{'a': {a}, 'b': {b}}}" in message
    stored, found = message.split(" was ")[1].split(" at ")[0].split(" and is ")
    assert float(stored) == pytest.approx(last.blobs[0, 1], abs=1e-9)
    assert float(found) - float(stored) == pytest.approx(
        likelihood + 0.5 * (a**2 + b**2) / 0.25, abs=1e-9
    )
    assert solved(tmp_path, "1.001", nsteps=9, probe_tolerance=0.1)[1][0].iteration == 9


def test_solves_that_fail_now_are_a_difference_and_are_not_counted(tmp_path):
    class Failing(Solver):
        def __call__(self, p):
            if self.file.read_text() == "broken":
                raise ArithmeticError("no licence")
            return super().__call__(p)

    def run(deck, nsteps):
        (tmp_path / "deck").write_text(deck)
        known = simple()
        posterior = ef.LogPosterior(Failing(tmp_path), known.terms, known.prior)
        options = {"on_failure": "reject", "nsteps": nsteps, "nwalkers": 60}
        file = tmp_path / "run.chain"
        return sampled(posterior, backend=file, resume=True, **options)[0].failures

    counts = run("1.0", 2).counts
    with pytest.raises(ValueError, match=r"1 log_posterior of .* is -inf at"):
        run("broken", 4)
    assert run("1.0", 2).counts == counts


def test_a_difference_below_the_tolerance_passes_and_one_above_does_not(tmp_path):
    solved(tmp_path, nsteps=5)
    with pytest.raises(ValueError, match="of another posterior"):
        solved(tmp_path, "1.00001", nsteps=6)
    solved(tmp_path, "1.0000000001", nsteps=6)


def test_a_solver_that_is_not_deterministic_is_told_apart(tmp_path):
    solved(tmp_path, nsteps=5, scatter=1e-3)
    with pytest.raises(ValueError, match=r"not deterministic: .*frequency.* was "):
        solved(tmp_path, nsteps=9, scatter=1e-3)
    solved(tmp_path, nsteps=9, scatter=1e-3, probe_tolerance=1.0)


def test_what_is_the_same_is_not_refused(path, monkeypatch):
    def named(p):
        return [10.0 + p["a"], 20.0 + p["b"]]

    def renamed(of):
        stiffness = of["a"]
        return [10.0 + stiffness, 20.0 + of["b"]]

    for nsteps, function in enumerate((named, renamed, lambda p: named(p)), 2):
        model = ef.FunctionModel(function, n_modes=2)
        known = simple()
        posterior = ef.LogPosterior(model, known.terms, known.prior)
        runs = sampled(posterior, backend=path, resume=True, nsteps=nsteps)
    assert runs[1].iteration == 4
    real = manifest.version
    monkeypatch.setattr(
        manifest, "version", lambda name: "0" if name == "numpy" else real(name)
    )
    with pytest.warns(UserWarning, match=r"versions\.numpy: was .*, is 0\. The chain"):
        sampled(posterior, backend=path, resume=True, nsteps=5)


def test_a_users_term_is_known_by_what_it_measured_and_counters_of_moves_by_none(path):
    class Term:
        name = "mine"

        def __init__(self, measured):
            self.observed = {"frequency": measured}
            self.made = np.random.default_rng().random()

        def __call__(self, p, modes):
            return -0.5 * ((modes.frequencies[:, 0] - 10) ** 2)

    class Move(DEMCMove):
        count = 0

        def __init__(self, kinds=frozenset({1, 2}), shift=1j, lock=None):
            super().__init__()
            self.kinds, self.shift, self.lock = kinds, shift, threading.Lock()

        def propose(self, model, state):
            self.count += 1
            return super().propose(model, state)

    known, move = simple(), Move()
    for nsteps in (2, 3):
        term = Term(np.array([10.0, 20.0, 30.0]))
        posterior = ef.LogPosterior(known.model, term, known.prior)
        sampled(posterior, moves=move, backend=path, resume=True, nsteps=nsteps)
    posterior = ef.LogPosterior(
        known.model, Term(np.array([11.0, 20.0, 30.0])), known.prior
    )
    with pytest.raises(ValueError, match=r"mine\.observed\.frequency\[0\]: was 10"):
        sampled(posterior, moves=move, backend=path, resume=True)


class Counting:
    """A prior of a user that counts its calls, and the move of one."""

    names, bounds, mean = PRIOR.names, PRIOR.bounds, PRIOR.mean

    def __init__(self, width=1.0, unkept=None):
        self.width, self.calls = width, 0

    def logpdf(self, theta):
        self.calls += 1
        return PRIOR.logpdf(theta)

    def sample(self, rng, n):
        return PRIOR.sample(rng, n)

    class Move(emcee.moves.StretchMove):
        def __init__(self, a=2.0):
            super().__init__(a)
            self.count = 0

        def propose(self, *arguments):
            self.count += 1
            return super().propose(*arguments)


def test_objects_of_users_are_known_by_their_kept_arguments_and_may_count(path):
    prior, move = Counting(), Counting.Move()
    posterior = ef.LogPosterior(PROBLEM.model, PROBLEM.posterior.terms, prior)
    for nsteps in (2, 3):  # as a cell of a notebook does that is run again
        sampled(posterior, moves=move, backend=path, resume=True, nsteps=nsteps)
    assert prior.calls and move.count
    other = ef.LogPosterior(PROBLEM.model, PROBLEM.posterior.terms, Counting(2.0))
    with pytest.raises(
        ValueError, match=r"prior\.width: was 1.0, is 2.0\n.*\.a: was 2"
    ):
        sampled(other, moves=Counting.Move(3.0), backend=path, resume=True)


def test_a_covariance_is_compared_as_it_was_given_and_not_by_its_eigenvectors(
    path, monkeypatch
):
    def correlated(sign=1.0, scale=1.0):
        covariance = scale * np.array([[0.2, sign * 0.1], [sign * 0.1, 0.3]])
        term = ef.FrequencyTerm([10.0, 20.0], covariance=covariance)
        known = simple()
        return ef.LogPosterior(known.model, term, known.prior)

    sampled(correlated(), backend=path, nsteps=2)
    other = r"terms\.frequency\.covariance\[0\]\[1\]: was 0.1, is -0.1"
    with pytest.raises(ValueError, match=other):
        sampled(correlated(-1.0), backend=path, resume=True)
    with pytest.raises(ValueError, match=r"covariance\[0\]\[0\]: was 0.2, is 0.2000"):
        sampled(correlated(scale=1 + 1e-11), backend=path, resume=True)
    eigh = np.linalg.eigh  # that of another processor:
    monkeypatch.setattr(
        np.linalg, "eigh", lambda C: (eigh(C)[0] * (1 + 1e-11), -eigh(C)[1])
    )
    sampled(correlated(scale=1 + 4e-16), backend=path, resume=True, nsteps=3)


def test_a_file_is_never_run_over(path):
    sampled(backend=path, nsteps=3)
    with pytest.raises(ValueError, match="exists; go on with it by resume=True"):
        sampled(backend=path)
    with pytest.raises(ValueError, match="nsteps: expected at least the 3 steps"):
        sampled(backend=path, resume=True, nsteps=2)
    for backend in (None, emcee.backends.Backend()):
        with pytest.raises(TypeError, match="resume: expected backend to be the name"):
            sampled(backend=backend, resume=True, ensembles=1)


def test_an_interrupted_run_goes_on(path):
    class Interrupted:
        names, variables = PROBLEM.model.names, ef.modal_variables(5)
        calls = 0

        def __call__(self, parameters):
            self.calls += 1
            if self.calls == 40:
                raise KeyboardInterrupt
            return PROBLEM.model(parameters)

    posterior = PROBLEM.posterior
    stopping = ef.LogPosterior(Interrupted(), posterior.terms, posterior.prior)
    with pytest.raises(KeyboardInterrupt):
        sampled(stopping, backend=path)
    all_same(sampled(stopping, backend=path, resume=True), sampled())


def test_nothing_is_written_for_a_run_that_is_refused(path):
    with pytest.raises(ValueError, match="initial"):
        sampled(backend=path, initial=np.zeros((2, 12, 3)))
    assert not path.exists()
