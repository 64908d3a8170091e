"""Factors by SuperLU and by PARDISO: against dense algebra, and against each other."""

import gc
import pickle
import sys
from concurrent.futures import ThreadPoolExecutor
from ctypes import byref, c_int

import numpy as np
import pytest
from scipy import sparse
from support.examples import load

import emcee_femu as ef
from emcee_femu.models.factorization import factor_definite, factor_indefinite

MODULE = "emcee_femu.models.factorization"
SOLVERS = ["SuperLU", "PARDISO"]


def choose(solver, monkeypatch):
    """Let one solver factor matrices of any size, and the other none."""
    if solver == "SuperLU":
        monkeypatch.setitem(sys.modules, "pypardiso", None)
    else:
        pytest.importorskip("pypardiso", reason="pip install 'emcee_femu[pardiso]'")
        monkeypatch.setattr(f"{MODULE}.LARGE_DOFS", 1)
        monkeypatch.setattr(f"{MODULE}.splu", None)


@pytest.fixture(params=SOLVERS)
def solver(request, monkeypatch):
    choose(request.param, monkeypatch)
    return request.param


def membrane(n):
    """Return the stiffness of n by n + 1 points, held at its edges, and eigenvalues."""
    sides, lines = [], []
    for m in (n, n + 1):
        diagonals = [np.full(m, 2.0), -np.ones(m - 1), -np.ones(m - 1)]
        sides.append(sparse.diags_array(diagonals, offsets=[0, 1, -1]))
        lines.append(4 * np.sin(np.arange(1, m + 1) * np.pi / (2 * m + 2)) ** 2)
    K = sparse.kronsum(*sides, format="csc")
    return sparse.csc_array(K), np.sort(np.add.outer(*lines).ravel())


@pytest.mark.parametrize("columns", [None, 1, 5])
def test_a_factor_solves_and_counts_negative_eigenvalues(solver, columns):
    K, eigenvalues = membrane(12)
    b = np.random.default_rng(1).normal(size=(156, columns) if columns else 156)
    for count in (0, 1, 40, 156):
        shift = np.r_[0.0, eigenvalues, 9.0][count : count + 2].mean()
        A = sparse.csc_array(K - shift * sparse.eye_array(156))
        factor, given = factor_indefinite(A), b.copy()
        assert factor.negative == count
        np.testing.assert_allclose(A @ factor.solve(b), b, atol=1e-9)
        np.testing.assert_array_equal(b, given)
        definite = factor_definite(A)
        if count:
            assert definite is None
        else:
            np.testing.assert_allclose(definite.solve(b), factor.solve(b), rtol=1e-9)


def test_a_matrix_that_is_not_positive_is_not_definite(solver):
    K, eigenvalues = membrane(12)
    empty = sparse.csc_array(([1.0], ([0], [0])), shape=(2, 2))
    swap = sparse.csc_array(np.array([[0.0, 2.0], [2.0, 0.0]]))
    weak = sparse.csc_array(K - eigenvalues[:2].mean() * sparse.eye_array(156))
    assert (weak.diagonal() > 0).all()
    for matrix in (empty, swap, -K, weak):
        assert factor_definite(matrix) is None


def test_a_matrix_without_a_stored_diagonal_is_factored(monkeypatch):
    monkeypatch.setattr(f"{MODULE}.LARGE_DOFS", 1)  # PARDISO would read beyond its rows
    swap = sparse.csc_array(np.array([[0.0, 2.0], [2.0, 0.0]]))
    np.testing.assert_allclose(factor_indefinite(swap, 0.01).solve(np.ones(2)), 0.5)


def test_a_pivot_that_pardiso_would_replace_is_left_to_superlu(monkeypatch):
    pytest.importorskip("pypardiso", reason="pip install 'emcee_femu[pardiso]'")
    monkeypatch.setattr(f"{MODULE}.LARGE_DOFS", 1)
    small = 2.0**-33  # what is left of the second pivot
    factor = factor_indefinite(
        sparse.csc_array(np.array([[1, 1, 0], [1, 1 + small, 0], [0, 0, -3]]))
    )
    assert factor.negative == 1
    solution = factor.solve(np.array([0.0, 1.0, 3.0]))
    np.testing.assert_allclose(solution, [-1 / small, 1 / small, -1.0])


def test_superlu_swaps_rows_where_it_may():
    A = sparse.csc_array(np.array([[1e-20, 1.0], [1.0, 2e-20]]))
    solution = factor_indefinite(A, 0.01).solve(np.array([1.0, 2.0]))
    np.testing.assert_allclose(solution, [2.0, 1.0])


# --- models -----------------------------------------------------------------------


def plate(cls, *args, **options):
    """Return a model of a membrane, half of whose stiffness is unknown, and values."""
    K, _ = membrane(14)
    half = sparse.csc_array(K[:105].T @ K[:105])
    return cls(K, *args, {"k": half}, **options), {"k": np.array([0.2, 0.7])}


def modal_answers():
    model, values = plate(ef.MatrixModel, sparse.eye_array(210), n_modes=4, shapes=[3])
    response, slopes = model.jacobian(values)
    shapes = np.abs(response.shapes), np.abs(slopes["shapes"]["k"])
    return response.frequencies, slopes["frequency"]["k"], *shapes


def static_answers():
    model, values = plate(ef.StaticModel, {"mid": {100: 1.0}, "all": np.ones(210)})
    response, slopes = model.jacobian(values)
    return response["displacement"], slopes["displacement"]["k"]


@pytest.mark.parametrize("answers", [modal_answers, static_answers])
def test_models_answer_alike_with_either_solver(answers, monkeypatch):
    results = []
    for solver in SOLVERS:
        with monkeypatch.context() as chosen:
            choose(solver, chosen)
            results.append(answers())
            for first, again in zip(results[-1], answers(), strict=True):
                np.testing.assert_array_equal(first, again)
    for ours, theirs in zip(*results, strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=1e-7, atol=1e-12)


def test_models_refuse_alike_with_either_solver(solver):
    model, _ = plate(ef.MatrixModel, sparse.eye_array(210), n_modes=2)
    with pytest.raises(ValueError, match=r"mode 1 is not elastic .* \{'k': -1.0\}"):
        model({"k": np.array([-1.0])})
    model, _ = plate(ef.StaticModel, {"all": np.ones(210)})
    with pytest.raises(ValueError, match="not positive definite at .*'k': -1.0"):
        model({"k": np.array([-1.0])})
    K, _ = membrane(14)
    off = sparse.diags_array([np.ones(209), np.ones(209)], offsets=[1, -1])
    with pytest.raises(ValueError, match="M0 is not positive definite"):
        ef.MatrixModel(K, sparse.csc_array(off + sparse.eye_array(210)), {}, n_modes=2)


# --- PARDISO's memory, threads and processes --------------------------------------


@pytest.fixture
def pardiso(monkeypatch):
    choose("PARDISO", monkeypatch)
    return sys.modules["pypardiso"].ps


def test_memory_lasts_as_long_as_a_factor(pardiso):
    K, _ = membrane(40)

    def held():
        gc.collect()
        return int(pardiso.libmkl.MKL_Mem_Stat(byref(c_int())))

    factor_definite(K)
    before = held()
    solve = factor_definite(K).solve  # is all that is kept
    size = held() - before
    assert size > sparse.triu(K).data.nbytes  # L fills in
    np.testing.assert_allclose(K @ solve(np.ones(1640)), 1.0)
    del solve
    for _ in range(5):
        assert factor_definite(-K) is None and factor_indefinite(-K).negative == 1640
    assert held() - before < size / 2  # of MKL's own, whatever the processor wants


def test_threads_have_factors_of_their_own(pardiso):
    K, eigenvalues = membrane(30)
    shifts = eigenvalues[:-1:40] + np.diff(eigenvalues)[::40] / 2

    def count(shift):
        A = sparse.csc_array(K - shift * sparse.eye_array(930))
        return [factor_indefinite(A).negative for _ in range(5)]

    expected = [5 * [int((eigenvalues < shift).sum())] for shift in shifts]
    with ThreadPoolExecutor(4) as executor:
        assert [*executor.map(count, shifts)] == expected


def test_the_number_of_threads_changes_no_bit(pardiso):
    M, parts = load("large_model").solid(6_000)
    K, solutions = sparse.csc_array(sum(parts.values())), []
    try:
        for threads in (1, 2, 2):
            pardiso.libmkl.MKL_Set_Num_Threads_Local(threads)
            solutions.append(factor_definite(K).solve(M.diagonal()))
    finally:
        pardiso.libmkl.MKL_Set_Num_Threads_Local(0)  # as many as before
    for solution in solutions:
        np.testing.assert_array_equal(solution, solutions[0])


def test_a_model_that_was_solved_is_sent_to_other_processes(pardiso):
    model, values = plate(ef.MatrixModel, sparse.eye_array(210), n_modes=4)
    before = model(values).frequencies
    after = pickle.loads(pickle.dumps(model))(values).frequencies
    np.testing.assert_array_equal(before, after)
