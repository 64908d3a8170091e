# %% [markdown]
# # Emulate modes that cross
#
# For those who emulate a slow model whose modes may cross: return the mode shapes,
# declare them, and return a closed set of modes; `emulate` does the rest. This page
# shows why, and what it gains. `python examples/how_to/emulated_crossing_modes.py`
# runs the page on made-up data.
#
# ## The kink
#
# `emulate` learns neither the likelihood nor the frequencies, but numbers that stay
# smooth as the parameters change. Sorted eigenvalues are not smooth where two modes
# meet: each has a kink there. A Gaussian process through a kink is wrong near it and
# does not know it. The simplest case is a beam of nearly square section: its bending
# modes in the two planes cross, or nearly so, where width and height are equal. Both
# are unknown, as fractions of their nominal values; a small coupling keeps the modes
# apart.

# %% tags=["result"] mystnb={"image": {"alt": "The two lowest frequencies over the height: one rises, one is level, and where height and width are equal each takes the place of the other in a sharp bend"}}
import matplotlib.pyplot as plt
import numpy as np

import emcee_femu as ef


def solve(p):
    up, across = 100 * p["height"] ** 2, 100 * p["width"] ** 2
    K = np.array([[up, 2.0, 0.0], [2.0, across, 2.0], [0.0, 2.0, 300.0]])
    eigenvalues, shapes = np.linalg.eigh(K)
    return ef.ModalSolution(np.sqrt(eigenvalues) / (2 * np.pi), shapes)


heights = np.linspace(0.8, 1.2, 200)
points = [{"height": h, "width": 1.0} for h in heights]
curves = np.array([solve(p).frequencies[:2] for p in points])
figure, axes = plt.subplots(figsize=(5, 3), layout="constrained")
axes.plot(heights, curves, label=["mode 1", "mode 2"])
axes.set(xlabel="height, nominal 1 (width nominal)", ylabel="frequency [Hz]")
_ = axes.legend(loc="upper left")

# %% [markdown]
# So modes that cross or nearly meet are emulated together:
#
# | what the model returns | what is emulated, in units of measurement error |
# |---|---|
# | frequencies | eigenvalues; of two or three that meet their mean and central moments, which do not mind the order |
# | frequencies and shapes | the entries of A = Q^T Lambda Q and the shapes Phi Q, where Q turns the modes onto reference shapes |
# | any other real variable | its numbers as they are |
#
# Each fit chooses which modes go together, and whether positive parameters and
# eigenvalues are seen by their logarithms, by leaving out each solved point in turn.
#
# ## The model with its shapes
#
# Two frequencies were measured and no shapes. The model still returns its shapes,
# because they identify the modes. `FunctionModel(solve, n_modes=3)` would not declare
# them, and `emulate` would not use them; so declare them, with the names of their DOFs.
# (A `MatrixModel` or a `PairedModel` with shapes does so by itself.) The model returns
# all three modes: a mode that crosses one that is not returned keeps its kink.

# %%
limits = [(0.7, 1.3)] * 2
prior = ef.GaussianPrior(["height", "width"], [1.0, 0.98], [0.07, 0.07], limits)
term = ef.FrequencyTerm([1.56, 1.63], relative_sd=0.01)
modes = ef.modal_variables(3, dofs=["x", "y", "z"])
posterior = ef.LogPosterior(ef.FunctionModel(solve, variables=modes), term, prior)
emulated = ef.emulate(posterior, solves=16, seed=1, tolerance=0)
emulated

# %% [markdown]
# ## Without them
#
# For comparison, here are the same numbers as a plain variable under another name,
# which `emulate` takes as they are, kinks included:


# %%
class SortedTerm:
    """The same Gaussian errors, of numbers that are not known to be frequencies."""

    reads = {"sorted": ef.Variable({"mode": [1, 2]}, "Hz")}

    def deviations(self, parameters, response):
        r = response["sorted"] / np.array([1.56, 1.63]) - 1
        return r, np.full(r.shape, 0.01)

    def __call__(self, parameters, response):
        r, sd = self.deviations(parameters, response)
        return -0.5 * ((r / sd) ** 2).sum(axis=1)


lowest = ef.FunctionModel(
    lambda p: solve(p).frequencies[:2], variables=SortedTerm.reads
)
plain = ef.LogPosterior(lowest, SortedTerm(), prior)
as_numbers = ef.emulate(plain, solves=16, seed=1, tolerance=0)

# %% [markdown]
# Both are compared at draws of the true posterior, none of which they have solved:

# %%
(chain,) = ef.run(posterior, steps=100, seed=2, ensembles=1)
columns = chain.get_chain(flat=True, thin=5).T
draws = dict(zip(prior.names, columns, strict=True))
true = posterior.model(draws)["frequency"][:, :2]
found = {
    "sorted numbers": as_numbers(draws)["sorted"],
    "frequencies and shapes": emulated(draws).frequencies[:, :2],
}
errors = {name: (f / true - 1) / 0.01 for name, f in found.items()}
rms = [np.sqrt((error**2).mean()) for error in errors.values()]
for name, error in zip(errors, rms, strict=True):
    print(f"{name}: {error:.2g} measurement errors (rms)")

# %% [markdown]
# Predictions are always real and in ascending order. Pairing with measured modes comes
# after them, so order and pairs are those of a full solve.
#
# ## Which modes to return
#
# **More modes help only if the set is then closed.** If the last mode crosses the next
# one, which is not returned, it has a kink that nothing smooths. For the paper's H
# structure seven modes were as good as nine. Eight were worse, because the last ones
# cross modes that are not returned (`examples/benchmarks/few_solves.py` has it).
#
# {doc}`/explanation/few_solves_measured` has whole problems.

# %% tags=["remove-cell"]
assert emulated.solves == as_numbers.solves == 16
assert rms[1] < 0.01 and rms[0] > 10 * rms[1]
