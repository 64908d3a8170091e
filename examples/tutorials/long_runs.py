# %% [markdown]
# # Long runs
#
# For runs of hours or days, which meet power cuts, time limits of a queue, full disks
# and solves that do not converge. This page keeps a run in a file, kills it,
# continues it to exactly the same chain, and shows what happens if the model has
# changed. `python examples/tutorials/long_runs.py` runs the page. The measured
# frequencies are made up.
#
# ## Resume and restart
#
# The script below is a whole job: model, data, prior, and one call of
# {py:func}`~emcee_femu.run` with `backend=`, the name of a file, and `resume=True`.
# This page writes it to a file, so that it can be killed as a separate process. The
# model is a frame of three storeys; a pause of a millisecond makes it slow enough to be
# killed.

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
        backend="run.chain", resume=True,
    )
    print(run[0].iteration, "steps")
"""
folder = tempfile.TemporaryDirectory()  # yours is where you keep your results
home = Path(folder.name)
(home / "job.py").write_text(JOB, encoding="utf-8")
file = home / "run.chain"

# %% [markdown]
# Start it, wait until the file holds 60 steps, and kill it, as the cluster's time limit
# would. {py:func}`~emcee_femu.diagnose` and {py:func}`~emcee_femu.to_inference_data`,
# with the posterior as an argument, read the file by its name, even while it grows.

# %%
search = [str(Path(ef.__file__).parents[1]), os.environ.get("PYTHONPATH", "")]
environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, search))}
start = {"args": [sys.executable, "job.py"], "cwd": home, "env": environment}
space = {"__name__": "job"}
exec(JOB, space)  # model and posterior of the script; it does not run
posterior = space["posterior"]


def steps_in(file):
    idata = ef.to_inference_data(file, posterior(), discard=0)  # with its burn-in
    return idata.posterior.sizes["draw"]


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
# The same command continues, and ends with exactly the chain of a run that was never
# stopped.

# %% tags=["result"]
done = subprocess.run(**start, capture_output=True, text=True, check=True)
print(done.stdout)

options = {"moves": ef.DEMCMove(), "nwalkers": 12, "ensembles": 1, "seed": 1}
(whole,) = ef.run(posterior(), steps=300, **options)
resumed = ef.to_inference_data(file, posterior(), discard=0).posterior
same = np.array_equal(resumed["k1"], whole.get_chain()[..., 0].T)  # (walkers, steps)
print("identical to a run that was never stopped:", same)

# %% [markdown]
# So a job script may always say `resume=True`: without a file a new run begins, and if
# the run is complete the call returns at once. {py:func}`~emcee_femu.anneal`,
# {py:func}`~emcee_femu.emulate` and {py:func}`~emcee_femu.certify` also take `backend`
# and `resume`, each with its own file: a SQLite database, in which each step is stored
# completely or not at all ({doc}`/how_to/clusters` has network file systems).
#
# ## The same posterior, or another one?
#
# Weeks later you continue the run, and somebody has corrected a mass in the model. A
# chain of two posteriors would be worthless, and nobody would notice. So a resumed run
# evaluates 16 of the stored points again and compares the results with the stored ones.


# %%
def corrected(p):
    return space["frequencies"](p, heaviest=21e3)


changed = posterior(corrected)
try:
    ef.run(changed, steps=400, backend=file, resume=True, **options)
except ValueError as error:
    message = str(error).replace(str(file), "run.chain")
    print(textwrap.fill(message, 80, replace_whitespace=False))

# %% [markdown]
# Data, prior, moves and settings are in the file, so that a difference is reported
# without a solve. The tolerance of the check is `probe_tolerance=1e-6`. A change without
# effect at these parameter sets passes: functions are not compared.
#
# ## Until it is enough
#
# Without `steps` a run ends when its chains have converged and every parameter has
# `ess=1_000` effective samples (more of them here), or after `solves=200_000`. Give a
# short job fewer `solves`; the next job is the same script with more of them:

# %%
file = home / "pieces.chain"
target = ef.paper.mass_spring().posterior
for solves in (10_000, 200_000):
    options = {"ess": 3_000, "solves": solves, "backend": file, "resume": True}
    run = ef.run(target, seed=1, **options)
    verdict = ef.diagnose(run)
    print(f"{run.solves:,} solves, ended by {run.stopped}: {verdict.short}")

# %% [markdown]
# A solve that fails stops the run, too, and nothing is lost; {doc}`/how_to/black_box`
# says when `on_failure="reject"` is right.
#
# ## A job script
#
# {doc}`/how_to/clusters` has job scripts, and jobs that continue one another.

# %% tags=["remove-cell"]
assert 60 <= stored < 300 and same
assert "another posterior" in message and "predicted" not in message
assert verdict.converged and run.stopped == "converged" and run.solves > 10_000
