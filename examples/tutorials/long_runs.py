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
    run = ef.run(
        posterior(), ef.DEMCMove(), nwalkers=12, steps=300, ensembles=1, seed=1,
        backend="run.sqlite", resume=True,
    )
    print(run[0].iteration, "steps")
"""
folder = tempfile.TemporaryDirectory()  # yours is where you keep your results
home = Path(folder.name)
(home / "job.py").write_text(JOB, encoding="utf-8")
file = home / "run.sqlite"

# %% [markdown]
# Start it, wait until the file holds 60 steps, and kill it as a full memory or the cluster's
# time limit would. {py:func}`~emcee_femu.diagnose` and
# {py:func}`~emcee_femu.to_inference_data`, which is told the posterior, read the file by its
# name, also while it grows.

# %%
search = [str(Path(ef.__file__).parents[1]), os.environ.get("PYTHONPATH", "")]
start = {
    "args": [sys.executable, "job.py"],
    "cwd": home,
    "env": os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, search))},
}


space = {"__name__": "job"}
exec(JOB, space)  # model and posterior of the script; it does not run
posterior = space["posterior"]


def steps_in(file):
    return ef.to_inference_data(file, posterior()).posterior.sizes["draw"]


job = subprocess.Popen(**start)
stored = 0
while job.poll() is None and stored < 60:
    time.sleep(0.05)
    try:
        stored = steps_in(file)
    except (FileNotFoundError, ValueError):  # nothing there, or only the start
        pass
job.kill()
job.wait()
stored = steps_in(file)
print("killed in the middle:", 60 <= stored < 300)

# %% [markdown]
# The same command goes on, and ends with the chain of a run that was never stopped, to
# the bit.

# %%
done = subprocess.run(**start, capture_output=True, text=True, check=True)
print(done.stdout)

(whole,) = ef.run(
    posterior(), nwalkers=12, steps=300, seed=1, moves=ef.DEMCMove(), ensembles=1
)
resumed = (
    ef.to_inference_data(file, posterior()).posterior["k1"].values
)  # (walkers, steps)
same = np.array_equal(resumed, whole.get_chain()[..., 0].T)
print("identical to a run that was never stopped:", same)

# %% [markdown]
# So a job script may always say `resume=True`: where there is no file a new run begins, and
# where the run is complete the call returns at once. The search of "auto" goes on too, and
# {py:func}`~emcee_femu.anneal`, {py:func}`~emcee_femu.emulate` and
# {py:func}`~emcee_femu.certify` take `backend` and `resume` as well, each with a file of its
# own. A file that is there is refused without `resume=True`.
#
# The file is a SQLite database, whatever its suffix: a step is there wholly or not at all,
# whatever kills the run. Each record has a checksum, so that flipped bytes are refused by
# name, and a second run that writes to the same file is refused. On a network file system
# see {doc}`/how_to/clusters`.
#
# ## The same posterior, or another one?
#
# Weeks later you go on with the run, and somebody has corrected a mass in the model. A chain
# of two posteriors would be worth nothing, and nobody would notice. So a resumed run
# evaluates 16 of the stored points again and compares what it finds with what was stored.


# %%
def corrected(p):
    return space["frequencies"](p, heaviest=21e3)


def go_on(changed, steps=400):
    """Try to go on with the file."""
    options = {"moves": ef.DEMCMove(), "nwalkers": 12, "ensembles": 1, "seed": 1}
    try:
        ef.run(changed, steps=steps, backend=file, resume=True, **options)
    except ValueError as error:
        message = str(error).replace(str(file), "run.sqlite")
        print(textwrap.fill(message, 80, replace_whitespace=False))
        return message


other_model = go_on(posterior(corrected))

# %% [markdown]
# Data, prior, moves and settings are in the file, so that a difference is named without a
# solve.
#
# - The tolerance of the probe is `probe_tolerance=1e-6`. A solver that gives another result
#   at each call is told apart from a changed one, and refused with that word.
# - What does not show at these parameter sets passes; functions are not compared.
# - Of data, priors, moves and settings what the file knows is compared as text, arrays of
#   more than 512 numbers by a digest.
#
# ## Pieces, until it is enough
#
# `steps` may grow from call to call. Where a job may take only so long, let it go on in
# pieces, look after each one, and end when the verdict is good or the time is up. The next
# job of the queue is the same script.

# %%
begin, limit = time.monotonic(), 20 * 3600.0  # s; leave some room
file = home / "pieces.sqlite"
target = ef.paper.mass_spring().posterior
for steps in range(500, 10_001, 500):
    run = ef.run(target, steps=steps, ensembles=2, seed=1, backend=file, resume=True)
    verdict = ef.diagnose(run)
    print(f"{steps} steps: {verdict.short}")
    if verdict.converged or time.monotonic() - begin > limit:
        break
assert verdict.converged

# %% [markdown]
# {py:func}`~emcee_femu.diagnose` says in one line what is missing, and in `verdict.verdict`
# at length, with the `steps` that it takes: the mass-spring posterior has a long tail in k4, which a short
# chain visits too rarely for its standard deviation. The search of "auto" takes a fifth of
# the evaluations that the *first* call asks for, so do not begin with too small a piece.
#
# ## Solves that fail
#
# A solve that fails (an exception, a time-out, NaN, a wrong number of modes) stops the run
# with the parameters by name. What was sampled is kept, in the file and as `error.run`.
# Should a run go on instead? With `on_failure="reject"` a failed solve is taken for
# impossible, counted by cause and reported: {doc}`/how_to/failing_solves` tells when that is
# right.
#
# ## Processes
#
# `workers=4` starts four processes and ends them with the run. On other machines, `pool=`
# takes any `concurrent.futures` executor, or a dask `Client`, or anything with a `map`. The
# chain is that of a serial run. Processes need the guard `if __name__ == "__main__":`
# wherever they are not forked (macOS, Windows).

# %%
if __name__ == "__main__":
    steps = {
        "moves": ef.DEMCMove(),
        "nwalkers": 12,
        "steps": 20,
        "ensembles": 1,
        "seed": 1,
    }
    chains = [
        ef.run(target, **steps, workers=workers)[0].get_chain() for workers in (None, 2)
    ]
    print("the same chain:", np.array_equal(*chains))

# %% [markdown]
# Workers pay from about a millisecond per solve on; one ensemble can use `nwalkers / 2` of
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
assert 60 <= stored < 300 and same
assert "another posterior" in other_model and "predicted" not in other_model
if __name__ == "__main__":
    assert np.array_equal(*chains)
