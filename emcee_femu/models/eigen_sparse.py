r"""The sparse eigenproblem K phi = omega^2 M phi, by shift-invert Lanczos.

Derivatives of frequencies are those of a dense one. Those of shapes, of which a sparse
solver returns few, are by Nelson's method:

.. math:: (K - \lambda_i M) x = -(K' - \lambda_i M' - \lambda_i' M) \phi_i, \qquad
    \phi_i' = x - (\phi_i^T M x + \tfrac12 \phi_i^T M' \phi_i) \phi_i

Its matrix is singular along the mode; with one DOF of x held, where the mode is large,
it is not.

Source: Nelson, AIAA J. 14 (1976) 1201, doi:10.2514/3.7211.
"""

import inspect
from collections.abc import Callable, Sequence
from typing import TypeAlias

import numpy as np
from scipy.linalg import qr
from scipy.sparse import csc_array, diags_array
from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigsh

from ..interfaces import Derivatives, Floats, ModalSolution, RepeatedModes
from .eigen_dense import (
    EPS,
    REPEATED,
    Slopes,
    at_row,
    check_elastic,
    refuse_parting,
)
from .factorization import Factor, factor_definite, factor_indefinite

SEMIDEFINITE = 1e-9  # an eigenvalue of a mass, by its diagonal, that is as good as zero
TOLERANCE = 1e-10  # for mode shapes; an eigenvalue errs by the square
# Newer versions of scipy draw from the system when Lanczos restarts, unless seeded.
SEEDED = "rng" in inspect.signature(eigsh).parameters

Pairs: TypeAlias = tuple[Floats, Floats]  # eigenvalues (m,), vectors (N, m)


class SparseSum:
    r"""``A(a) = A_0 + sum a_i A_i``, where only the stored numbers change.

    .. math:: d(a) = d_0 + D a

    where d are the stored numbers of A on the union of the patterns of all terms, which
    is found once. D is sparse as well: an entry of A depends on few parameters. With
    40 parameters the sum by scipy takes as long as the modes.

    Args:
        terms: A_0, then the A_i, each ``(N, N)``.
    """

    def __init__(self, terms: Sequence[csc_array]) -> None:
        self.size = terms[0].shape[0]
        entries = [term.tocoo() for term in terms]
        # The place of each number when columns are laid end to end.
        places = [e.col.astype(np.int64) * self.size + e.row for e in entries]
        pattern, row = np.unique(np.concatenate(places), return_inverse=True)
        number = np.repeat(np.arange(len(terms)), [len(own) for own in places])
        data = np.concatenate([e.data for e in entries])
        self.numbers = csc_array(
            (data, (row, number)), shape=(len(pattern), len(terms))
        )
        ends = np.searchsorted(pattern, self.size * np.arange(self.size + 1))
        self.pattern = (pattern % self.size).astype(np.int32), ends.astype(np.int32)

    def __call__(self, coefficients: Floats) -> csc_array:
        """Return the matrix for ``coefficients (n_units,)``."""
        data = self.numbers @ np.append(1.0, coefficients)
        matrix = csc_array((data, *self.pattern), shape=(self.size, self.size))
        matrix.has_canonical_format = True  # known here; saves a search at each use
        return matrix


class SparseEigenproblem:
    r"""``K(a) = K0 + sum a_i K_i`` and ``M(b) = M0 + sum b_j M_j``, scipy.sparse.

    .. math:: (K + \sigma M)^{-1} M \phi = (\omega^2 + \sigma)^{-1} \phi

    K is factored without pivoting in a symmetric ordering; sigma is zero, or a small
    positive number where there are rigid-body modes. The signs of the pivots are the
    inertia of the factored matrix (Sylvester), so that an indefinite K is refused at
    no cost. Modes below the last one are not counted: that would take a second
    factorisation, a third of the solve, and found none missing in 1,200 solves of a
    square building with double frequencies. (:func:`check_complete` counts them once
    where a model is reduced.) Massless DOFs may stay.

    Args:
        K: Stiffness matrices: K0, then those of unit coefficients, each ``(N, N)``.
        M: Mass matrices, likewise.
        n_modes: How many elastic modes to return.
        skip: Number of rigid-body modes below them, checked at each solve.
        dofs: Where mass-normalised shapes are wanted; empty for none.

    Attributes:
        stiffness: K as a function of its coefficients ``(n_k,)``.
        mass: M as a function of its coefficients ``(n_m,)``.

    Source: Ericsson and Ruhe, Math. Comp. 35 (1980) 1251,
        doi:10.1090/S0025-5718-1980-0583502-2.
    """

    def __init__(
        self,
        K: Sequence[csc_array],
        M: Sequence[csc_array],
        n_modes: int,
        skip: int = 0,
        dofs: Sequence[int] = (),
    ) -> None:
        self.K, self.M, self.n_modes, self.skip = tuple(K), tuple(M), n_modes, skip
        self.dofs = np.array(dofs, dtype=np.intp)
        self.stiffness, self.mass = SparseSum(K), SparseSum(M)

    def solve(
        self, k: Floats, m: Floats, describe: Callable[[int], str]
    ) -> ModalSolution:
        """Solve for coefficients ``k (n, n_k)`` and ``m (n, n_m)``, one by one.

        ``describe(i)`` names parameter set i in an error message.
        """
        return self.jacobian(k, m, {}, describe)[0]

    def jacobian(
        self, k: Floats, m: Floats, slopes: Slopes, describe: Callable[[int], str]
    ) -> tuple[ModalSolution, Derivatives]:
        """Return what :meth:`solve` does, and its derivatives, from one solve.

        Frequencies cost next to nothing, shapes a factorisation for each mode.
        ``slopes`` say how ``k`` and ``m`` change with each parameter. Whether the last
        mode coincides with one above it is seen only where shapes are wanted.
        """
        n, count, dofs = len(k), self.n_modes, self.dofs
        frequencies = np.empty((n, count))
        shapes = np.empty((n, len(dofs), count))
        changes = np.empty((len(slopes), n, count))
        turns = np.empty((len(slopes), *shapes.shape))
        for i in range(n):
            values, phi = self.lowest(k[i], m[i], self.skip + count, describe(i))
            modes = values[self.skip :], phi[:, self.skip :]
            frequencies[i], shapes[i] = np.sqrt(modes[0]) / (2 * np.pi), modes[1][dofs]
            if slopes:
                matrices = self.stiffness(k[i]), self.mass(m[i])
                changes[:, i], turns[:, i] = self._differentiate(
                    matrices, modes, at_row(slopes, i), describe(i)
                )
        changes /= 8 * np.pi**2 * frequencies
        derivatives = {"frequency": dict(zip(slopes, changes, strict=True))}
        if len(dofs):
            derivatives["shapes"] = dict(zip(slopes, turns, strict=True))
        return ModalSolution(frequencies, shapes if len(dofs) else None), derivatives

    def _differentiate(
        self,
        matrices: tuple[csc_array, csc_array],
        modes: Pairs,
        slopes: Slopes,
        where: str,
    ) -> tuple[Floats, Floats]:
        """Return derivatives of eigenvalues ``(d, m)`` and shapes ``(d, n_dof, m)``.

        Of one parameter set, with its K and M; modes that coincide are one cluster.
        """
        (K, M), (eigenvalues, shapes), dofs = matrices, modes, self.dofs
        units = [*self.K[1:], *self.M[1:]]
        weights = [np.array([*part]) for part in zip(*slopes.values(), strict=True)]
        size = np.abs(shapes)
        rounding = 10 * EPS * (size * (abs(K) @ size)).sum(axis=0)
        least = np.maximum(REPEATED * eigenvalues, rounding)
        ends = np.flatnonzero(np.diff(eigenvalues) > least[1:]) + 1
        changes = np.empty((len(slopes), len(eigenvalues)))
        turns = np.empty((len(slopes), len(dofs), len(eigenvalues)))
        for cluster in np.split(np.arange(len(eigenvalues)), ends):
            phi, eigenvalue = shapes[:, cluster], float(eigenvalues[cluster].mean())
            first = int(cluster[0]) + 1
            if len(cluster) > 1:
                refuse_parting(phi, eigenvalue, first, units, slopes, where)
            pushed = np.array([A @ phi for A in units])
            elastic = np.tensordot(weights[0], pushed[: len(self.K) - 1], 1)
            inertia = np.tensordot(weights[1], pushed[len(self.K) - 1 :], 1)
            force = elastic - eigenvalue * inertia
            H = phi.T @ force
            changes[:, cluster] = np.diagonal(H, axis1=1, axis2=2)
            if len(dofs):
                right = M @ phi @ H - force
                shifted = csc_array(K - eigenvalue * M)
                x, gap = _solve_held(shifted, K, M, phi, right)
                if not gap > np.sqrt(len(phi)) * least[cluster].max():
                    last = int(cluster[-1]) + 1
                    raise RepeatedModes(
                        f"mode {last} coincides with one above it, or nearly with one "
                        f"below, at {where}: its shape has no derivative by itself"
                        + f"; ask for n_modes={last + 1}"
                        * (last == len(eigenvalues))
                    )
                turn = x[:, dofs] - 0.5 * phi[dofs] @ (phi.T @ inertia)
                turns[:, :, cluster] = turn
        return changes, turns

    def lowest(self, k: Floats, m: Floats, count: int, where: str) -> Pairs:
        """Return the lowest eigenvalues ``(count,)`` and mass-normalised vectors.

        Rigid-body modes are included; ``where`` names the parameters in an error.
        """
        K, M = self.stiffness(k), self.mass(m)
        if len(self.M) > 1:
            check_mass(M, f"the mass matrix at {where}")
        return lowest_modes(K, M, count, self.skip, where)


def lowest_modes(
    K: csc_array, M: csc_array, count: int, skip: int, where: str
) -> Pairs:
    """Return the lowest eigenvalues ``(count,)`` and mass-normalised vectors.

    Rigid-body modes are included; ``where`` names the parameters in an error.
    """
    massive = np.count_nonzero(M.diagonal())
    if count > massive:
        raise ValueError(
            f"n_modes: expected skip + n_modes <= {massive} (the DOFs with mass), "
            f"got {count}"
        )
    values, vectors = _solve_shifted(K, M, count, skip, where)
    # The strain energy of a rigid motion is a difference of large terms: what is
    # left of it is rounding of their size. (A bound by the largest eigenvalue
    # would refuse models with penalty springs or tiny masses.)
    largest = np.abs(vectors[:, skip])
    rounding = 10 * EPS * np.array([largest @ (abs(K) @ largest)])
    check_elastic(values[None], rounding, skip, lambda _: where)
    return values, vectors


def check_complete(K: csc_array, M: csc_array, values: Floats, where: str) -> None:
    """Raise ValueError if a mode below the last of the eigenvalues ``(m,)`` is missing.

    Below a number between the last two that differ, K - sigma M says how many there
    are: a second factorisation.
    """
    apart = np.flatnonzero(np.diff(values) > 1e-6 * np.abs(values[1:]))
    if not len(apart):
        return
    below = int(apart[-1]) + 1
    shift = float(values[below - 1 : below + 1].mean())
    try:
        counted = factor_indefinite(csc_array(K - shift * M)).negative
    except RuntimeError:  # a pivot is zero before the last
        return
    if counted != below:
        raise ValueError(
            f"the full model missed a mode at {where}: {counted} are below "
            f"{np.sqrt(shift) / (2 * np.pi):g} Hz, {below} were found; ask for other "
            "n_modes"
        )


def _solve_shifted(
    K: csc_array, M: csc_array, count: int, skip: int, where: str
) -> Pairs:
    """Return the pairs nearest to ``-sigma``, ascending.

    Sigma is small, but enough to factor a K with rigid-body modes. From 1e-6 to
    1e4 times the first elastic eigenvalue the result is the same.
    """
    mass, shift = M.diagonal(), 0.0
    if skip:
        ratio = K.diagonal()[mass > 0] / mass[mass > 0]
        positive = ratio[ratio > 0]
        shift = 1e-6 * float(np.median(positive)) if len(positive) else 1.0
    factor = factor_definite(csc_array(K + shift * M) if shift else K)
    if factor is None:
        raise ValueError(
            f"mode {skip + 1} is not elastic (a pivot of the stiffness is not "
            f"above zero) at {where}: a stiffness matrix that is not positive "
            "(give the prior bounds that keep stiffnesses and masses above zero), "
            f"or a rigid-body mode beyond skip={skip}"
        )
    if np.count_nonzero(mass) <= max(2 * count + 1, 20):
        values, vectors = _solve_condensed(factor, M, count)
        return values - shift, vectors
    # Seeded: equal parameters give equal bits. Random: it holds every mode.
    start = np.random.default_rng(0).normal(size=K.shape[0])
    options: dict[str, object] = {"v0": start, "tol": TOLERANCE}
    if SEEDED:
        options["rng"] = np.random.default_rng(0)
    inverse = LinearOperator(K.shape, matvec=factor.solve, dtype=float)
    try:
        values, vectors = eigsh(K, count, M, -shift, OPinv=inverse, **options)
    except ArpackNoConvergence as error:
        raise ValueError(f"{error} at {where}; ask for other n_modes") from None
    order = np.argsort(values)
    return values[order], vectors[:, order]


def _solve_condensed(factor: Factor, M: csc_array, count: int) -> Pairs:
    """Return pairs from the flexibility at DOFs with mass: dense, and exact.

    Where these are few there is no room for a Krylov space.
    """
    massive = np.flatnonzero(M.diagonal())
    load = np.zeros((M.shape[0], len(massive)))
    load[massive, np.arange(len(massive))] = 1.0
    squares, axes = np.linalg.eigh(M[massive][:, massive].toarray())
    root = axes * np.sqrt(np.maximum(squares, 0.0))  # M may be semidefinite
    X = factor.solve(load) @ root
    inverse, y = np.linalg.eigh(root.T @ X[massive])
    inverse, y = inverse[: -count - 1 : -1], y[:, : -count - 1 : -1]
    return 1 / inverse, X @ y / inverse


def check_mass(M: csc_array, label: str) -> None:
    """Raise ValueError unless M is positive (semi)definite, and some of it is mass.

    Reduced integration leaves the mass of FE programs singular; what rounding makes of
    its zero eigenvalues is allowed for by a share of the diagonal.
    """
    diagonal = M.diagonal()
    massive = np.flatnonzero(diagonal)
    positive = len(massive) > 0 and bool((diagonal >= 0).all())
    entries = M.count_nonzero()
    if positive and entries > len(massive):  # not lumped
        block = M[massive][:, massive]
        shifted = csc_array(block + diags_array(SEMIDEFINITE * diagonal[massive]))
        positive = entries == block.count_nonzero()
        positive = positive and factor_definite(shifted) is not None
    if not positive:
        raise ValueError(
            f"{label} is not positive definite: expected a positive definite matrix, "
            "or a semidefinite one, such as with massless DOFs, whose rows are zero"
        )


def _solve_held(
    A: csc_array, K: csc_array, M: csc_array, phi: Floats, right: Floats
) -> tuple[Floats, float]:
    """Return ``x (d, N, c)`` of ``A x = right``, M-orthogonal to its null space phi.

    Modes that coincide are held together, at as many DOFs. Also returned is at least
    the distance of their eigenvalue to those with the DOFs held; zero if they coincide.
    """
    N, c = phi.shape
    scaled = phi * np.sqrt(np.abs(K.diagonal()))[:, None]  # free of DOFs' units
    held = qr(scaled.T, mode="r", pivoting=True)[1][:c]
    kept = np.delete(np.arange(N), held)
    A = A[:, kept][kept].tocsc()
    probe = np.random.default_rng(0).normal(size=N)
    load = M @ probe
    b = np.column_stack([right.transpose(1, 0, 2).reshape(N, -1), load])[kept]
    x = np.zeros((N, b.shape[1]))
    try:
        factor = factor_indefinite(A, 0.01)
    except RuntimeError:  # exactly singular
        return x[None], 0.0
    x[kept] = factor.solve(b)
    x[kept] += factor.solve(b - A @ x[kept])
    answer = x[:, -1]
    gap = float(np.sqrt(probe @ load / (answer @ (M @ answer))))
    by_parameter = x[:, :-1].reshape(N, len(right), c).transpose(1, 0, 2)
    return by_parameter - phi @ ((M @ phi).T @ by_parameter), gap
