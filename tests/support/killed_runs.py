"""Runs that die: a process of its own forks them, kills them and goes on with them.

Forked, since a run that starts Python anew would hardly be killed while it writes; in a
process of its own, since a test runner has threads, which do not survive a fork.
"""

import json
import logging
import os
import random
import signal
import sys
import time
import traceback
from functools import cache, partial
from pathlib import Path

from scipy import stats

import emcee_femu as ef
from emcee_femu import DEMCMove, MetropolisMove, SnookerMove, TemperedMove
from emcee_femu.sampling import auto
from emcee_femu.sampling.run_file import log
from support.run_files import assert_same

BETAS = [1.0, 0.3]
LADDER = [
    (TemperedMove(DEMCMove(), BETAS), 0.7),
    (TemperedMove(SnookerMove(), BETAS), 0.3),
]
MIXED = [(DEMCMove(), 0.6), (SnookerMove(), 0.3), (MetropolisMove(sd=9.0), 0.1)]
MOVES = {
    "plain": (None, 16),
    "tempered": (LADDER, 24),
    "mixed": (MIXED, 12),
    "auto": ("auto", 12),
    "reject": (None, 16),
}


def fails(p):
    if p["a"] > 0.9:
        raise ArithmeticError("no convergence")
    return [10.0 + p["a"], 20.0 + p["b"]]


FAILING = ef.LogPosterior(
    ef.FunctionModel(fails, n_modes=2),
    ef.FrequencyTerm([10.0, 20.0], sd=[0.5, 0.5]),
    ef.IndependentPrior({"a": stats.norm(0, 1), "b": stats.norm(0, 1)}),
)


def sampled(kind, nsteps, backend=None):
    moves, nwalkers = MOVES[kind]
    reject = kind == "reject"
    return ef.run(
        FAILING if reject else ef.paper.mass_spring().posterior,
        moves,
        nwalkers,
        nsteps,
        ensembles=2,
        seed=5,
        thin_by=2,
        backend=backend,
        resume=backend is not None,
        on_failure="reject" if reject else "raise",
        max_failures=1.0,
    )


@cache
def uninterrupted(kind, nsteps):
    return sampled(kind, nsteps)


def check_same(kind, nsteps, path):
    """Finish the run and compare it with one that was never stopped."""
    resumed = sampled(kind, nsteps, path)
    for one, other in zip(uninterrupted(kind, nsteps), resumed, strict=True):
        assert_same(one, other)
        assert one.recipe.record == other.recipe.record
        assert one.burn_in_evaluations == other.burn_in_evaluations
        if kind == "reject":
            assert one.failures.counts == other.failures.counts
            assert one.failures.counts[-1] > 0
    assert os.listdir(Path(path).parent) == [Path(path).name]


def forked(work):
    """Return the process that does the work."""
    pid = os.fork()
    if pid:
        return pid
    try:
        work()
    except BaseException:
        traceback.print_exc()
        os._exit(1)
    os._exit(0)


def random_kills(kind, nsteps, path, kills):
    """Kill a run at random times; return how often that found it at work."""
    begin = time.perf_counter()
    sampled(kind, nsteps, path)
    duration = time.perf_counter() - begin
    os.remove(path)
    rng, found = random.Random(1), 0
    for _ in range(kills):
        child = forked(lambda: sampled(kind, nsteps, path))
        # Each life is a part of the run that is too short to end it.
        time.sleep(rng.uniform(0, 1.2 * duration / kills))
        os.kill(child, signal.SIGKILL)
        found += os.WIFSIGNALED(os.waitpid(child, 0)[1])
    check_same(kind, nsteps, path)
    return found


def deaths_in_writes(kind, nsteps, path, share, stride):
    """Let a run die in every ``stride``-th change of a file; return how often it did.

    A write dies after a share of its bytes, another change before it is made.
    """
    write, replace, remove = log.write, os.replace, os.remove

    def die_at(number):
        left = [number]

        def count(change, last):
            def counted(*arguments):
                left[0] -= 1
                if left[0] < 0:
                    last(*arguments)
                    os._exit(3)
                change(*arguments)

            return counted

        log.write = count(write, lambda file, c: write(file, c[: int(share * len(c))]))
        os.replace, os.remove = count(replace, print), count(remove, print)
        sampled(kind, nsteps, path)

    deaths, status = 0, 3
    while status == 3:
        _, code = os.waitpid(forked(partial(die_at, deaths * stride)), 0)
        status = os.waitstatus_to_exitcode(code)
        if status == 1:
            raise RuntimeError("the run failed, it was not killed")
        check_same(kind, nsteps, path)
        os.remove(path)
        deaths += 1
    return deaths - 1


if __name__ == "__main__":
    logging.getLogger("emcee_femu").setLevel(logging.ERROR)
    auto.FEWEST, auto.ROUND = 100, 100  # or it would take seconds
    task, *arguments = json.loads(sys.argv[1])
    print(json.dumps(globals()[task](*arguments)))
