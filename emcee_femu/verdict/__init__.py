"""The verdict on chains: their numbers, and what speaks against them.

A run asks it; what data and model say of each other is judged in results.
"""
