"""Stiffness and mass of models built in FE programs: one file per program."""
