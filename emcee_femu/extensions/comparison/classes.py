"""Model classes compared by their evidence, for the same data."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ... import checks
from ...contracts import Floats
from ...digits import show
from ...results.evidence import Evidence, log_evidence
from ...table import Column, Parts, Report, Table

CLASS_LEAD = 2.0  # combined standard errors by which a class must be ahead
STRENGTH_WORDS = {5.0: "very strong", 3.0: "strong", 1.0: "positive", 0.0: "weak"}


@dataclass(frozen=True, eq=False)
class Standing:
    """The position of one model class relative to the best.

    Attributes:
        evidence: As :func:`.log_evidence` returns it.
        lead: ln of the Bayes factor of the best class against this one.
        lead_error: Its standard error; 0 for the best.
        probability: Probability of the class, given the data.
        decided: Whether the lead exceeds the errors.
    """

    evidence: Evidence
    lead: float
    lead_error: float
    probability: float
    decided: bool

    @property
    def strength(self) -> str:
        """The term of Kass and Raftery for the evidence against the class."""
        known = STRENGTH_WORDS.items()
        return next(word for least, word in known if self.lead >= least)


@dataclass(frozen=True, eq=False, repr=False)
class ModelComparison(Report):
    """The result of :func:`.compare_models`; ``print`` it for table and conclusion.

    Attributes:
        table: One row per model class, the largest evidence first: log evidence and its
            standard error; ln of the Bayes factor of the best class against this one
            and its standard error; probability; verdict.
        standings: The same numbers by label, the largest evidence first.
        evidences: By label, as :func:`.log_evidence` returns them.
        probabilities: Probabilities of the classes given the data, by label.
        winner: Label of the class that is significantly ahead of all others; None if
            there is none.
        conclusion: The outcome in words, one sentence per line.
    """

    table: Table
    standings: dict[str, Standing]
    evidences: dict[str, Evidence]
    probabilities: dict[str, float]
    winner: str | None
    conclusion: str

    def _parts(self) -> Parts:
        return self.table, self.conclusion


def compare_models(
    models: Mapping[str, object], *, prior: Mapping[str, float] | None = None
) -> ModelComparison:
    r"""Compare model classes by their evidence, for the same data.

    .. math:: B_{ij} = \frac{Z_i}{Z_j}, \qquad
        P(M_i | D) = \frac{\pi_i Z_i}{\sum_j \pi_j Z_j}

    Use it to decide, for example, whether a support is a hinge or a spring, or whether
    a parameter is needed. The evidence rewards a good fit and penalises each parameter
    that the data narrow from its prior: a prior ten times wider than needed costs ln
    10. All classes need the same measurements, normalised likelihoods and proper
    priors. It takes no solves.

    The verdict on a class is "undecided" if its log evidence is within two combined
    standard errors of the best. Otherwise the evidence against it is, in the terms of
    Kass and Raftery, weak (ln B below 1), positive (below 3), strong (below 5) or very
    strong.

    Args:
        models: At least two classes by label: anything that :func:`log_evidence`
            accepts or has returned, or the result of :func:`anneal`.
        prior: Positive prior probabilities of the classes by label; they are
            normalised. By default all are equal.

    Returns:
        A table, probabilities and a conclusion in words; ``print`` it.

    Raises:
        TypeError: If models or prior is not a mapping with text labels.
        ValueError: If there are fewer than two classes, prior does not name them all,
            or a log evidence is not finite; also errors of log_evidence, with the
            label.

    Source: Kass and Raftery (1995), doi:10.1080/01621459.1995.10476572.

    Examples:
        >>> from emcee_femu import compare_models
        >>> from emcee_femu.results.evidence import Evidence
        >>> one, four = Evidence(-12.3, 0.1, "known"), Evidence(-9.1, 0.1, "known")
        >>> print(compare_models({"one factor": one, "four factors": four}).conclusion)
        Ahead: 'four factors'; the evidence against 'one factor' is strong.
    """
    found = _estimate(models)
    labels = sorted(found, key=lambda label: -found[label].log_evidence)
    evidences = {label: found[label] for label in labels}
    values = np.array([evidence.log_evidence for evidence in evidences.values()])
    errors = np.array([evidence.log_evidence_error for evidence in evidences.values()])
    posterior = values + np.log(_weigh(prior, labels))
    probabilities = np.exp(posterior - np.logaddexp.reduce(posterior))

    lead = values[0] - values
    lead_errors = np.where(np.arange(len(lead)) > 0, np.hypot(errors[0], errors), 0.0)
    decided = lead > CLASS_LEAD * lead_errors
    numbers = lead.tolist(), lead_errors.tolist(), probabilities.tolist()
    rows = zip(evidences.values(), *numbers, decided.tolist(), strict=True)
    standings = dict(zip(labels, (Standing(*row) for row in rows), strict=True))
    verdicts = [
        f"behind, {standing.strength}" if standing.decided else "undecided"
        for standing in standings.values()
    ]
    verdicts[0] = "first"
    columns: list[Column] = [
        ("model class", "", labels),
        ("log evidence", show(values, errors), values),
        ("+-", show(errors, errors), errors),
        ("ln Bayes factor", show(lead, lead_errors), lead),
        ("its +-", show(lead_errors, lead_errors), lead_errors),
        ("probability", ".3g", probabilities),
        ("verdict", "", verdicts),
    ]
    title = (
        "Model classes compared: ln Bayes factor of the first against each; "
        + ("equal" if prior is None else "given")
        + " prior probabilities"
    )
    return ModelComparison(
        table=Table.from_columns(title, columns),
        standings=standings,
        evidences=evidences,
        probabilities=dict(zip(labels, probabilities.tolist(), strict=True)),
        winner=labels[0] if decided[1:].all() else None,
        conclusion=_conclude(standings),
    )


def _estimate(models: Mapping[str, object]) -> dict[str, Evidence]:
    """Return the evidences by label."""
    sources = checks.by_label("models", models, "runs, such as {'one factor': run}")
    if len(sources) < 2:
        raise ValueError(f"models: expected at least two classes, got {[*sources]}")
    evidences = {}
    for label, source in sources.items():
        try:
            evidences[label] = evidence = log_evidence(source)
            found = evidence.log_evidence, evidence.log_evidence_error
            if not np.isfinite(found[0]) or np.isnan(found[1]):
                raise ValueError(f"expected a finite log evidence, got {found}")
        except (TypeError, ValueError) as error:
            raise type(error)(f"models[{label!r}]: {error}") from error
    return evidences


def _weigh(prior: Mapping[str, float] | None, labels: list[str]) -> Floats:
    """Return the prior probabilities in the order of the labels."""
    if prior is None:
        return np.full(len(labels), 1 / len(labels))
    weights = checks.numbers_by_name("prior", prior, labels)
    if not (weights > 0).all():
        raise ValueError(
            f"prior: expected a number above zero for each of {labels}, got {prior}"
        )
    return np.asarray(weights / weights.sum())


def _conclude(standings: Mapping[str, Standing]) -> str:
    first, *others = standings
    close = [label for label in others if not standings[label].decided]
    behind = ", ".join(
        f"the evidence against {label!r} is {standings[label].strength}"
        for label in others
        if standings[label].decided
    )
    lines = [f"Ahead: {first!r}; {behind}."]
    if close:
        lines = [
            f"Undecided between {', '.join([first, *close[:-1]])} and {close[-1]}: "
            "the log evidences differ by less than two standard errors; run longer."
        ]
        lines += [f"Of the others, {behind}."] if behind else []
    lines += [
        f"{label}: no error can be given, because {problem}."
        for label, standing in standings.items()
        for problem in standing.evidence.problems
    ]
    return "\n".join(lines)
