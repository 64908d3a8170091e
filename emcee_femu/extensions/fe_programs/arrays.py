"""Matrices as NumPy, SciPy, MATLAB and spreadsheets write them."""

import warnings
import zipfile
import zlib
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import loadmat
from scipy.sparse import csc_array, issparse, load_npz

from .entries import AGAIN, Part, check, read_lines, try_part

DAMAGED = ValueError, KeyError, OSError, EOFError, zipfile.BadZipFile, zlib.error
MOST_UNPACKED = 200  # times as many bytes as the file has; matrices shrink tenfold
# A line of at least two numbers.
DENSE = r"\s*[-+]?[.,]?\d[-+\d.,eE]*(?:\s*[,;\s]\s*[-+]?[.,]?\d[-+\d.,eE]*)+\s*"


def read_npz(path: Path) -> list[Part]:
    """Return the matrices of a file of ``scipy.sparse.save_npz`` or ``numpy.savez``."""
    try:
        with path.open("rb") as file:  # load_npz leaves it open when it fails
            unpacked = sum(part.file_size for part in zipfile.ZipFile(file).filelist)
            if unpacked > MOST_UNPACKED * path.stat().st_size + 1e9:
                raise ValueError(f"its {unpacked:.1e} bytes are a bomb")
            named = np.load(file)
            if "format" not in named:
                return _choose_square(path, {**named})
            matrix = load_npz(file)
        if matrix.format in ("csr", "csc", "bsr"):  # else converting them crashes
            matrix.check_format(full_check=True)
    except DAMAGED as error:
        raise ValueError(
            f"{path}: expected matrices of numpy.savez or scipy.sparse.save_npz, got "
            f"{error}; write it again"
        ) from None
    return [Part("", path, check(path, matrix))]


def read_npy(path: Path) -> list[Part]:
    """Return the matrix that ``numpy.save`` wrote."""
    try:
        matrix = np.load(path)
    except DAMAGED as error:
        raise ValueError(
            f"{path}: expected a matrix of numpy.save, got {error}; write it again"
        ) from None
    (part,) = _choose_square(path, {"": matrix})
    return [part]


def read_mat(path: Path) -> list[Part]:
    """Return the square matrices of a MATLAB or Octave file, by their names there.

    Fields of a structure are read as variables of the file are.

    Raises:
        ValueError: If it holds none, or is damaged.
    """
    try:
        with warnings.catch_warnings():  # either kind of sparse matrix will do
            warnings.filterwarnings("ignore", ".*spmatrix", DeprecationWarning)
            named = loadmat(path)
    except Exception as error:  # what a damaged file raises there is of any kind
        raise ValueError(
            f"{path}: expected a MATLAB file of version 4 to 7, got "
            f"{type(error).__name__} {error}; {AGAIN}, by save -v7"
        ) from None
    fields: dict[str, Any] = {}
    for value in named.values():  # of one level, as model.K and model.M
        if np.shape(value) == (1, 1):
            fields |= {name: value[name][0, 0] for name in value.dtype.names or ()}
    return _choose_square(path, fields | named)


def read_dense(path: Path) -> list[Part]:
    """Return the matrix of a table of numbers, one line a row, as spreadsheets save it.

    Columns are separated by commas, semicolons, tabs or blanks; with semicolons or
    tabs, a comma is the decimal mark.

    Raises:
        ValueError: If a line is of another length, or has other than numbers.
    """
    rows: list[list[float]] = []
    for number, line in enumerate(read_lines(path), 1):
        if not line.strip():
            continue
        if mark := next((mark for mark in ";\t" if mark in line), ""):
            cells = line.replace(",", ".").split(mark)
        else:
            cells = line.split("," if "," in line else None)
        try:
            rows.append([float(cell) for cell in cells])
        except ValueError:
            raise ValueError(
                f"{path}, line {number}: expected numbers alone, got {line[:60]!r}; "
                "leave out titles of rows and columns"
            ) from None
        if len(cells) != len(rows[0]):
            raise ValueError(
                f"{path}, line {number}: expected {len(rows[0])} numbers, as in the "
                f"first line, got {len(cells)}; {AGAIN}"
            )
    (part,) = _choose_square(path, {"": np.array(rows)})
    return [part]


def _choose_square(path: Path, named: Mapping[str, Any]) -> list[Part]:
    """Return the square ones of named arrays; numbers only where nothing else is."""
    square = {}
    for name, value in named.items():
        array = value if issparse(value) else np.asarray(value)
        if array.ndim == 2 and array.shape[0] == array.shape[1] > 0:
            if array.dtype.kind in "iufc":
                square[name] = array
    if not square:
        shapes = {
            name: np.shape(value)
            for name, value in named.items()
            if not name.startswith("__")  # what loadmat adds
        }
        cure = AGAIN
        if shapes:
            cure = (
                "measured modes are Measurements(frequencies, shapes), with arrays of "
                f"scipy.io.loadmat; or {AGAIN}"
            )
        raise ValueError(
            f"{path}: expected square matrices of numbers, got {shapes}; {cure}"
        )
    larger = {name: array for name, array in square.items() if array.shape[0] > 1}
    return [
        try_part(name, path, partial(_build, path, name, array))
        for name, array in (larger or square).items()
    ]


def _build(path: Path, name: str, array: Any) -> Part:
    label = f"{path}, {name}" if name else str(path)
    if issparse(array) and np.iscomplexobj(array):
        raise ValueError(f"{label}: expected real numbers, got complex ones")
    return Part(name, path, check(label, csc_array(array)))
