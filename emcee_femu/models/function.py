"""Any Python callable or external solver as a modal model."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from .. import checks
from ..interfaces import PLACE, ModalSolution, Parameters, SolveError


@dataclass(frozen=True)
class FunctionModel:
    """A function of one parameter set, called once a walker.

    A solver that takes milliseconds or more gains from a pool: give ``run`` or
    ``emcee.EnsembleSampler`` a ``pool=``; the function must then be importable (no
    lambda). A program that may hang gets its limit where it is started:
    ``subprocess.run(..., timeout=600)``, whose ``TimeoutExpired`` is a failed solve.

    Args:
        function: ``{name: float}`` to natural frequencies in Hz ``(n_modes,)``, or to
            a :class:`ModalSolution` of ``(n_modes,)`` and ``(n_dof, n_modes)``.
        n_modes: How many frequencies the function returns; None for as many as the
            likelihood terms compare.

    Raises:
        TypeError: If function is not callable.
        ValueError: When called, if the function returns anything else, naming the
            parameters.

    Example:
        >>> model = FunctionModel(lambda p: [np.sqrt(p["k"] / p["m"]) / (2 * np.pi)])
        >>> model({"k": np.array([40.0]), "m": np.array([0.1])}).frequencies.round(3)
        array([[3.183]])
    """

    function: Callable[[Mapping[str, float]], ArrayLike | ModalSolution]
    n_modes: int | None = None
    one_by_one: ClassVar[bool] = True

    def __post_init__(self) -> None:
        """Check the arguments."""
        if not callable(self.function):
            raise TypeError(f"function: expected a callable, got {self.function!r}")
        if self.n_modes is not None:
            checks.whole_number("n_modes", self.n_modes, 1)

    def __call__(self, parameters: Parameters) -> ModalSolution:
        """Call the function for each parameter set and stack the results."""
        parameters, n = checks.batch(parameters)
        for name, value in parameters.items():
            if not np.isfinite(value).all():
                raise ValueError(f"parameters[{name!r}]: expected finite, got {value}")
        solutions: list[ModalSolution] = []
        for i in range(n):
            values = {name: float(value[i]) for name, value in parameters.items()}
            solution = self._one(values)
            first = solutions[0] if solutions else solution
            if _sizes(solution) != _sizes(first):
                raise SolveError(
                    "wrong number of modes",
                    "function: expected frequencies (and shapes) as large as the "
                    f"first ones, {_sizes(first)}, got {_sizes(solution)} at {values}",
                )
            solutions.append(solution)
        shapes = [s.shapes for s in solutions if s.shapes is not None]
        return ModalSolution(
            np.array([solution.frequencies for solution in solutions]),
            np.array(shapes) if shapes else None,
        )

    def _one(self, values: dict[str, float]) -> ModalSolution:
        try:
            result: Any = self.function(dict(values))
        except (StopIteration, SystemExit) as error:  # see LogPosterior
            raise RuntimeError(f"function: it raised {error!r} at {values}") from error
        except Exception as error:
            error.add_note(f"{PLACE} {values}")
            raise
        if isinstance(result, ModalSolution):
            result, shapes = result
        else:
            shapes = None
        try:
            frequencies = checks.numeric_array("function", result)
            if shapes is not None:
                shapes = checks.real_array("function (shapes)", shapes, 2)
        except (TypeError, ValueError) as error:
            raise type(error)(f"{error}; at {values}") from None
        wanted = self.n_modes
        length = frequencies.size if wanted is None else wanted
        if frequencies.shape != (length,) or not length:
            count = "n_modes" if wanted is None else str(wanted)
            raise SolveError(
                "wrong number of modes",
                f"function: expected frequencies of shape ({count},), got "
                f"{frequencies.shape} at {values}",
            )
        if shapes is not None and shapes.shape[1] != length:
            raise ValueError(
                f"function: expected shapes of (n_dof, {length}), got {shapes.shape} "
                f"at {values}"
            )
        return ModalSolution(frequencies, shapes)


def _sizes(solution: ModalSolution) -> tuple[tuple[int, ...], ...]:
    return tuple(np.shape(part) for part in solution if part is not None)
