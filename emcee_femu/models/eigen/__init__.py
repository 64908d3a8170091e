"""Generalised eigenvalue problems, dense and sparse, for a batch."""
