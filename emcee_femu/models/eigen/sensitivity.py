r"""Derivatives of natural frequencies and mode shapes of a batch, by modal sums.

.. math:: \lambda_i' = \phi_i^T (K' - \lambda_i M') \phi_i, \qquad
    f_i' = \frac{\lambda_i'}{8 \pi^2 f_i}, \qquad
    \phi_i' = \sum_{k \ne i} \frac{\phi_k^T (K' - \lambda_i M') \phi_i}
    {\lambda_i - \lambda_k} \phi_k - \tfrac12 (\phi_i^T M' \phi_i) \phi_i

of mass-normalised shapes that keep their signs. The sums run over all modes, rigid-body
modes among them, and are therefore exact; the modes i are elastic, so that no f is 0.

Source: Fox and Kapoor, AIAA J. 6 (1968) 2426, doi:10.2514/3.5008.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ...interfaces import Floats

EPS = float(np.finfo(float).eps)
ONE = 1.0  # the weight of a parameter that is a coefficient
REPEATED = 1e-10  # relative gap of eigenvalues below which modes coincide
PARTING = 1e-7  # share of a derivative's terms that may be left by rounding

Weight: TypeAlias = Floats | float  # (n,), or the same for all
# How the coefficients of K, and those of M, change with a parameter, by number.
Slope: TypeAlias = tuple[Mapping[int, Weight], Mapping[int, Weight]]
Slopes: TypeAlias = Mapping[str, Slope]
Derivatives: TypeAlias = dict[str, dict[str, Floats]]


class Block(NamedTuple):
    """Matrices of coefficients without their rows of zeros, those of one size together.

    The matrix of a spring, storey or member has few rows that are not zero.

    Attributes:
        numbers: Which matrices, ``g`` of them.
        rows: Their rows that are not zero, ``(g, s)``.
        entries: What is in these rows and columns, ``(g, s, s)``.
    """

    numbers: tuple[int, ...]
    rows: NDArray[np.intp]
    entries: Floats


Blocks: TypeAlias = tuple[Block, ...]


class Modes(NamedTuple):
    """What a solve leaves: all modes of every parameter set.

    Attributes:
        eigenvalues: Ascending, ``(n, N)``.
        shapes: Mass-normalised, ``(n, N, N)``.
        reported: The same where they are reported, ``(n, n_out, N)``; None for
            frequencies alone.
        selected: Indices of the modes whose derivatives are wanted.
        skip: Number of rigid-body modes.
        describe: Names parameter set i in an error message.
    """

    eigenvalues: Floats
    shapes: Floats
    reported: Floats | None
    selected: tuple[int, ...]
    skip: int
    describe: Callable[[int], str]


def unit_slopes(K: Iterable[str], M: Iterable[str]) -> dict[str, Slope]:
    """Return the slopes of parameters that are the coefficients of K and of M."""
    in_K, in_M = ({name: {i: ONE} for i, name in enumerate(of)} for of in (K, M))
    return {name: (in_K.get(name, {}), in_M.get(name, {})) for name in in_K | in_M}


def collect(matrices: Floats) -> Blocks:
    """Return matrices ``(n, N, N)`` by the number of their rows that are not zero."""
    N = matrices.shape[1]
    rows = [np.flatnonzero(matrix.any(axis=1)) for matrix in matrices]
    by_size: dict[int, list[int]] = {}
    for number, own in enumerate(rows):
        size = min(N, max(4, 1 << (len(own) - 1).bit_length()))  # few sizes: 4, 8, 16
        rows[number] = np.append(
            own, np.setdiff1d(np.arange(N), own)[: size - len(own)]
        )
        by_size.setdefault(size, []).append(number)
    blocks = []
    for size, numbers in by_size.items():
        # A block gathers g s rows of all shapes: at most four times their number.
        most = 4 * N // size
        for start in range(0, len(numbers), most):
            part = numbers[start : start + most]
            entries = [matrices[j][np.ix_(rows[j], rows[j])] for j in part]
            places = np.array([rows[j] for j in part])
            blocks.append(Block(tuple(part), places, np.array(entries)))
    return tuple(blocks)


def differentiate(modes: Modes, K: Blocks, M: Blocks, slopes: Slopes) -> Derivatives:
    """Return derivatives of what is reported, ``{variable: {parameter: (n, ...)}}``.

    "frequency" in Hz is ``(n, n_modes)``, "shapes" ``(n, n_out, n_modes)``. Modes
    coincide where their eigenvalues do, to 1e-10 or to rounding. If they stay together
    as a parameter changes, their frequencies have a derivative; that of the shapes is
    then without turning in the space that they span, in which they are any.

    Raises:
        ValueError: If modes coincide that part as a parameter changes: which of them
            is the lower one changes there, and no derivative exists.
    """
    n_modes, own = len(modes.selected), list(modes.selected)
    near = _find_repeated(modes, own)
    if repeated := bool(near.any()):  # with partners that nobody asked for
        own += sorted({*np.flatnonzero(near.any(axis=(0, 2))).tolist()} - {*own})
    columns = np.arange(len(own))
    eigenvalues, wanted = modes.eigenvalues[:, own], modes.shapes[:, :, own]
    full = repeated or modes.reported is not None
    left = modes.shapes if full else None
    in_K, in_M = ([slope[i] for slope in slopes.values()] for i in (0, 1))
    H = _combine(K, in_K, left, wanted)  # (n, d, [N,] m)
    T = _combine(M, in_M, left, wanted) if any(in_M) else None
    if T is not None:
        H -= (eigenvalues[:, None, None] if full else eigenvalues[:, None]) * T
    changes = H[:, :, own, columns] if full else H  # of the eigenvalues, (n, d, m)
    if repeated:
        sizes = _combine(_absolute(K), in_K, None, np.abs(wanted))
        masses = _combine(_absolute(M), in_M, None, np.abs(wanted))
        sizes += eigenvalues[:, None] * masses
        _refuse_parting(modes, near, own, H, changes, sizes, list(slopes))
    frequency = changes / (4 * np.pi * np.sqrt(eigenvalues[:, None]))
    result = {"frequency": by_name(slopes, frequency[:, :, :n_modes])}
    if modes.reported is not None:
        near[:, own[:n_modes], columns[:n_modes]] = True
        gaps = eigenvalues[:, None, :n_modes] - modes.eigenvalues[:, :, None]
        H = H[..., :n_modes]
        H *= np.where(near, 0.0, 1.0 / np.where(near, 1.0, gaps))[:, None]
        if T is not None:
            H -= np.where(near[:, None], 0.5 * T[..., :n_modes], 0.0)
        result["shapes"] = by_name(slopes, modes.reported[:, None] @ H)
    return result


def _find_repeated(modes: Modes, own: Sequence[int]) -> NDArray[np.bool_]:
    """Return whether mode k coincides with the i-th of ``own``, ``(n, N, m)``."""
    values = modes.eigenvalues
    rounding = EPS * np.sqrt(values.shape[1]) * values[:, -1:]
    apart = np.diff(values) > np.maximum(REPEATED * values[:, 1:], rounding)
    cluster = np.cumsum(apart, axis=1)
    cluster = np.concatenate([np.zeros_like(cluster[:, :1]), cluster], axis=1)
    near: NDArray[np.bool_] = cluster[:, :, None] == cluster[:, None, own]
    near[:, own, np.arange(len(own))] = False
    return near


def _combine(
    blocks: Blocks,
    slopes: Sequence[Mapping[int, Weight]],
    left: Floats | None,
    right: Floats,
) -> Floats:
    """Return ``left^T A' right`` for each parameter, where ``A' = sum w_j A_j``.

    Args:
        blocks: The A_j.
        slopes: The w_j of each parameter, ``d`` of them.
        left: ``(n, N, p)``; None for the diagonal of ``right^T A' right`` alone.
        right: ``(n, N, m)``.

    Returns:
        ``(n, d, p, m)``, or ``(n, d, m)`` for the diagonal.
    """
    users: dict[int, list[tuple[int, Weight]]] = {}
    for place, weights in enumerate(slopes):
        for number, weight in weights.items():
            users.setdefault(number, []).append((place, weight))
    used = [b for b in blocks if not users.keys().isdisjoint(b.numbers)]
    n, _, m = right.shape
    total: Floats | None = None
    for block in used:
        gathered = right[:, block.rows]  # (n, g, s, m)
        forces = block.entries @ gathered
        forms: Floats = (
            (gathered * forces).sum(axis=2)
            if left is None
            else left[:, block.rows].swapaxes(2, 3) @ forces
        )
        own = [users.get(number, []) for number in block.numbers]
        places = [place for pairs in own for place, _ in pairs]
        plain = all(len(pairs) == 1 and pairs[0][1] is ONE for pairs in own)
        if plain and len(used) == 1 and places == list(range(len(slopes))):
            return forms  # as it is, which saves half of the time
        if total is None:
            total = np.zeros((n, len(slopes), *forms.shape[2:]))
        if plain and len(set(places)) == len(places):
            total[:, places] += forms
            continue
        for i, pairs in enumerate(own):
            for place, weight in pairs:
                total[:, place] += (forms[:, i].T * weight).T
    if total is None:
        total = np.zeros((n, len(slopes), *(() if left is None else left.shape[2:]), m))
    return total


def _absolute(blocks: Blocks) -> Blocks:
    return tuple(block._replace(entries=np.abs(block.entries)) for block in blocks)


def _refuse_parting(
    modes: Modes,
    near: NDArray[np.bool_],
    own: Sequence[int],
    H: Floats,
    changes: Floats,
    sizes: Floats,
    names: Sequence[str],
) -> None:
    """Raise ValueError unless coinciding modes change alike, with every parameter."""
    row, k, i = np.nonzero(near)
    partner = np.array([own.index(mode) for mode in k.tolist()])
    difference = np.abs(changes[row, :, i] - changes[row, :, partner])  # (pairs, d)
    difference = np.maximum(difference, np.abs(H[row, :, k, i]))
    parting = difference > PARTING * (sizes[row, :, i] + sizes[row, :, partner])
    if not parting.any():
        return
    pair, which = np.argwhere(parting)[0].tolist()
    at = int(row[pair])
    low, high = sorted((own[int(i[pair])], int(k[pair])))
    hertz = np.sqrt(modes.eigenvalues[at, low]) / (2 * np.pi)
    numbers = low - modes.skip + 1, high - modes.skip + 1
    raise parting_error(numbers, float(hertz), names[which], modes.describe(at))


def parting_error(
    modes: tuple[int, int], hertz: float, parameter: str, where: str
) -> ValueError:
    """Return what is raised where modes coincide that part as a parameter changes."""
    return ValueError(
        f"modes {modes[0]} and {modes[1]} coincide ({hertz:.6g} Hz) at {where} and "
        f"part as {parameter!r} changes: which is the lower one changes there, so that "
        "they have no derivatives; move the parameters a little, by 1e-6 of their "
        "values, or tie those that make the two modes equal to one parameter"
    )


def at_row(slope: Slope, row: int) -> Slope:
    """Return a slope for one parameter set."""
    in_K, in_M = (
        {j: w if isinstance(w, float) else float(w[row]) for j, w in weights.items()}
        for weights in slope
    )
    return in_K, in_M


def by_name(names: Iterable[str], derivatives: Floats) -> dict[str, Floats]:
    """Return derivatives ``(n, d, ...)`` by the names of the parameters."""
    return {name: derivatives[:, i] for i, name in enumerate(names)}
