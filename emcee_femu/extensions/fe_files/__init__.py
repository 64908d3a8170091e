"""Matrices that FE programs export: one file per format, and their DOFs by name."""
