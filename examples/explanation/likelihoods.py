# %% [markdown]
# # The likelihoods
#
# This page says what each term computes, what it assumes, and which setting decides how
# narrow your posterior becomes. It checks each formula against `scipy.stats`.
# `python examples/explanation/likelihoods.py` runs it.
#
# A term maps the model's response to a log-likelihood, the logarithm of the density of
# what was measured, with the scale of the errors and their normalising constants. These
# do not matter as long as all errors are given. They matter as soon as an error is
# inferred, and when [model classes](../tutorials/model_classes.py) are compared by
# their evidence.

# %%
import numpy as np
from scipy import stats

import emcee_femu as ef

checked = []


def show(name, ours, scipy):
    checked.append((np.sum(ours), np.sum(scipy)))
    print("{:11}  {:.6f}   scipy {:.6f}".format(name, *checked[-1]))


# %% [markdown]
# ## Natural frequencies
#
# {py:class}`~emcee_femu.FrequencyTerm` is Eq. 2.2 of the paper: relative errors,
# independent and Gaussian, with precision $\beta$,
#
# $$ p(f^m \mid \theta) = \prod_{i=1}^{m} \sqrt{\frac{\beta_i}{2 \pi}}
#    \frac{1}{f_i^m} \exp\Big(-\frac{\beta_i}{2} r_i^2\Big), \qquad
#    r_i = \frac{f_i(\theta) - f_i^m}{f_i^m}. $$
#
# So $\beta_i^{-1/2}$ is the relative standard deviation of mode $i$: the paper's
# $\beta = 10$ means 32 %, and 1 % is $\beta = 10^4$. Give it as `relative_sd`, as `sd`
# in Hz, as `beta`, or as the `covariance` of the measured frequencies in Hz².
#
# A factor of two is easily lost here. Many papers compare eigenvalues,
# $f^2 / (f^m)^2 - 1$, whose deviations are about $2 r$: their 2 % is 1 % here.

# %%
measured = np.array([3.13, 9.83])
predicted = np.array([[3.10, 9.95]])  # of one parameter set
response = {"frequency": predicted}
by_beta = ef.FrequencyTerm(measured, beta=1e4)({}, response)
by_scipy = stats.norm.logpdf(predicted, measured, 0.01 * measured).sum()

C = np.diag(0.01 * measured) @ [[1, 0.8], [0.8, 1]] @ np.diag(0.01 * measured)
correlated = ef.FrequencyTerm(measured, covariance=C)({}, response)
correlated_by_scipy = stats.multivariate_normal.logpdf(predicted, measured, C)
show("independent", by_beta, by_scipy)
show("correlated", correlated, correlated_by_scipy)

# %% [markdown]
# Repeated tests scatter together. With a correlation of 0.8, two deviations of opposite
# sign are much less likely than if they were independent. Give the covariance of *one*
# test: errors that all tests share do not shrink with their number.
#
# **Assumed:** errors are small against the frequencies and Gaussian, and the compared
# modes are the same. {py:class}`~emcee_femu.PairedModel` ensures the second. If it
# finds no partner, 8 is subtracted from the log-likelihood, the cost of four standard
# deviations.
#
# ## What the model cannot represent
#
# Tests often scatter by 0.2 % while a good model is off by 1 or 2 % ([noise and model
# error](../tutorials/noise_and_model_error.py)). `discrepancy="error"` adds a relative
# standard deviation $\sigma_d$ that is a parameter with a prior of its own:
#
# $$ \ln p = -\tfrac12 r^T (R + \sigma_d^2 I)^{-1} r
#    - \tfrac12 \ln \det 2 \pi (R + \sigma_d^2 I) - \sum_i \ln f_i^m , $$
#
# with $R$ the covariance of the relative measurement errors. The determinant keeps
# $\sigma_d$ from growing. The prior must be proper: if $R = 0$, the usual improper prior
# of a scale, $1/\sigma_d$, has an infinite integral if some parameters make all residuals
# zero at once, which is usual unless there are more residuals than parameters.

# %%
term = ef.FrequencyTerm(measured, relative_sd=0.002, discrepancy="error")
sigma = np.array([0.01])
value = term({"error": sigma}, response)
scale = np.hypot(0.002, sigma) * measured
show("discrepancy", value, stats.norm.logpdf(predicted, measured, scale))

# %% [markdown]
# ## Mode shapes
#
# Scale and sign of a measured shape are arbitrary, so
# {py:class}`~emcee_femu.ShapeTerm` compares directions. By the modal assurance
# criterion, $\mathrm{MAC} = (\phi^T \phi^m)^2 / (\phi^T \phi \; {\phi^m}^T \phi^m)$,
#
# $$ \ln p = \sum_i \Big[ -\frac{1 - \mathrm{MAC}_i}{2 \delta^2}
#    - \frac{n_s - 1}{2} \ln 2 \pi \delta^2 \Big] . $$
#
# $\delta$ is the standard deviation of one sensor for a shape of unit length, and
# $n_s - 1$ the number of directions in which $n_s$ sensors can err. The power matters
# as soon as $\delta$ is inferred (`discrepancy="name"`): with $\delta^{-1}$ alone,
# which some authors use, the inferred $\delta$ would be about $\sqrt{n_s - 1}$ times
# too large. The term is a Gaussian of the part of the unit shape that is orthogonal to
# the measured one:

# %%
rng = np.random.default_rng(1)
phi_m = rng.standard_normal((8, 1))  # eight sensors, one mode
phi = phi_m + 0.1 * rng.standard_normal((8, 1))
unit, other = phi / np.linalg.norm(phi), phi_m / np.linalg.norm(phi_m)
across = (np.eye(8) - other @ other.T) @ unit  # seven directions
sine = np.linalg.norm(across)
by_mac = ef.ShapeTerm(phi_m, delta=0.05)({}, {"shapes": phi[None]})
show("by MAC", by_mac, stats.norm.logpdf([sine, 0, 0, 0, 0, 0, 0], scale=0.05))

# %% [markdown]
# If each sensor has its own standard deviation, `sd`, the model's shape is scaled by
# $\gamma$ to fit best and compared sensor by sensor:
#
# $$ \ln p = \sum_{i,s} \ln N(\phi^m_{si} - \gamma_i \phi_{si}; 0, \sigma_{si}^2),
#    \qquad \gamma_i = \frac{\sum_s \phi_{si}^m \phi_{si} / \sigma_{si}^2}
#    {\sum_s \phi_{si}^2 / \sigma_{si}^2} . $$
#
# A bad sensor then has little weight; by MAC it counts as much as the others.
#
# **Assumed:** sensors err independently. On a model that is wrong somewhere, dense
# arrays of sensors do not: their residuals are alike, and the posterior becomes too
# narrow. Use fewer sensors, or a larger $\delta$.

# %%
sd = np.full((8, 1), 0.05)
sd[3] = 1.0  # a bad sensor
by_sensor = ef.ShapeTerm(phi_m, sd=sd)({}, {"shapes": phi[None]})
gamma = (phi_m * phi / sd**2).sum() / (phi**2 / sd**2).sum()
show("by sensor", by_sensor, stats.norm.logpdf(phi_m, gamma * phi, sd))

# %% [markdown]
# ## Displacements
#
# {py:class}`~emcee_femu.DisplacementTerm` for static tests is the plain Gaussian
# $N(u - u^m; 0, \sigma^2 + (\sigma_d u^m)^2)$ over load cases and points, with the
# discrepancy relative to the measured displacement.

# %%
u_m, u = np.array([[0.5, 2.5]]), np.array([[[0.55, 2.6]]])
statics = ef.DisplacementTerm(u_m, sd=0.1)({}, {"displacement": u})
show("statics", statics, stats.norm.logpdf(u, u_m, 0.1))

# %% [markdown]
# ## Frequency response functions
#
# {py:class}`~emcee_femu.frf.FRFTerm` compares real and imaginary part, line by line,
#
# $$ \ln p = \sum_{c,l} \ln N(\mathrm{Re}\,\Delta_{cl}; 0, v_{cl})
#    + \ln N(\mathrm{Im}\,\Delta_{cl}; 0, v_{cl}), \qquad
#    v_{cl} = s_{cl}^2 + (\sigma_d |H^m_{cl}|)^2 , $$
#
# with $\Delta = H - H^m$ and, by coherence $\gamma^2$ and $n_d$ averages,
# $s = |H^m| \sqrt{(1 - \gamma^2) / (2 n_d \gamma^2)}$. `amplitude=True` compares
# $\ln |H|$ instead, for phases that are not trusted.
#
# **Assumed:** lines are independent (averaged FFTs without zero padding), and coherence
# shows all errors. It does not show the accelerometer's mass or a tilted hammer, which
# all lines share.
#
# The likelihood of complex FRFs is sharp where the resonances meet, and away from there
# it may rise in the wrong direction. So search by amplitudes, which lead there from
# everywhere, and sample with complex FRFs if phases are good.

# %%
lines = np.linspace(0.5, 1.8, 131)
one = ef.MassSpringModel([1.0], {"k": (0, 1, 40.0)}, shapes=True)
frf = ef.frf.FRFModel(one, lines, [(0, 0)], damping=0.02)
H = frf({"k": np.array([40.0])})
exact = frf({"k": np.array([39.5])})["receptance"][0] @ [1, 1j]
test = ef.frf.FRFMeasurements(lines, exact, [(0, 0)], kind="receptance")
s = 0.1 * np.abs(exact).max()  # noise that does not depend on the line
by_frf = ef.frf.FRFTerm(test, sd=s)({}, H)
r = H["receptance"][0] @ [1, 1j] - exact
show("FRF", by_frf, stats.norm.logpdf([r.real, r.imag], scale=s))

# %% [markdown]
# ## Several terms
#
# The log-likelihoods of several terms add. A test of many FRF lines or sensors then
# outweighs five frequencies by its sheer number, which is wrong if their errors share
# what the model cannot represent. A discrepancy for each term is the remedy.
#
# Sources: the paper's Eq. 2.2; Vanik, Beck and Au (2000),
# [doi:10.1061/(ASCE)0733-9399(2000)126:7(738)](https://doi.org/10.1061/(ASCE)0733-9399(2000)126:7(738));
# Simoen, De Roeck and Lombaert (2015),
# [doi:10.1016/j.ymssp.2014.11.001](https://doi.org/10.1016/j.ymssp.2014.11.001); Bendat
# and Piersol, Random Data (2010).

# %% tags=["remove-cell"]
for ours, scipy in checked:
    np.testing.assert_allclose(ours, scipy, rtol=1e-8)
assert correlated[0] < by_beta[0]
