"""GARTEUR by the example, against the same aircraft by another program's matrices."""

import runpy

import numpy as np
from support.examples import EXAMPLES, load

# By 162 x 162 matrices that were assembled outside this package.
NOMINAL = [5.582335061, 15.44511530, 32.32350686, 32.37585002, 37.22241568]
NOMINAL += [44.59372994, 52.54484140, 54.57656609, 60.99930558, 70.49955246]


def test_garteur(capsys):
    example = load("garteur")
    model = example.garteur(n_modes=10)
    np.testing.assert_allclose(model({}).frequencies[0], NOMINAL, rtol=1e-6)
    factors = ["density", "wing small", "wing large", "wing torsion", "fin torsion"]
    scaled = example.garteur(factors, n_modes=10)
    ones = {name: np.ones(1) for name in factors}
    assert {*scaled.names} == {*factors}
    np.testing.assert_allclose(scaled(ones).frequencies[0], NOMINAL, rtol=1e-6)
    runpy.run_path(str(EXAMPLES / "garteur.py"), run_name="__main__")
    assert "162 DOFs, 41.7 kg" in capsys.readouterr().out


def test_a_stiff_joint_is_none_and_a_layer_without_stiffness_is_mass():
    example = load("garteur")
    joined = example.garteur(joint=True)({"joint": np.array([1e3])}).frequencies[0]
    np.testing.assert_allclose(joined, NOMINAL[:8], rtol=2e-3)
    covered = example.garteur(layer=True)({"layer": np.array([1e-6, 1.0])})
    assert (covered.frequencies[0] < NOMINAL[:8]).all()
    # Bonded, by hand: 1.3 times the bending stiffness of the wing.
    share = covered.frequencies[1, 0] / covered.frequencies[0, 0]
    assert 1.25 < share**2 < 1.45
