"""Runs that die: this process forks them, kills them and goes on with them.

Forked, since a run that starts Python anew would hardly be killed while it writes; in a
process of its own, since a test runner has threads, which do not survive a fork.
"""

import logging
import multiprocessing
import os
import random
import signal
import sys
import time
from pathlib import Path

from support.stored import KINDS, bits

STEPS, KILLS = 20, 5


def kill(run, path):
    """Kill a run at random times; return how often that found it at work."""
    begin = time.perf_counter()
    whole = bits(run(None, steps=STEPS))
    duration = time.perf_counter() - begin
    rng, found = random.Random(1), 0
    for _ in range(KILLS):
        child = multiprocessing.get_context("fork").Process(
            target=run, args=(path,), kwargs={"steps": STEPS}
        )
        child.start()
        # Each life is a part of the run that is too short to end it.
        time.sleep(rng.uniform(0, 1.2 * duration / KILLS))
        child.kill()
        child.join()
        assert child.exitcode in (0, -signal.SIGKILL), "it failed"
        if child.exitcode:
            found += 1
        else:  # it took longer the first time, when the machine was busy
            os.remove(path)
            duration /= 2
    assert bits(run(path, steps=STEPS)) == whole
    assert os.listdir(Path(path).parent) == [Path(path).name]
    return found


if __name__ == "__main__":
    logging.getLogger("emcee_femu").setLevel(logging.ERROR)
    print(kill(KINDS[sys.argv[1]], sys.argv[2]))
