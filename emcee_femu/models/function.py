"""Any Python callable or external solver as a model, and a bare log-likelihood too."""

import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Self, TypeAlias

import numpy as np

from .. import checks
from ..contracts import (
    Derivatives,
    Floats,
    ModalSolution,
    Parameters,
    Response,
    SolveError,
    Variable,
    gather_tangents,
    modal_variables,
    placed,
    show_declared,
)

# Of a dict, so that functions that say dict and those that say Mapping both fit.
Function: TypeAlias = Callable[[dict[str, float]], Response]
Arrays: TypeAlias = dict[str, Floats]  # by the name of a variable or parameter

DENSITY = "log_likelihood"  # the variable that is what a DensityModel was given
UNSTORED = Variable({}, stored=False)


class FunctionModel:
    """A Python function of one parameter set as a model; it may start any solver.

    Use it for an external FE program, or for a model of your own. The function is
    called once per parameter set. If a call takes milliseconds or more, use several
    processes: ``run(..., workers=8)``. If the program may hang, set a time limit where
    you start it: ``subprocess.run(..., timeout=600)``; its ``TimeoutExpired`` counts as
    a failed solve.

    Args:
        function: A function from ``{name: float}`` to natural frequencies in Hz,
            ``(n_modes,)``; to a :class:`ModalSolution` of ``(n_modes,)`` and
            ``(n_dof, n_modes)``; or, with ``variables``, to ``{name: array}``, or just
            the array if there is only one variable.
        n_modes: Number of frequencies that the function returns. By default it is the
            number that the likelihood terms compare.
        variables: What the function returns instead of modes, ``{name: Variable}``.
        jacobian: A function of the same ``{name: float}`` that returns a pair: the
            result of ``function``, and its derivatives
            ``{variable: {parameter: array}}``; for modes, the variables are
            "frequency" and "shapes". Omitted derivatives are zero. None to use finite
            differences.

    Raises:
        TypeError: If function or jacobian is not callable, or n_modes and variables are
            both given.
        ValueError: When called, if the function returns anything else; the message
            gives the parameters.

    Examples:
        >>> import numpy as np
        >>> from emcee_femu import FunctionModel
        >>> model = FunctionModel(lambda p: [np.sqrt(p["k"] / p["m"]) / (2 * np.pi)])
        >>> model({"k": np.array([40.0]), "m": np.array([0.1])}).frequencies.round(3)
        array([[3.183]])
    """

    one_by_one = True

    def __init__(
        self,
        function: Function,
        n_modes: int | None = None,
        variables: Mapping[str, Variable] | None = None,
        *,
        jacobian: Function | None = None,
    ) -> None:
        checks.function("function", function)
        checks.function("jacobian", function if jacobian is None else jacobian)
        self._is_modal = variables is None
        if n_modes is not None:
            if variables is not None:
                raise TypeError("variables: expected them or n_modes, got both")
            count = checks.whole_number("n_modes", n_modes, 1)
            # Whether there are shapes, and where, is not known.
            variables = modal_variables(count) | {"shapes": UNSTORED}
        elif variables is not None:
            by_name = checks.by_label("variables", variables, "a Variable")
            for name, variable in by_name.items():
                checks.instance(f"variables[{name!r}]", variable, Variable)
        self.function, self.n_modes, self.variables = function, n_modes, variables
        self._jacobian = jacobian

    __repr__ = show_declared

    def __call__(self, parameters: Parameters) -> Response:
        """Call the function for each parameter set and stack the results."""
        return self._solve(parameters, self.function)[0]

    @property
    def jacobian(self) -> Callable[[Parameters], tuple[Response, Derivatives]] | None:
        """A function that returns response and derivatives of a batch, or None."""
        if self._jacobian is None:
            return None
        return partial(self._solve, function=self._jacobian, is_pair=True)

    def _solve(
        self, parameters: Parameters, function: Function, is_pair: bool = False
    ) -> tuple[Response, Derivatives]:
        """Call a function for each parameter set; stack its results and derivatives."""
        values, n = checks.batch(parameters)
        names, rows, tangents = [*values], list[Arrays](), list[Arrays]()
        form = "what function returns, and {variable: {parameter: array}}"
        for i in range(n):
            row = {name: float(value[i]) for name, value in values.items()}
            with placed(row, names):
                try:
                    result = function(dict(row))
                    slopes: dict[str, Arrays] = {}
                    if is_pair:
                        result, slopes = checks.group("jacobian", result, form, 2)
                    rows.append(self._read(result))
                    tangents.append(gather_tangents("jacobian", rows[i], slopes, names))
                except TypeError as error:
                    error.add_note(f"the function is given one dict, of {names}")
                    raise
                first = {name: array.shape for name, array in rows[0].items()}
                _check_shapes("function", rows[i], first)
        response = {name: np.array([row[name] for row in rows]) for name in rows[0]}
        derivatives: Derivatives = {}
        for name in dict.fromkeys(name for each in tangents for name in each):
            none = np.zeros((*first[name], len(names)))
            every = np.array([each.get(name, none) for each in tangents])
            derivatives[name] = dict(zip(names, np.moveaxis(every, -1, 0), strict=True))
        if self._is_modal:
            modes = ModalSolution(response["frequency"], response.get("shapes"))
            return modes, derivatives
        return response, derivatives

    def _read(self, result: Response) -> Arrays:
        """Return one response by variable, checked."""
        declared = {} if self.variables is None else self.variables
        if isinstance(result, ModalSolution):
            shapes = {} if result.shapes is None else {"shapes": result.shapes}
            result = {"frequency": result.frequencies} | shapes
        elif self._is_modal or not isinstance(result, Mapping):
            result = {next(iter(declared), "frequency"): result}
        try:
            response = {
                name: checks.numeric_array(f"function ({name})", result[name])
                for name in declared or ("frequency", "shapes")
                if name in result
            }
        except (TypeError, ValueError) as error:
            if self._is_modal:
                error.add_note("return frequencies, or ef.ModalSolution(f, shapes)")
            raise
        expected = {name: variable.shape for name, variable in declared.items()}
        if self._is_modal:
            count = self.n_modes or response["frequency"].size
            expected = {"frequency": (count,)}
            if "shapes" in response:
                expected["shapes"] = (*response["shapes"].shape[:1], count)
        _check_shapes("function", response, expected)
        return response


def _check_shapes(
    label: str, arrays: Arrays, expected: Mapping[str, tuple[int, ...]]
) -> None:
    shapes = {name: array.shape for name, array in arrays.items()}
    if shapes != expected:
        raise SolveError(
            "wrong shape", f"{label}: expected arrays of shape {expected}, got {shapes}"
        )


@dataclass(frozen=True, eq=False)
class DensityModel:
    """A log-likelihood as emcee takes one, in place of a model; its blobs are stored.

    Attributes:
        call: From ``(d,)``, or from ``(n, d)`` with vectorize, to a number for each
            point, or to a number and blobs.
        names: The parameters, in the order of the array.
        vectorize: Whether it takes all points at once.
        args: Its further arguments.
        kwargs: The same by name.
        variables: What its response holds: the log-likelihood, and each blob.
    """

    call: Callable[..., object]
    names: tuple[str, ...]
    vectorize: bool
    args: Sequence[object]
    kwargs: Mapping[str, object]
    variables: dict[str, Variable] = field(default_factory=dict)

    __repr__ = show_declared

    def __post_init__(self) -> None:
        """Check the arguments."""
        checks.function(DENSITY, self.call)
        if not isinstance(self.args, list | tuple):
            raise TypeError(f"args: expected a tuple, as (data,), got {self.args!r}")
        checks.mapping("kwargs", self.kwargs, "{name: value}")
        checks.flag("vectorize", self.vectorize)
        try:
            inspect.signature(self.call).bind(np.nan, *self.args, **self.kwargs)
        except TypeError as error:
            raise TypeError(
                f"{DENSITY}: it is called with one array, its parameters in the order "
                f"of {[*self.names]}, then args and kwargs, as emcee does: {error}; "
                "give what it needs besides as args= or kwargs=, or write lambda "
                "theta: f(*theta) for a function f of single numbers"
            ) from None
        except ValueError:  # a compiled function without a signature
            pass

    def declare_blobs(self, points: Floats) -> Self:
        """Return the model with the blobs that it returns at a possible point.

        Raises:
            ValueError: If it is finite at none of the points.
        """
        rows = (self._ask(point[None])[0] for point in points)
        row = next((row for row in rows if np.isfinite(row[DENSITY])), None)
        if row is None:
            raise ValueError(
                f"{DENSITY}: expected a finite number at some of {len(points)} draws "
                "of the prior, got NaN, inf or -inf at all; narrow the prior to where "
                "it is finite, or correct the function"
            )
        variables = {}
        for name, blob in row.items():
            dims = enumerate(blob.shape)
            variables[name] = Variable({f"{name}_dim_{i}": range(n) for i, n in dims})
        return replace(self, variables=variables | {DENSITY: UNSTORED})

    @property
    def one_by_one(self) -> bool:
        """Whether it takes one point after another."""
        return not self.vectorize

    def __call__(self, parameters: Parameters) -> Response:
        """Return log-likelihoods ``(n,)``, and blobs, of NaN where it is -inf."""
        rows = self._ask(np.stack([parameters[n] for n in self.names], axis=1))
        shapes = {name: variable.shape for name, variable in self.variables.items()}
        for row in rows:
            if np.isfinite(row[DENSITY]):
                _check_shapes(DENSITY, row, shapes)
        absent = {name: np.full(shape, np.nan) for name, shape in shapes.items()}
        return {k: np.array([row.get(k, absent[k]) for row in rows]) for k in shapes}

    @staticmethod
    def density(parameters: Parameters, response: Response) -> Floats:
        """Return the log-likelihoods ``(n,)`` in a response: the term of this model."""
        return np.asarray(response[DENSITY])

    def _ask(self, theta: Floats) -> list[Arrays]:
        """Return log-likelihood and blobs at each of ``theta (n, d)``."""
        if not self.vectorize:
            rows = []
            for point in theta:
                place = dict(zip(self.names, point.tolist(), strict=True))
                with placed(place, self.names):
                    result = self._call(point)
                    if isinstance(result, np.ndarray) and result.size > 1:
                        raise SolveError(
                            "wrong shape",
                            f"{DENSITY}: expected a number, or a tuple of a number and "
                            f"blobs, got an array of shape {result.shape}; sum it, or "
                            "return a tuple",
                        )
                    rows.append(_read_density(result))
            return rows
        results = self._call(theta)
        rows = [*results] if np.iterable(results) else []
        if len(rows) != len(theta):
            raise SolveError(
                "wrong shape",
                f"{DENSITY}: expected {len(theta)} numbers, or rows of a number and "
                f"blobs, got {results!r}; leave vectorize out for a function of one "
                "point",
            )
        return [_read_density(row) for row in rows]

    def _call(self, theta: Floats) -> object:
        """Return what the function does; note on an error what it was given."""
        try:
            return self.call(theta, *self.args, **self.kwargs)
        except (IndexError, TypeError, ValueError) as error:
            remedy = "with vectorize=True it is given all points at once, (n, d)"
            if self.vectorize:
                remedy = "without vectorize it is given one point at a time, (d,)"
            error.add_note(
                f"{DENSITY}: the function was given an array of shape {theta.shape}, "
                f"whose {len(self.names)} parameters are the names of the prior, "
                f"{[*self.names]}; {remedy}"
            )
            raise


def _read_density(result: Response) -> Arrays:
    """Return a log-likelihood by name, and its blobs where it is finite, as emcee."""
    try:
        value, *blobs = result
    except (TypeError, ValueError):  # one number has no length
        value, blobs = result, []
    row = {DENSITY: checks.numeric_array(DENSITY, value)}
    checks.shaped(DENSITY, row[DENSITY].shape, (), (1,))
    row[DENSITY] = row[DENSITY].reshape(())
    for i, blob in enumerate(blobs if np.isfinite(row[DENSITY]) else ()):
        row[f"blob{i}"] = checks.numeric_array(f"{DENSITY} (its blob {i})", blob)
    return row
