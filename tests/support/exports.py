"""A beam as FE programs export it, and its closed form."""

import re
from pathlib import Path

import numpy as np
from scipy import sparse

from .beams import assemble, bending, inertia

LENGTH, EI, MASS = 2.0, 4.2e4, 3.1  # m, N m^2, kg/m
BETA = np.array([1.8751040687, 4.6940911330, 7.8547574382])  # of a cantilever
FREQUENCIES = BETA**2 / LENGTH**2 * np.sqrt(EI / MASS) / (2 * np.pi)
FIRST = 11  # the node at the clamp; the others are numbered upwards by 2


def cantilever(elements=8, left=1.0, right=1.0, clamped=True):
    """Return K, M, DOFs ``(N, 2)``: z (3) and rotation about y (5); E I by halves."""
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


def cell(x, told):
    """Write a number as Fortran does: no E beside three digits of an exponent."""
    width, digits = (23, 16) if "23.16" in told else (16, 9)
    number = re.sub(r"E(?=[-+]\d{3}$)", "", f"{x:.{digits}E}")
    return (number.replace("E", "D") if "D" in told else number).rjust(width)


def op4(name, B, layout="dense", told="1P,3E23.16", kind=2):
    """Return a matrix as OUTPUT4 writes it FORMATTED."""
    n, words, wide = B.shape[1], 2 - kind % 2, 16 if layout == "bigmat 64" else 8
    rows = -len(B) if "bigmat" in layout else len(B)
    text = f"{n:{wide}d}{rows:{wide}d}{6:8d}{kind:8d}{name:8s}{told}\n"
    for j, column in enumerate(B.T, 1):
        there, body, total = np.flatnonzero(column), "", 0
        strings = np.split(there, np.flatnonzero(np.diff(there) > 1) + 1)
        if layout == "dense":
            strings = [np.arange(there[0], there[-1] + 1)]
        for s in strings:
            L, row = words * len(s) + 1, s[0] + 1
            heads = {"dense": [], "sparse": [row + 65536 * L]}
            head = heads.get(layout, [L, row])
            total += L - 1 + len(head)
            body += "".join(f"{x:{wide + 4}d}" for x in head) + "\n" * bool(head)
            per = 80 // len(cell(1.0, told))
            for k in range(0, len(s), per):
                body += "".join(cell(x, told) for x in column[s[k : k + per]]) + "\n"
        first = there[0] + 1 if layout == "dense" else 0
        text += f"{j:{wide}d}{first:{wide}d}{total:{wide}d}\n{body}"
    return text + f"{n + 1:{wide}d}{1:{wide}d}{1:{wide}d}\n{cell(1.0, told)}\n"
