r"""Factors of symmetric sparse matrices, by PARDISO where it is installed.

.. math:: A = L D L^T

The pivots on the diagonal of D have the signs of the eigenvalues of A (Sylvester's law
of inertia), so that a factor counts how many of these are negative.

SuperLU comes with scipy. PARDISO (the extra ``pardiso``) stores half of a symmetric
matrix and orders it by nested dissection, which pays in solids of some thousand DOFs.
Smaller matrices are left to SuperLU, for PARDISO takes most of a second to load. A
factor lives within one solve: a model holds none, and can be sent to other processes.

Source: Schenk and Gaertner, Future Gener. Comput. Syst. 20 (2004) 475,
    doi:10.1016/j.future.2003.07.011.
"""

import weakref
from collections.abc import Callable
from copy import copy
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.sparse import csc_array, csr_matrix, diags_array, triu
from scipy.sparse.linalg import splu

from ..contracts import Floats

# Of a constraint, beside that of the DOFs it ties: as much is left after a solve, its
# square after a refinement; rounding is amplified by its inverse, and refined alike.
COMPLIANCE = 1e-8
LARGE_DOFS = 5_000  # DOFs; SuperLU takes a few tenths of a second at most for fewer
DEFINITE, INDEFINITE = 2, -2  # PARDISO's types of real symmetric matrices
REPRODUCIBLE = 2  # mode of MKL: the same bits from any number of threads
ZERO_PIVOT = -4  # its error code, of a negative pivot of a definite matrix too


@dataclass(frozen=True, eq=False)
class Factor:
    """A matrix that was factored, to solve with many times.

    Attributes:
        solve: From ``b``, ``(N,)`` or ``(N, n)``, to the solution of ``A x = b``.
        negative: How many eigenvalues of A are negative.
    """

    solve: Callable[[Floats], Floats]
    negative: int


def factor_definite(A: csc_array) -> Factor | None:
    """Return the factor of a symmetric matrix, None unless positive definite.

    Rows without a diagonal are constraints of the others by Lagrange multipliers, under
    which these are to be positive definite.
    """
    diagonal = A.diagonal()
    if not (diagonal > 0).all():  # SuperLU would swap rows
        return None if (diagonal < 0).any() else _factor_constrained(A, diagonal)
    if _pardiso_pays(A):
        return _factor_by_pardiso(A, DEFINITE)
    try:
        factor = _factor_by_superlu(A, 0.0)
    except RuntimeError:  # exactly singular
        return None
    return None if factor.negative else factor


def _factor_constrained(A: csc_array, diagonal: Floats) -> Factor | None:
    """Return the factor of a matrix with rows that have no diagonal.

    A compliance in them makes it quasi-definite, so that no pivot vanishes, in whatever
    order, and as many are negative as there are constraints. A step of refinement takes
    the compliance out again.

    Source: Vanderbei, SIAM J. Optim. 5 (1995) 100, doi:10.1137/0805005.
    """
    tied = diagonal == 0
    squares = A.multiply(A)
    if tied.all() or not squares.sum(axis=1)[tied].all():  # an empty row
        return None
    near = squares @ np.where(tied, 0.0, 1 / np.where(tied, 1.0, diagonal))
    # A row with none but such neighbours is a DOF that hangs on constraints.
    change = np.where(near > 0, -near, np.median(diagonal[~tied]))
    factor = factor_indefinite(csc_array(A + diags_array(COMPLIANCE * change * tied)))
    if factor.negative != np.count_nonzero(tied & (near > 0)):
        return None

    def solve(b: Floats) -> Floats:
        x = factor.solve(b)
        return x + factor.solve(b - A @ x)

    return Factor(solve, factor.negative)


def factor_indefinite(A: csc_array, threshold: float = 0.0) -> Factor:
    """Return the factor of a symmetric matrix.

    Args:
        A: The matrix ``(N, N)``.
        threshold: How small a pivot may be beside the largest number of its column
            before SuperLU swaps rows, after which ``negative`` is no inertia.

    Raises:
        RuntimeError: If A is exactly singular.
    """
    factor = _factor_by_pardiso(A, INDEFINITE) if _pardiso_pays(A) else None
    return _factor_by_superlu(A, threshold) if factor is None else factor


def _pardiso_pays(A: csc_array) -> bool:
    if A.shape[0] < LARGE_DOFS or not A.diagonal().all():  # it wants all stored
        return False
    try:
        import pypardiso  # noqa: F401
    except ImportError:  # the extra is not installed, or MKL not found
        return False
    return True


def _factor_by_superlu(A: csc_array, threshold: float) -> Factor:
    options = {"SymmetricMode": True}
    factor = splu(A, "MMD_AT_PLUS_A", threshold, options=options)
    return Factor(factor.solve, int((~(factor.U.diagonal() > 0)).sum()))


def _factor_by_pardiso(A: csc_array, kind: int) -> Factor | None:
    """Return the factor, None if a pivot is zero, or not positive where all should be.

    PARDISO replaces a small pivot of an indefinite matrix; here that is none.
    """
    from pypardiso import ps
    from pypardiso.pardiso_wrapper import PyPardisoError

    ps.libmkl.MKL_CBWR_Set(REPRODUCIBLE)
    # Each factor has a handle of its own; to look for MKL again would take longer than
    # many a factorisation.
    solver = copy(ps)
    solver.pt, solver.iparm = np.zeros_like(ps.pt), np.zeros_like(ps.iparm)
    solver.set_matrix_type(kind)
    solver.size_limit_storage = np.inf  # above it each solve hashes the whole matrix
    upper = csr_matrix(triu(A, format="csr"))
    solve = partial(solver.solve, upper)
    weakref.finalize(solve, solver.free_memory, everything=True)
    try:
        solver.factorize(upper)
    except PyPardisoError as error:
        if error.value != ZERO_PIVOT:
            raise
        return None
    if solver.get_iparm(14):  # pivots replaced
        return None
    return Factor(solve, int(solver.get_iparm(23)))
