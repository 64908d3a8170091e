# %% [markdown]
# # Check that the prior allows what was measured
#
# For everybody, before any sampling: let draws of the prior predict the test. If what
# was measured is unlike all predictions, model, prior and test contradict each other,
# and a posterior would be their compromise. The test is simulated here. `python
# examples/how_to/prior_predictive.py` runs the page.
#
# A building has three floors of 20 t; the drawings say 30 MN/m for each storey, and one
# factor of all stiffnesses is to be updated. Three frequencies were measured to 1 %.

# %%
import numpy as np
from matplotlib import pyplot as plt
from scipy import stats

import emcee_femu as ef
from emcee_femu.table import Table

DRIFT = np.eye(3) - np.eye(3, k=-1)  # floors to storey drifts
storeys = {f"k{i + 1}": 30e3 * np.outer(row, row) for i, row in enumerate(DRIFT)}
measured = [2.35, 7.06, 10.95]  # Hz


def predict(K):
    """Return what 500 draws of the prior predict for the test, one solve each."""
    model = ef.MatrixModel(np.zeros((3, 3)), 20.0 * np.eye(3), K, n_modes=3)
    prior = ef.IndependentPrior(dict.fromkeys(K, stats.lognorm(0.3)))
    term = ef.FrequencyTerm(measured, relative_sd=0.01)
    posterior = ef.LogPosterior(model, term, prior)
    idata = ef.to_inference_data(posterior, prior_predictive=500)
    return idata["prior_predictive"]["frequency"].values[0]  # (500, 3)


tests = predict({"all": sum(storeys.values())})
low, high = np.quantile(tests, [0.025, 0.975], axis=0)
columns = [("mode", "d", [1, 2, 3]), ("measured Hz", ".2f", measured)]
columns += [("prior's 2.5 %", ".2f", low), ("97.5 %", ".2f", high)]
Table.from_columns("Predictions of the prior, 500 solves", columns)

# %% [markdown]
# Each frequency is well inside. But are they **together**? How far a test is from the
# mean, in standard deviations and correlations of the predictions, says how unusual it
# is (Box 1980). With a second model, which has a factor for each storey:


# %%
def share_farther(tests):
    """Return the share of predicted tests that are more unusual than the real one."""
    logs = np.log([*tests, measured])
    away = logs - logs[:-1].mean(axis=0)
    distance = (away @ np.linalg.inv(np.cov(logs[:-1].T)) * away).sum(axis=1)
    return (distance[:-1] > distance[-1]).mean()


both = {"one factor": tests, "a factor for each storey": predict(storeys)}
shares = {name: share_farther(drawn) for name, drawn in both.items()}

# %% tags=["result"] mystnb={"image": {"alt": "Ratio of the second to the first frequency against the first: with one factor the predictions lie on a level line below the measured ratio, with a factor for each storey in a cloud around it"}}
figure, panels = plt.subplots(1, 2, figsize=(8, 3.6), sharex=True, sharey=True)
for axes, (name, drawn) in zip(panels, both.items(), strict=True):
    axes.plot(drawn[:, 0], drawn[:, 1] / drawn[:, 0], ".", alpha=0.5)
    axes.plot(measured[0], measured[1] / measured[0], "C3P", ms=12, mec="white")
    axes.set_title(f"{name}:\n{100 * shares[name]:.0f} % of draws are more unusual")
    axes.set_xlabel("frequency 1 (Hz); predicted blue, measured red")
panels[0].set_ylabel("frequency 2 / frequency 1")
figure.tight_layout()
plt.close(figure)  # shown once, by the next line
figure

# %% [markdown]
# One factor moves all frequencies alike, so no draw is like the test. With a factor for
# each storey the test is ordinary, and sampling worth its solves.
#
# ## If the prior does not allow it
#
# 1. Look for a mistake: units (a factor of 6.28 is rad/s), modes in another order
#    ({doc}`/tutorials/crossing_modes`), a mass or a support that was forgotten.
# 2. Give the model what it lacks, as above, or let its error be inferred: `discrepancy=`
#    ({doc}`/tutorials/noise_and_model_error`).
# 3. Widen a prior only if it claimed more than you know, not until the test fits.
#
# A slow program affords fewer draws, say 50, or {doc}`its emulator
# </tutorials/hundred_solves>` predicts in its place. ArviZ draws the group by
# `plot_ppc(idata, group="prior")`, or since version 1 by
# `plot_ppc_dist(idata, group="prior_predictive")`.

# %% tags=["remove-cell"]
assert ((low < measured) & (measured < high)).all()
assert shares["one factor"] < 0.01 and shares["a factor for each storey"] > 0.1
