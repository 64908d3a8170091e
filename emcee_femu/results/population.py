"""An annealed population in the form of a run, for the conversion to ArviZ."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import checks
from ..interfaces import Floats
from ..sampling.annealing import Annealed


class PopulationRun:
    """One walker whose steps are the members, in the order of their lineages.

    Args:
        population: What :func:`anneal` returned.
        discard: Must be 0.
        thin: Must be 1.

    Raises:
        ValueError: If discard or thin is another.
    """

    nwalkers = 1
    seed = "unknown (annealed)"
    population = True

    def __init__(self, population: Annealed, discard: int, thin: int) -> None:
        if checks.whole_number("discard", discard) or (
            checks.whole_number("thin", thin, 1) > 1
        ):
            raise ValueError(
                "discard, thin: a population has no burn-in and no order to thin, "
                f"expected 0 and 1, got {discard} and {thin}"
            )
        self._theta, self._rows = population.theta, population.rows
        self.iteration = len(self._theta)
        share = float(population.acceptance[-1])
        self.accepted: NDArray[np.float64] = np.array([share * self.iteration])
        self.recipe = (
            f"annealed through {len(population.sweeps)} powers of the likelihood, "
            f"{population.solves} solves"
        )

    def get_chain(self, **_: Any) -> Floats:
        """Return the members, ``(size, 1, d)``."""
        return self._theta[:, None]

    def get_log_prob(self, **_: Any) -> Floats:
        """Return the log-posterior, ``(size, 1)``."""
        return self._rows[:, :1]

    def get_blobs(self, **_: Any) -> Floats:
        """Return the rest of the rows, ``(size, 1, columns - 1)``."""
        return self._rows[:, None, 1:]
