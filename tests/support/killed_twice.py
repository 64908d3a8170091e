"""``run`` killed at random times, in a process of its own: forks need no threads."""

import os
import random
import signal
import sys
import time

import numpy as np

import emcee_femu as ef
from emcee_femu import DEMCMove, MetropolisMove, SnookerMove, TemperedMove

POSTERIOR = ef.paper.mass_spring().posterior
BETAS = [1.0, 0.3]
MOVES = {
    "tempered": ([TemperedMove(DEMCMove(), BETAS)], 24),
    "mixed": (
        [(DEMCMove(), 0.6), (SnookerMove(), 0.3), (MetropolisMove(sd=9.0), 0.1)],
        12,
    ),
    "tempered and mixed": (
        [
            (TemperedMove(DEMCMove(), BETAS), 0.7),
            (TemperedMove(SnookerMove(), BETAS), 0.3),
        ],
        24,
    ),
    "auto": ("auto", 12),
}
ENSEMBLES, NSTEPS = 2, 600


def sampled(kind, backend=None, resume=False):
    moves, nwalkers = MOVES[kind]
    return ef.run(
        POSTERIOR,
        moves,
        nwalkers,
        NSTEPS,
        ensembles=ENSEMBLES,
        seed=5,
        thin_by=2,
        backend=backend,
        resume=resume,
    )


def killed(kind, path, seconds):
    """Go on with the run in a child, kill it, and say whether it was still at work."""
    child = os.fork()
    if not child:
        sampled(kind, path, resume=True)
        os._exit(0)
    time.sleep(seconds)
    os.kill(child, signal.SIGKILL)
    _, status = os.waitpid(child, 0)
    return os.WIFSIGNALED(status)


def main(kind, path, kills, seed):
    whole = sampled(kind)
    begin = time.perf_counter()
    sampled(kind, path + ".timed")
    duration = time.perf_counter() - begin
    random.seed(seed)
    found = 0
    for _ in range(kills):
        # Each life is a tenth of the run or less, so that none of them ends it.
        found += killed(kind, path, random.uniform(0, 1.2 * duration / kills))
    samplers = sampled(kind, path, resume=True)
    for one, other in zip(whole, samplers, strict=True):
        for what in ("get_chain", "get_log_prob", "get_blobs"):
            np.testing.assert_array_equal(getattr(one, what)(), getattr(other, what)())
        np.testing.assert_array_equal(
            one.acceptance_fraction, other.acceptance_fraction
        )
        for a, b in zip(
            one.backend.random_state, other.backend.random_state, strict=True
        ):
            np.testing.assert_array_equal(a, b)
        assert one.recipe == other.recipe
        assert one.burn_in_evaluations == other.burn_in_evaluations
    print(f"{found} of {kills} kills found it at work; the same to the bit")


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], int(sys.argv[3]), int(sys.argv[4]))
