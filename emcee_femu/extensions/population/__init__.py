"""Many tests of one structure: what its parameters have in common, and their spread."""

from .normal import NormalPopulation as NormalPopulation
