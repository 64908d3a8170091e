"""Stiffness and mass out of the programs where a model stands: one file per program."""
