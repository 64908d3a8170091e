"""Matrices of the 3-D Euler-Bernoulli beam element, split by section property.

DOFs of an element: (ux, uy, uz, rx, ry, rz) of its first node, then of its second, in
local axes: x along the bar, y along the part of the orientation vector normal to it.
Each matrix is that of a unit property, so that an element is a sum of products
``property x matrix``; see Przemieniecki, Theory of Matrix Structural Analysis (1968),
sections 5.6 and 11.5 (without shear deformation and rotary inertia of bending).
"""

import numpy as np

from ...interfaces import Floats

AXIAL, TORSION = [0, 6], [3, 9]
BENDING_Y = [1, 5, 7, 11]  # displacement uy, rotation rz = +d uy / dx; resisted by Iz
BENDING_Z = [2, 4, 8, 10]  # displacement uz, rotation ry = -d uz / dx; resisted by Iy
ROTATION_SIGN = np.array([1.0, -1.0, 1.0, -1.0])


def stiffness_matrices(length: float) -> dict[str, Floats]:
    """Return ``(12, 12)`` matrices for unit EA, GJ, EIz and EIy, in local axes."""
    L = length
    rod = np.array([[1.0, -1.0], [-1.0, 1.0]]) / L
    bending = (
        np.array(
            [
                [12.0, 6 * L, -12.0, 6 * L],
                [6 * L, 4 * L**2, -6 * L, 2 * L**2],
                [-12.0, -6 * L, 12.0, -6 * L],
                [6 * L, 2 * L**2, -6 * L, 4 * L**2],
            ]
        )
        / L**3
    )
    return {
        "EA": _place(AXIAL, rod),
        "GJ": _place(TORSION, rod),
        "EIz": _place(BENDING_Y, bending),
        "EIy": _place(BENDING_Z, bending * np.outer(ROTATION_SIGN, ROTATION_SIGN)),
    }


def mass_matrices(length: float) -> dict[str, Floats]:
    """Return consistent ``(12, 12)`` matrices for unit rho A and rho (Iy + Iz)."""
    L = length
    rod = np.array([[2.0, 1.0], [1.0, 2.0]]) * L / 6
    bending = (
        np.array(
            [
                [156.0, 22 * L, 54.0, -13 * L],
                [22 * L, 4 * L**2, 13 * L, -3 * L**2],
                [54.0, 13 * L, 156.0, -22 * L],
                [-13 * L, -3 * L**2, -22 * L, 4 * L**2],
            ]
        )
        * L
        / 420
    )
    return {
        "rhoA": _place(AXIAL, rod)
        + _place(BENDING_Y, bending)
        + _place(BENDING_Z, bending * np.outer(ROTATION_SIGN, ROTATION_SIGN)),
        "rhoI": _place(TORSION, rod),
    }


def local_axes(start: Floats, end: Floats, orientation: Floats) -> tuple[float, Floats]:
    """Return the length and the rotation ``(3, 3)`` whose rows are the local axes.

    Raises:
        ValueError: If the nodes coincide, or orientation is parallel to the bar.
    """
    along = end - start
    length = float(np.linalg.norm(along))
    if length == 0:
        raise ValueError(f"both nodes lie at {start.tolist()}")
    x = along / length
    y = orientation - (orientation @ x) * x
    norm = float(np.linalg.norm(y))
    if norm < 1e-6 * float(np.linalg.norm(orientation)):
        raise ValueError(
            f"the orientation {orientation.tolist()} is parallel to the bar, whose "
            f"direction is {x.tolist()}; give a vector that is not"
        )
    y /= norm
    return length, np.array([x, y, np.cross(x, y)])


def _place(dofs: list[int], block: Floats) -> Floats:
    matrix = np.zeros((12, 12))
    matrix[np.ix_(dofs, dofs)] = block
    return matrix
