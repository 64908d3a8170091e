"""A beam as FE programs export it, and its closed form."""

from pathlib import Path

import numpy as np
from scipy import sparse

LENGTH, EI, MASS = 2.0, 4.2e4, 3.1  # m, N m^2, kg/m
BETA = np.array([1.8751040687, 4.6940911330, 7.8547574382])  # of a cantilever
FREQUENCIES = BETA**2 / LENGTH**2 * np.sqrt(EI / MASS) / (2 * np.pi)
FIRST = 11  # the node at the clamp; the others are numbered upwards by 2


def cantilever(elements=8, left=1.0, right=1.0, clamped=True):
    """Return K, M and ``dofs (N, 2)``: z (3) and rotation about y (5) of each node.

    ``left`` and ``right`` are factors of E I in the two halves of the beam.
    """
    L = LENGTH / elements
    k = np.array(
        [
            [12, -6 * L, -12, -6 * L],
            [-6 * L, 4 * L**2, 6 * L, 2 * L**2],
            [-12, 6 * L, 12, 6 * L],
            [-6 * L, 2 * L**2, 6 * L, 4 * L**2],
        ]
    )
    m = np.array(
        [
            [156, -22 * L, 54, 13 * L],
            [-22 * L, 4 * L**2, -13 * L, -3 * L**2],
            [54, -13 * L, 156, 22 * L],
            [13 * L, -3 * L**2, 22 * L, 4 * L**2],
        ]
    )
    size = 2 * elements + 2
    K, M = np.zeros((size, size)), np.zeros((size, size))
    for i in range(elements):
        own = slice(2 * i, 2 * i + 4)
        factor = left if i < elements / 2 else right
        K[own, own] += factor * EI / L**3 * k
        M[own, own] += MASS * L / 420 * m
    dofs = np.array([(FIRST + 2 * (i // 2), (3, 5)[i % 2]) for i in range(size)])
    free = slice(2 if clamped else 0, None)
    return K[free, free], M[free, free], dofs[free]


def upper(matrix):
    """Return rows, columns and values of the upper triangle, column by column."""
    found = sparse.coo_array(np.triu(matrix))
    order = np.lexsort((found.row, found.col))
    return found.row[order], found.col[order], found.data[order]


def write_calculix(folder, K, M, dofs, job="beam"):
    """Write the three files of ``*FREQUENCY, SOLVER=MATRIXSTORAGE``."""
    for end, matrix in (("sti", K), ("mas", M)):
        entries = zip(*upper(matrix), strict=True)
        lines = [f"{i + 1} {j + 1} {x:20.13e}\n" for i, j, x in entries]
        Path(folder, f"{job}.{end}").write_text("".join(lines))
    labels = "".join(f"{node}.{direction}\n" for node, direction in dofs)
    Path(folder, f"{job}.dof").write_text(labels)
    return Path(folder, f"{job}.sti")
