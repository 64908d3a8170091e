"""Runs that die: a process of its own forks them, kills them and goes on with them.

Forked, since a run that starts Python anew would hardly be killed while it writes; in a
process of its own, since a test runner has threads, which do not survive a fork.
"""

import json
import logging
import os
import random
import resource
import signal
import sys
import time
import traceback
from functools import cache
from pathlib import Path

from support.stored import KINDS, bits

STEPS = 20


@cache
def uninterrupted(kind):
    return bits(KINDS[kind](None, steps=STEPS))


def check_same(kind, path):
    """Finish the run and compare it with one that was never stopped."""
    assert bits(KINDS[kind](path, steps=STEPS)) == uninterrupted(kind), kind
    assert os.listdir(Path(path).parent) == [Path(path).name]


def forked(work, *arguments):
    """Return the process that does the work."""
    pid = os.fork()
    if pid:
        return pid
    try:
        work(*arguments)
    except BaseException:
        traceback.print_exc()
        os._exit(1)
    os._exit(0)


def ended_by(child):
    """Return the signal that ended a child, 0 for none; it must not have failed."""
    status = os.waitpid(child, 0)[1]
    if os.WIFSIGNALED(status):
        return os.WTERMSIG(status)
    assert os.waitstatus_to_exitcode(status) == 0, "it failed"
    return 0


def random_kills(kind, path, kills):
    """Kill a run at random times; return how often that found it at work."""
    begin = time.perf_counter()
    KINDS[kind](path, steps=STEPS)
    duration = time.perf_counter() - begin
    os.remove(path)
    rng, found = random.Random(1), 0
    for _ in range(kills):
        child = forked(lambda: KINDS[kind](path, steps=STEPS))
        # Each life is a part of the run that is too short to end it.
        time.sleep(rng.uniform(0, 1.2 * duration / kills))
        os.kill(child, signal.SIGKILL)
        if ended_by(child):
            found += 1
        else:  # it took longer the first time, when the machine was busy
            os.remove(path)
            duration /= 2
    check_same(kind, path)
    return found


def limit(size):
    """Let no file of this process become larger."""
    hard = resource.getrlimit(resource.RLIMIT_FSIZE)[1]
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))


def full_disks(kind, path, number):
    """Let files find no room; return how often this was told by the file's name."""
    KINDS[kind](path, steps=STEPS)
    size, told = os.path.getsize(path), 0
    for part in range(number):
        os.remove(path)
        limit(max(40, size * part // number))  # semaphores of 32 bytes are files
        try:
            KINDS[kind](path, steps=STEPS)
        except OSError as error:
            told += Path(path).name in str(error)
        limit(resource.RLIM_INFINITY)
        check_same(kind, path)
    return told


if __name__ == "__main__":
    logging.getLogger("emcee_femu").setLevel(logging.ERROR)
    task, *arguments = json.loads(sys.argv[1])
    print(json.dumps(globals()[task](*arguments)))
