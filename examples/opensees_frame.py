"""OpenSees: update a frame with K and M of OpenSeesPy.

A frame of two storeys and one bay, built in OpenSees, is updated from four measured
frequencies: three factors, on the stiffness of the lower columns, of the upper columns
and of the beams. OpenSees assembles its matrices for four parameter sets, and the
sampler works with these:

    pip install "emcee_femu[opensees]"

For your own model copy `matrices`, which reads K, M and the label of every row from
whatever model stands in OpenSees, and `affine_split`, which suits any program. Mind:

* Parameters are factors on the moduli of groups of elements. Then
  K = K_0 + sum theta_j K_j, and K_j = K(theta_j = 2) - K(all 1); what belongs to no
  group, such as springs, is left over in K_0. One assembly at a random theta proves
  the split. It fails where K is not linear in the parameter: PDelta and Corotational
  transformations under load, the depth of a section, the thickness of a plate.
* Supports and ties. The handler Transformation takes fixed DOFs and those tied by
  equalDOF or rigidDiaphragm out of the equations. Penalty adds huge numbers to K and
  Lagrange adds rows: neither gives a K to use.
* Rows. After the assembly `nodeDOFs(node)` lists the rows of a node's directions, -1
  where fixed. Beware of a tied node: its own free directions come first and its
  master's rows after them, so position in the list is not direction; `matrices` sorts
  that out. A sensor on a direction tied by equalDOF reads the row of the master.
* DOFs without mass. `mass(node, m, m, 0.)` alone leaves the rotations massless;
  MatrixModel refuses such an M. Here the elements have a consistent mass (-mass,
  -cMass). In a lumped model give each rotation the inertia m r^2 of a radius r that is
  small to the structure, here 1 cm: that changes no frequency by more than 1e-5. Static
  condensation is no remedy for a split: K_aa - K_ab K_bb^-1 K_ba is not affine in theta
  (below it puts a frequency off by 1.4 %, three times the noise), so it must be done
  anew at each theta, say in a FunctionModel.

The measured frequencies are simulated: those of OpenSees at true factors, which are
stated, with 0.5 % of noise. A real structure also deviates from its model, and 0.5 %
would then be too little.

Run it:  python examples/opensees_frame.py
"""

import argparse
import ctypes
import time
from collections.abc import Callable, Mapping
from importlib import metadata
from types import ModuleType
from typing import Any

import numpy as np

import emcee_femu as ef

TRUTH = {"lower columns": 0.75, "upper columns": 1.15, "beams": 0.9}
N_MODES, NOISE = 4, 0.005  # relative standard deviation of a measured frequency
BAY, STOREY, FLOORS = 6.0, 3.5, (9000.0, 6000.0)  # m, m, kg
E, AREA, COLUMN, BEAM, LINE_MASS = 210e9, 8e-3, 4e-5, 2e-4, 62.8  # Pa, m2, m4, m4, kg/m

Split = tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]


def load_opensees() -> ModuleType:
    """Import OpenSees, or say what to do where it does not import."""
    # The liblapack of openseespy 3.7 does not look for libblas in its own folder: the
    # import fails on a machine without a BLAS, unless the one shipped is loaded first.
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
            f"OpenSees does not import ({error}). If it is not installed: pip install "
            "'emcee_femu[opensees]'. If it is, a BLAS or the Fortran runtime is "
            "missing: apt install libblas3 libgfortran5, or conda install -c "
            "conda-forge libblas libgfortran. There are no wheels for Linux on ARM"
        ) from error
    return ops


def build(ops: ModuleType, theta: Mapping[str, float], lumped: bool = False) -> None:
    """Build the frame with stiffness factors theta: here stands your own script."""
    ops.wipe()
    ops.model("basic", "-ndm", 2, "-ndf", 3)
    ops.geomTransf("Linear", 1)

    def element(tag: int, start: int, end: int, group: str, inertia: float) -> None:
        mass = () if lumped else ("-mass", LINE_MASS, "-cMass")
        properties = (AREA, theta[group] * E, inertia, 1, *mass)
        ops.element("elasticBeamColumn", tag, start, end, *properties)

    for node, x in ((1, 0.0), (2, BAY)):
        ops.node(node, x, 0.0)
        ops.fix(node, 1, 1, 1)
    for floor, group in ((10, "lower columns"), (20, "upper columns")):
        left, right, middle = floor + 1, floor + 2, floor + 3
        for node, x, share in ((left, 0, 0.25), (right, 1, 0.25), (middle, 0.5, 0.5)):
            ops.node(node, x * BAY, STOREY * floor / 10)
            mass = share * FLOORS[floor // 10 - 1]
            ops.mass(node, mass, mass, 0.0)
        for node in (right, middle):  # the slab keeps its length
            ops.equalDOF(left, node, 1)
        below = floor - 10
        element(floor + 1, below + 1, left, group, COLUMN)
        element(floor + 2, below + 2, right, group, COLUMN)
        element(floor + 3, left, middle, "beams", BEAM)
        element(floor + 4, middle, right, "beams", BEAM)


def matrices(ops: ModuleType) -> tuple[np.ndarray, np.ndarray, list[tuple[int, int]]]:
    """Return K, M and the (node, direction) of each row, directions counted from 1."""
    found = []
    for mass, stiffness in ((0.0, 1.0), (1.0, 0.0)):
        ops.wipeAnalysis()
        ops.system("FullGeneral")  # the system that hands out its matrix
        ops.numberer("Plain")
        ops.constraints("Transformation")
        ops.algorithm("Linear")
        ops.integrator("GimmeMCK", mass, 0.0, stiffness)  # mass, damping, stiffness
        ops.analysis("Transient")
        ops.analyze(1, 0.0)  # assembles; that it cannot solve a singular M does no harm
        n = ops.systemSize()
        found.append(np.array(ops.printA("-ret")).reshape(n, n))
    labels = {}
    for node in ops.getNodeTags():
        tied = ops.getConstrainedDOFs(node)
        directions = range(1, len(ops.nodeDOFs(node)) + 1)
        own = [direction for direction in directions if direction not in tied]
        # Rows of a master follow the node's own ones; zip leaves them out.
        for row, direction in zip(ops.nodeDOFs(node), own, strict=False):
            labels[row] = (node, direction)
    ops.wipeAnalysis()
    return found[0], found[1], [labels[row] for row in range(len(found[0]))]


def affine_split(
    assemble: Callable[[Mapping[str, float]], tuple[np.ndarray, np.ndarray]],
    names: list[str],
) -> Split:
    """Return K_0, M and {name: K_j} of any program that gives K and M at theta."""
    nominal = dict.fromkeys(names, 1.0)
    K, M = assemble(nominal)
    parts = {name: assemble({**nominal, name: 2.0})[0] - K for name in names}
    return K - sum(parts.values()), M, parts


def combined(split: Split, theta: Mapping[str, float]) -> np.ndarray:
    """Return K_0 + sum theta_j K_j."""
    return split[0] + sum(theta[name] * part for name, part in split[2].items())


def condensed(K: np.ndarray, M: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return K and M without massless DOFs, which follow the others statically."""
    a, b = M.diagonal() > 0, M.diagonal() == 0
    follow = np.linalg.solve(K[np.ix_(b, b)], K[np.ix_(b, a)])
    return K[np.ix_(a, a)] - K[np.ix_(a, b)] @ follow, M[np.ix_(a, a)]


def frequencies(ops: ModuleType, theta: Mapping[str, float]) -> np.ndarray:
    """Return the frequencies in Hz by the eigensolver of OpenSees."""
    build(ops, theta)
    ops.constraints("Transformation")
    ops.numberer("Plain")
    return np.sqrt(ops.eigen("-genBandArpack", N_MODES)) / (2 * np.pi)


def model_at(split: Split, theta: Mapping[str, float]) -> np.ndarray:
    """Return the frequencies in Hz of a split, one parameter set."""
    model = ef.MatrixModel(*split, n_modes=N_MODES)
    return model({name: np.array([x]) for name, x in theta.items()}).frequencies[0]


def lumped_masses(ops: ModuleType, split: Split) -> tuple[float, float]:
    """Return how far off a split of condensed K is, and one with a small inertia.

    Both are largest relative errors of a frequency at the true factors.
    """
    build(ops, TRUTH, lumped=True)
    M = matrices(ops)[1]
    exact = model_at((*condensed(combined(split, TRUTH), M), {}), {})
    wrong = affine_split(lambda t: condensed(combined(split, t), M), list(TRUTH))
    inertia = np.where(M.diagonal() == 0, M[M > 0].min() * 0.01**2, 0.0)  # r = 1 cm
    small = (split[0], M + np.diag(inertia), split[2])
    return tuple(np.abs(model_at(s, TRUTH) / exact - 1).max() for s in (wrong, small))


def main(generations: int = 1_000, seed: int = 1, sets: int = 20) -> dict[str, Any]:
    """Check the split, time both models, update the frame; return the figures."""
    ops, names, rng = load_opensees(), list(TRUTH), np.random.default_rng(seed)

    def assemble(theta: Mapping[str, float]) -> tuple[np.ndarray, np.ndarray]:
        build(ops, theta)
        return matrices(ops)[:2]

    split = affine_split(assemble, names)
    prior = ef.GaussianPrior(names, [1.0] * 3, 0.2, [(0.4, 1.6)] * 3)
    model = ef.MatrixModel(*split, n_modes=N_MODES)
    thetas = [dict(zip(names, t, strict=True)) for t in prior.sample(rng, sets)]
    K = assemble(thetas[0])[0]
    found = {"split": np.abs(combined(split, thetas[0]) - K).max() / np.abs(K).max()}
    print(f"K_0 + sum theta_j K_j: off by {found['split']:.0e} of the largest of K")

    errors, seconds = [], []  # both models in turn, at the same parameter sets
    for theta in thetas:
        batch = {name: np.full(16, value) for name, value in theta.items()}
        clock = [time.perf_counter()]
        own = frequencies(ops, theta)
        clock.append(time.perf_counter())
        ours = model(batch).frequencies
        clock.append(time.perf_counter())
        errors.append(np.abs(ours / own - 1).max())
        seconds.append(np.diff(clock) / (1, len(ours)))
    found["frequencies"] = np.max(errors)
    found["speed-up"] = np.median(np.divide(*np.transpose(seconds)))
    program, matrix = 1e3 * np.median(seconds, axis=0)
    print(f"frequencies: off by {found['frequencies']:.0e} from those of OpenSees")
    print(
        f"one solve: OpenSees {program:.2f} ms with the rebuilding, MatrixModel "
        f"{matrix:.3f} ms in a batch of 16, {found['speed-up']:.0f} times faster"
    )
    found["condensed"], found["inertia"] = lumped_masses(ops, split)
    print(
        f"lumped masses: frequencies of a split of condensed K off by "
        f"{found['condensed']:.1e}, with a small inertia by {found['inertia']:.0e}\n"
    )

    measured = frequencies(ops, TRUTH) * (1 + NOISE * rng.standard_normal(N_MODES))
    term = ef.FrequencyTerm(measured, relative_sd=NOISE)
    posterior = ef.LogPosterior(model, term, prior)
    samplers = ef.run(posterior, "auto", nsteps=generations, seed=seed)
    idata = ef.to_inference_data(samplers, posterior)
    print(ef.parameter_table(idata, nominal=TRUTH))
    print(ef.frequency_table(idata, posterior))
    draws = samplers[0].get_chain(flat=True)
    found |= {"mean": draws.mean(axis=0), "sd": draws.std(axis=0)}
    return {**found, "measured": measured}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--generations", type=int, default=1_000)
    parser.add_argument("--seed", type=int, default=1)
    main(**vars(parser.parse_args()))
