"""One test of the structure: a model, and the terms that compare its response."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from .. import checks
from ..interfaces import (
    PLACE,
    Floats,
    LikelihoodTerm,
    Model,
    Parameters,
    SolveError,
    Variable,
    add_place,
    read,
)
from .compatibility import check_types, declare, name_terms
from .differences import gather_tangents
from .marginal import marginalize


class Experiment(NamedTuple):
    """A model, its terms and what is stored of its response.

    Attributes:
        name: Its name in a joint posterior; empty for a single experiment.
        model: Parameters to response.
        terms: Likelihood terms.
        term_names: Their labels.
        variables: The stored variables of the response, by their own names.
        exact: Whether the model declared them, and must keep to their shapes.
    """

    name: str
    model: Model
    terms: tuple[LikelihoodTerm, ...]
    term_names: tuple[str, ...]
    variables: Mapping[str, Variable]
    exact: bool

    def full_name(self, name: str) -> str:
        """Return a name with that of the experiment before it."""
        return f"{self.name}.{name}" if self.name else name

    def solve(
        self,
        own: Parameters,
        parameters: Parameters,
        n: int,
        describe: Callable[[], Any],
    ) -> tuple[list[Floats], list[Floats]]:
        """Return each term's log-likelihoods ``(n,)``, and each variable ``(n, size)``.

        Args:
            own: ``{name: (n,)}``, for the model.
            parameters: The same, for the terms.
            n: Number of parameter sets.
            describe: Returns them by name, for messages.
        """
        spread = getattr(self.model, "spread", None)
        if spread is None:
            response = self.respond(self.model, own, describe)
            return self.compare(response, parameters, n, describe)
        response, directions = self.respond(spread, own, describe)
        return self.compare(response, parameters, n, describe, directions)

    def compare(
        self,
        response: Any,
        parameters: Parameters,
        n: int,
        describe: Callable[[], Any],
        directions: Any = None,
    ) -> tuple[list[Floats], list[Floats]]:
        """Return what :meth:`solve` does, of a response and its ``spread``."""
        spread = getattr(self.model, "spread", None)
        if spread is not None and directions is None:
            own = {name: value.copy() for name, value in parameters.items()}
            response, directions = self.respond(spread, own, describe)
        stored = [  # first, because it says best what is wrong with a response
            self._extract(response, name, (n, *variable.shape), describe)
            for name, variable in self.variables.items()
        ]
        values = [
            self._evaluate(term, name, parameters, response, n)
            for term, name in zip(self.terms, self.term_names, strict=True)
        ]
        if directions is not None:
            labels = dict.fromkeys(d for found in directions.values() for d in found)
            label = f"{self.full_name('model')}: spread"
            tangents = gather_tangents(label, response, directions, [*labels])
            still = dict.fromkeys(parameters, np.zeros((n, len(labels))))
            values = marginalize(
                self.terms, parameters, response, tangents | still, values
            )
        return values, stored

    def respond(
        self, model: Any, parameters: Parameters, describe: Callable[[], Any]
    ) -> Any:
        """Return what the model returns, or its ``jacobian``; errors say where."""
        try:
            return model(parameters)
        except (StopIteration, SystemExit) as error:
            # The one would lose its notes in emcee's generator, the other end the
            # program without a word, and with exit code 0.
            raise RuntimeError(
                f"{self.full_name('model')}: it raised {error!r} at {describe()}"
            ) from error
        except Exception as error:
            notes = getattr(error, "__notes__", ())
            if not any(note.startswith(PLACE) for note in notes):
                add_place(error, describe(), [*parameters])
            if self.name:
                error.add_note(f"in the experiment {self.name!r}")
            raise

    def _evaluate(
        self,
        term: LikelihoodTerm,
        name: str,
        parameters: Parameters,
        response: Any,
        n: int,
    ) -> Floats:
        value = term(parameters, response)
        label = self.full_name(name)
        if type(value) is not np.ndarray or value.dtype != np.float64:
            value = checks.numeric_array(f"terms ({label!r})", value)
        if value.shape != (n,):  # one number would do for all rows, unseen
            raise ValueError(
                f"terms: expected {n} log-likelihoods of {label!r}, got shape "
                f"{value.shape}"
            )
        return value

    def _extract(
        self,
        response: Any,
        name: str,
        extent: tuple[int, ...],
        describe: Callable[[], Any],
    ) -> Floats:
        """Return a variable of the response, in the declared extent."""
        value = read(response, name)
        if not isinstance(value, np.ndarray) or value.dtype.kind not in "fiub":
            raise TypeError(
                f"{self.full_name('model')}: expected an array of real numbers for "
                f"{name!r}, got {value!r} at {describe()}"
            )
        if value.shape != extent:
            # Of what was not declared a term may read the first part only.
            larger = len(value.shape) == len(extent) and value.shape[0] == extent[0]
            if self.exact or not larger or (np.array(value.shape) < extent).any():
                raise SolveError(
                    "wrong shape",
                    f"{self.full_name('model')}: expected {name!r} of shape {extent}, "
                    f"got {value.shape}: one value for each that was measured; let the "
                    f"model return more, or give its term fewer; at {describe()}",
                )
            value = value[tuple(map(slice, extent))]  # such as modes beyond those read
        array: Floats = value.reshape(len(value), -1)
        return array


def gather_experiments(
    given: Mapping[str, tuple[Any, Any]], prior: Any
) -> tuple[Experiment, ...]:
    """Return experiments of ``{name: (model, terms)}``, checked one by one."""
    experiments = []
    for name, (model, terms) in given.items():
        sequence = tuple(terms) if isinstance(terms, Sequence) else (terms,)
        check_types(model, sequence, prior)
        declared = declare(model, sequence)
        stored = {
            key: variable for key, variable in declared.items() if variable.stored
        }
        experiments.append(
            Experiment(
                name,
                model,
                sequence,
                name_terms(sequence),
                stored,
                exact=getattr(model, "variables", None) is not None,
            )
        )
    return tuple(experiments)


def check_joint(experiments: Any) -> None:
    """Refuse what is not ``{name: (model, terms)}``."""
    if not isinstance(experiments, Mapping):
        raise TypeError(
            "experiments: expected {name: (model, terms)}, got "
            f"{type(experiments).__name__}"
        )
    if not experiments:
        raise ValueError("experiments: expected at least one, got none")
    for name, pair in experiments.items():
        if not isinstance(name, str) or not name or set(name) & set("./"):
            raise ValueError(
                f"experiments: expected names without dots and slashes, got {name!r}"
            )
        if not isinstance(pair, Sequence) or len(pair) != 2:
            raise TypeError(
                f"experiments: expected (model, terms) for {name!r}, got {pair!r}"
            )
