# %% [markdown]
# # Two states of one structure: damage
#
# For those who must say how much stiffness was lost between two tests, and how sure
# that is. One posterior has both states, and the fall is computed from its samples,
# with an interval and a probability. **All data of this page are simulated**, so that
# the truth is known. `python examples/tutorials/two_states.py` runs the page.
#
# A steel mast of 12 m has three parts. Five frequencies were measured when it was new,
# and again after a storm, each to 0.2 %. In truth the lower part has lost 6 % of its
# stiffness, and the others nothing.

# %%
import tempfile
from pathlib import Path

import numpy as np
from scipy import stats

import emcee_femu as ef

PARTS = {"lower": (9e-3, 9e-5), "middle": (7e-3, 5e-5), "upper": (5e-3, 2.2e-5)}
LIMITS, ERROR = (100.0, 320.0), 0.002  # GPa; of a frequency


def mast(state, warm=False):
    """The mast in a plane, with a modulus in GPa by part and state; reduced."""
    nodes = [(0, 0, z) for z in np.linspace(0, 12, 25)]  # m
    rho = (7850.0, "warm") if warm else 7850.0  # kg/m3
    sections = {
        part: ef.Section((1e9, f"{part} {state}"), 4e6, rho, area, I2, I2, (0, 1, 0))
        for part, (area, I2) in PARTS.items()
    }
    bars = [(i, i + 1, [*PARTS][i // 8]) for i in range(24)]
    held = dict.fromkeys(range(1, 25), ("uy", "uz", "rx", "rz")) | {0: "all"}
    full = ef.FrameModel(nodes, bars, sections, held, n_modes=5)
    bounds = dict.fromkeys(full.names, LIMITS) | {"warm": (0.95, 1.05)}
    return ef.reduce_model(full, {name: bounds[name] for name in full.names})


models = {state: mast(state) for state in ("before", "after")}
truth = {"lower before": 205.0, "middle before": 200.0, "upper before": 212.0}
truth |= {"lower after": 0.94 * 205.0, "middle after": 200.0, "upper after": 212.0}
rng, tests = np.random.default_rng(2), {}
for state, model in models.items():
    exact = model({name: np.array([x]) for name, x in truth.items()}).frequencies[0]
    tests[state] = exact * (1 + ERROR * rng.standard_normal(5))
    print(f"{state:>6}: {tests[state].round(2)} Hz")

# %% [markdown]
# ## One posterior
#
# {py:meth}`LogPosterior.joint <emcee_femu.LogPosterior.joint>` takes both tests. Each
# part has a modulus before and one after, with priors that know nothing of a damage.

# %%
priors = dict.fromkeys(truth, stats.norm(200.0, 30.0))  # GPa
bounds = dict.fromkeys(truth, LIMITS)
terms = {s: ef.FrequencyTerm(hertz, relative_sd=ERROR) for s, hertz in tests.items()}


def infer(after, priors, bounds):
    """The run of both tests with a model of the second."""
    pairs = {"before": (models["before"], terms["before"])}
    pairs["after"] = after, terms["after"]
    prior = ef.IndependentPrior(priors, bounds=bounds)
    posterior = ef.LogPosterior.joint(pairs, prior, dict.fromkeys(truth, "GPa"))
    return ef.run(posterior, steps=120, ensembles=2, seed=1)


run = infer(models["after"], priors, bounds)
print(ef.diagnose(run).short)

# %% [markdown]
# ## The fall, from the samples
#
# Any function of the samples is a derived quantity: write it into the ArviZ object with
# its unit, and tables, figures and the report have it.

# %%
falls = [f"fall {part}" for part in PARTS]


def convert(run):
    """The ArviZ object of a run with the fall of each part, and their table."""
    idata = ef.to_inference_data(run)
    samples = idata["posterior"]
    for part in PARTS:
        kept = samples[f"{part} after"] / samples[f"{part} before"]
        samples[f"fall {part}"] = 100 * (1 - kept)
        samples[f"fall {part}"].attrs["units"] = "%"
    return idata, ef.parameter_table(idata, var_names=falls)


idata, table = convert(run)
table

# %%
for name in falls:
    drawn = idata["posterior"][name].values
    print(f"{name} > 0 with a probability of {(drawn > 0).mean():.3f},", end=" ")
    print(f"> 3 % with {(drawn > 3).mean():.3f}")

# %% tags=["result"] mystnb={"image": {"alt": "Samples of the falls of three parts: that of the lower part lies around 5 %, the others around 0"}}
truths = dict(zip(falls, [6.0, 0.0, 0.0], strict=True))
ef.figures.plot_scatter(idata, var_names=falls, truths=truths)

# %% [markdown]
# The interval of the lower part excludes zero. The others may have stayed as they were
# (blue: the truth). If the lower part has lost more, the middle one has lost less:
# frequencies tell their sum better than each of them.
#
# In the report of {py:func}`~emcee_femu.report` the falls stand among the parameters:

# %%
path = Path(tempfile.mkdtemp(), "mast.html")
ef.report(idata, path, posterior=run.posterior, title="Mast, before and after").name

# %% [markdown]
# ## How often is there a false alarm?
#
# Say that an alarm is an interval of 95 % that excludes zero. If nothing happened, some
# 5 of 100 alarms of a part should be false, and intervals should hold as often as they
# say. Simulated pairs of tests of this mast, moduli drawn from the prior, show that they
# do; in the second row the lower part has lost stiffness:
#
# ```{literalinclude} ../../examples/benchmarks/measured/damage_alarms.txt
# :language: text
# ```
#
# With three parts, the chance that any of them raises a false alarm is larger: for three
# parts, use 98 % intervals to keep the overall false-alarm rate near 5 %.
#
# ## What temperature would do
#
# Steel that is warmer by 30 K is softer by some one percent, in all parts alike; concrete,
# asphalt and frozen ground change by more. The same second test, with all moduli one
# percent lower, and so all frequencies by a half:

# %%
terms["after"] = ef.FrequencyTerm(tests["after"] * 0.99**0.5, relative_sd=ERROR)
_, unaware = convert(infer(models["after"], priors, bounds))
unaware

# %% [markdown]
# Each fall is one percent too large, and no interval says so. A temperature that may
# matter is a parameter with a prior, here a factor "warm" of the density, which changes
# frequencies as moduli do:

# %%
known = priors | {"warm": stats.norm(1.0, 0.01)}
within = bounds | {"warm": (0.95, 1.05)}
warm, aware = convert(infer(mast("after", warm=True), known, within))
aware

# %% [markdown]
# The intervals are wider by what the temperature may do. Frequencies cannot tell a warm
# structure from one that is softer everywhere. A thermometer can: 30 K more are a prior
# with the mean 1.01, and a smaller sd. What differs between parts is seen all the same:
# **compare parts**, or take tests at several temperatures into the joint posterior.

# %%
samples = warm["posterior"]
apart = (samples["fall lower"] - samples["fall upper"]).values
print(f"lower beyond upper: {apart.mean():.1f} %, sd {apart.std():.1f};", end=" ")
print(f"above 0 with a probability of {(apart > 0).mean():.3f}")

# %% [markdown]
# The same error of the model in both states, such as a wrong mass, hardly touches a fall.
# An error that differs between them does: another support, another load, snow. For
# several states in a row see {doc}`many_tests`.

# %% tags=["remove-cell"]
assert table.column("unit") == ["%"] * 3 and ef.diagnose(run).converged
true = np.array([*truths.values()])
low, high = (np.array(table.column(name)) for name in ("2.5 %", "97.5 %"))
assert (low < true).all() and (true < high).all() and low[0] > 2
assert "fall lower" in path.read_text(encoding="utf-8")
means = [np.array(each.column("mean")) for each in (table, unaware, aware)]
assert (np.abs(means[1] - means[0] - 1) < 0.5).all()
width = np.subtract(unaware.column("97.5 %"), unaware.column("2.5 %"))
low, high = (np.array(aware.column(name)) for name in ("2.5 %", "97.5 %"))
assert (high - low > width).all()
assert (low < true).all() and (true < high).all() and (apart > 0).mean() > 0.95
