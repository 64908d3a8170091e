"""The contracts between the stages, and the record that they pass.

Everything between the sampler and the model carries a leading walker axis of length
``n``. Outside the sampler parameters have names; the prior alone owns their order.

Optional attributes let a model be checked before the first FE solve: ``names`` (the
parameters that it reads), ``required`` (those without which there is no model),
``n_modes`` (the frequencies that it returns), ``positive`` (the parameters that must
stay above zero), ``bounds`` (``{parameter: (low, high)}`` within which it holds) and
``paired`` (whether it returns a :class:`PairedSolution`). Two do so for a term:
``n_modes`` (the frequencies that it compares) and ``names`` (the parameters that it
reads).
"""

from collections.abc import Mapping
from typing import NamedTuple, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

Floats: TypeAlias = NDArray[np.float64]
Parameters: TypeAlias = Mapping[str, Floats]

PLACE = "raised by the model at"  # begins the note that names the parameters


class ModalSolution(NamedTuple):
    """The lowest natural frequencies, and mode shapes where they were asked for.

    Attributes:
        frequencies: Natural frequencies in Hz, ascending, ``(n, n_modes)``.
        shapes: Mode shapes ``(n, n_dof, n_modes)``, mass-normalised where the model
            can, or None.
    """

    frequencies: Floats
    shapes: Floats | None = None


class Pairing(NamedTuple):
    """Which mode of the model stands for which measured mode.

    Attributes:
        mac: Modal assurance criterion of every pair, ``(n, n_measured)``.
        model_modes: Numbers of the model's modes, 1 = the lowest, ``(n, n_measured)``.
        unpaired: Where the MAC is too low for the pair to mean much,
            ``(n, n_measured)``.
    """

    mac: Floats
    model_modes: NDArray[np.intp]
    unpaired: NDArray[np.bool_]


class PairedSolution(ModalSolution):
    """A modal solution in the order of the measured modes, at the sensors.

    Args:
        frequencies: Of the paired modes in Hz, ``(n, n_measured)``, in the order of the
            measured ones.
        shapes: Their shapes at the sensors, ``(n, n_sensors, n_measured)``.
        pairing: How they were paired.
    """

    pairing: Pairing

    def __new__(
        cls, frequencies: Floats, shapes: Floats, pairing: Pairing
    ) -> "PairedSolution":
        """Attach the pairing to the two fields."""
        solution = super().__new__(cls, frequencies, shapes)
        solution.pairing = pairing
        return solution


class ModalModel(Protocol):
    """Parameters to modal solution, for a batch of parameter sets."""

    def __call__(self, parameters: Parameters) -> ModalSolution:
        """Solve for every parameter set; each value has shape ``(n,)``."""


class LikelihoodTerm(Protocol):
    """One factor of the likelihood."""

    @property
    def name(self) -> str:
        """The label under which the log-likelihood of this term is stored."""

    def __call__(self, parameters: Parameters, modes: ModalSolution) -> Floats:
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


class SolveError(ValueError):
    """A solve that returned something other than finite frequencies.

    Args:
        cause: In two or three words, under which failures are counted.
        message: What was expected and what came.
    """

    def __init__(self, cause: str, message: str) -> None:
        """See the class."""
        super().__init__(cause, message)
        self.cause = cause

    def __str__(self) -> str:
        """Return the message alone."""
        return str(self.args[1])
