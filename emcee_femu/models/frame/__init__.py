"""Frames of three-dimensional beams."""
