"""Chains of which everything is known, as emcee stores them."""

import emcee
import numpy as np


def backend(chain, accepted=None):
    """Return an emcee backend that holds ``chain (steps, walkers, d)``."""
    steps, walkers, d = chain.shape
    accepted = np.ones((steps, walkers), bool) if accepted is None else accepted
    filled = emcee.backends.Backend()
    filled.reset(walkers, d)
    filled.grow(steps, None)
    for coords, moved in zip(chain, accepted, strict=True):
        filled.save_step(emcee.State(coords, log_prob=np.zeros(walkers)), moved)
    return filled


def ar1(phis, steps, walkers, seed, mean=0.0, sd=1.0):
    """Return stationary AR(1) chains ``(steps, walkers, d)``, one phi per parameter."""
    rng, phi = np.random.default_rng(seed), np.array(phis)
    chain = rng.normal(size=(steps, walkers, len(phi)))
    for i in range(1, steps):
        chain[i] = phi * chain[i - 1] + np.sqrt(1 - phi**2) * chain[i]
    return mean + sd * chain
