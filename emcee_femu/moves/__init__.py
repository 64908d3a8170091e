"""Proposals: each a plain emcee Move, usable in any ``emcee.EnsembleSampler``."""

from .demc import DEMCMove as DEMCMove
from .metropolis import MetropolisMove as MetropolisMove
