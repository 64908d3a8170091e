r"""The batched eigenproblem K phi = omega^2 M phi of dense matrices, with derivatives.

.. math:: \lambda_i' = \phi_i^T (K' - \lambda_i M') \phi_i, \qquad
    f_i' = \frac{\lambda_i'}{8 \pi^2 f_i}

of mass-normalised shapes that keep their signs. Derivatives of shapes are sums over
all modes, which a dense solver returns:

.. math:: \phi_i' = \sum_{k \ne i} \frac{\phi_k^T (K' - \lambda_i M') \phi_i}
    {\lambda_i - \lambda_k} \phi_k - \tfrac12 (\phi_i^T M' \phi_i) \phi_i

Modes coincide where their eigenvalues do, to 1e-10 or to rounding. If they stay
together as a parameter changes, their frequencies have a derivative; that of the shapes
is then without turning in the space that they span, in which they are any. If they
part, there is no derivative.

Source: Fox and Kapoor, AIAA J. 6 (1968) 2426, doi:10.2514/3.5008.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..interfaces import Derivatives, Floats, ModalSolution
from .inputs import Matrix

EPS = float(np.finfo(float).eps)
RIGID_RATIO = 1e-4  # a rigid-body eigenvalue is below this share of the next one
REPEATED = 1e-10  # relative gap of eigenvalues below which modes coincide
PARTING = 1e-7  # share of a derivative's terms that may be left by rounding

Weight: TypeAlias = Floats | float  # (n,), or the same for all parameter sets
# How the coefficients of K, and those of M, change with a parameter, by number.
Slope: TypeAlias = tuple[Mapping[int, Weight], Mapping[int, Weight]]
Slopes: TypeAlias = Mapping[str, Slope]


class Unit(NamedTuple):
    """A matrix of a coefficient, without its rows and columns of zeros.

    The matrix of a spring, storey or member has few that are not zero.

    Attributes:
        rows: The rows that are not zero, ``(s,)``.
        entries: What is in them, ``(s, s)``.
    """

    rows: NDArray[np.intp]
    entries: Matrix


# Of the coefficients of K, and of those of M.
Units: TypeAlias = tuple[list[Unit], list[Unit]]


def trim_units(K: Sequence[Matrix], M: Sequence[Matrix]) -> Units:
    """Return what coefficients multiply, given the constant matrices first."""

    def trim(matrix: Matrix) -> Unit:
        rows = np.unique(matrix.nonzero()[0])
        return Unit(rows, matrix[np.ix_(rows, rows)])

    return [trim(A) for A in K[1:]], [trim(A) for A in M[1:]]


def unit_slopes(K: Iterable[str], M: Iterable[str]) -> Slopes:
    """Return the slopes of parameters that are the coefficients of K and of M."""
    in_K, in_M = ({name: {i: 1.0} for i, name in enumerate(part)} for part in (K, M))
    return {name: (in_K.get(name, {}), in_M.get(name, {})) for name in in_K | in_M}


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
        output: Maps mass-normalised shapes to what is returned of them, ``(n_out, N)``;
            None for frequencies alone.
    """

    def __init__(
        self,
        K: Floats,
        M: Floats,
        selected: NDArray[np.intp],
        skip: int = 0,
        output: Floats | None = None,
    ) -> None:
        self.K, self.M, self.selected, self.skip = K, M, selected, skip
        self.output, self.units = output, trim_units([*K], [*M])
        self._basis: Floats | None = None  # L^-T of a constant M
        self._to_output: Floats | None = None  # output @ L^-T
        if len(M) == 1:
            inverse = np.linalg.inv(np.linalg.cholesky(M[0]))
            self.K, self._basis = inverse @ K @ inverse.T, inverse.T
            self._to_output = None if output is None else output @ inverse.T

    def solve(
        self, k: Floats, m: Floats, describe: Callable[[int], str]
    ) -> ModalSolution:
        """Solve for coefficients ``k (n, n_k)`` and ``m (n, n_m)``.

        ``describe(i)`` names parameter set i in an error message.
        """
        vectors = self.output is not None
        eigenvalues, y, basis = self._decompose(k, m, describe, vectors)
        frequencies = np.sqrt(eigenvalues.take(self.selected, axis=1)) / (2 * np.pi)
        if self.output is None:
            return ModalSolution(frequencies)
        y = y.take(self.selected, axis=2)
        if self._to_output is not None:
            return ModalSolution(frequencies, self._to_output @ y)
        return ModalSolution(frequencies, self.output @ (basis @ y))

    def jacobian(
        self, k: Floats, m: Floats, slopes: Slopes, describe: Callable[[int], str]
    ) -> tuple[ModalSolution, Derivatives]:
        """Return what :meth:`solve` does, and its derivatives, from one solve.

        ``slopes`` say how ``k`` and ``m`` change with each parameter.

        Raises:
            ValueError: As :meth:`solve` does, or if modes coincide that part as a
                parameter changes: which of them is the lower one changes there.
        """
        eigenvalues, y, basis = self._decompose(k, m, describe, True)
        selected, count = self.selected, np.arange(len(self.selected))
        every = basis @ y  # (n, N, N)
        wanted, squares = every[:, :, selected], eigenvalues[:, None, selected]
        frequencies = np.sqrt(squares[:, 0]) / (2 * np.pi)
        clusters = _number_clusters(eigenvalues)
        together = clusters[:, :, None] == clusters[:, None, selected]  # (n, N, m)
        for row in np.flatnonzero(together.sum(axis=(1, 2)) > len(count)):
            for number in np.unique(clusters[row, selected]):
                members = np.flatnonzero(clusters[row] == number)
                refuse_parting(
                    every[row][:, members],
                    float(eigenvalues[row, members[0]]),
                    int(members[0]) - self.skip + 1,
                    self.units,
                    take_row(slopes, int(row)),
                    describe(int(row)),
                )
        output = None if self.output is None else self.output @ every
        # Without shapes nothing but the diagonal of H is needed: of other modes none.
        left, own = (wanted, count) if output is None else (every, selected)
        forces = [
            [entries @ wanted[:, rows] for rows, entries in part] for part in self.units
        ]

        def project(part: int, weights: Mapping[int, Weight]) -> Floats:
            """Return ``phi_k^T A' phi_i``, ``(n, N or m, m)``."""
            total = np.zeros((1, 1, 1))
            for number, weight in weights.items():
                force = (weight * forces[part][number].T).T  # of each parameter set
                rows = self.units[part][number].rows
                total = total + left[:, rows].swapaxes(1, 2) @ force
            return total

        gaps = squares - eigenvalues[:, :, None]
        inverse = np.where(together, 0.0, 1.0 / np.where(together, 1.0, gaps))
        frequency, shapes, scale = {}, {}, 8 * np.pi**2 * frequencies
        for name, (in_K, in_M) in slopes.items():
            H, T = project(0, in_K), project(1, in_M)
            if in_M:
                H = H - squares * T
            frequency[name] = H[:, own, count] / scale
            if output is not None:
                turn = inverse * H
                if in_M:
                    turn -= 0.5 * together * T
                shapes[name] = output @ turn
        if output is None:
            return ModalSolution(frequencies), {"frequency": frequency}
        derivatives = {"frequency": frequency, "shapes": shapes}
        return ModalSolution(frequencies, output[:, :, selected]), derivatives

    def _decompose(
        self, k: Floats, m: Floats, describe: Callable[[int], str], vectors: bool
    ) -> tuple[Floats, Floats, Floats]:
        """Return eigenvalues, y (none unless ``vectors``) and ``L^-T``."""
        A, basis = combine(self.K, k), self._basis
        if basis is None:
            mass = combine(self.M, m)
            try:
                inverse = np.linalg.inv(np.linalg.cholesky(mass))
            except np.linalg.LinAlgError:
                bad = int(np.argmin(np.linalg.eigvalsh(mass)[:, 0]))
                raise ValueError(
                    f"the mass matrix is not positive definite at {describe(bad)}"
                ) from None
            basis = inverse.transpose(0, 2, 1)
            A = inverse @ A @ basis
        y = np.empty(0)
        try:
            if vectors:
                eigenvalues, y = np.linalg.eigh(A)
            else:
                eigenvalues = np.linalg.eigvalsh(A)
        except np.linalg.LinAlgError:  # infinite or NaN entries
            bad = int(np.argmin(np.isfinite(A).all(axis=(1, 2))))
            raise ValueError(f"parameters: no eigenvalues at {describe(bad)}") from None
        # What a zero eigenvalue may come out as; grows like a random walk.
        rounding = 10 * EPS * math.sqrt(eigenvalues.shape[1]) * eigenvalues[:, -1]
        check_elastic(eigenvalues, rounding, self.skip, describe)
        return eigenvalues, y, basis


def pick_rows(dofs: Sequence[int], size: int) -> Floats | None:
    """Return the ``output`` of an :class:`Eigenproblem` for shapes at some DOFs."""
    return np.eye(size)[list(dofs)] if dofs else None


def combine(terms: Floats, coefficients: Floats) -> Floats:
    """Return ``terms[0] + sum_i coefficients[:, i] terms[1 + i]``, ``(n, N, N)``."""
    n, N = len(coefficients), terms.shape[1]
    # BLAS rounds a vector otherwise than rows of a matrix, which a run that goes on
    # after a kill may see: gradients of one walker then, are those of many now.
    rows = np.repeat(coefficients, 2, axis=0) if n == 1 else coefficients
    total = (rows @ terms[1:].reshape(-1, N * N)).reshape(-1, N, N)[:n]
    total += terms[0]
    return total


def check_elastic(
    eigenvalues: Floats, rounding: Floats, skip: int, describe: Callable[[int], str]
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


def _number_clusters(eigenvalues: Floats) -> NDArray[np.intp]:
    """Return the number of each mode's cluster, the same where modes coincide."""
    rounding = EPS * np.sqrt(eigenvalues.shape[1]) * eigenvalues[:, -1:]
    apart = np.diff(eigenvalues) > np.maximum(REPEATED * eigenvalues[:, 1:], rounding)
    clusters = np.zeros(eigenvalues.shape, dtype=np.intp)
    clusters[:, 1:] = np.cumsum(apart, axis=1)
    return clusters


def take_row(slopes: Slopes, row: int) -> Slopes:
    """Return the slopes of one parameter set."""

    def at(weights: Mapping[int, Weight]) -> dict[int, Weight]:
        return {i: w if isinstance(w, float) else w[row] for i, w in weights.items()}

    return {name: (at(in_K), at(in_M)) for name, (in_K, in_M) in slopes.items()}


def push(units: list[Unit], weights: Mapping[int, Weight], phi: Floats) -> Floats:
    """Return ``sum_i w_i A_i phi`` for ``phi (N, c)``."""
    total = np.zeros_like(phi)
    for number, weight in weights.items():
        rows, entries = units[number]
        total[rows] += weight * (entries @ phi[rows])
    return total


def refuse_parting(
    phi: Floats, eigenvalue: float, first: int, units: Units, slopes: Slopes, where: str
) -> None:
    """Raise ValueError unless coinciding modes change alike, with every parameter.

    Args:
        phi: Their shapes, ``(N, c)``.
        eigenvalue: That of all of them.
        first: The number of the first of them, 1 = the lowest elastic one.
        units: The matrices of the coefficients.
        slopes: How these change here.
        where: Names the parameters.
    """
    if phi.shape[1] == 1:
        return
    for name, slope in slopes.items():
        H, size = np.zeros((phi.shape[1],) * 2), 0.0
        for part, weights, sign in zip(units, slope, (1.0, -eigenvalue), strict=True):
            for number, weight in weights.items():
                rows, entries = part[number]
                H += sign * weight * phi[rows].T @ (entries @ phi[rows])
                absolute = np.abs(phi[rows]) * (abs(entries) @ np.abs(phi[rows]))
                size += float(np.abs(sign * weight) * absolute.sum())
        gap = H - np.trace(H) / len(H) * np.eye(len(H))
        if np.abs(gap).max() > PARTING * size:
            raise ValueError(
                f"modes {first} and {first + len(H) - 1} coincide "
                f"({np.sqrt(eigenvalue) / (2 * np.pi):.6g} Hz) at {where} and part as "
                f"{name!r} changes: which is the lower one changes there, so that they "
                "have no derivatives; move the parameters a little, by 1e-6 of their "
                "values, or tie those that make the two modes equal to one parameter"
            )
