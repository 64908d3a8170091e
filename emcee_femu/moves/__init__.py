"""Proposals; each is an emcee Move and works in any ``emcee.EnsembleSampler``."""

from typing import TYPE_CHECKING, Any

from .delayed_acceptance import DelayedAcceptanceMove as DelayedAcceptanceMove
from .demc import DEMCMove as DEMCMove
from .demc import MetropolisMove as MetropolisMove
from .hamiltonian import HamiltonianMove as HamiltonianMove
from .independence import IndependenceMove as IndependenceMove
from .proposing import ProposingMove as ProposingMove

if TYPE_CHECKING:
    from ..extensions.tempering import TemperedMove as TemperedMove


def __getattr__(name: str) -> Any:
    """Import the move of an extension when it is first asked for."""
    if name != "TemperedMove":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from ..extensions import tempering

    return tempering.TemperedMove


def __dir__() -> list[str]:
    """Return the public names, for completion also that of the extension."""
    return [n for n in (*globals(), "TemperedMove") if n.endswith(("Move", "__"))]
