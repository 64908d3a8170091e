"""Any Python callable or external solver as a model."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from .. import checks
from ..interfaces import (
    PLACE,
    Floats,
    ModalSolution,
    Parameters,
    SolveError,
    Variable,
)


@dataclass(frozen=True)
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

    Raises:
        TypeError: If function is not callable, or n_modes and variables are both given.
        ValueError: When called, if the function returns anything else, naming the
            parameters.

    Example:
        >>> model = FunctionModel(lambda p: [np.sqrt(p["k"] / p["m"]) / (2 * np.pi)])
        >>> model({"k": np.array([40.0]), "m": np.array([0.1])}).frequencies.round(3)
        array([[3.183]])
    """

    function: Callable[[Mapping[str, float]], Any]
    n_modes: int | None = None
    variables: Mapping[str, Variable] | None = None
    one_by_one: ClassVar[bool] = True

    def __post_init__(self) -> None:
        """Check the arguments."""
        if not callable(self.function):
            raise TypeError(f"function: expected a callable, got {self.function!r}")
        if self.n_modes is not None:
            checks.whole_number("n_modes", self.n_modes, 1)
            if self.variables is not None:
                raise TypeError("variables: expected them or n_modes, got both")
        given = self.variables
        named = isinstance(given, Mapping) and len(given) > 0
        if given is not None and not (
            named and all(isinstance(v, Variable) for v in given.values())
        ):
            raise TypeError(f"variables: expected {{name: Variable}}, got {given!r}")

    def __call__(self, parameters: Parameters) -> Any:
        """Call the function for each parameter set and stack the results."""
        parameters, n = checks.batch(parameters)
        for name, value in parameters.items():
            if not np.isfinite(value).all():
                raise ValueError(f"parameters[{name!r}]: expected finite, got {value}")
        results: list[dict[str, Floats]] = []
        for i in range(n):
            values = {name: float(value[i]) for name, value in parameters.items()}
            result = self._call(values)
            sizes = _sizes(results[0] if results else result)
            if _sizes(result) != sizes:
                raise SolveError(
                    "wrong shape",
                    f"function: expected results as large as the first ones, {sizes}, "
                    f"got {_sizes(result)} at {values}",
                )
            results.append(result)
        names = list(results[0]) if results else []
        stacked = {name: np.array([one[name] for one in results]) for name in names}
        return ModalSolution(**stacked) if self.variables is None else stacked

    def _call(self, values: dict[str, float]) -> dict[str, Floats]:
        try:
            result = self.function(dict(values))
        except (StopIteration, SystemExit) as error:  # see Experiment
            raise RuntimeError(f"function: it raised {error!r} at {values}") from error
        except Exception as error:
            error.add_note(f"{PLACE} {values}")
            raise
        try:
            return self._read(result)
        except SolveError as error:
            raise SolveError(error.cause, f"{error}; at {values}") from None
        except (TypeError, ValueError) as error:
            raise type(error)(f"{error}; at {values}") from None

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


def _sizes(result: Mapping[str, Floats]) -> dict[str, tuple[int, ...]]:
    return {name: value.shape for name, value in result.items()}
