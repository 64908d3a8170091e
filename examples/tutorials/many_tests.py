# %% [markdown]
# # Many tests of one structure
#
# For those who test the same structure again and again, while temperature, assembly,
# loads and excitation change. This page shows how much the parameters vary from test
# to test, what this depends on, and what to expect of the next test. The tests are
# simulated, so the answer is known. `python examples/tutorials/many_tests.py` runs
# the page.
#
# A single posterior of all data assumes that the parameters are constant, so its
# standard deviations shrink below the scatter between tests.
# {py:func}`~emcee_femu.pool_tests` starts from the posteriors of the single tests
# instead, and needs no new FE solve.
#
# ## Twelve tests
#
# A two-storey frame on soft soil is tested on 12 days between -4 and 33 degrees. The
# frame loses 0.4 % of its stiffness a degree, and scatters by 1.5 %. The soil does not
# depend on temperature, but varies from day to day by 6 %. Three frequencies are
# measured, with errors of 0.5 %.

# %%
import numpy as np

import emcee_femu as ef

TESTS, ERROR = 12, 0.005
SLOPE, SCATTER_FRAME, SCATTER_SOIL = -0.004, 0.015, 0.06

K_FRAME = 9e6 * np.array([[1.0, -1, 0], [-1, 2, -1], [0, -1, 1]])
K_SOIL = 12e6 * np.diag([1.0, 0.0, 0.0])
M = np.diag([9e3, 6e3, 5e3])  # footing, first floor, roof; kg
K = {"frame": K_FRAME, "soil": K_SOIL}  # parameters are factors of these
model = ef.MatrixModel(np.zeros((3, 3)), M, K, n_modes=3)

rng = np.random.default_rng(1)
degrees = rng.permutation(np.linspace(-4.0, 33.0, TESTS)).round(1)
frame = 1 + SLOPE * (degrees - 15) + SCATTER_FRAME * rng.standard_normal(TESTS)
soil = 1 + SCATTER_SOIL * rng.standard_normal(TESTS)
exact = model({"frame": frame, "soil": soil}).frequencies
measured = np.sort(exact * (1 + ERROR * rng.standard_normal(exact.shape)))
days = [f"day{i + 1}" for i in range(TESTS)]
for i in range(3):
    print(f"{days[i]}: {degrees[i]:5.1f} degrees, {measured[i].round(3)} Hz")

# %% [markdown]
# ## Each test by itself
#
# Every test is updated by itself, under the same prior. Pool only converged chains.

# %%
names, bounds = ["frame", "soil"], [(0.3, 2.0), (0.3, 2.0)]
prior = ef.GaussianPrior(names, [1.0, 1.0], 0.3, bounds)
posteriors, tests, soil_sd = {}, {}, {}
for i, day in enumerate(days):
    term = ef.FrequencyTerm(measured[i], relative_sd=ERROR)
    posteriors[day] = ef.LogPosterior(model, term, prior)
    run = ef.run(posteriors[day], steps=60, ensembles=2, seed=i)
    assert ef.diagnose(run).converged, day
    tests[day] = ef.to_inference_data(run)
    soil_sd[day] = run[0].get_chain(flat=True)[:, 1].std()
print("sd of the soil's factor:", *(f"{sd:.3f}" for sd in soil_sd.values()))
ef.parameter_table(tests["day1"])

# %% [markdown]
# ## The population
#
# The parameters of test t come from a normal distribution, cut at the bounds of the
# tests' priors and normalised inside them:
#
# $$\theta_t \sim N\big(\text{mean} + \text{slope}\,(x_t - \bar x),\ \text{sd}\big)$$
#
# Here x is the temperature, a *covariate*.

# %%
covariates = {"temperature": dict(zip(days, degrees, strict=True))}
population = ef.population.NormalPopulation(names, covariates=covariates)
options = {"draws": 300, "posteriors": posteriors}
pooled = ef.pool_tests(tests, population, seed=1, **options)
pooled

# %% [markdown]
# The first table is for the population:
#
# - `mean` is that at the average temperature. More tests determine it better, as in one
#   posterior of all data, and likewise the slope `per temperature`.
# - `sd` is the spread from test to test. It does **not** shrink with more tests, since
#   it belongs to the structure; it only becomes known better.
# - `next test` is what to expect of the parameters in the next test; design for it.
#
# The second table has each test by itself, and given all others, which determine it
# better. Tests whose draws hardly reach to where the others put them (Pareto k above 0.7)
# are sampled again under the population if `posteriors` are given; here all reach it.

# %% mystnb={"image": {"alt": "Two panels, frame and soil, one row for each of 12 days: grey intervals of single tests, blue ones given all tests beside them, a little shorter and nearer to the population's mean"}}
ef.figures.plot_population(pooled)

# %% [markdown]
# Grey is a test by itself, blue the same test given all others. It moves towards the
# value expected at the temperature of its day, the more so the less certain it was.
# Along the temperature, the frame falls and the soil does not:

# %% tags=["result"] mystnb={"image": {"alt": "Frame and soil factors over the temperature; the red line of the frame falls steadily, that of the soil is nearly level within its wide band"}}
ef.figures.plot_population(pooled, against="temperature")

# %% [markdown]
# ## A test not yet made
#
# `next_test` draws the parameters of a test at a temperature that no test had. The
# draws include the uncertainty of the population and the scatter about it.

# %%
hot = pooled.next_test(temperature=40.0)  # 1,000 draws
for name, values in hot.items():
    low, high = np.quantile(values, [0.025, 0.975])
    print(f"{name} at 40 degrees: {low:.3f} to {high:.3f}")
frequencies = model(hot).frequencies
low, high = np.quantile(frequencies[:, 0], [0.025, 0.975])
print(f"first frequency: {low:.2f} to {high:.2f} Hz")

# %% [markdown]
# `pooled.idata` and `pooled.run` belong to the population's run. The `log_likelihood`
# has one value for each test, so `arviz.loo` shows which test the others do not expect.
#
# ## What is assumed
#
# Hyperpriors are the priors of the population's own parameters. If you give none, they
# follow from the prior of the tests, with mean m and standard deviation s: `mean` is
# normal(m, s), `sd` half-normal(s), a slope normal(0, s / sd of the covariate).

# %%
pooled.population

# %% [markdown]
# - `hyperpriors={"sd soil": stats.halfnorm(scale=0.1)}` replaces them.
# - Parameters that are not named, such as an inferred error, stay separate for each test,
#   under the test's own prior.
# - Each test's prior is divided out of its posterior. A prior much narrower than the
#   likelihood leaves nothing to divide.
#
# ## When not to trust it
#
# The likelihood of a population is a product over the tests. Each factor is the average
# of normal density / prior density over the draws of that test's posterior. Its error
# grows with the number of pooled parameters: an ESS of a few hundred per test at least;
# `draws=4_000` uses more of them. `pytest -m slow tests/extensions/population/test_normal.py`
# compares it with quadrature.

# %% tags=["remove-cell"]
truth = {"mean frame": frame.mean(), "mean soil": 1.0}
truth |= {"sd frame": SCATTER_FRAME, "sd soil": SCATTER_SOIL}
truth |= {"frame per temperature": SLOPE, "soil per temperature": 0.0}
for name, value in truth.items():
    drawn = pooled.hyperdraws[name]
    assert abs(drawn.mean() - value) < 3 * drawn.std(), name
alone = np.array([*soil_sd.values()])
together = pooled.theta.std(axis=0)[:, 1]
assert (together < 1.1 * alone).all() and together.mean() < 0.97 * alone.mean()
assert pooled.unreached == ()
assert np.quantile(hot["frame"], 0.975) < 0.97  # no test was so hot
assert "Population of 12 tests" in str(pooled)
