"""MAC and one-to-one choices against formulas and all permutations."""

from itertools import permutations

import numpy as np
import pytest

from emcee_femu.models.pairing import at_sensors, mac, one_to_one


def random_shapes(seed, *shape):
    return np.random.default_rng(seed).normal(size=shape)


def test_mac_is_the_squared_cosine_whatever_scale_sign_or_phase():
    a, b = random_shapes(0, 6, 3), random_shapes(1, 6, 4)
    cosine = (a / np.linalg.norm(a, axis=0)).T @ (b / np.linalg.norm(b, axis=0))
    np.testing.assert_allclose(mac(a, b), cosine**2, rtol=1e-12)
    np.testing.assert_allclose(mac(-3e-9 * a, 1e7 * b), cosine**2, rtol=1e-12)
    phase = np.exp(1j * np.array([0.3, 1.0, 2.0]))
    np.testing.assert_allclose(np.diag(mac(a * phase, a)), 1.0, rtol=1e-12)
    z = a + 1j * random_shapes(12, 6, 3)
    np.testing.assert_allclose(np.diag(mac(z, z * phase)), 1.0, rtol=1e-12)
    batch = np.stack([b, 2 * b, b[:, ::-1]])
    np.testing.assert_allclose(mac(a, batch)[2], cosine[:, ::-1] ** 2, rtol=1e-12)
    assert mac(a, np.zeros((6, 1))).tolist() == [[0.0]] * 3


def test_mac_refuses_other_sensors():
    for a, b in ((np.ones((3, 1)), np.ones((4, 1))), (np.ones(3), np.ones((3, 1)))):
        with pytest.raises(ValueError, match="a, b: expected shapes .* same sensors"):
            mac(a, b)


def test_one_to_one_is_the_best_of_all_choices():
    score = np.random.default_rng(2).random((200, 3, 5))
    choices = np.array(list(permutations(range(5), 3)))
    totals = score[:, np.arange(3), choices].sum(axis=2)  # (200, choices)
    best = one_to_one(score)
    np.testing.assert_array_equal(best, choices[totals.argmax(axis=1)])
    assert (score.argmax(axis=2) != best).any()  # some needed more than the maximum


def test_sensors_are_rows_of_all_dofs_or_the_rows_themselves():
    shapes = random_shapes(11, 2, 5, 3)
    chosen = np.array([4, 1])
    np.testing.assert_array_equal(at_sensors(shapes, chosen, 2), shapes[:, [4, 1]])
    for dofs in (None, np.array([7, 8, 9, 11, 12]), np.arange(5)):
        assert at_sensors(shapes, dofs, 5) is shapes
    with pytest.raises(ValueError, match="another order"):
        at_sensors(shapes, np.array([1, 0, 2, 3, 4]), 5)
    with pytest.raises(
        ValueError, match=r"the rows of 2 sensors .* None; give Measurements\(dofs="
    ):
        at_sensors(shapes, None, 2)
    with pytest.raises(ValueError, match="among the 5 .* got .0, 5."):
        at_sensors(shapes, np.array([0, 5]), 2)
