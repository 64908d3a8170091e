"""Chains of which everything is known, as emcee stores them."""

import json

import arviz as az
import emcee
import numpy as np
import xarray


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


def dataset(idata, group):
    """Return a group of an ArviZ object of either generation."""
    found = idata[group]
    return found.to_dataset() if hasattr(found, "to_dataset") else found


def wrap(groups):
    """Return groups as the installed ArviZ's own container."""
    groups = {
        k: xarray.Dataset(**v) if isinstance(v, dict) else v for k, v in groups.items()
    }
    if az.__version__.startswith("0."):
        return az.InferenceData(**groups)
    return xarray.DataTree.from_dict(groups)


def as_arviz(backends, **attrs):
    """Return backends of one posterior as ``to_inference_data`` converts a run.

    ``attrs`` are what it knows, such as what "auto" found, as JSON.
    """
    chain = np.concatenate([b.get_chain().swapaxes(0, 1) for b in backends])
    log_prob = np.concatenate([b.get_log_prob().T for b in backends])
    walkers = len(chain) // len(backends)
    names = [f"theta{i + 1}" for i in range(chain.shape[2])]
    draws = {n: (("chain", "draw"), chain[..., i]) for i, n in enumerate(names)}
    number = ("chain", np.repeat(np.arange(len(backends)), walkers))
    attrs = {name: json.dumps(value) for name, value in attrs.items()}
    return wrap(
        {
            "posterior": {
                "data_vars": draws,
                "coords": {"ensemble": number},
                "attrs": {"sample_dims": ["chain", "draw"], **attrs},
            },
            "sample_stats": {"data_vars": {"lp": (("chain", "draw"), log_prob)}},
        }
    )
