"""Which modes are emulated together: what leaves the smallest error, left one out."""

from dataclasses import dataclass

import numpy as np

from ..interfaces import Floats
from .gaussian_process import Processes, fit_processes
from .mode_blocks import Aligned, Block, Modes, Symmetric
from .outputs_modes import LEAST, ModalOutputs

FAR = 3.0  # squared distance per dimension beyond which a point counts less
WORST = 100.0  # squared error beyond which it is only known to be large
GAIN = 0.8  # several modes together must lower the squared error to this share
ROUNDS = 3  # of lengths, then of blocks with them

Key = tuple[int, int]  # the first mode, and the one behind the last


def choose_modes(
    points: Floats,
    modes: Modes,
    units: tuple[Floats, Floats | None],
    start: Floats | None = None,
) -> ModalOutputs:
    """Return the blocks in which modes are emulated best.

    The modes are parted into neighbours: alone, turned onto reference shapes where
    shapes are known, two or three in symmetric functions where they are not.

    Args:
        points: ``(N, d)`` coordinates, of unit spread where it matters.
        modes: Eigenvalues ``(N, m)``, shapes ``(N, n_dof, m)`` or None.
        units: Of frequencies in Hz ``(m,)``, and of shapes ``(n_dof, m)``; None if
            they are not wanted, even if they are known.
        start: Lengths to begin with.
    """
    frequencies = np.sqrt(np.maximum(modes.eigenvalues, 0.0)) / (2 * np.pi)
    usual = np.maximum(np.median(frequencies, axis=0), units[0])
    ascending = bool((np.diff(frequencies, axis=1) >= 0).all())
    m = len(usual)
    unit = 8 * np.pi**2 * usual * units[0]
    choice = _Choice(points, modes, unit, units[1])
    single = [(j, j + 1) for j in range(m)]
    best = choice.part(start) if ascending else single
    return ModalOutputs(
        tuple(choice.make(*key) for key in best),
        LEAST * (2 * np.pi * usual) ** 2,
        ascending,
        units[1] is not None,
    )


@dataclass(frozen=True)
class _Choice:
    """The solved modes, and what of them is to be emulated."""

    points: Floats
    modes: Modes
    unit: Floats
    shape_unit: Floats | None

    def make(self, first: int, last: int) -> Block:
        """Return a block of neighbouring modes."""
        own = slice(first, last)
        shapes = self.modes.shapes
        if shapes is None and last > first + 1:
            eigenvalues = self.modes.eigenvalues[:, own]
            return Symmetric.of(first, self.unit[own], eigenvalues)
        wanted = None if self.shape_unit is None else self.shape_unit[:, own]
        centre = int(np.argmin((self.points**2).sum(axis=1)))
        reference = None if shapes is None else shapes[centre][:, own]
        return Aligned.of(first, self.unit[own], wanted, reference)

    def part(self, start: Floats | None) -> list[Key]:
        """Return the best parting into neighbours.

        Lengths depend on what is emulated, so that parting and fitting take turns,
        once from single modes and once from blocks that are as large as they may be.
        """
        m, shapes = len(self.unit), self.modes.shapes
        largest = 3 if shapes is None else min(m, shapes.shape[1])
        keys = [(i, j) for i in range(m) for j in range(i + 1, min(i + largest, m) + 1)]
        blocks = {key: self.make(*key) for key in keys}
        codes = {key: block.encode(self.modes) for key, block in blocks.items()}
        found: dict[tuple[Key, ...], float] = {}
        for size in (1, largest):
            chosen = tuple((i, min(i + size, m)) for i in range(0, m, size))
            lengths = start
            for _ in range(ROUNDS):
                if chosen in found:
                    break
                together = np.hstack([codes[key] for key in chosen])
                processes = fit_processes(self.points, together, lengths)
                costs = {
                    key: self._cost(blocks[key], codes[key], processes) for key in keys
                }
                found[chosen] = sum(costs[key] for key in chosen)
                chosen, lengths = _cheapest(costs, m), processes.lengths
        return [*min(found, key=lambda keys: found[keys])]

    def _cost(self, block: Block, codes: Floats, processes: Processes) -> float:
        """Return the squared error of a block's modes, each point left out in turn."""
        errors = processes.leave_out(codes)
        decoded = block.decode(codes - errors).eigenvalues
        own = slice(block.first, block.first + block.count)
        square = ((decoded - self.modes.eigenvalues[:, own]) / self.unit[own]) ** 2
        total = np.minimum(square, WORST).sum(axis=1)
        if self.shape_unit is not None:
            shapes = errors[:, block.count * (block.count + 1) // 2 :] ** 2
            total = total + np.minimum(shapes, WORST).sum(axis=1)
        distance = (self.points**2).mean(axis=1)
        weights = 1.0 / (1.0 + (distance / FAR) ** 2)
        mean = float(weights @ total / weights.sum())
        return mean if block.count == 1 else mean / GAIN


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
