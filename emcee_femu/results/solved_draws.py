"""Draws of an emulated posterior's chain that are to be solved in full."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..interfaces import Floats
from .arviz_objects import dataset, effective_sizes, is_weighted, mean_sizes, samples
from .diagnostics import diagnose


@dataclass(frozen=True, eq=False)
class EmulatedChain:
    """What an ArviZ object holds of the emulated posterior.

    Attributes:
        names: Parameter names, ``d`` of them.
        draws: All draws, step by step, ``(n, d)``.
        log_posterior: The emulated log-posterior there, ``(n,)``.
        bounds: Of the emulated posterior's prior, ``(d, 2)``.
        size: As many independent draws would know the centre as well, the worst
            parameter's.
        mean_sizes: The same for each parameter's mean and mean square, ``(2, d)``.
    """

    names: tuple[str, ...]
    draws: Floats
    log_posterior: Floats
    bounds: Floats
    size: float
    mean_sizes: Floats


@dataclass(frozen=True, eq=False)
class ChosenDraws:
    """Draws taken from a chain at equal distances; none is there twice.

    Attributes:
        theta: The draws, ``(n, d)``.
        log_posterior: The emulated log-posterior there, ``(n,)``.
        counts: How often each was taken: twice, if a walker stood still for so long.
    """

    theta: Floats
    log_posterior: Floats
    counts: NDArray[np.intp]


def read_chain(idata: Any, rng: np.random.Generator) -> EmulatedChain:
    """Return the chain of an emulated posterior; walkers in random order at each step.

    Raises:
        ValueError: If idata lacks the log-posterior or the bounds, or is not a chain
            but what an earlier certificate corrected.
    """
    names, chains = samples(idata)
    stats, constants = dataset(idata, "sample_stats"), dataset(idata, "constant_data")
    if "lp" not in stats or not {"lower", "upper"} <= set(constants):
        raise ValueError(
            "idata: expected what to_inference_data returns of the emulated posterior, "
            "with its log-posterior and its bounds"
        )
    if is_weighted(idata):
        raise ValueError(
            "idata: expected draws of the emulated posterior, got those that a "
            "certificate has weighted; give it the object that you certified"
        )
    lp = stats["lp"].transpose("chain", "draw").values
    order = rng.permuted(np.tile(np.arange(len(chains)), (chains.shape[1], 1)), axis=1)
    steps = np.arange(chains.shape[1])[:, None]
    draws = chains[order, steps].reshape(-1, len(names))
    for name, column in zip(names, draws.T, strict=True):
        if np.ptp(column) == 0:
            raise ValueError(f"idata: every draw of {name!r} is {column[0]:g}")
    squares = (chains - draws.mean(axis=0)) ** 2
    own = constants.reindex(parameter=names)
    return EmulatedChain(
        names=tuple(names),
        draws=draws,
        log_posterior=lp[order, steps].ravel(),
        bounds=np.column_stack([own["lower"].values, own["upper"].values]),
        size=_size(idata, chains),
        mean_sizes=np.array([_sizes(mean_sizes(c)) for c in (chains, squares)]),
    )


def _size(idata: Any, chains: Floats) -> float:
    """Return the number of independent draws."""
    if dataset(idata, "posterior").attrs.get("tempered"):
        # Exchanges hand states over, which walker by walker look independent.
        sizes = diagnose(idata).ess_bulk
    else:
        sizes = effective_sizes(chains)[0]
    return float(min(_sizes(sizes).min(), chains.shape[0] * chains.shape[1]))


def _sizes(found: Floats) -> Floats:
    """Return effective sizes of at least one; NaN is that of a chain too short."""
    sizes: Floats = np.fmax(np.nan_to_num(found, nan=1.0), 1.0)
    return sizes


def choose_draws(chain: EmulatedChain, n: int, rng: np.random.Generator) -> ChosenDraws:
    """Return ``n`` different draws at equal distances in the chain, or fewer.

    Every draw of the chain is as likely to be taken as any other. A walker that stood
    still may be met again: its draw is solved once and counts as often as it was met.
    """
    total, start = len(chain.draws), rng.random()
    taken = min(n, total)
    while True:
        places = ((start + np.arange(taken)) * total / taken).astype(int)
        places = np.minimum(places, total - 1)
        _, first, counts = np.unique(
            chain.draws[places], axis=0, return_index=True, return_counts=True
        )
        if len(first) >= n or taken == total:
            break
        taken = min(taken + max(n - len(first), taken // 8), total)
    kept = np.sort(rng.permutation(len(first))[:n])
    where = places[first[kept]]
    return ChosenDraws(chain.draws[where], chain.log_posterior[where], counts[kept])
