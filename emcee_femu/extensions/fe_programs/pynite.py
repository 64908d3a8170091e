"""Stiffness and mass of a PyNite model."""

from itertools import pairwise
from typing import Any

import numpy as np
from scipy.sparse import csc_array

from ... import checks
from ...models.geometry import Geometry
from .exports import DOF_DIRECTIONS, Matrices

# Of supports, in the order of DOF_DIRECTIONS.
PYNITE_AXES = ("DX", "DY", "DZ", "RX", "RY", "RZ")


def from_pynite(
    model: Any, mass_combo_name: str, mass_direction: str = "Y", *, gravity: float
) -> Matrices:
    """Read stiffness and mass of an analysed PyNite model.

    Give the same arguments as to ``model.analyze_modal``, which numbers the nodes.
    PyNite defines mass by a load combination: self-weight of members, and nodal loads
    along one direction, divided by gravity. Compare ``moving_mass`` with the mass you
    expect, because PyNite 3.2 computes masses from member loads incorrectly. It gives
    massless DOFs a millionth of the smallest mass.

    Args:
        model: The ``FEModel3D``, analysed after its last change.
        mass_combo_name: The load combination that defines the mass.
        mass_direction: X, Y or Z: loads along it are mass, in all directions.
        gravity: The acceleration that converts loads into masses, such as 9.81 m/s2 for
            N and kg.

    Returns:
        K and M without held DOFs, DOFs such as ``"roof A:ux"`` named by the nodes, and
        the geometry, with members, springs, plates and quads as lines.

    Raises:
        TypeError: If model is not an FEModel3D.
        ValueError: If the model is not analysed, or has no such combination, no mass or
            no free DOF.

    Examples:
        >>> from emcee_femu import from_pynite
        >>> def cantilever():
        ...     from Pynite import FEModel3D
        ...     model = FEModel3D()
        ...     model.add_material("steel", 210e9, 81e9, 0.3, 77e3)
        ...     model.add_section("tube", 4e-3, 2e-5, 2e-5, 3e-5)
        ...     model.add_node("root", 0.0, 0.0, 0.0)
        ...     model.add_node("tip", 2.0, 0.0, 0.0)
        ...     model.def_support("root", *[True] * 6)
        ...     model.add_member("beam", "root", "tip", "steel", "tube")
        ...     model.add_member_self_weight("FY", -1.0, case="dead")
        ...     model.add_load_combo("mass", {"dead": 1.0})
        ...     model.analyze_modal(2, "mass", "Y", 9.81)
        ...     return from_pynite(model, "mass", "Y", gravity=9.81)
        >>> cantilever().labels[:2]  # doctest: +SKIP
        ('tip:ux', 'tip:uy')
    """
    if not hasattr(model, "load_combos"):
        raise TypeError(f"model: expected an FEModel3D, got {type(model).__name__}")
    checks.one_of("mass_combo_name", mass_combo_name, model.load_combos)
    checks.one_of("mass_direction", mass_direction, "XYZ")
    g = checks.positive_array("gravity", gravity, 0).item()
    nodes, members = model.nodes.values(), model.members.values()
    numbered = all(node.ID is not None for node in nodes)
    if not numbered or any(mass_combo_name not in m.active for m in members):
        raise ValueError(
            "model: expected an analysed one, whose nodes have numbers; call "
            f"model.analyze_modal(..., {mass_combo_name!r}, ...) after the last change"
        )
    free = {
        6 * node.ID + i: (node.name, DOF_DIRECTIONS[i])
        for node in nodes
        for i, axis in enumerate(PYNITE_AXES)
        if not getattr(node, f"support_{axis}")
        and getattr(node, f"Enforced{axis}") is None
    }
    if not free:
        raise ValueError("model: it has no node with a free DOF")
    try:
        M = model.M(mass_combo_name, mass_direction, g, sparse=True)
    except Exception as error:  # PyNite raises nothing more special
        raise ValueError(
            f"model: {error} Mass is self-weight and loads at nodes of combination "
            f"{mass_combo_name!r} along {mass_direction}: add_member_self_weight or "
            "add_node_load, and add_load_combo"
        ) from error
    K = model.Ke(mass_combo_name, check_stability=False, sparse=True)
    rows = list(free)
    matrices = {name: csc_array(A)[rows][:, rows] for name, A in (("K", K), ("M", M))}
    return Matrices(matrices, np.array([*free.values()]), "PyNite", _locate(model))


def _locate(model: Any) -> Geometry:
    bars = [part for m in model.members.values() for part in m.sub_members.values()]
    bars += model.springs.values()
    lines = [(bar.i_node.name, bar.j_node.name) for bar in bars]
    for plate in (*model.plates.values(), *model.quads.values()):
        corners = plate.i_node, plate.j_node, plate.m_node, plate.n_node, plate.i_node
        lines += pairwise(corner.name for corner in corners)
    places = {node.name: (node.X, node.Y, node.Z) for node in model.nodes.values()}
    return Geometry(places, lines)
