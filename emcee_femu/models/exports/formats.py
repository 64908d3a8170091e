"""Which reader a file is for, by what is in it."""

import re
from collections.abc import Callable
from pathlib import Path

from .part import Part
from .triplets import CALCULIX, read_calculix, read_triplets

NUMBER = r"[-+]?\d*\.?\d+(?:[eEdD][-+]?\d+)?"
HEAD = 4096  # bytes that are looked at
# A line at the beginning of a text file, and who reads it.
LINES: dict[str, Callable[[Path], list[Part]]] = {
    rf"\s*\d+\s+\d+\s+{NUMBER}\s*": read_triplets,
}
LABEL = r"\s*\d+\.\d\s*"  # of a .dof file
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
    first = next((x for x in head.decode("latin-1").splitlines() if x.strip()), "")
    if path.suffix in {*CALCULIX.values(), ".dof"}:
        if re.fullmatch(LABEL, first) or re.fullmatch([*LINES][0], first):
            return read_calculix(path)
    for form, read in LINES.items():
        if re.fullmatch(form, first):
            return read(path)
    what = "binary content" if b"\0" in head else f"line 1: {first[:60]!r}"
    raise ValueError(f"{path}: expected matrices in one of {KNOWN}, got {what}")
