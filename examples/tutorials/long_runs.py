# %% [markdown]
# # Long runs and clusters
#
# A run of days meets power cuts, time limits of a queue, full disks and solves that do not
# converge. You will keep a run in a file, kill it and go on with it, see what a changed
# model does to it, decide what a failed solve means, use several processes, and write the
# job of a cluster. `python examples/tutorials/long_runs.py` runs this page (12 s of processor time).
#
# ## A run in a file
#
# The script below is a whole job: model, data, prior, and one call of
# {py:func}`~emcee_femu.run` with `backend=`, the name of a file, and `resume=True`. This
# page writes it, so that it can be killed in a process of its own. The model is a frame of
# three storeys; a pause of a millisecond makes it slow enough to be killed.

# %%
import os
import subprocess
import sys
import tempfile
import textwrap
import time
from pathlib import Path

import numpy as np

import emcee_femu as ef

JOB = """
import time

import numpy as np
import emcee_femu as ef


def frequencies(p, heaviest=20e3):  # k in MN/m, masses in kg
    k = 1e6 * np.array([p["k1"], p["k2"], p["k3"]])
    K = np.diag(k + np.append(k[1:], 0)) - np.diag(k[1:], 1) - np.diag(k[1:], -1)
    m = np.array([heaviest, 18e3, 15e3])
    time.sleep(0.001)
    return np.sqrt(np.linalg.eigvalsh(K / np.sqrt(np.outer(m, m)))) / (2 * np.pi)


def posterior(function=frequencies, measured=(3.32, 9.62, 13.11)):
    prior = ef.GaussianPrior(["k1", "k2", "k3"], [40] * 3, [10] * 3, [(5, 90)] * 3)
    term = ef.FrequencyTerm(list(measured), relative_sd=0.01)
    return ef.LogPosterior(ef.FunctionModel(function, n_modes=3), term, prior)


if __name__ == "__main__":
    samplers = ef.run(
        posterior(),
        nwalkers=12,
        nsteps=150,
        seed=1,
        backend="run.chain",
        resume=True,
    )
    print(samplers[0].iteration, "steps")
"""
folder = tempfile.TemporaryDirectory()  # yours is where you keep your results
home = Path(folder.name)
(home / "job.py").write_text(JOB, encoding="utf-8")
file = home / "run.chain"

# %% [markdown]
# Start it, wait until the file holds 60 steps, and kill it as a full memory or the cluster's
# time limit would. {py:class}`~emcee_femu.sampling.run_file.RunFile` reads the file, also
# while it grows.

# %%
search = [str(Path(ef.__file__).parents[1]), os.environ.get("PYTHONPATH", "")]
start = {
    "args": [sys.executable, "job.py"],
    "cwd": home,
    "env": os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, search))},
}
job = subprocess.Popen(**start)
stored = 0
while job.poll() is None and stored < 60:
    time.sleep(0.02)
    if file.exists():
        stored = ef.sampling.run_file.RunFile(file).iteration
job.kill()
job.wait()
stored = ef.sampling.run_file.RunFile(file).iteration
print("killed in the middle:", 60 <= stored < 150)

# %% [markdown]
# The same command goes on, and ends with the chain of a run that was never stopped, to
# the bit.

# %%
done = subprocess.run(**start, capture_output=True, text=True, check=True)
print(done.stdout)

resumed = ef.sampling.run_file.RunFile(file)
space = {"__name__": "job"}
exec(JOB, space)  # model and posterior of the script; it does not run
posterior = space["posterior"]
(whole,) = ef.run(posterior(), nwalkers=12, nsteps=150, seed=1)
same = np.array_equal(resumed.get_chain(), whole.get_chain())
print("identical to a run that was never stopped:", same)

# %% [markdown]
# So a job script may always say `resume=True`: where there is no file a new run begins, and
# where the run is complete the call returns at once. The search of "auto" goes on too, from
# the file `run.chain.burn-in`, a journal of all that it evaluated, which is removed once the
# chain begins. {py:func}`~emcee_femu.anneal` does the same with `backend="run.annealing"`;
# its file keeps every evaluation, and stays, so that a finished annealing asked for again
# costs no more than the probe below.
#
# The file is a log: a header with what is sampled and how, and one record with a checksum
# per stored generation, which is never touched again. A kill can only cut the last record
# short. Flipped bytes and a second run that writes to the same file are refused by the
# number of the record. A last record that has its full length but not its checksum, as a
# power loss may leave it, is computed again after a warning, and so are steps that were cut
# off at the end. A file without all starts is refused. `RunFile` knows the cold walkers of a
# tempered run, and its `to_hdf(path)` writes the file for emcee's `HDFBackend`.
#
# What writing costs is measured by `python examples/resume.py`: 0.01 to 0.06 ms per stored
# generation in four runs of version 0.2.0, at most 0.1 % of a generation of 16 walkers at
# 5 ms per evaluation.
#
# ## The same posterior, or another one?
#
# Weeks later you go on with the run, and somebody has corrected a mass in the model. A chain
# of two posteriors would be worth nothing, and nobody would notice. So a resumed run
# evaluates the stored last generation again and compares every column with what was stored.


# %%
def corrected(p):
    return space["frequencies"](p, heaviest=21e3)


def go_on(changed, nsteps=200):
    """Try to go on with the file."""
    options = {"nwalkers": 12, "seed": 1, "backend": file, "resume": True}
    try:
        ef.run(changed, nsteps=nsteps, **options)
    except ValueError as error:
        message = str(error).replace(str(file), "run.chain")
        print(textwrap.fill(message, 80, replace_whitespace=False))
        return message


other_model = go_on(posterior(corrected))

# %% [markdown]
# Data, prior, moves and settings are in the header of the file, so that a difference is
# named without a solve:

# %%
other_data = go_on(posterior(measured=(3.32, 9.62, 13.12)))

# %% [markdown]
# - The probe costs `nwalkers` solves per ensemble, of a search or an annealing 16. Its
#   tolerance is `probe_tolerance=1e-6`.
# - A solver that gives another result at each call is told apart from a changed one, and
#   refused with that word.
# - What does not show at these parameter sets passes.
# - Functions are not compared: neither the code of a model nor a proposal or a density
#   that is passed as a function. For objects of your own classes (priors, moves,
#   distributions) the file keeps the type and those constructor arguments that are
#   attributes of the same name, for a term of your own what it `observed`; other
#   attributes may count or cache.
# - Numbers are compared to a relative 1e-12, since another processor may compute the last
#   digits of a covariance otherwise; arrays of more than 512 numbers by a digest, exactly.
#
# ## Pieces, until it is enough
#
# `nsteps` may grow from call to call. Where a job may take only so long, let it go on in
# pieces, look after each one, and end when the verdict is good or the time is up. The next
# job of the queue is the same script.

# %%
begin, limit = time.monotonic(), 20 * 3600.0  # s; leave some room
file = home / "pieces.chain"
target = ef.paper.mass_spring().posterior
for nsteps in range(500, 10_001, 500):
    options = {"ensembles": 2, "seed": 1, "backend": file, "resume": True}
    samplers = ef.run(target, "auto", nsteps=nsteps, **options)
    verdict = ef.diagnose(samplers)
    print(f"{nsteps} steps: {verdict.short}")
    if verdict.short == "converged" or time.monotonic() - begin > limit:
        break

# %% [markdown]
# {py:func}`~emcee_femu.diagnose` says in a word or two what is missing, and in
# `verdict.verdict` at length: the mass-spring posterior has a long tail in k4, which a short
# chain visits too rarely for its standard deviation. The search of "auto" takes a fifth of
# the evaluations that the *first* call asks for, so do not begin with too small a piece.
#
# ## Solves that fail
#
# A solve that fails (an exception, a time-out, NaN, a wrong number of modes) stops the run
# with the parameters by name. What was sampled is kept, in the file or as `error.samplers`.
# Should a run go on instead? With `on_failure="reject"` a failed solve is taken for
# impossible, counted by cause and reported.

# %%
import logging

# Else one line per failure
logging.getLogger("emcee_femu").setLevel(logging.ERROR)


def diverging(p):
    if p["k3"] > 60:
        raise ArithmeticError("no convergence after 50 iterations")
    return space["frequencies"](p)


(sampler,) = ef.run(
    posterior(diverging), nwalkers=12, nsteps=100, seed=1, on_failure="reject"
)
log = sampler.failures
print(f"rejected: {dict(log.causes)} of {log.evaluations} evaluations")

# %% [markdown]
# Rejecting says something about the parameters, and it takes a part of the prior away:
# {doc}`/how_to/failing_solves` tells when that is right.
#
# ## Processes
#
# `workers=4` starts four processes and ends them with the run. On other machines, `pool=`
# takes any `concurrent.futures` executor, or a dask `Client`, or anything with a `map`. The
# chain is that of a serial run, to the bit. Processes need the guard
# `if __name__ == "__main__":` wherever they are not forked (macOS, Windows).

# %%
from concurrent.futures import ThreadPoolExecutor

if __name__ == "__main__":
    steps = {"nwalkers": 12, "nsteps": 20, "seed": 1}
    (serial,) = ef.run(target, **steps)
    (parallel,) = ef.run(target, **steps, workers=2)
    with ThreadPoolExecutor(2) as threads:
        (pooled,) = ef.run(target, **steps, pool=threads)
    chains = [s.get_chain() for s in (serial, parallel, pooled)]
    print("three times the same chain:", np.ptp(chains, axis=0).max() == 0)

# %% [markdown]
# Workers pay from about a millisecond per solve on; one sampler can use `nwalkers / 2` of
# them at once. {doc}`/how_to/clusters` has executors for other machines, and what they
# cost.
#
# ## A job script
#
# For one node of a Slurm cluster:
#
#  ```bash
#  #!/bin/bash
#  #SBATCH --ntasks=1 --cpus-per-task=16
#  #SBATCH --time=24:00:00
#  #SBATCH --job-name=bridge --dependency=singleton
#  export OMP_NUM_THREADS=1
#  python job.py
#  ```
#
# with `workers=16` and 32 walkers or more in `job.py`, one thread for the linear algebra of
# each, and the pieces above. Submit it three times: `--dependency=singleton` lets one job of
# that name run after the other, each goes on where the last one was stopped, and those
# that find nothing left to do end at once.

# %% tags=["remove-cell"]
assert 60 <= stored < 150 and same
assert "another posterior" in other_model and "predicted" not in other_model
assert "measured" in other_data and "13.11" in other_data
assert verdict.short == "converged" and nsteps < 10_000
assert log.causes["exception"] > 0 and log.evaluations >= 12 * 101
if __name__ == "__main__":
    assert np.ptp(chains, axis=0).max() == 0
