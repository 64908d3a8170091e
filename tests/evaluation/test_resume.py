"""Runs in files: the bits of one that was never stopped, or a clear refusal."""

import importlib.metadata
import os
import random
import sqlite3
import threading
from contextlib import closing
from copy import copy
from dataclasses import replace

import emcee
import numpy as np
import pytest
from scipy import stats
from support.examples import TESTS
from support.pool_problems import start_script
from support.runs import assert_same, failures, shorten_search
from support.stored import COUNT, DATA, KINDS, Gaussian, annealed, bits, posed, sampled
from support.systems import inherits, posix

import emcee_femu as ef
from emcee_femu.evaluation import resume
from emcee_femu.search.settings import SETTINGS

SLOW = pytest.mark.slow
PROBE = 16  # stored points that are solved again, at most
INSIDE = ["chain", "tempered", "auto"]
LONG = [pytest.param(kind, marks=SLOW) for kind in ("anneal", "emulate")]  # 3 and 10 s
every_kind = pytest.mark.parametrize("kind", [*INSIDE, *LONG])


@pytest.fixture(scope="module", autouse=True)
def short_search():
    with pytest.MonkeyPatch.context() as patch:
        shorten_search(patch)
        yield


@pytest.fixture(autouse=True)
def count(caplog):
    """Return what the model has done, and may do; some of its solves fail."""
    caplog.set_level("ERROR", "emcee_femu")
    before = dict(COUNT)
    yield COUNT
    COUNT.update(before)


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
            file = tmp_path_factory.mktemp("whole") / "run.chain"
            known[kind] = *attempt(kind, file), file.read_bytes()
        return known[kind]

    return run


@pytest.mark.parametrize(
    "kind", ["chain", "auto", pytest.param("tempered", marks=SLOW), *LONG]
)
def test_stopped_anywhere_it_goes_on_to_the_same_bits(whole, path, kind):
    calls, expected, _ = whole(kind)
    assert attempt(kind, None)[1] == expected
    spent = 0
    for share in (0.02, 0.3, 0.4):  # counted anew each time
        part, stopped = attempt(kind, path, max(1, int(share * calls)))
        assert isinstance(stopped, KeyboardInterrupt)
        spent += part
    part, result = attempt(kind, path)
    assert result == expected
    assert spent + part <= 1.5 * calls + 5  # each stop costs a probe and a batch
    again, result = attempt(kind, path)
    assert result == expected and again <= PROBE
    assert os.listdir(path.parent) == [path.name]


@inherits
def test_workers_store_what_one_process_goes_on_with_and_emcee_too(path):
    for steps, workers in ((5, 2), (9, None)):
        samplers = sampled(path, steps=steps, workers=workers)
    samplers[0].run_mcmc(None, 2)
    assert samplers[0].get_chain().shape == (11, 12, 2)
    samplers = sampled(path, steps=12, workers=2)
    assert_same(samplers, sampled(None, steps=12, workers=2))


@pytest.mark.slow
def test_what_auto_found_is_not_sought_again(whole, path, monkeypatch):
    first, _ = attempt("auto", path, steps=5)
    second, result = attempt("auto", path)
    assert second < first / 2 and result == whole("auto")[1]
    path.unlink()
    attempt("auto", path, stop=first // 2)
    # Another version of the package asks for other points.
    settings = replace(SETTINGS, searched_share=0.1)
    monkeypatch.setattr("emcee_femu.search.auto.SETTINGS", settings)
    with pytest.raises(ValueError, match="search.*run.chain"):
        sampled(path, moves="auto")


@posix
@pytest.mark.parametrize(
    "kind", [pytest.param(k, marks=SLOW) for k in ("chain", "workers", "auto")]
)
def test_kills_at_random_times_leave_the_bits_of_a_whole_run(path, kind):
    """The law of files: what was stored when a process died is gone on with."""
    program = start_script([TESTS / "support" / "killed_runs.py", kind, path])
    shown, errors = program.communicate()
    assert program.returncode == 0, errors
    assert int(shown.splitlines()[-1]) >= 2


# Pages of the file are written before the record is complete, as of a large one.
KILLED = """
import os, signal, sqlite3, sys
file = sqlite3.connect(sys.argv[1], isolation_level=None)
file.execute("PRAGMA cache_size = 1")
file.execute("BEGIN IMMEDIATE")
file.execute("UPDATE entry SET name = name || '?'")
file.execute("CREATE TABLE more (content)")
file.executemany("INSERT INTO more VALUES (?)", [(bytes(100_000),)] * 20)
os.kill(os.getpid(), signal.SIGKILL)
"""


@posix
def test_a_file_whose_writer_died_in_a_record_is_read_as_before_it(whole, path):
    path.write_bytes(whole("chain")[2])
    told = str(ef.diagnose(path))
    start_script(["-c", KILLED, path]).communicate()
    assert path.with_name("run.chain-journal").stat().st_size
    assert str(ef.diagnose(path)) == told


@pytest.mark.parametrize("kind", ["tempered", pytest.param("anneal", marks=SLOW)])
def test_a_full_disk_is_named_and_loses_nothing(whole, path, kind, monkeypatch):
    """The law of a transaction: a write that finds no room leaves what was there."""
    _, expected, content = whole(kind)
    connect = sqlite3.connect

    def cramped(*arguments, **options):
        file = connect(*arguments, **options)
        file.execute(f"PRAGMA max_page_count = {pages}")
        return file

    for share in (0.0, 0.3, 0.6):
        pages = 1 + int(share * len(content) / 4096)
        with monkeypatch.context() as patch:
            patch.setattr(sqlite3, "connect", cramped)
            with pytest.raises(OSError, match=path.name):
                KINDS[kind](path)
        assert bits(KINDS[kind](path)) == expected
        assert os.listdir(path.parent) == [path.name]
        path.unlink()


@pytest.mark.filterwarnings("ignore:.*run.chain")  # of a last record that is lost
@pytest.mark.parametrize("kind", ["chain", "anneal"])
def test_damage_is_refused_by_the_files_name_or_matters_to_nothing(whole, path, kind):
    _, expected, content = whole(kind)
    rng, third = random.Random(1), len(content) // 3
    spoiled = [content[:end] for end in (40, -1, -100, len(content) // 2)]
    for _ in range(6):
        spoiled.append(bytearray(content))
        spoiled[-1][rng.randrange(third, 2 * third)] ^= 1 << rng.randrange(8)
    refused = []
    for part in spoiled:
        path.write_bytes(part)
        try:
            assert bits(KINDS[kind](path)) == expected
        except ValueError as error:
            assert path.name in str(error)
            refused.append(len(part))
    assert 40 in refused and len(content) in refused


@pytest.mark.parametrize("column", ["stream", "number", "points", "content"])
def test_a_missing_number_is_damage(whole, path, column):
    path.write_bytes(whole("chain")[2])
    with closing(sqlite3.connect(path)) as file, file:
        file.execute(f"UPDATE record SET {column} = NULL WHERE number = 3")
    with pytest.raises(ValueError, match="run.chain .*damaged"):
        ef.diagnose(path)


def test_a_file_that_is_not_there_is_no_damaged_one(path):
    with pytest.raises(ValueError, match="no file .*run.chain"):
        ef.diagnose(str(path))
    assert not path.exists()


@every_kind
def test_another_file_is_left_as_it_is_and_none_gone_on_with_unasked(whole, path, kind):
    own = whole(kind)[2]
    other = whole("anneal" if kind == "chain" else "chain")[2]
    for content, options in ((b"mine", {}), (other, {}), (own, {"resume": False})):
        path.write_bytes(content)
        COUNT["calls"] = 0
        with pytest.raises(ValueError, match="run.chain"):
            KINDS[kind](path, **options)
        assert path.read_bytes() == content and COUNT["calls"] == 0


def test_a_search_that_was_stopped_is_not_gone_on_with_unasked(path):
    attempt("auto", path, stop=20)
    for changed in ({"resume": False}, {"seed": 2}):
        with pytest.raises(ValueError, match="run.chain"):
            sampled(path, moves="auto", **changed)


def test_of_two_runs_that_write_to_one_file_one_is_refused(path, count):
    def write_too():
        if count["calls"] == 60:
            sampled(path)

    count.update(calls=0, do=write_too)
    with pytest.raises(ValueError, match=path.name):
        sampled(path)
    assert_same(sampled(path), sampled(None))


def test_nothing_is_written_or_solved_for_a_run_that_is_refused(path):
    COUNT["calls"] = 0
    (path.parent / "sub").mkdir()
    for place in ("none/run.chain", "sub/"):
        with pytest.raises(ValueError, match="none|sub"):
            sampled(os.path.join(path.parent, place))
    with pytest.raises(ValueError, match="starts"):
        sampled(path, starts=np.full((2, 12, 2), 99.0))
    for backend in (None, emcee.backends.Backend()):
        with pytest.raises(TypeError, match="resume.*backend|backend.*file"):
            ef.run(posed(), seed=1, backend=backend, resume=True, ensembles=1)
    assert not path.exists() and COUNT["calls"] == 0
    sampled(path, steps=3)
    with pytest.raises(ValueError, match="steps.*3"):
        sampled(path, steps=2)


LAWS = {"a": stats.norm(0, 1), "b": stats.uniform(-3, 6)}
STARTS = [0.3 * posed().start(12, seed=seed) for seed in (1, 2)]


def with_prior(sd=1.0, bounds=((-4.0, 4.0),) * 2):
    prior = ef.GaussianPrior(["a", "b"], [0.0, 0.0], sd, bounds)
    return {"posterior": posed(prior=prior)}


def with_law(**changed):
    return {"posterior": posed(prior=ef.IndependentPrior(LAWS | changed))}


def with_covariance(off):
    model = ef.FunctionModel(lambda p: [10.0 + p["a"], 20.0 + p["b"]], n_modes=2)
    term = ef.FrequencyTerm([10.0, 20.0], covariance=[[0.2, off], [off, 0.3]])
    return {"posterior": posed(term=term, model=model)}


def with_moves(share=0.9, **options):
    stretch = emcee.moves.StretchMove(**options)
    return {"moves": [(ef.DEMCMove(), share), (stretch, 1 - share)]}


def strain(parameters, response):
    """The term, of which nobody knows what was measured."""
    return Gaussian()(parameters, response)


CHANGES = {  # what was run, what is asked for, and what the message names
    "data": ({}, {"posterior": posed(Gaussian(DATA + [0, 0, 0.01]))}, "strain.*0.31"),
    "observed": ({"posterior": posed(strain)}, {"posterior": posed()}, "strain"),
    "covariance": (with_covariance(0.1), with_covariance(-0.1), "frequency"),
    "prior": ({}, with_prior(sd=1.01), "prior.*1.01"),
    "bounds": ({}, with_prior(bounds=[(-4, 4), (-4, 5)]), "bounds.*b.*5"),
    "law": (with_law(), with_law(a=stats.norm(0, 2)), "prior.*norm.0, 2"),
    "moves": ({}, {"moves": ef.DEMCMove(sigma=0.1)}, "moves.*sigma.*0.1"),
    "splits": (with_moves(), with_moves(nsplits=4), "nsplits.*4"),
    "weights": (with_moves(), with_moves(0.8), "0.8"),
    "auto": ({}, {"moves": "auto"}, "moves.*auto"),
    "seed": ({}, {"seed": 2}, "seed.*1.*2"),
    "walkers": ({}, {"nwalkers": 14}, "nwalkers.*12.*14"),
    "ensembles": ({}, {"ensembles": 3}, "ensembles.*2.*3"),
    "thin_by": ({}, {"thin_by": 2}, "thin_by.*1.*2"),
    "starts": ({"starts": STARTS}, {"starts": STARTS[::-1]}, "starts"),
    "size": ({}, {"size": 100}, "size.*80.*100"),
}


@pytest.mark.parametrize("what", CHANGES)
def test_another_run_is_refused_by_every_entry_that_differs(path, what):
    before, after, named = CHANGES[what]
    kind = annealed if what == "size" else sampled
    kind(path, steps=2, **before)
    content = path.read_bytes()
    with pytest.raises(ValueError, match=f"(?s)run.chain .*{named}"):
        kind(path, steps=4, **before | after)
    assert path.read_bytes() == content


class Move(emcee.moves.StretchMove):
    """A move of a user that holds what no file can."""

    def __init__(self, a=2.0, kinds=frozenset({1, 2}), shift=1j):
        super().__init__(a)
        self.kinds, self.shift, self.lock = kinds, shift, threading.Lock()

    def __deepcopy__(self, memo):  # a lock cannot be copied; each ensemble has its move
        return copy(self)


def test_what_is_the_same_is_not_refused_though_it_has_another_name(path):
    def renamed(of):
        stiffness = of["a"]
        return [10.0 + stiffness, 20.0 + of["b"]]

    term = ef.FrequencyTerm([10.0, 20.0], sd=0.5)
    move = Move()
    for steps, function in ((2, renamed), (3, lambda p: renamed({**p}))):
        model = ef.FunctionModel(function, n_modes=2)
        model.made = steps  # as a time or a folder would be another one
        posterior = posed(term=term, model=model)
        samplers = sampled(path, posterior, moves=move, steps=steps)
    assert samplers[1].iteration == 3
    with pytest.raises(ValueError, match=r"moves: was .*a=2.0.* is .*a=3.0"):
        sampled(path, posterior, moves=Move(3.0), steps=4)


def test_another_version_of_a_library_is_warned_of(path, monkeypatch):
    sampled(path, steps=2)
    kind = type(importlib.metadata.distribution("numpy"))
    version = kind.version.fget
    other = property(lambda d: "0" if d.name == "numpy" else version(d))
    monkeypatch.setattr(kind, "version", other)
    monkeypatch.setattr(resume, "installed_version", importlib.metadata.version)
    with pytest.warns(UserWarning, match="numpy.* is 0"):
        sampled(path, steps=3)


@pytest.mark.parametrize("kind", ["chain", "auto", *LONG])
def test_a_model_that_changed_is_found_in_any_file(whole, path, count, kind):
    _, expected, content = whole(kind)
    path.write_bytes(content)
    for offset in (1e-3, 1e-5):
        count["offset"] = offset
        with pytest.raises(ValueError, match="another posterior: .*(strain|y).*'a': "):
            KINDS[kind](path)
    assert bits(KINDS[kind](path, probe_tolerance=10.0)) == expected
    count.update(offset=1e-10, calls=0)
    assert bits(KINDS[kind](path)) == expected and count["calls"] <= PROBE


def test_a_model_that_fails_now_or_is_not_deterministic_is_told_apart(path, count):
    def fail():
        raise ArithmeticError("no licence")

    def scatter():
        count["offset"] = 1e-3 * np.random.default_rng().normal()

    sampled(path)
    count["do"] = fail
    with pytest.raises(ValueError, match="-inf"):
        sampled(path)
    count["do"] = scatter
    with pytest.raises(ValueError, match="not deterministic: .*strain"):
        sampled(path)
    sampled(path, steps=22, probe_tolerance=1.0)


@pytest.mark.slow
def test_the_counts_of_failures_and_their_limit_go_on_after_a_resume(path):
    whole = sampled(None, steps=30)
    total, causes = failures(whole)
    assert total >= 2 * 12 * 31 and causes["exception"] > 5
    sampled(path, steps=4)
    with pytest.raises(RuntimeError, match="max_failures") as caught:
        sampled(path, steps=30, max_failures=0.001)
    assert 4 <= caught.value.run[0].iteration < 30
    samplers = sampled(path, steps=30)
    assert failures(samplers) == (total, causes)
    assert ef.diagnose(samplers).failures == ef.diagnose(whole).failures


@pytest.mark.slow
@pytest.mark.parametrize("kind", [sampled, annealed])
def test_what_a_failure_stopped_goes_on_with_reject(path, kind):
    starts = np.random.default_rng(0).uniform(0.9, 1.0, (2, 12, 2))
    options = {"starts": starts} if kind is sampled else {}
    with pytest.raises(ArithmeticError):
        kind(path, on_failure="raise", **options)
    assert bits(kind(path, **options)) == bits(kind(None, **options))
    if kind is annealed:
        result = kind(path)
        assert result.failed_solves > 0 and (result.theta[:, 0] <= 1.5).all()
        with pytest.raises(RuntimeError, match="max_failures"):
            kind(None, max_failures=0.001)


def test_the_keyboard_is_told_where_the_run_is_and_one_just_begun_has_no_chain(path):
    attempt("chain", path, stop=1)
    with pytest.raises(ValueError, match=path.name):
        ef.diagnose(str(path))
    _, error = attempt("chain", path, stop=60)
    assert str(path) in str(error) and "resume=True" in str(error)
    assert error.run[0].iteration > 0 and error.__suppress_context__
