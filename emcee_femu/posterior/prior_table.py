"""A prior as a table: laws and bounds."""

from typing import Any

import numpy as np

from ..interfaces import Prior
from ..table import Table


def tabulate_prior(title: str, prior: Prior) -> Table:
    """Return names and bounds of any prior, and the laws of those of this package."""
    columns: list[tuple[str, str, Any]] = [("parameter", "", list(prior.names))]
    laws = getattr(prior, "_laws", None)
    if laws is not None:
        columns.append(("prior", "", laws))
    low, high = np.transpose(prior.bounds)
    columns += [("lower", ".4g", low), ("upper", ".4g", high)]
    return Table.from_columns(title, columns)


def say(law: Any) -> str:
    """Write a frozen distribution as scipy does: its name and arguments."""
    law = getattr(law, "marginal", law)  # of one that is cut
    kind = getattr(law, "dist", law)
    given = [f"{value:.4g}" for value in getattr(law, "args", ())]
    given += [f"{key}={value:.4g}" for key, value in getattr(law, "kwds", {}).items()]
    return f"{getattr(kind, 'name', type(kind).__name__)}({', '.join(given)})"
