# %% [markdown]
# # Handle solves that fail
#
# Some parameter sets cannot be solved: the program does not converge, hangs, or returns
# fewer modes. By default that stops the run, with nothing lost; with
# `on_failure="reject"` the run continues and counts failures.
# `python examples/how_to/failing_solves.py` runs this page (5 s of processor time) on
# simulated data.
#
# ## Stop, and say where
#
# The solver below fails for a stiff second storey.

# %%
import logging

import numpy as np

import emcee_femu as ef


def frequencies(p):
    if p["k2"] > 9.5:
        raise ArithmeticError("no convergence after 50 iterations")
    K = 1e6 * np.array([[p["k1"] + p["k2"], -p["k2"]], [-p["k2"], p["k2"]]])
    A = K / np.sqrt(np.outer([16.5e3, 16.1e3], [16.5e3, 16.1e3]))
    return np.sqrt(np.linalg.eigvalsh(A)) / (2 * np.pi)


bounds = [(20, 90), (1, 15)]
prior = ef.GaussianPrior(["k1", "k2"], [50, 8], [9, 1], bounds)
term = ef.FrequencyTerm([3.13, 9.83], relative_sd=0.02)
posterior = ef.LogPosterior(ef.FunctionModel(frequencies, n_modes=2), term, prior)

try:
    posterior(np.array([[54.0, 9.9]]))
except ArithmeticError as error:
    print(error, *error.__notes__, sep="\n")

# %% [markdown]
# The samples so far are in the file `backend=`, and in `error.run`. A run that a
# failure stopped continues with `resume=True, on_failure="reject"`.
#
# ## Reject, and count
#
# A rejected solve has posterior probability zero. The logger "emcee_femu", silenced
# here, logs each one with its parameters. Starts from the prior that cannot be solved
# are drawn again.

# %%
logging.getLogger("emcee_femu").setLevel(logging.ERROR)
run = ef.run(
    posterior, ef.DEMCMove(), steps=200, ensembles=2, seed=1,
    on_failure="reject", max_failures=0.2,
)  # fmt: skip
log = run.failures
print(f"{log.causes.total()} of {log.evaluations} evaluations failed")
first = log.kept[0]
print("the first one:", first.message, dict(first.parameters), sep="\n  ")

# %% [markdown]
# `diagnose` reports them before its statements.
#
# **Rejecting says something about the parameters.** It removes a part of the prior, for
# an evidence too. If the posterior leans against that part, the result is that of another
# prior. So `max_failures` stops a run if more than that share of the evaluations, of at
# least 100, has failed.
#
# ## A program that hangs
#
# Limit the time where the model starts the program, `subprocess.run(..., timeout=600)`.
# `subprocess.TimeoutExpired` and `TimeoutError` are counted as time-outs, apart from
# other exceptions.
#
# ## The parameters' fault, or the machine's?
#
# Some failures come from the parameters, and some from the machine. If points are
# missing because a licence server was down, the posterior is wrong. The driver
# `examples/calculix_program.py` ({doc}`calculix`) handles both:
#
# - No convergence, a crash, a missing or damaged result, or a time-out is an exception:
#   the run does what `on_failure` says.
# - A full disk, a missing program, or no licence after `patience` seconds is
#   `Unavailable`. It is a `BaseException`, not an `Exception`, so that it stops the run in
#   any case.
#
# All solves are in the file `backend=`. When the server is back, the same call checks that
# the model is the same, and continues: `run` ({doc}`/tutorials/long_runs`), `emulate`
# ({doc}`/tutorials/hundred_solves`) and `certify`. A solve that `emulate` rejects is left
# out of the fit; in `certify` such a draw has no weight.

# %% tags=["remove-cell"]
assert 0 < log.causes["exception"] < 0.2 * log.evaluations
assert max(s.get_chain()[..., 1].max() for s in run) <= 9.5
assert "'exception'" in str(ef.diagnose(run, discard=100))
