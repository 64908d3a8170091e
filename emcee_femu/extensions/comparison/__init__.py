"""Comparison of moves on one posterior."""
