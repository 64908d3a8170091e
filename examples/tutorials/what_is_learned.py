# %% [markdown]
# # Which parameters can be learned
#
# For those who plan a test, or wonder why a parameter stays unknown. Before a test,
# you can see which parameters it will determine, and choose modes and sensors
# accordingly. After the test, you can separate what the data say from what only the
# prior says. `python examples/tutorials/what_is_learned.py` runs the page. The
# test is simulated.
#
# A shear building has five floors of 20 t. The factors k1 to k5 of its storeys' nominal
# stiffness, 30 MN/m, are uncertain by about 20 %. Units: kN, t, m.

# %%
import textwrap

import numpy as np
from scipy import stats

import emcee_femu as ef
from emcee_femu.table import Table

N, MASS, STIFFNESS = 5, 20.0, 30e3
FLOORS = MASS * np.eye(N)
names = [f"k{storey}" for storey in range(1, N + 1)]
DRIFT = np.eye(N) - np.eye(N, k=-1)  # floors to storey drifts
STOREYS = {n: STIFFNESS * np.outer(b, b) for n, b in zip(names, DRIFT, strict=True)}
prior = ef.IndependentPrior(dict.fromkeys(names, stats.lognorm(0.2)))
nominal = {name: np.ones(1) for name in names}

# %% [markdown]
# ## Before the test
#
# You can see what a test will tell without measuring anything: let the model predict
# the data at the nominal parameters, and look at what they would teach. Frequencies are
# assumed good to 1 %, model error included, and shapes to 0.03 at a sensor for a shape
# of unit length.


# %%
def planned(n_modes, floors=()):
    """Posterior of a test that finds what the model predicts."""
    options = {"n_modes": n_modes, "shapes": [floor - 1 for floor in floors] or False}
    model = ef.MatrixModel(np.zeros((N, N)), FLOORS, STOREYS, **options)
    predicted = model(nominal)
    terms = [ef.FrequencyTerm(predicted.frequencies[0], relative_sd=0.01)]
    if floors:
        terms.append(ef.ShapeTerm(predicted.shapes[0], delta=0.03))
    return ef.LogPosterior(model, terms, prior)


found = ef.find_map(planned(2), seed=1)
look = ef.identifiability(found)
look

# %% [markdown]
# {py:func}`~emcee_femu.find_map` climbs from 16 draws of the prior to the maxima of the
# posterior, and approximates it by a Gaussian about each (Laplace). A model with
# `jacobian` takes one solve a step, a black box `d + 1`; with `workers=` all climbs
# advance in one batch. The first table says that two frequencies would leave nearly all
# uncertainty: the ratio of the posterior's to the prior's standard deviation is 0.69 to
# 0.94. The second says why: each row is the change in the eigenvalues for one prior
# standard deviation of a storey. Two frequencies are two numbers, for five unknowns.
#
# ### Which modes, which sensors
#
# The cheapest remedy is a better plan. The sd ratio of every storey under each plan:


# %% tags=["result"]
def ratios(posterior):
    return ef.identifiability(ef.find_map(posterior, seed=1)).sd_ratio


plans = {
    "2 modes, frequencies": (2, ()),
    "3 modes, frequencies": (3, ()),
    "5 modes, frequencies": (5, ()),
    "2 modes, shapes at floors 1 to 5": (2, (1, 2, 3, 4, 5)),
    "3 modes, shapes at floors 1 to 5": (3, (1, 2, 3, 4, 5)),
}
rows = np.array([ratios(planned(*what)) for what in plans.values()])
columns = [(name, ".2f", rows[:, i]) for i, name in enumerate(names)]
columns = [("plan", "", list(plans)), *columns]
Table.from_columns("sd/prior sd that a plan would leave", columns)

# %% [markdown]
# Two modes with their shapes teach far more than three frequencies. For most storeys
# they teach nearly as much as five, and they are far easier to excite. Compare sensor
# positions in the same way: `planned(2, (2, 5))`, and so on.
#
# A Gaussian is not always enough, and a maximum that no start leads to is missing; a narrow
# one may need `starts=200`. `check=100` spends that many solves on draws of the Gaussians.
# Their importance weights say whether the posterior is Gaussian.
#
# ## After the test
#
# Two modes were measured at all five floors. The test is simulated with a ground storey
# that has lost 30 % of its stiffness.

# %%
truth = {"k1": 0.7, "k2": 1.0, "k3": 1.05, "k4": 0.95, "k5": 1.0}
plan = planned(2, (1, 2, 3, 4, 5))
model = plan.experiments[0].model
modes = model({name: np.array([x]) for name, x in truth.items()})
rng = np.random.default_rng(1)
hertz = modes.frequencies[0] * (1 + 0.01 * rng.normal(size=2))
unit = modes.shapes[0] / np.linalg.norm(modes.shapes[0], axis=0)
test = ef.Measurements(hertz, shapes=unit + 0.03 * rng.normal(size=unit.shape))
terms = [ef.FrequencyTerm(test, relative_sd=0.01), ef.ShapeTerm(test, delta=0.03)]
posterior = ef.LogPosterior(model, terms, prior)
run = ef.run(posterior, seed=1)
idata = ef.to_inference_data(run)
diagnosis = ef.diagnose(run)
print(diagnosis.verdict)
ef.parameter_table(idata, true=truth)

# %%
after = ef.identifiability(idata)
after

# %% [markdown]
# The sd ratios are close to those of the plan (its fourth row). The loss in the ground
# storey is found: its whole 95 % interval lies below 0.9.
#
# A parameter with an sd ratio near 1 would be as uncertain as before: its posterior is
# the prior, and a narrower prior makes the answer narrower, not better. Report such a
# prior beside the result, and never call such a parameter updated.
#
# ## Stiffness and mass: only their ratio
#
# Frequencies are square roots of stiffness over mass. If the factor k of all storeys
# and the factor m of all floors are both unknown, no number of modes can separate them.

# %%
both = ef.IndependentPrior({"k": stats.lognorm(0.3), "m": stats.lognorm(0.3)})
WHOLE, NOTHING = sum(STOREYS.values()), np.zeros((N, N))


def state(added=0.0):  # t on the roof
    extra = np.diag([*np.zeros(N - 1), added])
    K, M = {"k": WHOLE}, {"m": FLOORS}
    model = ef.MatrixModel(NOTHING, extra, K, M, n_modes=3)
    predicted = model({"k": np.ones(1), "m": np.ones(1)}).frequencies[0]
    return model, ef.FrequencyTerm(predicted, relative_sd=0.003)


alone = ef.identifiability(ef.find_map(ef.LogPosterior(*state(), both), seed=1))
print(textwrap.fill(alone.findings[-1]))

# %% [markdown]
# Each parameter by itself keeps an sd ratio of 0.7: two priors and one known ratio leave
# 1/√2.
#
# ## What to add
#
# The same building with a known mass on its roof, here 20 t, separates them.
# {py:meth}`~emcee_femu.LogPosterior.joint` combines both tests:

# %%
states = {"empty": state(), "loaded": state(20.0)}
together = ef.LogPosterior.joint(states, both)
separated = ef.identifiability(ef.find_map(together, seed=1))
print("sd ratio of k and m:", alone.sd_ratio.round(2), "by frequencies,")
print("and with the known mass:", separated.sd_ratio.round(2))

# %% [markdown]
# Deflections under known loads do not depend on the mass, and separate them better: [a
# static test](../how_to/static_test.py). Where an sd ratio is near 1, add another kind of
# data before you add more of the same.

# %% tags=["remove-cell"]
frequencies, _, five, shapes, _ = rows
assert 0.6 < frequencies.min() and 0.85 < frequencies.max() < 0.95
assert abs(shapes.mean() - five.mean()) < 0.12
assert diagnosis.converged
assert np.abs(after.sd_ratio - shapes).max() < 0.15
for name, value in truth.items():
    x = idata["posterior"][name].values
    assert abs(x.mean() - value) < 3 * x.std()
assert np.quantile(idata["posterior"]["k1"].values, 0.975) < 0.9
assert "k and m" in alone.findings[-1] and 0.65 < min(alone.sd_ratio) < 0.75
assert max(separated.sd_ratio) < 0.3 * min(alone.sd_ratio)
