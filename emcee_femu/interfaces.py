"""The contracts between the stages, and the record that they pass.

Everything between the sampler and the model carries a leading walker axis of length
``n``. Outside the sampler parameters have names; the prior alone owns their order.

Three optional attributes let a model be checked before the first FE solve:
``names`` (the parameters that it reads), ``n_modes`` (the frequencies that it returns)
and ``positive`` (the parameters that must stay above zero). Two do so for a term:
``n_modes`` (the frequencies that it compares) and ``names`` (the parameters that it
reads).
"""

from collections.abc import Mapping
from typing import NamedTuple, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

Floats: TypeAlias = NDArray[np.float64]
Parameters: TypeAlias = Mapping[str, Floats]


class ModalSolution(NamedTuple):
    """The lowest natural frequencies, and mode shapes where they were asked for.

    Attributes:
        frequencies: Natural frequencies in Hz, ascending, ``(n, n_modes)``.
        shapes: Mode shapes ``(n, n_dof, n_modes)``, mass-normalised where the model
            can, or None.
    """

    frequencies: Floats
    shapes: Floats | None = None


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
