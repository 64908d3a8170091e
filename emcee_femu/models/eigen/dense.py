"""The batched eigenproblem K phi = omega^2 M phi that the matrix models share."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ... import checks
from ...interfaces import Floats, ModalSolution
from .blocks import Blocks, collect
from .sensitivity import EPS, Derivatives, Modes, Slopes, differentiate

RIGID_RATIO = 1e-4  # a rigid-body eigenvalue is below this share of the next one


@dataclass(frozen=True, eq=False)
class Eigenproblem:
    r"""``K(a) = K0 + sum a_i K_i`` and ``M(b) = M0 + sum b_j M_j``, dense.

    .. math:: L L^T = M, \qquad A = L^{-1} K L^{-T}, \qquad A y = \omega^2 y,
        \qquad \phi = L^{-T} y, \qquad f = \omega / 2 \pi

    A constant M is folded into all K once, so that a batch is one
    ``numpy.linalg.eigvalsh``; otherwise the Cholesky factors are batched.

    Args:
        K: Stiffness matrices: K0, then those of unit coefficients, ``(1 + n_k, N, N)``.
        M: Mass matrices, likewise, ``(1 + n_m, N, N)``.
        selected: Indices of the wanted modes, 0 = the lowest, rigid ones included.
        skip: Number of rigid-body modes, checked at each solve.
        shapes: Whether mass-normalised mode shapes are wanted too.
        output: Rows that map the DOFs to those at which shapes are returned,
            ``(n_out, N)``; None for all DOFs.
    """

    K: Floats
    M: Floats
    selected: tuple[int, ...]
    skip: int = 0
    shapes: bool = False
    output: Floats | None = field(default=None, repr=False)
    _units: tuple[Blocks, Blocks] = field(init=False, repr=False)
    _basis: Floats | None = field(init=False, repr=False)
    _to_dof: Floats | None = field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Fold a constant mass matrix into the stiffness."""
        units = collect(self.K[1:]), collect(self.M[1:])
        checks.set_fields(self, _units=units, _basis=None, _to_dof=None)
        if len(self.M) == 1:
            inverse = np.linalg.inv(np.linalg.cholesky(self.M[0]))
            K = inverse @ self.K @ inverse.T
            to_dof = self._report(inverse.T)
            checks.set_fields(self, K=K, _basis=inverse.T, _to_dof=to_dof)

    def solve(
        self, k: Floats, m: Floats, describe: Callable[[int], str]
    ) -> ModalSolution:
        """Solve for coefficients ``k (n, n_k)`` and ``m (n, n_m)``.

        ``describe(i)`` names parameter set i in an error message.
        """
        eigenvalues, y, basis = self._decompose(k, m, describe, self.shapes)
        return self._read(eigenvalues, y if self.shapes else None, basis)

    def jacobian(
        self, k: Floats, m: Floats, slopes: Slopes, describe: Callable[[int], str]
    ) -> tuple[ModalSolution, Derivatives]:
        """Return what :meth:`solve` does, and its derivatives, from one solve.

        ``slopes`` say how ``k`` and ``m`` change with each parameter.
        """
        eigenvalues, y, basis = self._decompose(k, m, describe, True)
        shapes = basis @ y
        reported = None if not self.shapes else self._report(shapes)
        modes = Modes(eigenvalues, shapes, reported, self.selected, self.skip, describe)
        solution = self._read(eigenvalues, y if self.shapes else None, basis)
        return solution, differentiate(modes, *self._units, slopes)

    def _decompose(
        self, k: Floats, m: Floats, describe: Callable[[int], str], vectors: bool
    ) -> tuple[Floats, Any, Floats]:
        """Return eigenvalues, eigenvectors y of A, or None, and ``L^-T``."""
        A = combine(self.K, k)
        basis = self._basis
        if basis is None:
            inverse = self._inverse_factor(m, describe)
            basis = inverse.transpose(0, 2, 1)
            A = inverse @ A @ basis
        try:
            found: tuple[Any, Any] = (
                np.linalg.eigh(A) if vectors else (np.linalg.eigvalsh(A), None)
            )
        except np.linalg.LinAlgError:  # infinite or NaN entries
            bad = int(np.argmin(np.isfinite(A).all(axis=(1, 2))))
            raise ValueError(f"parameters: no eigenvalues at {describe(bad)}") from None
        eigenvalues, y = found
        # What a zero eigenvalue may come out as; grows like a random walk.
        rounding = 10 * EPS * math.sqrt(eigenvalues.shape[1]) * eigenvalues[:, -1]
        check_elastic(eigenvalues, rounding, self.skip, describe)
        return eigenvalues, y, basis

    def _read(
        self, eigenvalues: Floats, y: Floats | None, basis: Floats
    ) -> ModalSolution:
        shapes = None
        if y is not None:
            to_dof = self._report(basis) if self._to_dof is None else self._to_dof
            shapes = to_dof @ y.take(self.selected, axis=2)
        # Contiguous rows: a sum over modes must round alike for one row and for many.
        frequencies = np.sqrt(eigenvalues.take(self.selected, axis=1))
        frequencies /= 2 * np.pi
        return ModalSolution(frequencies, shapes)

    def _inverse_factor(self, m: Floats, describe: Callable[[int], str]) -> Floats:
        """Return the inverse Cholesky factors of the mass matrices, ``(n, N, N)``."""
        mass = combine(self.M, m)
        try:
            return np.linalg.inv(np.linalg.cholesky(mass))
        except np.linalg.LinAlgError:
            bad = int(np.argmin(np.linalg.eigvalsh(mass)[:, 0]))
            raise ValueError(
                f"the mass matrix is not positive definite at {describe(bad)}"
            ) from None

    def _report(self, to_dof: Floats) -> Floats:
        return to_dof if self.output is None else self.output @ to_dof


def output_rows(dofs: Sequence[int], size: int) -> Floats | None:
    """Return the ``output`` of an :class:`Eigenproblem` for shapes at some DOFs."""
    natural = tuple(dofs) in ((), tuple(range(size)))
    return None if natural else np.eye(size)[list(dofs)]


def check_elastic(
    eigenvalues: Any, rounding: Any, skip: int, describe: Callable[[int], str]
) -> None:
    """Raise ValueError unless exactly ``skip`` eigenvalues are zero, in each row.

    Args:
        eigenvalues: Ascending, ``(n, skip + 1)`` or more.
        rounding: What a zero eigenvalue may come out as, ``(n,)``.
        skip: The expected number of rigid-body modes.
        describe: Names row i in the message.
    """
    first = eigenvalues[:, skip]
    flexible = first > rounding
    if not flexible.all():
        i = int(np.argmin(flexible))
        raise ValueError(
            f"mode {skip + 1} is not elastic (omega^2 = {first[i]:.3g} (rad/s)^2) "
            f"at {describe(i)}: a negative value means a stiffness matrix that is "
            f"not positive (give the prior bounds that keep stiffnesses and masses "
            f"above zero), zero a rigid-body mode beyond skip={skip}"
        )
    if skip:
        rigid = np.abs(eigenvalues[:, skip - 1])
        is_rigid = rigid <= np.maximum(RIGID_RATIO * first, rounding)
        if not is_rigid.all():
            i = int(np.argmin(is_rigid))
            raise ValueError(
                f"skip={skip}, but mode {skip} is elastic: "
                f"{np.sqrt(rigid[i]) / (2 * np.pi):.4g} Hz at {describe(i)}; "
                "the structure has fewer rigid-body modes"
            )


def combine(terms: Floats, coefficients: Floats) -> Floats:
    """Return ``terms[0] + sum_i coefficients[:, i] terms[1 + i]``, ``(n, N, N)``."""
    n, (n_terms, size, _) = len(coefficients), terms.shape
    if n_terms == 1:
        return np.broadcast_to(terms[0], (n, size, size))
    # One row at a time inside matmul: a (n, n_k) @ (n_k, N^2) product rounds
    # differently with n, and a pool must give the same bits as one vectorised call.
    # Contiguous, or matmul sums rows of a batch by other means than a row alone.
    rows = np.ascontiguousarray(coefficients)[:, None, :]
    rows = rows @ terms[1:].reshape(n_terms - 1, -1)
    result: Floats = rows.reshape(n, size, size)
    result += terms[0]
    return result
