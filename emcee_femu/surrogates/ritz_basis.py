"""A Ritz basis of mode shapes, its projected matrices and the estimate of its error."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.sparse import csc_array

from ..interfaces import Floats
from ..models.eigen.dense import Eigenproblem
from ..models.eigen.sparse import SparseEigenproblem, symmetric_factor

PROBES = 32  # the estimate then has a standard deviation of sqrt(2 / 32) = 25 %
RIGID_WEIGHT = 1e3  # so that rigid motions stay in a basis of any size
DEPENDENT = 1e-7  # share of a shape's energy norm; what is new in it must be more


@dataclass(frozen=True, eq=False)
class Projection:
    r"""Projected matrices, and random probes of the residual that they leave.

    .. math:: \frac{|f_r - f|}{f} \approx \frac{r^T A^{-1} r}{2 \lambda}
        \approx \frac{1}{2 \lambda s} \sum_{j=1}^{s} (g_j^T r)^2, \qquad
        r = (K - \lambda M) \phi, \quad g_j \sim N(0, A^{-1})

    A is the stiffness at the centre of the bounds, plus a small multiple of the mass
    where there are rigid-body modes. The probes are projected once, so that an
    estimate costs no more than the reduced solve.

    Args:
        matrices: V^T K_q V ``(1 + n_k, r, r)`` and V^T M_q V ``(1 + n_m, r, r)``,
            constants first.
        probes: g^T K_q V ``(1 + n_k, s, r)`` and g^T M_q V ``(1 + n_m, s, r)``.
        selected: Indices of the elastic modes, after the rigid ones.

    Source: Smetana, Zahm and Patera, SIAM J. Sci. Comput. 41 (2019) A900,
        doi:10.1137/18M120364X (random probes of a residual norm).
    """

    matrices: tuple[Floats, ...]
    probes: tuple[Floats, ...]
    selected: tuple[int, ...]

    def eigenproblem(
        self, shapes: bool = True, output: Floats | None = None
    ) -> Eigenproblem:
        """Return the dense problem in the basis; ``output`` rows map to the DOFs."""
        return Eigenproblem(
            K=self.matrices[0],
            M=self.matrices[1],
            selected=self.selected,
            skip=self.selected[0],
            shapes=shapes,
            output=output,
        )

    def estimate(self, k: Floats, m: Floats) -> Floats:
        """Return estimated relative errors of the frequencies, ``(n, n_modes)``."""
        frequencies, shapes = self.eigenproblem().solve(k, m, lambda i: f"point {i}")
        y = np.asarray(shapes)
        eigenvalues = (2 * np.pi * frequencies[:, None, :]) ** 2
        probed = _sum(self.probes[0], k) @ y
        probed -= eigenvalues * (_sum(self.probes[1], m) @ y)
        result: Floats = 0.5 * np.mean(probed**2, axis=1) / eigenvalues[:, 0]
        return result

    def rotate(self, T: Floats) -> "Projection":
        """Return the projection on the basis ``V T``."""
        return replace(
            self,
            matrices=tuple(T.T @ matrix @ T for matrix in self.matrices),
            probes=tuple(probe @ T for probe in self.probes),
        )


@dataclass(frozen=True, eq=False)
class RitzBasis:
    """Shapes at chosen points, orthonormal in the energy A, with their projection.

    Args:
        vectors: The basis V, ``(N, r)``.
        projection: The full matrices in it.
        snapshots: Coordinates of the shapes, scaled to unit energy, ``(r, n)``.
        A: Measures the energy: the stiffness at the centre of the bounds.
        shift: Multiple of the mass in A.
        matrices: The full stiffness and the full mass matrices.
        probes: K_q g_j and M_q g_j.
    """

    vectors: Floats
    projection: Projection
    snapshots: Floats
    A: csc_array = field(repr=False)
    shift: float
    matrices: tuple[tuple[csc_array, ...], ...] = field(repr=False)
    probes: tuple[list[Floats], ...] = field(repr=False)

    def extend(self, eigenvalues: Floats, shapes: Floats) -> "RitzBasis":
        """Return the basis with mode shapes ``(N, n)`` added."""
        V, old = self.vectors, self.projection
        new = shapes / np.sqrt(np.abs(eigenvalues) + self.shift)  # unit energy
        coordinates = np.zeros((V.shape[1], new.shape[1]))
        for _ in range(2):  # once leaves the rounding of a difference behind
            part = V.T @ (self.A @ new)
            new = new - V @ part
            coordinates += part
        energy, directions = np.linalg.eigh(new.T @ (self.A @ new))
        kept = energy > DEPENDENT**2
        Q = new @ (directions[:, kept] / np.sqrt(energy[kept]))
        coordinates = np.vstack([coordinates, Q.T @ (self.A @ new)])
        coordinates[:, : old.selected[0]] *= RIGID_WEIGHT
        projection = replace(
            old,
            matrices=tuple(
                np.array([_border(q, V, Q, own) for q, own in zip(*pair, strict=True)])
                for pair in zip(self.matrices, old.matrices, strict=True)
            ),
            probes=tuple(
                np.concatenate([known, np.array([p.T @ Q for p in own])], axis=2)
                for known, own in zip(old.probes, self.probes, strict=True)
            ),
        )
        snapshots = np.pad(self.snapshots, ((0, Q.shape[1]), (0, 0)))
        return replace(
            self,
            vectors=np.hstack([V, Q]),
            snapshots=np.hstack([snapshots, coordinates]),
            projection=projection,
        )

    def principal_directions(self) -> Floats:
        """Return the coordinates of the snapshots' principal directions, ``(r, r)``.

        The first columns hold as much of the snapshots' energy as that many columns
        can (proper orthogonal decomposition).
        """
        directions: Floats = np.linalg.svd(self.snapshots, full_matrices=True)[0]
        return directions


def empty_basis(
    problem: SparseEigenproblem,
    k: Floats,
    m: Floats,
    shift: float,
    added: float,
    rng: np.random.Generator,
) -> RitzBasis:
    """Return a basis without vectors.

    Args:
        problem: The full model.
        k: Stiffness coefficients at the centre of the bounds, ``(n_k,)``.
        m: Mass coefficients there, ``(n_m,)``.
        shift: Multiple of the mass in A; above zero if there are rigid-body modes.
        added: Multiple of A added to the mass; above zero if there are massless DOFs.
        rng: For the random probes.
    """
    A = csc_array(_combine(problem.K, k) + shift * _combine(problem.M, m))
    matrices = (problem.K, (csc_array(problem.M[0] + added * A), *problem.M[1:]))
    g, skip = _draw_probes(A, rng), problem.skip
    projection = Projection(
        matrices=tuple(np.empty((len(terms), 0, 0)) for terms in matrices),
        probes=tuple(np.empty((len(terms), PROBES, 0)) for terms in matrices),
        selected=tuple(range(skip, skip + problem.n_modes)),
    )
    return RitzBasis(
        vectors=np.empty((A.shape[0], 0)),
        projection=projection,
        snapshots=np.empty((0, 0)),
        A=A,
        shift=shift,
        matrices=matrices,
        probes=tuple([q @ g for q in terms] for terms in matrices),
    )


def _border(q: csc_array, V: Floats, Q: Floats, corner: Floats) -> Floats:
    """Return ``[V Q]^T q [V Q]``, where ``corner`` is ``V^T q V``."""
    right = q @ Q
    side = V.T @ right
    return np.block([[corner, side], [side.T, Q.T @ right]])


def _combine(matrices: Sequence[csc_array], coefficients: Floats) -> csc_array:
    total = matrices[0]
    for matrix, value in zip(matrices[1:], coefficients, strict=True):
        total = total + value * matrix
    return total


def _sum(terms: Floats, coefficients: Floats) -> Floats:
    result: Floats = terms[0] + np.tensordot(coefficients, terms[1:], axes=1)
    return result


def _draw_probes(A: csc_array, rng: np.random.Generator) -> Floats:
    """Return random vectors ``(N, PROBES)`` with covariance ``A^-1``."""
    factor = symmetric_factor(A)  # A = P^T L D L^T P
    noise = rng.normal(size=(A.shape[0], PROBES))
    noise *= np.sqrt(factor.U.diagonal())[:, None]
    coloured = (factor.L @ noise)[factor.perm_r]  # of covariance A
    result: Floats = factor.solve(coloured)
    return result
