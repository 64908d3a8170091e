"""A long run: killed, resumed, and with a solver that sometimes fails.

Five masses and ten springs stand for a model that costs days. The run writes to a file;
a child process that samples is killed in the middle (SIGKILL, as by a full memory or a
cluster's time limit), and the same call goes on with the file. The chain is that of a
run which was never stopped, to the bit. Asked to go on with other data, it refuses and
says what differs. Then the cost of writing is measured, against a generation of 16
walkers at 5 ms per evaluation. Last, a solver that does not converge for stiff springs
is sampled with ``on_failure="reject"``: the failures are counted, and reported.

Run it:  python examples/resume.py
"""

import argparse
import logging
import multiprocessing
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path

import numpy as np

import emcee_femu as ef

PROBLEM = ef.paper.mass_spring()
MOVES = [(ef.DEMCMove(), 0.9), (ef.SnookerMove(), 0.1)]


def sample(
    path: str | None, generations: int, posterior: ef.LogPosterior = PROBLEM.posterior
) -> list:
    """Begin the run, or go on with it: the same call for both."""
    return ef.run(
        posterior,
        MOVES,
        nwalkers=16,
        nsteps=generations,
        ensembles=2,
        seed=1,
        backend=path,
        resume=path is not None,
    )


def killed(path: str, generations: int, share: float) -> int:
    """Sample in a child process, kill it at a share of the run, count its steps."""
    child = multiprocessing.get_context("spawn").Process(
        target=sample, args=(path, generations)
    )
    child.start()
    wanted = int(2 * generations * share)
    stored = 0
    while child.is_alive() and stored < wanted:
        if Path(path).exists():
            stored = sum(steps(path))
        time.sleep(0.01)
    child.kill()
    child.join()
    return sum(steps(path))


def steps(path: str) -> list[int]:
    """Return the stored steps of both ensembles."""
    return [own.iteration for own in ef.sampling.run_file.RunFile.open(path)]


def diverging(parameters: Mapping[str, float]) -> np.ndarray:
    """Solve one parameter set, and fail for stiff springs, as some solvers do."""
    if parameters["k4"] > 2_250:
        raise ArithmeticError("no convergence after 50 iterations")
    batch = {name: np.array([value]) for name, value in parameters.items()}
    return PROBLEM.model(batch).frequencies[0]


def main(generations: int = 4_000, share: float = 0.4) -> dict:
    """Kill and resume a run, time the writing, reject failures; return what came."""
    with tempfile.TemporaryDirectory() as directory:
        found = survive(str(Path(directory) / "run.chain"), generations, share)
    return {**found, "log": reject(generations // 2)}


def survive(path: str, generations: int, share: float) -> dict:
    """Kill and resume a run, be refused another one, and time the writing."""
    stored = killed(path, generations, share)
    print(f"killed with {stored} of {2 * generations} steps in the file")
    resumed, whole = sample(path, generations), sample(None, generations)
    same = all(
        np.array_equal(a.get_chain(), b.get_chain())
        and np.array_equal(a.get_blobs(), b.get_blobs())
        for a, b in zip(resumed, whole, strict=True)
    )
    print(f"resumed; identical to a run that was never stopped: {same}")

    other = ef.FrequencyTerm(PROBLEM.measured * [1, 1, 1.001, 1, 1], beta=6.8e5)
    prior = PROBLEM.posterior.prior
    refusal = ""
    try:
        sample(path, generations, ef.LogPosterior(PROBLEM.model, other, prior))
    except ValueError as error:
        refusal = str(error).replace(path, "run.chain")
    print(f"\nwith other data: {refusal}")

    seconds = {}
    for place in ("memory", "file"):
        backend = None if place == "memory" else path + ".timed"
        begin = time.process_time()
        sample(backend, generations)
        seconds[place] = time.process_time() - begin
    cost = 1e3 * (seconds["file"] - seconds["memory"]) / (2 * generations)
    print(
        f"\nwriting costs {cost:.2f} ms per generation: {cost / 80:.2%} of one of 16 "
        "walkers at 5 ms per evaluation"
    )

    return {"stored": stored, "same": same, "refusal": refusal}


def reject(generations: int) -> ef.posterior.failures.FailureLog:
    """Sample where the solver does not always converge; return what was counted."""
    # Each failure is logged with its parameters; here their number is enough.
    logging.getLogger("emcee_femu").setLevel(logging.ERROR)
    model = ef.FunctionModel(diverging, n_modes=5)
    known = PROBLEM.posterior
    posterior = ef.LogPosterior(model, known.terms, known.prior)
    samplers = ef.run(
        posterior,
        nwalkers=16,
        nsteps=generations,
        seed=1,
        initial=[list(PROBLEM.nominal.values())] * np.ones((16, 1))
        + np.random.default_rng(0).normal(size=(16, 5)),
        on_failure="reject",
        max_failures=0.2,
    )
    diagnosis = ef.diagnose(samplers, discard=generations // 5)
    log = samplers[0].failures
    print(f"\n{log.causes.total()} of {log.evaluations} solves failed\n{diagnosis}")
    return log


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--generations", type=int, default=4_000)
    parser.add_argument("--share", type=float, default=0.4)
    main(**vars(parser.parse_args()))
