"""Outputs that are emulated one by one: numbers, and shapes of one sign."""

from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from ..interfaces import Floats, read

Named = dict[str, Floats]


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

    def decode_slopes(
        self, values: Floats, directions: Floats, finite: bool = False
    ) -> tuple[Named, Named]:
        """Return it, and its slopes ``(n, *shape, k)``."""
        shape = len(values), *self.unit.shape, directions.shape[2]
        slopes = directions.reshape(shape) * self.unit[..., None]
        return self.decode(values), {self.name: slopes}


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
