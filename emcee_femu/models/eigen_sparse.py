r"""The sparse eigenproblem K phi = omega^2 M phi, by shift-invert block Lanczos.

A Krylov space of one vector holds one copy of a multiple eigenvalue; that others turn
up is left to rounding. One of b random vectors holds b copies of each. Where as many
equal ones are found, b more vectors join, until there are more vectors than copies:
no mode below the highest one can be missing, but for start vectors that are orthogonal
to it by accident, which has probability zero.

Derivatives of frequencies are those of a dense one. Those of shapes, of which a sparse
solver returns few, are by Nelson's method:

.. math:: (K - \lambda_i M) x = -(K' - \lambda_i M' - \lambda_i' M) \phi_i, \qquad
    \phi_i' = x - (\phi_i^T M x + \tfrac12 \phi_i^T M' \phi_i) \phi_i

Its matrix is singular along the mode; with one DOF of x held, where the mode is large,
it is not.

Source: Nelson, AIAA J. 14 (1976) 1201, doi:10.2514/3.7211.
"""

from collections.abc import Sequence
from functools import cached_property, partial
from typing import TypeAlias

import numpy as np
from scipy.linalg import qr
from scipy.sparse import csc_array, diags_array

from ..contracts import Floats, ModalSolution, RepeatedModes
from .eigen_dense import (
    A_MECHANISM,
    EPS,
    NOT_POSITIVE,
    REPEATED,
    Eigenproblem,
    ModeRequest,
    Modes,
    Slopes,
    at_row,
    check_differentiable,
    check_elastic,
    find_ill_scaled,
    join,
)
from .factorization import Factor, factor_definite, factor_indefinite
from .matrices import Matrix, Weights
from .parameter_sets import Where

SEMIDEFINITE = 1e-9  # relative eigenvalue of a mass matrix that counts as zero
SHAPE_TOLERANCE = 1e-9  # of mode shapes; an eigenvalue errs by the square
BLOCK = 4  # start vectors: three equal modes, as of a free cube, need no more
# Relative distance of eigenvalues that count as equal, far above SHAPE_TOLERANCE.
EQUAL_MODES = 1e-6
# Squared length, of one, that rounding leaves of what is in the space.
LANCZOS_DEPENDENT = 1e-14

Parts: TypeAlias = Sequence[Matrix]  # the constant one, those of unit coefficients
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
        shape = len(pattern), len(terms)
        self.numbers = csc_array((data, (row, number)), shape=shape)
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
    no cost. The modes returned are the lowest, however many of them coincide, with
    rigid-body modes and massless DOFs, too.

    Args:
        K: Stiffness matrices: K0, then those of unit coefficients, each ``(N, N)``.
        M: Mass matrices, likewise.
        wanted: The wanted modes.
        label: What M0 is called in a message.

    Attributes:
        stiffness: K as a function of its coefficients ``(n_k,)``.
        mass: M as a function of its coefficients ``(n_m,)``.

    Source: Grimes, Lewis and Simon, SIAM J. Matrix Anal. Appl. 15 (1994) 228,
        doi:10.1137/S0895479888151111.
    """

    def __init__(
        self, K: Parts, M: Parts, wanted: ModeRequest, label: str = "M0"
    ) -> None:
        self.K, self.M = (tuple(map(csc_array, part)) for part in (K, M))
        self.skip, self.modes = wanted.skip, np.array(wanted.modes)
        self.sensors = wanted.sensors
        self.stiffness, self.mass = SparseSum(self.K), SparseSum(self.M)
        if len(M) == 1:
            check_mass(self.M[0], label)

    def solve(self, weights: Weights, describe: Where, slopes: Slopes) -> Modes:
        """Solve for coefficients ``k (n, n_k)`` and ``m (n, n_m)``, one by one.

        ``describe(i)`` names parameter set i in an error message. ``slopes`` say how
        ``k`` and ``m`` change with each parameter. By these the derivatives of
        frequencies cost next to nothing, those of shapes a factorisation for each mode.
        Whether the last mode coincides with one above it is seen only where shapes are
        wanted.
        """
        (k, m), count = weights, int(self.modes[-1])
        n, size = len(k), len(self.sensors.labels)
        frequencies = np.empty((n, count))
        shapes = np.empty((n, size, count))
        changes = np.empty((len(slopes), n, count))
        turns = np.empty((len(slopes), *shapes.shape))
        for i in range(n):
            K, M, where = self.stiffness(k[i]), self.mass(m[i]), describe(i)
            if len(self.M) > 1:
                check_mass(M, f"the mass matrix at {where}")
            values, phi = lowest_modes(K, M, self.skip + count, self.skip, where)
            modes = values[self.skip :], phi[:, self.skip :]
            frequencies[i] = np.sqrt(modes[0]) / (2 * np.pi)
            shapes[i] = self.sensors.of(modes[1])
            if slopes:
                at = at_row(slopes, i)
                changes[:, i], turns[:, i] = self._differentiate(K, M, modes, at, where)
        changes /= 8 * np.pi**2 * frequencies
        frequencies, shapes, changes, turns = (
            each[..., self.modes - 1] for each in (frequencies, shapes, changes, turns)
        )
        derivatives = {"frequency": dict(zip(slopes, changes, strict=True))}
        if size:
            derivatives["shapes"] = dict(zip(slopes, turns, strict=True))
        return ModalSolution(frequencies, shapes if size else None), derivatives

    def _differentiate(
        self, K: csc_array, M: csc_array, modes: Pairs, slopes: Slopes, where: str
    ) -> tuple[Floats, Floats]:
        """Return derivatives of eigenvalues ``(d, m)`` and shapes ``(d, n_dof, m)``.

        Of one parameter set, with its K and M; modes that coincide are one cluster.
        """
        (eigenvalues, shapes), sensors = modes, self.sensors
        units = [*self.K[1:], *self.M[1:]]
        weights = [np.concatenate(part) for part in zip(*slopes.values(), strict=True)]
        size = np.abs(shapes)
        rounding = 10 * EPS * (size * (abs(K) @ size)).sum(axis=0)
        least = np.maximum(REPEATED * eigenvalues, rounding)
        ends = np.flatnonzero(np.diff(eigenvalues) > least[1:]) + 1
        changes = np.empty((len(slopes), len(eigenvalues)))
        turns = np.empty((len(slopes), len(sensors.labels), len(eigenvalues)))
        for cluster in np.split(np.arange(len(eigenvalues)), ends):
            phi, eigenvalue = shapes[:, cluster], float(eigenvalues[cluster].mean())
            first = int(cluster[0]) + 1
            if len(cluster) > 1:
                check_differentiable(phi, eigenvalue, first, units, slopes, where)
            pushed = np.array([A @ phi for A in units])
            elastic = np.tensordot(weights[0], pushed[: len(self.K) - 1], 1)
            inertia = np.tensordot(weights[1], pushed[len(self.K) - 1 :], 1)
            force = elastic - eigenvalue * inertia
            H = phi.T @ force
            changes[:, cluster] = np.diagonal(H, axis1=1, axis2=2)
            if sensors.labels:
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
                turn = x - 0.5 * phi @ (phi.T @ inertia)
                turns[:, :, cluster] = sensors.of(turn)
        return changes, turns


class DenseProblem:
    """A dense eigenproblem, and the sparse one where rounding spoils it.

    Dense solvers round all eigenvalues to a fraction of the largest, which matters if,
    say, a DOF is held by a stiffness of 1e36. Sparse factors round each row on its own
    scale.

    The arguments are those of :class:`SparseEigenproblem`, with dense matrices.
    """

    def __init__(
        self, K: Parts, M: Parts, wanted: ModeRequest, label: str = "M0"
    ) -> None:
        self._given, parts = (K, M, wanted, label), (np.array(K), np.array(M))
        output = wanted.sensors.of(np.eye(K[0].shape[0]))
        self._dense = Eigenproblem(*parts, wanted, output, label)
        self.stiffness, self.mass = self._dense.stiffness, self._dense.mass
        self._diagonals = [A.diagonal(axis1=1, axis2=2) for A in parts]

    @cached_property
    def _sparse(self) -> SparseEigenproblem:
        """The sparse problem, created when it is first needed."""
        return SparseEigenproblem(*self._given)

    def solve(self, weights: Weights, describe: Where, slopes: Slopes) -> Modes:
        """Solve as the other two; rows spoilt by rounding one by one."""
        (k, m), (in_K, in_M) = weights, self._diagonals
        ill_scaled = find_ill_scaled(in_K[0] + k @ in_K[1:], in_M[0] + m @ in_M[1:])
        if ill_scaled.any() and len(k) > 1:  # other rows are unaffected
            results = []
            for i in range(len(k)):
                one, at = slice(i, i + 1), partial(lambda row, _: describe(row), i)
                results.append(self.solve([k[one], m[one]], at, at_row(slopes, i)))
            return join(results)
        problem = self._sparse if ill_scaled.any() else self._dense
        return problem.solve(weights, describe, slopes)


def lowest_modes(K: csc_array, M: csc_array, count: int, skip: int, at: str) -> Pairs:
    """Return the lowest eigenvalues ``(count,)`` and mass-normalised vectors.

    Rigid-body modes are included; ``at`` names the parameters in an error. The pairs
    are those nearest to ``-shift``, which is small, but enough to factor a K with
    rigid-body modes. From 1e-6 to 1e4 times the first elastic eigenvalue the result is
    the same.
    """
    mass, shift = M.diagonal(), 0.0
    if skip or not K.diagonal().all():  # with it, constraints are the massless ones
        ratio = K.diagonal()[mass > 0] / mass[mass > 0]
        positive = ratio[ratio > 0]
        shift = 1e-6 * float(np.median(positive)) if len(positive) else 1.0
    factor = factor_definite(csc_array(K + shift * M) if shift else K)
    if factor is None:
        raise ValueError(
            f"mode {skip + 1} is not elastic (a pivot of the stiffness is not "
            f"above zero) at {at}: it is zero, {A_MECHANISM.format(skip)}; or "
            f"{NOT_POSITIVE}"
        )
    inverse, vectors = _krylov(factor, M, count, skip)
    values = 1 / inverse - shift
    # The strain energy of a rigid motion is a difference of large terms: what is
    # left of it is rounding of their size. (A bound by the largest eigenvalue
    # would refuse models with penalty springs or tiny masses.)
    largest = np.abs(vectors[:, skip])
    rounding = 10 * EPS * np.array([largest @ (abs(K) @ largest)])
    check_elastic(values[None], rounding, skip, lambda _: at)
    if len(values) < count:
        raise ValueError(
            f"n_modes: expected skip + n_modes <= {len(values)} (the rank of the mass "
            f"matrix), got {count}"
        )
    return values, vectors


def _krylov(factor: Factor, M: csc_array, count: int, skip: int) -> Pairs:
    """Return the largest eigenvalues of the factored inverse times M, and vectors.

    The block Krylov space is kept whole: it grows until it holds the wanted ones, at
    last to all of the DOFs with mass. Rigid motions are in it first, since an inverse
    iteration or two brings them out.
    """
    rng = np.random.default_rng(0)  # equal parameters give equal bits

    def draw(size: int = BLOCK) -> Floats:
        return factor.solve(M @ rng.normal(size=(M.shape[0], size)))

    space, X, width = _KrylovSpace(factor, M), draw(), BLOCK
    if skip:
        rigid = draw(skip)
        for _ in range(3):
            rigid = factor.solve(space.complement(rigid)[1])
        X = np.hstack([space.grow(rigid), X])
    while True:
        size = len(space.H)
        X = space.grow(X)
        if len(space.H) == size:  # it maps into itself
            X, width = space.grow(draw()), width + BLOCK
        full = len(space.H) == size
        if not full and len(space.H) < 2 * count:
            continue
        values, axes = np.linalg.eigh(space.H)
        order = np.argsort(-np.abs(values))[:count]  # infinity may round to either sign
        values, axes = values[order], axes[:, order]
        rest = X @ axes[size:]  # what the space lacks of the image of each vector
        lacking = np.sqrt(np.einsum("ij,ij->j", rest, M @ rest))
        if full or (lacking <= SHAPE_TOLERANCE * abs(values) + space.rounding).all():
            apart = np.diff(values[skip:]) < -EQUAL_MODES * values[skip + 1 :]
            ends = np.flatnonzero([True, *apart, True])
            if full or np.diff(ends).max() < width:
                return values, space.Q @ axes
            X, width = np.hstack([X, draw()]), width + BLOCK


class _KrylovSpace:
    """M-orthonormal vectors Q, and the factored inverse times M among them, H."""

    def __init__(self, factor: Factor, M: csc_array) -> None:
        self.factor, self.M = factor, M
        self.Q = self.MQ = np.zeros((M.shape[0], 0))
        self.H = np.zeros((0, 0))

    @property
    def rounding(self) -> float:
        """The length that rounding gives to an image."""
        return 10 * EPS * float(abs(self.H).max(initial=0.0))

    def grow(self, X: Floats) -> Floats:
        """Take in vectors, and return what their images have beyond the space."""
        X, MX = self.complement(X)
        if not X.shape[1]:
            return X
        self.Q, self.MQ = np.hstack([self.Q, X]), np.hstack([self.MQ, MX])
        X = self.factor.solve(MX)
        projected = self.MQ.T @ X
        self.H = np.block([[self.H, projected[: len(self.H)]], [projected.T]])
        return X - self.Q @ projected

    def complement(self, X: Floats) -> tuple[Floats, Floats]:
        """Return M-orthonormal vectors with those of X beyond Q, and M times these.

        None for a column that rounding made, or near a combination of others.
        """
        for least in (self.rounding, 0.5):  # lengths are one in the second pass
            X = X - self.Q @ (self.MQ.T @ X)
            MX = self.M @ X
            gram = X.T @ MX
            size = np.sqrt(np.maximum(gram.diagonal(), 0.0))
            long = size > least
            size = size[long]
            scaled = gram[np.ix_(long, long)] / np.outer(size, size)
            squares, axes = np.linalg.eigh(scaled)
            kept = squares > LANCZOS_DEPENDENT
            root = axes[:, kept] / size[:, None] / np.sqrt(squares[kept])
            X, MX = X[:, long] @ root, MX[:, long] @ root
        return X, MX


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
