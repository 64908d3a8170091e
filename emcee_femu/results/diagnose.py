"""Judge a run: autocorrelation time, ESS, R-hat, acceptance, and three statements."""

import json
from collections.abc import Collection, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from scipy import stats

from ..posterior.log_posterior import LogPosterior
from ..search.first_solve import doubt_units, is_constant, same_response
from ..search.maxima import HITS
from ..search.record import Chains
from ..verdict.statistics import MaximaWeights
from ..verdict.verdict import (
    NO_CHAINS,
    NOT_SEARCHED,
    SEARCHED,
    Cures,
    Diagnosis,
    Statement,
    judge_chains,
    measure,
)
from .arviz_objects import InferenceData, dataset, is_arviz
from .chains import read_chains
from .identifiability import describe_samples
from .measured import read_measured
from .to_arviz import read_samples

# Weights are equal within two standard errors, if these are so small.
EQUAL_WITHIN, ERROR_OF_EQUAL = 2.0, 0.02
ENOUGH_PREDICTED = 4_000  # samples
WIDTH_95 = 1.96  # standard deviations of a new measurement to either side: 95 %
CHANCE = 0.1  # of so many values outside, if the posterior had not seen them
FAR_OUTSIDE = 4.0  # standard deviations, for a single value
OUTVOTED = 5  # times as many values in another term
SMALL_MAXIMUM = 0.01  # weight of one whose modes do not matter
WRONG = 2.0  # times what was measured, or its inverse: more than a model's error
NOT_DRAWN = "no term draws new measurements of what the model stores"
NO_DATA = "no term says what was measured; a bare log-likelihood cannot"
NOT_KNOWN = "to_inference_data(source, posterior) has the data of a LogPosterior"


def diagnose(source: object, discard: int | None = None) -> Diagnosis:
    """Judge a run: whether chains converged, what was searched, whether the model fits.

    Use it after every :func:`run`, before you read any result. It makes three separate
    statements, because converged chains may have missed a mode, and a model may fit
    badly although its chains converged. Judging a run takes no solve.

    tau is emcee's integrated autocorrelation time, computed for each ensemble. R-hat is
    rank-normalised and split. A single ensemble cannot show that it missed a mode; run
    several from over-dispersed starts. For tempered runs only the cold walkers are
    judged, and tau and ESS are those of the mean over these walkers: exchanges pass
    states between walkers, so a single walker forgets its past sooner than the ensemble
    does. The results of :func:`anneal` and :func:`certify` are not chains; the first
    statement then says how to judge them instead.

    Args:
        source: The result of :func:`run`, :func:`anneal` or :func:`certify`, the
            emcee samplers of one posterior, the name of a run's file, or an ArviZ
            object made from any of these, whose steps are those left after its own
            ``discard`` and ``thin``.
        discard: Number of stored steps to drop as burn-in. None for those that a run
            by given moves found itself (``run.burn_in``), and for none of other
            sources.

    Returns:
        Numbers and three statements; ``print`` it.

    Raises:
        TypeError: If source is something else, or discard is not a whole number.
        ValueError: If fewer than 8 steps are left.

    Source: Goodman and Weare (2010), doi:10.2140/camcos.2010.5.65 (tau); Vehtari et
    al. (2021), doi:10.1214/20-BA1221 (R-hat, ESS).

    Examples:
        >>> import emcee_femu as ef
        >>> posterior = ef.paper.mass_spring().posterior
        >>> run = ef.run(posterior, ef.DEMCMove(), 20, 50, ensembles=1, seed=1)
        >>> diagnosis = ef.diagnose(run)
        >>> diagnosis.chains.status, diagnosis.search.status, diagnosis.fit.status
        ('not converged', 'not searched', 'fits')
    """
    source = getattr(source, "idata", source)  # of a certificate
    chains = read_chains(source, discard=discard)
    if chains.kind == "chain":
        diagnosis = measure(chains)
        about = judge_chains(diagnosis, chains.starts_given)
        search = judge_search(diagnosis.maxima, diagnosis.cures)
    else:
        about, search = judge_without_chains(source, chains)
        nan: Any = np.full((1, len(chains.names)), np.nan)
        # From tau to scatter, in the order of the attributes.
        numbers = nan, *3 * [nan[0]], nan[:, :1], (), *4 * [nan[0]]
        measured = chains.names, len(chains.draws), *numbers, chains.failures
        diagnosis = Diagnosis(*measured)
    fit = judge_fit(source, chains)
    return replace(diagnosis, chains=about, search=search, fit=fit)


def judge_search(maxima: MaximaWeights | None, cures: Cures) -> Statement:
    """Say what a search found, and how small a maximum it may have missed."""
    if maxima is None:
        sentence = "none: a maximum that no walker started near is not seen; "
        sentence += f"{cures.search} searches."
        return Statement(NOT_SEARCHED, "none", sentence)
    count = len(maxima.importance)
    short = "one maximum" if count == 1 else f"{count} maxima"
    climbs, from_prior = maxima.climbs
    few = from_prior // HITS
    reached = f", and at which fewer than one climb in {few:,} ends," if few else ""
    sentence = (
        f"{short}, by {maxima.searched:,} points and {climbs:,} climbs. A maximum so "
        f"small that fewer than one point in {maxima.searched // HITS:,} falls near it"
        f"{reached} may be missing."
    )
    if count > 1:
        sentence += (
            f" The samples form {count} separate clouds, and a mean may lie between "
            "them: report each with its weight."
        )
        i, j = np.triu_indices(count, 1)
        weights, errors = (
            maxima.weights.mean(axis=0),
            maxima.errors[i] + maxima.errors[j],
        )
        apart = np.abs(weights[i] - weights[j])
        equal = (apart < EQUAL_WITHIN * errors) & (errors < ERROR_OF_EQUAL)
        if equal.any():
            first = np.argmax(equal)
            sentence += (
                f" Maxima {i[first] + 1} and {j[first] + 1} weigh the same: if one "
                "mirrors the other, as left and right of a symmetric structure, these "
                "data cannot tell them apart; measure what can, or tie the parameters."
            )
    return Statement(SEARCHED, short, sentence)


def judge_without_chains(
    source: InferenceData, chains: Chains
) -> tuple[Statement, Statement]:
    """Say how draws that are not chains are judged, and what a search found."""
    if chains.kind == "population":
        words = "an annealed population; anneal with other seeds and compare"
        found = (
            f"{chains.origin}. A maximum so small that fewer than one draw of the "
            f"prior in {len(chains.draws) // HITS:,} falls near it may be missing."
        )
        search = Statement(SEARCHED, SEARCHED, found)
    else:
        certificate = dataset(source, "certificate").attrs
        words = f"draws weighted by full solves. {certificate['verdict']}"
        told = json.loads(certificate["search"])
        search = Statement(**told | {"reasons": tuple(told.get("reasons", ()))})
    return Statement(NO_CHAINS, NO_CHAINS, f"{NO_CHAINS}, but {words}"), search


def judge_fit(source: InferenceData, chains: Chains) -> Statement:
    """Say whether the measurements lie inside the posterior predictive.

    Args:
        source: What holds chains.
        chains: The chains that were read from it.
    """
    idata = _read(source, chains)
    parts = [] if idata is None else read_measured(idata)
    drawn = [(part, part.replicated) for part in parts if part.replicated is not None]
    if not drawn:
        known = idata is not None and "constant_data" in idata
        reason = (NOT_DRAWN if parts else NO_DATA) if known else NOT_KNOWN
        sentence = " ".join([f"not checked: {reason}.", *_recall(chains)])
        return Statement("not checked", "not checked", sentence)
    about = describe_samples(idata, fitted=False)
    missed, far, units, inside, total = [*about.surprising], "", [], 0, 0
    remedy = "Infer the model's error (discrepancy=), or improve the model."
    for part, new in drawn:
        mean = new.mean(axis=0)
        with np.errstate(divide="ignore", invalid="ignore"):
            z = np.abs(part.values - mean) / new.std(axis=0)
            ratios = np.abs(np.log(np.abs(mean / part.values)))[z > WIDTH_95]
        outside, worst = int((z > WIDTH_95).sum()), int(np.argmax(z))
        inside, total = inside + len(z) - outside, total + len(z)
        if ratios.max(initial=0) > np.log(WRONG):
            remedy = f"Units or the model are wrong: off by a factor above {WRONG:g}."
        if z[worst] > FAR_OUTSIDE or stats.binom.sf(outside - 1, len(z), 0.05) < CHANCE:
            missed.append(part.name)
            far += (
                f"; {part.name} of {part.dims} {part.labels[worst]} is farthest out "
                f"(measured {part.values[worst]:.4g}, predicted {mean[worst]:.4g}"
                f"{f' {part.unit}'.rstrip()})"
            )
            if text := doubt_units(part.initial[None], part.values, part.unit):
                units.append(f"At the prior mean {text}")
    names = ", ".join(part.name for part, _ in drawn)
    sentence = (
        f"{inside} of {total} measured values ({names}) are inside 95 % of new "
        f"measurements{far}."
    )
    pressed = about.find_pressed()
    swapped = [*_find_swaps(chains)]
    if not missed:
        doubts = [*about.find_followed(), *swapped, *_recall(chains)]
        still = [p for p in parts if is_constant(p.predicted)]
        if np.ptp(chains.draws) and still:
            label = ", ".join(part.name for part in still)
            doubts.append(same_response(label, len(still[0].predicted)))
        status, short = "fits", "inside"
        if doubts:
            status, short = "doubtful", "inside, but doubtful"
        if pressed:
            status = short = "at a bound"
        sentence = " ".join([f"{short}: {sentence}", *pressed, *doubts])
        return Statement(status, short, sentence)
    actions = units or [*_outvoted(chains.posterior, missed)] or about.find_doubts()
    actions = swapped or actions or pressed or [remedy]
    short = f"{total - inside} of {total} outside" if far else "a surprising error"
    sentence = " ".join([f"does not fit: {sentence}", *actions])
    return Statement("does not fit", short, sentence)


def _read(source: InferenceData, chains: Chains) -> InferenceData | None:
    """Return samples with their response, None where nothing is known of it."""
    if is_arviz(source):
        there = len(dataset(source, "posterior")["draw"])
        left_out = there - len(chains.draws)
        return source.isel(draw=slice(left_out, None)) if left_out else source
    if chains.posterior is None:
        return None
    thin = min(len(chains.draws), -(-chains.log_prob.size // ENOUGH_PREDICTED))
    return read_samples(source, None, chains.discard, thin)[0]


def _find_swaps(chains: Chains) -> Iterator[str]:
    """Name modes of the structure that change places, by maximum of the posterior."""
    if (search := chains.search) is None:
        return
    for experiment, found in search.followed.items():
        for i, numbers in enumerate(found):
            there = numbers != 1 + np.arange(len(numbers))
            swapped = np.flatnonzero(there & (numbers > 0))
            if not swapped.size or search.weights[i] < SMALL_MAXIMUM:
                continue
            moved = [f"{mode + 1} is number {numbers[mode]}" for mode in swapped]
            where = f"maximum {i + 1}{f' of {experiment}' if experiment else ''}"
            yield (
                f"At {where} (weight {search.weights[i]:.2f}) modes of the structure "
                "have changed places since the prior mean, by the model's shapes: mode "
                f"{', mode '.join(moved)}. Pair them by shape: PairedModel(model, ...)."
            )


def _recall(chains: Chains) -> list[str]:
    """Return the warnings before the run, which its file keeps."""
    return [f"Before the run: {doubt.rstrip('.?')}?" for doubt in chains.doubts]


def _outvoted(posterior: LogPosterior | None, missed: Collection[str]) -> Iterator[str]:
    """Name terms that do not fit, and those with far more values that outvote them.

    These infer their own error, and so may claim as much as they like.
    """
    for experiment in posterior.experiments if posterior else ():
        sizes = {
            term: sum(v.size for v in (term.reads or {}).values())
            for term in experiment.terms
        }
        for term, size in sizes.items():
            names = {*map(experiment.full_name, term.observed), term.discrepancy}
            for other, more in sizes.items():
                claims = other.discrepancy and other.discrepancy not in missed
                if names & {*missed} and claims and more >= OUTVOTED * size:
                    yield (
                        f"The {more} values of {other.name!r} outvote the {size} of "
                        f"{term.name!r}, since their error is inferred: give "
                        f"{other.name!r} known standard deviations (sd=), or a fixed "
                        "delta."
                    )
