"""Whether the posterior predicts the measurements, and reasons to doubt its fit."""

from collections.abc import Collection, Iterator

import numpy as np
from scipy import stats

from ..posterior.log_posterior import LogPosterior
from ..sampling.first_solve import doubt_units, is_constant, same_response
from ..sampling.record import Chains
from ..sampling.verdict import Statement
from .arviz_objects import InferenceData, is_arviz
from .identifiability import describe_samples
from .measured import read_measured
from .to_arviz import read_samples

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


def judge_fit(source: InferenceData, chains: Chains, discard: int) -> Statement:
    """Say whether the measurements lie inside the posterior predictive.

    Args:
        source: What holds chains.
        chains: The chains that were read from it.
        discard: Number of stored steps that were dropped.
    """
    idata = _read(source, chains, discard)
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


def _read(source: InferenceData, chains: Chains, discard: int) -> InferenceData | None:
    """Return samples and their response; None for a response that is unknown."""
    if is_arviz(source):
        return source.isel(draw=slice(discard, None)) if discard else source
    if chains.posterior is None:
        return None
    thin = min(len(chains.draws), -(-chains.log_prob.size // ENOUGH_PREDICTED))
    return read_samples(source, None, discard, thin)[0]


def _find_swaps(chains: Chains) -> Iterator[str]:
    """Name modes of the structure that change places, by maximum of the posterior."""
    if (search := chains.search) is None:
        return
    for experiment, found in search.followed.items():
        for i, numbers in enumerate(np.array(found)):
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
    """Return the warnings given before the run, from its record or file."""
    return [f"Before the run: {doubt.rstrip('.?')}?" for doubt in chains.doubts]


def _outvoted(posterior: LogPosterior | None, missed: Collection[str]) -> Iterator[str]:
    """Name terms that do not fit, and the larger terms that outvote them.

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
