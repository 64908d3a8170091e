# %% [markdown]
# # Use a program as a black box
#
# For those whose model is a program that is started from a command line: write its
# input file, start it, read its output. `emulate` then learns the outputs from some
# tens of solves, and `certify` checks the posterior against full ones. Parameter sets
# that cannot be solved stop a run, with nothing lost, or are rejected and counted.
# `python examples/how_to/black_box.py` runs the page.
#
# ## The program
#
# A few lines of Python replace the program here, so that this page runs on every
# machine: two storeys of 16.5 t and 16.1 t, with simulated data. Like an FE program, it
# reads `job.inp` and writes `job.dat` in the folder where it is started. It fails for a
# stiff second storey.

# %%
import logging
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

import emcee_femu as ef

PROGRAM = """
from math import pi, sqrt
k1, k2 = (1e6 * float(word) for word in open("job.inp").read().split())
if k2 > 9.5e6:
    raise SystemExit("no convergence after 50 iterations")
b = (k1 + k2) / 16.5e3 + k2 / 16.1e3
c = k1 * k2 / (16.5e3 * 16.1e3)
with open("job.dat", "w") as output:
    for sign in (-1, 1):
        omega = sqrt(b / 2 + sign * sqrt(b * b / 4 - c))
        output.write(f"{omega / (2 * pi):.9e}\\n")
"""
folder = tempfile.TemporaryDirectory()
home = Path(folder.name)
(home / "program.py").write_text(PROGRAM, encoding="utf-8")
COMMAND = [sys.executable, "-I", "-S", str(home / "program.py")]

# %% [markdown]
# ## The function around it
#
# The function takes one parameter set and returns its results. Every solve gets a new,
# empty folder; the time limit ends a program that hangs; an exit status other than 0
# becomes an exception; numbers are written with all their digits.

# %%
starts = []


def solve(p):
    starts.append(p)
    with tempfile.TemporaryDirectory(dir=home) as job:
        deck, result = Path(job) / "job.inp", Path(job) / "job.dat"
        deck.write_text(f"{p['k1']:.12e} {p['k2']:.12e}\n", encoding="ascii")
        options = {"cwd": job, "timeout": 60, "capture_output": True, "text": True}
        if (done := subprocess.run(COMMAND, **options)).returncode:
            raise ArithmeticError(done.stderr.strip())
        return [float(line) for line in result.read_text(encoding="ascii").split()]


prior = ef.GaussianPrior(["k1", "k2"], [50, 8], [9, 1], [(20, 90), (1, 15)])
term = ef.FrequencyTerm([3.13, 9.83], relative_sd=0.02)
posterior = ef.LogPosterior(ef.FunctionModel(solve, n_modes=2), term, prior)

# %% [markdown]
# ## A solve that fails: stop, and say where
#
# First, solve some corners of the prior and look at the output. If a tenth of the prior
# cannot be solved, narrow it.

# %%
try:
    posterior(np.array([[54.0, 9.9]]))
except ArithmeticError as error:
    print(error, *error.__notes__, sep="\n")

# %% [markdown]
# The samples of a run so far are in the file `backend=`, and in `error.run`. A run that
# a failure stopped continues with `resume=True, on_failure="reject"`.
#
# ## Reject, and count
#
# A rejected solve has posterior probability zero. The logger "emcee_femu", silenced
# here, logs each one with its parameters. Starts from the prior that cannot be solved
# are drawn again, and `diagnose` reports failures before its statements.

# %%
logging.getLogger("emcee_femu").setLevel(logging.ERROR)
reject = {"seed": 1, "on_failure": "reject"}
options = {"ensembles": 1, "max_failures": 0.2}
short = ef.run(posterior, ef.DEMCMove(), 8, 15, **options, **reject)
log = short.failures
print(f"{log.causes.total()} of {log.evaluations} evaluations failed")
print("the first one:", log.kept[0].message, dict(log.kept[0].parameters), sep="\n  ")

# %% [markdown]
# **Rejecting says something about the parameters.** It removes a part of the prior, for
# an evidence too. If the posterior leans against that part, the result is that of
# another prior. So `max_failures` stops a run if more than that share of the
# evaluations, of at least 100, has failed.
#
# ## Few solves
#
# {py:func}`~emcee_femu.run_emulated` emulates the program, samples the emulated posterior
# and certifies it by full solves, all in one call:

# %% tags=["result"]
before = len(starts)
found = ef.run_emulated(posterior, 120, **reject)
print(f"the program was started {len(starts) - before} times")
found

# %% [markdown]
# {doc}`/tutorials/hundred_solves` explains its steps and this output. A solve that is
# rejected is left out of the fit of the emulator; of the draws that certify, such a draw
# has no weight. A program that writes K and M needs no emulator ({doc}`matrices`).
#
# ## For daily use
#
# [`examples/calculix_program.py`](https://github.com/emcee-femu/emcee_femu/blob/main/examples/calculix_program.py)
# is that function, to copy, with CalculiX as the program ({doc}`calculix`). It also
# ends all that a start script has started, and tells failures of the machine from those
# of the parameters:
#
# - No convergence, a crash, a missing or damaged result, or a time-out is an exception:
#   the run does what `on_failure` says. `subprocess.TimeoutExpired` and `TimeoutError`
#   are counted apart from other exceptions.
# - A full disk, a missing program, or no licence after `patience` seconds is
#   `Unavailable`. It is a `BaseException`, so that it stops the run in any case: if
#   points are missing because a licence server was down, the posterior is wrong. All
#   solves are in the file `backend=`. When the server is back, the same call checks
#   that the model is the same, and continues ({doc}`/tutorials/long_runs`).
#
# For your own program:
#
# - **Time limit.** Take ten times the longest usual solve, on a machine that is as busy as
#   it will be.
# - **Scratch folders.** Put them on a local disk that is large enough for all workers.
#   When a run stops, workers end in the middle of a solve and leave their folders: use a
#   `tempfile.TemporaryDirectory()` around the run.
# - **Workers.** `workers=4` needs four copies of the program, with one thread each
#   (`OMP_NUM_THREADS=1`), and four licences.

# %% tags=["remove-cell"]
assert 0 < log.causes["exception"] < 0.2 * log.evaluations
assert short[0].get_chain()[..., 1].max() <= 9.5
assert "'exception'" in str(ef.diagnose(short))
assert found.short == "certified"
assert len(starts) - before == found.solves <= 120
assert abs(found.mean[0] - 54.3) < 0.5
assert abs(found.mean[1] - 7.25) < 0.15
