"""Parameter sets and rows in words."""

from typing import Any

import numpy as np

from ..interfaces import Floats, SolveError

SHOWN = 8  # parameter sets of a batch in a message


def name_sets(names: tuple[str, ...], theta: Floats) -> Any:
    """Return parameter sets by name, and not all of many."""
    some = theta[:SHOWN].tolist()
    sets = [dict(zip(names, row, strict=True)) for row in some]
    rest = [f"{len(theta) - SHOWN} more"] if len(theta) > SHOWN else []
    return sets[0] if len(theta) == 1 else [*sets, *rest]


def not_finite(posterior: Any, rows: Floats, theta: Floats) -> SolveError:
    """Return the error that names the first row with NaN or infinity."""
    first = posterior.columns["densities"].stop
    wrong = ~(rows[:, 0] < np.inf) | ~np.isfinite(rows[:, first:]).all(axis=1)
    row = int(np.argmax(wrong))
    values = name_sets(posterior.names, theta[row : row + 1])
    numbers = rows[row].tolist()
    densities = dict(
        zip(("prior", *posterior.term_names), numbers[1:first], strict=True)
    )
    stored = {name: numbers[posterior.columns[name]] for name in posterior.variables}
    return SolveError(
        "not finite",
        f"the log-posterior is {numbers[0]} at {values}: log-densities "
        f"{densities}, {stored}; a model must return finite numbers, a term finite "
        "ones, or -inf to reject. If the parameters make no sense, give the prior "
        "bounds",
    )
