r"""What is emulated of a response: numbers that stay smooth, in units of their errors.

Sorted eigenvalues have kinks where two modes meet. With shapes known the modes of a
block are turned onto reference shapes, :math:`\Phi Q \approx \Phi_0`, and

.. math:: A = Q^T \Lambda Q, \qquad \Psi = \Phi Q

are smooth as long as the block spans what the reference spans; the eigenvectors of A
turn :math:`\Psi` back. Without shapes two or three neighbours are told by their mean
and their central moments, which do not mind the order. Any other variable is emulated
as it is.

To decode is to return both a response and how it moves along ``directions (n, size,
k)`` of the numbers: as far as they are long if they are ``finite``, so that what has a
root or a crossing stays finite; otherwise the moves are derivatives.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Self, TypeAlias

import numpy as np

from ..interfaces import Floats, Response, read
from .gaussian_process import fit_processes

LEAST = 1e-8  # an eigenvalue predicted below this share of the usual one is cut there
FAR = 3.0  # squared distance per dimension beyond which a point counts less
WORST = 100.0  # squared error beyond which it is only known to be large
GAIN = 0.8  # several modes together must lower the squared error to this share
ROUNDS = 3  # of lengths, then of blocks with them

Named: TypeAlias = dict[str, Floats]
Key: TypeAlias = tuple[int, int]  # the first mode, and the one behind the last


class Modes(NamedTuple):
    """Eigenvalues ``(n, m)``, and shapes ``(n, n_dof, m)`` where they are known."""

    eigenvalues: Floats
    shapes: Floats | None = None


@dataclass(frozen=True, eq=False)
class Aligned:
    """Modes turned onto reference shapes; a single mode needs none.

    Attributes:
        first: The first of the modes.
        unit: Of the eigenvalues, ``(r,)``.
        shape_unit: ``(n_dof, r)``, None if shapes are not wanted.
        inverse: Of the reference shapes, ``(r, n_dof)``, None if there are none.
    """

    first: int
    unit: Floats
    shape_unit: Floats | None
    inverse: Floats | None

    @property
    def size(self) -> int:
        """How many numbers."""
        r = len(self.unit)
        return r * (r + 1) // 2 + (
            0 if self.shape_unit is None else self.shape_unit.size
        )

    @property
    def _scale(self) -> Floats:
        """The units of the entries of A, ``(r, r)``."""
        return np.asarray(np.sqrt(np.outer(self.unit, self.unit)))

    def encode(self, modes: Modes) -> Floats:
        """Return the entries of A and the aligned shapes, ``(n, size)``."""
        members = slice(self.first, self.first + len(self.unit))
        eigenvalues = modes.eigenvalues[:, members]
        if self.inverse is None or modes.shapes is None:
            scaled: Floats = eigenvalues / self.unit
            return scaled
        shapes = modes.shapes[:, :, members]
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
    ) -> tuple[Modes, Modes]:
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
        if aligned is None or rest is None:
            return Modes(eigenvalues), Modes(moved)
        gaps = (eigenvalues[:, None] - eigenvalues[:, :, None])[:, :, None]
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
        return (
            Modes(eigenvalues, shapes),
            Modes(moved, changed.transpose(0, 2, 3, 1) + mixed.swapaxes(2, 3)),
        )

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


@dataclass(frozen=True, eq=False)
class Symmetric:
    r"""Two or three eigenvalues by their mean and central moments.

    .. math:: \mu = \overline{\lambda}, \qquad p_2 = \overline{(\lambda - \mu)^2},
        \qquad p_3 = \overline{(\lambda - \mu)^3}

    Whatever is predicted, the eigenvalues are real and in order.

    Attributes:
        first: The first of the modes.
        unit: Of the moments, ``(r,)``.
    """

    first: int
    unit: Floats

    @classmethod
    def of(cls, first: int, unit: Floats, eigenvalues: Floats) -> Self:
        """Return the block for eigenvalues ``(N, r)`` of the given units ``(r,)``."""
        sd = float(np.sqrt((unit**2).mean()))
        spread = max(float(np.median(eigenvalues.std(axis=1))), sd)
        # A moment moves by its power times the spread for a move of one.
        scales = [sd, 2.0 * spread * sd, 3.0 * spread**2 * sd]
        return cls(first, np.array(scales[: eigenvalues.shape[1]]))

    @property
    def size(self) -> int:
        """How many numbers."""
        return len(self.unit)

    def encode(self, modes: Modes) -> Floats:
        """Return the moments, ``(n, size)``."""
        eigenvalues = modes.eigenvalues[:, self.first : self.first + self.size]
        mean = eigenvalues.mean(axis=1, keepdims=True)
        powers = range(2, self.size + 1)
        moments = [((eigenvalues - mean) ** p).mean(axis=1) for p in powers]
        return np.column_stack([mean, *moments]) / self.unit

    def decode(
        self, values: Floats, directions: Floats, finite: bool
    ) -> tuple[Modes, Modes]:
        """Return the eigenvalues of these moments, or the nearest real ones."""
        eigenvalues, moves = self._solve(values), directions.swapaxes(1, 2)
        if finite:
            ahead, behind = (
                self._solve(values[:, None] + s * moves) for s in (1.0, -1)
            )
            change = (ahead - behind) / 2.0
            return Modes(eigenvalues), Modes(change.swapaxes(1, 2))
        apart = eigenvalues - eigenvalues.mean(axis=1, keepdims=True)
        # How the moments move with the eigenvalues, row by row
        squares = apart**2 - (apart**2).mean(axis=1, keepdims=True)
        rows = [np.ones_like(apart), 2.0 * apart, 3.0 * squares][: self.size]
        forward = np.stack(rows, axis=1) / self.size / self.unit[:, None]
        return Modes(eigenvalues), Modes(np.linalg.pinv(forward) @ directions)

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
        solved: Floats = moments[..., :1] + apart
        return solved


@dataclass(frozen=True, eq=False)
class ModalOutputs:
    r"""Frequencies in Hz, and shapes, by eigenvalues in units of measurement error.

    .. math:: \lambda = (2 \pi f)^2, \qquad \sigma_\lambda = 8 \pi^2 f \sigma_f

    Where the frequencies were in ascending order, so are those that are predicted.

    Attributes:
        blocks: The modes, in blocks that cross among themselves.
        least: Eigenvalues below which none is predicted, ``(m,)``.
        ascending: Whether the frequencies were in ascending order.
    """

    blocks: tuple[Aligned | Symmetric, ...]
    least: Floats
    ascending: bool

    @property
    def size(self) -> int:
        """How many numbers."""
        return sum(block.size for block in self.blocks)

    def encode(self, response: Response) -> Floats:
        """Return the numbers ``(n, size)``."""
        modes = read_modes(response)
        return np.hstack([block.encode(modes) for block in self.blocks])

    def decode(
        self, values: Floats, directions: Floats, finite: bool
    ) -> tuple[Named, Named]:
        """Return the frequencies in Hz and the shapes, and how they move."""
        pairs = [
            block.decode(values[:, part], directions[:, part], finite)
            for block, part in zip(self.blocks, _split(self.blocks), strict=True)
        ]
        modes, moves = (_join(group) for group in zip(*pairs, strict=True))
        order = np.broadcast_to(np.arange(len(self.least)), modes.eigenvalues.shape)
        if self.ascending:
            order = np.argsort(modes.eigenvalues, axis=1, kind="stable")
        ordered = np.take_along_axis(modes.eigenvalues, order, axis=1)
        root = np.sqrt(np.maximum(ordered, self.least))
        response = {"frequency": root / (2 * np.pi)}
        moved = np.take_along_axis(moves.eigenvalues, order[:, :, None], axis=1)
        root = root[:, :, None]
        if finite:
            # No further than to zero: half the way from there to twice as far.
            root = np.maximum(root, np.sqrt(np.abs(moved)) / 2.0)
        changes = {"frequency": moved / (4 * np.pi * root)}
        if modes.shapes is not None and moves.shapes is not None:
            pick = order[:, None]
            response["shapes"] = np.take_along_axis(modes.shapes, pick, axis=2)
            changes["shapes"] = np.take_along_axis(
                moves.shapes, pick[..., None], axis=2
            )
        return response, changes


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

    def encode(self, response: Response) -> Floats:
        """Return the numbers ``(n, size)``."""
        values = np.asarray(read(response, self.name), dtype=float) / self.unit
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
    """The parts that together make a response; made by :func:`choose_outputs`."""

    parts: tuple[ModalOutputs | Numbers, ...]

    @property
    def size(self) -> int:
        """How many numbers are emulated."""
        return sum(part.size for part in self.parts)

    def encode(self, response: Response) -> Floats:
        """Return the numbers ``(n, size)``, in units of measurement error."""
        return np.hstack([part.encode(response) for part in self.parts])

    def decode(
        self, values: Floats, directions: Floats, finite: bool = False
    ) -> tuple[Named, Named]:
        """Return the response that has these numbers, and how it moves.

        ``{variable: (n, *shape)}`` and ``{variable: (n, *shape, k)}``.
        """
        response: Named = {}
        moves: Named = {}
        for part, columns in zip(self.parts, _split(self.parts), strict=True):
            pair = part.decode(values[:, columns], directions[:, columns], finite)
            response |= pair[0]
            moves |= pair[1]
        return response, moves


def choose_outputs(
    points: Floats,
    response: Response,
    units: Mapping[str, Floats],
    start: Floats | None = None,
) -> Outputs:
    """Return what to emulate of a response that was solved for at some points.

    Frequencies become eigenvalues, those of modes that cross one block of numbers that
    stay smooth; all else stays as it is.

    Args:
        points: ``(N, d)`` coordinates of about unit spread.
        response: Its variables, each ``(N, *shape)``.
        units: Standard deviations of the measurement error, ``{variable: (*shape)}``,
            of every variable that is wanted; of frequencies in Hz. Shapes that are not
            wanted still tell which mode is which.
        start: Lengths to begin with.
    """
    rest = dict(units)
    parts: list[ModalOutputs | Numbers] = []
    if "frequency" in rest and rest["frequency"].ndim == 1:
        modal_units = rest.pop("frequency"), rest.pop("shapes", None)
        parts.append(_choose_modes(points, read_modes(response), *modal_units, start))
    for name, unit in rest.items():
        reference = None
        if name == "shapes" and unit.ndim == 2:
            # The direction that most shapes have in common, whatever their signs.
            by_mode = np.asarray(read(response, name)).transpose(2, 0, 1)
            reference = np.linalg.svd(by_mode, full_matrices=False)[2][:, 0].T
        parts.append(Numbers(name, unit, reference))
    return Outputs(tuple(parts))


def read_modes(response: Response) -> Modes:
    """Return eigenvalues, and shapes where the response has them."""
    frequencies = np.asarray(read(response, "frequency"), dtype=float)
    try:
        shapes = np.asarray(read(response, "shapes"), dtype=float)
    except TypeError:
        shapes = None
    return Modes((2 * np.pi * frequencies) ** 2, shapes)


def _choose_modes(
    points: Floats,
    modes: Modes,
    frequency_unit: Floats,
    shape_unit: Floats | None,
    start: Floats | None,
) -> ModalOutputs:
    """Return the blocks of neighbours in which modes are emulated best.

    Alone, turned onto reference shapes where shapes are known, two or three in
    symmetric functions where they are not. Lengths depend on what is emulated, so that
    parting and fitting take turns, once from single modes and once from blocks that are
    as large as they may be; the best leaves the smallest error, each point left out in
    turn.
    """
    frequencies = np.sqrt(modes.eigenvalues) / (2 * np.pi)
    usual = np.maximum(np.median(frequencies, axis=0), frequency_unit)
    unit, shapes, m = 8 * np.pi**2 * usual * frequency_unit, modes.shapes, len(usual)
    centre = int(np.argmin((points**2).sum(axis=1)))

    def make(first: int, last: int) -> Aligned | Symmetric:
        members = slice(first, last)
        if shapes is None and last > first + 1:
            return Symmetric.of(first, unit[members], modes.eigenvalues[:, members])
        wanted = None if shape_unit is None else shape_unit[:, members]
        inverse = None if shapes is None else np.linalg.pinv(shapes[centre][:, members])
        return Aligned(first, unit[members], wanted, inverse)

    least = LEAST * (2 * np.pi * usual) ** 2
    if not (np.diff(frequencies, axis=1) >= 0).all():
        return ModalOutputs(tuple(make(j, j + 1) for j in range(m)), least, False)
    largest = 3 if shapes is None else min(m, shapes.shape[1])
    keys = [(i, j) for i in range(m) for j in range(i + 1, min(i + largest, m) + 1)]
    blocks = {key: make(*key) for key in keys}
    codes = {key: block.encode(modes) for key, block in blocks.items()}
    weights = 1.0 / (1.0 + ((points**2).mean(axis=1) / FAR) ** 2)

    def cost(key: Key, errors: Floats) -> float:
        still = np.empty((*errors.shape, 0))
        decoded = blocks[key].decode(codes[key] - errors, still, False)[0].eigenvalues
        wrong = (decoded - modes.eigenvalues[:, slice(*key)]) / unit[slice(*key)]
        total = np.minimum(wrong**2, WORST).sum(axis=1)
        count = key[1] - key[0]
        if shape_unit is not None:
            by_shapes = errors[:, count * (count + 1) // 2 :] ** 2
            total = total + np.minimum(by_shapes, WORST).sum(axis=1)
        mean = float(weights @ total / weights.sum())
        return mean if count == 1 else mean / GAIN

    partings: dict[tuple[Key, ...], float] = {}
    for size in (1, largest):
        chosen = tuple((i, min(i + size, m)) for i in range(0, m, size))
        lengths = start
        for _ in range(ROUNDS):
            if chosen in partings:
                break
            together = np.hstack([codes[key] for key in chosen])
            processes = fit_processes(points, together, lengths)
            costs = {key: cost(key, processes.leave_out(codes[key])) for key in keys}
            partings[chosen] = sum(costs[key] for key in chosen)
            chosen, lengths = _cheapest(costs, m), processes.lengths
    best = min(partings, key=lambda parting: partings[parting])
    return ModalOutputs(tuple(blocks[key] for key in best), least, True)


def _cheapest(costs: dict[Key, float], m: int) -> tuple[Key, ...]:
    """Return the parting of m modes into neighbours that costs least."""
    best: list[tuple[float, tuple[Key, ...]]] = [(0.0, ())]
    for j in range(1, m + 1):
        ends = [
            (best[i][0] + costs[i, j], (*best[i][1], (i, j)))
            for i in range(j)
            if (i, j) in costs
        ]
        best.append(min(ends))
    return best[m][1]


def _split(
    parts: Sequence[Aligned | Symmetric] | Sequence[ModalOutputs | Numbers],
) -> list[slice]:
    """Return the columns of each part."""
    ends = np.cumsum([0, *(part.size for part in parts)]).tolist()
    return [slice(*pair) for pair in zip(ends[:-1], ends[1:], strict=True)]


def _join(blocks: Sequence[Modes]) -> Modes:
    """Return the modes of all blocks, or their moves, side by side."""
    eigenvalues = np.concatenate([block.eigenvalues for block in blocks], axis=1)
    shapes = [block.shapes for block in blocks if block.shapes is not None]
    if len(shapes) < len(blocks):
        return Modes(eigenvalues)
    return Modes(eigenvalues, np.concatenate(shapes, axis=2))
