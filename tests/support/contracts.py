"""What every prior, model and term must do; CONTRIBUTING.md shows how to use it.

A move has :func:`support.checks.exact_start`, a model's ``jacobian``
:func:`support.derivatives.assert_jacobian`.
"""

import pickle

import numpy as np
from scipy import stats

import emcee_femu as ef

# What may be the same for all parameters of a right model: the shapes of modes, as
# where one stiffness is a factor of all, and how they were paired.
MAY_STAY = ("shapes", "mac", "model_mode", "unpaired")
DRAWS, STEPS = 20_000, 20  # of a prior, and how often each draw is moved
BY_CHANCE = 1e-4  # that a right prior is refused


def _row(values, i):
    return {name: np.asarray(value)[i : i + 1] for name, value in values.items()}


def assert_prior(prior):
    """Its draws are of its density, lie inside its bounds and come from the generator.

    Moved by steps that keep the density they must still have the law of other draws.
    """
    x, same, fresh = (prior.sample(np.random.default_rng(i), DRAWS) for i in (1, 1, 2))
    assert x.shape == (DRAWS, len(prior.names)), "sample returns (n, d)"
    assert np.array_equal(x, same) and (x != fresh).any(), "sample uses its generator"
    low, high = prior.bounds.T
    outside = np.vstack([low, high]) + np.array([[-1.0], [1.0]])
    for i in range(x.shape[1]):
        assert (x[:, i] >= low[i]).all() and (x[:, i] <= high[i]).all(), prior.names[i]
        for end in outside[np.isfinite(outside[:, i])]:
            point = np.where(np.arange(len(low)) == i, end, x[0])
            assert prior.logpdf(point[None])[0] == -np.inf, "-inf out of bounds"
    rng, scale = np.random.default_rng(3), x.std(axis=0)
    height = prior.logpdf(x)
    assert height.shape == (DRAWS,) and np.isfinite(height).all(), "logpdf returns (n,)"
    for _ in range(STEPS):
        y = x + scale * rng.standard_normal(x.shape)
        new = prior.logpdf(y)
        taken = np.log(rng.random(DRAWS)) < new - height
        x, height = np.where(taken[:, None], y, x), np.where(taken, new, height)
    for name, moved, drawn in zip(prior.names, x.T, fresh.T, strict=True):
        chance = stats.ks_2samp(moved, drawn).pvalue
        assert chance > BY_CHANCE, f"{name}: the draws have another law than logpdf"


def assert_model(model, parameters, rtol=1e-9):
    """The response is as declared, and the same in a batch, one by one and pickled.

    ``parameters`` are two different sets or more, in which each parameter changes the
    response by itself; ``rtol`` is a share of the largest.
    """
    declared = ef.contracts.read_declared(model, "variables")
    assert declared, "the model must have variables"
    before = {name: np.array(value) for name, value in parameters.items()}
    batch = model(parameters)
    for name, value in before.items():
        assert np.array_equal(parameters[name], value), f"the model changed {name}"
    copied = pickle.loads(pickle.dumps(model))(parameters)
    n = len(next(iter(before.values())))
    singles = [model(_row(before, i)) for i in range(n)]
    for name, variable in declared.items():
        if not (variable.coords or variable.stored):
            continue  # of a shape that is not known, or not there
        value = np.asarray(ef.contracts.read(batch, name))
        expected = (n, *variable.shape)
        assert value.shape == expected, f"{name}: {value.shape}, declared {expected}"
        assert np.isfinite(value).all(), f"{name} is not finite"
        changes = (value != value[:1]).any()
        assert changes or name in MAY_STAY, f"{name} is the same for all parameters"
        assert np.array_equal(ef.contracts.read(copied, name), value), (
            f"{name} of a pickled copy"
        )
        single = np.concatenate([ef.contracts.read(one, name) for one in singles])
        atol = rtol * np.abs(value).max()
        np.testing.assert_allclose(single, value, rtol, atol, err_msg=f"{name}, alone")
    known = [key for key, variable in declared.items() if variable.coords]
    read = (ef.contracts.read_declared(model, k) or () for k in ("names", "bounds"))
    for name in before.keys() & {name for names in read for name in names}:
        only = {k: v if k == name else np.repeat(v[:1], n) for k, v in before.items()}
        answers = [ef.contracts.read(model(only), key) for key in known]
        changed = any((answer != answer[:1]).any() for answer in answers)
        assert changed or not known, f"{name} by itself changes nothing"


def assert_shapes(found, expected, rtol=0.0, atol=0.0):
    """Compare shapes ``(..., sensors, modes)`` but for their signs."""
    signs = np.sign((found * expected).sum(axis=-2, keepdims=True))
    np.testing.assert_allclose(found * signs, expected, rtol, atol)


def assert_term(term, parameters, response, expected, rtol=1e-9):
    """The log-likelihood is the expected one but for a constant, and its parts fit it.

    ``response`` is what a model would return for the parameters, two sets or more;
    ``expected`` is the log-density by another route, ``(n,)``.
    """
    found = term(parameters, response)
    assert np.shape(found) == np.shape(expected), "one number per parameter set"
    close = rtol * (np.ptp(expected) + np.abs(expected).max())
    constant = np.ptp(found - expected)
    assert constant <= close, f"it differs from the expected by up to {constant:g}"
    rows = [term(_row(parameters, i), _row(response, i)) for i in range(len(found))]
    np.testing.assert_allclose(np.concatenate(rows), found, rtol, err_msg="one by one")
    data = term.pointwise(parameters, response) if hasattr(term, "pointwise") else None
    if data:  # it is where the data have no factors
        total = sum(one.reshape(len(found), -1).sum(axis=1) for one in data.values())
        np.testing.assert_allclose(total, found, rtol, err_msg="the sum of pointwise")
    if hasattr(term, "deviations"):
        r, sd = term.deviations(parameters, response)
        normal = stats.norm.logpdf(r, 0, sd).sum(axis=1)
        assert np.ptp(normal - found) <= close, "deviations have another density"
    if hasattr(term, "replicate"):
        new = term.replicate(np.random.default_rng(0), parameters, response)
        for name, value in new.items():
            assert value.shape == (len(found), *np.shape(term.observed[name])), name
            assert (value[0] != value[-1]).any(), f"{name}: replicates are all alike"
