r"""What is emulated of a response: numbers that stay smooth, in units of their errors.

Sorted eigenvalues have kinks where two modes meet. With shapes known the modes of a
block are turned onto reference shapes, :math:`\Phi Q \approx \Phi_0`, and

.. math:: A = Q^T \Lambda Q, \qquad \Psi = \Phi Q

are smooth as long as the block spans what the reference spans; the eigenvectors of A
turn :math:`\Psi` back. Where parameters are seen by their logarithms so are the
eigenvalues, :math:`Q^T \ln \Lambda \, Q`. Without shapes two or three neighbours are
told by their mean and their central moments, which do not mind the order. Any other
variable is emulated as it is.

To decode is to return both a response and how it moves along ``directions (n, size,
k)`` of the numbers: as far as they are long if they are ``finite``, so that what has a
root or a crossing stays finite; otherwise the moves are derivatives.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from ...contracts import Floats

Named: TypeAlias = dict[str, Floats]


@dataclass(frozen=True, eq=False)
class Aligned:
    r"""Modes turned onto reference shapes; a single mode needs none.

    Attributes:
        first: The first of the modes.
        unit: Of the eigenvalues, ``(r,)``.
        shape_unit: ``(n_dof, r)``, None if shapes are not wanted.
        inverse: Of the reference shapes, ``(r, n_dof)``, None if there are none.
        usual: Eigenvalues ``(r,)`` near which :math:`\ln \Lambda` takes the place of
            :math:`\Lambda`, as suits powers of parameters; None for these themselves.
    """

    first: int
    unit: Floats
    shape_unit: Floats | None
    inverse: Floats | None
    usual: Floats | None = None

    @property
    def size(self) -> int:
        """How many numbers."""
        r = len(self.unit)
        shapes = 0 if self.shape_unit is None else self.shape_unit.size
        return r * (r + 1) // 2 + shapes

    @property
    def _scale(self) -> Floats:
        """The units of the entries of A, ``(r, r)``."""
        unit = self.unit if self.usual is None else self.unit / self.usual
        return np.asarray(np.sqrt(np.outer(unit, unit)))

    def encode(self, response: Named) -> Floats:
        """Return the entries of A and the aligned shapes, ``(n, size)``."""
        members = slice(self.first, self.first + len(self.unit))
        eigenvalues = eigenvalues_of(response)[:, members]
        if self.usual is not None:
            eigenvalues = np.log(eigenvalues)
        if self.inverse is None:
            return np.asarray(eigenvalues / self._scale.diagonal())
        shapes = response["shapes"][:, :, members]
        left, _, right = np.linalg.svd(self.inverse @ shapes)
        turn = (left @ right).swapaxes(1, 2)
        A = turn.swapaxes(1, 2) @ (eigenvalues[:, :, None] * turn)
        entries: Floats = (A / self._scale)[:, *np.triu_indices(len(self.unit))]
        if self.shape_unit is None:
            return entries
        aligned = (shapes @ turn) / self.shape_unit
        return np.hstack([entries, aligned.reshape(len(aligned), -1)])

    def decode(
        self, values: Floats, directions: Floats, finite: bool
    ) -> tuple[Named, Named]:
        """Return the modes in ascending order, and how they move."""
        (n, _, k), r = directions.shape, len(self.unit)
        A, aligned = self._matrix(values)
        eigenvalues, vectors = (
            np.linalg.eigh(A) if r > 1 else (A[:, 0], np.ones_like(A))
        )
        moves = directions.swapaxes(1, 2).reshape(n * k, self.size)
        entries, rest = self._matrix(moves)
        # One product for each of n, with the k directions side by side.
        right = entries.reshape(n, k * r, r) @ vectors
        beside = right.reshape(n, k, r, r).transpose(0, 2, 1, 3).reshape(n, r, k * r)
        turned = (vectors.swapaxes(1, 2) @ beside).reshape(n, r, k, r)
        moved = np.diagonal(turned, axis1=1, axis2=3).swapaxes(1, 2)
        gaps = (eigenvalues[:, None] - eigenvalues[:, :, None])[:, :, None]
        if self.usual is not None:
            eigenvalues = np.exp(eigenvalues)
            moved = moved * eigenvalues[:, :, None]
        if aligned is None or rest is None:
            return {"eigenvalues": eigenvalues}, {"eigenvalues": moved}
        if finite:
            # The angle by which two modes turn, at most an eighth of a turn.
            side = np.where(gaps < 0, -1.0, 1.0)
            mixing = 0.5 * np.arctan2(2.0 * turned * side, np.abs(gaps))
        else:
            mixing = turned / np.where(gaps == 0.0, np.inf, gaps)
        mixing[:, range(r), :, range(r)] = 0.0
        shapes, n_dof = aligned @ vectors, aligned.shape[1]
        changed = (rest.reshape(n, k * n_dof, r) @ vectors).reshape(n, k, n_dof, r)
        mixed = (shapes @ mixing.reshape(n, r, k * r)).reshape(n, n_dof, k, r)
        change = changed.transpose(0, 2, 3, 1) + mixed.swapaxes(2, 3)
        modes = {"eigenvalues": eigenvalues, "shapes": shapes}
        return modes, {"eigenvalues": moved, "shapes": change}

    def _matrix(self, values: Floats) -> tuple[Floats, Floats | None]:
        """Return A ``(n, r, r)``, and the aligned shapes ``(n, n_dof, r)``."""
        n, r = len(values), len(self.unit)
        rows, columns = np.triu_indices(r)
        A = np.empty((n, r, r))
        A[:, rows, columns] = A[:, columns, rows] = values[:, : len(rows)]
        A *= self._scale
        if self.shape_unit is None:
            return A, None
        shapes = values[:, len(rows) :].reshape(n, *self.shape_unit.shape)
        return A, shapes * self.shape_unit


class Symmetric:
    r"""Two or three eigenvalues by their mean and central moments.

    .. math:: \mu = \overline{\lambda}, \qquad p_2 = \overline{(\lambda - \mu)^2},
        \qquad p_3 = \overline{(\lambda - \mu)^3}

    Whatever is predicted, the eigenvalues are real and in order.

    Args:
        first: The first of the modes.
        unit: Of the eigenvalues, ``(r,)``.
        eigenvalues: Those that were solved for, ``(N, r)``.

    Attributes:
        first: The first of the modes.
        size: How many numbers, r.
        unit: Of the moments, ``(r,)``.
    """

    def __init__(self, first: int, unit: Floats, eigenvalues: Floats) -> None:
        sd = float(np.sqrt((unit**2).mean()))
        spread = max(float(np.median(eigenvalues.std(axis=1))), sd)
        # A moment moves by its power times the spread for a move of one.
        scales = [sd, 2.0 * spread * sd, 3.0 * spread**2 * sd]
        self.first, self.size = first, len(unit)
        self.unit: Floats = np.array(scales[: self.size])

    def encode(self, response: Named) -> Floats:
        """Return the moments, ``(n, size)``."""
        members = slice(self.first, self.first + self.size)
        eigenvalues = eigenvalues_of(response)[:, members]
        mean = eigenvalues.mean(axis=1, keepdims=True)
        powers = range(2, self.size + 1)
        moments = [((eigenvalues - mean) ** p).mean(axis=1) for p in powers]
        return np.column_stack([mean, *moments]) / self.unit

    def decode(
        self, values: Floats, directions: Floats, finite: bool
    ) -> tuple[Named, Named]:
        """Return the eigenvalues of these moments, or the nearest real ones."""
        eigenvalues = self._solve(values)
        if finite:
            moves, here = directions.swapaxes(1, 2), values[:, None]
            change = (self._solve(here + moves) - self._solve(here - moves)) / 2.0
            moved = change.swapaxes(1, 2)
        else:
            apart = eigenvalues - eigenvalues.mean(axis=1, keepdims=True)
            # How the moments move with the eigenvalues, row by row
            squares = apart**2 - (apart**2).mean(axis=1, keepdims=True)
            rows = [np.ones_like(apart), 2.0 * apart, 3.0 * squares][: self.size]
            forward = np.stack(rows, axis=1) / self.size / self.unit[:, None]
            moved = np.linalg.pinv(forward) @ directions
        return {"eigenvalues": eigenvalues}, {"eigenvalues": moved}

    def _solve(self, values: Floats) -> Floats:
        """Return the eigenvalues ``(..., r)`` that have the moments ``(..., r)``."""
        moments = values * self.unit
        spread = np.sqrt(np.maximum(moments[..., 1], 0.0))
        if self.size == 2:
            apart = spread[..., None] * [-1.0, 1.0]
        else:
            cube = spread**3
            skew = np.sqrt(2.0) * np.divide(
                moments[..., 2], cube, out=np.zeros_like(cube), where=cube > 0
            )
            angle = np.arccos(np.clip(skew, -1.0, 1.0))[..., None] / 3.0
            thirds = 2.0 * np.pi / 3.0 * np.array([-1.0, 1.0, 0.0])
            apart = np.sqrt(2.0) * spread[..., None] * np.cos(angle + thirds)
            apart.sort(axis=-1)
        return np.asarray(moments[..., :1] + apart)


@dataclass(frozen=True, eq=False)
class Numbers:
    """Any real variable, divided by the standard deviations of its measurement.

    Attributes:
        name: Of the variable.
        unit: ``(*shape)``.
        reference: Of mode shapes, to whose side each is turned, ``(n_dof, m)``.
    """

    name: str
    unit: Floats
    reference: Floats | None = None

    @property
    def size(self) -> int:
        """How many numbers."""
        return self.unit.size

    def encode(self, response: Named) -> Floats:
        """Return the numbers ``(n, size)``."""
        values = response[self.name] / self.unit
        if self.reference is not None:
            side = (values * self.unit * self.reference).sum(axis=1, keepdims=True)
            values = values * np.where(side < 0, -1.0, 1.0)
        return values.reshape(len(values), -1)

    def decode(
        self, values: Floats, directions: Floats, finite: bool
    ) -> tuple[Named, Named]:
        """Return the variable ``(n, *shape)``, and how it moves."""
        shape = len(values), *self.unit.shape
        moves = directions.reshape(*shape, directions.shape[2]) * self.unit[..., None]
        return {self.name: values.reshape(shape) * self.unit}, {self.name: moves}


@dataclass(frozen=True, eq=False)
class Outputs:
    r"""The blocks that together make a response; made by :func:`.fit_outputs`.

    Frequencies in Hz come as eigenvalues in units of measurement error,

    .. math:: \lambda = (2 \pi f)^2, \qquad \sigma_\lambda = 8 \pi^2 f \sigma_f

    Where the frequencies were in ascending order, so are those that are predicted.

    Attributes:
        blocks: Modes that cross among themselves, and other variables.
        least: Eigenvalues below which none is predicted, ``(m,)``.
        ascending: Whether the frequencies were in ascending order.
    """

    blocks: tuple[Aligned | Symmetric | Numbers, ...]
    least: Floats
    ascending: bool

    @property
    def size(self) -> int:
        """How many numbers are emulated."""
        return sum(block.size for block in self.blocks)

    def encode(self, response: Named) -> Floats:
        """Return the numbers ``(n, size)``, in units of measurement error."""
        return np.hstack([block.encode(response) for block in self.blocks])

    def decode(
        self, values: Floats, directions: Floats, finite: bool = False
    ) -> tuple[Named, Named]:
        """Return the response that has these numbers, and how it moves.

        ``{variable: (n, *shape)}`` and ``{variable: (n, *shape, k)}``.
        """
        parts: list[tuple[Named, Named]] = []
        begin = 0
        for block in self.blocks:
            part = slice(begin, begin := begin + block.size)
            parts.append(block.decode(values[:, part], directions[:, part], finite))
        response, moves = (_join(side) for side in zip(*parts, strict=True))
        if "eigenvalues" not in response:
            return response, moves
        eigenvalues, moved = response.pop("eigenvalues"), moves.pop("eigenvalues")
        order = np.broadcast_to(np.arange(len(self.least)), eigenvalues.shape)
        if self.ascending:
            order = np.argsort(eigenvalues, axis=1, kind="stable")
        ordered = np.take_along_axis(eigenvalues, order, axis=1)
        root = np.sqrt(np.maximum(ordered, self.least))
        response["frequency"] = root / (2 * np.pi)
        moved = np.take_along_axis(moved, order[:, :, None], axis=1)
        root = root[:, :, None]
        if finite:
            # No further than to zero: half the way from there to twice as far.
            root = np.maximum(root, np.sqrt(np.abs(moved)) / 2.0)
        moves["frequency"] = moved / (4 * np.pi * root)
        if "shapes" in response:
            order = order[:, None]
            response["shapes"] = np.take_along_axis(response["shapes"], order, axis=2)
            order = order[..., None]
            moves["shapes"] = np.take_along_axis(moves["shapes"], order, axis=2)
        return response, moves


def _join(parts: Sequence[Named]) -> Named:
    """Return the modes of all blocks side by side, and the other variables."""
    joined: Named = {}
    for name in dict.fromkeys(name for part in parts for name in part):
        arrays = [part[name] for part in parts if name in part]
        axis = 2 if name == "shapes" else 1
        joined[name] = arrays[0] if len(arrays) == 1 else np.concatenate(arrays, axis)
    return joined


def eigenvalues_of(response: Named) -> Floats:
    """Return the eigenvalues ``(n, m)`` of frequencies in Hz."""
    return np.asarray((2 * np.pi * response["frequency"]) ** 2)
