"""The evidence along a ladder of betas, and a better ladder."""

from typing import Any

import numpy as np

from ..interfaces import Floats
from ..moves.tempering import find_ladder
from ..sampling.bridging import bridge
from .evidence_bridge import ENOUGH_OVERLAP, standard_error

STEP = 1.2  # between neighbouring betas, in standard deviations of their log ratio


def tempered_evidence(
    log_likelihood: Floats, betas: Floats
) -> tuple[float, float, tuple[str, ...], dict[str, Any]]:
    """Return the log evidence, its error, what forbids it, overlaps and better betas.

    Args:
        log_likelihood: ``(steps, ensembles, n_betas, block)``.
        betas: From 1 to 0.
    """
    by_rung = np.moveaxis(log_likelihood, 2, 0)
    if not (by_rung.var(axis=(1, 3)) > 0).all():
        raise ValueError(
            "samplers: the log-likelihoods of an ensemble never changed; see diagnose"
        )
    total, series, overlaps = 0.0, np.zeros(by_rung.shape[1:3]), []
    for t, gap in enumerate(betas[:-1] - betas[1:]):
        found = bridge(gap * by_rung[t], gap * by_rung[t + 1])
        total += found.log_ratio
        # One series, for exchanges carry errors from rung to rung.
        series += (found.from_f + found.from_g).mean(axis=2)
        overlaps.append(found.overlap)
    error, problems = standard_error(series)
    better = space_betas(betas, by_rung.var(axis=(1, 2, 3)))
    worst = int(np.argmin(overlaps))
    if overlaps[worst] < ENOUGH_OVERLAP:
        problems = (
            *problems,
            f"betas {betas[worst]:.3g} and {betas[worst + 1]:.3g} hardly overlap "
            f"({overlaps[worst]:.3f} of 1): run again with these better_betas, "
            f"{np.array2string(better, precision=3, separator=', ')}",
        )
    found_too = {"overlaps": np.array(overlaps), "better_betas": better}
    return total, error, problems, found_too


def space_betas(betas: Floats, variances: Floats) -> Floats:
    r"""Return betas from 1 to 0 whose laws are about equally far from their neighbours.

    .. math:: \int_{\beta_{t+1}}^{\beta_t} \sqrt{V(\beta)}\, d\beta \le 1.2

    V is the variance of the log-likelihood; between the betas given, 1 / sqrt(V) is
    taken for linear, as it is for a Gaussian posterior.

    Examples:
        >>> space_betas(np.array([1.0, 0.1, 0.0]), np.array([2.0, 50.0, 1e4])).round(3)
        array([1.   , 0.423, 0.142, 0.027, 0.   ])
    """
    spread = 1 / np.sqrt(variances)
    length, along, places = 0.0, [np.zeros(1)], [betas[-1:]]
    for t in range(len(betas) - 1, 0, -1):
        hot, cold = spread[t], spread[t - 1] * (1 + 1e-9)  # their logarithms differ
        slope = (cold - hot) / (betas[t - 1] - betas[t])
        points = hot * (cold / hot) ** np.linspace(0, 1, 100)
        along.append(length + np.log(points / hot) / slope)
        places.append(betas[t] + (points - hot) / slope)
        length = along[-1][-1]
    steps = max(1, int(np.ceil(length / STEP)))
    lengths = np.linspace(0, length, steps + 1)
    result = np.interp(lengths, np.concatenate(along), np.concatenate(places))
    result[[0, -1]] = 0.0, 1.0
    return result[::-1].copy()


def check_betas(runs: list[Any]) -> Floats:
    """Return the betas that all runs share, refusing those that do not end at 0."""
    found: list[Floats] = []
    for run in runs:
        move = find_ladder(getattr(run, "_moves", ()))
        own: Any = getattr(run, "backend", run) if move is None else move
        if not hasattr(own, "betas") or len(own.betas) < 2:
            raise ValueError(
                "samplers: expected samplers of a TemperedMove or of 'auto', got one "
                "that is not, or a backend, which does not know its moves"
            )
        found.append(np.asarray(own.betas, dtype=float))
    if not all(np.array_equal(own, found[0]) for own in found):
        got = [own.tolist() for own in found]
        raise ValueError(f"samplers: expected the same betas in all, got {got}")
    if found[0][-1] != 0:
        raise ValueError(
            "samplers: expected betas that end at 0, the prior, from which the "
            f"evidence starts, got {found[0].tolist()}"
        )
    return found[0].copy()
