# %% [markdown]
# # Close and crossing modes
#
# For everybody whose modes lie close together or may change their order: measured and
# computed frequencies must not be compared by their numbers. This page shows why, and
# how {py:class}`~emcee_femu.PairedModel` compares them by shape, even where shapes
# mix. `python examples/tutorials/crossing_modes.py` runs the page. The test is
# simulated.
#
# A two-storey building sways along x and along y: four modes, two of them near 3 Hz.
# According to the drawings it is 20 % stiffer along x. In truth the walls along x have
# cracked and keep 75 % of their stiffness; along y it has 105 %. So **x comes second in
# the model and first in the test**. Units: MN, kt, m.

# %%
import numpy as np
from scipy import stats

import emcee_femu as ef

FLOOR, STOREY = 0.02, 20.0  # kt, MN/m
ONE_WAY = STOREY * np.array([[2.0, -1.0], [-1.0, 1.0]])
ALONG_X, ALONG_Y = np.diag([1.2, 0.0]), np.diag([0.0, 1.0])
K = {"kx": np.kron(ALONG_X, ONE_WAY), "ky": np.kron(ALONG_Y, ONE_WAY)}
dofs = {"1x": 0, "2x": 1, "1y": 2, "2y": 3}
M, NOTHING = FLOOR * np.eye(4), np.zeros((4, 4))

model = ef.MatrixModel(NOTHING, M, K, n_modes=4, shapes=dofs)
prior = ef.IndependentPrior(dict.fromkeys(K, stats.lognorm(0.15)))
truth = {"kx": 0.75, "ky": 1.05}


def simulate(model, truth, scatter, seed):
    """Frequencies with scatter, shapes of length one to 0.03 at a sensor."""
    modes = model({name: np.array([x]) for name, x in truth.items()})
    rng = np.random.default_rng(seed)
    f = modes.frequencies[0] * (1 + scatter * rng.normal(size=4))
    shapes = modes.shapes[0] / np.linalg.norm(modes.shapes[0], axis=0)
    shapes += 0.03 * rng.normal(size=shapes.shape)
    order = np.argsort(f)
    f, shapes = f[order].round(3), shapes[:, order]
    return ef.Measurements(f, sd=scatter * f, shapes=shapes, dofs=list(dofs))


test = simulate(model, truth, scatter=0.007, seed=1)
print(test)

# %% [markdown]
# ## By number: a wrong posterior
#
# A {py:class}`~emcee_femu.FrequencyTerm` alone compares the i-th measured frequency
# with the i-th of the model.

# %%
term = ef.FrequencyTerm(test)
by_number = ef.LogPosterior(model, term, prior)
run = ef.run(by_number, seed=1)
wrong = ef.to_inference_data(run)
print(ef.diagnose(run).short)
ef.parameter_table(wrong, true=truth)

# %% tags=["result"] mystnb={"image": {"alt": "Samples of kx and ky in two separate clouds; the truth is in the smaller one"}}
ef.figures.plot_scatter(wrong, truths=truth)

# %% [markdown]
# There are two clouds, and both fit equally well: frequencies alone cannot tell x from
# y. The prior prefers the cloud nearer to the drawings, which spreads the damage over
# both directions; the truth (blue) is in the smaller one. No diagnosis detects a wrong
# comparison that fits.
#
# ## By shape: MAC, one to one
#
# The modal assurance criterion of two shapes is the squared cosine of the angle between
# them,
#
# $$\mathrm{MAC}(\phi, \psi) =
# \frac{(\phi^T \psi)^2}{(\phi^T \phi)\,(\psi^T \psi)},$$
#
# which is 1 for the same shape at any scale and sign, and 0 for orthogonal shapes. The
# measured modes (rows) and those of the nominal model (columns):

# %%
nominal = model({name: np.ones(1) for name in K}).shapes[0]
nominal = nominal / np.linalg.norm(nominal, axis=0)
measured = test.shapes / np.linalg.norm(test.shapes, axis=0)
print(((measured.T @ nominal) ** 2).round(2))

# %% [markdown]
# The first measured mode is the model's second. `PairedModel` makes this choice anew
# for each parameter set. Out of `candidates` modes (by default twice as many as were
# measured) each measured mode gets one, so that the sum of all MAC is largest. Shapes
# may enter the likelihood too, with a {py:class}`~emcee_femu.ShapeTerm`; pairing does
# not need it.

# %%
paired = ef.PairedModel(model, test, candidates=4)
terms = [term, ef.ShapeTerm(test, delta=0.03)]
by_shape = ef.LogPosterior(paired, terms, prior)
run = ef.run(by_shape, seed=1)
right = ef.to_inference_data(run)
print(ef.diagnose(run).short)
ef.parameter_table(right, true=truth)

# %%
ef.pairing_table(right)

# %% [markdown]
# There is one cloud, with the truth in it. The table shows how each measured mode was
# paired ({doc}`/start/reading` has its columns).
#
# A mode that the model does not have shows up as a MAC below 0.5 in all samples. It
# costs a finite penalty of log-likelihood (8), so the chain continues and you see it.
#
# ## Close modes
#
# Two modes of nearly the same frequency can rotate in the plane that they span: a small
# asymmetry decides their direction. Suppose that both directions are equally stiff, and
# that a light brace across the plan, which the model does not have, ties x to y.

# %%
SQUARE = {"kx": np.kron(np.diag([1.0, 0.0]), ONE_WAY), "ky": K["ky"]}
brace = 0.004 * np.kron(np.ones((2, 2)), ONE_WAY)
square = ef.MatrixModel(NOTHING, M, SQUARE, n_modes=4, shapes=dofs)
braced = ef.MatrixModel(brace, M, SQUARE, n_modes=4, shapes=dofs)
equal = {"kx": 1.0, "ky": 1.0}
mixed = simulate(braced, equal, scatter=0.002, seed=3)
print(mixed)
print((mixed.shapes / np.abs(mixed.shapes).max(axis=0)).round(2))

# %% [markdown]
# The measured modes sway along the diagonals, the model's along x and y. Mode by mode
# the MAC is between 0.5 and 0.6, whatever the parameters. But the two modes span the
# same plane. Below a relative distance of `min_gap` (2 %), `PairedModel` therefore
# compares a measured shape with its projection on the plane of both modes: the
# **subspace MAC**. It fades between 1 % and 2 % (2 % to 4 % of kx), so that nothing
# jumps:

# %%
along = {"kx": np.array([0.92, 1.0, 1.08]), "ky": np.ones(3)}
models, mac = {}, {}
for gap in (0.0, 0.02):
    models[gap] = ef.PairedModel(square, mixed, candidates=4, min_gap=gap)
    mac[gap] = models[gap](along).mac[:, 0]
    print(f"min_gap={gap}: MAC {mac[gap].round(2)} at kx = 0.92, 1 and 1.08")

# %% [markdown]
# With an inferred shape error, `ShapeTerm(mixed, discrepancy="shape error")`, the
# mode-by-mode posterior infers errors of some 0.4 at each sensor, and reports modes
# that the model does not have. With the subspace MAC both are gone:

# %%
priors = dict.fromkeys(K, stats.lognorm(0.15))
priors["shape error"] = stats.halfnorm(scale=0.3)
terms = [ef.FrequencyTerm(mixed), ef.ShapeTerm(mixed, discrepancy="shape error")]
posterior = ef.LogPosterior(models[0.02], terms, ef.IndependentPrior(priors))
plane = ef.to_inference_data(ef.run(posterior, seed=1))
ef.parameter_table(plane)

# %%
ef.pairing_table(plane)

# %% [markdown]
# The two modes still change places in many samples: within their plane the order has no
# meaning.
#
# If no shapes were measured, `PairedModel(model, frequencies, reference={...})` follows the
# model's own ({doc}`real_aircraft`), if test and model have the same order there. The
# paper compares by number: [what that means for its H](../explanation/paper.py).

# %% tags=["remove-cell"]
wrong_kx, wrong_ky = (wrong["posterior"][name].values.ravel() for name in truth)
assert 0.6 < (wrong_kx > 0.81).mean() < 0.9  # most samples are in the wrong cloud
between = np.abs(wrong_kx - 0.81) < 0.01
assert between.mean() < 0.02  # where hardly a sample is
for name, value in truth.items():
    x = right["posterior"][name].values
    assert abs(x.mean() - value) < 3 * x.std() and x.std() < 0.02
assert "in 0 %" in ef.pairing_table(right).title
assert mac[0.0].max() < 0.7 and mac[0.02][1] > 0.98
assert np.abs(mac[0.02] - mac[0.0])[[0, -1]].max() < 1e-12
assert plane["posterior"]["shape error"].values.mean() < 0.06
assert 5 < ef.pairing_table(plane).column("another in %")[0] < 50
