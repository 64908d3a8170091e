"""Which numbers of a response are emulated: modes together that change places.

The fit decides, each point left out in turn.
"""

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np

from ...contracts import Floats
from ...models.differences import derive_along
from .encoding import Aligned, Named, Numbers, Outputs, Symmetric, eigenvalues_of
from .gaussian_process import Processes, fit_processes

# An eigenvalue predicted below this share of the usual one is cut there.
LEAST_EIGENVALUE = 1e-8
WORST = 100.0  # squared error beyond which it is only known to be large
# Share of the squared error that modes together, or own lengths, leave.
WORTH_A_BLOCK = 0.95
EXACT_ERROR = 1e-300  # squared error of processes that are exact
PARTITION_ROUNDS = 3  # of lengths, then of blocks with them
# Share of a variable's size by which it is moved along its derivatives.
TANGENT_STEP = 1e-4

Key: TypeAlias = tuple[int, int]  # the first mode, and the one behind the last


def fit_outputs(
    points: Floats,
    response: Named,
    tangents: Named,
    units: Named,
    weights: Floats,
    logs: bool = False,
    start: Sequence[Processes] = (),
    again: bool = False,
) -> tuple[Outputs, tuple[Processes, ...], float]:
    """Return what to emulate of a response that was solved for, and its processes.

    Frequencies become eigenvalues, those of modes that cross one block of numbers that
    stay smooth; all else stays as it is. The processes are of all numbers, or some of
    each block with lengths of their own. Beside them stands the mean square error that
    leaving out one point after another shows, by which fits are compared.

    Args:
        points: ``(N, d)`` coordinates of about unit spread.
        response: Its variables, each ``(N, *shape)``.
        tangents: Their derivatives by the coordinates, as in :func:`observe`.
        units: Standard deviations of the measurement error, ``{variable: (*shape)}``,
            of every variable that is wanted; of frequencies in Hz. Shapes that are not
            wanted still tell which mode is which.
        weights: How much each point matters, ``(N,)``, which sum to one.
        logs: Whether eigenvalues are seen by their logarithms, if they are above zero.
        start: Processes whose lengths to begin with.
        again: Whether their kinds of kernel are kept, and one set of lengths if they
            have one.
    """
    numbers = dict(units)
    modal, processes, cost = Outputs((), np.empty(0), False), None, 0.0
    if "frequency" in units and units["frequency"].ndim == 1:
        pair = numbers.pop("frequency"), numbers.pop("shapes", None)
        modal, processes, cost = _choose_modes(
            points, response, tangents, *pair, weights, logs, start, again
        )
    blocks = [*modal.blocks]
    for name, unit in numbers.items():
        reference = None
        if name == "shapes" and unit.ndim == 2:
            # The direction that most shapes have in common, whatever their signs.
            by_mode = response[name].transpose(2, 0, 1)
            reference = np.linalg.svd(by_mode, full_matrices=False)[2][:, 0].T
        blocks.append(Numbers(name, unit, reference))
    outputs = Outputs(tuple(blocks), modal.least, modal.ascending)
    if numbers or processes is None:
        values = observe(outputs, response, tangents)
        processes = _fit(points, values, start, again)
        cost += _square(processes.leave_out(values)[:, modal.size :], weights)
    if len(blocks) == 1 or (again and len(start) == 1):
        return outputs, (processes,), cost

    ends = np.cumsum([block.size for block in blocks])[:-1]
    parts = np.split(processes.values, ends, axis=2)
    apart = tuple(_fit(points, part, [processes], again) for part in parts)
    own = np.hstack([fit.leave_out(fit.values) for fit in apart])
    common = _square(processes.leave_out(processes.values), weights)
    share = _square(own, weights) / max(common, EXACT_ERROR)
    if share > WORTH_A_BLOCK:
        return outputs, (processes,), cost
    return outputs, apart, share * cost


def observe(
    encoder: Aligned | Symmetric | Numbers | Outputs, response: Named, tangents: Named
) -> Floats:
    """Return what is emulated, ``(N, 1, size)``, or ``(N, 1 + d, size)`` with slopes.

    These are differences along the derivatives of the response, which cost no solve.

    Args:
        encoder: A block, or all of them.
        response: Its variables, each ``(N, *shape)``.
        tangents: Their derivatives along d directions, each ``(N, *shape, d)``, NaN
            where they are not known; empty without.
    """
    values = encoder.encode(response)
    if not tangents:
        return values[:, None]
    known = ~np.isnan(next(iter(tangents.values())).reshape(len(values), -1)[:, 0])
    at = [response[name][known] for name in tangents]
    along = [np.moveaxis(tangent[known], -1, 0) for tangent in tangents.values()]
    directions = [str(j) for j in range(len(along[0]))]
    observed = np.full((len(values), 1 + len(directions), values.shape[1]), np.nan)
    observed[:, 0] = values
    speed = np.zeros(along[0].shape[:2])
    for value, move in zip(at, along, strict=True):
        size = np.abs(value).max(initial=0.0) or 1.0
        speed += np.abs(move).reshape(*speed.shape, -1).max(axis=2) / size
    steps = TANGENT_STEP / np.where(speed > 0, speed, 1.0)

    def encode(*arrays: Floats) -> Named:
        return {"": encoder.encode(dict(zip(tangents, arrays, strict=True)))}

    if known.any():
        slopes = derive_along(encode, at, along, steps, directions)[""]
        observed[known, 1:] = np.stack([*slopes.values()], axis=1)
    return observed


def _choose_modes(
    points: Floats,
    response: Named,
    tangents: Named,
    frequency_unit: Floats,
    shape_unit: Floats | None,
    weights: Floats,
    logs: bool,
    start: Sequence[Processes],
    again: bool,
) -> tuple[Outputs, Processes, float]:
    """Return the blocks of neighbours in which modes are emulated best, fitted.

    Alone, turned onto reference shapes where shapes are known, two or three in
    symmetric functions where they are not. Lengths depend on what is emulated, so that
    parting and fitting take turns, once from single modes and once from blocks that are
    as large as they may be; the best leaves the smallest error, each point left out in
    turn. A block puts its modes in ascending order, which is wrong where they are not.
    """
    frequencies, shapes = response["frequency"], response.get("shapes")
    eigenvalues = eigenvalues_of(response)
    usual = np.maximum(np.median(frequencies, axis=0), frequency_unit)
    unit, m = 8 * np.pi**2 * usual * frequency_unit, len(usual)
    least = LEAST_EIGENVALUE * (2 * np.pi * usual) ** 2
    by_logs = logs and (eigenvalues > least).all()
    scale = (2 * np.pi * usual) ** 2 if by_logs else None
    centre = int(np.argmax(weights))

    def make(first: int, last: int) -> Aligned | Symmetric:
        members = slice(first, last)
        if shapes is None and last > first + 1:
            return Symmetric(first, unit[members], eigenvalues[:, members])
        wanted = None if shape_unit is None else shape_unit[:, members]
        inverse = None if shapes is None else np.linalg.pinv(shapes[centre][:, members])
        scaled = None if scale is None else scale[members]
        return Aligned(first, unit[members], wanted, inverse, scaled)

    largest = 3 if shapes is None else min(m, shapes.shape[1])
    keys = [(i, j) for i in range(m) for j in range(i + 1, min(i + largest, m) + 1)]
    blocks = {key: make(*key) for key in keys}
    modal = {n: t for n, t in tangents.items() if n in ("frequency", "shapes")}
    codes = {key: observe(block, response, modal) for key, block in blocks.items()}

    def cost(key: Key, errors: Floats) -> float:
        still, members = np.empty((*errors.shape, 0)), slice(*key)
        decoded, _ = blocks[key].decode(codes[key][:, 0] - errors, still, False)
        wrong = (decoded["eigenvalues"] - eigenvalues[:, members]) / unit[members]
        count = key[1] - key[0]
        if shape_unit is not None:
            wrong = np.hstack([wrong, errors[:, count * (count + 1) // 2 :]])
        mean = _square(wrong, weights)
        return mean if count == 1 else mean / WORTH_A_BLOCK

    partings: dict[tuple[Key, ...], tuple[float, Processes]] = {}
    for power in (2, 0):  # single modes, and as few blocks as there can be
        chosen = _cheapest({(i, j): float(j - i) ** power for i, j in keys}, m)
        near = start
        for _ in range(PARTITION_ROUNDS):
            if chosen in partings:
                break
            together = np.concatenate([codes[key] for key in chosen], axis=2)
            processes = _fit(points, together, near, again)
            near = [processes]
            costs = {key: cost(key, processes.leave_out(codes[key])) for key in keys}
            partings[chosen] = sum(costs[key] for key in chosen), processes
            chosen = _cheapest(costs, m)
    best = min(partings, key=lambda parting: partings[parting][0])
    ascending = bool((np.diff(frequencies, axis=1) >= 0).all())
    outputs = Outputs(tuple(blocks[key] for key in best), least, ascending)
    return outputs, partings[best][1], partings[best][0]


def _square(wrong: Floats, weights: Floats) -> float:
    """Return the weighted mean square of errors ``(N, q)``, none beyond WORST."""
    return float(weights @ np.minimum(wrong**2, WORST).sum(axis=1))


def _fit(
    points: Floats, values: Floats, start: Sequence[Processes], again: bool
) -> Processes:
    """Return processes fitted from lengths of others, ``again`` by their kernels."""
    if not start:
        return fit_processes(points, values)
    rough = {processes.rough for processes in start}
    kinds = tuple(sorted(rough)) if again else (False, True)
    return fit_processes(points, values, start[0].lengths, kinds)


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
