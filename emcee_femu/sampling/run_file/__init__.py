"""A file of a run that a kill at any moment leaves usable."""

from .backend import RunFile as RunFile
