"""The contracts between the stages: model, response, term, prior, move, result.

Everything between sampler and model has a leading axis of ``n`` walkers. Outside the
sampler, parameters are addressed by name; only the prior defines their order. A plain
function is enough for a model or a term. The attributes below are optional; those that
are given are checked before the first FE solve:

=========== ============= =============================================================
attribute   of            meaning
=========== ============= =============================================================
variables   model         ``{name: Variable}``, the contents of its response; those that
                          are ``stored`` are kept with each sample. Without it
                          the terms' ``reads`` are stored.
names       model, term   the parameters that it needs; None or absent: unknown (of a
                          model)
bounds      model, term   ``{parameter: (low, high)}`` within which it is valid, for
                          these parameters and any others that it reads if given;
                          (0, inf) means positive
jacobian    model         ``jacobian(parameters)``: the response and its derivatives,
                          ``{variable: {parameter: (n, *shape)}}``, from one solve;
                          omitted derivatives are zero. None or absent: no derivatives
spread      model         ``spread(parameters)``: the response and its change by one
                          standard deviation along each direction in which it is
                          uncertain, ``{variable: {direction: (n, *shape)}}``; the
                          likelihood is then averaged over them. None or absent: no
                          uncertainty
one_by_one  model         True: it solves parameter sets one at a time, so that a failed
                          solve affects only its own set
geometry    model         its ``Geometry``, for drawings of mode shapes
dofs        model         all its DOFs; nodes without DOFs are drawn as supports
sensors     model         which combinations of ``dofs`` the rows of its shapes are
name        term          the label under which its log-likelihood is stored
reads       term          ``{name: Variable}``, the variables that it needs
observed    term          ``{name: array}``, the measured values by variable name
deviations  term          ``deviations(parameters, response)``: r and sd, each
                          ``(n, m)``, if the log-likelihood is the sum of those of
                          N(r; 0, sd) up to a constant; this gives the Fisher
                          information and the residuals by which the fit is judged,
                          by label too where m is the number of the data, or of the
                          labels along some of their axes
restore     term          ``restore(deviations)``: the measurements ``(n, *shape)`` that
                          have the deviations ``(n, m)``, so that new measurements
                          can be drawn; not needed if they are plain differences
error_sd    term          ``{name: array}``, the standard deviations of ``observed``
statement   term          for reports: the likelihood in one sentence
formula     term          for reports, in HTML: the likelihood as a formula
discrepancy term          which of ``names`` is an inferred error: reports name it, and
                          it is asked whether data fit by a large error only
symbol      term          for reports, in HTML: the symbol of this error
logpdfs     prior         ``logpdfs(theta)``: the log density of each parameter, ``(n,
                          d)``: drawn beside the posterior, stored as ``log_prior``
marginals   prior         ``{parameter: distribution}`` as of scipy.stats, frozen:
                          tables and reports name them, and their means are where a
                          run begins
state       move          ``state()``: its memory from one step to the next, as JSON
                          types (numbers, strings, lists, mappings). Absent: its
                          proposals depend only on the walkers and the random stream
restore     move          ``restore(state)``: continue from the result of ``state()``,
                          called on a copy of the move as it was before the first step
betas       move          the powers of the likelihood, the first 1, with which as many
                          equal blocks of walkers sample. Absent: all sample the
                          posterior
idata       result        its samples, an ArviZ object: it may be given in place of them
as_chains   result        ``as_chains()``: the same as ``Chains``
posterior   result        the ``LogPosterior`` that was sampled
reported    result        ``reported()``: what a report says of it, a ``Reported``
=========== ============= =============================================================

``parameters`` is ``{name: (n,)}``, and ``stored`` the stored variables of the response,
``{name: (n, ...)}``.
"""

from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence, Sized
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol, TypeAlias

import emcee
import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import checks

Floats: TypeAlias = checks.Floats
Parameters: TypeAlias = Mapping[str, Floats]
Batch: TypeAlias = Mapping[str, Floats]  # arrays (n, ...) by the name of a variable
# What a model returns: an object with its variables as attributes, or a mapping.
Response: TypeAlias = Any
Places: TypeAlias = Sequence[Hashable]  # labels along a dimension
# {variable: {parameter: (n, *shape)}}, of a model's jacobian
Derivatives: TypeAlias = dict[str, dict[str, Floats]]

# The columns that begin each row of a posterior, whatever the terms.
LOG_POSTERIOR = 0
LOG_PRIOR = 1

WRAP = "a function of one parameter set becomes a model by FunctionModel(function)"
PLACED = "emcee_femu_place"  # marks errors that already name their parameters


def add_place(error: BaseException, place: object, names: Sequence[str]) -> None:
    """Note where a model raised, and the known names if it asked for another."""
    error.add_note(f"raised by the model at {place}")
    vars(error)[PLACED] = place
    asked = error.args[:1] if isinstance(error, KeyError) else ()
    if any(name not in names for name in asked):  # another, or a number, as in p[0]
        error.add_note(f"the parameters are {', '.join(names)}, read by these names")


@contextmanager
def placed(place: object, names: Sequence[str]) -> Iterator[None]:
    """Note on an error inside where a model raised it: see :func:`add_place`."""
    try:
        yield
    except (Exception, SystemExit) as error:
        add_place(error, place, names)
        raise


@dataclass(frozen=True)
class Variable:
    """A quantity in a response: its dimensions and coordinates, as in xarray.

    Use it to declare what a :class:`FunctionModel` returns or what a term of your own
    reads.

    Args:
        coords: ``{dimension: labels}``, in the order of the axes after the walker axis;
            the number of labels is the length of the axis. Empty for a scalar, or for a
            variable that is not stored and whose shape is not known in advance.
        unit: The unit shown in tables and figures.
        stored: Whether the variable is stored with each sample.

    Raises:
        TypeError: If an argument has the wrong type.

    Examples:
        >>> from emcee_femu import Variable
        >>> Variable({"point": ["left", "middle", "right"]}, "m").shape
        (3,)
    """

    coords: Mapping[str, Places]
    unit: str = ""
    stored: bool = True

    def __post_init__(self) -> None:
        """Check the arguments."""
        for labels in checks.mapping("coords", self.coords, "{name: labels}").values():
            if isinstance(labels, str) or not isinstance(labels, Sized):
                raise TypeError(
                    f"coords: expected {{name: labels}}, got {self.coords!r}"
                )
        checks.instance("unit", self.unit, str)
        checks.flag("stored", self.stored)

    @property
    def dims(self) -> tuple[str, ...]:
        """The names of the dimensions."""
        return tuple(self.coords)

    @property
    def shape(self) -> tuple[int, ...]:
        """The shape for one parameter set, without the walker axis."""
        return tuple(len(labels) for labels in self.coords.values())

    @property
    def size(self) -> int:
        """The number of values for one parameter set."""
        return int(np.prod(self.shape, dtype=int))


def find(response: Response, name: str) -> Floats | None:
    """Return a variable of a response, which is an object or a mapping, or None."""
    is_mapping = isinstance(response, Mapping)
    return response.get(name) if is_mapping else getattr(response, name, None)


def read(response: Response, name: str) -> Floats:
    """Return a variable of a response, which is an object or a mapping.

    Raises:
        TypeError: If the response has no such variable; the message lists the others.
    """
    kind = type(response).__name__
    if isinstance(response, list | np.ndarray):
        raise TypeError(
            f"model: expected ModalSolution or {{name: array}} of many parameter sets, "
            f"got {kind}; {WRAP}"
        )
    if (value := find(response, name)) is not None:
        return value
    if isinstance(response, Mapping):
        has = list(response)
    else:
        there = [k for k in dir(response) if k[0] != "_"]
        has = [k for k in there if isinstance(find(response, k), np.ndarray)]
    raise TypeError(f"model: its {kind} has no {name!r}; there are {has}")


class Stored(dict[str, Floats]):
    """The stored variables of a response, read by key or as attributes.

    A term may read them as it reads what the model returns.
    """

    def __getattr__(self, name: str) -> Floats:
        """Return a variable, or the frequencies by the name of their field."""
        try:
            return self["frequency" if name == "frequencies" else name]
        except KeyError:
            raise AttributeError(f"no stored {name!r}; there are {[*self]}") from None


class Linearization(NamedTuple):
    """A log-posterior to second order at ``n`` points.

    Attributes:
        rows: The rows of the posterior, ``(n, columns)``.
        gradient: The gradient of the log-posterior, ``(n, d)``; NaN where a row is
            -inf.
        information: The Fisher information of the likelihood minus the Hessian of the
            log-prior, ``(n, d, d)``; None if a term does not provide it.
    """

    rows: Floats
    gradient: Floats
    information: Floats | None


class ModalSolution(NamedTuple):
    """The lowest natural frequencies and, if requested, the mode shapes.

    Models of this package return it, and the function of a :class:`FunctionModel` may
    return it to provide shapes as well.

    Attributes:
        frequencies: Natural frequencies in Hz, ascending, ``(n, n_modes)``.
        shapes: Mode shapes ``(n, n_dof, n_modes)``, mass-normalised if the model can do
            so, or None.

    Examples:
        >>> import numpy as np
        >>> from emcee_femu import FunctionModel, ModalSolution
        >>> def solve(p):
        ...     values, vectors = np.linalg.eigh([[p["k1"] + 5.0, -5.0], [-5.0, 5.0]])
        ...     return ModalSolution(np.sqrt(values) / (2 * np.pi), vectors)
        >>> FunctionModel(solve)({"k1": np.array([10.0, 40.0])}).shapes.shape
        (2, 2, 2)
    """

    frequencies: Floats
    shapes: Floats | None = None

    @property
    def frequency(self) -> Floats:
        """The frequencies, under the name with which they are stored."""
        return self.frequencies


class PairedSolution(NamedTuple):
    """A modal solution in the order of the measured modes, at the sensors.

    Attributes:
        frequencies: Frequencies of the paired modes in Hz, ``(n, n_measured)``, in the
            order of the measured modes.
        shapes: Their shapes at the sensors, ``(n, n_sensors, n_measured)``.
        mac: Modal assurance criterion of each pair, ``(n, n_measured)``.
        model_mode: Mode numbers of the model, 1 = the lowest, ``(n, n_measured)``.
        unpaired: Whether the MAC is too low for a meaningful pair,
            ``(n, n_measured)``.
    """

    frequencies: Floats
    shapes: Floats
    mac: Floats
    model_mode: NDArray[np.intp]
    unpaired: NDArray[np.bool_]

    @property
    def frequency(self) -> Floats:
        """The frequencies, under the name with which they are stored."""
        return self.frequencies


def modal_variables(n_modes: int, dofs: Places = ()) -> dict[str, Variable]:
    """Return the ``variables`` that a model with modal solutions declares.

    Use it for a model class of your own that returns a :class:`ModalSolution`.

    Args:
        n_modes: Number of natural frequencies.
        dofs: Labels of the rows of the mode shapes; empty if there are no shapes.

    Returns:
        ``frequency`` in Hz and, with dofs, ``shapes``, which are not stored.

    Raises:
        TypeError: If n_modes is not a whole number.

    Examples:
        >>> from emcee_femu import modal_variables
        >>> {name: v.shape for name, v in modal_variables(2, ["roof"]).items()}
        {'frequency': (2,), 'shapes': (1, 2)}
    """
    modes = range(1, checks.whole_number("n_modes", n_modes) + 1)
    frequency = Variable({"mode": modes}, "Hz")
    shapes = Variable({"dof": dofs, "mode": modes}, stored=False)
    return {"frequency": frequency, **({"shapes": shapes} if len(dofs) else {})}


def read_declared(reader: object, attribute: str) -> Any:
    """Return an attribute that one of the stages declares, or None.

    Only the attributes in the table at the top of this file are read.
    """
    return getattr(reader, attribute, None)


def show_declared(stage: object) -> str:
    """Return the one-line repr of a model or a term."""
    names, parts = ", ".join(read_declared(stage, "names") or ()), []
    for of in ("variables", "reads"):
        for name, variable in (read_declared(stage, of) or {}).items():
            parts.append(f"{name} {list(variable.shape)}")
    words = type(stage).__name__ + f"({names})" * bool(names)
    return words + ": " * bool(parts) + ", ".join(parts)


class Model(Protocol):
    """A map from parameters to response, for a batch of parameter sets.

    The response is an object with the declared variables as attributes, or a mapping
    with them as keys; each is an array ``(n, *shape)``.
    """

    def __call__(self, parameters: Parameters) -> Response:
        """Solve for every parameter set; each value has shape ``(n,)``."""


class LikelihoodTerm(Protocol):
    """One factor of the likelihood."""

    def __call__(self, parameters: Parameters, response: Response) -> Floats:
        """Return the log-likelihood of every parameter set, ``(n,)``."""


class Prior(Protocol):
    """A proper prior, which defines the parameters' names, order and bounds."""

    @property
    def names(self) -> tuple[str, ...]:
        """The parameters' names, in the order of the vector ``theta``."""

    @property
    def bounds(self) -> Floats:
        """Lower and upper bounds, ``(d, 2)``; infinite if there is none."""

    def logpdf(self, theta: Floats) -> Floats:
        """Return the log density ``(n,)`` of ``theta (n, d)``, -inf out of bounds."""

    def sample(self, rng: np.random.Generator, n: int) -> Floats:
        """Draw ``(n, d)`` parameter sets, all inside the bounds."""


class Move(Protocol):
    """A proposal with the interface of emcee's moves.

    Every ensemble has its own copy. A run's file stores ``state()`` with each step. A
    move that depends on anything else is refused if the run is stored.
    """

    def propose(
        self, model: emcee.model.Model, state: emcee.State
    ) -> tuple[emcee.State, NDArray[np.bool_]]:
        """Return the next state and which walkers moved, ``(nwalkers,)``."""


@dataclass(frozen=True)
class Reported:
    """What a result of an extension adds to a report; returned by its ``reported()``.

    Attributes:
        name: What a user calls such a result.
        source: The samples to report on: a run or an ArviZ object.
        title: Title of a section with the result as notebooks print it, by its
            ``_repr_html_()``; empty for none. A section means that the samples are not
            those of a model's own parameters, and the report leaves the model out.
        measured: Sentences about the measurements.
        solved: A sentence about the evaluations, with "{}" for their number.
        figure: The function of ``figures`` that draws the result; empty for none.
        caption: What the figure shows.
    """

    name: str
    source: object
    title: str = ""
    measured: tuple[str, ...] = ()
    solved: str = ""
    figure: str = ""
    caption: str = ""


class SolveError(ValueError):
    """A solve that did not return finite numbers of the right shape.

    Args:
        cause: Two or three words under which such failures are counted.
        message: What was expected and what was returned.
    """

    def __init__(self, cause: str, message: str) -> None:
        super().__init__(cause, message)
        self.cause = cause

    def __str__(self) -> str:
        """Return only the message."""
        return str(self.args[1])


class RepeatedModes(ValueError):
    """Two modes coincide and separate as a parameter changes: no derivatives exist.

    A ``jacobian`` raises it. Climbs, ``run`` and ``find_map`` then use differences of
    the response instead.
    """


def split_rows(rows: Floats) -> tuple[Floats, Floats]:
    """Return log-posteriors ``(n,)``, and what follows in each row, emcee's blobs."""
    return rows[:, LOG_POSTERIOR], rows[:, LOG_POSTERIOR + 1 :]


def gather_tangents(
    label: str,
    response: Response,
    derivatives: Mapping[str, Mapping[str, ArrayLike]],
    names: Sequence[Hashable],
    needed: Iterable[str] = (),
) -> dict[str, Floats]:
    """Return the derivatives of each variable, ``(n, *shape, d)``.

    Args:
        label: Name of the function that returned them, for messages.
        response: The model's response.
        derivatives: ``{variable: {name: (n, *shape)}}``; omitted ones are zero.
        names: The d names that exist.
        needed: Variables that must be included.

    Raises:
        TypeError: If derivatives is not a mapping.
        ValueError: If it has another name, or lacks a variable.
        SolveError: If a derivative does not have the size of its variable.
    """
    form = "{variable: {parameter: array}}"
    by_variable = checks.mapping(label, derivatives, form)
    if missing := {*needed} - {*by_variable}:
        raise ValueError(
            f"{label} returned no derivatives of {missing}; return {form}, {{}} for "
            "one that does not change"
        )
    tangents = {}
    for variable, by_name in by_variable.items():
        if find(response, variable) is None or not isinstance(by_name, Mapping):
            raise ValueError(
                f"{label}: expected {{parameter: array}} of variables of the response, "
                f"got {variable!r}: {by_name!r}"
            )
        shape = np.shape(read(response, variable))
        tangents[variable] = tangent = np.zeros((*shape, len(names)))
        if unknown := [name for name in by_name if name not in names]:
            raise ValueError(f"{label}: no parameter {unknown}; there are {[*names]}")
        for name, value in by_name.items():
            slope = np.asarray(value)
            if slope.shape != shape or slope.dtype.kind not in "fiu":
                raise SolveError(
                    "wrong shape",
                    f"{label}: expected the derivative of {variable!r} by {name!r} of "
                    f"shape {shape}, real, got {slope.shape} of {slope.dtype}",
                )
            tangent[..., names.index(name)] = slope
    return tangents
