"""Frames of bars: their stiffness and mass, and the two structures of the paper."""
