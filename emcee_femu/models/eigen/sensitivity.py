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
from .blocks import ONE, Blocks, Weight, absolute, combine

EPS = float(np.finfo(float).eps)
AT_ONCE = 2**16  # numbers of an array; larger ones cost more to allocate than to fill
REPEATED = 1e-10  # relative gap of eigenvalues below which modes coincide
PARTING = 1e-7  # share of a derivative's terms that may be left by rounding

# How the coefficients of K, and those of M, change with a parameter, by number.
Slope: TypeAlias = tuple[Mapping[int, Weight], Mapping[int, Weight]]
Slopes: TypeAlias = Mapping[str, Slope]
Derivatives: TypeAlias = dict[str, dict[str, Floats]]


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

    def take(self, rows: slice) -> "Modes":
        """Return those of some parameter sets."""
        return self._replace(
            eigenvalues=self.eigenvalues[rows],
            shapes=self.shapes[rows],
            reported=None if self.reported is None else self.reported[rows],
            describe=lambda row: self.describe(rows.start + row),
        )


def unit_slopes(K: Iterable[str], M: Iterable[str]) -> dict[str, Slope]:
    """Return the slopes of parameters that are the coefficients of K and of M."""
    in_K, in_M = ({name: {i: ONE} for i, name in enumerate(of)} for of in (K, M))
    return {name: (in_K.get(name, {}), in_M.get(name, {})) for name in in_K | in_M}


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
    n, N = modes.eigenvalues.shape
    shape = len(slopes), len(modes.selected)
    frequency = np.empty((n, *shape))
    shapes = None
    if modes.reported is not None:
        shapes = np.empty((n, shape[0], modes.reported.shape[1], shape[1]))
    step = max(1, AT_ONCE // max(1, N * shape[0] * shape[1]))
    for start in range(0, n, step):
        rows = slice(start, start + step)
        frequency[rows], turns = _differentiate_rows(modes.take(rows), K, M, slopes)
        if shapes is not None:
            shapes[rows] = turns
    result = {"frequency": by_name(slopes, frequency)}
    return result if shapes is None else result | {"shapes": by_name(slopes, shapes)}


def _differentiate_rows(
    modes: Modes, K: Blocks, M: Blocks, slopes: Slopes
) -> tuple[Floats, Floats | None]:
    """Return derivatives ``(n, d, m)`` and ``(n, d, n_out, m)`` of some rows."""
    n_modes, own = len(modes.selected), list(modes.selected)
    near = _find_repeated(modes, own)
    if repeated := bool(near.any()):  # with partners that nobody asked for
        own += sorted({*np.flatnonzero(near.any(axis=(0, 2))).tolist()} - {*own})
    columns = np.arange(len(own))
    eigenvalues, wanted = modes.eigenvalues[:, own], modes.shapes[:, :, own]
    full = repeated or modes.reported is not None
    left = modes.shapes if full else None
    in_K, in_M = ([slope[i] for slope in slopes.values()] for i in (0, 1))
    H = combine(K, in_K, left, wanted)  # (n, d, [N,] m)
    T = combine(M, in_M, left, wanted) if any(in_M) else None
    if T is not None:
        H -= (eigenvalues[:, None, None] if full else eigenvalues[:, None]) * T
    changes = H[:, :, own, columns] if full else H  # of the eigenvalues, (n, d, m)
    if repeated:
        sizes = combine(absolute(K), in_K, None, np.abs(wanted))
        masses = combine(absolute(M), in_M, None, np.abs(wanted))
        sizes += eigenvalues[:, None] * masses
        _refuse_parting(modes, near, own, H, changes, sizes, list(slopes))
    frequency = changes / (4 * np.pi * np.sqrt(eigenvalues[:, None]))
    turns = None
    if modes.reported is not None:
        near[:, own[:n_modes], columns[:n_modes]] = True
        gaps = eigenvalues[:, None, :n_modes] - modes.eigenvalues[:, :, None]
        H = H[..., :n_modes]
        H *= np.where(near, 0.0, 1.0 / np.where(near, 1.0, gaps))[:, None]
        if T is not None:
            H -= np.where(near[:, None], 0.5 * T[..., :n_modes], 0.0)
        turns = modes.reported[:, None] @ H
    return frequency[:, :, :n_modes], turns


def _find_repeated(modes: Modes, own: Sequence[int]) -> NDArray[np.bool_]:
    """Return whether mode k coincides with the i-th of ``own``, ``(n, N, m)``."""
    values = modes.eigenvalues
    rounding = EPS * np.sqrt(values.shape[1]) * values[:, -1:]
    apart = np.diff(values) > np.maximum(REPEATED * values[:, 1:], rounding)
    cluster = np.cumsum(np.pad(apart, ((0, 0), (1, 0))), axis=1)
    near: NDArray[np.bool_] = cluster[:, :, None] == cluster[:, None, own]
    near[:, own, np.arange(len(own))] = False
    return near


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
