"""The samples that a figure of parameters shows."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..interfaces import Floats
from ..results.arviz_objects import samples


def changing_draws(
    idata: Any, var_names: Sequence[str] | None
) -> tuple[list[str], Floats]:
    """Return names and draws ``(n, d)``, refusing a parameter that never changes."""
    names, chains = samples(idata, var_names)
    draws = chains.reshape(-1, len(names))
    for name, column in zip(names, draws.T, strict=True):
        if np.ptp(column) == 0:
            raise ValueError(f"idata: every sample of {name!r} is {column[0]:g}")
    return names, draws
