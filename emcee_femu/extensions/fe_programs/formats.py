"""Which reader a file is for, by what is in it; all readers but those of Nastran."""

import importlib
import re
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from scipy.sparse import csc_array, diags_array

from .arrays import DENSE, read_dense, read_mat, read_npy, read_npz
from .entries import (
    AGAIN,
    Dofs,
    Part,
    build_labelled,
    build_matrix,
    check,
    read_cells,
    read_columns,
    read_lines,
    try_part,
)
from .nastran import OP4_HEADER, read_dmig, read_op4

Read = Callable[[Path], list[Part]]
# jobname_STIF1.mtx of step 1, and with it jobname_MASS1.mtx
HARWELL_BOEING_KINDS = {"STIF": "K", "MASS": "M"}
NAMED = re.compile(r"(.*_)(STIF|MASS)(\d*\.\w+)", re.I)
MARKET = re.compile(
    r"%%\w+\s+matrix\s+(coordinate|array)\s+(?:real|double|integer)\s+"
    r"(general|symmetric)\s*",
    re.I,
)
# Of *FREQUENCY, SOLVER=MATRIXSTORAGE: jobname.sti, jobname.mas and jobname.dof.
CALCULIX = {"K": ".sti", "M": ".mas"}


def read_abaqus(path: Path) -> list[Part]:
    """Return the matrices of a step: of this file, and of the one beside it.

    FORMAT=MATRIX INPUT and FORMAT=LABELS have one triangle with the labels of nodes,
    negative for internal ones.
    """
    named = NAMED.fullmatch(path.name)
    if named is None:
        return [_read_part(path)]
    other = "MASS" if named[2].upper() == "STIF" else "STIF"
    beside = path.with_name(f"{named[1]}{other}{named[3]}")
    files = {named[2].upper(): path} | ({other: beside} if beside.exists() else {})
    return [
        try_part(HARWELL_BOEING_KINDS[kind], file, partial(_read_part, file))
        for kind, file in sorted(files.items())[::-1]
    ]


def _read_part(path: Path) -> Part:
    with path.open(encoding="latin-1") as file:
        first = next((x for x in file if x.strip() and not x.startswith("*")), "")
    delimiter = "," if "," in first else None
    if len(first.split(delimiter)) == 3:
        return read_triplets(path, delimiter)
    form = "node,dof,node,dof,value".replace(",", delimiter or " ")
    labels, values = read_columns(path, form, 4, delimiter)
    return build_labelled("", path, labels.reshape(-1, 2, 2), values[:, 0])


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
            "install ansys-mapdl-reader, or let ANSYS write Matrix Market files: "
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


def read_matrix_market(path: Path) -> list[Part]:
    """Return the matrix of a Matrix Market file, general or symmetric.

    Raises:
        ValueError: If it is complex or a pattern, or has other entries than it says.
            (``scipy.io.mmread`` of version 1.17 crashes the interpreter on such files.)
    """
    lines = read_lines(path)
    header = MARKET.fullmatch(lines[0])
    if header is None:
        raise ValueError(
            f"{path}, line 1: expected a matrix of real numbers, general or symmetric, "
            f"got {lines[0]!r}"
        )
    coordinate, symmetric = (header[i].lower()[0] in "cs" for i in (1, 2))
    skip = next((i for i, x in enumerate(lines) if x[:1] != "%" and x.strip()), 0)
    sizes = lines[skip].split()
    if len(sizes) != 2 + coordinate or not all(map(str.isdecimal, sizes)):
        raise ValueError(
            f"{path}, line {skip + 1}: expected the numbers of rows, columns"
            f"{' and entries' if coordinate else ''}, got {lines[skip]!r}; {AGAIN}"
        )
    rows, columns = map(int, sizes[:2])
    if rows != columns:
        raise ValueError(f"{path}: expected a square matrix, got {rows} by {columns}")
    if coordinate:
        count = int(sizes[2])
        places, values = read_columns(path, "row column value", 2, skip=skip + 1)
        i, j = places.T - 1
    else:
        count = rows * (rows + 1) // 2 if symmetric else rows**2
        _, values = read_columns(path, "value", 0, skip=skip + 1)
        filled = rows if len(values) == count else 0  # 1e9 rows are only announced
        j, i = np.triu_indices(filled)
        if not symmetric:
            j, i = np.divmod(np.arange(filled**2), max(filled, 1))
    if len(values) != count or max(i.max(initial=0), j.max(initial=0)) >= rows:
        raise ValueError(
            f"{path}: expected {count} entries of {rows} rows, as line {skip + 1} "
            f"says, got {len(values)}, up to row {i.max(initial=0) + 1}; {AGAIN}"
        )
    matrix = build_matrix(path, i, j, values[:, 0], rows, mirror=symmetric)
    return [Part("", path, matrix)]


def read_harwell_boeing(path: Path) -> list[Part]:
    """Return the matrix of a Harwell-Boeing or Rutherford-Boeing file, as of HBMAT.

    Raises:
        ValueError: If it is no assembled real matrix, or its numbers do not agree.
    """
    lines = read_lines(path)
    kind, *sizes = re.split(r" +", lines[2].strip())
    if kind.upper() not in ("RSA", "RUA"):
        raise ValueError(
            f"{path}, line 3: expected an assembled real matrix, RSA or RUA, got "
            f"{kind}; write that, or Matrix Market"
        )
    size, entries = int(sizes[0]), int(sizes[2])
    try:
        counts = [int(count) for count in lines[1].split()]
        at = 5 if sum(counts[4:]) else 4  # a line on right-hand sides
        widths = re.findall(r"[DEFGI](\d+)", lines[3].upper())
        numbers = []
        for count, width in zip(counts[1:4], map(int, widths[:3]), strict=True):
            every = [read_cells(x, width) for x in lines[at : at + count]]
            numbers.append(np.array([number for cells in every for number in cells]))
            at += count
        whole = np.concatenate(numbers[:2])
        if not (abs(whole) <= max(size, entries + 1)).all() or (whole % 1).any():
            raise ValueError
        pointers, rows = (x.astype(np.int64) for x in numbers[:2])
        columns = np.repeat(np.arange(size), np.diff(pointers))
        counted = len(rows) == len(columns) == len(numbers[2]) == entries
        if not counted or pointers[0] != 1 or rows.max() > size:
            raise ValueError
    except (ValueError, IndexError):
        raise ValueError(
            f"{path}: expected numbers in the formats of line 4, as many as lines 2 "
            f"and 3 say, {entries} entries in {size} columns; {AGAIN}"
        ) from None
    mirror = kind.upper() == "RSA"
    matrix = build_matrix(path, rows - 1, columns, numbers[2], size, mirror=mirror)
    return [Part("", path, matrix)]


def read_triplets(
    path: Path, delimiter: str | None = None, size: int | None = None
) -> Part:
    """Return the matrix of a file, the lower or upper triangle of it or both.

    Raises:
        ValueError: If the matrix is not of ``size``, or the last of its entries is not
            in the last row and column, where CalculiX always ends.
    """
    form = "row column value".replace(" ", delimiter or " ")
    places, values = read_columns(path, form, 2, delimiter)
    if size is not None and places[-1].tolist() != [size, size]:
        raise ValueError(
            f"{path}: expected the last line to be row {size}, column {size}, as there "
            f"are {size} labels in the .dof file, got {places[-1].tolist()}; {AGAIN}"
        )
    rows, columns = places.T - 1
    return Part("", path, build_matrix(path, rows, columns, values[:, 0]))


def read_labels(path: Path) -> Dofs:
    """Return node and direction of each row from lines ``node.direction``.

    Raises:
        ValueError: If a line is no label.
    """
    return read_columns(path, "node.direction", 2, delimiter=".")[0]


def read_calculix(path: Path) -> list[Part]:
    """Return K and M of a job, given any of its three files.

    Raises:
        ValueError: If one of the files is missing or damaged, or they differ in size,
            as those of a cyclic symmetry do (its matrices are complex).
    """
    files = {name: path.with_suffix(end) for name, end in CALCULIX.items()}
    labels = path.with_suffix(".dof")
    for file in (*files.values(), labels):
        if not file.exists():
            raise ValueError(
                f"{path}: {file.name} is missing beside it, which CalculiX writes "
                "with it; copy it there, or let CalculiX export all three again"
            )
    dofs = read_labels(labels)
    parts = [
        try_part(name, file, partial(read_triplets, file, size=len(dofs)))
        for name, file in files.items()
    ]
    return [part._replace(dofs=dofs) for part in parts]


HEAD = 4096  # bytes that are looked at
# The first line of a text file that is no comment, and who reads it. Of Abaqus it has
# row and column, or node and direction of both, and a value.
TEXTS: dict[str, Read] = {
    r"%%MatrixMarket\b.*": read_matrix_market,
    OP4_HEADER.pattern: read_op4,
    r"\s*(?:-?\d+\s*[ ,]\s*){2}(?:(?:-?\d+\s*[ ,]\s*){2})?[^\s,]+\s*": read_abaqus,
    DENSE: read_dense,
}
# The third line of Harwell-Boeing: type, and numbers of rows, columns and entries.
BOEING = r"[RCPIQ][SUHZR][AE]\s+\d+\s+\d+\s+\d+(\s+\d+)?\s*"
# A Fortran record of 24 or, with long integers, 48 bytes, either end of a number first.
OP4 = rb"(\x18\0\0\0|\0\0\0\x18).{24}\1.*|(\x30\0\0\0|\0\0\0\x30).{48}\2.*"
BINARIES: dict[bytes, Read] = {  # the first bytes
    rb"PK\x03\x04.*": read_npz,
    rb"\x93NUMPY.*": read_npy,
    rb"MATLAB 5\.0 MAT-file.*": read_mat,
    rb".{8}\x04\0\0\0.*": read_full,
}
KNOWN_FORMATS = (
    "Matrix Market, Harwell-Boeing, MATLAB .mat, NumPy .npy .npz, CSV, Abaqus *MATRIX "
    "OUTPUT, CalculiX .sti .mas .dof, Nastran DMIG and ASCII OP4, ANSYS .full"
)
HDF5 = rb"(MATLAB 7\.3 |\x89HDF\r\n\x1a\n).*"
LIBRARIES = {  # that read matrices from other files, by their suffix
    ".op2": "pyNastran",
    ".h5": "h5py",
    ".hdf5": "h5py",
    ".csv": "pandas.read_csv",
    ".xls": "pandas.read_excel",
    ".xlsx": "pandas.read_excel",
    ".rst": "PyMAPDL-Reader",
    ".emat": "PyMAPDL-Reader",
}


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
    if re.fullmatch(OP4, head, re.S):
        raise ValueError(
            f"{path}: a binary OUTPUT4 file of Nastran is not read; write it as text, "
            f"ASSIGN OUTPUT4='{path.name}',UNIT=11,FORM=FORMATTED"
        )
    suffix = path.suffix.lower()
    if suffix == ".mat" and re.fullmatch(HDF5, head, re.S):
        raise ValueError(
            f"{path}: a MATLAB file of version 7.3, which scipy does not read; write "
            f"save('{path.name}', 'K', 'M', '-v7') in MATLAB, or read it by h5py and "
            "give the arrays to MatrixModel"
        )
    if b"\0" in head and suffix not in LIBRARIES:
        for start, read in BINARIES.items():
            if re.fullmatch(start, head, re.S):
                return read(path)
        if suffix == ".mat":  # of version 4, which has no name of its own
            return read_mat(path)
    lines = head.decode("latin-1").splitlines()
    if len(lines) > 3 and re.fullmatch(BOEING, lines[2], re.I):
        return read_harwell_boeing(path)
    told = (x for x in lines if x.strip() and x[0] not in "$*")
    first = next(told, lines[0])
    if suffix == ".csv" and re.fullmatch(DENSE, first):  # it may look like Abaqus's
        return read_dense(path)
    if suffix in {*CALCULIX.values(), ".dof"}:
        if re.fullmatch(r"\s*\d+(\.\d+\s*| +\d+ .*)", first):  # a label, or an entry
            return read_calculix(path)
    for form, read in TEXTS.items():
        if re.fullmatch(form, first, re.I):
            return read(path)
    if re.search(rb"^DMIG[*, ]", path.read_bytes(), re.M | re.I):
        return read_dmig(path)  # grid points and others may come first
    what = "binary content" if b"\0" in head else repr(first[:60])
    library = LIBRARIES.get(suffix, "the library of the program that wrote it")
    raise ValueError(
        f"{path}: expected matrices in one of {KNOWN_FORMATS}; got {what}. Read the "
        f"file by {library}, and give the arrays to MatrixModel"
    )
