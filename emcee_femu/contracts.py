"""The contracts between the stages: model, response, term, prior, move.

Everything between sampler and model carries a leading axis of ``n`` walkers. Outside
the sampler parameters have names; only the prior owns their order. A plain function
is enough for a model or a term. What either may say of itself, so that it is checked
before the first FE solve, is optional:

========== ============= =============================================================
attribute  of            meaning
========== ============= =============================================================
variables  model         ``{name: Variable}``, what its response holds; those that are
                         ``stored`` go with each sample. Without it the terms' ``reads``
                         are stored.
names      model, term   the parameters that it needs; None or absent: of a model,
                         nobody knows
bounds     model, term   ``{parameter: (low, high)}`` within which it holds, of these
                         and of those that it reads where they are given; (0, inf):
                         it must stay above zero
jacobian   model         ``jacobian(parameters)``: the response and its derivatives,
                         ``{variable: {parameter: (n, *shape)}}``, from one solve; a
                         parameter that is left out changes nothing. None or absent:
                         no derivatives
spread     model         ``spread(parameters)``: the response, and how far it moves by
                         one standard deviation along each direction in which it is
                         uncertain, ``{variable: {direction: (n, *shape)}}``; the
                         likelihood is then averaged over them. None or absent: it is
                         certain
one_by_one model         True: it solves one parameter set after another, so that a
                         failure is known by itself
geometry   model         its ``Geometry``, for pictures of mode shapes
dofs       model         all its DOFs; nodes without any are supports in such pictures
name       term          the label under which its log-likelihood is stored
reads      term          ``{name: Variable}``, what it needs of the response
observed   term          ``{name: array}``, what was measured, by the name of a variable
deviations term          ``deviations(parameters, response)``: r and sd, each
                         ``(n, m)``, if the log-likelihood is, but for a constant,
                         the sum of those of N(r; 0, sd): then the Fisher information
                         is known
statement  term          for reports: the likelihood in a sentence; with ``formula``, in
                         HTML, and ``symbol``, that of an inferred error
state      move          ``state()``: what it remembers from one step to the next, as
                         JSON can hold it (numbers, texts, lists, mappings). Absent: its
                         proposals depend on the walkers and the random stream alone
restore    move          ``restore(state)``: go on from what ``state()`` returned, as of
                         a copy of the move as it was before the first step
========== ============= =============================================================

``parameters`` is ``{name: (n,)}``, and ``stored`` the stored variables of the response,
``{name: (n, ...)}``.
"""

from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

Floats: TypeAlias = NDArray[np.float64]
Parameters: TypeAlias = Mapping[str, Floats]
Batch: TypeAlias = Mapping[str, Floats]  # arrays (n, ...) by the name of a variable
# What a model returns: an object with its variables as attributes, or a mapping.
Response: TypeAlias = Any
Places: TypeAlias = Sequence[Any]  # labels along a dimension
# {variable: {parameter: (n, *shape)}}, of a model's jacobian
Derivatives: TypeAlias = dict[str, dict[str, Floats]]

WRAP = "a function of one parameter set becomes a model by FunctionModel(function)"
PLACED = "emcee_femu_place"  # attribute of an error whose parameters a note names


def add_place(error: BaseException, place: object, names: Sequence[str]) -> None:
    """Note where a model raised, and which names there are if it asked for another."""
    error.add_note(f"raised by the model at {place}")
    vars(error)[PLACED] = place
    wrong = error.args[:1] if isinstance(error, KeyError) else ()
    others = [name for name in wrong if isinstance(name, str) and name not in names]
    if others or any(name in range(len(names)) for name in wrong):  # as p[0] asks for
        error.add_note(f"the parameters are {', '.join(names)}, read by these names")


@dataclass(frozen=True)
class Variable:
    """A quantity of a response: dimensions and coordinates, as in xarray.

    Args:
        coords: ``{dimension: labels}``, in the order of the axes after that of the
            walkers; the number of labels is the length of the axis. Empty for a
            number, or for something unstored whose shape is not known beforehand.
        unit: For tables and figures.
        stored: Whether it is stored with each sample.

    Raises:
        TypeError: If an argument is of another type.

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
        labelled = isinstance(self.coords, Mapping) and all(
            hasattr(labels, "__len__") and not isinstance(labels, str)
            for labels in self.coords.values()
        )
        if not labelled:
            raise TypeError(f"coords: expected {{name: labels}}, got {self.coords!r}")
        if not isinstance(self.unit, str):
            raise TypeError(f"unit: expected text, got {self.unit!r}")
        if not isinstance(self.stored, bool):
            raise TypeError(f"stored: expected True or False, got {self.stored!r}")

    @property
    def dims(self) -> tuple[str, ...]:
        """The names of the dimensions."""
        return tuple(self.coords)

    @property
    def shape(self) -> tuple[int, ...]:
        """The shape for one parameter set."""
        return tuple(len(labels) for labels in self.coords.values())

    @property
    def size(self) -> int:
        """How many numbers it has for one parameter set."""
        return int(np.prod(self.shape, dtype=int))


def read(response: Response, name: str) -> Floats:
    """Return a variable of a response, which is an object or a mapping.

    Raises:
        TypeError: If the response has none of that name; it says what there is.
    """
    if isinstance(response, Mapping):
        value, has = response.get(name), list(response)
    elif isinstance(response, list | np.ndarray):
        raise TypeError(
            f"model: expected ModalSolution or {{name: array}} of many parameter sets, "
            f"got {type(response).__name__}; {WRAP}"
        )
    else:
        value = getattr(response, name, None)
        has = []
    if value is None:
        given = {k: getattr(response, k) for k in dir(response) if k[0] != "_"}
        has = has or [k for k, v in given.items() if isinstance(v, np.ndarray)]
        kind = type(response).__name__
        raise TypeError(f"model: its {kind} has no {name!r}; there are {has}")
    values: Floats = value
    return values


class Linearization(NamedTuple):
    """A log-posterior to second order, at ``n`` points.

    Attributes:
        rows: The rows of the posterior, ``(n, columns)``.
        gradient: Of the log-posterior, ``(n, d)``; NaN where a row is -inf.
        information: Fisher's of the likelihood minus the Hessian of the log-prior,
            ``(n, d, d)``; None where a term does not tell.
    """

    rows: Floats
    gradient: Floats
    information: Floats | None


class ModalSolution(NamedTuple):
    """The lowest natural frequencies, and mode shapes where they were asked for.

    Attributes:
        frequencies: Natural frequencies in Hz, ascending, ``(n, n_modes)``.
        shapes: Mode shapes ``(n, n_dof, n_modes)``, mass-normalised where the model
            can, or None.

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
        """The frequencies, under the name by which they are stored."""
        return self.frequencies


class PairedSolution(NamedTuple):
    """A modal solution in the order of the measured modes, at the sensors.

    Attributes:
        frequencies: Frequencies of the paired modes in Hz, ``(n, n_measured)``, in the
            order of the measured ones.
        shapes: Their shapes at the sensors, ``(n, n_sensors, n_measured)``.
        mac: Modal assurance criterion of every pair, ``(n, n_measured)``.
        model_mode: Numbers of the model's modes, 1 = the lowest, ``(n, n_measured)``.
        unpaired: Where the MAC is too low for the pair to mean much,
            ``(n, n_measured)``.

    Examples:
        >>> import numpy as np
        >>> from emcee_femu import MassSpringModel, Measurements, PairedModel
        >>> springs = {"k1": (0, 1, 10.0), "k2": (1, 2, 5.0)}
        >>> model = MassSpringModel([1.0, 1.0], springs, shapes=True)
        >>> measured = Measurements([0.66], shapes=[[1.9], [-1.0]])
        >>> solution = PairedModel(model, measured)({"k1": np.array([10.0])})
        >>> solution.model_mode.tolist(), solution.mac.round(2).tolist()
        ([[2]], [[0.99]])
    """

    frequencies: Floats
    shapes: Floats
    mac: Floats
    model_mode: NDArray[np.intp]
    unpaired: NDArray[np.bool_]

    @property
    def frequency(self) -> Floats:
        """The frequencies, under the name by which they are stored."""
        return self.frequencies


def modal_variables(n_modes: int, dofs: Places = ()) -> dict[str, Variable]:
    """Return what a model with modal solutions declares.

    Args:
        n_modes: Number of natural frequencies.
        dofs: Labels of the rows of the mode shapes; none if there are no shapes.

    Returns:
        ``frequency`` in Hz and, where there are dofs, ``shapes``, which are not stored.

    Raises:
        TypeError: If n_modes is not a whole number.

    Examples:
        >>> from emcee_femu import modal_variables
        >>> {name: v.shape for name, v in modal_variables(2, ["roof"]).items()}
        {'frequency': (2,), 'shapes': (1, 2)}
    """
    try:
        modes = range(1, n_modes + 1)
    except TypeError:
        raise TypeError(f"n_modes: expected a whole number, got {n_modes!r}") from None
    frequency = Variable({"mode": modes}, "Hz")
    shapes = Variable({"dof": dofs, "mode": modes}, stored=False)
    return {"frequency": frequency, **({"shapes": shapes} if len(dofs) else {})}


def read_declared(reader: object, attribute: str) -> Any:
    """Return what a model or a term says of itself, None if it says nothing.

    The attributes are those of the table on top of this file, and no others are read.
    """
    return getattr(reader, attribute, None)


def show_declared(stage: object) -> str:
    """Return a model or a term in one line, which is its repr."""
    names, parts = ", ".join(read_declared(stage, "names") or ()), []
    for of in ("variables", "reads"):
        for name, variable in (read_declared(stage, of) or {}).items():
            parts.append(f"{name} {list(variable.shape)}")
    words = type(stage).__name__ + f"({names})" * bool(names)
    return words + ": " * bool(parts) + ", ".join(parts)


class Model(Protocol):
    """Parameters to response, for a batch of parameter sets.

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
    """A proper prior; it owns the parameters' names, order and bounds."""

    @property
    def names(self) -> tuple[str, ...]:
        """The parameters' names, in the order of the vector ``theta``."""

    @property
    def bounds(self) -> Floats:
        """Lower and upper bounds, ``(d, 2)``; infinite where there is none."""

    def logpdf(self, theta: Floats) -> Floats:
        """Return the log density ``(n,)`` of ``theta (n, d)``, -inf out of bounds."""

    def sample(self, rng: np.random.Generator, n: int) -> Floats:
        """Draw ``(n, d)`` parameter sets, all inside the bounds."""


class Move(Protocol):
    """A proposal, as emcee takes it.

    Every ensemble has a copy of its own. In the file of a run, ``state()`` is kept with
    each step; a move that decides by more than that is refused there.
    """

    def propose(self, model: Any, state: Any) -> tuple[Any, NDArray[np.bool_]]:
        """Return the next state, and which walkers moved ``(nwalkers,)``."""


@dataclass(frozen=True)
class Reported:
    """What a result of an extension adds to a report, as its ``reported()`` returns it.

    Attributes:
        name: What a user calls such a result.
        source: The samples to report on: a run or an ArviZ object.
        title: Of a section in which the result prints itself; empty for none. Then the
            samples are not those of a model's own parameters, so that the report
            leaves the model out.
        measured: Sentences on what was measured.
        solved: A sentence on the evaluations, with "{}" for their number.
        figure: Its function of ``figures``, which draws the result; empty for none.
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
    """A solve that returned something other than finite numbers of the right shape.

    Args:
        cause: In two or three words, under which failures are counted.
        message: What was expected and what came.
    """

    def __init__(self, cause: str, message: str) -> None:
        super().__init__(cause, message)
        self.cause = cause

    def __str__(self) -> str:
        """Return only the message."""
        return str(self.args[1])


class RepeatedModes(ValueError):
    """Two modes coincide, and have no derivatives where they part.

    What a ``jacobian`` raises there. Climbs, ``run`` and ``find_map`` then take
    differences of the response, which there is.
    """


def gather_tangents(
    label: str,
    response: Response,
    derivatives: object,
    names: Sequence[Hashable],
    needed: Iterable[str] = (),
) -> dict[str, Floats]:
    """Return the derivatives of each variable, ``(n, *shape, d)``.

    Args:
        label: What returned them.
        response: The model's.
        derivatives: ``{variable: {name: (n, *shape)}}``; zero where one is left out.
        names: The d names that there are.
        needed: Variables that must be among them.

    Raises:
        TypeError: If derivatives is no mapping.
        ValueError: If it has another name, or lacks a variable.
        SolveError: If a derivative is not as large as its variable.
    """
    if not isinstance(derivatives, Mapping):
        raise TypeError(
            f"{label}: expected {{variable: {{parameter: array}}}}, got "
            f"{type(derivatives).__name__}"
        )
    if missing := {*needed} - {*derivatives}:
        raise ValueError(
            f"{label} returned no derivatives of {missing}; return {{variable: "
            "{parameter: array}}, {} for one that does not change"
        )
    tangents = {}
    for variable, by_name in derivatives.items():
        shape = np.shape(read(response, variable))
        tangents[variable] = tangent = np.zeros((*shape, len(names)))
        unknown = [name for name in by_name if name not in names]
        if unknown:
            raise ValueError(f"{label}: no parameter {unknown}; there are {[*names]}")
        for name, value in by_name.items():
            if np.shape(value) != shape:
                raise SolveError(
                    "wrong shape",
                    f"{label}: expected the derivative of {variable!r} by {name!r} of "
                    f"shape {shape}, got {np.shape(value)}",
                )
            tangent[..., names.index(name)] = value
    return tangents
