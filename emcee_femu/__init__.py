"""Bayesian updating of finite element models with emcee."""
