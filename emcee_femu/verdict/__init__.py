"""The verdict on chains: their numbers, and what speaks against them.

A run ends by it. Whether the model fits the data is judged in results.
"""
