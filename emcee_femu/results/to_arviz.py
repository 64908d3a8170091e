"""ArviZ objects of runs and other chains; all tables read samples through it."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from .. import checks
from ..contracts import LOG_POSTERIOR, Floats, read_declared
from ..likelihoods.residuals import FitRecord
from ..posterior.log_posterior import LogPosterior
from ..search.record import Chains
from .arviz_objects import (
    Groups,
    InferenceData,
    groups,
    is_arviz,
    samples,
    samples_of,
    wrap,
)
from .chains import read_chains
from .fit import SOLVED_AGAIN, judge_data, write_records
from .groups import PRIOR_STORED, convert, fixed_groups, make_dataset, read_rows
from .measured import gather_measurements

FIT = "fit"  # attribute of the posterior group
# Samples whose log-posterior is lower than the best one's by more than d plus this have
# not arrived: for a Gaussian it is lower by d / 2 on average, and by more than d plus
# this once in a thousand times.
LOST = 5.0


def to_inference_data(
    source: object,
    posterior: LogPosterior | None = None,
    discard: int | None = None,
    thin: int = 1,
    names: Sequence[str] | None = None,
    term: str | None = None,
    prior_predictive: int = 0,
) -> InferenceData:
    """Convert a run to an ArviZ object, with every walker as a chain.

    Use it to drop the burn-in, to work with ArviZ, or to save a run as netCDF. Tables,
    figures and :func:`identifiability` also accept a run and convert it themselves.
    What the samples say of the data is stored too, for the statement on the fit, with
    as many solves as :func:`diagnose` takes for it.

    ============================ ====================================================
    group                        contents
    ============================ ====================================================
    ``posterior``                the parameters by name, with ``attrs["units"]`` if
                                 known; ``attrs["sampled"]`` of the group lists them, so
                                 that you can add derived quantities; ``attrs`` also has
                                 the posterior's ``notes``
    ``sample_stats``             lp, log_prior
    ``log_prior``                of each parameter, if the prior has ``logpdfs``
    ``log_likelihood``           of each datum if its term factorises, otherwise of the
                                 whole term; by the term's name or, with several terms,
                                 side by side as ``data``
    ``response``                 the model's stored variables, without measurement
                                 noise
    ``new_measurement``          a new measurement for each sample, noise included, if
                                 a term can draw one
    ``posterior_predictive``     500 draws of these, for ``arviz.plot_ppc``
    ``prior``                    1,000 draws of the prior
    ``prior_predictive``         a new measurement for each of the first
                                 ``prior_predictive`` of these
    ``observed_data``            the measurements, by the name of the variable; a
                                 second measurement as ``frequency[term]``
    ``constant_data``            lower and upper bounds; prior_mean and prior_sd inside
                                 them; ``initial``, a Gaussian prior's own mean, or else
                                 the prior mean; ``initial_<variable>``, the response
                                 there (one solve, unless the run stored it), NaN if it
                                 cannot be solved; is_error, whether only terms read the
                                 parameter (noise, discrepancy); ``min_mac``, if the
                                 model pairs modes
    ============================ ====================================================

    Walkers of one ensemble are not independent chains; the coordinate ``ensemble``
    shows which belong together. Draws count from 0; the coordinate ``step`` is the
    stored step. For tempered runs only the cold walkers are converted. At its peak the
    conversion needs about four times the memory of the chains and blobs that are kept.
    If the posterior is unknown, as for any other log-probability function, the groups
    are ``posterior``, ``sample_stats`` and, if the function returned blobs, ``blobs``:
    named as in a structured ``blobs_dtype``, otherwise ``blob``, or ``blob0``,
    ``blob1``, ... if they differ in shape.

    Args:
        source: The result of :func:`run`, any EnsembleSampler, a backend, or the name
            of a run's file; or the result of :func:`anneal`, whose members become one
            chain. An ArviZ object, also one that a result holds, is returned as it is.
            A LogPosterior has no samples yet, and gives the groups ``prior``,
            ``prior_predictive``, ``observed_data`` and ``constant_data``.
        posterior: The sampled posterior, if the source does not hold it.
        discard: Number of stored steps to drop as burn-in. None for those that a run
            by given moves found itself (``run.burn_in``), and for none of other
            sources. ``attrs["discard"]`` has the number.
        thin: Keep every ``thin``-th stored step.
        names: Parameter names for a sampler without a LogPosterior; ``theta1`` and so
            on by default.
        term: Label of a term whose data are independent, of a run or its file, to
            convert what was measured for this term alone, as ``arviz.plot_loo_pit``
            and ``arviz.loo_pit`` need it: ``log_likelihood`` and
            ``posterior_predictive`` have the name of the measured variable, and all
            draws of the chains.
        prior_predictive: Number of draws of the prior, at most 1,000, at which to
            predict new measurements for a prior predictive check: as many solves, in
            this process.

    Returns:
        ``arviz.InferenceData`` (ArviZ < 1) or ``xarray.DataTree`` (ArviZ >= 1).

    Raises:
        TypeError: If a number is not whole, posterior is not a LogPosterior or is
            missing where ``term`` or ``prior_predictive`` needs it, or names are not
            text.
        ValueError: If no step is left, a chain does not belong to this posterior, names
            are not needed or do not match the number of parameters, or the term's data
            are not independent.

    Examples:
        >>> import emcee_femu as ef
        >>> posterior = ef.paper.mass_spring().posterior
        >>> run = ef.run(posterior, ef.DEMCMove(), 20, 100, ensembles=1, seed=1)
        >>> idata = ef.to_inference_data(run, discard=50)
        >>> dict(idata["posterior"]["k1"].sizes)
        {'chain': 20, 'draw': 50}
        >>> before = ef.to_inference_data(posterior, prior_predictive=100)
        >>> dict(before["prior_predictive"]["frequency"].sizes)
        {'chain': 1, 'draw': 100, 'mode': 5}
    """
    count = checks.whole_number("prior_predictive", prior_predictive)
    if count > PRIOR_STORED:
        raise ValueError(
            f"prior_predictive: expected at most {PRIOR_STORED}, the draws of the "
            f"prior that are stored, got {count}"
        )
    if isinstance(source, LogPosterior):
        of_samples = posterior, names, term
        if discard or thin != 1 or any(given is not None for given in of_samples):
            raise ValueError(
                "source: a LogPosterior has no samples yet; give a run, or leave out "
                "posterior, discard, thin, names and term"
            )
        data = wrap(Groups(fixed_groups(source, {}, source.initial)))
        posterior = source
    elif names is None:
        told = "source", term, True
        read, posterior = read_samples(source, posterior, discard, thin, *told)
        data = wrap(read) if isinstance(read, Groups) else read
    else:
        chains = read_chains(source, posterior, discard, thin, blobs=True)
        names = checks.parameter_names("names", names)
        if is_arviz(source) or chains.posterior is not None:
            raise ValueError(f"names: {list(chains.names)} are known; leave it out")
        if len(names) != (d := len(chains.names)):
            raise ValueError(f"names: expected one for each of {d} parameters")
        data = wrap(convert(replace(chains, names=names), thin, term))
    if not count:
        return data
    posterior = checks.instance("posterior", posterior, LogPosterior)
    theta = posterior.prior.sample(np.random.default_rng(0), PRIOR_STORED)[:count]
    rows = posterior(theta)[:, None, None]
    new = gather_measurements(posterior, theta[:, None, None], rows)
    if not new:
        raise ValueError(
            "prior_predictive: no likelihood term draws new measurements, as of a bare "
            "log-likelihood; leave it out"
        )
    return wrap(groups(data) | {"prior_predictive": make_dataset(new, {}, {})})


def read_samples(
    source: object,
    posterior: LogPosterior | None = None,
    discard: int | None = None,
    thin: int = 1,
    argument: str = "idata",
    term: str | None = None,
    judged: bool = False,
) -> tuple[InferenceData, LogPosterior | None]:
    """Return the ArviZ object of any source of samples, and its posterior if known.

    All tables and figures read samples through it. Of chains each group is made when
    it is asked for. If ``judged``, what samples say of the data is stored too, and all
    groups are made.
    """
    if not is_arviz(source := samples_of(source)):
        read = partial(
            read_chains, source, posterior, discard, blobs=True, argument=argument
        )
        if judged:
            chains = read(thin)
            data = convert(chains, thin, term)
            if chains.posterior is not None:
                return store_fit(data, judge_samples(chains)), chains.posterior
            return wrap(data), None
        chains = read(thin, blobs=False)
        if chains.posterior is not None and chains.kind == "chain":
            # The blobs of another posterior differ: one step of them shows it.
            read_rows(read(thin * len(chains.draws)), chains.posterior)
        return convert(chains, thin, term, partial(read, thin)), chains.posterior
    if (discard or 0, thin, term) != (0, 1, None):
        raise ValueError(
            "discard, thin, term: expected 0, 1 and None for an ArviZ object, got "
            f"{discard}, {thin} and {term!r}; select its draws by isel(draw=...), and "
            "a term when you convert the run"
        )
    if posterior is not None:
        check_sampled(posterior, samples(source)[0])
    return source, posterior


def read_samples_and_model(
    source: object, posterior: LogPosterior | None
) -> tuple[InferenceData, LogPosterior]:
    """Return the ArviZ object of any source of samples, and the sampled posterior."""
    held = read_declared(source, "posterior")  # a result may hold it beside its samples
    if posterior is None and isinstance(held, LogPosterior):
        posterior = held
    idata, known = read_samples(source, posterior)
    return idata, require_model(known)


def require_model(known: LogPosterior | None) -> LogPosterior:
    """Return what was sampled, refusing samples of which that is not known."""
    if known is None:
        raise TypeError(
            "posterior: expected the sampled LogPosterior, whose model is needed here; "
            "an ArviZ object holds samples only, so give the posterior after it"
        )
    return checks.instance("posterior", known, LogPosterior)


def check_sampled(posterior: LogPosterior, names: Sequence[str]) -> None:
    """Refuse a posterior whose parameters are not the sampled ones."""
    checks.instance("posterior", posterior, LogPosterior)
    if posterior.names != tuple(names):
        raise ValueError(
            f"posterior: expected the sampled one, with the parameters {list(names)}, "
            f"got {list(posterior.names)}"
        )


def store_fit(data: InferenceData, records: Sequence[FitRecord]) -> InferenceData:
    """Return an ArviZ object that holds the records of its data."""
    held = groups(data)
    held["posterior"] = held["posterior"].assign_attrs({FIT: write_records(records)})
    return wrap(held)


def judge_samples(
    chains: Chains, weights: Floats | None = None, solves: int = SOLVED_AGAIN
) -> tuple[FitRecord, ...]:
    """Return the records of the data, without samples that have not arrived.

    Args:
        chains: Chains with their blobs.
        weights: Weights of the draws, ``(n,)``; None if all are equal.
        solves: How many samples may be solved again.
    """
    if (posterior := chains.posterior) is None:
        return ()
    rows = read_rows(chains, posterior).reshape(-1, posterior.row_size)
    theta = chains.draws.reshape(-1, posterior.ndim)
    height = rows[:, LOG_POSTERIOR]
    kept = height > height.max() - LOST - posterior.ndim
    rows, theta = rows[kept], theta[kept]
    if weights is not None:
        weights = weights[kept]
    initial = posterior.initial if chains.initial is None else chains.initial
    return judge_data(posterior, theta, rows, initial, weights, solves)
