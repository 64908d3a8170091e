"""The interface of likelihood terms; Gaussian terms derive all of it from deviations.

A term that is Gaussian in the measured quantities gives deviations r and their standard
deviations; density, pointwise densities, replicates, gradient and Fisher information
are derived here. Any other callable becomes a :class:`FunctionTerm`, with the
attributes that it declares (contracts.py).

Derivatives are central differences along *tangents*: the derivatives of each variable
of the response, ``(n, *shape, d)``, and of each parameter, ``(n, d)``, in d directions.
They cost evaluations of the term but no solve.
"""

from collections.abc import Callable, Mapping
from copy import copy
from typing import TypeAlias, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import checks
from ..contracts import (
    Batch,
    Floats,
    Parameters,
    Response,
    Variable,
    read_declared,
    show_declared,
)
from ..contracts import read as read_variable
from .residuals import Residuals

Deviations: TypeAlias = tuple[Floats, Floats]  # r and sd, (n, m) each
Values = TypeVar("Values", Floats, NDArray[np.complex128])

# An inferred error of zero, where a search may stand on the bound of a prior: its
# likelihood overflows to zero, and is not undefined.
LEAST_SD = 1e-160
# Share of a standard deviation by which equal ones, or equal deviations, may differ.
SAME_SD = 1e-9
# What to advise for an inferred relative error. A half-normal has density at zero,
# where the likelihood has a spike if the parameters fit all data; the long tail of
# lognorm(1, scale=0.005) leaves standard deviations unknown where data are few.
ERROR_PRIOR = "(0.001, 0.05)"
MOST_RELATIVE = 0.5  # of a standard deviation; more is one in percent
RESPONSE_STEP = 6e-6  # relative change of a response, where no solve adds noise
# What a callable may declare, besides deviations and restore (contracts.py).
DECLARED = (
    "names",
    "bounds",
    "reads",
    "observed",
    "error_sd",
    "discrepancy",
    "statement",
    "formula",
    "symbol",
)
MODEL_ERROR = "σ<sub>d</sub>"  # as reports write the error that a discrepancy infers


class Term:
    r"""One factor of the likelihood: the base class of all terms.

    .. math:: \ln p = \sum_i [\ln N(r_i; 0, \sigma_i) + c_i]

    A subclass implements :meth:`deviations`, and :meth:`restore` if replicated
    measurements can be drawn; or its own density if it is not Gaussian.

    Attributes:
        gaussian: Whether it has :meth:`deviations`.
        name: The label under which its log-likelihood is stored.
        discrepancy: Name of the inferred error, or None.
        names: The parameters that it reads; None if unknown.
        bounds: ``{parameter: (low, high)}`` within which it is valid.
        reads: The variables that it needs; None if unknown.
        observed: The measured values by variable name.
        error_sd: Their standard deviations, 0 for values taken as exact.
        log_constants: c, from units and normalisation, one number or ``(m,)``.
        separate: Whether each deviation belongs to one datum.
        stated_sd: The standard deviations of deviations that are known, ``(m,)``.
        scale: What the inferred error is relative to, one number or ``(m,)``.
    """

    gaussian: bool = True
    name: str = ""
    discrepancy: str | None = None
    names: tuple[str, ...] | None = None
    bounds: Mapping[str, tuple[float, float]] = {}
    reads: Mapping[str, Variable] | None = None
    observed: Mapping[str, Floats] = {}
    error_sd: Mapping[str, Floats] = {}
    log_constants: Floats | float = 0.0
    separate: bool = True
    stated_sd: Floats | float = 0.0
    scale: Floats | float = 1.0

    def label(self, name: str, discrepancy: str | None = None) -> None:
        """Set the name, and the discrepancy as the only parameter that is read."""
        checks.text("name", name)
        if discrepancy is not None:
            checks.text("discrepancy", discrepancy)
        self.name, self.discrepancy = name, discrepancy
        self.names = () if discrepancy is None else (discrepancy,)
        self.bounds = dict.fromkeys(self.names, (0.0, np.inf))

    __repr__ = show_declared

    def __call__(self, parameters: Parameters, response: Response) -> Floats:
        """Return the log-likelihood of every parameter set, ``(n,)``."""
        return np.asarray(np.add.reduce(self._parts(parameters, response), axis=1))

    def deviations(
        self, parameters: Parameters, response: Response
    ) -> Deviations | None:
        """Return r and sd, ``(n, m)`` each; None if the term is not Gaussian.

        The log-likelihood is the sum of those of N(r; 0, sd), up to a constant.
        """
        return None

    def residuals(self, parameters: Parameters, response: Response) -> Residuals | None:
        """Return deviations over their standard deviations, by datum where possible.

        None if the term is not Gaussian. Where deviations are combinations of data, as
        with a covariance, each datum has its own standard deviation and residual.
        """
        pair = self.deviations(parameters, response)
        if pair is None:
            return None
        r, sd = map(np.asarray, pair)
        by_datum = independent = r / sd
        axes = np.eye(r.shape[1])
        # One row for each deviation: how it moves the data, which is linear.
        ends = None if self.separate else self.restore(np.vstack([0 * axes[:1], axes]))
        restored = None if ends is None else self.restore(r)
        if ends is not None and restored is not None:
            ends, restored = ends.reshape(len(ends), -1), restored.reshape(len(r), -1)
            by_datum = (restored - ends[0]) / np.sqrt(sd**2 @ (ends[1:] - ends[0]) ** 2)
        inferred = bool((np.ptp(sd, axis=0) > SAME_SD * sd[0]).any())
        return Residuals(independent, by_datum, inferred, {})

    def standard_deviations(self, parameters: Parameters) -> Floats | float:
        """Return the standard deviations, the stated and the inferred one together.

        They are ``(m,)``, or ``(n, m)`` if one is inferred.
        """
        if self.discrepancy is None:
            return self.stated_sd
        inferred = parameters[self.discrepancy][:, None] * self.scale
        variances = self.stated_sd**2 + inferred**2
        return np.asarray(np.sqrt(np.maximum(variances, LEAST_SD**2)))

    def constants(self, response: Response) -> Floats | float:
        """Return c, from which a response may subtract a penalty."""
        return self.log_constants

    def restore(self, deviations: Floats) -> Floats | None:
        """Return measurements ``(n, *shape)`` that have these deviations ``(n, m)``."""
        return None

    def _parts(self, parameters: Parameters, response: Response) -> Floats:
        """Return the log-likelihood of each deviation, ``(n, m)``."""
        pair = self.deviations(parameters, response)
        assert pair is not None
        values = log_normal(*pair)
        values += self.constants(response)
        return values

    def linearize(
        self, parameters: Parameters, response: Response, tangents: Batch, steps: Floats
    ) -> tuple[Floats, Floats | None]:
        """Return the gradient ``(n, d)`` along tangents, and scores ``(n, m, d)``.

        ``scores^T scores`` is the Fisher information; None if it is unknown.

        Args:
            parameters: The parameter sets.
            response: The model's response to them.
            tangents: Derivatives of variables and parameters in d directions.
            steps: Largest step along each direction that moves a parameter of the term,
                ``(n, d)``. Steps are smaller where the response would change by more
                than a small part of itself.
        """
        steps = self._choose_steps(parameters, response, tangents, steps)
        moved = move_along(parameters, response, tangents, steps)
        here = self.deviations(parameters, response)
        if here is None:
            return derive(self(*moved), steps)[:, 0], None
        slopes = [derive(part, steps) for part in self.deviations(*moved) or ()]
        return linearize_normal(*here, *slopes)

    def _choose_steps(
        self, parameters: Parameters, response: Response, tangents: Batch, steps: Floats
    ) -> Floats:
        """Return steps that change no variable by more than a small part of itself."""
        n, d = steps.shape
        read = parameters if self.names is None else self.names
        moved = np.zeros(d, dtype=bool)
        for name in tangents.keys() & read:
            moved |= (tangents[name] != 0).any(axis=0)
        chosen = np.where(moved, steps, np.inf)
        for name in tangents.keys() - parameters:
            largest = np.abs(read_variable(response, name)).reshape(n, -1).max(axis=1)
            slope = np.abs(tangents[name]).reshape(n, -1, d).max(axis=1)
            far = np.full((n, d), np.inf)
            relative = np.divide(largest[:, None], slope, out=far, where=slope > 0)
            chosen = np.minimum(chosen, RESPONSE_STEP * relative)
        return np.where(np.isfinite(chosen) & (chosen > 0), chosen, steps)

    def pointwise(self, parameters: Parameters, stored: Batch) -> Batch:
        """Return the log-likelihood of each datum, in the shape of the measurements.

        It is empty for deviations that do not belong to single data, as with a
        covariance, and for variables that are not stored.
        """
        if not (self.separate and self.observed and self._reads_only(stored)):
            return {}
        ((variable, measured),) = self.observed.items()
        values = self._parts(parameters, stored)
        if values[0].size != np.size(measured):
            return {}
        return {variable: values.reshape(-1, *np.shape(measured))}

    def replicate(
        self, rng: np.random.Generator, parameters: Parameters, stored: Batch
    ) -> Batch:
        """Return a new measurement for each sample, with all its errors.

        None if the term reads variables that are not stored, or cannot be drawn from.
        """
        readable = self.observed and self._reads_only(stored)
        pair = self.deviations(parameters, stored) if readable else None
        if pair is None:
            return {}
        r, sd = pair
        measured = self.restore(r + sd * rng.standard_normal(r.shape))
        return {} if measured is None else dict.fromkeys(self.observed, measured)

    def _reads_only(self, stored: Batch) -> bool:
        return set(self.reads or ()) <= set(stored)


class FunctionTerm(Term):
    """A user's own term: a callable and what it declares (contracts.py)."""

    def __init__(self, function: Callable[[Parameters, Response], Floats]) -> None:
        self.function = function
        name = read_declared(function, "name") or getattr(function, "__name__", "")
        self.name = "" if name == "<lambda>" else str(name)  # netCDF takes no brackets
        for attribute in DECLARED:
            if (declared := read_declared(function, attribute)) is not None:
                setattr(self, attribute, declared)
        self._deviations = read_declared(function, "deviations")
        self._restore = read_declared(function, "restore")
        self.gaussian = self._deviations is not None
        self.separate = self.gaussian and len(self.observed) == 1

    def __call__(self, parameters: Parameters, response: Response) -> Floats:
        """Return the callable's log-likelihood, ``(n,)``."""
        return self.function(parameters, response)

    def deviations(
        self, parameters: Parameters, response: Response
    ) -> Deviations | None:
        """Return the callable's deviations; None if it declares none."""
        return self._deviations(parameters, response) if self.gaussian else None

    def restore(self, deviations: Floats) -> Floats | None:
        """Return the callable's measurements; None if it declares no ``restore``."""
        if self._restore is None:
            return None
        measured = np.asarray(self._restore(deviations))
        for name, values in self.observed.items():
            expected = len(deviations), *np.shape(values)
            if measured.shape != expected:
                raise ValueError(
                    f"term {self.name}: restore(deviations) returned an array of "
                    f"shape {measured.shape}, expected {expected}, those of {name!r}"
                )
        return measured

    def replicate(
        self, rng: np.random.Generator, parameters: Parameters, stored: Batch
    ) -> Batch:
        """Return a new measurement for each sample, if they can be drawn.

        A callable whose deviations are the differences between the response and what
        was measured needs no ``restore``.
        """
        if self._restore or not (self.separate and self._reads_only(stored)):
            return super().replicate(rng, parameters, stored)
        ((name, measured),) = self.observed.items()
        u, (r, sd) = stored[name], self._deviations(parameters, stored)
        there = u.shape == (len(r), *np.shape(measured)) and u.size == r.size
        differences = (u - measured).reshape(len(r), -1) if there else np.nan
        # To a share of the error, since units may make all of these numbers tiny.
        if not (np.abs(np.abs(r) - np.abs(differences)) <= SAME_SD * sd).all():
            return {}
        noise = sd * rng.standard_normal(r.shape)
        return {name: u + noise.reshape(u.shape)}

    def _parts(self, parameters: Parameters, response: Response) -> Floats:
        values = super()._parts(parameters, response)
        constant = self(parameters, response) - values.sum(axis=1)
        return np.asarray(values + constant[:, None] / values.shape[1])


def as_term(term: Callable[[Parameters, Response], Floats]) -> Term:
    """Return a term of this package unchanged, and any other callable as one."""
    return term if isinstance(term, Term) else FunctionTerm(term)


def choose_error(
    errors: Mapping[str, ArrayLike | None], discrepancy: str | None, hint: str = ""
) -> tuple[str, ArrayLike]:
    """Return the name and value of the one measurement error; "" if there is none.

    Raises:
        TypeError: If there are several, or neither one nor a discrepancy.
    """
    there = {name: value for name, value in errors.items() if value is not None}
    if len(there) > 1 or not (there or discrepancy):
        raise TypeError(
            f"{', '.join(errors)}: expected exactly one of them{hint}, or, "
            f'for unknown noise, discrepancy="noise" alone, got {[*there] or "none"}'
        )
    return next(iter(there.items()), ("", 0.0))


def error_array(argument: str, value: ArrayLike, *shapes: tuple[int, ...]) -> Floats:
    """Return positive numbers: a single one, or an array of one of the shapes."""
    numbers = checks.positive_array(argument, value)
    checks.shaped(argument, numbers.shape, (), *shapes)
    if argument == "relative_sd" and numbers.max() > MOST_RELATIVE:
        got = f"got {numbers.max():g}; 0.02 is 2 %"
        raise ValueError(f"{argument}: expected at most {MOST_RELATIVE}, {got}")
    if argument == "beta" and numbers.min() < (least := MOST_RELATIVE**-2):
        got = f"got {numbers.min():g}; 2500 is an error of 2 %, {least:g} of 50 %"
        raise ValueError(f"{argument}: expected at least {least:g}, {got}")
    return numbers


def log_normal(r: Floats, sd: Floats) -> Floats:
    """Return the log densities of N(r; 0, sd), ``(n, m)``."""
    with np.errstate(over="ignore"):  # so far off the likelihood is zero
        values = r / sd
        values *= values
    values += 2.0 * np.log(sd) + np.log(2 * np.pi)
    values *= -0.5
    return values


def linearize_normal(
    r: Floats, sd: Floats, d_r: Floats, d_sd: Floats
) -> tuple[Floats, Floats]:
    r"""Return gradient ``(n, d)`` and scores of :math:`\sum_i \ln N(r_i; 0, \sigma_i)`.

    .. math:: \partial \ln N = -\frac{r}{\sigma} \frac{\partial r}{\sigma}
        + \left(\frac{r^2}{\sigma^2} - 1\right) \frac{\partial \sigma}{\sigma}, \qquad
        E[\partial_a \ln N \, \partial_b \ln N] = \frac{\partial_a r \partial_b r
        + 2 \partial_a \sigma \partial_b \sigma}{\sigma^2}

    Args:
        r: Deviations ``(n, m)``.
        sd: Their standard deviations ``(n, m)``.
        d_r: Derivatives of r, ``(n, m, d)``.
        d_sd: Derivatives of sd, ``(n, m, d)``.
    """
    standard = (r / sd)[:, :, None]
    scores, relative = d_r / sd[:, :, None], d_sd / sd[:, :, None]
    gradient: Floats = ((standard**2 - 1) * relative - standard * scores).sum(axis=1)
    if relative.any():
        scores = np.concatenate([scores, np.sqrt(2.0) * relative], axis=1)
    return gradient, scores


def derive(values: Values, steps: Floats) -> Values:
    """Return derivatives ``(n, m, d)`` from values at both sides.

    The values are ``(n * 2 d, ...)``.
    """
    n, d = steps.shape
    sides = np.asarray(values).reshape(n, 2, d, -1)
    slopes: Values = (sides[:, 0] - sides[:, 1]) / (2 * steps[:, :, None])
    return slopes.swapaxes(1, 2)


def move_along(
    parameters: Parameters, response: Response, tangents: Batch, steps: Floats
) -> tuple[dict[str, Floats], Response]:
    """Return parameters and response, ``n * 2 d`` of each, moved along the tangents.

    The order is that of parameter sets, then sides (+, -), then directions.
    """
    n, d = steps.shape
    sides = np.concatenate([steps, -steps], axis=1)  # (n, 2 d)

    def shift(value: Floats, tangent: Floats) -> Floats:
        wide = np.moveaxis(np.concatenate([tangent, tangent], axis=-1), -1, 1)
        moved = wide * sides.reshape(*sides.shape, *[1] * (wide.ndim - 2))
        moved += np.asarray(value)[:, None]
        return np.asarray(moved.reshape(-1, *wide.shape[2:]))

    variables = {
        name: shift(read_variable(response, name), tangent)
        for name, tangent in tangents.items()
        if name not in parameters
    }
    there = {name: shift(parameters[name], tangents[name]) for name in parameters}
    return there, _replace(response, variables, n, 2 * d)


def _replace(response: Response, shifted: Batch, n: int, times: int) -> Response:
    """Return a response with some variables replaced; the others are repeated."""

    def move(name: str, value: Response) -> Response:
        if name in shifted:
            return shifted[name]
        by_row = isinstance(value, np.ndarray) and value.ndim and len(value) == n
        return np.repeat(value, times, axis=0) if by_row else value

    if isinstance(response, Mapping):
        return {k: move(k, v) for k, v in response.items()} | dict(shifted)
    if "frequency" in shifted:  # the field of modal solutions
        shifted = {**shifted, "frequencies": shifted["frequency"]}
    named = isinstance(response, tuple)
    fields = response._asdict() if named else vars(response)
    moved = {name: move(name, value) for name, value in fields.items()}
    if named:
        return response._replace(**moved)
    other = copy(response)
    vars(other).update(moved)  # of a frozen one, too
    return other
