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
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.random import RandomState
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import softmax

from .. import checks
from ..contracts import Floats
from ..evaluation.evaluator import Evaluation
from ..evaluation.resume import open_evaluator
from ..evaluation.starts import check_first_solve
from ..moves.independence import ComponentWalk, IndependenceMove
from ..moves.mixture import MOST_FITTED, PER_PARAMETER
from ..moves.proposing import temper
from ..posterior.log_posterior import (
    LOG_POSTERIOR,
    LOG_PRIOR,
    LogPosterior,
    log_likelihood,
)
from ..posterior.plausibility import doubt_reach
from .coordinates import Coordinates
from .importance import GOOD_K, are_reliable, bridge, kish_share, pareto_k, resample
from .record import Annealed

# Most draws of the prior, relative to the size, for a population of finite likelihood.
MOST_FINITE_DRAWS = 20
# Number of last powers whose proposals tell what is missing. Those at earlier powers
# may fit badly.
LAST_POWERS = 2
# Share of the members that have to become independent of their ancestors.
RENEWED = 0.8
# Most sweeps at one power.
MOST_SWEEPS = 30
# Standard errors by which two estimates of the evidence may differ.
AGREED = 2.5
# Scale of the best random walk for a Gaussian: an accepted step in d dimensions is
# worth 2.8 / d independent draws, and a quarter of the steps is accepted.
WORTH_OF_STEP = 2.8
WALK_ACCEPTANCE = 0.25

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

    Use it for posteriors with several maxima, for the evidence, or if many workers are
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
    tables and figures. A narrow maximum is missed if no early member comes near it; a
    larger size finds smaller ones.

    No error of the evidence is given, and ``problems`` says why, in two cases. First,
    proposals fitted to the population at the last two powers have heavy-tailed weights
    (Pareto k above 0.7): they reach a region that the population is missing, such as
    the neck of a funnel. Second, the mean weight of the last proposals, a second
    estimate of the evidence, differs from the first by more than 2.5 standard errors:
    at some power there were too few members, or they moved too slowly. A maximum far
    from all members remains undetected.

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
    rows = coordinates.lower(population.rows, population.theta)
    return replace(
        population,
        theta=coordinates.parameters(population.theta),
        rows=rows,
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
        evaluator: Evaluates the posterior.
        coordinates: The coordinates in which the population moves, with their prior.
        rng: Random stream; the same stream gives the same population.
        size: Members, at least ``fewest_members(d)``.
        thorough: Whether sweeps go on until the slowest quarter of the members has been
            renewed. An evidence needs that, a search for starts does not.
        most: Solves that may be spent, including those for the draws of the prior. If
            they are spent, the population may end at a lower power.
        begin: Another posterior with the same prior, and its members, ``(size, d)``, to
            begin with instead of draws of the prior. The powers are then those of the
            ratio of the two posteriors.

    Raises:
        ValueError: If too few draws of the prior have a finite likelihood.
        RuntimeError: If no power above the last one can be told from it.
    """
    before = evaluator.solves
    random = RandomState(rng.bit_generator)
    evaluate = alone = partial(coordinates.rows, evaluator)
    if begin is None:
        theta, rows, share, draws = _draw(evaluate, coordinates, rng, size)
        # In a search, or with an emulator, the prior was looked at before. If some
        # draws are impossible, the likelihood does vary.
        look = thorough and share == 1
        for doubt in doubt_reach(evaluator.posterior, rows) if look else ():
            warnings.warn(doubt, stacklevel=3)
    else:
        evaluate = partial(coordinates.compare, evaluator, begin[0])
        theta, rows, share, draws = begin[1], evaluate(begin[1]), 1.0, size
    halves = [np.arange(size // 2), np.arange(size // 2, size)]
    fits = [IndependenceMove.fit(theta[half]) for half in halves[::-1]]
    lineages, powers = _Lineages(size, float(np.log(share))), [0.0]
    history: list[_Renewed] = []
    while powers[-1] < 1 and (left := most - evaluator.solves + before) > size:
        low = log_likelihood(rows)
        power, step = _next_power(low, powers[-1])
        powers.append(power)
        kept = _select(softmax(step * low), halves, rng)
        theta, rows = theta[kept], rows[kept]
        first, second = (theta[half] for half in halves)
        fits = [_fit(second, first, fits[0]), _fit(first, second, fits[1])]
        here = alone if power == 1 else evaluate  # the other posterior no longer counts
        sweeps = int(min(MOST_SWEEPS, left / size))
        history.append(
            _renew(here, theta, rows, halves, power, random, fits, thorough, sweeps)
        )
        theta, rows = history[-1].theta, history[-1].rows
        lineages.go_on(kept, step * low, step * log_likelihood(rows))
    error = lineages.error((1 - share) / (share * draws))
    tried = [moved.log_weights for moved in history[-LAST_POWERS:]]
    problems = _find_problems(tried, lineages.log_evidence, error)
    return Annealed(
        names=evaluator.posterior.names,
        theta=theta,
        rows=rows,
        powers=np.array(powers),
        acceptance=np.array([np.mean(moved.accepted) for moved in history]),
        sweeps=np.array([len(moved.accepted) for moved in history]),
        log_evidence=lineages.log_evidence,
        log_evidence_error=np.inf if problems else error,
        effective_size=lineages.effective_size(coordinates.parameters(theta)),
        solves=evaluator.solves - before,
        problems=problems,
        units=evaluator.posterior.units,
        log_box=evaluator.posterior.log_box,
        posterior=evaluator.posterior,
    )


class _Renewed(NamedTuple):
    """Members that were moved at one power.

    Attributes:
        theta: The members, ``(size, d)``.
        rows: Their rows.
        accepted: The share of accepted proposals of each sweep.
        log_weights: ln(p / q) of all independence proposals.
    """

    theta: Floats
    rows: Floats
    accepted: list[float]
    log_weights: Floats


class _Lineages:
    """The ancestors of a population among its first members, and its evidence.

    Attributes:
        ancestors: The first member from which each descends, ``(size,)``.
        log_evidence: The sum of the ratios so far.
    """

    def __init__(self, size: int, log_evidence: float) -> None:
        self.ancestors, self.log_evidence = np.arange(size), log_evidence
        self._influence = np.zeros(size)

    def go_on(self, kept: NDArray[np.intp], low: Floats, high: Floats) -> None:
        """Record which members are kept, and the bridge from one power to the next.

        Args:
            kept: The members of the last power from which those of this one begin.
            low: ln of the ratio of the densities of both powers at the last members.
            high: The same at the members of this power.
        """
        ratio, parents = bridge(high, low), self.ancestors
        self.ancestors = parents[kept]
        self.log_evidence += ratio.log_ratio
        np.add.at(self._influence, parents, ratio.from_g / len(low))
        np.add.at(self._influence, self.ancestors, ratio.from_f / len(high))

    def error(self, variance: float) -> float:
        """Return the standard error of the log evidence, with a variance added."""
        return float(np.sqrt((self._influence**2).sum() + variance))

    def effective_size(self, theta: Floats) -> Floats:
        """Return each parameter's variance relative to that of its mean, ``(d,)``."""
        n = len(theta)
        centred = theta - theta.mean(axis=0)
        sums = np.zeros((n, theta.shape[1]))
        np.add.at(sums, self.ancestors, centred)
        size: Floats = n * (centred**2).sum(axis=0) / (sums**2).sum(axis=0)
        return np.minimum(size, n)


def fewest_members(ndim: int) -> int:
    """Return the smallest population that a mixture can be fitted to, in halves."""
    return 2 * PER_PARAMETER * ndim


def _find_problems(tried: list[Floats], value: float, error: float) -> tuple[str, ...]:
    """Say why no standard error can be claimed, by weights of independence proposals.

    A region that the population missed is in none of the fits to it, and the few
    proposals that come upon it have weights far above all others.

    Where they have no such tail, their mean is an evidence that owes nothing to the
    earlier powers. Members that were slow at these, or too few, make the product of
    ratios wrong by more than their lineages tell, and the last population may still
    be good.
    """
    if not tried:
        return ()
    judged = [(pareto_k(weights), kish_share(weights)) for weights in tried]
    if bad := [k for k, share in judged if not are_reliable(k, share)]:
        k = max(bad)
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
        finite = rows[:, LOG_POSTERIOR] > -np.inf
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


def _next_power(values: Floats, last: float) -> tuple[float, float]:
    """Return the next power, whose weights have a coefficient of variation of 1.

    The second number is the step to it.

    Args:
        values: Log-likelihoods of the members.
        last: The power that was reached.

    Raises:
        RuntimeError: If no power above the last one can be told from it.
    """
    centred, step = values - values.max(), 1 - last

    def excess(step: float) -> float:
        weights = np.exp(step * centred)
        return float(weights.std() / weights.mean()) - 1

    if excess(step) > 0:
        step = float(brentq(excess, 0.0, step, xtol=1e-300, maxiter=10_000))
    if last + step == last:
        raise RuntimeError(
            f"posterior: the likelihood still varies by {np.ptp(values):g} at "
            f"its power {last:g}, and no larger one can be reached; is it a function "
            "of the parameters alone?"
        )
    return (1.0 if step == 1 - last else last + step), step


def _select(
    weights: Floats, halves: Sequence[NDArray[np.intp]], rng: np.random.Generator
) -> NDArray[np.intp]:
    """Resample the members by their weights, each half within itself."""
    kept = [half[resample(weights[half], len(half), rng.random())] for half in halves]
    return np.concatenate(kept)


def _tempered(rows: Floats, power: float) -> Floats:
    """Return the log-densities at a power of the likelihood."""
    return temper(rows[:, LOG_POSTERIOR], rows[:, LOG_PRIOR], power)


def _fit(draws: Floats, others: Floats, last: IndependenceMove) -> IndependenceMove:
    """Return a mixture with as many components as make the others more likely.

    Where a thin part of the prior holds nearly all of the likelihood, a half may become
    copies of one member, which have no covariance: then the last fit serves again.
    """
    most = min(MOST_FITTED, len(draws) // (PER_PARAMETER * draws.shape[1]))
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
) -> _Renewed:
    """Return members far from where they were, with their rows.

    Independence proposals and a random walk alternate; the one that renews more members
    gets three sweeps of four. Members of high likelihood may wait longest, and have
    most weight at the next power: an average over all members would not show it.
    """
    (n, ndim), renewed = theta.shape, np.zeros(len(theta))
    walks = [ComponentWalk(fit.mixture) for fit in fits]
    accepted: list[float] = []
    log_weights: list[Floats] = []
    worth = min(1.0, WORTH_OF_STEP / ndim)
    rates = [1.0, WALK_ACCEPTANCE * worth]
    groups = [np.arange(n)]
    if thorough:  # quarters by likelihood
        groups = np.array_split(np.argsort(log_likelihood(rows)), 4)
    for sweep in range(sweeps):
        walk_pays = rates[1] > rates[0]
        walking = sweep > 0 and (walk_pays if sweep % 4 < 3 else not walk_pays)
        moves = zip(walks if walking else fits, halves, strict=True)
        proposals = [move.get_proposal(theta[half], [], random) for move, half in moves]
        proposed, factors = map(np.concatenate, zip(*proposals, strict=True))
        new = evaluate(proposed)
        target = _tempered(new, power)
        if not walking:
            pairs = zip(fits, halves, strict=True)
            log_q = [fit.log_density(proposed[half]) for fit, half in pairs]
            log_weights.append(target - np.concatenate(log_q))
        threshold = _tempered(rows, power) - factors
        threshold -= random.standard_exponential(n)
        accepting = target > threshold
        theta = np.where(accepting[:, None], proposed, theta)
        rows = np.where(accepting[:, None], new, rows)
        accepted.append(float(accepting.mean()))
        rates[walking] = accepted[-1] * (worth if walking else 1.0)
        renewed[accepting] += worth if walking else 1.0
        if walking:
            for walk in walks:
                walk.scale *= np.exp(accepted[-1] - WALK_ACCEPTANCE)
        if min(np.minimum(renewed[group], 1).mean() for group in groups) > RENEWED:
            break
    return _Renewed(theta, rows, accepted, np.concatenate(log_weights))
