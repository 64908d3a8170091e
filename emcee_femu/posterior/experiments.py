"""One test of the structure: a model, and the terms that compare its response."""

import inspect
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple, TypeAlias

import numpy as np

from .. import checks
from ..contracts import (
    PLACED,
    WRAP,
    Batch,
    Floats,
    LikelihoodTerm,
    Model,
    Parameters,
    Response,
    SolveError,
    Stored,
    add_place,
    gather_tangents,
    read,
    read_declared,
)
from ..likelihoods.term import Term, as_term, move_along
from ..models.paired import PairedModel
from .compatibility import check_terms, declare

Terms: TypeAlias = LikelihoodTerm | Sequence[LikelihoodTerm]
Tests: TypeAlias = Mapping[str, tuple[Model, Terms]]  # by the names of experiments
Directions: TypeAlias = Mapping[str, Mapping[str, Floats]]  # as spread returns them
Ask: TypeAlias = Callable[[Parameters], tuple[Response, Directions]]

SHOWN_SETS = 2  # parameter sets of a batch in a message


class Solved(NamedTuple):
    """What one experiment gave for n parameter sets.

    Attributes:
        terms: Those of the experiment.
        response: That of the model.
        log_likelihoods: One ``(n,)`` for each term.
        stored: One ``(n, size)`` for each stored variable.
        tangents: Derivatives ``(n, *shape, d)`` by variable; empty without.
    """

    terms: tuple[Term, ...]
    response: Response
    log_likelihoods: list[Floats]
    stored: list[Floats]
    tangents: dict[str, Floats]


class Experiment:
    """A model, its terms and what is stored of its response.

    Args:
        name: Its name in a joint posterior; empty for a single experiment.
        model: Parameters to response.
        terms: Likelihood terms, or one.

    Attributes:
        paired: The model, if it pairs modes; else None.
        term_names: The labels of the terms.
        variables: The stored variables of the response, by their own names.
        exact: Whether the model declared them, and must keep to their shapes.
        jacobian: What returns response and derivatives, None if the model has none.
        spread: What returns response and uncertainty, None if the model claims none.
    """

    def __init__(self, name: str, model: Model, terms: Terms) -> None:
        several = checks.one_or_several(terms)
        check_terms(model, several)
        self.name, self.model = name, model
        self.paired = model if isinstance(model, PairedModel) else None
        self.terms = tuple(map(as_term, several))
        names = [term.name or f"term{i}" for i, term in enumerate(self.terms)]
        self.term_names = checks.parameter_names("terms (their names)", names)
        declared = declare(model, self.terms)
        self.variables = {name: v for name, v in declared.items() if v.stored}
        self.exact = read_declared(model, "variables") is not None
        self.jacobian: Ask | None = read_declared(model, "jacobian")
        self.spread: Ask | None = read_declared(model, "spread")

    def full_name(self, name: str) -> str:
        """Return a name with that of the experiment before it."""
        return f"{self.name}.{name}" if self.name else name

    def stored(self, values: Mapping[str, Floats]) -> Stored:
        """Return its own of the stored variables ``{full name: values}``."""
        return Stored({name: values[self.full_name(name)] for name in self.variables})

    def solve(
        self, parameters: Parameters, names: Sequence[str], derivatives: bool = False
    ) -> Solved:
        """Solve the model once for each parameter set, and compare what it returns.

        Args:
            parameters: ``{name: (n,)}``.
            names: All parameters of the posterior, in its order.
            derivatives: Whether to ask the model's jacobian for derivatives.
        """
        solved, directions = self._respond(parameters, names, derivatives)
        for term, name in zip(self.terms, self.term_names, strict=True):
            value, label = term(parameters, solved.response), self.full_name(name)
            if type(value) is not np.ndarray or value.dtype != np.float64:
                value = checks.numeric_array(f"terms ({label!r})", value)
            # One number would do for all, unseen.
            shape = parameters[names[0]].shape
            checks.shaped(f"terms ({label!r})", value.shape, shape)
            solved.log_likelihoods.append(value)
        if directions is None:
            return solved
        averaged = self._average(parameters, solved, directions)
        return solved._replace(log_likelihoods=averaged)

    def _respond(
        self, parameters: Parameters, names: Sequence[str], derivatives: bool
    ) -> tuple[Solved, Directions | None]:
        """Return response, tangents, uncertainty and what is stored; errors say where.

        A model may overwrite its parameters: it is given copies.
        """
        tangents, directions, label = {}, None, self.full_name("model")

        def copies() -> Parameters:
            return {name: value.copy() for name, value in parameters.items()}

        try:
            if derivatives and self.jacobian is not None:
                response, slopes = self.jacobian(copies())
                reads = {name for term in self.terms for name in term.reads or ()}
                who = f"{label}: jacobian"
                tangents = gather_tangents(who, response, slopes, names, reads)
            if self.spread is not None:  # an emulator: its second call costs nothing
                response, directions = self.spread(copies())
            elif not derivatives:
                response = self.model(copies())
            n = len(next(iter(parameters.values())))
            stored = [self._extract(response, name, n) for name in self.variables]
        except (Exception, SystemExit) as error:
            if PLACED not in vars(error):
                add_place(error, name_sets(parameters), [*parameters])
            if inspect.isfunction(self.model):
                error.add_note(f"it was given arrays, of many parameter sets; {WRAP}")
            if self.name:
                error.add_note(f"in the experiment {self.name!r}")
            if type(error) not in (StopIteration, SystemExit):
                raise
            # The one would lose its notes in emcee's generator, the other end the
            # program without a word, and with exit code 0.
            raise RuntimeError(
                f"{label}: it raised {error!r}, {', '.join(error.__notes__)}"
            ) from error
        return Solved(self.terms, response, [], stored, tangents), directions

    def _average(
        self, parameters: Parameters, solved: Solved, directions: Directions
    ) -> list[Floats]:
        r"""Return log-likelihoods averaged over the error that the model claims.

        The response moves by one standard deviation along each of q independent
        directions, whose coordinates z are standard normal. To second order in z

        .. math:: \ln \int N(z; 0, I) \, p(D | z) \, dz \approx \ln p(D | 0)
            + \tfrac12 g^T (I + F)^{-1} g - \tfrac12 \ln \det(I + F)

        with gradient g and Fisher information F of the log-likelihood along the
        directions: exact where the data are Gaussian and their mean is linear in z. The
        variance of the model then adds to that of the measurement.

        Each is given the data of the terms before it, so that their sum is that of all
        data: a term that shares the model's error with one before it knows it better.
        """
        label, response = f"{self.full_name('model')}: spread", solved.response
        tangents = tangents_of(label, parameters, response, directions)
        n, q = tangents[next(iter(parameters))].shape
        gradient, information = np.zeros((n, q)), np.tile(np.eye(q), (n, 1, 1))
        before, averaged = np.zeros(n), []
        for term, value in zip(self.terms, solved.log_likelihoods, strict=True):
            possible = value > -np.inf
            with np.errstate(all="ignore"):  # of rows that are -inf
                slope, curvature = expand(term, parameters, response, tangents, value)
            gradient += np.where(possible[:, None], slope, 0.0)
            information += np.where(possible[:, None, None], curvature, 0.0)
            factor = np.linalg.cholesky(information)
            scaled = np.linalg.solve(factor, gradient[:, :, None])[:, :, 0]
            widths = np.diagonal(factor, axis1=1, axis2=2)
            gain = 0.5 * (scaled**2).sum(axis=1) - np.log(widths).sum(axis=1)
            averaged.append(value + gain - before)
            before = gain
        return averaged

    def _extract(self, response: Response, name: str, n: int) -> Floats:
        """Return a variable of the response, in the declared shape, ``(n, size)``."""
        value = part = read(response, name)
        shape = self.variables[name].shape
        if not isinstance(value, np.ndarray) or value.dtype.kind not in "fiub":
            raise TypeError(
                f"{self.full_name('model')}: expected an array of real numbers for "
                f"{name!r}, got {value!r}"
            )
        if value.ndim == 1 + len(shape) and not self.exact:
            # Of what was not declared a term may read the first part only.
            part = value[(slice(None), *map(slice, shape))]
        if part.shape != (n, *shape):
            raise SolveError(
                "wrong shape",
                f"{self.full_name('model')}: expected {name!r} of shape "
                f"{(n, *shape)}, got {value.shape}: one value for each that was "
                "measured; let the model return more, or give its term fewer",
            )
        return part.reshape(n, -1)


def tangents_of(
    label: str, parameters: Parameters, response: Response, directions: Directions
) -> dict[str, Floats]:
    """Return moves of variables ``(n, *shape, q)``, and of parameters, which rest."""
    names = [*dict.fromkeys(name for moves in directions.values() for name in moves)]
    n = len(next(iter(parameters.values())))
    still = dict.fromkeys(parameters, np.zeros((n, len(names))))
    return gather_tangents(label, response, directions, names) | still


def expand(
    term: Term,
    parameters: Parameters,
    response: Response,
    tangents: Batch,
    log_likelihood: Floats,
) -> tuple[Floats, Floats]:
    """Return gradient ``(n, q)`` and information ``(n, q, q)`` along the directions."""
    steps = np.ones_like(tangents[next(iter(parameters))])
    gradient, scores = term.linearize(parameters, response, tangents, steps)
    if scores is not None:
        return gradient, scores.swapaxes(1, 2) @ scores
    # One standard deviation to both sides of each direction.
    q, value = steps.shape[-1], log_likelihood[:, None]
    moved = move_along(parameters, response, tangents, steps)
    ahead, behind = term(*moved).reshape(-1, 2, q).swapaxes(0, 1)
    slope = (ahead - behind) / 2
    bend = 2 * value - ahead - behind
    # What bends the other way has no maximum: it gains what was seen, no more.
    seen = np.maximum(np.maximum(ahead, behind) - value, 0.5)
    least = np.maximum(slope**2 / (2 * seen) - 1.0, 0.0)
    bend = np.where(bend > 0, bend, least)
    return slope, bend[:, :, None] * np.eye(q)


def check_joint(experiments: Tests) -> None:
    """Refuse what is not ``{name: (model, terms)}``."""
    checks.mapping("experiments", experiments, "{name: (model, terms)}")
    for name in checks.parameter_names("experiments", experiments):
        if set(name) & set("./"):
            raise ValueError(f"experiments: no dots or slashes in names, got {name!r}")
        label = f"experiments[{name!r}]"
        checks.group(label, experiments[name], "(model, terms)", 2)


def name_sets(parameters: Parameters) -> dict[str, float] | list[object]:
    """Return parameter sets by name, and not all of many."""
    n = len(next(iter(parameters.values())))
    sets = [
        {name: values[i].item() for name, values in parameters.items()}
        for i in range(min(n, SHOWN_SETS))
    ]
    rest = [f"{n - SHOWN_SETS} more"] if n > SHOWN_SETS else []
    return sets[0] if n == 1 else [*sets, *rest]
