"""Runs that die: a process of its own forks them, kills them and goes on with them.

Forked, since a run that starts Python anew would hardly be killed while it writes; in a
process of its own, since a test runner has threads, which do not survive a fork.
"""

import json
import os
import signal
import sys
import time
from pathlib import Path

import emcee
import numpy as np

from emcee_femu.moves import DEMCMove, SnookerMove, TemperedMove
from emcee_femu.sampling.run_file import RunFile, creation, storage
from emcee_femu.sampling.run_file import backend as own_backend

NWALKERS, NDIM, BLOBS = 16, 2, 3
BETAS = [1.0, 0.4]
MOVES = [
    (TemperedMove(DEMCMove(), BETAS), 0.7),
    (TemperedMove(SnookerMove(), BETAS), 0.3),
]


def log_prob(theta):
    """Return rows that begin with the log-posterior and the log-prior."""
    log_prior = -0.05 * np.square(theta).sum(axis=1)
    log_likelihood = -np.square(theta[:, 0] * theta[:, 1] - 1)
    return np.column_stack([log_prior + log_likelihood, log_prior, theta * 2])


def first_state(ensemble):
    random = np.random.RandomState(ensemble)  # noqa: NPY002 - what emcee uses
    start = random.standard_normal((NWALKERS, NDIM))
    rows = log_prob(start)
    return emcee.State(start, rows[:, 0], rows[:, 1:], random.get_state())


def run(backends, nsteps, thin_by=2):
    """Run every ensemble up to ``nsteps`` steps, from where it is."""
    for ensemble, backend in enumerate(backends):
        done = backend.iteration if backend.initialized else 0
        sampler = emcee.EnsembleSampler(
            NWALKERS, NDIM, log_prob, moves=MOVES, vectorize=True, backend=backend
        )
        state = backend.get_last_sample() if done else first_state(ensemble)
        if done < nsteps:
            sampler.run_mcmc(
                state, nsteps - done, thin_by=thin_by, skip_initial_state_check=True
            )


def go_on(path, nsteps, room, ensembles=2):
    """Begin the run, with room for some steps only, or go on with it."""
    if os.path.exists(path):
        backends = RunFile.resume(path, ensembles)
    else:
        backends = RunFile.create(
            path, NWALKERS, NDIM, room, blobs=BLOBS, ensembles=ensembles, fingerprint={}
        )
    run(backends, nsteps)


def content(backends):
    """Return all that a run leaves, as bytes."""
    return [
        np.asarray(part).tobytes()
        for backend in backends
        for part in (
            backend.get_chain(),
            backend.get_log_prob(),
            backend.get_blobs(),
            backend.accepted,
            *backend.random_state[1:],
            backend.iteration,
        )
    ]


def uninterrupted(nsteps, ensembles=2):
    """Return the content of a run in memory: emcee's own, without any file."""
    backends = [emcee.backends.Backend() for _ in range(ensembles)]
    run(backends, nsteps)
    return content(backends)


def plain(path, ensembles=2):
    """Return the content of a file as emcee itself reads it."""
    names = [f"ensemble_{k}" for k in range(ensembles)]
    return content([emcee.backends.HDFBackend(path, name=name) for name in names])


def forked(work):
    """Return the process that does the work."""
    pid = os.fork()
    if pid:
        return pid
    try:
        work()
    except BaseException as error:
        print(f"child: {error!r}", file=sys.stderr, flush=True)
        os._exit(1)
    os._exit(0)


def killed_after(delay, work):
    """Return whether the work was killed before it ended."""
    pid = forked(work)
    time.sleep(delay)
    os.kill(pid, signal.SIGKILL)
    code = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
    if code > 0:
        raise RuntimeError("the run failed, it was not killed")
    return code < 0


def random_kills(path, nsteps, least):
    """Kill a run at random times; return the kills, and whether the end is the same."""
    rng = np.random.default_rng(1)
    begin = time.perf_counter()
    go_on(path + ".whole", 1, room=nsteps)
    making = time.perf_counter() - begin
    go_on(path + ".whole", nsteps, room=nsteps)
    running = time.perf_counter() - begin - making

    def work():
        go_on(path, nsteps, room=nsteps // 2)

    kills = {"making": 0, "running": 0}
    while kills["making"] < least // 2:
        kills["making"] += killed_after(rng.uniform(0, making), work)
        if os.path.exists(path):
            RunFile.resume(path, 2)  # whole if it is there
            os.remove(path)
    go_on(path, 1, room=nsteps // 2)  # or all were killed before there is a file
    # Half of the time, as the machine may be faster now than when it was measured.
    while kills["running"] < least and killed_after(
        rng.uniform(0, 0.5 * running / least), work
    ):
        kills["running"] += 1
    work()
    expected = uninterrupted(nsteps)
    same = content(RunFile.resume(path, 2)) == expected == plain(path)
    return kills | {"same": same}


# Only where files change: a death while reading changes nothing.
WRITING = (
    "create extend _incomplete _build _make_room _copy_rows resume grow save_step "
    "write_rows commit publish write_at"
).split()


def deaths_at_lines(path, nsteps, room, stride):
    """Let a run die before each ``stride``-th line that may write; return failures."""
    files = {module.__file__ for module in (own_backend, creation, storage)}

    def die_before_line(number):
        count = 0

        def trace(frame, event, _):
            nonlocal count
            code = frame.f_code
            if code.co_filename not in files or code.co_name not in WRITING:
                return None
            count += event == "line"
            if count > number:
                os._exit(3)
            return trace

        sys.settrace(trace)
        go_on(path, nsteps, room, ensembles=1)

    return deaths(path, nsteps, room, die_before_line, stride)


def deaths_in_every_write(path, nsteps, room, share):
    """Let a run die in each write, after a share of the bytes; return the failures."""
    write = storage.write_at

    def die_in_write(number):
        count = 0

        def write_at(file, place, content):
            nonlocal count
            if count == number:
                write(file, place, content[: int(share * len(content))])
                os._exit(3)
            count += 1
            write(file, place, content)

        storage.write_at = write_at
        go_on(path, nsteps, room, ensembles=1)

    return deaths(path, nsteps, room, die_in_write, 1)


def deaths(path, nsteps, room, die, stride):
    expected = uninterrupted(nsteps, 1)
    number, failures = 0, []
    while True:
        for rest in Path(path).parent.glob(Path(path).name + "*"):
            rest.unlink()
        _, status = os.waitpid(forked(lambda n=number: die(n)), 0)
        died = os.waitstatus_to_exitcode(status) == 3
        try:
            go_on(path, nsteps, room, ensembles=1)
            same = content(RunFile.resume(path)) == expected == plain(path, 1)
            if not same:
                failures.append(f"{number}: another chain")
        except Exception as error:  # reported by the test
            failures.append(f"{number}: {error!r}")
        if not died:
            return {"deaths": number // stride, "failures": failures}
        number += stride


if __name__ == "__main__":
    os.fsync = lambda _: None  # for a loss of power, not for a kill; it takes long
    kind, *arguments = json.loads(sys.argv[1])
    print(json.dumps(globals()[kind](*arguments)))
