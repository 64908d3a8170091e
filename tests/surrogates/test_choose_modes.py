"""The blocks that are chosen, and what they gain where modes cross."""

import numpy as np
import pytest
from support.crossing import respond, solve

from emcee_femu.surrogates.choose_modes import choose_modes
from emcee_femu.surrogates.emulated import fit_emulated
from emcee_femu.surrogates.mode_blocks import Aligned, Modes, Symmetric
from emcee_femu.surrogates.outputs import choose_outputs
from emcee_femu.surrogates.outputs_modes import ModalOutputs

RNG = np.random.default_rng(1)
POINTS, FRESH = RNG.standard_normal((40, 2)), RNG.standard_normal((300, 2))
HERTZ = np.full(3, 0.002)  # where 100 Hz^2 / (2 pi)^2 is 1.6 Hz
BOUNDS = {"a": (-9.0, 9.0), "b": (-9.0, 9.0)}


def error(response, units, alone=False, monkeypatch=None):
    """Return the root mean square error in units, and the emulator."""
    if alone:
        single = [(j, j + 1) for j in range(3)]
        path = "emcee_femu.surrogates.choose_modes._Choice.part"
        monkeypatch.setattr(path, lambda self, start: single)
    model = fit_emulated(POINTS, response, units, BOUNDS)
    found = model(dict(zip("ab", FRESH.T, strict=True)))
    wrong = (found.frequencies - respond(FRESH)["frequency"]) / HERTZ
    return np.sqrt((wrong**2).mean()), model


@pytest.mark.parametrize("shapes", [True, False])
def test_modes_that_cross_are_emulated_together_to_advantage(shapes, monkeypatch):
    response = respond(POINTS, seed=4)
    if not shapes:
        del response["shapes"]
    units = {"frequency": HERTZ}
    together, model = error(response, units)
    (part,) = model.outputs.parts
    assert max(block.count for block in part.blocks) == 3
    kind = Aligned if shapes else Symmetric
    assert isinstance(part.blocks[0], kind)
    alone, _ = error(response, units, True, monkeypatch)
    assert together < (0.05 if shapes else 0.3) * alone


def test_modes_that_keep_apart_stay_alone():
    x = POINTS
    eigenvalues = np.column_stack(
        [100 + 9 * x[:, 0], 300 + x[:, 1] ** 2, 900 + 5 * x[:, 1] + x[:, 0] ** 2]
    )
    outputs = choose_modes(x, Modes(eigenvalues), (HERTZ, None))
    assert [block.count for block in outputs.blocks] == [1, 1, 1]
    assert outputs.ascending


def test_points_that_are_all_far_away_have_their_say():
    outputs = choose_modes(
        1e6 * POINTS, Modes(solve(POINTS).eigenvalues), (HERTZ, None)
    )
    assert sum(block.count for block in outputs.blocks) == 3


def test_modes_in_no_order_are_left_in_theirs():
    modes = Modes(solve(POINTS).eigenvalues[:, ::-1])
    outputs = choose_modes(POINTS, modes, (HERTZ, None))
    frequencies = np.sqrt(modes.eigenvalues) / (2 * np.pi)
    values = outputs.encode({"frequency": frequencies})
    assert not outputs.ascending and len(outputs.blocks) == 3
    np.testing.assert_allclose(outputs.decode(values)["frequency"], frequencies)


def test_shapes_come_back_where_they_are_wanted():
    response = respond(POINTS, seed=4)
    units = {"frequency": HERTZ, "shapes": np.full((5, 3), 0.02)}
    model = fit_emulated(POINTS, response, units, BOUNDS)
    found, truth = model(dict(zip("ab", FRESH.T, strict=True))), respond(FRESH)
    products = (found.shapes * truth["shapes"]).sum(axis=1) ** 2
    squares = [(s**2).sum(axis=1) for s in (found.shapes, truth["shapes"])]
    assert np.quantile(1 - products / (squares[0] * squares[1]), 0.95) < 1e-4
    assert model.variables["shapes"].shape == (5, 3)


def test_modes_of_several_blocks_are_put_in_order_with_their_shapes_and_slopes():
    reference = np.eye(3)
    blocks = [
        Aligned.of(j, np.ones(1), np.ones((3, 1)), reference[:, j : j + 1])
        for j in range(3)
    ]
    outputs = ModalOutputs(tuple(blocks), np.full(3, 1e-9), True, True)
    values = np.hstack([[x, *reference[j]] for j, x in enumerate([9.0, 1.0, 4.0])])
    found = outputs.decode(values[None])
    np.testing.assert_allclose(2 * np.pi * found["frequency"], [[1.0, 2.0, 3.0]])
    np.testing.assert_allclose(found["shapes"][0], reference[:, [1, 2, 0]])
    move = np.zeros((1, 12, 1))
    move[0, 0] = 6.0  # of the highest
    for finite in (False, True):
        _, slopes = outputs.decode_slopes(values[None], move, finite)
        moved = 2 * np.pi * slopes["frequency"][0, :, 0]
        np.testing.assert_allclose(moved, [0.0, 0.0, 1.0])


def test_other_variables_are_emulated_as_they_are():
    response = {"sag": np.stack([POINTS[:, 0], POINTS[:, 1] ** 2, 0 * POINTS[:, 0]], 1)}
    outputs = choose_outputs(POINTS, response, {"sag": np.array([0.1, 0.2, 0.3])})
    values = outputs.encode(response)
    np.testing.assert_allclose(values[:, 1], POINTS[:, 1] ** 2 / 0.2)
    np.testing.assert_allclose(outputs.decode(values)["sag"], response["sag"])
    moved = RNG.standard_normal((len(POINTS), 3, 2))
    slopes = outputs.decode_slopes(values, moved)[1]["sag"]
    np.testing.assert_allclose(slopes, moved * np.array([0.1, 0.2, 0.3])[:, None])


@pytest.mark.parametrize(
    ("response", "units", "expected"),
    [
        ({"sag": np.ones((40, 2)) * 1j}, {"sag": 1.0}, "real and imaginary"),
        ({"sag": np.ones((39, 2))}, {"sag": 1.0}, "of 40 points"),
        ({"sag": np.full((40, 2), np.nan)}, {"sag": 1.0}, "finite numbers of 'sag'"),
        ({"sag": np.ones((40, 2))}, {"sag": np.ones(3)}, r"of shape \(2,\)"),
        ({"sag": np.ones((40, 2))}, {"sag": 0.0}, "above zero"),
        ({"sag": np.ones((40, 2))}, {"dip": 1.0}, "no 'dip'"),
    ],
)
def test_what_cannot_be_emulated_is_named(response, units, expected):
    with pytest.raises((TypeError, ValueError), match=expected):
        choose_outputs(POINTS, response, units)
