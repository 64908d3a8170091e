# %% [markdown]
# # Use the matrices that an FE program exports
#
# For those whose FE program exports K and M: read the files of CalculiX, Abaqus,
# Nastran, ANSYS, MATLAB or any other program, and give their rows the names of the test's
# sensors. The model made from them solves thousands of parameter sets without the
# program. `python examples/how_to/matrices.py` runs the page. Its numbers are
# made up.
#
# {doc}`calculix` does so with the files of a real program.
#
# ## What to export
#
# | program | how it exports | what to give |
# |---|---|---|
# | CalculiX | `*FREQUENCY, SOLVER=MATRIXSTORAGE` | any of `job.sti`, `job.mas`, `job.dof` |
# | Abaqus | a step with `*MATRIX GENERATE, STIFFNESS, MASS` and `*MATRIX OUTPUT, STIFFNESS, MASS, FORMAT=MATRIX INPUT` | `job_STIF1.mtx`; `job_MASS1.mtx` is found beside it |
# | Nastran | `PARAM,EXTOUT,DMIGPCH` or `EXTSEOUT(STIFFNESS,MASS,DMIGPCH)` | the punch file `job.pch` |
# | Nastran | `OUTPUT4 KAA,MAA//0/11 $` in DMAP, `ASSIGN OUTPUT4='km.op4',UNIT=11,FORM=FORMATTED` | `km.op4`, which has no labels |
# | ANSYS | a modal analysis writes `file.full` | `file.full`, with `pip install ansys-mapdl-reader` |
# | ANSYS | `*SMAT,K,D,IMPORT,FULL,file.full,STIFF`, `*EXPORT,K,MMF,K.mtx`; M by `MASS` | `{"K": "K.mtx", "M": "M.mtx"}`, no labels |
# | ANSYS | `HBMAT,K,txt,,ASCII,STIFF,NO` and `HBMAT,M,txt,,ASCII,MASS,NO` after `/AUX2` and `FILE,file,full`: Harwell-Boeing (RSA or RUA) | `{"K": "K.txt", "M": "M.txt"}`, no labels |
# | MATLAB | `save('model.mat', 'K', 'M', '-v7')`, sparse or not | `model.mat`, no labels |
# | NumPy | `np.savez('model.npz', K=K, M=M)`, or one `.npy` or CSV file for each matrix | `model.npz`, or `{"K": "K.npy", "M": "M.npy"}`, no labels |
# | any other | Matrix Market (`scipy.io.mmwrite`) or `scipy.sparse.save_npz` | `{"K": "K.mtx", "M": "M.mtx"}`, no labels |
#
# The format is recognised by the content, not by the name of the file. A file that is
# truncated, damaged or in another format raises an error with its name, the line if
# there is one, and what to do. Matrices must be symmetric.
#
# ## Rows by their names
#
# Here are three exports of a three-storey building. In two of them the columns of the
# ground floor are 2 and 3 times as stiff. Matrix Market files have no labels, so a text
# file with a line `node.direction` for each row is given with the matrices. CalculiX's
# `.dof` is such a file.

# %% tags=["result"]
import tempfile
from pathlib import Path

import numpy as np
from scipy.io import mmwrite
from scipy.sparse import csc_array

import emcee_femu as ef

folder = Path(tempfile.mkdtemp())


def write(path, columns):  # of the ground floor; in units of 30 MN/m
    K = np.diag([2.0, 2.0, 1.0]) - np.eye(3, k=1) - np.eye(3, k=-1)
    K[0, 0] = 1.0 + columns
    mmwrite(path, csc_array(3e7 * K), symmetry="symmetric")


write(folder / "K.mtx", 1.0)
write(folder / "K2.mtx", 2.0)
write(folder / "K3.mtx", 3.0)
M = csc_array(1.6e4 * np.eye(3))
mmwrite(folder / "M.mtx", M, symmetry="symmetric")
rows = folder / "rows.txt"
rows.write_text("1.1\n2.1\n3.1\n")

base = ef.read_matrices({"K": folder / "K.mtx", "M": folder / "M.mtx", "dofs": rows})
print(base)

# %% [markdown]
# `base.dofs("node 3 x")` is a row, `base.dofs(["3:ux", "1:ux"])` an array of them; x y
# z, ux uy uz, rx ry rz and the numbers 1 to 6 are accepted. With `base.sensors` the
# model names its rows as the test does. `Measurements(..., dofs=[...])`, or the column
# `dof` of its CSV file, is matched by these names.

# %%
print(base.dofs("node 3 x"), base.dofs(["3:ux", "1:ux"]))
test = ef.Measurements(
    [2.6, 8.2], sd=[0.02, 0.05], shapes=[[1.0, -0.8], [0.5, 1.0]], dofs=["3:ux", "1:ux"]
)
exports = {2.0: folder / "K2.mtx", 3.0: folder / "K3.mtx"}
changed = {b: ef.read_matrices({"K": K, "dofs": rows}) for b, K in exports.items()}
options = {"n_modes": 3, "shapes": base.sensors(test.dofs)}
model = ef.MatrixModel.from_differences(base, {"columns": changed}, **options)
paired = ef.PairedModel(model, test, candidates=3)
paired({"columns": [0.6, 1.0]}).frequencies.round(3)  # two parameter sets

# %% [markdown]
# ## Parameters from differences
#
# $K_j = (K(b) - K(a)) / (b - a)$ for each parameter, from the base and an export in
# which only this parameter was changed; `at={"E": 2.1e11}` says its value in the base,
# which is 1 if nothing is said. M is split in the same way: an export is what
# `read_matrices` gives, `(K, M)`, or K alone if M is the same. Two matrices always lie
# on a straight line. With more exports the fewest powers up to the cube that fit are
# used. If K is not a polynomial of a parameter, the error says how far it is off.
#
# Moduli, densities, areas and springs are linear and need one export, better two. A
# plate's thickness (t and t³) needs three.
#
# A matrix counts as unchanged below 1e-9 of its diagonal. Rounding errors in other
# entries, below 1e-12, are dropped, so that $K_j$ has entries only where the parameter
# acts. So export all digits, and make a large change: double the parameter.
#
# A model of a few hundred DOFs is faster with dense matrices (`base.K.toarray()`).
# Models of thousands stay sparse and are reduced ({doc}`/tutorials/large_models`).
#
# ## What multiplies a matrix
#
# Parameters that multiply each other cannot be found from exports in which one is
# changed. If you have the parts, say what multiplies each: the bending stiffness of a
# plate grows with $E t^3$ and its mass with t. The arguments of a function are
# parameters. It is called with all walkers at once, and its derivatives take no solve.
# Here the matrices above stand for those of a plate, with a shaker of known mass:

# %%
plate = ef.MatrixModel(
    np.zeros((3, 3)),
    np.diag([0.0, 0.0, 4e3]),  # kg
    K={"bending": (base.K.toarray(), lambda E, t: E * t**3)},
    M={"plate": (M.toarray(), lambda t: t)},
    n_modes=3,
)
print(plate.names, plate({"E": [1.0, 1.0], "t": [1.0, 1.1]}).frequencies.round(2))

# %% [markdown]
# Without the shaker all frequencies would be proportional to $t \sqrt{E / \rho}$, and no
# test could tell E from t; {doc}`/tutorials/what_is_learned` shows how to see that before
# a test. If K is not a sum of given matrices (the place of a spring), use
# {py:class}`~emcee_femu.AssembledModel`, a function from one parameter set to K and M.
#
# ## CalculiX, Abaqus, Nastran, ANSYS: what to know of each
#
# - **CalculiX** leaves out held DOFs. It makes beams and shells into bricks, so a node
#   becomes several. Such a name raises an error that lists its rows; choose one, as in
#   `shapes={"12:uz": 40}`. Elements with reduced integration (C3D20R, C3D8I, and so
#   beams and shells) have a singular mass, which sparse models accept. A single row of
#   C3D20R bricks is singular in K too, and is refused: use C3D20.
# - **Abaqus** numbers inner nodes below zero (`base.dofs("-3:ux")`), and puts 1e36 on the
#   diagonal of held DOFs, which are left out. With FORMAT=COORDINATE there are no labels,
#   and held rows are refused.
# - **Nastran** writes the a-set in the displacement coordinate systems of its grid
#   points, with ten digits in a punch file. A punch file has no end mark: compare the
#   total mass. Names that begin with K and M (KAAX, MAAX) are taken for them. If there
#   are several, give `{"KAA": path, "MAA": path}` and take `base.matrices["KAA"]`.
#   Binary OP4 is refused: write it FORMATTED.
# - **ANSYS** `.full` files are read by PyMAPDL-Reader, which runs with NumPy 2 from
#   version 0.56 and installs VTK.
#
# Results agree with the programs' own frequencies: CalculiX 2.20 (beams and shells, to 4
# decimals, and after changes of E and density by 30 % through `from_differences`), MSC
# Nastran 2013 (a public punch file with its eigenvalues: all 7 printed digits), ANSYS 15
# (the clamped beam that comes with the reader, to about 1 %). Readers of Abaqus files, of
# OP4 and of Harwell-Boeing are tested on files written by their published formats.

# %% tags=["remove-cell"]
from scipy.linalg import eigh

K = np.diag([1.6, 2.0, 1.0]) - np.eye(3, k=1) - np.eye(3, k=-1)
exact = np.sqrt(eigh(3e7 * K, M.toarray(), eigvals_only=True)) / (2 * np.pi)
found = paired({"columns": [0.6, 1.0]}).frequencies
np.testing.assert_allclose(found[0], exact[:2], rtol=1e-9)
assert list(base.dofs(["3:ux", "1:ux"])) == [2, 0]
K, m = base.K.toarray() * 1.1**3, 1.1 * M.toarray() + np.diag([0.0, 0.0, 4e3])
exact = np.sqrt(eigh(K, m, eigvals_only=True)) / (2 * np.pi)
thicker = plate({"E": np.ones(1), "t": np.array([1.1])})
np.testing.assert_allclose(thicker.frequencies[0], exact, rtol=1e-9)
