# %% [markdown]
# # Update a PyNite model
#
# For those who build their model in PyNite: take K and M from it, and update it
# without PyNite in the loop. `python examples/how_to/pynite.py` runs the page;
# it takes `pip install PyNiteFEA`.
#
# A steel platform on four columns carries a pump on one of its long beams. It is
# updated from five measured frequencies (simulated here), with three factors: on the
# stiffness of the columns, of the long beams and of the short beams. PyNite assembles
# its matrices for four parameter sets, and the sampler works with these.
# {py:func}`~emcee_femu.from_pynite` reads K, M and the name of every row from an
# analysed PyNite model.

# %%
import numpy as np

import emcee_femu as ef

TRUTH = {"columns": 0.85, "long beams": 1.1, "short beams": 0.8}
N_MODES, NOISE = 5, 0.005  # relative sd of a measured frequency
LENGTH, WIDTH, HEIGHT = 5.0, 3.0, 3.5  # m
E, G, WEIGHT, GRAVITY = 210e9, 81e9, 77e3, 9.81  # Pa, Pa, N/m3, m/s2
PUMP, DECK = 800.0, 200.0  # kg, at one node, and at each of the others
SECTIONS = {  # area m2, Iy m4, Iz m4, J m4
    "columns": (4.6e-3, 2.0e-5, 2.0e-5, 3.1e-5),
    "long beams": (7.0e-3, 4.0e-5, 7.0e-5, 7.5e-5),
    "short beams": (4.0e-3, 1.6e-5, 1.6e-5, 2.5e-5),
}

# %% [markdown]
# ## The model
#
# Put your own script here. Parameters are factors on the moduli of groups of members:
# each group has its own material, with the factor on E and on G.


# %%
def build(theta):
    from Pynite import FEModel3D

    model = FEModel3D()
    for group, section in SECTIONS.items():
        model.add_section(group, *section)
        factor = theta[group]
        model.add_material(group, factor * E, factor * G, 0.3, WEIGHT)
    corners = dict(A=(0, 0), B=(LENGTH, 0), C=(LENGTH, WIDTH), D=(0, WIDTH))
    for name, (x, z) in corners.items():
        foot = f"foot {name}"
        model.add_node(foot, x, 0.0, z)
        model.add_node(name, x, HEIGHT, z)
        model.def_support(foot, *[True] * 6)
        model.add_member(f"column {name}", foot, name, "columns", "columns")
    for name in ("AB", "BC", "CD", "DA"):
        middle = np.add(corners[name[0]], corners[name[1]]) / 2
        model.add_node(name, float(middle[0]), HEIGHT, float(middle[1]))
        group = "long beams" if name in ("AB", "CD") else "short beams"
        model.add_member(f"beam {name}", *name, group, group)  # divided by its node
    add_mass(model, (*corners, "AB", "BC", "CD", "DA"))
    model.analyze_modal(N_MODES, "Mass", "Y", GRAVITY, check_stability=False)
    return model


# %% [markdown]
# **Mass.** PyNite takes mass only from a load combination: self-weight of members,
# which becomes a consistent mass (`rho` is a weight per volume here), and loads at
# nodes in the requested direction, divided by g. With neither, PyNite stops: "Model is
# massless". Do not give mass by loads on members: PyNite 3.2.0 gets it wrong (981 N/m
# along 4 m, 400 kg, becomes -100 kg at one end and 200 kg at the other). Check the
# moving mass, printed below: it is all that you put in, except for what belongs to the
# supports.


# %%
def add_mass(model, nodes):
    for name in nodes:
        mass = PUMP if name == "AB" else DECK
        model.add_node_load(name, "FY", -mass * GRAVITY, case="dead")
    model.add_member_self_weight("FY", -1.0, case="dead")
    model.add_load_combo("Mass", {"dead": 1.0})


# %% [markdown]
# ## Its matrices
#
# {py:func}`~emcee_femu.from_pynite` takes the arguments of `analyze_modal`:
# combination, direction and gravity. It leaves the supported DOFs out and names the
# others by node and direction, `"AB:uy"`: `base.dofs("AB:uy")` is a row, and
# `shapes=base.sensors(["AB:uy", "A:ux"])` asks for shapes at sensors.


# %%
def assemble(theta):
    return ef.from_pynite(build(theta), "Mass", "Y", gravity=GRAVITY)


# %% [markdown]
# Rotations have mass here, since members have self-weight. To massless rotations PyNite
# gives a millionth of the smallest entry of M's diagonal, so M is positive definite.
#
# ## The split, and the update
#
# {py:meth}`MatrixModel.from_differences <emcee_femu.MatrixModel.from_differences>`
# makes $K = K_0 + \sum_j \theta_j K_j$ from one assembly with all factors 1 and one per
# group doubled. {doc}`opensees` has the same steps, and more words on them.

# %% tags=["result"]
if __name__ == "__main__":
    names, rng = list(TRUTH), np.random.default_rng(1)
    ones = dict.fromkeys(names, 1.0)
    doubled = {name: {2.0: assemble({**ones, name: 2.0})} for name in names}
    base = assemble(ones)
    print(base)
    model = ef.MatrixModel.from_differences(base, doubled, n_modes=N_MODES)
    exact = build(TRUTH).frequencies
    found = model({name: np.array([x]) for name, x in TRUTH.items()}).frequencies[0]
    gap = np.abs(found / exact - 1).max()
    print(f"frequencies: off by {gap:.0e} from those of PyNite")
    measured = exact * (1 + NOISE * rng.standard_normal(N_MODES))
    term = ef.FrequencyTerm(measured, relative_sd=NOISE)
    prior = ef.GaussianPrior(names, [1.0] * 3, 0.2, [(0.4, 1.6)] * 3)
    run = ef.run(ef.LogPosterior(model, term, prior), seed=1)
    idata = ef.to_inference_data(run)
    print(ef.parameter_table(idata, true=TRUTH), ef.frequency_table(run), sep="\n\n")
    print(ef.diagnose(run).verdict)

# %% tags=["remove-cell"]
if __name__ == "__main__":
    assert gap < 1e-7
    assert ef.diagnose(run).converged
