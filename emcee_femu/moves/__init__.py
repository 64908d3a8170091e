"""Proposals: each a plain emcee Move, usable in any ``emcee.EnsembleSampler``."""

from ..extensions.tempering import TemperedMove as TemperedMove
from .delayed_acceptance import DelayedAcceptanceMove as DelayedAcceptanceMove
from .demc import DEMCMove as DEMCMove
from .hamiltonian import HamiltonianMove as HamiltonianMove
from .independence import IndependenceMove as IndependenceMove
from .metropolis import MetropolisMove as MetropolisMove
