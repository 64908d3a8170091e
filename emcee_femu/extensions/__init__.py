"""Subjects that few need: each knows the core only, and none another."""
