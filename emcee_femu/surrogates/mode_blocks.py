r"""Modes that are emulated together, by quantities that stay smooth where they cross.

Sorted eigenvalues have kinks where two modes meet. With shapes known the modes of a
block are turned onto reference shapes, :math:`\Phi Q \approx \Phi_0`, and

.. math:: A = Q^T \Lambda Q, \qquad \Psi = \Phi Q

are smooth as long as the block spans what the reference spans; the eigenvectors of A
turn :math:`\Psi` back. Without shapes two or three neighbours are told by their mean
and their central moments, which do not mind the order.
"""

from dataclasses import dataclass
from typing import NamedTuple, Protocol, Self

import numpy as np

from ..interfaces import Floats


class Modes(NamedTuple):
    """Eigenvalues ``(n, m)``, and shapes ``(n, n_dof, m)`` where they are known."""

    eigenvalues: Floats
    shapes: Floats | None = None


class Block(Protocol):
    """Neighbouring modes as smooth numbers, and back."""

    @property
    def first(self) -> int:
        """The first of the modes."""

    @property
    def count(self) -> int:
        """How many modes."""

    @property
    def size(self) -> int:
        """How many numbers."""

    def encode(self, modes: Modes) -> Floats:
        """Return the numbers ``(n, size)`` of the block, one of all modes."""

    def decode(self, values: Floats) -> Modes:
        """Return the modes of the block, in ascending order."""

    def decode_slopes(
        self, values: Floats, directions: Floats, finite: bool
    ) -> tuple[Modes, Modes]:
        """Return the modes, and how they move along ``directions (n, size, k)``.

        ``finite`` directions are moves of their own length, along which the modes stay
        finite; others are derivatives.
        """


@dataclass(frozen=True, eq=False)
class Aligned:
    """Modes turned onto reference shapes; a single mode needs none."""

    first: int
    unit: Floats  # of the eigenvalues, (r,)
    shape_unit: Floats | None  # (n_dof, r), None if shapes are not wanted
    inverse: Floats | None  # of the reference shapes, (r, n_dof)

    @classmethod
    def of(
        cls,
        first: int,
        unit: Floats,
        shape_unit: Floats | None,
        reference: Floats | None,
    ) -> Self:
        """Return the block with reference shapes ``(n_dof, r)``."""
        if reference is None:
            return cls(first, unit, shape_unit, None)
        return cls(first, unit, shape_unit, np.asarray(np.linalg.pinv(reference)))

    @property
    def count(self) -> int:
        """How many modes."""
        return len(self.unit)

    @property
    def size(self) -> int:
        """How many numbers."""
        shapes = 0 if self.shape_unit is None else self.shape_unit.size
        return self.count * (self.count + 1) // 2 + shapes

    @property
    def _scale(self) -> Floats:
        """The units of the entries of A, ``(r, r)``."""
        scale: Floats = np.sqrt(np.outer(self.unit, self.unit))
        return scale

    def encode(self, modes: Modes) -> Floats:
        """Return the entries of A and the aligned shapes."""
        own = slice(self.first, self.first + self.count)
        eigenvalues = modes.eigenvalues[:, own]
        upper = np.triu_indices(self.count)
        if self.inverse is None or modes.shapes is None:
            scaled: Floats = eigenvalues / self.unit
            return scaled
        shapes = modes.shapes[:, :, own]
        left, _, right = np.linalg.svd(self.inverse @ shapes)
        turn = (left @ right).swapaxes(1, 2)
        A = turn.swapaxes(1, 2) @ (eigenvalues[:, :, None] * turn)
        entries: Floats = (A / self._scale)[:, *upper]
        if self.shape_unit is None:
            return entries
        aligned = (shapes @ turn) / self.shape_unit
        return np.hstack([entries, aligned.reshape(len(aligned), -1)])

    def decode(self, values: Floats) -> Modes:
        """Return the modes of the matrix with these entries."""
        return self._solve(values)[0]

    def decode_slopes(
        self, values: Floats, directions: Floats, finite: bool
    ) -> tuple[Modes, Modes]:
        """Return the modes, and how they move."""
        modes, vectors, aligned = self._solve(values)
        n, r, k = len(values), self.count, directions.shape[2]
        moves = directions.swapaxes(1, 2).reshape(n * k, -1)
        entries, rest = self._matrix(moves)
        # One product for each of n, with the k directions side by side.
        right = entries.reshape(n, k * r, r) @ vectors
        beside = right.reshape(n, k, r, r).transpose(0, 2, 1, 3).reshape(n, r, k * r)
        turned = (vectors.swapaxes(1, 2) @ beside).reshape(n, r, k, r)
        eigenvalues = np.diagonal(turned, axis1=1, axis2=3).swapaxes(1, 2)
        if aligned is None or rest is None:
            return modes, Modes(eigenvalues)
        gaps = modes.eigenvalues[:, None] - modes.eigenvalues[:, :, None]
        gaps = gaps[:, :, None]
        if finite:
            # The angle by which two modes turn, at most an eighth of a turn.
            side = np.where(gaps < 0, -1.0, 1.0)
            mixing = 0.5 * np.arctan2(2.0 * turned * side, np.abs(gaps))
        else:
            mixing = turned / np.where(gaps == 0.0, np.inf, gaps)
        mixing[:, range(r), :, range(r)] = 0.0
        n_dof = aligned.shape[1]
        own = rest.reshape(n, k * n_dof, r) @ vectors
        other = aligned @ vectors @ mixing.reshape(n, r, k * r)
        shapes = own.reshape(n, k, n_dof, r).transpose(0, 2, 3, 1)
        shapes = shapes + other.reshape(n, n_dof, k, r).swapaxes(2, 3)
        return modes, Modes(eigenvalues, shapes)

    def _matrix(self, values: Floats) -> tuple[Floats, Floats | None]:
        """Return A ``(n, r, r)``, and the aligned shapes ``(n, n_dof, r)``."""
        r = self.count
        rows, columns = np.triu_indices(r)
        A = np.empty((len(values), r, r))
        A[:, rows, columns] = A[:, columns, rows] = values[:, : len(rows)]
        A *= self._scale
        if self.shape_unit is None:
            return A, None
        shapes = values[:, len(rows) :].reshape(len(values), *self.shape_unit.shape)
        return A, shapes * self.shape_unit

    def _solve(self, values: Floats) -> tuple[Modes, Floats, Floats | None]:
        """Return modes, eigenvectors of A, and the aligned shapes."""
        A, aligned = self._matrix(values)
        if self.count == 1:
            return Modes(A[:, 0], aligned), np.ones_like(A), aligned
        eigenvalues, vectors = np.linalg.eigh(A)
        shapes = None if aligned is None else aligned @ vectors
        return Modes(eigenvalues, shapes), vectors, aligned


@dataclass(frozen=True, eq=False)
class Symmetric:
    r"""Two or three eigenvalues by their mean and central moments.

    .. math:: \mu = \overline{\lambda}, \qquad p_2 = \overline{(\lambda - \mu)^2},
        \qquad p_3 = \overline{(\lambda - \mu)^3}

    Whatever is predicted, the eigenvalues are real and in order.
    """

    first: int
    unit: Floats  # of the moments, (r,)

    @classmethod
    def of(cls, first: int, unit: Floats, eigenvalues: Floats) -> Self:
        """Return the block for eigenvalues ``(N, r)`` of the given units ``(r,)``."""
        sd = float(np.sqrt((unit**2).mean()))
        spread = max(float(np.median(eigenvalues.std(axis=1))), sd)
        # A moment moves by its power times the spread for a move of one.
        scales = [sd, 2.0 * spread * sd, 3.0 * spread**2 * sd]
        return cls(first, np.array(scales[: eigenvalues.shape[1]]))

    @property
    def count(self) -> int:
        """How many modes."""
        return len(self.unit)

    size = count

    def encode(self, modes: Modes) -> Floats:
        """Return the moments."""
        own = modes.eigenvalues[:, self.first : self.first + self.count]
        mean = own.mean(axis=1, keepdims=True)
        moments = [((own - mean) ** p).mean(axis=1) for p in range(2, self.count + 1)]
        return np.column_stack([mean, *moments]) / self.unit

    def decode(self, values: Floats) -> Modes:
        """Return the eigenvalues that have these moments, or the nearest real ones."""
        moments = values * self.unit
        spread = np.sqrt(np.maximum(moments[:, 1], 0.0))
        if self.count == 2:
            apart = spread[:, None] * [-1.0, 1.0]
        else:
            cube = spread**3
            skew = np.sqrt(2.0) * np.divide(
                moments[:, 2], cube, out=np.zeros_like(cube), where=cube > 0
            )
            angle = np.arccos(np.clip(skew, -1.0, 1.0))[:, None] / 3.0
            thirds = 2.0 * np.pi / 3.0 * np.array([-1.0, 1.0, 0.0])
            apart = np.sqrt(2.0) * spread[:, None] * np.cos(angle + thirds)
            apart.sort(axis=1)
        return Modes(moments[:, :1] + apart)

    def decode_slopes(
        self, values: Floats, directions: Floats, finite: bool
    ) -> tuple[Modes, Modes]:
        """Return the modes, and how they move."""
        modes = self.decode(values)
        n, _, k = directions.shape
        moves = directions.swapaxes(1, 2)  # (n, k, size)
        if finite:
            there = [
                self.decode((values[:, None] + s * moves).reshape(n * k, -1))
                for s in (1.0, -1.0)
            ]
            change = (there[0].eigenvalues - there[1].eigenvalues) / 2.0
            return modes, Modes(change.reshape(n, k, -1).swapaxes(1, 2))
        apart = modes.eigenvalues - modes.eigenvalues.mean(axis=1, keepdims=True)
        # How the moments move with the eigenvalues, row by row
        rows = [np.ones_like(apart), 2.0 * apart]
        if self.count == 3:
            rows.append(3.0 * (apart**2 - (apart**2).mean(axis=1, keepdims=True)))
        forward = np.stack(rows, axis=1) / self.count / self.unit[:, None]
        return modes, Modes(np.linalg.pinv(forward) @ directions)
