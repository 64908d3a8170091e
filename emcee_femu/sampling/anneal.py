"""TMCMC: carry a population from the prior to the posterior, power by power.

The population is two halves. Each is resampled within itself, and moved by proposals
that were fitted to the other: a fit to the members that it then moves follows their
accidents, which made the evidence 1.3 too large in ten dimensions.
"""

import warnings
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from os import PathLike
from typing import TypeAlias

import numpy as np
from numpy.random import RandomState
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import softmax

from .. import checks
from ..contracts import Floats
from ..evaluation.evaluator import Evaluation
from ..evaluation.resume import open_evaluator
from ..moves.independence import ComponentWalk, IndependenceMove
from ..moves.proposing import temper
from ..posterior.log_posterior import LogPosterior
from .coordinates import Coordinates
from .first_solve import check_first_solve, doubt_reach
from .importance import FAIR_SHARE, GOOD_K, bridge, kish_share, pareto_k, resample
from .record import Annealed

MOST_FINITE_DRAWS = 20  # times the size, for a population of finite likelihood
# Powers whose proposals tell of what is missing; early ones may fit badly.
LAST_POWERS = 2
RENEWED = 0.8  # of the members are to be independent of their ancestors
MOST_SWEEPS = 20  # at one power
MOST_THOROUGH = 30  # sweeps of an annealing for the evidence
AGREED = 2.5  # standard errors by which two evidences may differ
MOST_ANNEALED = 6
PER_COMPONENT = 10  # members of a half for each parameter and component

Evaluate: TypeAlias = Callable[[Floats], Floats]  # coordinates to rows


def anneal(
    posterior: LogPosterior,
    size: int = 1_000,
    *,
    seed: int,
    workers: int | None = None,
    pool: object = None,
    on_failure: str = "raise",
    max_failures: float = 0.2,
    backend: str | PathLike[str] | None = None,
    resume: bool = False,
    probe_tolerance: float = 1e-6,
) -> Annealed:
    r"""Carry a population of draws from the prior to the posterior (TMCMC).

    .. math:: p_j(\theta) \propto p(\theta) L(\theta)^{\beta_j}, \quad 0 = \beta_0 <
        \dots < \beta_m = 1

    Use it for posteriors with several modes, for the evidence, or if many workers are
    available: all members are evaluated in one batch, so up to ``size`` workers help.
    Each power takes up to 30 sweeps of ``size`` solves.

    Each power is chosen so that the weights :math:`L^{\beta_{j+1} - \beta_j}` have a
    coefficient of variation of 1. Members are resampled by these weights, then moved by
    independence proposals (Student-t mixtures) and random walks until four fifths have
    been renewed, even among the quarter of slowest members by likelihood. They move on
    the log scale of positive parameters and on the logit scale of parameters between
    two bounds, since the posterior may be pressed against a bound. Each half of the
    population fits the proposals for the other. The evidence is a product of ratios,
    each bridged between the members at two neighbouring powers; its error treats all
    descendants of one draw of the prior as a single draw.

    The result is a population with equal weights, not a chain: R-hat and
    autocorrelation times have no meaning. Pass it to :func:`to_inference_data` for
    tables and figures. A narrow mode is missed if no early member comes near it; a
    larger size finds smaller modes.

    No error of the evidence is given, and ``problems`` says why, in two cases. First,
    proposals fitted to the population at the last two powers have heavy-tailed weights
    (Pareto k above 0.7): they reach a region that the population is missing, such as
    the neck of a funnel. Second, the mean weight of the last proposals, a second
    estimate of the evidence, differs from the first by more than 2.5 standard errors:
    at some power there were too few members, or they moved too slowly. A mode far from
    all members remains undetected.

    Args:
        posterior: The posterior to sample.
        size: Number of members, at least 20 per parameter.
        seed: A whole number; the same seed gives the same population, bit for bit.
        workers: Number of worker processes, as in :func:`run`.
        pool: A pool to evaluate in, instead of workers; see :func:`run`.
        on_failure: What to do about a failed solve, as in :func:`run`; "reject" sets
            its likelihood to zero.
        max_failures: Fraction of failed solves above which "reject" stops.
        backend: File in which all evaluations are stored, such as "anneal.sqlite".
        resume: Whether to continue from that file if it exists. The population is the
            same as without the interruption, bit for bit. Resuming a finished
            calculation costs the 16 solves that check for a changed model.
        probe_tolerance: Relative difference in these solves above which the model is
            considered changed.

    Returns:
        The population, its evidence and its history; ``print`` it.

    Raises:
        TypeError: If posterior is not a LogPosterior, or a count is not a whole number.
        ValueError: If size is too small, too few draws of the prior have a finite
            likelihood, or the file already exists or belongs to another calculation.
        RuntimeError: If too many solves failed.
        UserWarning: If the model at the prior mean is far from the measurements.

    Source: Ching and Chen (2007),
    doi:10.1061/(ASCE)0733-9399(2007)133:7(816); Bennett (1976),
    doi:10.1016/0021-9991(76)90078-4 (the ratios); Lee and Whiteley (2018),
    doi:10.1093/biomet/asy028 (lineages).

    Examples:
        >>> import emcee_femu as ef
        >>> model = ef.FunctionModel(lambda p: [p["k"] ** 0.5, (3 * p["k"]) ** 0.5])
        >>> term = ef.FrequencyTerm([3.0, 5.2], relative_sd=0.01)
        >>> prior = ef.GaussianPrior(["k"], [8.0], [2.0], [(1.0, 20.0)])
        >>> population = ef.anneal(ef.LogPosterior(model, term, prior), 200, seed=1)
        >>> population.theta.shape, bool(abs(population.theta.mean() - 9.0) < 0.1)
        ((200, 1), True)
    """
    posterior = checks.instance("posterior", posterior, LogPosterior)
    size = checks.whole_number("size", size, fewest_members(posterior.ndim))
    seed = checks.whole_number("seed", seed)
    asked = {"moves": "anneal", "size": size, "seed": seed}
    how = workers, pool, on_failure, max_failures, backend, resume, probe_tolerance
    with open_evaluator(posterior, asked, *how) as evaluator:
        _, doubts = check_first_solve(evaluator)
        coordinates = Coordinates.unbounded(posterior.prior)
        rng = np.random.default_rng(seed)
        population = anneal_population(evaluator, coordinates, rng, size, thorough=True)
    population.rows[:, :2] -= coordinates.log_volume(population.theta)[:, None]
    return replace(
        population,
        theta=coordinates.parameters(population.theta),
        solves=evaluator.solves,
        failed_solves=evaluator.failed,
        doubts=doubts,
    )


def anneal_population(
    evaluator: Evaluation,
    coordinates: Coordinates,
    rng: np.random.Generator,
    size: int,
    thorough: bool = False,
    most: float = np.inf,
    begin: tuple[Evaluation, Floats] | None = None,
) -> Annealed:
    """Return the population at the power 1, in coordinates; see :func:`anneal`.

    Args:
        evaluator: Of parameters.
        coordinates: In which the population moves, and its prior.
        rng: The same stream gives the same population.
        size: Members, at least ``fewest_members(d)``.
        thorough: Whether sweeps end by the slowest quarter of the members, as an
            evidence needs it; a search for starts does not.
        most: Solves that may be spent, members of the prior too; it may end at a lower
            power then.
        begin: Another posterior of the same prior, and members of it, ``(size, d)``, to
            begin with in place of the prior: the powers are those of the ratio of the
            two.

    Raises:
        ValueError: If too few draws of the prior have a finite likelihood.
        RuntimeError: If no power above the last one can be told from it.
    """
    before = evaluator.solves
    random = RandomState(rng.bit_generator)
    evaluate = alone = partial(coordinates.rows, evaluator)
    if begin is None:
        theta, rows, share, draws = _draw(evaluate, coordinates, rng, size)
        # In a search, or of an emulator, there was a look before. Where draws are
        # impossible the likelihood does vary.
        look = thorough and share == 1
        for doubt in doubt_reach(evaluator.posterior, rows) if look else ():
            warnings.warn(doubt, stacklevel=3)
    else:
        evaluate = partial(coordinates.compare, evaluator, begin[0])
        theta, rows, share, draws = begin[1], evaluate(begin[1]), 1.0, size
    halves = [np.arange(size // 2), np.arange(size // 2, size)]
    fits = [IndependenceMove.fit(theta[half]) for half in halves[::-1]]
    ancestors, influence = np.arange(size), np.zeros(size)
    log_evidence, powers = float(np.log(share)), [0.0]
    moved, tried = [], []
    longest = MOST_THOROUGH if thorough else MOST_SWEEPS
    while powers[-1] < 1 and (left := most - evaluator.solves + before) > size:
        sweeps = int(min(longest, left / size))
        low = rows[:, 0] - rows[:, 1]
        step = _next_step(low, 1 - powers[-1])
        if powers[-1] + step == powers[-1]:
            raise RuntimeError(
                f"posterior: the likelihood still varies by {np.ptp(low):g} at its "
                f"power {powers[-1]:g}, and no larger one can be reached; is it a "
                "function of the parameters alone?"
            )
        powers.append(1.0 if step == 1 - powers[-1] else powers[-1] + step)
        weights = softmax(step * low)
        kept = np.concatenate(
            [half[resample(weights[half], len(half), rng.random())] for half in halves]
        )
        parents, ancestors = ancestors, ancestors[kept]
        theta, rows = theta[kept], rows[kept]
        first, second = (theta[half] for half in halves)
        fits = [_fit(second, first, fits[0]), _fit(first, second, fits[1])]
        here = alone if powers[-1] == 1 else evaluate  # where no other law counts
        theta, rows, accepted, log_weights = _renew(
            here, theta, rows, halves, powers[-1], random, fits, thorough, sweeps
        )
        moved.append(accepted)
        tried.append(log_weights)
        high = rows[:, 0] - rows[:, 1]
        ratio = bridge(step * high, step * low)
        log_evidence += ratio.log_ratio
        np.add.at(influence, parents, ratio.from_g / len(low))
        np.add.at(influence, ancestors, ratio.from_f / len(high))
    error = float(np.sqrt((influence**2).sum() + (1 - share) / (share * draws)))
    problems = (
        _find_problems(tried[-LAST_POWERS:], log_evidence, error) if tried else ()
    )
    return Annealed(
        names=evaluator.posterior.names,
        theta=theta,
        rows=rows,
        powers=np.array(powers),
        acceptance=np.array([np.mean(shares) for shares in moved]),
        sweeps=np.array([len(shares) for shares in moved]),
        log_evidence=log_evidence,
        log_evidence_error=np.inf if problems else error,
        effective_size=_effective_size(coordinates.parameters(theta), ancestors),
        solves=evaluator.solves - before,
        problems=problems,
        units=evaluator.posterior.units,
        log_box=evaluator.posterior.log_box,
    )


def fewest_members(ndim: int) -> int:
    """Return the smallest population that a mixture can be fitted to, in halves."""
    return 2 * PER_COMPONENT * ndim


def _find_problems(tried: list[Floats], value: float, error: float) -> tuple[str, ...]:
    """Return what the weights of independence proposals at the last powers forbid.

    A region that the population missed is in none of the fits to it, and the few
    proposals that come upon it have weights far above all others.

    Where they have no such tail, their mean is an evidence that owes nothing to the
    earlier powers. Members that were slow at these, or too few, make the product of
    ratios wrong by more than their lineages tell, and the last population may still
    be good.
    """
    k = max((pareto_k(w) for w in tried if kish_share(w) < FAIR_SHARE), default=0.0)
    if k > GOOD_K:
        return (
            "a region of the posterior may be missing: the weights of proposals fitted "
            f"to the population have a heavy tail (Pareto k {k:.2f}, the limit is "
            f'{GOOD_K}); a larger size may find it, and so may "auto"',
        )
    last = tried[-1]
    direct = float(np.logaddexp.reduce(last)) - np.log(len(last))
    apart = np.hypot(error, np.sqrt((1 / kish_share(last) - 1) / len(last)))
    if abs(value - direct) <= AGREED * apart:
        return ()
    return (
        f"the log evidence along the powers, {value:.3f}, and that from the last "
        f"proposals, {direct:.3f}, differ significantly; give a larger size",
    )


def _draw(
    evaluate: Evaluate, coordinates: Coordinates, rng: np.random.Generator, size: int
) -> tuple[Floats, Floats, float, int]:
    """Return members of finite likelihood, their rows, their share of the prior."""
    theta = coordinates.sample(rng, size)
    rows = evaluate(theta)
    for draws in range(size, (MOST_FINITE_DRAWS + 1) * size, size):
        finite = rows[:, 0] > -np.inf
        if (number := int(finite.sum())) >= size:
            keep = np.flatnonzero(finite)[:size]
            return theta[keep], rows[keep], number / draws, draws
        more = coordinates.sample(rng, size)
        theta = np.concatenate([theta[finite], more])
        rows = np.concatenate([rows[finite], evaluate(more)])
    raise ValueError(
        f"posterior: only {number} of {draws} draws of the prior have a finite "
        "likelihood; narrow the prior to where the model can be solved"
    )


def _next_step(log_likelihood: Floats, most: float) -> float:
    """Return the increment whose weights have a coefficient of variation of 1."""
    centred = log_likelihood - log_likelihood.max()

    def excess(step: float) -> float:
        weights = np.exp(step * centred)
        return float(weights.std() / weights.mean()) - 1

    if excess(most) <= 0:
        return most
    return float(brentq(excess, 0.0, most, xtol=1e-300, maxiter=10_000))


def _fit(draws: Floats, others: Floats, last: IndependenceMove) -> IndependenceMove:
    """Return a mixture with as many components as make the others more likely.

    Where a thin part of the prior holds nearly all of the likelihood, a half may become
    copies of one member, which have no covariance: then the last fit serves again.
    """
    most = min(MOST_ANNEALED, len(draws) // (PER_COMPONENT * draws.shape[1]))
    best, score = last, -np.inf
    for components in range(1, most + 1):
        try:
            fitted = IndependenceMove.fit(draws, components)
            new = fitted.log_density(others).mean()
        except ValueError:  # a component died, or is flat
            break
        if new <= score:
            break
        best, score = fitted, new
    return best


def _renew(
    evaluate: Evaluate,
    theta: Floats,
    rows: Floats,
    halves: Sequence[NDArray[np.intp]],
    power: float,
    random: RandomState,
    fits: Sequence[IndependenceMove],
    thorough: bool,
    sweeps: int,
) -> tuple[Floats, Floats, list[float], Floats]:
    """Return members far from where they were, with their rows.

    Sweeps of independence proposals alternate with a random walk, whichever renews
    more members having three quarters of them. Those of high likelihood may wait the
    longest, and weigh the most at the next power: an average does not see them.

    Returns:
        Members, rows, the share of accepted proposals of each sweep, and ln(p / q) of
        all independence proposals.
    """
    (n, ndim), renewed = theta.shape, np.zeros(len(theta))
    walks = [ComponentWalk(fit.mixture) for fit in fits]
    accepted: list[float] = []
    log_weights: list[Floats] = []
    # An accepted step of the walk is worth 2.38**2 / (2 ndim) independent draws.
    worth = min(1.0, 2.8 / ndim)
    rates = [1.0, 0.25 * worth]
    groups = [np.arange(n)]
    if thorough:  # quarters by likelihood
        groups = np.array_split(np.argsort(rows[:, 0] - rows[:, 1]), 4)
    for sweep in range(sweeps):
        better = rates[1] > rates[0]
        walking = better if sweep % 4 < 3 and sweep else not better and sweep > 0
        moves = zip(walks if walking else fits, halves, strict=True)
        proposals = [move.get_proposal(theta[half], [], random) for move, half in moves]
        proposed, factors = map(np.concatenate, zip(*proposals, strict=True))
        new = evaluate(proposed)
        target = temper(new[:, 0], new[:, 1], power)
        if not walking:
            pairs = zip(fits, halves, strict=True)
            log_q = [fit.log_density(proposed[half]) for fit, half in pairs]
            log_weights.append(target - np.concatenate(log_q))
        threshold = temper(rows[:, 0], rows[:, 1], power) - factors
        threshold -= random.standard_exponential(n)
        better_ones = target > threshold
        theta = np.where(better_ones[:, None], proposed, theta)
        rows = np.where(better_ones[:, None], new, rows)
        accepted.append(float(better_ones.mean()))
        rates[walking] = accepted[-1] * (worth if walking else 1.0)
        renewed[better_ones] += worth if walking else 1.0
        if walking:
            for walk in walks:
                walk.scale *= np.exp(accepted[-1] - 0.25)
        if min(np.minimum(renewed[group], 1).mean() for group in groups) > RENEWED:
            break
    return theta, rows, accepted, np.concatenate(log_weights)


def _effective_size(theta: Floats, ancestors: NDArray[np.intp]) -> Floats:
    """Return the variance of each parameter by that of its mean, by lineages."""
    n = len(theta)
    centred = theta - theta.mean(axis=0)
    sums = np.zeros((n, theta.shape[1]))
    np.add.at(sums, ancestors, centred)
    size: Floats = n * (centred**2).sum(axis=0) / (sums**2).sum(axis=0)
    return np.minimum(size, n)
