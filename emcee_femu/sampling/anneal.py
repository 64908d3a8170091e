"""TMCMC for its users: a population of the posterior and the evidence, in one call."""

from dataclasses import replace
from os import PathLike
from typing import Any

import numpy as np

from .. import checks
from ..posterior.log_posterior import LogPosterior
from .annealing import Annealed, anneal_population
from .arguments import check_file
from .evaluation import Evaluation
from .journal import Journal
from .manifest import describe
from .pools.own_processes import open_pool
from .renewing import fewest_members
from .run_file.log import check_new


def anneal(
    posterior: LogPosterior,
    size: int = 1_000,
    *,
    seed: int,
    workers: int | None = None,
    pool: Any = None,
    on_failure: str = "raise",
    max_failures: float = 0.1,
    backend: str | PathLike[str] | None = None,
    resume: bool = False,
    probe_tolerance: float = 1e-6,
) -> Annealed:
    r"""Carry a population from the prior to the posterior: TMCMC.

    .. math:: p_j(\theta) \propto p(\theta) L(\theta)^{\beta_j}, \quad 0 = \beta_0 <
        \dots < \beta_m = 1

    Each power is chosen so that the weights :math:`L^{\beta_{j+1} - \beta_j}` have a
    coefficient of variation of 1. Members are drawn by their weights, then moved by
    proposals from Student-t mixtures and by random walks until four fifths of them
    are renewed, at most 20 times. Two halves of the population fit the proposals for
    each other. All members are evaluated at once, so as many workers as members are of
    use. The evidence is a product of ratios, each bridged from the members at two
    neighbouring powers; its error counts the descendants of one draw of the prior as
    one.

    It gives a population of equal weights, not a chain: R-hat and autocorrelation times
    have no meaning for it. :func:`to_inference_data` takes it, for tables and figures.
    A narrow mode of which no early member came near is not found; a larger size sees
    smaller ones. No error of the evidence is claimed, with the reason in ``problems``,
    where proposals fitted to the population at its last two powers have weights of a
    heavy tail (Pareto k above 0.7): they come upon something that it lacks, such as the
    neck of a funnel. A mode far from all members stays unseen.

    Args:
        posterior: What to sample.
        size: Members, at least 20 per parameter.
        seed: A whole number; the same seed gives the same population, to the bit.
        workers: Number of processes to start, as in :func:`run`.
        pool: Where to evaluate instead, as in :func:`run`.
        on_failure: What a failed solve does, as in :func:`run`; with "reject" its
            likelihood is zero.
        max_failures: Fraction of failed solves above which "reject" stops.
        backend: Name of a file that keeps all evaluations, such as "run.annealing";
            None for none.
        resume: Whether to go on with that file, if it is there; the population is that
            of an annealing that was never stopped, to the bit. A finished one costs
            the 16 solves that tell a changed model.
        probe_tolerance: Relative difference above which those count as another.

    Returns:
        The population, its evidence and how it got there; ``print`` it.

    Raises:
        TypeError: If posterior is not a LogPosterior, or a count not a whole number.
        ValueError: If size is too small, too few draws of the prior have a finite
            likelihood, or a file is there already or of another annealing.
        RuntimeError: If too many solves failed.

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
    if not isinstance(posterior, LogPosterior):
        raise TypeError(
            f"posterior: expected a LogPosterior, got {type(posterior).__name__}"
        )
    fewest = fewest_members(posterior.ndim)
    size = checks.whole_number("size", size, 1)
    if size < fewest:
        raise ValueError(
            f"size: expected at least {fewest}, 20 for each of {posterior.ndim} "
            f"parameters, got {size}"
        )
    seed = checks.whole_number("seed", seed)
    path = check_file(backend, checks.flag("resume", resume))
    if path is not None and not resume:
        check_new(path)
    tolerance = checks.real_number("probe_tolerance", probe_tolerance, 0)
    with open_pool(pool, workers, posterior.one_by_one) as evaluators:
        evaluation = Evaluation.of(posterior, evaluators, on_failure, max_failures)
        manifest = describe(posterior, moves="anneal", size=size, seed=seed)
        journal = Journal(evaluation, path, {"manifest": manifest})
        journal.probe(tolerance)
        rng = np.random.default_rng(seed)
        found = anneal_population(journal, posterior.prior, rng, size)
    log = evaluation.failures
    return replace(found, failed_solves=0 if log is None else log.causes.total())
