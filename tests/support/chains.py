"""Chains of which everything is known, as emcee stores them."""

import emcee
import numpy as np


def backend(chain, accepted=None, log_prob=None):
    """Return an emcee backend that holds ``chain (steps, walkers, d)``."""
    steps, walkers, d = chain.shape
    accepted = np.ones((steps, walkers), bool) if accepted is None else accepted
    log_prob = np.zeros((steps, walkers)) if log_prob is None else log_prob
    filled = emcee.backends.Backend()
    filled.reset(walkers, d)
    filled.grow(steps, None)
    for coords, values, moved in zip(chain, log_prob, accepted, strict=True):
        filled.save_step(emcee.State(coords, log_prob=values), moved)
    return filled


def ar1(phis, steps, walkers, seed, mean=0.0, sd=1.0):
    """Return stationary AR(1) chains ``(steps, walkers, d)``, one phi per parameter."""
    rng, phi = np.random.default_rng(seed), np.array(phis)
    chain = rng.normal(size=(steps, walkers, len(phi)))
    for i in range(1, steps):
        chain[i] = phi * chain[i - 1] + np.sqrt(1 - phi**2) * chain[i]
    return mean + sd * chain


def switching(share, stay, steps, walkers, seed):
    """Return ``(steps, walkers)`` of zeros and ones, ones for ``share`` of the time.

    Every walker draws anew with probability ``1 - stay``: tau is
    ``(1 + stay) / (1 - stay)``.
    """
    rng = np.random.default_rng(seed)
    states = rng.random((steps, walkers)) < share
    keep = rng.random((steps, walkers)) < stay
    for i in range(1, steps):
        states[i] = np.where(keep[i], states[i - 1], states[i])
    return states.astype(int)
