"""ANSYS ``.full`` files, read by PyMAPDL-Reader."""

import importlib
from pathlib import Path

import numpy as np
from scipy.sparse import csc_array, diags_array

from .numbers import AGAIN
from .part import Part, check


def read_full(path: Path) -> list[Part]:
    """Return stiffness and mass without held DOFs, whose rows are empty there.

    Raises:
        ImportError: If the reader is not installed.
        ValueError: If it cannot read the file.
    """
    try:
        reader = importlib.import_module("ansys.mapdl.reader")
    except ImportError as error:
        raise ImportError(
            f"{path}: a .full file of ANSYS needs PyMAPDL-Reader ({error}); pip "
            "install 'emcee_femu[ansys]', or let ANSYS write Matrix Market files: "
            "*SMAT,K,D,IMPORT,FULL,file.full,STIFF and *EXPORT,K,MMF,K.mtx"
        ) from error
    try:
        file = reader.read_binary(str(path))
        dofs, *triangles = file.load_km(sort=True)
        held = {tuple(dof) for dof in np.asarray(file.const).tolist()}
    except Exception as error:  # what a damaged file raises there is of any kind
        raise ValueError(f"{path}: {type(error).__name__} {error}; {AGAIN}") from error
    free = np.array([tuple(dof) not in held for dof in dofs.tolist()])
    labels = dofs[free].astype(np.int64) + np.array([0, 1], dtype=np.int64)
    parts = []
    for name, triangle in zip("KM", triangles, strict=True):
        if triangle is not None:
            upper = csc_array(triangle)[free][:, free]
            full = upper + upper.T - diags_array(upper.diagonal())
            parts.append(Part(name, path, check(path, full), labels))
    return parts
