"""Judge a run: autocorrelation time, ESS, R-hat, acceptance, and three statements."""

import json
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from .. import checks
from ..contracts import Floats
from ..likelihoods.residuals import NOT_JUDGED, FitRecord
from ..search.maxima import HITS
from ..search.record import Chains
from ..verdict.diagnosis import (
    NO_CHAINS,
    NOT_SEARCHED,
    REFUSED,
    SEARCHED,
    Cures,
    Diagnosis,
    Statement,
    measure,
)
from ..verdict.statistics import MaximaWeights
from ..verdict.verdict import judge_chains
from .arviz_objects import (
    SAMPLED,
    InferenceData,
    dataset,
    groups,
    is_arviz,
    judgement_of,
    samples_of,
    wrap,
)
from .chains import read_chains
from .fit import read_records
from .fit_statement import judge_fit
from .groups import convert
from .to_arviz import FIT, judge_samples

# Functions that judge samples with their response, by the title of their statement: see
# CONTRIBUTING.md.
FURTHER: dict[str, Callable[[InferenceData], Statement]] = {}
NO_RESPONSE = "these samples come without the model's response"
NOT_TO_BE_USED = "refused by full solves: do not use these numbers"
# Weights are equal if they differ by less than two standard errors, which are small.
EQUAL_WITHIN, ERROR_OF_EQUAL = 2.0, 0.02


def diagnose(source: object, discard: int | None = None) -> Diagnosis:
    """Judge a run: whether chains converged, what was searched, whether the model fits.

    Use it after every :func:`run`, before you read any result. It makes three separate
    statements, because converged chains may have missed a maximum, and a model may fit
    badly although its chains converged. Judging a run takes no solve, but nine where a
    term reads what is not stored, such as mode shapes or FRFs: eight samples and the
    prior mean. Where shapes do not fit, 2 more look for a wrong sensor, and 16 if one
    is suspect. Each is made the first time only.

    The fit is judged twice. Each measured value is compared with new measurements that
    the terms draw. And each Gaussian term has residuals, whose chi^2 is compared with
    that of a right model: of all its data, and by mode, sensor, channel and so on, in
    ``data``. Over all that is looked at, a right test raises an alarm in one of a
    hundred cases; an inferred error absorbs much, so then shares of chi^2 count. The
    statement names what is farthest out, the likeliest cause first, and terms that
    cannot be judged. Of an ArviZ object it is that of its conversion.

    tau is emcee's integrated autocorrelation time, computed for each ensemble. R-hat is
    rank-normalised and split. A single ensemble cannot show a maximum that it missed;
    run several from over-dispersed starts. For tempered runs only the cold walkers are
    judged, and tau and ESS are those of the mean over these walkers: exchanges pass
    states between walkers, so a single walker forgets its past sooner than the ensemble
    does. The results of :func:`anneal`, and what :func:`certify` corrected, are not
    chains; the first statement then says how to judge them instead. It says "refused"
    of an emulated posterior that was refused.

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
        >>> run = ef.run(posterior, ef.DEMCMove(), 20, 100, ensembles=1, seed=1)
        >>> diagnosis = ef.diagnose(run)
        >>> diagnosis.chains.status, diagnosis.search.status, diagnosis.fit.status
        ('not converged', 'not searched', 'fits')
    """
    source, judged = samples_of(source), judgement_of(source)
    chains = read_chains(source, discard=discard)
    if chains.kind == "chain":
        diagnosis = measure(chains)
        about = judge_chains(diagnosis, chains.starts_given)
        search = judge_search(diagnosis.maxima, diagnosis.cures)
    else:
        about, search = judge_without_chains(source, chains)
        nan: Floats = np.full((1, len(chains.names)), np.nan)
        diagnosis = Diagnosis(
            names=chains.names,
            steps=len(chains.draws),
            tau=nan,
            steps_per_tau=nan[0],
            ess_bulk=nan[0],
            ess_tail=nan[0],
            acceptance=nan[:, :1],
            stuck=(),
            rhat_within=nan[0],
            rhat_between=nan[0],
            sd_error=nan[0],
            scatter=nan[0],
            failures=chains.failures,
        )
    if judged.get("refused"):
        told = f"not to be used. {judged['verdict']}"
        about = Statement(REFUSED, NOT_TO_BE_USED, told, about.reasons)
    idata, records = _read(source, chains)
    fit = judge_fit(idata, records, chains)
    data = records or ()
    further = {title: _ask(judge, idata) for title, judge in FURTHER.items()}
    diagnosis = replace(diagnosis, data=data, further=further)
    return replace(diagnosis, chains=about, search=search, fit=fit)


def _ask(
    judge: Callable[[InferenceData], Statement], idata: InferenceData | None
) -> Statement:
    """Return a further statement; a judge that fails does not take the others along."""
    if idata is None:
        return Statement(NOT_JUDGED, NOT_JUDGED, f"{NOT_JUDGED}: {NO_RESPONSE}.")
    try:
        return checks.instance("the statement", judge(idata), Statement)
    except Exception as error:  # of any kind: it is the user's judge
        return Statement(NOT_JUDGED, NOT_JUDGED, f"not judged: it raised {error!r}.")


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
    reached = f" and 1 in {few:,} climbs" if few else ""
    sentence = (
        f"{short}, by {maxima.searched:,} points and {climbs:,} "
        f"{'climb' if climbs == 1 else 'climbs'}. Only a maximum that attracts fewer "
        f"than 1 in {maxima.searched // HITS:,} points{reached} "
        "could have been missed."
    )
    if maxima.held > 1:
        sentence += (
            f" {maxima.held} of them hold samples, so that a mean may lie between "
            "clouds (plot_scatter shows it): report each with its weight."
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
            f"{chains.origin}. Only a maximum that attracts fewer than 1 in "
            f"{len(chains.draws) // HITS:,} draws of the prior could have been missed."
        )
        search = Statement(SEARCHED, SEARCHED, found)
    else:
        judged = judgement_of(source)
        words = f"draws weighted by full solves. {judged['verdict']}"
        told = json.loads(judged["search"])
        search = Statement(**told | {"reasons": tuple(told.get("reasons", ()))})
    return Statement(NO_CHAINS, NO_CHAINS, f"{NO_CHAINS}, but {words}"), search


def _read(
    source: InferenceData, chains: Chains
) -> tuple[InferenceData | None, tuple[FitRecord, ...] | None]:
    """Return samples with their response, and their records; None where unknown."""
    if not is_arviz(source):
        if chains.posterior is None:
            return None, None
        whole = read_chains(source, discard=chains.discard, blobs=True)
        return convert(whole), judge_samples(whole)
    posterior = dataset(source, "posterior")
    known = posterior.attrs.get(FIT)
    records = None if known is None else read_records(known)
    left_out = len(posterior["draw"]) - len(chains.draws)
    if left_out:  # of the samples alone: draws of the prior have no burn-in
        source = wrap(
            {
                name: part.isel(draw=slice(left_out, None)) if name in SAMPLED else part
                for name, part in groups(source).items()
            }
        )
    return source, records
