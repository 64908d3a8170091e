"""Stiffness and mass from FE programs: out of their files, or of models in Python."""
