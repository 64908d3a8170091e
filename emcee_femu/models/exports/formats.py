"""Which reader a file is for, by what is in it."""

import re
from collections.abc import Callable
from pathlib import Path

from .abaqus import read_abaqus
from .ansys import read_full
from .dmig import read_dmig
from .matrix_market import read_matrix_market
from .op4 import HEADER, read_op4
from .part import Part
from .scipy_npz import read_npz
from .triplets import CALCULIX, read_calculix

Read = Callable[[Path], list[Part]]
HEAD = 4096  # bytes that are looked at
INTEGER, NUMBER = r"\s*-?\d+\s*", r"\s*[-+]?[\d.]+(?:[ED][-+]?\d+)?\s*"
TRIPLET = rf"\s*\d+ +\d+ {NUMBER}"
# How the first line of a text file begins that is no comment, and who reads it.
TEXTS: dict[str, Read] = {
    r"%%MatrixMarket\b.*": read_matrix_market,
    HEADER.pattern: read_op4,
    TRIPLET: read_abaqus,
    rf"{INTEGER},{INTEGER},{NUMBER}": read_abaqus,
    rf"{INTEGER},{INTEGER},{INTEGER},{INTEGER},{NUMBER}": read_abaqus,
    rf"\s*-?\d+ +\d+ +-?\d+ +\d+ {NUMBER}": read_abaqus,
}
BINARIES: dict[bytes, Read] = {  # the first bytes
    rb"PK\x03\x04.*": read_npz,
    rb".{8}\x04\0\0\0.*": read_full,
}
LABEL = r"\s*\d+\.\d+\s*"  # of a .dof file
KNOWN = (
    "Matrix Market, scipy.sparse.save_npz, Abaqus *MATRIX OUTPUT, CalculiX "
    ".sti .mas .dof, Nastran DMIG and ASCII OP4, ANSYS .full"
)


def read_file(path: Path) -> list[Part]:
    """Return the matrices of a file, and of those that the program wrote with it.

    Raises:
        FileNotFoundError: If there is no such file.
        ValueError: If its content is none of the known formats, or damaged.
    """
    with path.open("rb") as file:
        head = file.read(HEAD)
    if not head:
        raise ValueError(f"{path}: the file is empty; did the program stop early?")
    if b"\0" in head:
        for start, read in BINARIES.items():
            if re.fullmatch(start, head, re.S):
                return read(path)
    lines = head.decode("latin-1").splitlines()
    told = (x for x in lines if x.strip() and x[0] not in "$*")
    first = next(told, lines[0])
    if path.suffix.lower() in {*CALCULIX.values(), ".dof"}:
        if re.fullmatch(f"{LABEL}|{TRIPLET}", first, re.I):
            return read_calculix(path)
    for form, read in TEXTS.items():
        if re.fullmatch(form, first, re.I):
            return read(path)
    if re.search(rb"^DMIG[*, ]", path.read_bytes(), re.M | re.I):
        return read_dmig(path)  # grid points and others may come first
    what = "binary content" if b"\0" in head else f"line {lines.index(first) + 1}: "
    what += "" if b"\0" in head else repr(first[:60])
    raise ValueError(f"{path}: expected matrices in one of {KNOWN}; got {what}")
