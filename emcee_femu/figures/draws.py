"""The samples that a figure of parameters shows, and what certified them."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..interfaces import Floats
from ..results.arviz_objects import describe_certificate, samples


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


def say_certified(figure: Any, idata: Any) -> None:
    """Write above a figure what :func:`certify` said of its samples, if it did."""
    text = describe_certificate(idata).strip(" ()")
    if text:
        figure.suptitle(f"{text[:1].upper()}{text[1:]}", fontsize=10)
