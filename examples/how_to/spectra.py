# %% [markdown]
# # Identify modes from a record of ambient vibration
#
# Turn accelerations under wind and traffic into frequencies, damping ratios and shapes
# *with* their uncertainties, ready for a posterior of your model.
# `python examples/how_to/spectra.py` runs this page (5 s).
#
# Wind, traffic and people shake a structure with forces that nobody measures. Near a
# spectral peak, or a close pair, the Fourier transform of such a record determines the
# mode, and its statistics are known exactly. Line by line it is an independent complex
# Gaussian vector. Its covariance follows from frequency, damping ratio, shape, the
# spectral density of the modal force and that of the noise (Whittle's likelihood; here
# Au's "fast Bayesian FFT"). There is no model order and no stabilisation diagram.
#
# ## The record
#
# Three floors are under wind for 600 periods of their first mode, simulated, so the
# truth is known:

# %%
import matplotlib.pyplot as plt
import numpy as np
from scipy import signal

import emcee_femu as ef

F, ZETA = np.array([1.0, 2.8, 4.05]), np.array([0.01, 0.012, 0.015])
SHAPES = np.array(
    [[0.328, 0.737, 0.591], [0.591, 0.328, -0.737], [0.737, -0.591, 0.328]]
)
RATE, DURATION = 20.0, 600.0  # samples per second, s
FORCE, NOISE = 1e-4, 1e-5  # one-sided densities, (m/s^2)^2 / Hz


def record(seed):  # accelerations of the floors, (samples, 3)
    rng = np.random.default_rng(seed)
    n, run_in = round(RATE * DURATION), 2_000
    sd = np.sqrt(np.array([FORCE, NOISE]) * RATE / 2)  # of one sample
    modes = []
    for w, zeta in zip(2 * np.pi * F, ZETA, strict=True):
        own = ([1.0, 0.0, 0.0], [1.0, 2 * zeta * w, w * w])
        b, a, _ = signal.cont2discrete(own, 1 / RATE)
        force = sd[0] * rng.standard_normal(n + run_in)
        modes.append(signal.lfilter(b.ravel(), a, force)[run_in:])
    noise = sd[1] * rng.standard_normal((n, 3))
    return np.transpose(modes) @ SHAPES.T + noise


accelerations = record(seed=7)

# %% [markdown]
# Read the bands off a plot of the spectra; six half widths of the peak to either side
# are a good choice.

# %% mystnb={"image": {"alt": "Spectral densities of three floors over frequency: three peaks at 1, 2.8 and 4 Hz, each inside a shaded band"}}
WIDTHS = 6 * ZETA * F
BANDS = np.transpose([F - WIDTHS, F + WIDTHS])
lines, densities = signal.welch(accelerations, RATE, nperseg=2048, axis=0)
figure, axes = plt.subplots(figsize=(7, 3), layout="constrained")
axes.semilogy(lines, densities, label=["first", "second", "roof"])
for band in BANDS:
    axes.axvspan(*band, color="0.9")
axes.set(
    title="spectral density",
    xlim=(0.5, 5),
    xlabel="frequency (Hz)",
    ylabel="(m/s²)² / Hz",
)
legend = axes.legend(frameon=False, loc="upper right")

# %% [markdown]
# ## One mode in one band
#
# - **`Spectra.from_record(record, rate, band)`** transforms accelerations `(samples,
#   channels)` and keeps the lines of a band. Velocities and displacements too:
#   `kind="velocity"`. `averages=8` cuts the record into segments first; spectral matrices
#   from elsewhere are `Spectra(lines, matrices, averages=8)`. Densities are one-sided, per
#   Hz.
# - **`SpectrumModel(spectra)`** is one mode with the parameters `f`, `zeta`, `ln_S`
#   (the logarithm of the force's density), `ln_S_e` (of the noise) and `phi_<sensor>`:
#   the shape, with 1 at the `reference` sensor. `SpectrumModel(spectra, 2)` is a close
#   pair: `f1`, `f2` and so on, and the coherence of the two forces, `coherence_re` and
#   `coherence_im`. `model.ranges` has wide ranges of all parameters for a prior, from
#   the level of the spectra.
# - **`SpectrumTerm(spectra)`** is the likelihood, in closed form for all walkers at once,
#   with derivatives for `"auto"`.


# %%
def identify(accelerations, band, seed):
    spectra = ef.spectra.Spectra.from_record(
        accelerations, RATE, band, sensors=["first", "second", "roof"]
    )
    model = ef.spectra.SpectrumModel(spectra)
    prior = ef.IndependentPrior(dict(model.ranges))
    posterior = ef.LogPosterior(model, ef.spectra.SpectrumTerm(spectra), prior)
    return ef.to_inference_data(ef.run(posterior, steps=100, ensembles=1, seed=seed))


found = {
    f"{f:g} Hz": identify(accelerations, b, 7) for f, b in zip(F, BANDS, strict=True)
}
ef.parameter_table(found["1 Hz"])

# %% [markdown]
# The run is short, for this page. {py:func}`~emcee_femu.spectra.modes_from_spectra`
# makes {py:class}`~emcee_femu.Measurements` from one or more bands: frequencies with
# their standard deviations (the covariance for a pair), `damping` and `damping_sd`,
# shapes and `shape_sd`. Use them in {py:class}`~emcee_femu.FrequencyTerm`,
# {py:class}`~emcee_femu.ShapeTerm` and {py:class}`~emcee_femu.PairedModel` like any
# others.

# %%
modes = ef.spectra.modes_from_spectra(found)
modes

# %% [markdown]
# ## How long must a record be?
#
# For a long record of $N_c$ periods, a band of $f (1 \pm \kappa \zeta)$ and little
# noise, Au's formulas (2014, Mech. Syst. Signal Process. 48, 15-33) give the squared
# coefficients of variation of $f$ and $\zeta$,
#
# $$ \frac{\zeta}{2 \pi N_c B_f}, \qquad \frac{1}{2 \pi \zeta N_c B_\zeta}, $$
#
# $$ B_f = \frac{2}{\pi} \Big( \tan^{-1} \kappa - \frac{\kappa}{\kappa^2 + 1} \Big), \quad
#    B_\zeta = \frac{2}{\pi} \Big( \tan^{-1} \kappa + \frac{\kappa}{\kappa^2 + 1}
#    - \frac{2}{\kappa} (\tan^{-1} \kappa)^2 \Big). $$


# %%
def laws(zeta, periods, kappa=6.0):
    angle, part = np.arctan(kappa), kappa / (kappa**2 + 1)
    b_f = 2 / np.pi * (angle - part)
    b_zeta = 2 / np.pi * (angle + part - 2 * angle**2 / kappa)
    return (
        np.sqrt(zeta / (2 * np.pi * periods * b_f)),
        np.sqrt(1 / (2 * np.pi * zeta * periods * b_zeta)),
    )


for periods in (1_000, 10_000):
    by_f, by_zeta = laws(0.01, periods)
    print(f"{periods} periods: f to {by_f:.2%}, zeta to {by_zeta:.1%}")

# %% [markdown]
# These are for 1 % damping. A damping ratio to 5 % needs more than 10,000 periods. The
# Fisher information of the term agrees with both formulas within 0.5 %
# (`tests/likelihoods/test_spectrum_term.py`), for three channels even if the noise is
# inferred. A single channel separates noise from the flanks of the peak less well, and
# is a little less certain than the formulas.
#
# Stochastic subspaces ({doc}`ambient_vibration`) use the whole range of frequencies and
# assume white forces over all of it; a band does not. Spectra add a posterior, with
# shapes and without a model order to choose.
#
# ## What it cannot do
#
# - Another mode in the band that is not in the model raises the flanks: end the band
#   where the next peak begins to show. More than two modes per band are refused.
# - Lines are independent, and peaks not smeared, only if a mode is wide compared with
#   their distance: $2 \zeta f$ must be several times 1 / duration, of one segment.
#   Short segments make damping too high: one long segment is best.
# - If frequencies drift (temperature), the peak of a long record is wider than the
#   mode. Treat each hour as a test, and pool them as [many
#   tests](../tutorials/many_tests.py) does.
# - The force must be flat over the band, and the noise alike in all channels.
# - The modes of a pair are in ascending order; if the posterior does not separate `f1`
#   from `f2`, their means mix both modes.

# %% tags=["remove-cell"]
assert np.abs((modes.frequencies - F) / modes.sd).max() < 3.5
assert np.abs((modes.damping - ZETA) / modes.damping_sd).max() < 3.5
assert laws(0.01, 10_000)[1] > 0.05
