"""Runs in files: the bits of one that was never stopped, or a clear refusal.

Nothing here knows the format of a file: chains, searches of "auto", annealings and
emulations are begun, spoiled and gone on with by public functions only.
"""

import importlib.metadata
import json
import logging
import os
import random
import subprocess
import sys
import threading
import tracemalloc
from copy import copy
from pathlib import Path

import emcee
import numpy as np
import pytest
from scipy import stats
from support import killed_runs
from support.runs import assert_same, failures
from support.stored import (
    COUNT,
    DATA,
    KINDS,
    Gaussian,
    annealed,
    bits,
    emulated,
    posed,
    sampled,
)
from support.systems import inherits, posix

import emcee_femu as ef

SLOW = pytest.mark.slow
PROBE = 16  # stored points that are solved again, at most
INSIDE = [kind for kind in KINDS if kind != "workers"]  # that count in this process
every_kind = pytest.mark.parametrize("kind", INSIDE)
FITTED = pytest.param("emulate", marks=SLOW)  # anew after each batch
most_kinds = pytest.mark.parametrize("kind", [*INSIDE[:-1], FITTED])


@pytest.fixture(autouse=True)
def count(caplog):
    """Return what the model has done, and may do; some of its solves fail."""
    caplog.set_level("ERROR", "emcee_femu")
    before = dict(COUNT)
    yield COUNT
    COUNT.update(before)


@pytest.fixture
def path(tmp_path):
    return tmp_path / "run.stored"


def attempt(kind, path, stop=0, **options):
    """Return how often the model was called, and the bits or what stopped it."""
    COUNT.update(calls=0, stop=stop)
    try:
        result = bits(KINDS[kind](path, **options))
    except KeyboardInterrupt as error:
        result = error
    COUNT["stop"] = 0
    return COUNT["calls"], result


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Return, of each kind, the calls and bits of a run in a file, and the content."""
    known = {}

    def run(kind):
        if kind not in known:
            file = tmp_path_factory.mktemp("whole") / "run.stored"
            known[kind] = *attempt(kind, file), file.read_bytes()
        return known[kind]

    return run


# --- the bits of a run that was never stopped --------------------------------------


@every_kind
def test_a_file_changes_no_bit_and_a_finished_one_costs_a_probe(whole, path, kind):
    calls, expected, content = whole(kind)
    assert attempt(kind, None)[1] == expected
    path.write_bytes(content)
    again, result = attempt(kind, path)
    assert result == expected
    assert again <= PROBE
    assert os.listdir(path.parent) == [path.name]


@every_kind
def test_stopped_anywhere_it_goes_on_to_the_same_bits(whole, path, kind):
    calls, expected, _ = whole(kind)
    spent = 0
    for share in (0.02, 0.1, 0.3, 0.4):  # counted anew each time
        stop = max(1, int(share * calls))
        part, stopped = attempt(kind, path, stop)
        assert isinstance(stopped, KeyboardInterrupt)
        spent += part
    part, result = attempt(kind, path)
    assert result == expected
    assert os.listdir(path.parent) == [path.name]
    assert spent + part <= 1.6 * calls + 5  # each stop costs a probe and a batch
    assert part < calls or calls <= PROBE


@most_kinds
def test_more_steps_or_solves_go_on_from_the_file(whole, path, kind):
    shorter = {"emulate": {"solves": 7}, "anneal": {}}.get(kind, {"steps": 5})
    attempt(kind, path, **shorter)
    assert attempt(kind, path)[1] == whole(kind)[1]


@inherits
def test_workers_store_what_one_process_goes_on_with(path):
    for steps, workers in ((5, 2), (9, 1), (12, 2)):
        samplers = sampled(path, steps=steps, workers=workers)
    assert_same(samplers, sampled(None, steps=12, workers=2))


@SLOW
def test_a_smaller_tolerance_goes_on_too(whole, path):
    assert emulated(path, tolerance=100.0).solves < 8
    assert bits(emulated(path)) == whole("emulate")[1]


def test_what_auto_found_is_not_sought_again(whole, path):
    first, _ = attempt("auto", path, steps=5)
    second, result = attempt("auto", path)
    assert second < first / 3 and result == whole("auto")[1]


def test_emcees_own_way_goes_on_too(path):
    samplers = sampled(path, steps=10)
    samplers[0].run_mcmc(None, 2)
    assert samplers[0].get_chain().shape == (12, 12, 2)
    longer = sampled(path, steps=15)
    assert_same(longer, sampled(None, steps=15))


# --- deaths ------------------------------------------------------------------------


def kill(task, *arguments):
    """Return what a process says that lets runs die; see support/killed_runs.py."""
    call = [sys.executable, killed_runs.__file__, json.dumps([task, *arguments])]
    folders = [str(Path(killed_runs.__file__).parents[1]), *sys.path]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(folders)}
    done = subprocess.run(call, capture_output=True, text=True, env=environment)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


def some(*quick):
    return [pytest.param(kind, marks=() if kind in quick else SLOW) for kind in KINDS]


@posix
@pytest.mark.parametrize("kind", some("chain"))
def test_kills_at_random_times_leave_the_bits_of_a_whole_run(path, kind):
    assert kill("random_kills", kind, str(path), 8) >= 3


@pytest.mark.slow
@posix
@pytest.mark.parametrize("kind", some("chain"))
def test_a_death_in_the_middle_of_any_write_is_harmless(path, kind):
    assert kill("deaths_in_writes", kind, str(path), 6) >= 5


@pytest.mark.slow
@posix
@pytest.mark.parametrize("kind", some("chain"))
def test_a_full_disk_is_named_and_loses_nothing(path, kind):
    assert kill("full_disks", kind, str(path), 3) == 3


# --- damage ------------------------------------------------------------------------


def goes_on_or_is_refused(kind, path, expected):
    """Return whether it was refused, by the file's name; else the bits are the same."""
    try:
        result = bits(KINDS[kind](path))
    except ValueError as error:
        assert path.name in str(error)
        return True
    assert result == expected
    return False


@pytest.mark.filterwarnings("ignore:.*run.stored")  # of a last record that is lost
@most_kinds
def test_a_flipped_bit_is_found_or_matters_to_nothing(whole, path, kind):
    _, expected, content = whole(kind)
    rng, third = random.Random(1), len(content) // 3
    refused = 0
    for _ in range(3 if kind == "emulate" else 12):
        spoiled = bytearray(content)
        spoiled[rng.randrange(third, 2 * third)] ^= 1 << rng.randrange(8)
        path.write_bytes(spoiled)
        refused += goes_on_or_is_refused(kind, path, expected)
    assert refused > 0


@pytest.mark.filterwarnings("ignore:.*run.stored")
@most_kinds
def test_a_file_that_was_cut_short_is_gone_on_with_or_refused(whole, path, kind):
    _, expected, content = whole(kind)
    for end in (-1, -100, len(content) // 2, 40):
        path.write_bytes(content[:end])
        refused = goes_on_or_is_refused(kind, path, expected)
    assert refused  # of 40 bytes


@pytest.mark.parametrize("content", [b"mine", b"k1, 4000\n" * 500])
@every_kind
def test_a_file_of_something_else_is_left_as_it_is(path, kind, content):
    path.write_bytes(content)
    with pytest.raises(ValueError, match="run.stored"):
        KINDS[kind](path)
    assert path.read_bytes() == content and COUNT["calls"] == 0


@every_kind
def test_the_file_of_another_kind_is_refused(whole, path, kind):
    other = INSIDE[INSIDE.index(kind) - 1]
    path.write_bytes(whole(other)[2])
    with pytest.raises(ValueError, match="run.stored"):
        KINDS[kind](path)
    assert bits(KINDS[other](path)) == whole(other)[1]


@pytest.mark.parametrize("kind", [kind for kind in INSIDE if kind != "emulate"])
def test_a_file_is_never_gone_on_with_unasked(whole, path, kind):
    path.write_bytes(whole(kind)[2])
    with pytest.raises(ValueError, match="run.stored.*resume"):
        KINDS[kind](path, resume=False)
    assert path.read_bytes() == whole(kind)[2]


def test_a_search_that_was_stopped_is_not_gone_on_with_unasked(path):
    attempt("auto", path, stop=20)
    with pytest.raises(ValueError, match="run.stored.*resume"):
        sampled(path, moves="auto", resume=False)
    with pytest.raises(ValueError, match="seed: was 1, is 2"):
        sampled(path, moves="auto", seed=2)
    assert_same(sampled(path, moves="auto"), sampled(None, moves="auto"))


@posix
def test_of_two_runs_that_write_to_one_file_one_is_refused(path, count):
    outcome = []

    def second_writer():
        if count["calls"] != 60:
            return

        def go_on():
            count["do"] = lambda: None
            try:
                sampled(path)
            except ValueError as error:
                os._exit(3 if path.name in str(error) else 4)

        child = killed_runs.forked(go_on)
        outcome.append(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))

    count.update(calls=0, do=second_writer)
    try:
        sampled(path)
        refused = False
    except ValueError as error:
        refused = path.name in str(error)
    count["do"] = lambda: None
    assert outcome in ([0], [3]) and refused == (outcome == [0])
    assert_same(sampled(path), sampled(None))


@pytest.mark.parametrize("moves", [ef.DEMCMove(), "auto"])
@pytest.mark.parametrize("name", ["none/run.stored", "sub/"])
def test_a_place_for_no_file_is_refused_before_anything_is_solved(path, moves, name):
    (path.parent / "sub").mkdir()
    for resume in (False, True):
        with pytest.raises(ValueError, match="none|sub"):
            sampled(os.path.join(path.parent, name), moves=moves, resume=resume)
    assert COUNT["calls"] == 0


def test_nothing_is_written_for_a_run_that_is_refused(path):
    with pytest.raises(ValueError, match="starts"):
        sampled(path, starts=np.full((2, 12, 2), 99.0))
    for backend in (None, emcee.backends.Backend()):
        with pytest.raises(TypeError, match="resume.*backend|backend.*file"):
            ef.run(posed(), seed=1, backend=backend, resume=True, ensembles=1)
    assert not path.exists()


def test_fewer_steps_than_are_stored_are_refused(path):
    sampled(path, steps=3)
    with pytest.raises(ValueError, match="steps.*3"):
        sampled(path, steps=2)


# --- another run -------------------------------------------------------------------

LAWS = {"a": stats.norm(0, 1), "b": stats.uniform(-3, 6)}
STARTS = [0.3 * posed().start(12, seed=seed) for seed in (1, 2)]


def with_prior(mean=(0.0, 0.0), sd=1.0, bounds=((-4.0, 4.0),) * 2):
    return {"posterior": posed(prior=ef.GaussianPrior(["a", "b"], mean, sd, bounds))}


def with_laws(**laws):
    return {"posterior": posed(prior=ef.IndependentPrior(LAWS | laws))}


def with_frequencies(measured=(10.0, 20.0), **error):
    model = ef.FunctionModel(lambda p: [10.0 + p["a"], 20.0 + p["b"]], n_modes=2)
    term = ef.FrequencyTerm(measured, **error or {"sd": 0.5})
    return {"posterior": posed(term=term, model=model)}


def with_moves(*moves):
    return {"moves": moves[0] if len(moves) == 1 else [*moves]}


STRETCH = emcee.moves.StretchMove
CHANGES = {  # what was run, what is asked for, and what the message names
    "data": ({}, {"posterior": posed(Gaussian(DATA + [0, 0, 0.01]))}, "strain.*0.31"),
    "noise": ({}, {"posterior": posed(Gaussian(sd=0.2))}, "strain"),
    "measured": (with_frequencies(), with_frequencies((10.0, 20.1)), "measured.*20.1"),
    "covariance": (with_frequencies(covariance=[[0.2, 0.1], [0.1, 0.3]]),
                   with_frequencies(covariance=[[0.2, -0.1], [-0.1, 0.3]]),
                   "frequency"),
    "prior": ({}, with_prior(sd=1.01), "prior.*1.01"),
    "bounds": ({}, with_prior(bounds=[(-4, 4), (-4, 5)]), "bounds.*b.*5"),
    "law": (with_laws(), with_laws(a=stats.norm(0, 2)), "prior.*norm.0, 2"),
    "moves": ({}, with_moves(ef.DEMCMove(sigma=0.1)), "moves.*sigma.*0.1"),
    "splits": (with_moves(STRETCH()), with_moves(STRETCH(nsplits=4)), "nsplits.*4"),
    "weights": (with_moves((ef.DEMCMove(), 0.9), (STRETCH(), 0.1)),
                with_moves((ef.DEMCMove(), 0.8), (STRETCH(), 0.2)), "0.8"),
    "auto": ({}, {"moves": "auto"}, "moves.*auto"),
    "seed": ({}, {"seed": 2}, "seed.*1.*2"),
    "walkers": ({}, {"nwalkers": 14}, "nwalkers.*12.*14"),
    "ensembles": ({}, {"ensembles": 3}, "ensembles.*2.*3"),
    "thin_by": ({}, {"thin_by": 2}, "thin_by.*1.*2"),
    "starts": ({"starts": STARTS}, {"starts": STARTS[::-1]}, "starts"),
}  # fmt: skip


@pytest.mark.parametrize("what", CHANGES)
def test_another_run_is_refused_by_every_entry_that_differs(path, what):
    before, after, named = CHANGES[what]
    samplers = sampled(path, steps=2, **before)
    with pytest.raises(ValueError, match=f"(?s)run.stored .*{named}"):
        sampled(path, steps=4, **before | after)
    assert_same(sampled(path, steps=2, **before), samplers)


@pytest.mark.parametrize(
    ("kind", "other", "named"),
    [
        (annealed, {"seed": 2}, "seed.*1.*2"),
        (annealed, {"size": 100}, "size.*80.*100"),
        (annealed, {"posterior": posed(Gaussian(sd=0.2))}, "strain"),
        (emulated, {"seed": 2}, "seed.*1.*2"),
        (emulated, {"posterior": posed(Gaussian(DATA + 0.1))}, "strain"),
    ],
)
def test_another_annealing_or_emulation_is_refused(whole, path, kind, other, named):
    name = {annealed: "anneal", emulated: "emulate"}[kind]
    path.write_bytes(whole(name)[2])
    with pytest.raises(ValueError, match=f"(?s)run.stored .*{named}"):
        kind(path, **other)


def test_what_is_the_same_is_not_refused(path):
    def renamed(of):
        stiffness = of["a"]
        return [10.0 + stiffness, 20.0 + of["b"]]

    functions = renamed, lambda p: renamed(p), lambda p: renamed({**p})
    term = ef.FrequencyTerm([10.0, 20.0], sd=0.5)
    for steps, function in enumerate(functions, 2):
        model = ef.FunctionModel(function, n_modes=2)
        samplers = sampled(path, posed(term=term, model=model), steps=steps)
    assert samplers[1].iteration == 4


def test_another_version_of_a_library_is_warned_of(path, monkeypatch):
    sampled(path, steps=2)
    kind = type(importlib.metadata.distribution("numpy"))
    version = kind.version.fget
    other = property(lambda d: "0" if d.name == "numpy" else version(d))
    monkeypatch.setattr(kind, "version", other)
    with pytest.warns(UserWarning, match="numpy.* is 0"):
        sampled(path, steps=3)


class Prior:
    """A prior of a user that counts its calls."""

    names, bounds = ("a", "b"), np.tile([-4.0, 4.0], (2, 1))

    def __init__(self, width=1.0):
        self.width, self.calls = width, 0

    def logpdf(self, theta):
        self.calls += 1
        return stats.norm.logpdf(theta).sum(axis=1)

    def sample(self, rng, n):
        return rng.standard_normal((n, 2))


class Move(emcee.moves.StretchMove):
    """A move of a user that counts too, and holds what no file can."""

    def __init__(self, a=2.0, kinds=frozenset({1, 2}), shift=1j):
        super().__init__(a)
        self.calls, self.kinds, self.shift = 0, kinds, shift
        self.lock = threading.Lock()

    def __deepcopy__(self, memo):  # a lock cannot be copied; each ensemble has its move
        return copy(self)

    def propose(self, *arguments):
        self.calls += 1
        return super().propose(*arguments)


def test_objects_of_users_are_known_by_their_kept_arguments_and_may_count(path):
    prior, move = Prior(), Move()
    for steps in (2, 3):  # as a cell of a notebook does that is run again
        sampled(path, posed(prior=prior), moves=move, steps=steps)
    assert prior.calls
    with pytest.raises(ValueError, match=r"moves: was .*a=2.0.* is .*a=3.0"):
        sampled(path, posed(prior=Prior(2.0)), moves=Move(3.0), steps=4)


# --- another model -----------------------------------------------------------------


class Solver:
    """A model that reads a file, which no look at its code would tell."""

    names, variables = ("a", "b"), ef.modal_variables(2)

    def __init__(self, folder, scatter=0.0):
        self.file, self.scatter, self.solves = folder / "deck", scatter, 0
        self.made = np.random.default_rng().random()  # as a time or a folder would be

    def __call__(self, p):
        if self.file.read_text() == "broken":
            raise ArithmeticError("no licence")
        self.solves += len(p["a"])
        noise = self.scatter * np.random.default_rng().normal()
        slope = float(self.file.read_text()) + noise
        return ef.ModalSolution(np.stack([10 + slope * p["a"], 20 + p["b"]], axis=1))


def solved(path, deck="1.0", scatter=0.0, **options):
    (path.parent / "deck").write_text(deck)
    model = Solver(path.parent, scatter)
    term = ef.FrequencyTerm([10.0, 20.0], sd=0.5)
    return model, sampled(path, posed(term=term, model=model), **options)


def test_the_probe_solves_sixteen_points_and_says_so_before(path, caplog):
    solved(path, steps=5)
    caplog.set_level(logging.INFO, "emcee_femu")
    model, _ = solved(path, steps=5)
    assert model.solves == PROBE and "solved again" in caplog.text


def test_a_file_that_the_solver_reads_was_changed(path):
    solved(path, steps=5)
    with pytest.raises(ValueError, match="of another posterior") as caught:
        solved(path, "1.001", steps=9)
    assert "frequency" in str(caught.value) and "'b': " in str(caught.value)
    with pytest.raises(ValueError, match="of another posterior"):
        solved(path, "1.00001", steps=9)
    with pytest.raises(ValueError, match="-inf"):
        solved(path, "broken", steps=9)
    assert solved(path, "1.0000000001", steps=6)[1][0].iteration == 6
    assert solved(path, "1.001", steps=9, probe_tolerance=0.1)[1][0].iteration == 9


@pytest.mark.parametrize("kind", ["auto", "anneal", FITTED])
def test_a_changed_model_is_found_in_any_file(whole, path, count, kind):
    path.write_bytes(whole(kind)[2])
    count["offset"] = 1e-3
    with pytest.raises(ValueError, match="of another posterior"):
        KINDS[kind](path)
    assert bits(KINDS[kind](path, probe_tolerance=10.0)) == whole(kind)[1]


@pytest.mark.slow
@pytest.mark.parametrize(("solves", "changed"), [(6, 2), (12, 7), (16, 11)])
def test_a_model_that_changed_at_one_of_few_stored_points_is_found(
    path, count, solves, changed
):
    emulated(path, solves=solves)

    def change_one():
        count["offset"] = 0.01 if count["calls"] == changed else 0.0

    count.update(calls=0, do=change_one)
    with pytest.raises(ValueError, match="of another posterior|not deterministic"):
        emulated(path, solves=solves)


def test_a_solver_that_is_not_deterministic_is_told_apart(path):
    solved(path, steps=5, scatter=1e-3)
    with pytest.raises(ValueError, match="not deterministic: .*frequency"):
        solved(path, steps=9, scatter=1e-3)
    solved(path, steps=9, scatter=1e-3, probe_tolerance=1.0)


# --- failures ----------------------------------------------------------------------


def test_the_counts_of_failures_go_on_after_a_resume(path):
    whole = sampled(None, steps=40)
    total, causes = failures(whole)
    assert total >= 2 * 12 * 41 and causes["exception"] > 10
    for steps in (1, 13, 40, 40):
        samplers = sampled(path, steps=steps)
    assert failures(samplers) == (total, causes)
    assert ef.diagnose(samplers).failures == ef.diagnose(whole).failures


def test_too_many_failures_are_too_many_after_a_resume_too(path):
    sampled(path, steps=4)
    with pytest.raises(RuntimeError, match="max_failures") as caught:
        sampled(path, steps=40, max_failures=0.01)
    assert 4 <= caught.value.run[0].iteration < 40


@pytest.mark.parametrize("kind", [sampled, annealed])
def test_what_a_failure_stopped_goes_on_with_reject(path, kind):
    starts = np.random.default_rng(0).uniform(0.9, 1.0, (2, 12, 2))
    options = {"starts": starts} if kind is sampled else {}
    with pytest.raises(ArithmeticError):
        kind(path, on_failure="raise", **options)
    assert bits(kind(path, **options)) == bits(kind(None, **options))


def test_a_solver_may_change_the_directory(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "sub").mkdir()
    COUNT["do"] = lambda: os.chdir(tmp_path / "sub")
    sampled("run.stored", steps=3)
    COUNT["do"] = lambda: None
    monkeypatch.chdir(tmp_path)
    assert [file.name for file in tmp_path.rglob("*.*")] == ["run.stored"]
    assert_same(sampled("run.stored", steps=3), sampled(None, steps=3))


def test_memory_does_not_hold_the_steps(path):
    posterior = ef.paper.mass_spring().posterior
    options = {"nwalkers": 200, "ensembles": 1}
    sampled(path, posterior, steps=1, **options)
    tracemalloc.start()
    (sampler,) = sampled(path, posterior, steps=80, **options)
    grown, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    stored = sampler.get_chain().nbytes + sampler.get_blobs().nbytes
    assert grown < stored / 4


def test_the_keyboard_is_told_where_the_run_is_and_how_it_goes_on(path):
    _, error = attempt("chain", path, stop=40)
    assert str(path) in str(error) and "resume=True" in str(error)
    assert error.run[0].iteration > 0 and error.__suppress_context__


def test_a_run_that_has_just_begun_has_no_chain_yet(path):
    attempt("chain", path, stop=1)
    with pytest.raises(ValueError, match=path.name):
        ef.diagnose(str(path))
