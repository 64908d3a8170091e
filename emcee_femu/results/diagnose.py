"""Judge a run: autocorrelation time, ESS, R-hat, acceptance, and three statements."""

import json
from dataclasses import replace
from typing import Any

import numpy as np

from ..sampling.modes import ModeWeights
from ..sampling.record import Chains
from ..sampling.verdict import (
    NO_CHAINS,
    NOT_SEARCHED,
    SEARCHED,
    Diagnosis,
    Statement,
    judge_chains,
    measure,
)
from .arviz_objects import dataset
from .chains import read_chains
from .fit import judge_fit

HITS = 3  # expected, of which none comes once in twenty times


def diagnose(source: object, discard: int = 0) -> Diagnosis:
    """Say whether chains converged, what a search found, and whether the model fits.

    Three statements, each with its own status: converged chains may have missed a mode,
    and may be those of a model that fits nothing.

    tau is emcee's, for each ensemble by itself. R-hat is rank-normalised and split.
    One ensemble cannot show that it missed a mode: run several from
    over-dispersed starts. For tempered runs only the cold walkers are judged, and tau
    and ESS are those of the mean over these walkers: an exchange hands a state to
    another walker, so that a walker forgets sooner than its ensemble. Populations and
    the weighted draws of a certificate are no chains, which the first statement says,
    and by what they are judged instead.

    Args:
        source: What :func:`run` returned, EnsembleSamplers of one target, or the name
            of a run's file; what :func:`anneal` or :func:`certify` returned; or an
            ArviZ object of them, with steps counted after its own ``discard`` and
            ``thin``.
        discard: Stored steps to drop as burn-in.

    Returns:
        Numbers and three statements; ``print`` it.

    Raises:
        TypeError: If source is something else, or discard not a whole number.
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
        about = judge_chains(diagnosis, chains.starts_given, discard)
        search = judge_search(diagnosis.modes)
    else:
        about, search = judge_without_chains(source, chains)
        nan: Any = np.full((1, len(chains.names)), np.nan)
        # From tau to scatter, in the order of the attributes.
        numbers = nan, *3 * [nan[0]], nan[:, :1], (), *4 * [nan[0]]
        measured = chains.names, len(chains.draws), *numbers, chains.failures
        diagnosis = Diagnosis(*measured)
    fit = judge_fit(source, chains, discard)
    return replace(diagnosis, chains=about, search=search, fit=fit)


def judge_search(modes: ModeWeights | None) -> Statement:
    """Say what a search found, and how small a maximum it may have missed."""
    if modes is None:
        sentence = "none: a maximum that no walker started near is not seen; "
        sentence += 'run(posterior, "auto") searches.'
        return Statement(NOT_SEARCHED, "none", sentence)
    count = len(modes.importance)
    short = "one maximum" if count == 1 else f"{count} maxima"
    climbs, from_prior = modes.climbs
    few = from_prior // HITS
    reached = f", and at which fewer than one climb in {few:,} ends," if few else ""
    sentence = (
        f"{short}, by {modes.searched:,} points and {climbs:,} climbs. A maximum so "
        f"small that fewer than one point in {modes.searched // HITS:,} falls near it"
        f"{reached} may be missing."
    )
    return Statement(SEARCHED, short, sentence)


def judge_without_chains(source: Any, chains: Chains) -> tuple[Statement, Statement]:
    """Say by what draws are judged that are no chains, and what a search found."""
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
        search = Statement(**json.loads(certificate["search"]))
    return Statement(NO_CHAINS, NO_CHAINS, f"{NO_CHAINS}, but {words}"), search
