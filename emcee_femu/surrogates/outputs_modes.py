"""Modes as smooth numbers: eigenvalues and shapes in blocks that cross among them."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..interfaces import Floats, read
from .mode_blocks import Block, Modes

Named = dict[str, Floats]
LEAST = 1e-8  # an eigenvalue predicted below this share of the usual one is cut there


@dataclass(frozen=True, eq=False)
class ModalOutputs:
    r"""Frequencies in Hz, and shapes, by eigenvalues in units of measurement error.

    .. math:: \lambda = (2 \pi f)^2, \qquad \sigma_\lambda = 8 \pi^2 f \sigma_f

    Where the frequencies were in ascending order, so are those that are predicted.
    """

    blocks: tuple[Block, ...]
    least: Floats  # (m,)
    ascending: bool
    with_shapes: bool

    @property
    def size(self) -> int:
        """How many numbers."""
        return sum(block.size for block in self.blocks)

    def encode(self, response: Any) -> Floats:
        """Return the numbers ``(n, size)``."""
        modes = read_modes(response)
        return np.hstack([block.encode(modes) for block in self.blocks])

    def decode(self, values: Floats) -> Named:
        """Return the frequencies in Hz, and shapes."""
        found = [
            block.decode(values[:, own])
            for block, own in zip(self.blocks, self._split(), strict=True)
        ]
        return self._respond(_join(found, 2))[0]

    def decode_slopes(
        self, values: Floats, directions: Floats, finite: bool = False
    ) -> tuple[Named, Named]:
        """Return them, and their slopes ``(n, *shape, k)``."""
        found = [
            block.decode_slopes(values[:, own], directions[:, own], finite)
            for block, own in zip(self.blocks, self._split(), strict=True)
        ]
        modes = _join([there for there, _ in found], 2)
        slopes = _join([moved for _, moved in found], 3)
        response, order, eigenvalues = self._respond(modes)
        moved = np.take_along_axis(slopes.eigenvalues, order[:, :, None], axis=1)
        root = np.sqrt(eigenvalues)[:, :, None]
        if finite:
            # No further than to zero: half the way from there to twice as far.
            root = np.maximum(root, np.sqrt(np.abs(moved)) / 2.0)
        changes = {"frequency": moved / (4 * np.pi * root)}
        if self.with_shapes and slopes.shapes is not None:
            pick = order[:, None, :, None]
            changes["shapes"] = np.take_along_axis(slopes.shapes, pick, axis=2)
        return response, changes

    def _respond(self, modes: Modes) -> tuple[Named, NDArray[np.intp], Floats]:
        """Return the response, the order of the modes, and their eigenvalues."""
        eigenvalues = modes.eigenvalues
        order = np.broadcast_to(np.arange(len(self.least)), eigenvalues.shape)
        if self.ascending:
            order = np.argsort(eigenvalues, axis=1, kind="stable")
        ordered = np.take_along_axis(eigenvalues, order, axis=1)
        ordered = np.maximum(ordered, self.least)
        response = {"frequency": np.sqrt(ordered) / (2 * np.pi)}
        if self.with_shapes and modes.shapes is not None:
            pick = order[:, None]
            response["shapes"] = np.take_along_axis(modes.shapes, pick, axis=2)
        return response, order, ordered

    def _split(self) -> list[slice]:
        ends = np.cumsum([0, *(block.size for block in self.blocks)]).tolist()
        return [slice(*pair) for pair in zip(ends[:-1], ends[1:], strict=True)]


def read_modes(response: Any) -> Modes:
    """Return eigenvalues, and shapes where the response has them."""
    frequencies = np.asarray(read(response, "frequency"), dtype=float)
    try:
        shapes = np.asarray(read(response, "shapes"), dtype=float)
    except TypeError:
        shapes = None
    return Modes((2 * np.pi * frequencies) ** 2, shapes)


def _join(found: list[Modes], axis: int) -> Modes:
    """Return the modes of all blocks side by side; shapes have them along ``axis``."""
    eigenvalues = np.concatenate([modes.eigenvalues for modes in found], axis=1)
    shapes = [modes.shapes for modes in found if modes.shapes is not None]
    if len(shapes) < len(found):
        return Modes(eigenvalues)
    return Modes(eigenvalues, np.concatenate(shapes, axis=2))
