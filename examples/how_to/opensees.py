# %% [markdown]
# # Update an OpenSees model
#
# For those who build their model in OpenSeesPy: take K and M from it, and update it
# without OpenSees in the loop. `python examples/how_to/opensees.py` runs the page (3
# s); it takes `pip install openseespy`.
#
# A frame of two storeys and one bay is updated from four measured frequencies
# (simulated here), with three factors: on the stiffness of the lower columns, of the
# upper columns and of the beams. OpenSees assembles its matrices for four parameter
# sets, and the sampler works with these. {py:func}`~emcee_femu.from_opensees` reads K,
# M and the name of every row from the model that is currently in OpenSees.

# %%
import ctypes
from importlib import metadata

import numpy as np

import emcee_femu as ef

TRUTH = {"lower columns": 0.75, "upper columns": 1.15, "beams": 0.9}
N_MODES, NOISE = 4, 0.005  # relative sd of a measured frequency
BAY, STOREY, FLOORS = 6.0, 3.5, (9000.0, 6000.0)  # m, m, kg
E, AREA, COLUMN, BEAM = 210e9, 8e-3, 4e-5, 2e-4  # Pa, m2, m4, m4
LINE_MASS = 62.8  # kg/m


def load_opensees():
    # openseespy 3.7 does not look for libblas in its own folder: the import
    # fails on a machine without a BLAS, unless the one shipped is loaded first.
    try:
        shipped = metadata.files("openseespylinux") or []
    except metadata.PackageNotFoundError:
        shipped = []
    try:
        for file in shipped:
            if file.name.startswith("libblas.so"):
                ctypes.CDLL(str(file.locate()), mode=ctypes.RTLD_GLOBAL)
        import openseespy.opensees as ops
    except (ImportError, OSError, RuntimeError) as error:
        raise ImportError(
            f"OpenSees does not import ({error}). If it is not installed: "
            "pip install openseespy. If it is, a BLAS or the Fortran "
            "runtime is missing: apt install libblas3 libgfortran5, or conda "
            "install -c conda-forge libblas libgfortran. There are no wheels for "
            "Linux on ARM"
        ) from error
    return ops


# %% [markdown]
# ## The model
#
# Put your own script here. Parameters are factors on the moduli of groups of elements.
# `ops` is `openseespy.opensees`.


# %%
def build(ops, theta):
    ops.wipe()
    ops.model("basic", "-ndm", 2, "-ndf", 3)
    ops.geomTransf("Linear", 1)
    for node, x in ((1, 0.0), (2, BAY)):
        ops.node(node, x, 0.0)
        ops.fix(node, 1, 1, 1)
    add_floor(ops, 10, theta["lower columns"], theta["beams"])
    add_floor(ops, 20, theta["upper columns"], theta["beams"])


def add_floor(ops, floor, columns, beams):
    left, right, middle, below = floor + 1, floor + 2, floor + 3, floor - 10
    nodes = ((left, 0, 0.25), (right, 1, 0.25), (middle, 0.5, 0.5))
    for node, x, share in nodes:
        ops.node(node, x * BAY, STOREY * floor / 10)
        mass = share * FLOORS[floor // 10 - 1]
        ops.mass(node, mass, mass, 0.0)
    for node in (right, middle):  # the slab keeps its length
        ops.equalDOF(left, node, 1)
    for start, end, factor, inertia in (
        (below + 1, left, columns, COLUMN),
        (below + 2, right, columns, COLUMN),
        (left, middle, beams, BEAM),
        (middle, right, beams, BEAM),
    ):
        tag = len(ops.getEleTags()) + 1
        properties = (AREA, factor * E, inertia, 1, "-mass", LINE_MASS, "-cMass")
        ops.element("elasticBeamColumn", tag, start, end, *properties)


# %% [markdown]
# ## Its matrices
#
# The integrator `GimmeMCK` with the system `FullGeneral` gives the matrices;
# {py:func}`~emcee_femu.from_opensees` calls them.
#
# - **Supports and ties.** Fixed DOFs, and those tied by equalDOF or rigidDiaphragm, have
#   no row: a sensor there reads the row of the master, here `"11:ux"` for all of the first
#   floor. Nodes tied twice, or to a tied node, are refused, since OpenSees treats them
#   wrongly.
# - **Rows** are named by node and direction, `"12:uy"`: `base.dofs("12:uy")` is a row, and
#   `shapes=base.sensors(["11:ux", "21:ux"])` asks for shapes at sensors.
# - **Mass.** `print(base)` shows the mass that moves along each axis; compare it with
#   your input.


# %%
def assemble(ops, theta):
    build(ops, theta)
    return ef.from_opensees(ops)


# %% [markdown]
# ## The split, and the update
#
# $K = K_0 + \sum_j \theta_j K_j$: {py:meth}`MatrixModel.from_differences
# <emcee_femu.MatrixModel.from_differences>` makes the parts from one assembly with all
# factors 1 and one per group doubled. It fails if K is not linear in the parameter: the
# depth of a section, PDelta under load.


# %%
def frequencies(ops, theta):  # in Hz, by OpenSees
    build(ops, theta)
    ops.constraints("Transformation")
    ops.numberer("Plain")
    return np.sqrt(ops.eigen("-genBandArpack", N_MODES)) / (2 * np.pi)


# %% [markdown]
# The measured frequencies are simulated: those of OpenSees at true factors, with 0.5 %
# of noise. At these factors the model must have the same frequencies, which verifies
# the split. A real structure also deviates from its model
# ({doc}`/tutorials/noise_and_model_error`). The cell is inside `if __name__ ==
# "__main__":`, so that the functions above can be imported without OpenSees.

# %% tags=["result"]
if __name__ == "__main__":
    ops, names, rng = load_opensees(), list(TRUTH), np.random.default_rng(1)
    ones = dict.fromkeys(names, 1.0)
    doubled = {name: {2.0: assemble(ops, {**ones, name: 2.0})} for name in names}
    base = assemble(ops, ones)
    print(base)
    print("the first rows are", *base.labels[:4])
    model = ef.MatrixModel.from_differences(base, doubled, n_modes=N_MODES)
    exact = frequencies(ops, TRUTH)
    found = model({name: np.array([x]) for name, x in TRUTH.items()}).frequencies[0]
    gap = np.abs(found / exact - 1).max()
    print(f"frequencies: off by {gap:.0e} from those of OpenSees")
    measured = exact * (1 + NOISE * rng.standard_normal(N_MODES))
    term = ef.FrequencyTerm(measured, relative_sd=NOISE)
    prior = ef.GaussianPrior(names, [1.0] * 3, 0.2, [(0.4, 1.6)] * 3)
    run = ef.run(ef.LogPosterior(model, term, prior), seed=1)
    idata = ef.to_inference_data(run)
    print(ef.parameter_table(idata, true=TRUTH), ef.frequency_table(run), sep="\n\n")
    print(ef.diagnose(run).verdict)

# %% [markdown]
# ## DOFs without mass
#
# `mass(node, m, m, 0.)` alone leaves the rotations massless. The model then works with
# sparse matrices, and takes up to forty times as long if it is small. Here the elements
# have a consistent mass (`-mass`, `-cMass`). In a lumped model, give each rotation the
# inertia $m r^2$ of a radius r that is small against the structure, such as 1 cm. Static
# condensation does not help: the condensed matrix is not affine in θ.

# %% tags=["remove-cell"]
if __name__ == "__main__":
    assert gap < 1e-7
    for name, value in TRUTH.items():
        draws = idata.posterior[name].values
        assert abs(draws.mean() - value) < 3 * draws.std() < 3 * 0.1
