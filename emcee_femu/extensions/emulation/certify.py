"""Check an emulated posterior against full solves at its own draws.

Weights at the draws cannot see what the emulator excludes. Three things can: bounds
narrower than the prior's, draws that press against such a bound, and climbs of the true
posterior from draws of the prior.
"""

from collections import Counter
from dataclasses import replace
from os import PathLike
from typing import Any

import numpy as np
from scipy.special import logsumexp, softmax

from ... import checks
from ...contracts import Floats
from ...evaluation.evaluator import Evaluation
from ...evaluation.progress import check_progress, progress_bar
from ...evaluation.resume import open_evaluator
from ...posterior.log_posterior import LogPosterior
from ...results.arviz_objects import (
    InferenceData,
    dataset,
    groups,
    samples,
    wrap,
)
from ...results.diagnose import diagnose
from ...results.evidence import log_evidence
from ...results.fit import SOLVED_AGAIN, needs_solves
from ...results.to_arviz import check_sampled, read_samples
from ...search.climbing import Maximum, climb
from ...search.importance import GOOD_K, kish_share, smooth_tail
from ...verdict.burn_in import FEWEST_STEPS
from ...verdict.diagnosis import NOT_CONVERGED, NOT_SEARCHED, SEARCHED, Statement
from ...verdict.verdict import TOO_SHORT
from .certificate import EQUAL_WEIGHTS, GROUP, SURE, Certificate
from .draws import WIDER_POWER, draw_wider
from .emulated import SETTLED, EmulatedModel
from .emulated_chain import (
    EmulatedChain,
    compare_bounds,
    correct_moments,
    find_missed,
)

FEWEST_SOLVES = 10
BRIDGED = 1_000  # draws of the chain that are compared with those of a wider law
JUDGED_SHARE = 10  # of the solves, at least, for each that judges the fit
# Solves for the search: at most a quarter, and no more than these.
SEARCH_SHARE, MOST_SEARCH_SOLVES = 4, 30
FIRST_CLIMBS = 8  # starts that are sorted by height
FEWEST_CLIMB_STEPS = 3  # steps; shorter climbs are not counted
UNKNOWN = (
    "If emulate made this posterior, its samples do not say whether its errors were "
    "within the tolerance; those of a run on the posterior that it returned do."
)
ONLY_CHAIN = (
    "All draws are of the chain, since its samples do not hold the emulated posterior "
    "itself; give certify the run, and a quarter is of a wider emulated posterior."
)
MOMENTS = "mean", "mean_error", "sd", "sd_error", "off_error"  # in their order


def certify(
    idata: object,
    posterior: LogPosterior,
    solves: int = 100,
    *,
    seed: int,
    workers: int | None = None,
    pool: object = None,
    on_failure: str = "reject",
    max_failures: float = 0.2,
    backend: str | PathLike[str] | None = None,
    resume: bool = False,
    progress: bool | str | None = None,
    probe_tolerance: float = 1e-6,
) -> Certificate:
    r"""Check an emulated posterior with full solves at some of its own draws.

    Use it after :func:`emulate` and :func:`run`, or with any other approximate model.
    Draws are taken from the chain at equal intervals, without repeats, and solved
    with the full model. If the run itself is given, a quarter of the draws are of a
    wider emulated posterior, :math:`p \tilde L^{1/4}`, where a region that the emulator
    underrates has a larger share. Importance weights then correct the emulated
    posterior:

    .. math:: w_i = \frac{p(\theta_i) L(\theta_i)}{q(\theta_i)}, \qquad
        \hat f = \sum_i w_i f(\theta_i) \Big/ \sum_i w_i

    where :math:`p L` is the true posterior and q the law of all draws together.
    Corrected means and standard deviations are those of the whole chain, plus the
    change that the weights make at the solved draws. The verdict is one of

    - *certified*: the efficiency (effective share) of the weights is at least 0.9, as
      it would be at draws of the emulated posterior alone, and means and standard
      deviations are right to a tenth of a standard deviation; for the latter, two
      standard errors of the difference are included;
    - *corrected*: the emulated posterior is not good enough, but the weights correct
      it;
    - *refused*: the weights are unreliable, part of the posterior is missing, the
      chain has not converged, or :func:`emulate` spent its solves before its errors
      were within its tolerance (``settled``). Unequal weights are unreliable if their
      Pareto k is above 0.7 or above ``1 - 1 / log10(n)`` for n draws, or if they are
      worth fewer than 50 independent draws.

    Weights with an efficiency above 0.9 are trusted whatever k is, because fewer than
    100 nearly equal weights do not determine k well. Unequal weights with k up to 0.7
    are smoothed (PSIS).

    Weights cannot reveal what the emulated posterior excludes. An emulator that did
    not settle may exclude what no draw shows, so its posterior is refused however equal
    the weights are. A run on the emulated posterior knows whether it settled, and so
    does its ArviZ object, also if read back from netCDF; a finding says where it is not
    known. Besides the wider draws, three checks look for what is excluded. The
    emulator's bounds must contain at least 99 % of the prior. The draws must not pile
    up at a bound that the prior does not have. And climbs of the true posterior, which
    take a quarter of the solves and at most 30, start from draws of the prior away from
    the chain. A narrow mode that neither a climb nor a wider draw comes near remains
    undetected.

    Weights cannot recover regions that the chain never visited either. A chain that
    :func:`diagnose` calls "not converged" is therefore refused, unless its only fault
    is that it is too short: the standard errors then allow for this, and a finding
    says so. Failed climbs are also listed in ``findings``.

    Args:
        idata: The run on the emulated posterior, or its :func:`to_inference_data`
            without burn-in, which has no draws of the wider posterior.
        posterior: The true posterior, with the same parameters.
        solves: Number of full solves to spend on draws and climbs, at least 10.
        seed: A whole number; the same seed gives the same certificate.
        workers: Number of worker processes, as in :func:`run`.
        pool: A pool to solve in, instead of workers; see :func:`run`.
        on_failure: "reject" to log a draw whose solve fails and to leave it out, or,
            if such draws lie elsewhere than the others by two standard errors of a
            parameter's mean or variance, to give it the weight zero; "raise" to stop
            and name its parameters. A failed solve of a climb shortens a step or ends
            the climb.
        max_failures: Fraction of failed solves above which the verdict is *refused*.
        backend: File in which each solve is stored as soon as it is done, such as
            "beam.chain".
        resume: Whether to continue from the file if it exists. Stored solves are not
            repeated.
        progress: Whether to show solves and the remaining time, as in :func:`run`.
        probe_tolerance: Relative difference between a stored and a repeated solve above
            which the model is considered changed.

    Returns:
        The certificate: verdict, corrected moments, weights, and an ArviZ object for
        further work. ``print`` it.

    Raises:
        TypeError: If posterior is not a LogPosterior, or a count is not a whole number.
        ValueError: If idata is incomplete or has other parameters, solves is below 10,
            or the file belongs to another calculation. These are raised before the
            first solve.
        ImportError: If progress is "notebook" and ipywidgets is not installed.

    Source: Vehtari, Simpson, Gelman, Yao and Gabry (2024), "Pareto smoothed importance
    sampling", JMLR 25(72); Kish (1965), Survey Sampling (efficiency); Owen (2013),
    Monte Carlo theory, methods and examples, chapter 8 (the difference estimator).

    Examples:
        >>> import emcee_femu as ef
        >>> term = ef.FrequencyTerm([3.0], relative_sd=0.01)
        >>> prior = ef.GaussianPrior(["k"], [8.0], [2.0], [(1.0, 20.0)])
        >>> true = ef.LogPosterior(
        ...     ef.FunctionModel(lambda p: [p["k"] ** 0.5], n_modes=1), term, prior
        ... )
        >>> near = ef.FunctionModel(lambda p: [3 + (p["k"] - 9) / 6], n_modes=1)
        >>> emulated = ef.LogPosterior(near, term, prior)
        >>> sampler = ef.run(emulated, ef.DEMCMove(), 20, 400, ensembles=1, seed=1)
        >>> idata = ef.to_inference_data(sampler, emulated, discard=100)
        >>> certificate = ef.certify(idata, true, 60, seed=2)
        >>> certificate.short, certificate.solves <= 60
        ('certified', True)
    """
    idata, approximate = read_samples(idata, judged=True)
    if GROUP in (held := groups(idata)):  # an earlier one, which is judged anew
        idata = wrap({name: held[name] for name in held if name != GROUP})
    check_sampled(posterior, samples(idata)[0])
    solves = checks.whole_number("solves", solves, FEWEST_SOLVES)
    seed = checks.whole_number("seed", seed)
    display = check_progress(progress)
    rng = np.random.default_rng(seed)
    chain = EmulatedChain(idata, posterior.prior, rng)
    asked = {"moves": "certify", "solves": solves, "seed": seed}
    asked["emulated draws"] = chain.draws
    asked["wider draws"] = approximate is not None
    judged = judge_chain(idata)  # before a solve is spent, for it may raise
    how = workers, pool, on_failure, max_failures, backend, resume, probe_tolerance
    again = min(SOLVED_AGAIN, solves // JUDGED_SHARE) * needs_solves(posterior)
    settled = _has_settled(idata, approximate)
    known = settled is not None or approximate is not None
    with (
        open_evaluator(posterior, asked, *how) as evaluator,
        progress_bar(display, solves, "certify") as evaluator.bar,
    ):
        if evaluator.failures is not None:
            evaluator.failures.max_failures = 1.0  # judged below, no reason to stop
        certificate, rows, emulated = judge_draws(
            chain,
            judged,
            evaluator,
            approximate,
            solves,
            again,
            settled,
            max_failures,
            rng,
        )
    if not known:
        certificate = replace(certificate, notes=(*certificate.notes, UNKNOWN))
    return certificate.sealed(posterior, rows, emulated, again, again)


def judge_draws(
    chain: EmulatedChain,
    judged: tuple[list[str], list[str]],
    evaluator: Evaluation,
    approximate: LogPosterior | None,
    solves: int,
    again: int,
    settled: bool | None,
    max_failures: float,
    rng: np.random.Generator,
) -> tuple[Certificate, Floats, Floats]:
    """Return a certificate, not sealed yet, with the rows of the draws that it solved.

    Rows of the true posterior ``(n, columns)`` and the emulated log-posterior ``(n,)``.

    Args:
        chain: The chain of the emulated posterior.
        judged: What :func:`judge_chain` said of it.
        evaluator: Of the true posterior, by which nothing was solved yet.
        approximate: The emulated posterior; None if only its chain is known.
        solves: How many full solves there are for draws and climbs.
        again: How many of these are left for the judgement of the fit.
        settled: Whether the emulator settled; None if that is not known.
        max_failures: Fraction of draws that may fail.
        rng: Chooses draws and starts of climbs.
    """
    unsound, warned = judged
    faults = [*compare_bounds(chain, evaluator.posterior.prior), *unsound]
    most = min(solves // SEARCH_SHARE, MOST_SEARCH_SOLVES)
    maxima, unfinished = _look_elsewhere(chain, evaluator, most, rng)
    climbed = evaluator.failed
    left = solves - evaluator.solves - again
    theta, emulated, log_shares, narrow = _choose_draws(chain, approximate, left, rng)
    rows = np.array([row for _, row in sorted(evaluator.each(theta))])
    n, log_posterior, failed = len(theta), rows[:, 0], evaluator.failed - climbed
    lost = log_posterior == -np.inf
    by_chance = 0 < failed < n and not _lie_apart(theta, lost)
    known = ~lost if by_chance else np.full(n, True)
    ratios = log_posterior - emulated
    counted = log_shares + ratios
    log_ratio, possible = float(logsumexp(counted)), bool(counted.max() > -np.inf)
    worth = n * kish_share(counted)
    # That of draws of the emulated posterior alone.
    efficiency = kish_share(ratios[known], log_shares[known])
    smoothed, pareto_k = smooth_tail(counted)
    if efficiency < EQUAL_WEIGHTS and pareto_k <= GOOD_K:
        counted = smoothed
    weights, moments = np.zeros(n), np.full((len(MOMENTS), len(chain.names)), np.nan)
    if possible:
        weights = softmax(counted)
        shares = softmax(log_shares[known])
        moments = correct_moments(chain, theta[known], shares, weights[known])
    if failed > max_failures * n:
        faults.append(f"{failed} of {n} draws could not be solved")
    notes = _note(chain, n, len(maxima), unfinished, evaluator.failed, by_chance)
    named: dict[str, Any] = dict(zip(MOMENTS, moments, strict=True))
    certificate = Certificate(
        names=chain.names,
        solves=evaluator.solves,
        failed_solves=evaluator.failed,
        efficiency=efficiency,
        effective=worth / chain.excess(n),
        settled=settled,
        pareto_k=pareto_k,
        largest=float(n * weights.max()) if possible else np.inf,
        log_ratio=log_ratio,
        **named,
        emulated_mean=chain.draws.mean(axis=0),
        emulated_sd=chain.draws.std(axis=0, ddof=1),
        theta=theta,
        weights=n * weights,
        log_posterior=log_posterior,
        search=_judge_climbs(maxima, unfinished),
        faults=tuple(faults),
        missed=find_missed(chain, maxima, theta, log_posterior, weights),
        notes=(*warned, *narrow, *notes),
        emulated_evidence=log_evidence(chain.idata) if chain.searched else None,
        idata=chain.idata,
        posterior=evaluator.posterior,
    )
    return certificate, rows, emulated


def _lie_apart(theta: Floats, lost: Floats) -> bool:
    """Return whether draws that failed lie elsewhere than the others, by some moment.

    By chance the mean of a few values, and of their squares, is that of all draws.
    """
    sigmas = (theta - theta.mean(axis=0)) / theta.std(axis=0)
    squares = sigmas**2 - 1
    moments = np.hstack([sigmas, squares / squares.std(axis=0)])
    chance = np.sqrt(1 / max(lost.sum(), 1) - 1 / len(lost))
    return bool((np.abs(moments[lost].mean(axis=0)) > SURE * chance).any())


def _choose_draws(
    chain: EmulatedChain,
    approximate: LogPosterior | None,
    n: int,
    rng: np.random.Generator,
) -> tuple[Floats, Floats, Floats, list[str]]:
    """Return draws to be solved, three quarters of the chain, the rest of a wider law.

    A region that the emulated posterior holds for less likely than it is has more of
    these. The shares are such as draws of both laws together have as draws of the
    emulated posterior.

    Returns:
        At most ``n`` different draws, their emulated log-posterior, the logarithms of
        their shares, whose sum is one, and a sentence if none are of the wider law.
    """
    some = slice(None, None, -(-len(chain.draws) // BRIDGED))
    wide, low, narrow = np.empty((0, len(chain.names))), np.empty(0), list[str]()
    if approximate is None:
        narrow = [ONLY_CHAIN]
    else:
        prior = approximate.prior
        at = chain.log_posterior[some] - prior.logpdf(chain.draws[some])
        try:
            number = n // SEARCH_SHARE
            wide, low, log_ratio = draw_wider(approximate, at, number, rng)
        except (ValueError, RuntimeError) as error:
            narrow = [f"No wider emulated posterior could be drawn from: {error}."]
    places, counts = chain.choose(n - len(wide), rng)
    theta = np.vstack([chain.draws[places], wide])
    emulated = np.append(chain.log_posterior[places], low)
    log_shares = np.log(np.append(counts, np.ones(len(wide))))
    if len(wide):
        raised = log_ratio - (1 - WIDER_POWER) * (emulated - prior.logpdf(theta))
        log_shares -= np.logaddexp(0.0, raised + np.log(len(wide) / counts.sum()))
    return theta, emulated, log_shares - logsumexp(log_shares), narrow


def _has_settled(idata: InferenceData, approximate: LogPosterior | None) -> bool | None:
    """Return whether all emulators ended within tolerance; None if none is known."""
    if (noted := dataset(idata, "posterior").attrs.get(SETTLED)) is not None:
        return bool(noted)
    experiments = approximate.experiments if approximate else ()
    models = [getattr(e.paired, "model", e.model) for e in experiments]
    emulators = [model for model in models if isinstance(model, EmulatedModel)]
    return all(model.settled for model in emulators) if emulators else None


def _look_elsewhere(
    chain: EmulatedChain, evaluator: Evaluation, most: int, rng: np.random.Generator
) -> tuple[list[Maximum], list[str]]:
    """Return where climbs end that start from prior draws away from the chain.

    Climbing stops when its share of the solves is spent; there is no climb if that
    share is too small for a few steps. Also return, in one sentence each, why other
    climbs failed.
    """
    maxima, lost = list[Maximum](), list[str]()
    starts = evaluator.posterior.prior.sample(rng, 20 * most)
    away = chain.distance(starts)
    starts, away = starts[away > 1], away[away > 1]
    # The first climb begins where the draws are farthest of a few starts, since near
    # ones lead to the maximum that is known.
    order = np.argsort(-away[:FIRST_CLIMBS])
    starts = np.concatenate([starts[:FIRST_CLIMBS][order], starts[FIRST_CLIMBS:]])
    price = 1 if evaluator.posterior.differentiable else evaluator.posterior.ndim + 1
    for start in chain.coordinates.coordinates(starts)[:, None]:
        left = most - evaluator.solves
        if left < FEWEST_CLIMB_STEPS * price:
            break
        try:
            maxima += climb(evaluator, start, None, left, chain.coordinates)
        except Exception as error:  # of any kind: it costs no certificate
            lost.append(f"it raised {error!r}, and no other was made")
            break
    lost += [end.message for end in maxima if end.log_evidence == -np.inf]
    return [end for end in maxima if end.log_evidence > -np.inf], lost


def judge_chain(idata: InferenceData) -> tuple[list[str], list[str]]:
    """Return why the emulated posterior's chain cannot be trusted, or a finding."""
    group = dataset(idata, "posterior")
    judged = "ensemble" in group.coords and group.attrs.get("kind") != "population"
    if not judged or group.sizes["draw"] < FEWEST_STEPS:
        return [], []
    if (about := diagnose(idata).chains).status != NOT_CONVERGED:
        return [], []
    doubt = (
        f"the chain of the emulated posterior is {about.sentence.rstrip('.')}; "
        "no certificate is better than what its chain has visited"
    )
    # Its length alone is in the errors.
    short = {*about.reasons} == {TOO_SHORT}
    return ([], [f"T{doubt[1:]}."]) if short else ([doubt], [])


def _note(
    chain: EmulatedChain,
    n: int,
    arrived: int,
    lost: list[str],
    failed: int,
    by_chance: bool,
) -> list[str]:
    """Return further remarks on ``n`` solved draws, in sentences."""
    sentences = []
    if by_chance:
        sentences.append(
            f"{failed} solves failed. The draws among them lie like the others, so "
            "they are taken to have failed by chance and were left out; in the "
            "evidence they count as zero."
        )
    elif failed:
        sentences.append(
            f"{failed} solves failed; the posterior counts as zero there, which "
            "the emulator does not know: cut the prior to where the model can be "
            "solved, and emulate again."
        )
    if chain.size < 2 * n:
        sentences.append(
            f"The emulated chain is worth {chain.size:.0f} independent draws only, for "
            f"{n} solves: run it longer; the errors allow for it."
        )
    sentences += [
        f"{count} of {arrived + len(lost)} climbs failed: {reason}."
        for reason, count in Counter(lost).items()
    ]
    return sentences


def _judge_climbs(maxima: list[Maximum], lost: list[str]) -> Statement:
    """Say whether climbs looked elsewhere."""
    ends, climbs = sum(m.converged for m in maxima), len(maxima) + len(lost)
    if climbs:
        sentence = (
            f"{ends} of {climbs} climbs from other places ended at a maximum; a region "
            "that no climb or draw reached may still be missing."
        )
        return Statement(SEARCHED, SEARCHED, sentence)
    sentence = (
        "There were too few solves to climb from other places: a part of the posterior "
        "far from all draws may be missing; find_map can look for one."
    )
    return Statement(NOT_SEARCHED, NOT_SEARCHED, sentence)
