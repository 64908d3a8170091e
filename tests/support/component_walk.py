"""The random walk of ``anneal``, which is no public move, for the tests of its law."""

from emcee_femu.moves.independence import ComponentWalk as ComponentWalk
