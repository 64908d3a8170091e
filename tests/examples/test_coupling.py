"""Pages that update a structure with the matrices of a real FE program.

Each is held to routes that share nothing with it: closed forms, and the Gaussian
posterior of a least-squares fit by scipy. Adapters have tests in fe_programs.
"""

import runpy
import sys

import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.optimize import least_squares
from support.examples import EXAMPLES, load
from support.programs import opensees

PROGRAMS = {"opensees": "openseespy", "pynite": "Pynite", "scikit_fem": "skfem"}


@pytest.fixture
def plate():
    pytest.importorskip("skfem", reason="pip install 'emcee_femu[skfem]'")
    return load("how_to/scikit_fem")


def check_update(name, mean_gap=0.2, sd_gap=0.1):
    """The posterior of a page, against scipy alone."""
    page = runpy.run_path(str(EXAMPLES / "how_to" / f"{name}.py"), run_name="__main__")
    model, parts = page["model"], page["model"].K
    K0, M = (np.asarray(matrix) for matrix in (model.K0, model.M0))
    largest = max(np.abs(part).max() for part in parts.values())
    assert np.abs(K0).max() < 1e-12 * largest  # each element is in a group

    def residuals(theta):
        K = K0 + sum(t * part for t, part in zip(theta, parts.values(), strict=True))
        omega2 = eigh(K, M, eigvals_only=True)[: page["N_MODES"]]
        ratio = np.sqrt(omega2) / (2 * np.pi) / page["measured"]
        return np.append((ratio - 1) / page["NOISE"], (theta - 1) / 0.2)

    fit = least_squares(residuals, np.ones(len(page["TRUTH"])), jac="3-point")
    sd = np.sqrt(np.diag(np.linalg.inv(fit.jac.T @ fit.jac)))
    draws = page["run"][0].get_chain(flat=True)
    np.testing.assert_array_less(np.abs(draws.mean(axis=0) - fit.x) / sd, mean_gap)
    np.testing.assert_allclose(draws.std(axis=0), sd, rtol=sd_gap)


def test_opensees_frame(capsys):
    opensees()
    check_update("opensees")
    shown = capsys.readouterr().out
    assert "sd/prior sd" in shown and "TAE" in shown and "upper columns" in shown


@pytest.mark.slow
def test_pynite_frame():
    pytest.importorskip("Pynite", reason="pip install 'emcee_femu[pynite]'")
    check_update("pynite")


@pytest.mark.slow
def test_skfem_plate(plate):
    check_update("scikit_fem")


@pytest.mark.parametrize("name", PROGRAMS)
def test_a_page_can_be_imported_without_its_program(name, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, PROGRAMS[name], None)
    load(f"how_to/{name}")
    assert capsys.readouterr().out == ""


def test_strips_and_mass_of_the_plate_have_their_closed_forms(plate):
    basis, ones = plate.plate(), dict.fromkeys(plate.TRUTH, 1.0)
    whole = plate.assemble(basis, ones)
    assert len(whole.labels) == whole.size == 96
    # w = x^2 y is clamped at x = 0 and lies in the space of the elements.
    values = {
        "u": lambda x, y: x**2 * y,
        "u_x": lambda x, y: 2 * x * y,
        "u_y": lambda x, y: x**2,
        "u_xy": lambda x, y: 2 * x,
    }
    places = basis.mesh.p.T
    rows = [label.split(":") for label in whole.labels]
    w = np.array([values[name](*places[int(node)]) for node, name in rows])
    L, W, nu = plate.LENGTH, plate.WIDTH, plate.NU
    mass = plate.RHO * plate.THICKNESS * L**5 / 5 * W**3 / 3
    assert w @ (whole.M @ w) == pytest.approx(mass, rel=1e-10)
    D = plate.E * plate.THICKNESS**3 / (12 * (1 - nu**2))
    for i, name in enumerate(plate.TRUTH):
        part = plate.assemble(basis, {**ones, name: 2.0}).K - whole.K
        a, b = i * L / 4, (i + 1) * L / 4
        # w_xx = 2 y, w_xy = 2 x, w_yy = 0
        bent = 4 * W**3 / 3 * (b - a)
        twisted = 2 * (1 - nu) * 4 * W * (b**3 - a**3) / 3
        assert w @ (part @ w) == pytest.approx(D * (bent + twisted), rel=1e-9)


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
