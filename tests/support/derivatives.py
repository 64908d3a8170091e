"""A model's jacobian against differences of what it returns, for any modal model."""

import numpy as np
from numpy.testing import assert_allclose

import emcee_femu as ef

read = ef.contracts.read

STENCIL = {-2: 1 / 12, -1: -2 / 3, 1: 2 / 3, 2: -1 / 12}  # exact to the fourth power
# Share of a response that rounding may change: in differences it looks like a slope.
ROUNDED = 1e-12
STEPS = ("model_mode", "unpaired")  # what a paired model returns, and has no slope


def aligned(value, reference, name):
    """Return shapes with the signs of the reference, anything else as it is."""
    value = np.asarray(value)
    if name != "shapes":
        return value
    return value * np.sign((value * reference).sum(axis=1, keepdims=True))


def differences(model, parameters, name, of, step, stencil=STENCIL):
    """Return differences of a variable, by default central ones of the fourth order."""
    reference = read(model(parameters), of)
    width = step * np.abs(parameters[name])
    total = 0.0
    for shift, weight in stencil.items():
        moved = {**parameters, name: parameters[name] + shift * width}
        total = total + weight * aligned(read(model(moved), of), reference, of)
    return total / width.reshape(-1, *[1] * (reference.ndim - 1))


def assert_jacobian(
    model, parameters, step=1e-3, tolerance=1e-6, alike=False, alone_to=1e-9
):
    """The response is that of a call, its derivatives are those of differences.

    Errors are shares of the largest derivative by the parameter, or by any where all
    have one unit and one size (``alike``); those of a row alone and in a batch differ
    by less than ``alone_to``. What rounding does to differences is no error, as where
    a derivative is zero. A parameter without a derivative changes nothing.
    """
    response, derivatives = model.jacobian(parameters)
    called = model(parameters)
    last = {name: value[-1:] for name, value in parameters.items()}
    alone = model.jacobian(last)[1]
    for variable, by_name in derivatives.items():
        value = read(response, variable)
        assert_allclose(value, read(called, variable), rtol=1e-11, atol=1e-11)
        if variable in STEPS:
            assert by_name == {}
            continue
        expected = {
            name: differences(model, parameters, name, variable, step)
            for name in parameters
        }
        sizes = {name: np.abs(expected[name]).max() for name in parameters}
        for name, at in parameters.items():
            rounded = ROUNDED * np.abs(value).max() / np.abs(at).min()
            if name not in by_name:
                assert sizes[name] <= rounded / step, (variable, name)
                continue
            size = max(sizes.values()) if alike else sizes[name]
            assert by_name[name].shape == value.shape
            error = np.abs(by_name[name] - expected[name]).max()
            assert error <= tolerance * size + rounded / step, (variable, name, error)
            row = aligned(alone[variable][name], by_name[name][-1:], variable)
            apart = np.abs(row - by_name[name][-1:]).max()
            assert apart <= alone_to * size + rounded, (variable, name, apart)
