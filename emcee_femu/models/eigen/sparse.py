"""The sparse eigenproblem K phi = omega^2 M phi, by shift-invert Lanczos."""

import inspect
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array, diags_array
from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigsh, splu

from ... import checks
from ...interfaces import Floats, ModalSolution
from .dense import check_elastic
from .nelson import Pairs, collect_sparse, differentiate_pairs
from .sensitivity import EPS, Derivatives, Slopes, at_row, by_name
from .sparse_sum import SparseSum

SEMIDEFINITE = 1e-9  # an eigenvalue of a mass, by its diagonal, that is as good as zero
TOLERANCE = 1e-10  # for mode shapes; an eigenvalue errs by the square
# Newer versions of scipy draw from the system when Lanczos restarts, unless seeded.
SEEDED = "rng" in inspect.signature(eigsh).parameters


@dataclass(frozen=True, eq=False)
class SparseEigenproblem:
    r"""``K(a) = K0 + sum a_i K_i`` and ``M(b) = M0 + sum b_j M_j``, scipy.sparse.

    .. math:: (K + \sigma M)^{-1} M \phi = (\omega^2 + \sigma)^{-1} \phi

    K is factored without pivoting in a symmetric ordering; sigma is zero, or a small
    positive number where there are rigid-body modes. The signs of the pivots are the
    inertia of the factored matrix (Sylvester), so that an indefinite K is refused at
    no cost. Modes below the last one are not counted: that would take a second
    factorisation, a third of the solve, and found none missing in 1,200 solves of a
    square building with double frequencies. Massless DOFs may stay.

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

    K: tuple[csc_array, ...]
    M: tuple[csc_array, ...]
    n_modes: int
    skip: int = 0
    dofs: tuple[int, ...] = ()
    stiffness: SparseSum = field(init=False, repr=False)
    mass: SparseSum = field(init=False, repr=False)
    _start: Floats = field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Find the patterns of the sums."""
        # Only with a shift are both matrices added, and need a pattern in common.
        also_K, also_M = (self.M, self.K) if self.skip else ((), ())
        checks.set_fields(
            self,
            stiffness=SparseSum(self.K, also_K),
            mass=SparseSum(self.M, also_M),
            # Seeded: equal parameters give equal bits. Random: it holds every mode.
            _start=np.random.default_rng(0).normal(size=self.K[0].shape[0]),
        )

    def solve(
        self, k: Floats, m: Floats, describe: Callable[[int], str]
    ) -> ModalSolution:
        """Solve for coefficients ``k (n, n_k)`` and ``m (n, n_m)``, one by one.

        ``describe(i)`` names parameter set i in an error message.
        """
        count = self.skip + self.n_modes
        frequencies = np.empty((len(k), self.n_modes))
        dofs = np.array(self.dofs, dtype=np.intp)
        shapes = np.empty((len(k), len(dofs), self.n_modes))
        for i, (own_k, own_m) in enumerate(zip(k, m, strict=True)):
            eigenvalues, vectors = self.lowest(own_k, own_m, count, describe(i))
            frequencies[i] = np.sqrt(eigenvalues[self.skip :]) / (2 * np.pi)
            shapes[i] = vectors[dofs, self.skip :]
        return ModalSolution(frequencies, shapes if self.dofs else None)

    def jacobian(
        self, k: Floats, m: Floats, slopes: Slopes, describe: Callable[[int], str]
    ) -> tuple[ModalSolution, Derivatives]:
        """Return what :meth:`solve` does, and its derivatives, from one solve.

        Frequencies cost next to nothing, shapes a factorisation for each mode.
        ``slopes`` say how ``k`` and ``m`` change with each parameter. Whether the last
        mode coincides with one above it is seen only where shapes are wanted.
        """
        count = self.skip + self.n_modes
        units = collect_sparse(self.K[1:]), collect_sparse(self.M[1:])
        dofs = np.array(self.dofs, dtype=np.intp)
        frequencies = np.empty((len(k), self.n_modes))
        shapes = np.empty((len(k), len(dofs), self.n_modes))
        changes = np.empty((len(k), len(slopes), self.n_modes))
        turns = np.empty((len(k), len(slopes), *shapes.shape[1:]))
        for i, (own_k, own_m) in enumerate(zip(k, m, strict=True)):
            eigenvalues, vectors = self.lowest(own_k, own_m, count, describe(i))
            frequencies[i] = np.sqrt(eigenvalues[self.skip :]) / (2 * np.pi)
            shapes[i] = vectors[dofs, self.skip :]
            pairs = Pairs(
                self.stiffness(own_k),
                self.mass(own_m),
                eigenvalues[self.skip :],
                vectors[:, self.skip :],
                describe(i),
            )
            own = {name: at_row(slope, i) for name, slope in slopes.items()}
            changes[i], turns[i] = differentiate_pairs(pairs, units, own, dofs)
        changes /= 8 * np.pi**2 * frequencies[:, None]
        derivatives = {"frequency": by_name(slopes, changes)}
        if self.dofs:
            derivatives["shapes"] = by_name(slopes, turns)
        return ModalSolution(frequencies, shapes if self.dofs else None), derivatives

    def lowest(
        self, k: Floats, m: Floats, count: int, where: str
    ) -> tuple[Floats, Floats]:
        """Return the lowest eigenvalues ``(count,)`` and mass-normalised vectors.

        Rigid-body modes are included; ``where`` names the parameters in an error.
        """
        K, M = self.stiffness(k), self.mass(m)
        if len(self.M) > 1:
            check_mass(M, f"the mass matrix at {where}")
        massive = np.count_nonzero(M.diagonal())
        if count > massive:
            raise ValueError(
                f"n_modes: expected skip + n_modes <= {massive} (the DOFs with mass), "
                f"got {count}"
            )
        values, vectors = self._solve_shifted(K, M, count, where)
        self._check(K, values, vectors, where)
        return values, vectors

    def _choose_shift(self, K: csc_array, M: csc_array) -> float:
        """Return sigma: small, but enough to factor a K with rigid-body modes.

        From 1e-6 to 1e4 times the first elastic eigenvalue the result is the same.
        """
        if not self.skip:
            return 0.0
        mass = M.diagonal()
        ratio = K.diagonal()[mass > 0] / mass[mass > 0]
        positive = ratio[ratio > 0]
        return 1e-6 * float(np.median(positive)) if len(positive) else 1.0

    def _solve_shifted(
        self, K: csc_array, M: csc_array, count: int, where: str
    ) -> tuple[Floats, Floats]:
        """Return the pairs nearest to ``-sigma``, ascending."""
        shift = self._choose_shift(K, M)
        A = K + shift * M if shift else K
        factor = self.factor(A, where)
        massive = np.flatnonzero(M.diagonal())
        if len(massive) <= max(2 * count + 1, 20):  # no room for a Krylov space
            values, vectors = _solve_condensed(factor, M, massive, count)
            return values - shift, vectors
        options: dict[str, Any] = {"v0": self._start, "tol": TOLERANCE}
        options["OPinv"] = LinearOperator(K.shape, matvec=factor.solve, dtype=float)
        if SEEDED:
            options["rng"] = np.random.default_rng(0)
        try:
            values, vectors = eigsh(K, count, M, sigma=-shift, **options)
        except ArpackNoConvergence as error:
            raise ValueError(f"{error} at {where}; ask for other n_modes") from None
        order = np.argsort(values)
        return values[order], vectors[:, order]

    def factor(self, A: csc_array, where: str) -> Any:
        """Return the SuperLU factor of a positive definite matrix."""
        try:
            factor = symmetric_factor(A)
            negative = int(np.count_nonzero(factor.U.diagonal() <= 0))
        except RuntimeError:  # exactly singular
            negative = 1
        if negative:
            raise ValueError(
                f"mode {self.skip + 1} is not elastic ({negative} pivot(s) of the "
                f"stiffness are not above zero) at {where}: a stiffness matrix that "
                f"is not positive (give the prior bounds that keep stiffnesses and "
                f"masses above zero), or a rigid-body mode beyond skip={self.skip}"
            )
        return factor

    def _check(self, K: csc_array, values: Floats, vectors: Floats, where: str) -> None:
        # The strain energy of a rigid motion is a difference of large terms: what is
        # left of it is rounding of their size. (A bound by the largest eigenvalue
        # would refuse models with penalty springs or tiny masses.)
        largest = np.abs(vectors[:, self.skip])
        rounding = 10 * EPS * float(largest @ (abs(K) @ largest))
        check_elastic(values[None], np.array([rounding]), self.skip, lambda _: where)


def _solve_condensed(
    factor: Any, M: csc_array, massive: NDArray[np.intp], count: int
) -> tuple[Floats, Floats]:
    """Return pairs from the flexibility at few DOFs with mass: dense, and exact."""
    load = np.zeros((M.shape[0], len(massive)))
    load[massive, np.arange(len(massive))] = 1.0
    mass = M[massive][:, massive].toarray()
    try:
        L = np.linalg.cholesky(mass)
    except np.linalg.LinAlgError:  # semidefinite
        squares, axes = np.linalg.eigh(mass)
        L = axes * np.sqrt(np.maximum(squares, 0.0))
    X = factor.solve(load) @ L
    inverse, y = np.linalg.eigh(L.T @ X[massive])
    inverse, y = inverse[: -count - 1 : -1], y[:, : -count - 1 : -1]
    return 1 / inverse, X @ y / inverse


def symmetric_factor(A: csc_array) -> Any:
    """Return the LU factor of a symmetric matrix with pivots on its diagonal."""
    return splu(
        A,
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0,
        options={"SymmetricMode": True},
    )


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
        block = M[massive][:, massive].tocsc()
        positive = entries == block.count_nonzero()
        positive = positive and is_positive(block, SEMIDEFINITE)
    if not positive:
        raise ValueError(
            f"{label} is not positive definite: expected a positive definite matrix, "
            "or a semidefinite one, such as with massless DOFs, whose rows are zero"
        )


def is_positive(M: csc_array, share: float) -> bool:
    """Return whether M with a share of its diagonal added is positive definite."""
    shifted = M + diags_array(share * M.diagonal())
    try:
        return bool((symmetric_factor(csc_array(shifted)).U.diagonal() > 0).all())
    except RuntimeError:  # exactly singular
        return False
