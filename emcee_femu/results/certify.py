"""Hold an emulated posterior to full solves at its own draws."""

from dataclasses import replace
from os import PathLike
from typing import Any

import numpy as np

from .. import checks
from ..interfaces import Floats
from ..posterior.log_posterior import LogPosterior
from ..sampling.arguments import check_file
from ..sampling.evaluation import Evaluation
from ..sampling.importance import GOOD_K, kish_share, smooth_tail
from ..sampling.journal import Journal
from ..sampling.manifest import describe
from ..sampling.pools.own_processes import open_pool
from .arviz_objects import dataset, samples
from .certificate import EQUAL, Certificate, judge
from .certified_idata import with_certificate
from .corrected_moments import Moments, correct_moments, curvature_k, spread_factor
from .diagnostics import FEWEST_STEPS, diagnose
from .frequencies import check_sampled
from .outside import MOST, SHARE, Search, compare_bounds, find_missed, look_elsewhere
from .solved_draws import ChosenDraws, EmulatedChain, choose_draws, read_chain

FEWEST_SOLVES = 10
APART = 1.1  # R-hat of walkers or ensembles that are in different places


def certify(
    idata: Any,
    posterior: LogPosterior,
    solves: int = 100,
    *,
    seed: int,
    workers: int | None = None,
    pool: Any = None,
    on_failure: str = "raise",
    max_failures: float = 0.1,
    backend: str | PathLike[str] | None = None,
    probe_tolerance: float = 1e-6,
) -> Certificate:
    r"""Hold the posterior of an emulator to full solves at independent draws of it.

    .. math:: w_i = \frac{p(\theta_i) L(\theta_i)}{\tilde p(\theta_i)}, \qquad
        \hat f = \sum_i w_i f(\theta_i) \Big/ \sum_i w_i

    with the true posterior over the emulated one, :math:`\tilde p`, which idata holds.
    Draws are taken from the chain at equal distances, none twice. The effective share
    of the weights and their Pareto k tell how good the emulated posterior is; corrected
    means and standard deviations use the whole chain beside the weights. The verdict is

    - *certified*: efficiency at least .9, and means and standard deviations within a
      tenth of a standard deviation;
    - *corrected*: the weights repair what is wrong;
    - *refused*: k above .7, unequal weights worth fewer than 50 independent draws, a
      tail too heavy for so few weights (k above ``1 - 1 / log10(n)``), or something
      missing.

    Weights that are nearly equal (efficiency above .9) are believed whatever their k,
    which fewer than 100 of them do not tell well. Where k is at most .7 unequal weights
    are smoothed (PSIS).

    Weights at draws of the emulated posterior cannot see what it excludes. So bounds
    that leave out more than 1 % of the prior are refused, and draws that press against
    a bound which the prior does not have; and a quarter of the solves, at most 30, are
    spent on climbs of the true posterior from draws of the prior that lie away from the
    chain, where these are enough for three steps. What neither comes upon stays unseen:
    a narrow mode of which no climb came near. Nor do weights bring back
    what the chain did not visit: a chain in several parts is refused, and what
    else :func:`diagnose` says against it is in the findings.

    Args:
        idata: What :func:`to_inference_data` made of a run on the emulated posterior,
            without burn-in.
        posterior: The true posterior, of the same parameters.
        solves: Full solves to spend, all included; at least 10.
        seed: A whole number; the same seed gives the same certificate.
        workers: Number of processes to start, as in :func:`run`.
        pool: Where to evaluate instead, as in :func:`run`.
        on_failure: What a failed solve does, as in :func:`run`; with "reject" the draw
            has no weight.
        max_failures: Fraction of failed solves above which "reject" stops.
        backend: Name of a file that keeps every solve as it arrives, such as
            "beam.certificate"; None for none. If it is there, the solves in it are not
            repeated.
        probe_tolerance: Relative difference at solves of the file above which the model
            counts as another.

    Returns:
        The verdict, what it rests on, and an ArviZ object to go on with; ``print`` it.

    Raises:
        TypeError: If posterior is not a LogPosterior, or a number not a whole one.
        ValueError: If idata lacks what is needed or is of other parameters, solves is
            below 10, or the file is of something else.
        RuntimeError: If too many solves failed.

    Source: Vehtari, Simpson, Gelman, Yao and Gabry (2024), "Pareto smoothed importance
    sampling", JMLR 25(72); Kish (1965), Survey Sampling (efficiency).

    Examples:
        >>> import emcee_femu as ef
        >>> term = ef.FrequencyTerm([3.0], relative_sd=0.01)
        >>> prior = ef.GaussianPrior(["k"], [8.0], [2.0], [(1.0, 20.0)])
        >>> true = ef.LogPosterior(
        ...     ef.FunctionModel(lambda p: [p["k"] ** 0.5], n_modes=1), term, prior
        ... )
        >>> near = ef.FunctionModel(lambda p: [3 + (p["k"] - 9) / 6], n_modes=1)
        >>> emulated = ef.LogPosterior(near, term, prior)
        >>> sampler = ef.run(emulated, nwalkers=20, nsteps=400, seed=1)
        >>> idata = ef.to_inference_data(sampler, emulated, discard=100)
        >>> certificate = ef.certify(idata, true, 60, seed=2)
        >>> certificate.short, certificate.solves <= 60
        ('certified', True)
    """
    check_sampled(posterior, samples(idata)[0])
    solves = checks.whole_number("solves", solves, FEWEST_SOLVES)
    seed = checks.whole_number("seed", seed)
    path = check_file(backend, False)
    tolerance = checks.real_number("probe_tolerance", probe_tolerance, 0)
    rng = np.random.default_rng(seed)
    chain = read_chain(idata, rng)
    with open_pool(pool, workers, posterior.one_by_one) as evaluators:
        evaluation = Evaluation.of(posterior, evaluators, on_failure, max_failures)
        settings = {"moves": "certify", "solves": solves, "seed": seed}
        manifest = describe(posterior, **settings, emulated_draws=chain.draws)
        journal = Journal(evaluation, path, {"manifest": manifest})
        journal.probe(tolerance)
        search = look_elsewhere(chain, journal, min(solves // SHARE, MOST), rng)
        chosen = choose_draws(chain, solves - search.solves, rng)
        if evaluators is None and not posterior.one_by_one:
            rows = journal.rows(chosen.theta)  # a batch takes little longer than one
        else:
            solved = dict(journal.each(chosen.theta))
            rows = np.array([solved[i] for i in range(len(chosen.theta))])
    log = evaluation.failures
    found = _weigh(
        chain, chosen, rows, journal.solves, 0 if log is None else log.causes.total()
    )
    bounds = compare_bounds(chain, posterior.prior, rng)
    shares = found.weights / len(found.weights)
    missed = find_missed(chain, search, found.log_posterior, shares)
    unsound, said = _judge_chain(idata)
    short, verdict, also = judge(found, [*bounds, *unsound], missed)
    findings = (*also, *_find(chain, found, search), *said)
    found = replace(found, short=short, verdict=verdict, findings=findings)
    made = with_certificate(idata, posterior, found, rows, chosen.log_posterior)
    return replace(found, idata=made)


def _weigh(
    chain: EmulatedChain, chosen: ChosenDraws, rows: Floats, solves: int, failed: int
) -> Certificate:
    """Return a certificate without a verdict."""
    n, d = chosen.theta.shape
    mean, sd = chain.draws.mean(axis=0), chain.draws.std(axis=0, ddof=1)
    log_weights = rows[:, 0] - chosen.log_posterior
    counted = log_weights + np.log(chosen.counts)
    efficiency = kish_share(counted)
    smoothed, k = smooth_tail(counted)
    if efficiency < EQUAL and k <= GOOD_K:
        counted = smoothed
    top = counted.max()
    weights, moments = np.zeros(n), Moments(*np.full((4, d), np.nan))
    if top > -np.inf:
        weights = np.exp(counted - top)
        weights /= weights.sum()
        plain = chosen.counts / chosen.counts.sum()
        moments = correct_moments(chain, chosen.theta, plain, weights)
    return Certificate(
        names=chain.names,
        short="",
        verdict="",
        solves=solves,
        failed_solves=failed,
        efficiency=efficiency,
        effective=n * efficiency / spread_factor(chain.size, n),
        pareto_k=k,
        curvature_k=curvature_k(chain, chosen.theta, log_weights),
        largest=float(n * weights.max()) if top > -np.inf else np.inf,
        **moments._asdict(),
        emulated_mean=mean,
        emulated_sd=sd,
        theta=chosen.theta,
        weights=n * weights,
        log_posterior=rows[:, 0],
    )


def _judge_chain(idata: Any) -> tuple[list[str], list[str]]:
    """Return what forbids to trust the emulated posterior's chain, and a finding."""
    group = dataset(idata, "posterior")
    known = "ensemble" in group.coords and not group.attrs.get("population")
    if not known or group.sizes["draw"] < FEWEST_STEPS:
        return [], []
    found = diagnose(idata)
    if not found.verdict.startswith("Not converged"):
        return [], []
    apart = np.nan_to_num([found.rhat_within.max(), found.rhat_between.max()])
    if found.stuck or apart.max() > APART:
        return [
            "the chain of the emulated posterior is in several parts, which no weight "
            "brings together; run it longer, without its burn-in, until diagnose finds "
            "no walkers or ensembles apart"
        ], []
    return [], [
        f"The chain of the emulated posterior itself: {found.verdict} What it has not "
        "visited, no weight brings back."
    ]


def _find(chain: EmulatedChain, found: Certificate, search: Search) -> tuple[str, ...]:
    """Return what else to know, in sentences."""
    n = len(found.theta)
    sentences = []
    if found.failed_solves:
        sentences.append(
            f"{found.failed_solves} of {found.solves} solves failed; the posterior is "
            "taken for zero there, of which the emulator knows nothing: cut the prior "
            "to where the model can be solved, and emulate again."
        )
    if chain.size < 2 * n:
        sentences.append(
            f"The emulated chain is worth {chain.size:.0f} independent draws only, for "
            f"{n} solves: run it longer; the errors allow for it."
        )
    if search.solves:
        ends = len(search.maxima)
        sentences.append(
            f"{search.solves} solves went into climbs from elsewhere, of which {ends} "
            "came to an end; what neither they nor the draws came upon stays unseen."
        )
    else:
        sentences.append(
            "No climb from elsewhere was made, for which the solves were too few: a "
            "part of the posterior far from all draws would not be seen; find_map "
            "looks for one."
        )
    return tuple(sentences)
