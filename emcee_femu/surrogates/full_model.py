"""The full model over the unit cube of its parameters: what a reduction costs."""

from dataclasses import dataclass

import numpy as np

from ..interfaces import Floats
from ..models.eigen.sparse import SparseEigenproblem
from ..models.matrix import MatrixModel
from ..models.parameters import columns, describe
from .ritz_basis import Projection, RitzBasis, empty_basis

BUFFER = 2  # extra modes, so that those which cross the wanted ones are in the basis
CLOSE = 0.02  # modes nearer to each other in frequency mix their shapes
MISSED = 1e-6  # a Ritz frequency this much below the full one, relatively, is an error


@dataclass
class FullModel:
    """The full model over the unit cube of its parameters, counting its solves."""

    model: MatrixModel
    problem: SparseEigenproblem
    bounds: dict[str, tuple[float, float]]
    solves: int = 0

    def parameters(self, points: Floats) -> dict[str, Floats]:
        """Return the parameters at points of the unit cube, ``(n, d)``."""
        low, high = np.array([*self.bounds.values()]).T
        values = np.clip(low + points * (high - low), low, high)  # rounding, by an ulp
        return dict(zip(self.model.names, values.T, strict=True))

    def coefficients(self, points: Floats) -> tuple[Floats, Floats]:
        """Return the coefficients of K and of M there."""
        values, n = self.parameters(points), len(points)
        return columns(values, self.model.K, n), columns(values, self.model.M, n)

    def describe(self, point: Floats) -> str:
        """Return the parameters at one point, for a message."""
        return describe(self.parameters(point[None]), self.model.names, 0)

    def lowest(self, point: Floats) -> tuple[Floats, Floats]:
        """Solve in full at one point, with rigid-body modes and some more."""
        k, m = self.coefficients(point[None])
        count = self.problem.skip + self.problem.n_modes + BUFFER
        massive = int(np.count_nonzero(self.problem.mass(m[0]).diagonal()))
        self.solves += 1
        where = self.describe(point)
        return self.problem.lowest(k[0], m[0], min(count, massive), where)

    def first_basis(self, tolerance: float, rng: np.random.Generator) -> RitzBasis:
        """Return the basis of the shapes at the centre."""
        centre = np.full((1, len(self.bounds)), 0.5)
        eigenvalues, shapes = self.lowest(centre[0])
        k, m = self.coefficients(centre)
        skip = self.problem.skip
        shift = 0.1 * float(eigenvalues[skip]) if skip else 0.0
        massless = not self.problem.mass(m[0]).diagonal().all()
        # A little mass keeps the projected one definite: 0.5 % of the tolerance here.
        added = 0.01 * tolerance / float(eigenvalues[-1]) if massless else 0.0
        empty = empty_basis(self.problem, k[0], m[0], shift, added, rng)
        return empty.extend(eigenvalues, shapes)

    def errors(
        self, projection: Projection, vectors: Floats, points: Floats
    ) -> tuple[Floats, float]:
        """Return frequency errors ``(n,)`` and the largest 1 - MAC, by full solves."""
        k, m = self.coefficients(points)
        solution = projection.eigenproblem().solve(k, m, lambda row: f"point {row}")
        coordinates = np.asarray(solution.shapes)
        skip, n_modes = self.problem.skip, self.problem.n_modes
        errors, lost = np.empty(len(points)), 0.0
        for i, point in enumerate(points):
            eigenvalues, shapes = self.lowest(point)
            frequencies = np.sqrt(eigenvalues[skip:]) / (2 * np.pi)
            reduced = solution.frequencies[i]
            phi = vectors @ coordinates[i]
            M_phi = self.problem.mass(m[i]) @ phi
            # The mass added to the first modes bounds what it lowers the last one by.
            kept = 1 - np.cumsum(1 - (phi * M_phi).sum(axis=0))
            least = frequencies[:n_modes] * np.sqrt(np.maximum(kept, 0.0))
            for mode in np.flatnonzero(reduced < (1 - MISSED) * least):
                raise ValueError(
                    f"the full model missed a mode near {reduced[mode]:g} Hz at "
                    f"{self.describe(point)}: a Ritz frequency is never below the true "
                    "one; ask for other n_modes"
                )
            errors[i] = np.abs(reduced / frequencies[:n_modes] - 1).max()
            mac = (shapes[:, skip:].T @ M_phi) ** 2
            close = np.abs(frequencies[:, None] / reduced - 1) < CLOSE
            lost = max(lost, float((1 - (mac * close).sum(axis=0)).max()))
        return errors, lost
