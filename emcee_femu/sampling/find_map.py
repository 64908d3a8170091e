"""The maxima of a posterior, before any sampling: a start, and a quick look."""

from collections import Counter
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy import special

from .. import checks
from ..interfaces import Floats
from ..posterior.climbing import Maximum, climb_each, distinct
from ..posterior.log_posterior import LogPosterior
from .evaluation import Evaluation
from .found_map import FoundMap, draw_inside
from .importance import kish_share, pareto_k
from .pools.own_processes import open_pool

FEWEST = 25  # draws of a check; from fewer there is no Pareto k


def find_map(
    posterior: LogPosterior,
    starts: int | ArrayLike = 16,
    *,
    seed: int,
    check: int = 0,
    workers: int | None = None,
    pool: Any = None,
    on_failure: str = "raise",
    max_failures: float = 0.1,
) -> FoundMap:
    r"""Find the maxima of the posterior, each with the Gaussian that fits it there.

    From every start a climb inside the bounds, by Gauss-Newton steps where the terms'
    errors are Gaussian: some 4 solves if the models have ``jacobian``, else ``d + 1``
    for each step. The weight of a maximum is its share of the evidence by Laplace's
    approximation,

    .. math:: Z_k = p(D | \theta_k) p(\theta_k) (2\pi)^{d/2} |\Sigma_k|^{1/2}
        P_k(\mathrm{inside\ the\ bounds})

    Good for a first look, for starts of a chain and to see that a model and a test fit
    together. It is no posterior: a maximum that no start leads to is missing, and what
    is not Gaussian has other standard deviations. The same seed gives the same result.

    Args:
        posterior: Where to climb.
        starts: How many draws from the prior to start from, or the starts themselves,
            ``(n, d)`` or ``(d,)``.
        seed: A whole number.
        check: Draws from the found Gaussians, whose importance weights tell whether
            the posterior is one; as many solves. At least 25; 0 for no check.
        workers: Number of processes to start; see :func:`run`.
        pool: Where to evaluate instead; see :func:`run`.
        on_failure: What a solve that fails does: "raise" to stop with the parameters
            by name, "reject" to log it and give up the start, or shorten the step.
        max_failures: Fraction of the evaluations, of at least 100, above which
            "reject" stops the search.

    Returns:
        The maxima, their Gaussians and weights; ``print`` it.

    Raises:
        TypeError: If posterior is not a LogPosterior, or a count is not a whole
            number.
        ValueError: If a start is out of bounds, or check is between 0 and 25.
        RuntimeError: If no start led to a maximum, or too many solves failed.

    Examples:
        >>> import emcee_femu as ef
        >>> model = ef.FunctionModel(lambda p: [p["k"] ** 0.5], n_modes=1)
        >>> term = ef.FrequencyTerm([3.0], relative_sd=0.01)
        >>> prior = ef.GaussianPrior(["k"], [8.0], [2.0], [(1.0, 20.0)])
        >>> found = ef.find_map(ef.LogPosterior(model, term, prior), 4, seed=1)
        >>> (best,) = found.maxima
        >>> best.theta.round(2).tolist(), (best.covariance**0.5).round(2).tolist()
        ([8.99], [[0.18]])
    """
    if not isinstance(posterior, LogPosterior):
        got = type(posterior).__name__
        raise TypeError(f"posterior: expected a LogPosterior, got {got}")
    for_starts, for_check = np.random.SeedSequence(
        checks.whole_number("seed", seed)
    ).spawn(2)
    points = _choose_starts(posterior, starts, for_starts)
    check = checks.whole_number("check", check)
    if 0 < check < FEWEST:
        raise ValueError(f"check: expected 0 or at least {FEWEST} draws, got {check}")
    with open_pool(pool, workers, posterior.one_by_one) as evaluators:
        evaluation = Evaluation.of(posterior, evaluators, on_failure, max_failures)
        ends = climb_each(evaluation, points, posterior.prior)
        reached = [end for end in ends if end.log_evidence > -np.inf]
        lost = [end.message for end in ends if end.log_evidence == -np.inf]
        if not reached:
            raise RuntimeError(
                f"starts: none of {len(ends)} led to a maximum ({dict(Counter(lost))});"
                " give starts where the posterior can be evaluated"
            )
        groups = distinct(reached)
        groups.sort(key=lambda group: -reached[group[0]].log_evidence)
        maxima = [reached[group[0]] for group in groups]
        log_evidence = np.array([own.log_evidence for own in maxima])
        weights = special.softmax(log_evidence)
        found = 0, np.nan, np.nan
        if check:
            found = _check(evaluation, maxima, weights, check, for_check)
    return FoundMap(
        posterior=posterior,
        maxima=tuple(maxima),
        weights=weights,
        climbs=np.array([len(group) for group in groups]),
        lost=tuple(lost),
        solves=evaluation.solves,
        draws=found[0],
        pareto_k=found[1],
        efficiency=found[2],
    )


def _choose_starts(posterior: LogPosterior, starts: Any, seed: Any) -> Floats:
    """Return starts ``(n, d)``, drawn from the prior or given."""
    if isinstance(starts, str) or not hasattr(starts, "__len__"):
        return posterior.start(checks.whole_number("starts", starts, 1), seed)
    points = np.atleast_2d(checks.real_array("starts", starts))
    if not points.size:
        raise ValueError("starts: expected at least one, got none")
    posterior.check_inside("starts", points)
    return points


def _check(
    evaluation: Evaluation, maxima: list[Maximum], weights: Floats, n: int, seed: Any
) -> tuple[int, float, float]:
    """Return how many draws from the Gaussians, their Pareto k and effective share.

    There are fewer than n where most of a Gaussian is out of bounds.
    """
    rng, bounds = np.random.default_rng(seed), evaluation.posterior.prior.bounds
    draws, log_density = draw_inside(maxima, weights, bounds, n, rng)
    log_weights = evaluation.rows(draws)[:, 0] - log_density
    return len(draws), pareto_k(log_weights), kish_share(log_weights)
