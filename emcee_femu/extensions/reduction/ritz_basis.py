"""A Ritz basis of mode shapes, which grows where a model is solved in full."""

from bisect import bisect_left
from typing import TypeAlias

import numpy as np
from scipy.linalg import eigh
from scipy.sparse import csc_array

from ...contracts import Floats
from ...models.assembled import AssembledModel
from ...models.eigen_sparse import check_mass, lowest_modes
from ...models.matrix import AffineModel
from ...models.parameter_sets import describe

GOOD_IN_A_ROW = 3  # consecutive full solves that add nothing new
RESERVE = 0.2  # share of the tolerance for the basis before truncation
RIGID_WEIGHT = 1e3  # so that rigid motions stay in a basis of any size
NEW_ENERGY = 1e-7  # share of a shape's energy norm; what is new in it must be more
BUFFER = 2  # extra modes, so that those which cross the wanted ones are in the basis
CLOSE_MODES = 0.02  # modes nearer to each other in frequency mix their shapes
# A Ritz frequency this much below the full one, relatively, is an error.
RITZ_BELOW = 1e-6

# Of K and of M in a basis, each (n, r, r).
Matrices: TypeAlias = tuple[Floats, Floats]
Modes: TypeAlias = tuple[Floats, Floats]  # eigenvalues (m,) and shapes (N, m)
Model: TypeAlias = AffineModel | AssembledModel


class RitzBasis:
    """Shapes of a model at points of the unit cube of its parameters.

    Attributes:
        points: Where it was solved in full.
        V: The shapes, orthonormal in the energy A, ``(N, r)``.
        snapshots: The shapes as they were solved for, scaled to unit energy.
    """

    def __init__(
        self,
        model: Model,
        bounds: dict[str, tuple[float, float]],
        tolerance: float,
    ) -> None:
        self.model, self.bounds = model, bounds
        # What parameters multiply, if it is a sum.
        parts = model.parts if isinstance(model, AffineModel) else ([], [])
        self.K, self.M = ([*map(csc_array, part)] for part in parts)
        self.units = self.K + self.M
        self.inside = [np.empty((0, 0)) for _ in self.units]  # of these, in the basis
        self.points: list[Floats] = []
        centre = np.full(len(bounds), 0.5)
        eigenvalues, shapes = self.solve(centre)
        K, M, _ = self.assemble(centre)
        self.shift = 0.1 * float(eigenvalues[model.skip]) if model.skip else 0.0
        self.A = csc_array(K + self.shift * M)
        # A little mass keeps that of massless DOFs definite: 0.5 % of the tolerance.
        massless = not M.diagonal().all()
        self.added = 0.01 * tolerance / float(eigenvalues[-1]) if massless else 0.0
        self.V, self.snapshots = np.empty((len(shapes), 0)), list[Floats]()
        self.append(eigenvalues, shapes)

    def parameters(self, points: Floats) -> dict[str, Floats]:
        """Return the parameters at points of the unit cube, ``(n, d)``."""
        low, high = np.array([*self.bounds.values()]).T
        values = np.clip(low + points * (high - low), low, high)  # rounding, by an ulp
        return dict(zip(self.bounds, values.T, strict=True))

    def assemble(self, point: Floats) -> tuple[csc_array, csc_array, str]:
        """Return K and M at a point, and what names it in a message."""
        values = self.parameters(point[None])
        K, M = self.model.matrices({name: v[0] for name, v in values.items()})
        return csc_array(K), csc_array(M), describe(values, values, 0)

    def solve(self, point: Floats) -> Modes:
        """Solve in full at one point, with rigid-body modes and some more."""
        K, M, where = self.assemble(point)
        if len(self.M) != 1:  # a constant one was checked
            check_mass(M, f"the mass matrix at {where}")
        massive = int(np.count_nonzero(M.diagonal()))
        count = min(self.model.skip + self.model.modes[-1] + BUFFER, massive)
        self.points.append(point)
        return lowest_modes(K, M, count, self.model.skip, where)

    def append(self, eigenvalues: Floats, shapes: Floats) -> None:
        """Add mode shapes ``(N, n)``."""
        new = shapes / np.sqrt(np.abs(eigenvalues) + self.shift)  # unit energy
        rigid = np.arange(new.shape[1]) < self.model.skip
        self.snapshots.append(new * np.where(rigid, RIGID_WEIGHT, 1.0))
        # Then energies are one, but of what was the rounding of a difference.
        for least in (NEW_ENERGY**2, 0.5):
            for _ in range(2):
                new = new - self.V @ (self.V.T @ (self.A @ new))
            energy, directions = np.linalg.eigh(new.T @ (self.A @ new))
            kept = energy > least
            new = new @ (directions[:, kept] / np.sqrt(energy[kept]))
        # What was projected before stays; of large models the rest would take longer
        # than a solve.
        for i, unit in enumerate(self.units):
            pushed = unit @ new
            side = self.V.T @ pushed
            self.inside[i] = np.block(
                [[self.inside[i], side], [side.T, new.T @ pushed]]
            )
        self.V = np.hstack([self.V, new])

    def project(self, directions: Floats | None = None) -> Model:
        """Return the model in the basis, or in directions ``(r, k)``, orthonormal."""
        model, T = self.model, np.eye(self.V.shape[1])
        T = T if directions is None else directions
        if isinstance(model, AssembledModel):
            return model.project(self.V @ T, self.added)
        inside = np.array([T.T @ part @ T for part in self.inside])
        K, M = inside[: len(self.K)], inside[len(self.K) :]
        M[0] += self.added * np.eye(M.shape[1])  # where the energy A is the identity
        return model.project(K, M, model.sensors.of(self.V) @ T)

    def matrices(self, small: Model, points: Floats) -> Matrices:
        """Return K and M of a model in a basis at points."""
        values = self.parameters(points)
        rows = zip(*values.values(), strict=True)
        pairs = [small.matrices(dict(zip(values, row, strict=True))) for row in rows]
        K, M = map(np.array, zip(*pairs, strict=True))
        return K, M

    def grow(self, candidates: Floats, target: float, allowed: int) -> None:
        """Solve at points far from all earlier ones until nothing new is found."""
        errors: list[float] = []
        while len(errors) < GOOD_IN_A_ROW or max(errors[-GOOD_IN_A_ROW:]) > target:
            if len(self.points) >= allowed:
                worst = max(errors[-GOOD_IN_A_ROW:], default=np.inf)
                raise not_reached(target, worst, len(self.points))
            gaps = ((candidates[:, None] - np.array(self.points)) ** 2).sum(axis=2)
            farthest = candidates[np.argmax(gaps.min(axis=1))]
            error, _, modes = self.compare(self.V, self.project(), farthest)
            self.append(*modes)
            errors.append(error)

    def truncate(self, points: Floats, target: float) -> Floats:
        """Return the fewest principal directions that keep all frequencies there.

        They are orthonormal, in coordinates of the basis, ``(r, k)``.
        """
        coordinates = self.V.T @ (self.A @ np.hstack(self.snapshots))
        directions = np.linalg.svd(coordinates, full_matrices=True)[0]
        K, M = (
            directions.T @ part @ directions
            for part in self.matrices(self.project(), points)
        )
        modes = slice(self.model.skip, self.model.skip + self.model.modes[-1])

        def solve(size: int) -> Floats:
            inverse = np.linalg.inv(np.linalg.cholesky(M[:, :size, :size]))
            squares = np.linalg.eigvalsh(
                inverse @ K[:, :size, :size] @ inverse.transpose(0, 2, 1)
            )
            return np.sqrt(squares[:, modes])

        whole, sizes = solve(len(directions)), range(modes.stop, len(directions))
        # Errors fall with the size, for Ritz frequencies do.
        left = bisect_left(sizes, -target, key=lambda r: -(solve(r) / whole - 1).max())
        return np.asarray(directions[:, : modes.stop + left])

    def compare(
        self, V: Floats, small: Model, point: Floats
    ) -> tuple[float, float, Modes]:
        """Solve in full at a point; return what a basis errs there, and the modes.

        The largest relative error of a frequency, and the largest 1 - MAC.
        """
        skip, n_modes = self.model.skip, self.model.modes[-1]
        (K,), (M,) = self.matrices(small, point[None])
        squares, y = eigh(K, M)
        reduced = np.sqrt(squares[skip:][:n_modes]) / (2 * np.pi)
        eigenvalues, shapes = self.solve(point)
        full = np.sqrt(eigenvalues[skip:]) / (2 * np.pi)
        phi = V @ y[:, skip:][:, :n_modes]
        _, mass, where = self.assemble(point)
        M_phi = mass @ phi
        # The mass added to the first modes bounds what it lowers the last one by.
        kept = 1 - np.cumsum(1 - (phi * M_phi).sum(axis=0))
        least = full[:n_modes] * np.sqrt(np.maximum(kept, 0.0))
        for mode in np.flatnonzero(reduced < (1 - RITZ_BELOW) * least):
            raise ValueError(
                f"the full model missed a mode near {reduced[mode]:g} Hz at "
                f"{where}: a Ritz frequency is never below the true one; ask for "
                "other n_modes"
            )
        error = float(np.abs(reduced / full[:n_modes] - 1).max())
        mac = (shapes[:, skip:].T @ M_phi) ** 2
        close = np.abs(full[:, None] / reduced - 1) < CLOSE_MODES
        lost = float((1 - (mac * close).sum(axis=0)).max())
        return error, lost, (eigenvalues, shapes)


def not_reached(target: float, error: float, solves: int) -> ValueError:
    """Return what to raise where a tolerance was not reached."""
    return ValueError(
        f"the tolerance was not reached: frequency error {error:.2g}, wanted "
        f"{target:.2g}, after {solves} full solves; allow more max_solves, a "
        "larger tolerance, or give narrower bounds"
    )
