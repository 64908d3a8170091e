# %% [markdown]
# # Update from frequency response functions
#
# For those who have frequency response functions (FRFs) and want to compare them with
# a model line by line, without identifying modes first, with the damping inferred.
# `python examples/how_to/frf.py` runs the page.
#
# A hammer or shaker test gives FRFs: response over force. Here a simulated three-storey
# frame is excited at the roof and measured at the roof and the first floor.
#
# ## The model
#
# {py:class}`~emcee_femu.frf.FRFModel` superposes the modes of any model that returns
# mass-normalised shapes: `MatrixModel(..., shapes=True)`, its reduction, a
# {py:class}`~emcee_femu.FrameModel`.
#
# ## Damping
#
# It is a ratio, or the name of a parameter, or one of these per mode, or
# `{"mass": "a", "stiffness": "b"}` for proportional damping.

# %%
import numpy as np

import emcee_femu as ef

STOREYS = {"k1": (0, 1, 2e6), "k2": (1, 2, 2e6), "k3": (2, 3, 2e6)}  # N/m
FLOORS = {"first": 0, "second": 1, "roof": 2}  # of 1 t
LINES = np.linspace(1.0, 16.0, 300)  # Hz
CHANNELS = [("roof", "roof"), ("first", "roof")]  # response, excitation

modal = ef.MassSpringModel([1e3, 1e3, 1e3], STOREYS, shapes=FLOORS)
model = ef.frf.FRFModel(modal, LINES, CHANNELS, damping="damping", kind="accelerance")

# %% [markdown]
# Modes that are left out add a constant flexibility below their frequencies; with
# `residual=True` a `MatrixModel` adds it exactly. All walkers are one batch, with
# derivatives.
#
# ## FRFs
#
# {py:class}`~emcee_femu.frf.FRFMeasurements` holds receptance (displacement over
# force), mobility (velocity) or accelerance (acceleration), each channel a pair
# (response DOF, excitation DOF). `FRFMeasurements.from_uff("test.uff", averages=20)`
# reads data sets 58 of universal files, text or binary, with the coherence;
# `between=(low, high)` takes a part of the lines, and `kind="mobility"` says what a
# file leaves open (analysers may write the type of the ordinate as unknown). A line at
# 0 Hz, where analysers begin, is left out with a warning, and values come in SI. A
# channel such as `("2:-ux", "7:uz")` is measured against an axis: its sign is turned.
# `nodes={12: 3}` names channels by the DOFs of the model, `"3:uz"`, and `axes="own"` turns
# sensors along a node's own axes ({doc}`csv_and_uff`); then ask the model for
# `shapes=measured.dofs`.
# Here a test of 20 averages is simulated:

# %%
truth = {"k1": 2.2e6, "k2": 1.9e6, "k3": 2.0e6, "damping": 0.012}
true = model({name: np.array([value]) for name, value in truth.items()})
H = true["accelerance"][0] @ [1, 1j]
rng = np.random.default_rng(1)
coherence = np.abs(H) ** 2 / (np.abs(H) ** 2 + 2e-4**2)
noise = rng.standard_normal((2, *H.shape)) * np.sqrt((1 / coherence - 1) / 40)
H = H + np.abs(H) * (noise[0] + 1j * noise[1])
options = {"kind": "accelerance", "coherence": coherence, "averages": 20}
measured = ef.frf.FRFMeasurements(LINES, H, CHANNELS, **options)

# %% [markdown]
# The error follows from the coherence c and the number of averages n: the real and the
# imaginary part have the standard deviation $|H| \sqrt{(1 - c) / (2 n c)}$. Receptance
# against accelerance, or mm/N against m/N, raises an error before the first solve.
#
# ## The posterior
#
# {py:class}`~emcee_femu.frf.FRFTerm` compares real and imaginary parts, or by
# `amplitude=True` the logarithm of the amplitude. `discrepancy="name"` infers what the
# model cannot represent, relative to the amplitude.

# %%
bounds = [(1e6, 3e6)] * 3 + [(0.001, 0.1)]
sd = [3e5, 3e5, 3e5, 0.01]
prior = ef.GaussianPrior([*truth], [2e6, 2e6, 2e6, 0.02], sd, bounds)
posterior = ef.LogPosterior(model, ef.frf.FRFTerm(measured), prior)
run = ef.run(posterior, seed=1)
idata = ef.to_inference_data(run)
ef.parameter_table(idata, true=truth)

# %% tags=["result"] mystnb={"image": {"alt": "Amplitudes of two measured FRFs with the band that the model predicts"}}
ef.frf.plot_frf(idata, posterior)

# %% [markdown]
# Most information is in the lines at the resonances: their place determines the
# stiffness and their width the damping.
#
# FRFs are large, so they are not stored with each sample, but natural frequencies and
# damping ratios are. `stored=True` stores all.
#
# **Limits.** Damping is modal, with real shapes: nonproportional damping needs complex
# modes, which the package does not have. Coherence does not show leakage, nor errors
# that all lines share ({doc}`/explanation/likelihoods`): use `discrepancy`.

# %% tags=["remove-cell"]
assert ef.diagnose(run).converged
for name, value in truth.items():
    draws = idata.posterior[name].values
    assert abs(draws.mean() - value) < 4 * draws.std(), name
    assert draws.std() < 0.01 * value
