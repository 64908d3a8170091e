"""Files of every format: read back, renamed, cut, damaged."""

import sys
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from scipy import sparse
from scipy.io import hb_read, hb_write, mmwrite, savemat
from support.exports import (
    FREQUENCIES,
    cantilever,
    op4,
    write_abaqus,
    write_calculix,
    write_dmig,
)

import emcee_femu as ef

K, M, DOFS = cantilever()


def write_market(folder, symmetry="symmetric", kind=sparse.coo_array):
    for name, matrix in (("K", K), ("M", M)):
        mmwrite(folder / f"{name}.mtx", kind(matrix), "a beam", symmetry=symmetry)
    return {"K": folder / "K.mtx", "M": folder / "M.mtx"}


def write_npz(folder):
    for name, matrix in (("K", K), ("M", M)):
        sparse.save_npz(folder / f"{name}.npz", sparse.csr_array(matrix))
    return {"K": folder / "K.npz", "M": folder / "M.npz"}


def write_npy(folder):
    for name, matrix in (("K", K), ("M", M)):
        np.save(folder / f"{name}.npy", matrix)
    return {"K": folder / "K.npy", "M": folder / "M.npy"}


def write_savez(folder):
    np.savez(folder / "both.npz", K=K, M=M, nodes=DOFS, count=len(K))
    return folder / "both.npz"


def write_csv(folder, delimiter=","):
    for name, matrix in (("K", K), ("M", M)):
        path = folder / f"{name}.csv"
        np.savetxt(path, matrix, delimiter=delimiter, fmt="%.16g")
        if delimiter == ";":  # a spreadsheet with decimal commas
            path.write_text(path.read_text().replace(".", ","))
    return {"K": folder / "K.csv", "M": folder / "M.csv"}


def write_mat(folder, version="5", kind=np.array):
    path = folder / "job.mat"
    matrices = {"K": kind(K), "M": kind(M), "f": np.ones((1, 3)), "title": "a beam"}
    savemat(path, matrices | {"count": len(K)}, format=version)
    return path


def write_struct(folder):
    """A structure with a matrix of the same name as one beside it, which counts."""
    path = folder / "job.mat"
    savemat(path, {"model": {"K": K, "M": 0.5 * M, "name": "beam"}, "M": M, "n": 2})
    return path


def write_op4(folder, layout):
    path = folder / "beam.op4"
    path.write_text(op4("KAA", K, layout) + op4("MAA", M, layout))
    return path


WRITERS = {
    "Matrix Market": write_market,
    "Matrix Market, general": lambda folder: write_market(folder, "general"),
    "Matrix Market, array": lambda folder: write_market(folder, "symmetric", np.array),
    "SciPy": write_npz,
    "NumPy": write_npy,
    "NumPy, both": write_savez,
    "CSV": write_csv,
    "CSV, semicolons": lambda folder: write_csv(folder, ";"),
    "CSV, blanks": lambda folder: write_csv(folder, " "),
    "MATLAB": write_mat,
    "MATLAB, a structure": write_struct,
    "MATLAB, sparse": lambda folder: write_mat(folder, "5", sparse.csc_array),
    "Abaqus": lambda folder: write_abaqus(folder, K, M, DOFS),
    "Abaqus, labels": lambda folder: write_abaqus(folder, K, M, DOFS, "labels"),
    "Abaqus, rows": lambda folder: write_abaqus(folder, K, M, DOFS, "coordinate"),
    "CalculiX": lambda folder: write_calculix(folder, K, M, DOFS),
    "Nastran DMIG": lambda folder: write_dmig(folder / "beam.pch", K, M, DOFS),
    "Nastran OP4, dense": lambda folder: write_op4(folder, "dense"),
    "Nastran OP4, sparse": lambda folder: write_op4(folder, "sparse"),
    "Nastran OP4, bigmat": lambda folder: write_op4(folder, "bigmat"),
}
LABELLED = "Abaqus", "Abaqus, labels", "CalculiX", "Nastran DMIG"


@pytest.mark.parametrize("program", WRITERS)
def test_what_was_written_is_read_whatever_the_suffix(tmp_path, program):
    given = WRITERS[program](tmp_path)
    read = ef.read_matrices(given)
    model = ef.MatrixModel(read.K, read.M, {}, n_modes=3)
    np.testing.assert_allclose(model({}).frequencies[0], FREQUENCIES, rtol=3e-3)
    if program in LABELLED:
        np.testing.assert_array_equal(read.nodes, DOFS)
        assert read.dofs("node 27 z") == 14
    else:
        assert read.nodes is None
    if program == "CalculiX":
        given = {"K": given, "M": given.with_suffix(".mas")}
    elif not isinstance(given, dict):
        other = given.with_name(given.name.replace("STIF", "MASS"))
        given = {"K": given, "M": other}
    renamed = {name: tmp_path / f"{name}.txt" for name in given}
    for name, path in given.items():
        renamed[name].write_bytes(path.read_bytes())
    for found in (read, ef.read_matrices(renamed)):
        np.testing.assert_allclose(found.K.toarray(), K, rtol=6e-10)
        np.testing.assert_allclose(found.M.toarray(), M, rtol=6e-10)


@pytest.mark.parametrize("program", WRITERS)
def test_a_cut_file_is_refused_or_a_matrix_is_missing(tmp_path, program):
    # So may K be complete when M is not.
    given = WRITERS[program](tmp_path)
    path = given["K"] if isinstance(given, dict) else given
    whole = path.read_bytes()
    for end in range(0, len(whole) - 1, max(1, len(whole) // 16)):
        path.write_bytes(whole[:end])
        if program == "Nastran DMIG" and whole[end - 1 : end] == b"\n":
            continue  # it has no end mark: see test_nastran.py
        try:
            read = ef.read_matrices(given)
        except ValueError as error:
            assert str(tmp_path) in str(error)
        else:
            assert [*read.matrices] == ["K"] and "OP4" not in program
            np.testing.assert_allclose(read.K.toarray(), K, rtol=6e-10)


@pytest.mark.parametrize(
    "program",
    [
        p
        for p in WRITERS
        if p[:3] not in ("Sci", "Num", "CSV", "MAT") and "array" not in p
    ],
)
@pytest.mark.parametrize("wrong", ["nan", "1e999"])
def test_an_entry_that_is_no_number_is_refused(tmp_path, program, wrong):
    given = WRITERS[program](tmp_path)
    path = given["K"] if isinstance(given, dict) else given
    lines = path.read_text().splitlines(keepends=True)
    at = len(lines) // 4
    while len(lines[at].split()) < 2 or "." not in lines[at]:  # not a header of OP4
        at += 1
    kept = max(lines[at].rstrip().rfind(mark) for mark in " ,")
    width = len(lines[at].rstrip()) - kept - 1
    lines[at] = f"{lines[at][: kept + 1]}{wrong:>{width}}\n"
    path.write_text("".join(lines))
    with pytest.raises(ValueError, match=str(path)):
        ef.read_matrices(given)


def test_a_matlab_file_of_version_4_and_one_of_version_7_3(tmp_path):
    read = ef.read_matrices(write_mat(tmp_path, "4"))
    np.testing.assert_array_equal(read.M.toarray(), M)
    newer = tmp_path / "new.mat"
    newer.write_bytes(
        b"MATLAB 7.3 MAT-file, Platform".ljust(512) + b"\x89HDF\r\n\x1a\n\0"
    )
    with pytest.raises(ValueError, match=r"new\.mat.*-v7'.*h5py"):
        ef.read_matrices(newer)


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("K.csv", "a,b\n1,0\n0,1\n", "a,b"),
        ("K.csv", "1,0\n0,x\n", "line 2"),
        ("K.csv", "1,0\n0\n", "line 2"),
        ("K.csv", "1,0,0\n0,1,0\n", "square"),
        ("K.csv", "1,0\n0,1", "cut off"),
        ("K.csv", "1,0\n0,nan\n", "finite"),
        ("job.op2", "\0\0", "pyNastran"),
        ("job.h5", "\x89HDF\r\n\x1a\n\0", "h5py"),
        ("job.xlsx", "PK\x03\x04\0", "pandas.read_excel"),
        ("K.mat", "\0" * 200, "expected"),  # as scipy's version reads it
        ("K.mat", "MATLAB 7.3 MAT-file\0", "-v7"),
        ("K.npy", "\x93NUMPY\x01\0v\0", "numpy.save"),
    ],
)
def test_what_is_no_matrix_says_what_to_do(tmp_path, name, content, words):
    path = tmp_path / name
    path.write_text(content, encoding="latin-1", newline="")
    with pytest.raises(ValueError, match=rf"{path}.*{words}"):
        ef.read_matrices({"K": path})


def test_a_csv_of_three_whole_columns_is_no_list_of_triplets(tmp_path):
    A = np.array([[2, -1, 0], [-1, 2, -1], [0, -1, 3]])
    np.savetxt(tmp_path / "K.csv", A, delimiter=",", fmt="%d")
    assert (
        ef.read_matrices({"K": tmp_path / "K.csv"}).K.toarray().tolist() == A.tolist()
    )


def test_labels_of_a_file_are_for_formats_that_have_none(tmp_path):
    given = write_market(tmp_path)
    dofs = tmp_path / "rows.txt"
    dofs.write_text("".join(f"{n}.{d}\n" for n, d in DOFS))
    read = ef.read_matrices(given | {"dofs": dofs})
    assert read.dofs(["13:uz", "27:ry"]).tolist() == [0, 15]
    dofs.write_text("".join(f"{n}.{d}\n" for n, d in DOFS[:-1]))
    with pytest.raises(ValueError, match=r"K\.mtx: a matrix of 16 rows, but 15 labels"):
        ef.read_matrices(given | {"dofs": dofs})
    path = write_dmig(tmp_path / "beam.pch", K, M, DOFS)
    with pytest.raises(ValueError, match=r"path\['dofs'\]: .*differ; leave"):
        ef.read_matrices({"K": path, "M": path, "dofs": dofs})


MARKET = b"%%MatrixMarket matrix "
FOREIGN = {
    "empty": (b"", "empty"),
    "picture": (b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\0", "CalculiX"),
    "page": (b"<html>\n", "CalculiX"),
    "zeros": (bytes(999), "CalculiX"),
    "a number": (b"1.5\n", "CalculiX"),
    "complex": (MARKET + b"coordinate complex hermitian\n", "line 1"),
    "vector": (b"%%MatrixMarket vector coordinate real general\n", "line 1"),
    "sizes": (MARKET + b"coordinate real general\n3 3\n", "line 2"),
    "row": (MARKET + b"coordinate real general\n2 2 1\n3 1 1.0\n", "line 2.*row 3"),
    "value": (MARKET + b"array real general\n2 2\n1\n0\n0\nx\n", "line 6"),
    "rows": (MARKET + b"coordinate real general\n900000000 900000000 1\n1 1 1\n", ""),
    "array": (MARKET + b"array real general\n900000000 900000000\n1.0\n", ""),
}


@pytest.mark.parametrize("name", FOREIGN)
def test_a_foreign_file_is_refused_by_its_name(tmp_path, name):
    content, words = FOREIGN[name]
    path = tmp_path / "matrices.bin"
    path.write_bytes(content)
    with pytest.raises(ValueError, match=rf"{path}.*{words}"):
        ef.read_matrices({"K": path})


ANNOUNCED = sparse.coo_array(
    (np.ones(1), (np.zeros(1, int), np.zeros(1, int))), shape=(900_000_000,) * 2
)
CRASHING = {  # the interpreter, or the memory
    "beyond": {"indices": np.array([0, 1, 2_000_000])},
    "below": {"indices": np.array([0, 1, -5])},
    "pointer": {"indptr": np.array([0, 1, 2, 2**40])},
    "order": {"indptr": np.array([0, 2, 1, 3])},
    "shape": {"shape": np.array([900_000_000, 900_000_000])},
    "announced": ANNOUNCED,
    "bomb": (4 * 10**9).to_bytes(4, "little"),  # the size of a member
}


@pytest.mark.parametrize("name", CRASHING)
def test_npz_files_that_crash_the_interpreter_are_refused(tmp_path, name):
    wrong, path = CRASHING[name], tmp_path / "K.npz"
    sparse.save_npz(path, sparse.csr_array(np.eye(3)))
    if isinstance(wrong, dict):
        np.savez_compressed(path, **(dict(np.load(path)) | wrong))
    elif isinstance(wrong, bytes):
        content = bytearray(path.read_bytes())
        member = content.find(b"PK\x01\x02")  # its entry in the directory
        content[member + 24 : member + 28] = wrong
        path.write_bytes(content)
    else:
        sparse.save_npz(path, wrong)
    with pytest.raises(ValueError, match=r"K\.npz"):
        ef.read_matrices({"K": path})


def test_abaqus_holds_DOFs_by_1e36(tmp_path):
    K, M, dofs = cantilever(clamped=False)
    for row in (0, 1):
        K[row, :] = K[:, row] = 0.0
        K[row, row] = 1e36
    read = ef.read_matrices(write_abaqus(tmp_path, K, M, dofs))
    np.testing.assert_array_equal(read.nodes, dofs[2:])
    model = ef.MatrixModel(read.K, read.M, {}, n_modes=3)
    np.testing.assert_allclose(model({}).frequencies[0], FREQUENCIES, rtol=3e-3)
    path = write_abaqus(tmp_path, K, M, dofs, "coordinate")
    with pytest.raises(ValueError, match=r"STIF1.mtx: 2 rows are held .*MATRIX INPUT"):
        ef.read_matrices(path)


def test_abaqus_numbers_inner_nodes_below_zero_and_in_any_order(tmp_path):
    dofs = DOFS.copy()
    dofs[4:6, 0] = -3
    shuffled = np.random.default_rng(1).permutation(len(K))  # each pair stays once
    both = [A[np.ix_(shuffled, shuffled)] for A in (K, M)]
    read = ef.read_matrices(write_abaqus(tmp_path, *both, dofs[shuffled]))
    rows = read.dofs(["13:uz", "-3:uz", "27:ry"])
    assert rows.tolist() == [2, 0, 15]
    model = ef.MatrixModel(read.K, read.M, {}, n_modes=3)
    np.testing.assert_allclose(model({}).frequencies[0], FREQUENCIES, rtol=3e-3)


def full_file(folder):
    path = folder / "file.full"
    path.write_bytes(np.array([100, -(2**31), 4, 0], "<i4").tobytes() + bytes(400))
    return path


def test_ansys_without_its_reader_is_told_how(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "ansys.mapdl.reader", None)
    with pytest.raises(ImportError, match=r"file\.full.*ansys-mapdl-reader.*\*EXPORT"):
        ef.read_matrices(full_file(tmp_path))


def test_ansys_files_have_upper_triangles_and_empty_rows_of_held_DOFs(
    tmp_path, monkeypatch
):
    K0, M0, dofs = cantilever(clamped=False)
    K0[:2], K0[:, :2], M0[:2], M0[:, :2] = 0.0, 0.0, 0.0, 0.0
    numbered = dofs - [0, 1]
    triangles = [sparse.csc_matrix(np.triu(A)) for A in (K0, M0)]
    found = SimpleNamespace(
        load_km=lambda sort: (numbered, *triangles), const=numbered[:2]
    )
    reader = ModuleType("ansys.mapdl.reader")
    reader.read_binary = lambda path: found
    monkeypatch.setitem(sys.modules, "ansys.mapdl.reader", reader)
    for name in ("ansys", "ansys.mapdl"):
        monkeypatch.setitem(sys.modules, name, ModuleType(name))
    read = ef.read_matrices(full_file(tmp_path))
    np.testing.assert_array_equal(read.nodes, DOFS)
    np.testing.assert_allclose(read.K.toarray(), K)
    np.testing.assert_allclose(read.M.toarray(), M)
    found.load_km = lambda sort: 1 / 0
    with pytest.raises(ValueError, match=r"file\.full: ZeroDivisionError"):
        ef.read_matrices(full_file(tmp_path))


def test_the_beam_that_comes_with_the_reader_of_ansys():
    pytest.importorskip("ansys.mapdl.reader")
    from ansys.mapdl.reader import examples

    read = ef.read_matrices(examples.fullfile)
    assert (read.size, read.dofs("node 22 x")) == (900, 0)
    clamped = ef.MatrixModel(read.K, read.M, {}, n_modes=6)({}).frequencies[0]
    free = 11504.895, 20137.193  # of its file.rst: torsion and axial, free at both ends
    np.testing.assert_allclose(clamped[[2, 5]], np.divide(free, 2), rtol=0.015)


# 3 by 3, lower half by columns: [[4, 0, -1.5], [0, 3, 0], [-1.5, 0, 2]].
LINES = [
    f"{'A title':72s}KEY",
    f"{3:14d}{1:14d}{1:14d}{1:14d}{0:14d}",
    f"{'RSA':14s}{3:14d}{3:14d}{4:14d}{0:14d}",
    f"{'(4I3)':16s}{'(4I3)':16s}{'(1P,4D12.4)':20s}",
    "  1  3  4  5",
    "  1  3  2  3",
    "  4.0000D+00 -1.5000D+00  3.0000D+00  2.0000D+00",
]
ENTRIES = [[4.0, 0.0, -1.5], [0.0, 3.0, 0.0], [-1.5, 0.0, 2.0]]


def write_lines(path, changed=()):
    lines = LINES.copy()
    for line, text in dict(changed).items():
        lines[line - 1] = text
    path.write_text("".join(line + "\n" for line in lines if line is not None))
    return {"K": path}


# SciPy 1.18 announces another default of an argument that older ones have not.
@pytest.mark.filterwarnings("ignore:The default value for `spmatrix`")
def test_all_entries_and_the_lower_half_are_read_as_scipy_reads_them(tmp_path):
    random = np.random.default_rng(3)
    half = np.tril(random.normal(size=(9, 9)) * (random.random((9, 9)) < 0.5))
    half += 20 * np.eye(9)
    paths = [tmp_path / f"{name}.hb" for name in ("half", "full")]
    for path, A in zip(paths, (half, half + np.tril(half, -1).T), strict=True):
        hb_write(path, sparse.csc_array(A))
    lower, full = (hb_read(path).toarray() for path in paths)
    np.testing.assert_array_equal(np.tril(full), lower)
    paths[0].write_text(paths[0].read_text().replace("RUA", "RSA"))
    for path in paths:
        read = ef.read_matrices({"K": path, "M": path})
        np.testing.assert_array_equal(read.K.toarray(), full)
        np.testing.assert_array_equal(read.M.toarray(), full)


F = {4: "(4I3)           (4I3)           (4F12.4)", 7: LINES[6].replace("D+00", "    ")}
BARE = {2: f"{4:14d}{2:14d}{1:14d}{1:14d}", 4: "(2I3)          (4I3)          (4E6.1)"}
BARE |= {5: "  1  3\n  4  5", 7: " 4.0+0-1.5+0 3.0+0 2.0+0"}
RHS = {2: LINES[1].replace(" 0", " 1"), 4: LINES[3] + "\nF  1  0", 7: LINES[6] + "\n 9"}


@pytest.mark.parametrize("changed", [{}, {3: LINES[2].lower()}, F, BARE, RHS])
def test_numbers_are_read_by_the_formats_that_the_file_says(tmp_path, changed):
    read = ef.read_matrices(write_lines(tmp_path / "K.rsa", changed))
    assert read.K.toarray().tolist() == ENTRIES


@pytest.mark.parametrize("kind", ["CSA", "PUA", "RSE", "RZA", "RRA"])
def test_other_types_of_harwell_boeing_are_refused_by_their_name(tmp_path, kind):
    files = write_lines(tmp_path / "K.hb", {3: LINES[2].replace("RSA", kind)})
    with pytest.raises(ValueError, match=rf"K\.hb.*{kind}"):
        ef.read_matrices(files)


@pytest.mark.parametrize(
    ("line", "text"),
    [(3, LINES[2].replace("RSA", "RUA")),  # half of it alone
     (3, f"RSA {4:14d}{3:14d}{4:14d}"), (3, f"RSA {3:14d}{3:14d}{5:14d}"),
     (4, "(4I3)           (4I3)"), (5, None), (5, "  1  3  4  6"), (5, "  0  2  3  4"),
     (5, "  1  4  3  5"), (5, "nan  3  4  5"), (5, "inf  3  4  5"), (6, "  1  4  2  3"),
     (6, "  1  0  2  3"), (6, "1.5  3  2  3"), (6, "  1  1  2  3"), (6, ""),
     (7, LINES[6][:36]), (7, LINES[6].replace("2.0000D", "1.0D999")), (7, None)],
)  # fmt: skip
def test_a_damaged_harwell_boeing_file_is_refused_by_its_name(tmp_path, line, text):
    with pytest.raises(ValueError, match=r"K\.hb"):
        ef.read_matrices(write_lines(tmp_path / "K.hb", {line: text}))
