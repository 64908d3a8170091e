"""Files of ``scipy.sparse.save_npz``."""

import zipfile
import zlib
from pathlib import Path

from scipy.sparse import load_npz

from .part import Part, check

DAMAGED = ValueError, KeyError, OSError, EOFError, zipfile.BadZipFile, zlib.error


def read_npz(path: Path) -> list[Part]:
    """Return the matrix of a file that ``scipy.sparse.save_npz`` wrote."""
    try:
        with path.open("rb") as file:  # load_npz leaves it open when it fails
            matrix = load_npz(file)
    except DAMAGED as error:
        raise ValueError(
            f"{path}: no matrix of scipy.sparse.save_npz ({error}); write it again"
        ) from None
    return [Part("", path, check(path, matrix))]
