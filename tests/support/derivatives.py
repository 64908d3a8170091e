"""A model's jacobian against differences of what it returns, for any modal model."""

import numpy as np

from emcee_femu.interfaces import read

STENCIL = {-2: 1 / 12, -1: -2 / 3, 1: 2 / 3, 2: -1 / 12}  # exact to the fourth power
STEPS = ("model_mode", "unpaired")  # what a paired model returns, and has no slope


def aligned(value, reference, name):
    """Return shapes with the signs of the reference, anything else as it is."""
    value = np.asarray(value)
    if name != "shapes":
        return value
    return value * np.sign((value * reference).sum(axis=1, keepdims=True))


def differences(model, parameters, name, of, reference, step):
    """Return central differences of a variable, of the fourth order."""
    width = step * np.abs(parameters[name])
    total = 0.0
    for shift, weight in STENCIL.items():
        moved = {**parameters, name: parameters[name] + shift * width}
        total = total + weight * aligned(read(model(moved), of), reference, of)
    return total / width.reshape(-1, *[1] * (reference.ndim - 1))


def assert_jacobian(model, parameters, step=1e-3, tolerance=1e-6, alike=False):
    """The response is that of a call, its derivatives are those of differences.

    Errors are shares of the largest derivative by the parameter, or by any where all
    have one unit and one size (``alike``).
    """
    response, derivatives = model.jacobian(parameters)
    called = model(parameters)
    for variable, by_name in derivatives.items():
        value = read(response, variable)
        np.testing.assert_allclose(value, read(called, variable), rtol=1e-12)
        if variable in STEPS:
            assert by_name == {}
            continue
        assert [*by_name] == [name for name in model.names if name in parameters]
        expected = {
            name: differences(model, parameters, name, variable, value, step)
            for name in by_name
        }
        sizes = {name: np.abs(expected[name]).max() for name in by_name}
        for name, derivative in by_name.items():
            assert derivative.shape == value.shape
            size = max(sizes.values()) if alike else sizes[name]
            assert size > 0
            error = np.abs(derivative - expected[name]).max()
            assert error < tolerance * size, (variable, name, error / size)


def assert_jacobian_batch_is_a_loop(model, parameters):
    """A batch and a loop differ by rounding, as einsum of NumPy 2.0 does."""
    response, derivatives = model.jacobian(parameters)
    for i in range(len(response.frequency)):
        one = {name: value[i : i + 1] for name, value in parameters.items()}
        own, own_derivatives = model.jacobian(one)
        assert np.array_equal(own.frequency[0], response.frequency[i])
        for variable, by_name in derivatives.items():
            for name, derivative in by_name.items():
                alone = own_derivatives[variable][name][0]
                scale = np.abs(derivative[i]).max()
                np.testing.assert_allclose(
                    alone, derivative[i], 1e-12, 1e-12 * (1 + scale), err_msg=name
                )
