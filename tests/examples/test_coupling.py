"""Pages that update a structure with the matrices of a real FE program.

The site's build executes them, and what they claim; here are published values of one.
Adapters have tests in fe_programs.
"""

import sys

import numpy as np
import pytest
from support.examples import load

PROGRAMS = {"opensees": "openseespy", "pynite": "Pynite", "scikit_fem": "skfem"}


@pytest.fixture
def plate():
    pytest.importorskip("skfem", reason="pip install 'emcee_femu[skfem]'")
    return load("how_to/scikit_fem")


@pytest.mark.parametrize("name", PROGRAMS)
def test_a_page_can_be_imported_without_its_program(name, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, PROGRAMS[name], None)
    load(f"how_to/{name}")
    assert capsys.readouterr().out == ""


def test_a_uniform_square_plate_has_the_published_frequencies(plate, monkeypatch):
    for constant, value in (("LENGTH", 1.0), ("WIDTH", 1.0), ("NU", 0.3)):
        monkeypatch.setattr(plate, constant, value)
    monkeypatch.setattr(plate, "N_MODES", 5)
    found = plate.frequencies(plate.plate(8, 8), dict.fromkeys(plate.TRUTH, 1.0))
    D = plate.E * plate.THICKNESS**3 / (12 * (1 - plate.NU**2))
    factors = 2 * np.pi * found * np.sqrt(plate.RHO * plate.THICKNESS / D)
    # Leissa 1973, doi 10.1016/S0022-460X(73)80371-2: upper bounds by the Ritz method.
    published = np.array([3.4917, 8.5246, 21.429, 27.331, 31.111])
    assert (factors < published).all()
    np.testing.assert_allclose(factors, published, rtol=0.01)
