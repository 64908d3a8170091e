"""Outputs that are emulated one by one: numbers, eigenvalues, shapes of one sign."""

from dataclasses import dataclass, field
from typing import Any, Self

import numpy as np

from ..interfaces import Floats, read

Named = dict[str, Floats]
LEAST = 1e-8  # an eigenvalue predicted below this share of the usual one is cut there


@dataclass(frozen=True, eq=False)
class Numbers:
    """Any real variable, divided by the standard deviations of its measurement."""

    name: str
    unit: Floats

    @property
    def size(self) -> int:
        """How many numbers."""
        return self.unit.size

    def encode(self, response: Any) -> Floats:
        """Return the numbers ``(n, size)``."""
        values = np.asarray(read(response, self.name)) / self.unit
        return values.reshape(len(values), -1)

    def decode(self, values: Floats) -> Named:
        """Return the variable, ``(n, *shape)``."""
        return {self.name: values.reshape(len(values), *self.unit.shape) * self.unit}

    def decode_slopes(self, values: Floats, directions: Floats) -> tuple[Named, Named]:
        """Return it, and its slopes ``(n, *shape, k)``."""
        shape = len(values), *self.unit.shape, directions.shape[2]
        slopes = directions.reshape(shape) * self.unit[..., None]
        return self.decode(values), {self.name: slopes}


@dataclass(frozen=True, eq=False)
class Eigenvalues:
    r"""Eigenvalues in units of their measurement error, from frequencies in Hz.

    .. math:: \lambda = (2 \pi f)^2, \qquad \sigma_\lambda = 8 \pi^2 f \sigma_f

    Where the frequencies were in ascending order, so are those that are predicted.
    """

    unit: Floats  # of each eigenvalue, (m,)
    least: Floats  # (m,)
    ascending: bool = field(default=True)

    @classmethod
    def of(cls, frequencies: Floats, sd: Floats) -> Self:
        """Return the outputs of frequencies ``(N, m)`` with errors ``sd (m,)``."""
        usual = np.maximum(np.median(frequencies, axis=0), sd)
        ascending = bool((np.diff(frequencies, axis=1) >= 0).all())
        least = LEAST * (2 * np.pi * usual) ** 2
        return cls(8 * np.pi**2 * usual * sd, least, ascending)

    @property
    def size(self) -> int:
        """How many modes."""
        return len(self.unit)

    def encode(self, response: Any) -> Floats:
        """Return the eigenvalues ``(n, m)``."""
        scaled: Floats = (2 * np.pi * read(response, "frequency")) ** 2 / self.unit
        return scaled

    def decode(self, values: Floats) -> Named:
        """Return the frequencies in Hz."""
        return {"frequency": self._frequencies(values)[0]}

    def decode_slopes(self, values: Floats, directions: Floats) -> tuple[Named, Named]:
        """Return the frequencies, and their slopes ``(n, m, k)``."""
        frequencies, order = self._frequencies(values)
        moved = directions * self.unit[:, None]
        moved = np.take_along_axis(moved, order[:, :, None], axis=1)
        slopes = moved / (8 * np.pi**2 * frequencies[:, :, None])
        return {"frequency": frequencies}, {"frequency": slopes}

    def _frequencies(self, values: Floats) -> tuple[Floats, Any]:
        eigenvalues = np.maximum(values * self.unit, self.least)
        order = np.broadcast_to(np.arange(self.size), values.shape)
        if self.ascending:
            order = np.argsort(eigenvalues, axis=1, kind="stable")
        ordered = np.take_along_axis(eigenvalues, order, axis=1)
        return np.sqrt(ordered) / (2 * np.pi), order


@dataclass(frozen=True, eq=False)
class SignedShapes(Numbers):
    """Mode shapes, each turned to the side of a reference shape."""

    reference: Floats  # (n_dof, m)

    @classmethod
    def of(cls, shapes: Floats, sd: Floats) -> Self:
        """Return the outputs of shapes ``(N, n_dof, m)``."""
        # The direction that most shapes have in common, whatever their signs.
        common = np.linalg.svd(shapes.transpose(2, 0, 1), full_matrices=False)[2][:, 0]
        return cls("shapes", sd, common.T)

    def encode(self, response: Any) -> Floats:
        """Return the shapes ``(n, n_dof * m)``."""
        shapes = read(response, "shapes")
        side = (shapes * self.reference).sum(axis=1, keepdims=True)
        return super().encode({"shapes": shapes * np.where(side < 0, -1.0, 1.0)})
