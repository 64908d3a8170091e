"""Any Python callable or external solver as a model."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from .. import checks
from ..interfaces import (
    Floats,
    ModalSolution,
    Parameters,
    SolveError,
    Variable,
    add_place,
)


@dataclass(frozen=True, init=False)
class FunctionModel:
    """A function of one parameter set, called once per walker.

    A solver that takes milliseconds or more gains from processes: ``run(...,
    workers=8)``. A program that may hang gets its limit where it is started:
    ``subprocess.run(..., timeout=600)``, whose ``TimeoutExpired`` is a failed solve.

    Args:
        function: ``{name: float}`` to natural frequencies in Hz ``(n_modes,)``; or to a
            :class:`ModalSolution` of ``(n_modes,)`` and ``(n_dof, n_modes)``; or, with
            ``variables``, to ``{name: array}``, or only the array if there is one.
        n_modes: How many frequencies the function returns; None for as many as the
            likelihood terms compare.
        variables: What the function returns instead of modes, ``{name: Variable}``.
        jacobian: A function of the same ``{name: float}`` to a pair: what ``function``
            returns, and its derivatives ``{variable: {parameter: array}}``, of
            "frequency" and "shapes" if these are modes; a parameter that is left out
            changes nothing. None for finite differences.

    Raises:
        TypeError: If function or jacobian is not callable, or n_modes and variables are
            both given.
        ValueError: When called, if the function returns anything else, naming the
            parameters.

    Examples:
        >>> import numpy as np
        >>> from emcee_femu import FunctionModel
        >>> model = FunctionModel(lambda p: [np.sqrt(p["k"] / p["m"]) / (2 * np.pi)])
        >>> model({"k": np.array([40.0]), "m": np.array([0.1])}).frequencies.round(3)
        array([[3.183]])
    """

    function: Callable[[Mapping[str, float]], Any]
    n_modes: int | None
    variables: Mapping[str, Variable] | None
    _jacobian: Callable[[Mapping[str, float]], Any] | None = field(repr=False)
    one_by_one: ClassVar[bool] = True

    def __init__(
        self,
        function: Callable[[Mapping[str, float]], Any],
        n_modes: int | None = None,
        variables: Mapping[str, Variable] | None = None,
        *,
        jacobian: Callable[[Mapping[str, float]], Any] | None = None,
    ) -> None:
        for label, given in (("function", function), ("jacobian", jacobian)):
            if not callable(given) and not (label == "jacobian" and given is None):
                raise TypeError(f"{label}: expected a callable, got {given!r}")
        if n_modes is not None:
            checks.whole_number("n_modes", n_modes, 1)
            if variables is not None:
                raise TypeError("variables: expected them or n_modes, got both")
        named = isinstance(variables, Mapping) and len(variables) > 0
        if variables is not None and not (
            named and all(isinstance(v, Variable) for v in variables.values())
        ):
            raise TypeError(
                f"variables: expected {{name: Variable}}, got {variables!r}"
            )
        checks.set_fields(self, function=function, n_modes=n_modes)
        checks.set_fields(self, variables=variables, _jacobian=jacobian)

    def __getattr__(self, attribute: str) -> Any:
        """Return ``jacobian`` where one was given (interfaces.py)."""
        if attribute == "jacobian" and self.__dict__.get("_jacobian") is not None:
            return self._derive
        raise AttributeError(attribute)

    def __call__(self, parameters: Parameters) -> Any:
        """Call the function for each parameter set and stack the results."""
        return self._stack(self._solve(parameters, self.function, self._read))

    def _derive(self, parameters: Parameters) -> tuple[Any, dict[str, Any]]:
        """Return the response and its derivatives, ``jacobian`` of interfaces.py."""
        found = self._solve(parameters, self._jacobian, self._read_derivatives)
        names = [name for name in found[0] if isinstance(name, str)] if found else []
        response = self._stack([{name: one[name] for name in names} for one in found])
        derivatives: dict[str, Any] = {}
        for key in found[0] if found else ():
            if not isinstance(key, str):
                own = derivatives.setdefault(key[0], {})
                if key[1] is not None:
                    own[key[1]] = np.array([one[key] for one in found])
        return response, derivatives

    def _solve(
        self, parameters: Parameters, function: Any, read: Callable[[Any], Any]
    ) -> list[dict[Any, Floats]]:
        """Call a function for each parameter set; all results are as large."""
        parameters, n = checks.batch(parameters)
        for name, value in parameters.items():
            if not np.isfinite(value).all():
                raise ValueError(f"parameters[{name!r}]: expected finite, got {value}")
        results: list[dict[Any, Floats]] = []
        for i in range(n):
            values = {name: float(value[i]) for name, value in parameters.items()}
            result = _call(function, values, read)
            sizes = _sizes(results[0] if results else result)
            if _sizes(result) != sizes:
                raise SolveError(
                    "wrong shape",
                    f"function: expected results as large as the first ones, {sizes}, "
                    f"got {_sizes(result)} at {values}",
                )
            results.append(result)
        return results

    def _stack(self, results: list[dict[Any, Floats]]) -> Any:
        names = list(results[0]) if results else []
        stacked = {name: np.array([one[name] for one in results]) for name in names}
        return ModalSolution(**stacked) if self.variables is None else stacked

    def _read(self, result: Any) -> dict[str, Floats]:
        """Return one result by name, checked."""
        if self.variables is not None:
            return _read_variables(result, self.variables)
        shapes = None
        if isinstance(result, ModalSolution):
            result, shapes = result
        frequencies = checks.numeric_array("function", result)
        length = frequencies.size if self.n_modes is None else self.n_modes
        if frequencies.shape != (length,) or not length:
            count = "n_modes" if self.n_modes is None else str(self.n_modes)
            raise SolveError(
                "wrong shape",
                f"function: expected frequencies of shape ({count},), got "
                f"{frequencies.shape}",
            )
        found = {"frequencies": frequencies}
        if shapes is not None:
            found["shapes"] = checks.real_array("function (shapes)", shapes, 2)
            if found["shapes"].shape[1] != length:
                raise ValueError(
                    f"function: expected shapes of (n_dof, {length}), got "
                    f"{found['shapes'].shape}"
                )
        return found

    def _read_derivatives(self, result: Any) -> dict[Any, Floats]:
        """Return a result, and its derivatives by ``(variable, parameter)``."""
        if (
            not isinstance(result, Sequence)
            or len(result) != 2
            or not isinstance(result[1], Mapping)
        ):
            raise TypeError(
                "jacobian: expected what function returns, and {variable: {parameter: "
                f"array}}, got {type(result).__name__}"
            )
        found: dict[Any, Floats] = {**self._read(result[0])}
        names = {"frequency" if name == "frequencies" else name: name for name in found}
        for variable, by_parameter in result[1].items():
            if variable not in names or not isinstance(by_parameter, Mapping):
                raise ValueError(
                    f"jacobian: expected {{parameter: array}} for each of {[*names]}, "
                    f"got {variable!r}: {by_parameter!r}"
                )
            shape = found[names[variable]].shape
            found[variable, None] = np.empty(0)  # said, even if nothing changes it
            for parameter, value in by_parameter.items():
                label = f"jacobian (d {variable} / d {parameter})"
                slope = checks.numeric_array(label, value)
                if slope.shape != shape:
                    raise SolveError(
                        "wrong shape", f"{label}: expected {shape}, got {slope.shape}"
                    )
                found[variable, parameter] = slope
        return found


def _call(
    function: Any,
    values: dict[str, float],
    read: Callable[[Any], dict[Any, Floats]],
) -> dict[Any, Floats]:
    """Return what a function gives for one parameter set, checked."""
    try:
        result = function(dict(values))
    except (StopIteration, SystemExit) as error:  # see Experiment
        raise RuntimeError(f"function: it raised {error!r} at {values}") from error
    except Exception as error:
        add_place(error, values, [*values])
        raise
    try:
        return read(result)
    except SolveError as error:
        raise SolveError(error.cause, f"{error}; at {values}") from None
    except (TypeError, ValueError) as error:
        raise type(error)(f"{error}; at {values}") from None


def _read_variables(
    result: Any, variables: Mapping[str, Variable]
) -> dict[str, Floats]:
    if isinstance(result, ModalSolution):
        result = {"frequency": result.frequencies, "shapes": result.shapes}
    if not isinstance(result, Mapping):
        if len(variables) > 1:
            raise TypeError(
                f"function: expected {{name: array}} of {list(variables)}, got "
                f"{type(result).__name__}"
            )
        result = {next(iter(variables)): result}
    missing = [name for name in variables if result.get(name) is None]
    if missing:
        raise TypeError(f"function: expected {list(variables)}, got no {missing}")
    found = {}
    for name, variable in variables.items():
        found[name] = checks.numeric_array(f"function ({name})", result[name])
        if found[name].shape != variable.shape:
            raise SolveError(
                "wrong shape",
                f"function: expected {name!r} of shape {variable.shape}, got "
                f"{found[name].shape}",
            )
    return found


def _sizes(result: Mapping[Any, Floats]) -> dict[Any, tuple[int, ...]]:
    return {name: value.shape for name, value in result.items()}
