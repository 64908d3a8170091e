# %% [markdown]
# # Use a program as a black box
#
# Any program that is started from a command line can be a model: write its input file,
# start it, read its output. `emulate` then learns the outputs from some tens of solves,
# and `certify` checks the posterior against full ones.
# `python examples/how_to/black_box.py` runs this page (4 s of processor time).
#
# ## The program
#
# A few lines of Python replace the program here, so that this page runs on every
# machine: two storeys of 16.5 t and 16.1 t, with simulated data. Like an FE program, it
# reads `job.inp` and writes `job.dat` in the folder where it is started.

# %%
import subprocess
import sys
import tempfile
from pathlib import Path

import emcee_femu as ef

PROGRAM = """
from math import pi, sqrt
k1, k2 = (1e6 * float(word) for word in open("job.inp").read().split())
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
# empty folder; the time limit ends a program that hangs; `check=True` turns an exit
# status other than 0 into an exception; numbers are written with all their digits.

# %%
starts = []


def solve(p):
    starts.append(p)
    with tempfile.TemporaryDirectory(dir=home) as job:
        deck, result = Path(job) / "job.inp", Path(job) / "job.dat"
        deck.write_text(f"{p['k1']:.12e} {p['k2']:.12e}\n", encoding="ascii")
        subprocess.run(COMMAND, cwd=job, timeout=60, check=True)
        return [float(line) for line in result.read_text(encoding="ascii").split()]


solve({"k1": 50.0, "k2": 10.0})

# %% [markdown]
# First, solve some corners of the prior and look at the output. If a tenth of the prior
# cannot be solved, narrow it.
#
# ## Emulate, run, certify

# %%
bounds = [(20, 90), (1, 15)]
prior = ef.GaussianPrior(["k1", "k2"], [50, 10], [9, 3], bounds)
term = ef.FrequencyTerm([3.13, 9.83], relative_sd=0.02)
model = ef.FunctionModel(solve, n_modes=2)
posterior = ef.LogPosterior(model, term, prior)

emulated = ef.emulate(posterior, solves=30, seed=1, on_failure="reject")
run = ef.run(emulated.posterior, seed=1)
idata = ef.to_inference_data(run)
certificate = ef.certify(idata, posterior, 40, seed=1)
print(f"the program was started {len(starts)} times")
certificate

# %% [markdown]
# {doc}`/tutorials/hundred_solves` explains these steps and their output. A program that
# writes K and M needs no emulator ({doc}`matrices`).
#
# ## For daily use
#
# [`examples/calculix_program.py`](https://github.com/emcee-femu/emcee_femu/blob/main/examples/calculix_program.py)
# is that function, to copy, with CalculiX as the program ({doc}`calculix`). It also
# ends all that a start script has started, waits for licences, and tells failures of
# the machine from those of the parameters ({doc}`failing_solves`).
#
# - **Time limit.** Take ten times the longest usual solve, on a machine that is as busy as
#   it will be.
# - **Scratch folders.** Put them on a local disk that is large enough for all workers.
#   When a run stops, workers end in the middle of a solve and leave their folders: use a
#   `tempfile.TemporaryDirectory()` around the run.
# - **Workers.** `workers=4` solves four parameter sets at a time, in four copies of the
#   program with one thread each (`OMP_NUM_THREADS=1`) and four licences.

# %% tags=["remove-cell"]
assert certificate.short == "certified" and len(starts) <= 1 + 70
assert len(starts) == 1 + emulated.solves + certificate.solves
assert abs(certificate.mean[0] - 54.3) < 0.5
assert abs(certificate.mean[1] - 7.22) < 0.1
