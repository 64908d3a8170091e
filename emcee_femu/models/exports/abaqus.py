"""Abaqus ``*MATRIX OUTPUT``: ``node,dof,node,dof,value``, or ``row,column,value``."""

import re
from pathlib import Path

import numpy as np

from .numbers import read_columns
from .part import Part, build_labelled
from .triplets import read_triplets

# jobname_STIF1.mtx of step 1, and with it jobname_MASS1.mtx
KINDS = {"STIF": "K", "MASS": "M"}
NAMED = re.compile(r"(.*_)(STIF|MASS)(\d*\.\w+)", re.I)


def read_abaqus(path: Path) -> list[Part]:
    """Return the matrices of a step: of this file, and of the one beside it.

    FORMAT=MATRIX INPUT and FORMAT=LABELS have one triangle with the labels of nodes,
    negative for internal ones.
    """
    named = NAMED.fullmatch(path.name)
    if named is None:
        return [_read("", path)]
    other = "MASS" if named[2].upper() == "STIF" else "STIF"
    beside = path.with_name(f"{named[1]}{other}{named[3]}")
    files = {named[2].upper(): path} | ({other: beside} if beside.exists() else {})
    return [_read(KINDS[kind], file) for kind, file in sorted(files.items())[::-1]]


def _read(name: str, path: Path) -> Part:
    with path.open(encoding="latin-1") as file:
        first = next((x for x in file if x.strip() and not x.startswith("*")), "")
    delimiter = "," if "," in first else None
    if len(first.split(delimiter)) == 3:
        return read_triplets(path, delimiter)._replace(name=name)
    form = "node,dof,node,dof,value".replace(",", delimiter or " ")
    labels, values = read_columns(path, form, 4, delimiter)
    pairs = labels.reshape(-1, 2, 2)
    return build_labelled(name, path, pairs[:, 0], pairs[:, 1], np.ravel(values))
