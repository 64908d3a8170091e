"""Runs that die: a process of its own forks them, kills them and goes on with them.

Forked, since a run that starts Python anew would hardly be killed while it writes; in a
process of its own, since a test runner has threads, which do not survive a fork.
"""

import json
import logging
import multiprocessing
import os
import random
import resource
import signal
import sys
import time
from pathlib import Path

from support.stored import KINDS, bits

STEPS = 20


def finish(kind, path, expected):
    """Finish the run and compare it with one that was never stopped."""
    assert bits(KINDS[kind](path, steps=STEPS)) == expected, kind
    assert os.listdir(Path(path).parent) == [Path(path).name]


def random_kills(kind, path, kills):
    """Kill a run at random times; return how often that found it at work."""
    begin = time.perf_counter()
    whole = bits(KINDS[kind](None, steps=STEPS))
    duration = time.perf_counter() - begin
    rng, found = random.Random(1), 0
    for _ in range(kills):
        child = multiprocessing.get_context("fork").Process(
            target=KINDS[kind], args=(path,), kwargs={"steps": STEPS}
        )
        child.start()
        # Each life is a part of the run that is too short to end it.
        time.sleep(rng.uniform(0, 1.2 * duration / kills))
        child.kill()
        child.join()
        assert child.exitcode in (0, -signal.SIGKILL), "it failed"
        if child.exitcode:
            found += 1
        else:  # it took longer the first time, when the machine was busy
            os.remove(path)
            duration /= 2
    finish(kind, path, whole)
    return found


def limit(size):
    """Let no file of this process become larger."""
    hard = resource.getrlimit(resource.RLIMIT_FSIZE)[1]
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))


def full_disks(kind, path, number):
    """Let files find no room; return how often this was told by the file's name."""
    whole, told = bits(KINDS[kind](path, steps=STEPS)), 0
    size = os.path.getsize(path)
    for part in range(number):
        os.remove(path)
        limit(max(40, size * part // number))  # semaphores of 32 bytes are files
        try:
            KINDS[kind](path, steps=STEPS)
        except OSError as error:
            told += Path(path).name in str(error)
        limit(resource.RLIM_INFINITY)
        finish(kind, path, whole)
    return told


if __name__ == "__main__":
    logging.getLogger("emcee_femu").setLevel(logging.ERROR)
    task, *arguments = json.loads(sys.argv[1])
    print(json.dumps(globals()[task](*arguments)))
