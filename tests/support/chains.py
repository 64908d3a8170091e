"""Chains of which everything is known, as emcee stores them."""

import json

import arviz as az
import emcee
import numpy as np
import xarray
from scipy.signal import lfilter


def backend(chain, accepted=None, log_prob=None, blobs=None):
    """Return an emcee backend that holds ``chain (steps, walkers, d)``."""
    steps, walkers, d = chain.shape
    accepted = np.ones((steps, walkers), bool) if accepted is None else accepted
    log_prob = np.zeros((steps, walkers)) if log_prob is None else log_prob
    blobs = [None] * steps if blobs is None else blobs
    filled = emcee.backends.Backend()
    filled.reset(walkers, d)
    filled.grow(steps, blobs[0])
    for *held, moved in zip(chain, log_prob, blobs, accepted, strict=True):
        filled.save_step(emcee.State(*held), moved)
    return filled


def ar1(phis, steps, walkers, seed, mean=0.0, sd=1.0):
    """Return stationary AR(1) chains ``(steps, walkers, d)``, one phi per parameter."""
    chain = np.random.default_rng(seed).normal(size=(steps, walkers, len(phis)))
    for column, phi in zip(np.moveaxis(chain, 2, 0), phis, strict=True):
        share, known = [np.sqrt(1 - phi**2)], phi * column[:1]
        column[1:] = lfilter(share, [1.0, -phi], column[1:], axis=0, zi=known)[0]
    return mean + sd * chain


def switching(share, stay, steps, walkers, seed):
    """Return ``(steps, walkers)`` of zeros and ones, ones for ``share`` of the time.

    A walker draws anew with probability ``1 - stay``: tau is (1 + stay) / (1 - stay).
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


def stored_and_read(idata, path):
    """Return an object as it comes back from ArviZ's own netCDF file."""
    idata.to_netcdf(str(path))
    return az.from_netcdf(str(path))


def by_hand(draws, constants=None, measured=None, dims=("mode",), **groups):
    """Return draws ``{name: (chain, draw)}`` as ``to_inference_data`` has them.

    Constants are by parameter, what was measured is of ``dims``, and further groups of
    chain, draw and ``dims``, unless an array comes in a tuple behind its dimensions.
    """

    def dataset(values, own, **attrs):
        columns = {
            name: v if isinstance(v, tuple) else (own[: np.ndim(v)], v)
            for name, v in values.items()
        }
        made = xarray.Dataset(columns, attrs=attrs)
        return made.assign_coords(
            {d: 1 + np.arange(made.sizes.get(d, 0)) for d in dims}
        )

    kept = ("chain", "draw", *dims)
    attrs = {"sampled": [*draws], "sample_dims": ["chain", "draw"]}
    groups = {"posterior": draws, **groups}
    made = {name: dataset(group, kept, **attrs) for name, group in groups.items()}
    if measured is not None:
        made["observed_data"] = dataset(measured, dims)
    if constants is not None:
        by_parameter = dataset(constants, ("parameter",))
        made["constant_data"] = by_parameter.assign_coords(parameter=[*draws])
    if az.__version__.startswith("0."):
        return az.InferenceData(**made)
    return xarray.DataTree.from_dict(made)


def as_arviz(backends, **attrs):
    """Return backends of one posterior as an object that knows ``attrs``, as JSON."""
    chain = np.concatenate([b.get_chain().swapaxes(0, 1) for b in backends])
    log_prob = np.concatenate([b.get_log_prob().T for b in backends])
    draws = {f"theta{i + 1}": x for i, x in enumerate(np.moveaxis(chain, 2, 0))}
    idata = by_hand(draws, sample_stats={"lp": log_prob})
    number = np.repeat(np.arange(len(backends)), len(chain) // len(backends))
    idata["posterior"].coords["ensemble"] = "chain", number
    idata["posterior"].attrs.update({k: json.dumps(v) for k, v in attrs.items()})
    return idata
