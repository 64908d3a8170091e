# %% [markdown]
# # Comparing model classes
#
# For those who must decide how many parameters the data justify. A *model class* is a
# model, its parameters and their prior. This page compares classes by their evidence,
# and shows what such a comparison depends on. `python
# examples/tutorials/model_classes.py` runs the page. Its building and
# frequencies are made up.
#
# More parameters always fit better, so the fit cannot choose. The *evidence* can. It is
# the probability density that a class gave to the measurements D before they were made:
#
# $$Z = p(D) = \int p(D \mid \theta)\, p(\theta)\, d\theta$$
#
# A class that could also have predicted many other data gave less to each of them.
#
# ## Three classes for one building
#
# Three floors of 500 kg, three natural frequencies, measured to 1 %. The drawings say 2
# MN/m for each storey. The second storey has visible damage. Which of these?
#
# - one factor for all storeys;
# - one factor, and the second storey by itself;
# - three stiffnesses.

# %%
import numpy as np

import emcee_femu as ef

storeys = {f"k{i}": (i - 1, i, 2e6) for i in (1, 2, 3)}
building = ef.MassSpringModel([500.0, 500.0, 500.0], storeys)
term = ef.FrequencyTerm([4.17, 12.29, 16.42], relative_sd=0.01)  # Hz


def one_factor(p):  # the three storeys are alike
    return building({name: 2e6 * p["factor"] for name in storeys})


def second_apart(p):
    alike = 2e6 * p["factor"]
    return building({"k1": alike, "k2": p["k2"], "k3": alike})


for function in (one_factor, second_apart):
    function.variables = ef.modal_variables(3)

# %% [markdown]
# All classes get the same measurements and realistic priors: 30 % on every stiffness.
# `"auto"` samples them; its runs give the evidence without any further solve.

# %%
factor = ef.GaussianPrior(["factor"], [1.0], [0.3], [(0.1, 3.0)])
bounds = [(0.1, 3.0), (2e5, 6e6)]
apart = ef.GaussianPrior(["factor", "k2"], [1, 2e6], [0.3, 6e5], bounds)
three = ef.GaussianPrior([*storeys], [2e6] * 3, 6e5, [(2e5, 6e6)] * 3)
classes = {
    "one factor": ef.LogPosterior(one_factor, term, factor),
    "second storey apart": ef.LogPosterior(second_apart, term, apart),
    "three stiffnesses": ef.LogPosterior(building, term, three),
}
runs = {name: ef.run(posterior, seed=1) for name, posterior in classes.items()}
for name, run in runs.items():
    print(f"{name}: {ef.diagnose(run).short}")

# %% [markdown]
# All chains have converged, but two of three measured frequencies lie outside of what
# the first class predicts.
#
# ## The comparison

# %%
compared = ef.compare_models(runs)
compared

# %% [markdown]
# For each class, the table has ln Z with its standard error, and the logarithm of the
# Bayes factor against the first class. The probabilities take all classes for equally
# probable before the data; otherwise give `prior=`. `weak`, `positive`, `strong` and
# `very strong` are Kass and Raftery's words, for ln B below 1, below 3, below 5, and
# above. A difference within two combined standard errors is called undecided.

# %% tags=["result"] mystnb={"image": {"alt": "Log Bayes factors of three classes with bars: second storey apart on top, three stiffnesses a little behind, one factor far behind; to the right their probabilities"}}
ef.figures.plot_model_comparison(compared)

# %% [markdown]
# ## Occam's razor
#
# The logarithm of the evidence is a fit less a charge:
#
# $$\ln Z = \langle \ln p(D \mid \theta) \rangle - \mathrm{KL}(\text{posterior},
# \text{prior})$$
#
# The fit is the mean of the log-likelihood over the posterior. The charge, the
# Kullback-Leibler divergence, is how far the data narrowed the prior down.

# %%
charge = {}
for name, run in runs.items():
    log_prob = np.concatenate([s.get_log_prob(flat=True) for s in run])
    blobs = np.concatenate([s.get_blobs(flat=True) for s in run])
    fit = (log_prob - blobs[:, 0]).mean()  # the first blob is the log-prior
    log_z = compared.evidences[name].log_evidence
    charge[name] = fit - log_z
    print(f"{name:20} fit {fit:6.2f} - charge {charge[name]:5.2f} = {log_z:6.2f}")

# %% [markdown]
# The third stiffness hardly improves the fit, but adds to the charge.
#
# ## Cross-validation, by ArviZ
#
# `arviz.loo` leaves one datum out after the other. The model class with the lower
# `elpd` predicts worse. The group `log_likelihood` has one number for each datum; a
# term whose data are correlated, such as that of shapes, counts as one.

# %% tags=["remove-stderr"]
import arviz as az

ranking = az.compare({name: ef.to_inference_data(run) for name, run in runs.items()})
ranking

# %% [markdown]
# Mind the warning. A modal test has few data, and leaving one out changes the posterior
# much: a Pareto k above 0.7 means that the samples cannot give the result. The evidence
# has no such limit, but depends on the prior.
#
# ## What the evidence depends on
#
# The evidence depends on the prior far more than a posterior does. Here is the single
# factor again, uniform between 0.5 and 1.5, and then over a range ten times as wide.
# The posterior is the same; the evidence is not.

# %%
wide = {}
for low, high in [(0.5, 1.5), (0.1, 10.1)]:
    prior = ef.IndependentPrior({"factor": (low, high)})
    posterior = ef.LogPosterior(one_factor, term, prior)
    run = ef.run(posterior, seed=1)
    theta = np.concatenate([s.get_chain(flat=True) for s in run])
    wide[high] = ef.log_evidence(run)
    mean, sd, log_z = theta.mean(), theta.std(), wide[high].log_evidence
    print(f"{low} to {high}: factor {mean:.3f} +- {sd:.3f}, ln Z {log_z:.2f}")
loss = wide[1.5].log_evidence - wide[10.1].log_evidence
print(f"lost: {loss:.2f}; ln 10 = {np.log(10):.2f}")

# %% [markdown]
# So a prior made wide "to be on the safe side" counts against its class, by ln 10 for
# each unnecessary factor of ten, and for each parameter. Use priors that state what you
# believed before the test, in all classes alike, and check how much the conclusion
# changes with them. The evidence depends on the error model as well: if errors are too
# small, every class fails, and the most flexible one fails least.
#
# {py:func}`~emcee_femu.log_evidence` takes runs of `"auto"`, by one bridge from the
# frozen proposal to the chain, tempered runs, and annealed populations: [several
# modes](../how_to/tempering.py). If a standard error cannot be trusted, none is
# claimed, and `compare_models` decides nothing. [Moves
# measured](../explanation/moves_measured.md) compares all three with exact values.

# %% tags=["remove-cell"]
assert compared.winner != "one factor"
table = compared.table.to_frame().set_index("model class")
by_class = table["ln Bayes factor"].to_dict()
assert by_class["one factor"] > 5
assert list(by_class)[0] == "second storey apart"
assert 0 < by_class["three stiffnesses"] < 3
assert "against 'one factor' is very strong" in compared.conclusion
assert [*charge.values()] == sorted(charge.values())
assert ranking.index[-1] == "one factor"
assert abs(loss - np.log(10)) < 0.06
assert all(ef.diagnose(s).converged for s in runs.values())
