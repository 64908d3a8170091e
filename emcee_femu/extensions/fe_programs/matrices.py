"""Files of stiffness and mass matrices, and how they are joined on the same rows."""

from collections.abc import Collection, Mapping
from os import PathLike
from pathlib import Path

import numpy as np
from scipy.sparse import csc_array

from ... import checks
from ...models.matrices import warn_of_uncoupled
from .entries import AGAIN, Part
from .exports import Matrices, write_name
from .formats import read_file, read_labels

FilePath = str | PathLike[str]
HELD = 1e35  # Abaqus puts 1e36 on the diagonal of DOFs that a boundary holds
LABELS = "dofs"  # key of the file of labels among the matrices


def read_matrices(path: FilePath | Mapping[str, FilePath]) -> Matrices:
    """Read stiffness and mass matrices exported by an FE program, with row labels.

    Use it to make a :class:`MatrixModel` from an FE program's files. The format is
    recognised from the content: Matrix Market, MATLAB ``.mat`` up to version 7,
    ``numpy.save`` and ``savez``, ``scipy.sparse.save_npz``, CSV tables of numbers,
    Abaqus ``*MATRIX OUTPUT``, CalculiX ``.sti .mas .dof``, Nastran DMIG and ASCII OP4,
    Harwell-Boeing (HBMAT of ANSYS), ANSYS ``.full``. Rows keep the program's order. If
    the mass matrix was written without massless DOFs, it is filled up with rows of
    zeros. In a file with many matrices, only K and M must be valid; others that are not
    symmetric or not real, or have other rows, such as mode shapes, are left out.

    Args:
        path: One file; further files of a CalculiX or Abaqus job are found beside it.
            If each file holds one matrix and does not say which,
            ``{"K": path, "M": path}``; ``"dofs"`` may be added for a file of labels,
            with a line such as ``12.3`` (node.direction, 1 to 6) for each row.

    Returns:
        K, M and other matrices in the files, sparse, with the names of the DOFs.

    Raises:
        TypeError: If path is neither a file name nor ``{name: file name}``.
        FileNotFoundError: If there is no such file.
        ValueError: If a file is damaged, in another format, or not of this model; the
            message names the file, the line and the remedy.
        ImportError: If the format needs a package that is not installed.

    Warns:
        UserWarning: If rows with mass are not coupled to any other, as for held DOFs.

    Examples:
        >>> from pathlib import Path
        >>> from tempfile import TemporaryDirectory
        >>> from scipy.io import mmwrite
        >>> from emcee_femu import read_matrices
        >>> with TemporaryDirectory() as folder:
        ...     files = {"K": Path(folder, "K.mtx"), "M": Path(folder, "M.mtx")}
        ...     for path in files.values():
        ...         mmwrite(path, [[3.0, -1.0], [-1.0, 1.0]])
        ...     read_matrices(files).K.toarray().tolist()
        [[3.0, -1.0], [-1.0, 1.0]]
    """
    if isinstance(path, Mapping):
        files = {
            name: Path(checks.file_name(f"path[{name!r}]", given))
            for name, given in checks.by_label("path", path, "files").items()
        }
        labels = files.pop(LABELS, None)
        if not files:
            raise ValueError(
                "path: expected files by the names of their matrices, such as "
                f"{{'K': path, 'M': path}}, got {path!r}"
            )
        parts, asked = [], [*files]
        dofs = None if labels is None else read_labels(labels)
        for name, file in files.items():
            held = read_file(file)
            chosen = [part for part in held if len(held) == 1 or part.name == name]
            if len(chosen) != 1:
                raise ValueError(
                    f"{file}: expected one matrix, or one named {name}, got "
                    f"{[part.name for part in held]}"
                )
            own = chosen[0].dofs
            if not (own is None or dofs is None or np.array_equal(own, dofs)):
                raise ValueError(
                    f"path['{LABELS}']: {file} has its own row labels, and those of "
                    f"{labels} differ; leave it out"
                )
            rows = dofs if own is None else own
            parts.append(chosen[0]._replace(name=name, dofs=rows))
        source = ", ".join(file.name for file in files.values())
    else:
        file = Path(checks.file_name("path", path))
        parts, source = read_file(file), file.name
        if "" in (part.name for part in parts):
            raise ValueError(
                f"{file}: this format does not say which matrix it holds; write "
                "read_matrices({'K': path, 'M': path})"
            )
        asked = ["K", "M"]
    read = _join(parts, source, asked)
    if {"K", "M"} <= {*read.matrices}:
        warn_of_uncoupled([read.K], [read.M], read.labels)
    return read


def _join(parts: list[Part], source: str, asked: Collection[str]) -> Matrices:
    """Return matrices of the same rows: those of K, or of the largest.

    Others than those asked for are left out if they cannot be read, or have other rows.

    Raises:
        ValueError: If one that is asked for is such a one, or a row lacks its diagonal
            that is no constraint.
    """
    for part in parts:
        if part.fault and (part.name in asked or all(one.fault for one in parts)):
            raise ValueError(part.fault)
    good = [part for part in parts if not part.fault]
    first = max(good, key=lambda part: (part.name == "K", part.matrix.shape[0]))
    matrices = {}
    for part in good:
        try:
            matrices[part.name] = _at_rows(part, first)
        except ValueError:
            if part.name in asked:
                raise
    for part in good:
        if part.name in ("K", "M"):
            _check_diagonal(part, matrices)
    free = np.flatnonzero(first.matrix.diagonal() < HELD)
    if len(free) == first.matrix.shape[0]:
        return Matrices(matrices, first.dofs, source)
    if first.dofs is None:
        raise ValueError(
            f"{first.path}: {first.matrix.shape[0] - len(free)} rows are held by a "
            f"stiffness above {HELD:g}; export with labels (FORMAT=MATRIX INPUT), so "
            "that they can be left out"
        )
    kept = {name: csc_array(matrix[free][:, free]) for name, matrix in matrices.items()}
    return Matrices(kept, first.dofs[free], source)


def _check_diagonal(part: Part, matrices: Mapping[str, csc_array]) -> None:
    """Raise ValueError where a row of K or M has entries, but none on the diagonal.

    Formats without an end mark are cut at the end of a line. In K it may be a
    constraint by a Lagrange multiplier, which has no mass.
    """
    matrix = matrices[part.name]
    lone = (matrix.diagonal() == 0) & (np.diff(matrix.indptr) > 0)
    constraint = part.name == "K" and "M" in matrices
    if constraint:
        lone &= matrices["M"].diagonal() != 0
    if lone.any():
        raise ValueError(
            f"{part.path}: row {int(np.argmax(lone)) + 1} of {part.name} has entries, "
            f"but none on the diagonal: the file ends early; {AGAIN}"
            + "; if it is a constraint by a Lagrange multiplier, read M with it"
            * (part.name == "K" and not constraint)
        )


def _at_rows(part: Part, first: Part) -> csc_array:
    """Return a matrix with the rows of another, zero for those that it has not.

    Programs leave out DOFs without mass.
    """
    size, own, every = first.matrix.shape[0], part.dofs, first.dofs
    count, told = size, f"{first.path} has {size}"
    if own is not None and every is not None:
        count, told = len(own), f"{len(own)} labels"
    if part.matrix.shape[0] != count:
        raise ValueError(
            f"{part.path}: a matrix of {part.matrix.shape[0]} rows, but {told}; are "
            "they of the same job?"
        )
    if own is None or every is None or np.array_equal(own, every):
        return part.matrix
    place = {tuple(dof): i for i, dof in enumerate(every.tolist())}
    dofs = [tuple(dof) for dof in own.tolist()]
    unknown = [write_name(*dof) for dof in dofs if dof not in place]
    if unknown:
        raise ValueError(
            f"{part.path}: {len(unknown)} DOFs, such as {unknown[0]}, are not in "
            f"{first.name} of {first.path}; are the files from the same job?"
        )
    rows = [place[dof] for dof in dofs]
    there = (np.ones(len(dofs)), (rows, range(len(dofs))))
    selection = csc_array(there, shape=(size, len(dofs)))
    return csc_array(selection @ part.matrix @ selection.T)
