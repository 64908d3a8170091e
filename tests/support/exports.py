"""A beam as FE programs export it, and its closed form."""

from pathlib import Path

import numpy as np
from scipy import sparse

from .beams import assemble, bending, inertia

LENGTH, EI, MASS = 2.0, 4.2e4, 3.1  # m, N m^2, kg/m
BETA = np.array([1.8751040687, 4.6940911330, 7.8547574382])  # of a cantilever
FREQUENCIES = BETA**2 / LENGTH**2 * np.sqrt(EI / MASS) / (2 * np.pi)
FIRST = 11  # the node at the clamp; the others are numbered upwards by 2


def cantilever(elements=8, left=1.0, right=1.0, clamped=True):
    """Return K, M and ``dofs (N, 2)``: z (3) and rotation about y (5) of each node.

    ``left`` and ``right`` are factors of E I in the two halves of the beam.
    """
    L, halves = LENGTH / elements, np.array_split(np.arange(elements), 2)
    K = left * assemble(bending(L), elements, halves[0])
    K += right * assemble(bending(L), elements, halves[1])
    M, turn = assemble(inertia(L), elements), np.tile([1.0, -1.0], elements + 1)
    K, M = EI * turn[:, None] * K * turn, MASS * turn[:, None] * M * turn
    size = len(K)
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
        Path(folder, f"{job}.{end}").write_text("".join(lines), encoding="utf-8")
    labels = "".join(f"{node}.{direction}\n" for node, direction in dofs)
    Path(folder, f"{job}.dof").write_text(labels, encoding="utf-8")
    return Path(folder, f"{job}.sti")


def write_abaqus(folder, K, M, dofs, form="matrix input", job="beam", step=1):
    """Write the files of ``*MATRIX OUTPUT, STIFFNESS, MASS, FORMAT=...``."""
    for kind, matrix in (("STIF", K), ("MASS", M)):
        lines = []
        for j, i, x in zip(*upper(matrix), strict=True):  # the lower triangle
            (a, b), (c, d) = dofs[i], dofs[j]
            if form == "coordinate":
                lines.append(f"{i + 1:8d} {j + 1:8d} {x:22.15e}\n")
                if i != j:
                    lines.append(f"{j + 1:8d} {i + 1:8d} {x:22.15e}\n")
            elif form == "labels":
                lines.append(f"{a:8d} {b:4d} {c:8d} {d:4d} {x:22.15e}\n")
            else:
                lines.append(f"{a},{b}, {c},{d}, {x:.15e}\n")
        Path(folder, f"{job}_{kind}{step}.mtx").write_text(
            "".join(lines), encoding="utf-8"
        )
    return Path(folder, f"{job}_STIF{step}.mtx")


def write_dmig(path, K, M, dofs):
    """Write the punch file of ``PARAM,EXTOUT,DMIGPCH``: K, M and a load."""
    lines = ["$TITLE   = CANTILEVER\n", "GRID          11               0.      0.\n"]
    for name, matrix in (("KAAX", K), ("MAAX", M)):
        lines.append(f"DMIG    {name}{0:12d}{6:8d}{2:8d}{0:8d}{len(K):24d}\n")
        last = None
        for i, j, x in zip(*upper(matrix), strict=True):
            if j != last:
                lines.append(f"DMIG*   {name:16s}{dofs[j][0]:16d}{dofs[j][1]:16d}\n")
            last = j
            value = f"{x:16.9E}".replace("E", "D")
            lines.append(f"*       {dofs[i][0]:16d}{dofs[i][1]:16d}{value}\n")
    lines.append(f"DMIG    VAX {0:12d}{9:8d}{2:8d}{0:8d}{1:24d}\n")
    lines.append(f"DMIG*   {'VAX':16s}{1:16d}{0:16d}\n")
    lines.append(f"*       {11:16d}{3:16d} 1.000000000D+00\n")
    Path(path).write_text("".join(lines), encoding="utf-8")
    return Path(path)


def write_op4(path, form, **matrices):
    """Write ASCII OUTPUT4: form is dense, sparse (strings) or bigmat."""
    lines = []
    for name, A in matrices.items():
        n, rows = A.shape[1], -len(A) if form == "bigmat" else len(A)
        lines.append(f"{n:8d}{rows:8d}{6:8d}{2:8d}{name:8s}1P,3E23.16\n")
        for j, column in enumerate(A.T, 1):
            there = np.flatnonzero(column)
            if form == "dense":
                strings = [np.arange(there[0], there[-1] + 1)]
                lines.append(f"{j:8d}{there[0] + 1:8d}{2 * len(strings[0]):8d}\n")
            else:
                strings = np.split(there, np.flatnonzero(np.diff(there) > 1) + 1)
                extra = 2 if form == "bigmat" else 1
                words = sum(2 * len(s) + extra for s in strings)
                lines.append(f"{j:8d}{0:8d}{words:8d}\n")
            for s in strings:
                L = 2 * len(s) + 1
                if form == "bigmat":
                    lines.append(f"{L:8d}{s[0] + 1:8d}\n")
                elif form == "sparse":
                    lines.append(f"{s[0] + 1 + 65536 * L:12d}\n")
                cells = [f"{x:23.16E}" for x in column[s]]
                triples = ["".join(cells[k : k + 3]) for k in range(0, len(cells), 3)]
                lines += [triple + "\n" for triple in triples]
        lines += [f"{n + 1:8d}{1:8d}{1:8d}\n", f"{1.0:23.16E}\n"]
    Path(path).write_text("".join(lines), encoding="utf-8")
    return Path(path)
