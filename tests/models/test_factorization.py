"""Models by SuperLU and by PARDISO: against closed forms, and against each other."""

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
from emcee_femu.models.factorization import factor_indefinite

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


@pytest.fixture
def pardiso(monkeypatch):
    choose("PARDISO", monkeypatch)
    return sys.modules["pypardiso"].ps


def membrane(n):
    """Return the stiffness of n by n + 1 points, held at its edges, and eigenvalues."""
    sides, lines = [], []
    for m in (n, n + 1):
        diagonals = [np.full(m, 2.0), -np.ones(m - 1), -np.ones(m - 1)]
        sides.append(sparse.diags_array(diagonals, offsets=[0, 1, -1]))
        lines.append(4 * np.sin(np.arange(1, m + 1) * np.pi / (2 * m + 2)) ** 2)
    K = sparse.kronsum(*sides, format="csc")
    return sparse.csc_array(K), np.sort(np.add.outer(*lines).ravel())


def sprung(n):
    """Return a static model of a membrane on springs k, and its forces."""
    K, _ = membrane(n)
    forces = np.random.default_rng(1).normal(size=(2, K.shape[0]))
    cases = dict(zip("ab", forces, strict=True))
    return ef.StaticModel(K, cases, {"k": sparse.eye_array(K.shape[0])}), forces


def test_displacements_and_modes_are_exact_where_the_stiffness_is_positive(solver):
    K, eigenvalues = membrane(12)
    model, forces = sprung(12)
    for k in (0.0, -0.9 * eigenvalues[0], 9.0):
        u = model({"k": np.array([k])})["displacement"][0]
        found = u @ (K + k * sparse.eye_array(156))
        np.testing.assert_allclose(found, forces, atol=1e-9)
    found = ef.MatrixModel(K, sparse.eye_array(156), {}, n_modes=40)({}).frequencies
    np.testing.assert_allclose(found[0], np.sqrt(eigenvalues[:40]) / 2 / np.pi)
    for k in -eigenvalues[[0, 39, 155]] - 1e-6:
        with pytest.raises(ValueError, match="not positive definite at .*'k': -"):
            model({"k": np.array([k])})


@pytest.mark.parametrize("matrix", [[[1.0, 0], [0, 0]], [[0, 2.0], [2.0, 0]]])
def test_a_matrix_without_a_diagonal_is_not_definite(solver, matrix):
    K = sparse.csc_array(matrix)
    with pytest.raises(ValueError, match="not positive definite"):
        ef.StaticModel(0 * K, {"a": np.ones(2)}, {"k": K})({"k": np.ones(1)})


def modal():
    """Return a model of a membrane, half of whose stiffness is unknown."""
    K, _ = membrane(14)
    half = {"k": sparse.csc_array(K[:105].T @ K[:105])}
    return ef.MatrixModel(K, sparse.eye_array(210), half, n_modes=4, shapes=[3])


def tied():
    """Return a chain with two multipliers, and one whose K - lambda M has zeros."""
    n, tie = 40, np.zeros((2, 40))
    chain = 2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    tie[0, [3, 20]], tie[1, [9, 30]] = (1, -1), (1, -2)
    K = sparse.csc_array(np.block([[chain, tie.T], [tie, np.zeros((2, 2))]]))
    M = sparse.diags_array(np.r_[np.ones(n), 0, 0])
    part = sparse.diags_array(1.0 * (np.arange(n + 2) < 7))
    return ef.MatrixModel(K, M, {"k": part}, n_modes=4, shapes=[3])


VALUES = {"k": np.array([0.2, 0.7])}


def answers_of(kind):
    if kind == "static":
        response, slopes = sprung(14)[0].jacobian(VALUES)
        return response["displacement"], slopes["displacement"]["k"]
    response, slopes = (modal if kind == "modal" else tied)().jacobian(VALUES)
    shapes = np.abs(response.shapes), np.abs(slopes["shapes"]["k"])
    return response.frequencies, slopes["frequency"]["k"], *shapes


@pytest.mark.parametrize("kind", ["modal", "static", "tied"])
def test_models_answer_alike_with_either_solver(kind, monkeypatch):
    pytest.importorskip("pypardiso", reason="pip install 'emcee_femu[pardiso]'")
    results = []
    for pardiso in (False, True):
        with monkeypatch.context() as chosen:
            if pardiso:  # which leaves to SuperLU what it cannot do
                chosen.setattr(f"{MODULE}.LARGE_DOFS", 1)
            results.append(answers_of(kind))
            for first, again in zip(results[-1], answers_of(kind), strict=True):
                np.testing.assert_array_equal(first, again)
    for ours, theirs in zip(*results, strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=1e-7, atol=1e-12)


def test_a_pivot_that_pardiso_would_replace_is_left_to_superlu(monkeypatch):
    pytest.importorskip("pypardiso", reason="pip install 'emcee_femu[pardiso]'")
    monkeypatch.setattr(f"{MODULE}.LARGE_DOFS", 1)
    small = 2.0**-33  # what is left of the second pivot
    A = np.array([[1, 1, 0], [1, 1 + small, 0], [0, 0, -3]])
    factor = factor_indefinite(sparse.csc_array(A))
    assert factor.negative == 1
    solution = factor.solve(np.array([0.0, 1.0, 3.0]))
    np.testing.assert_allclose(solution, [-1 / small, 1 / small, -1.0])


def test_models_refuse_alike_with_either_solver(solver):
    with pytest.raises(ValueError, match=r"mode 1 is not elastic .* \{'k': -1.0\}"):
        modal()({"k": np.array([-1.0])})
    K, _ = membrane(14)
    off = sparse.diags_array([np.ones(209), np.ones(209)], offsets=[1, -1])
    with pytest.raises(ValueError, match="M0 is not positive definite"):
        ef.MatrixModel(K, sparse.csc_array(off + sparse.eye_array(210)), {}, n_modes=2)


def test_memory_lasts_as_long_as_a_solve(pardiso):
    (model, _), K = sprung(40), membrane(40)[0]

    def held():
        gc.collect()
        return int(pardiso.libmkl.MKL_Mem_Stat(byref(c_int())))

    model({"k": np.ones(1)})
    before = held()
    for k in (1.0, 2.0, -9.0, -9.0, 3.0):
        if k > 0:
            model({"k": np.array([k])})
        else:
            with pytest.raises(ValueError, match="not positive definite"):
                model({"k": np.array([k])})
    assert held() - before < sparse.triu(K).data.nbytes / 2  # of one factor, at most


def test_threads_have_factors_of_their_own(pardiso):
    model, _ = sprung(30)

    def solve(k):
        rows = np.full(5, k)
        return model({"k": rows})["displacement"]

    values = np.linspace(0.0, 3.0, 16)
    expected = [solve(k) for k in values]
    with ThreadPoolExecutor(4) as executor:
        np.testing.assert_array_equal([*executor.map(solve, values)], expected)


def test_the_number_of_threads_changes_no_bit(pardiso):
    M, parts = load("large_model").solid(6_000)
    model = ef.StaticModel(sum(parts.values()), {"weight": M.diagonal()}, {})
    try:
        solutions = []
        for threads in (1, 2):
            pardiso.libmkl.MKL_Set_Num_Threads_Local(threads)
            solutions.append(model({})["displacement"])
    finally:
        pardiso.libmkl.MKL_Set_Num_Threads_Local(0)  # as many as before
    np.testing.assert_array_equal(*solutions)


def test_a_model_that_was_solved_is_sent_to_other_processes(pardiso):
    model = modal()
    before = model(VALUES).frequencies
    after = pickle.loads(pickle.dumps(model))(VALUES).frequencies
    np.testing.assert_array_equal(before, after)
