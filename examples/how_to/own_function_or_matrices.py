# %% [markdown]
# # Choose between a function and matrices
#
# You will give one structure to the sampler in two ways: as a Python function that solves
# one parameter set at a time, where any solver can stand, and as matrices, which are
# solved for all walkers at once. Both give the same chain.
# `python examples/how_to/own_function_or_matrices.py` runs this page (4 s).
#
# A cantilever of length L and mass μ per length has the bending frequencies
#
# $$ f_j = \frac{b_j^2}{2 \pi L^2} \sqrt{\frac{EI}{\mu}}, \qquad
#    b = 1.8751,\ 4.6941,\ 7.8548. $$
#
# At its tip sits an unknown point mass m. Three measured frequencies shall tell EI and m.

# %%
import numpy as np
from scipy import stats
from scipy.linalg import eigh

import emcee_femu as ef

LENGTH, ELEMENTS, MU = 1.2, 8, 0.81  # m, -, kg/m
MEASURED = [9.62, 66.1, 192.5]  # Hz
h = LENGTH / ELEMENTS

# %% [markdown]
# The matrices of a beam element, displacement and rotation at both ends, and their sum
# over the elements, clamped at the first node:

# %%
stiffness = (
    np.array(  # for EI = 1 N m2
        [
            [12, 6 * h, -12, 6 * h],
            [6 * h, 4 * h**2, -6 * h, 2 * h**2],
            [-12, -6 * h, 12, -6 * h],
            [6 * h, 2 * h**2, -6 * h, 4 * h**2],
        ]
    )
    / h**3
)
mass = (
    MU
    * h
    / 420
    * np.array(
        [
            [156, 22 * h, 54, -13 * h],
            [22 * h, 4 * h**2, 13 * h, -3 * h**2],
            [54, 13 * h, 156, -22 * h],
            [-13 * h, -3 * h**2, -22 * h, 4 * h**2],
        ]
    )
)
K1, M0 = np.zeros((2, 2 * ELEMENTS + 2, 2 * ELEMENTS + 2))
for e in range(ELEMENTS):
    own = slice(2 * e, 2 * e + 4)
    K1[own, own] += stiffness
    M0[own, own] += mass
K1, M0 = K1[2:, 2:], M0[2:, 2:]
M1 = np.zeros_like(M0)
M1[-2, -2] = 1.0  # the tip's displacement carries the point mass

# %% [markdown]
# ## As a function
#
# The function gets `{name: float}` and returns frequencies in Hz. Put the call of your own
# program in its place; a program that is started for each solve is a case of its own
# ({doc}`black_box`), with failures and time limits ({doc}`failing_solves`).


# %%
def solver(parameters):
    K, M = parameters["EI"] * K1, M0 + parameters["m"] * M1
    omega_squared = eigh(K, M, eigvals_only=True, subset_by_index=(0, 2))
    return np.sqrt(omega_squared) / (2 * np.pi)


function = ef.FunctionModel(solver)

# %% [markdown]
# ## As matrices
#
# $K = EI\,K_1$ and $M = M_0 + m\,M_1$: whatever is affine in the parameters. There are
# derivatives, all walkers are one batch, and matrices of other programs come from files
# ({doc}`matrices`) or from a script ({doc}`opensees`, {doc}`pynite`, {doc}`scikit_fem`).

# %%
matrices = ef.MatrixModel(
    np.zeros_like(K1),
    M0,
    {"EI": K1},
    {"m": M1},
    n_modes=3,
)

# %% [markdown]
# ## The same chain

# %%
prior = ef.IndependentPrior(
    {"EI": stats.lognorm(0.3, scale=700.0), "m": stats.uniform(0.0, 0.5)}
)
term = ef.FrequencyTerm(MEASURED, relative_sd=0.01)
chains = {}
for name, model in {"function": function, "matrices": matrices}.items():
    posterior = ef.LogPosterior(model, term, prior)
    samplers = ef.run(posterior, nwalkers=16, nsteps=500, seed=7)
    chains[name] = samplers[0].get_chain()
gap = np.abs(chains["function"] / chains["matrices"] - 1).max()
print(f"largest relative difference of the two chains: {gap:g}")

# %% [markdown]
# The chains are short, for this page; a study takes some thousand generations and more than
# one ensemble, or `"auto"`. The table is that of the matrices:

# %%
idata = ef.to_inference_data(samplers, posterior, discard=100)
ef.parameter_table(idata)

# %%
ef.frequency_table(idata, posterior)

# %% tags=["remove-cell"]
assert gap < 1e-6
bare = matrices({"EI": np.array([700.0]), "m": np.array([0.0])}).frequencies[0]
b = np.array([1.8751, 4.6941, 7.8548])
closed = b**2 / (2 * np.pi * LENGTH**2) * np.sqrt(700.0 / MU)
np.testing.assert_allclose(bare, closed, rtol=1e-3)
assert max(ef.parameter_table(idata).column("sd/prior sd")) < 0.15
