"""PyNite: update a 3-D platform with K and M of PyNite.

A steel platform on four columns carries a pump on one of its long beams. Built in
PyNite, it is updated from five measured frequencies: three factors, on the stiffness of
the columns, of the long beams and of the short beams. PyNite assembles its matrices for
four parameter sets, and the sampler works with these:

    pip install "emcee_femu[pynite]"

For your own model copy `matrices`, which reads K, M and the label of every row from an
analysed PyNite model, and `affine_split`, which suits any program. Mind:

* Parameters are factors on the moduli of groups of members: a material of its own for
  each group, and the factor on E and on G. Then K = K_0 + sum theta_j K_j, and
  K_j = K(theta_j = 2) - K(all 1); what belongs to no group, such as support springs, is
  left over in K_0. One assembly at a random theta proves the split. It fails where K
  is not linear in the parameter: P-Delta, the depth of a section, the thickness of a
  plate.
* Supports. `Ke` and `M` hold all six DOFs of every node, the supported ones too, in the
  order of the numbers `node.ID` that an analysis gives; `matrices` keeps the free ones.
  A member that passes through a node is divided there by PyNite itself.
* Mass. There is none but in a load combination: self-weight of members, which becomes a
  consistent mass (`rho` is a weight per volume here), and loads at nodes in the
  direction that is asked for, divided by g. With neither, PyNite stops: "Model is
  massless". Do not give mass by loads on members: PyNite 3.2.0 gets it wrong (981 N/m
  along 4 m, 400 kg, becomes -100 kg at one end and 200 kg at the other). The total
  mass, printed below, is the check. Compare it with what you put in.
* DOFs without mass. Rotations have mass here, since members have self-weight. To those
  that would have none PyNite gives a millionth of the smallest entry of M's diagonal,
  so M is positive definite. Do not condense such DOFs out before the split: the
  condensed K_aa - K_ab K_bb^-1 K_ba is not affine in theta.

The measured frequencies are simulated: those of PyNite at true factors, which are
stated, with 0.5 % of noise. A real structure also deviates from its model, and 0.5 %
would then be too little.

Run it:  python examples/pynite_frame.py
"""

import argparse
import time
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

import emcee_femu as ef

TRUTH = {"columns": 0.85, "long beams": 1.1, "short beams": 0.8}
N_MODES, NOISE = 5, 0.005  # relative standard deviation of a measured frequency
LENGTH, WIDTH, HEIGHT = 5.0, 3.0, 3.5  # m
E, G, WEIGHT, GRAVITY = 210e9, 81e9, 77e3, 9.81  # Pa, Pa, N/m3, m/s2
PUMP, DECK = 800.0, 200.0  # kg, at one node, and at each of the others
SECTIONS = {  # area m2, Iy m4, Iz m4, J m4
    "columns": (4.6e-3, 2.0e-5, 2.0e-5, 3.1e-5),
    "long beams": (7.0e-3, 4.0e-5, 7.0e-5, 7.5e-5),
    "short beams": (4.0e-3, 1.6e-5, 1.6e-5, 2.5e-5),
}
DIRECTIONS = ("DX", "DY", "DZ", "RX", "RY", "RZ")

Split = tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]


def build(theta: Mapping[str, float]) -> Any:
    """Return the analysed model for stiffness factors: here stands your own script."""
    from Pynite import FEModel3D

    model = FEModel3D()
    for group, section in SECTIONS.items():
        model.add_section(group, *section)
        model.add_material(group, theta[group] * E, theta[group] * G, 0.3, WEIGHT)
    corners = {"A": (0, 0), "B": (LENGTH, 0), "C": (LENGTH, WIDTH), "D": (0, WIDTH)}
    for name, (x, z) in corners.items():
        model.add_node(f"foot {name}", x, 0.0, z)
        model.add_node(name, x, HEIGHT, z)
        model.def_support(f"foot {name}", True, True, True, True, True, True)
        model.add_member(f"column {name}", f"foot {name}", name, "columns", "columns")
    for name in ("AB", "BC", "CD", "DA"):
        start, end = corners[name[0]], corners[name[1]]
        middle = np.add(start, end) / 2
        model.add_node(name, float(middle[0]), HEIGHT, float(middle[1]))
        group = "long beams" if name in ("AB", "CD") else "short beams"
        model.add_member(f"beam {name}", name[0], name[1], group, group)
    for name in (*corners, "AB", "BC", "CD", "DA"):
        mass = PUMP if name == "AB" else DECK
        model.add_node_load(name, "FY", -mass * GRAVITY, case="dead")
    model.add_member_self_weight("FY", -1.0, case="dead")
    model.add_load_combo("Mass", {"dead": 1.0})
    model.analyze_modal(N_MODES, "Mass", "Y", GRAVITY, check_stability=False)
    return model


def matrices(
    model: Any, combination: str = "Mass", direction: str = "Y", gravity: float = 9.81
) -> tuple[np.ndarray, np.ndarray, list[tuple[str, str]]]:
    """Return K, M and the (node, direction) of each row of an analysed model."""
    labels = {
        6 * node.ID + i: (name, axis)
        for name, node in model.nodes.items()
        for i, axis in enumerate(DIRECTIONS)
        if not getattr(node, f"support_{axis}")
    }
    free = np.ix_(list(labels), list(labels))
    K = model.Ke(combination, check_stability=False, sparse=False)
    M = model.M(combination, direction, gravity, sparse=False)
    return K[free], M[free], list(labels.values())


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


def total_mass(model: Any) -> list[float]:
    """Return the mass in kg that moves when all nodes move by 1 in X, in Y and in Z."""
    M = model.M("Mass", "Y", GRAVITY, sparse=False)
    return [float(M[i::6, i::6].sum()) for i in range(3)]


def main(generations: int = 1_000, seed: int = 1, sets: int = 10) -> dict[str, Any]:
    """Check the split, time both models, update the platform; return the figures."""
    names, rng = list(TRUTH), np.random.default_rng(seed)

    def assemble(theta: Mapping[str, float]) -> tuple[np.ndarray, np.ndarray]:
        return matrices(build(theta))[:2]

    split = affine_split(assemble, names)
    prior = ef.GaussianPrior(names, [1.0] * 3, 0.2, [(0.4, 1.6)] * 3)
    model = ef.MatrixModel(*split, n_modes=N_MODES)
    thetas = [dict(zip(names, t, strict=True)) for t in prior.sample(rng, sets)]
    K = assemble(thetas[0])[0]
    found = {"split": np.abs(combined(split, thetas[0]) - K).max() / np.abs(K).max()}
    found["mass"] = total_mass(build(thetas[0]))
    print("total mass in X, Y and Z:", *np.round(found["mass"], 1), "kg")
    print(f"K_0 + sum theta_j K_j: off by {found['split']:.0e} of the largest of K")

    errors, seconds = [], []  # both models in turn, at the same parameter sets
    for theta in thetas:
        batch = {name: np.full(16, value) for name, value in theta.items()}
        clock = [time.perf_counter()]
        own = build(theta).frequencies
        clock.append(time.perf_counter())
        ours = model(batch).frequencies
        clock.append(time.perf_counter())
        errors.append(np.abs(ours / own - 1).max())
        seconds.append(np.diff(clock) / (1, len(ours)))
    found["frequencies"] = np.max(errors)
    found["speed-up"] = np.median(np.divide(*np.transpose(seconds)))
    program, matrix = 1e3 * np.median(seconds, axis=0)
    print(f"frequencies: off by {found['frequencies']:.0e} from those of PyNite")
    print(
        f"one solve: PyNite {program:.1f} ms with the rebuilding, MatrixModel "
        f"{matrix:.3f} ms in a batch of 16, {found['speed-up']:.0f} times faster\n"
    )

    measured = build(TRUTH).frequencies * (1 + NOISE * rng.standard_normal(N_MODES))
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
