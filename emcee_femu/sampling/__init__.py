"""A run: its arguments, samplers, steps and end; search and verdict lie below it."""
