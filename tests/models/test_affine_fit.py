"""Affine parts from exports at several values of the parameters."""

import numpy as np
import pytest
from scipy import sparse
from support.exports import cantilever, write_calculix

import emcee_femu as ef

PLAIN = cantilever()[:2]


def read(folder, **factors):
    return ef.read_matrices(write_calculix(folder, *cantilever(**factors)))


def build(changes, base=PLAIN, **given):
    return ef.MatrixModel.from_differences(base, changes, n_modes=3, **given)


@pytest.mark.parametrize("kind", [np.array, sparse.csc_array])
def test_the_parts_of_a_beam_of_two_halves(kind):
    K, M = map(kind, PLAIN)
    changes = {"left": {2.0: kind(cantilever(left=2.0)[0])}}
    changes["mass"] = {3.0: (None, 3.0 * M)}
    model = build(changes, (K, M))
    assert [*model.K] == ["left"] and [*model.M] == ["mass"]
    own, _, _ = cantilever(left=1.0, right=0.0)
    as_array = np.asarray if kind is np.array else sparse.csc_array.toarray
    scale = abs(own).max()
    np.testing.assert_allclose(as_array(model.K["left"]), own, atol=1e-12 * scale)
    np.testing.assert_allclose(as_array(model.M0), 0.0, atol=1e-12)
    frequencies = model({"left": [0.7], "mass": [1.3]}).frequencies
    other = ef.MatrixModel(cantilever(left=0.7)[0], 1.3 * PLAIN[1], {}, n_modes=3)
    np.testing.assert_allclose(frequencies, other({}).frequencies, rtol=1e-10)


def test_values_are_those_of_the_parameters(tmp_path):
    E = 2.1e11
    base, soft = read(tmp_path), read(tmp_path, left=0.5)
    stiff = read(tmp_path, left=1.7)
    model = build({"E": {0.5 * E: soft, 1.7 * E: stiff}}, base, at={"E": E})
    other = ef.MatrixModel(*cantilever(left=1.2)[:2], {}, n_modes=3)
    frequencies = model({"E": [1.2 * E]}).frequencies
    np.testing.assert_allclose(frequencies, other({}).frequencies, rtol=1e-9)
    # The half that stands alone has no entries elsewhere: what rounding left is gone.
    rows = model.K["E"].nonzero()[0]
    assert rows.max() == base.dofs("19:ry") and model.M == {}


def test_a_third_export_shows_that_a_parameter_is_not_affine():
    K0, Kt = cantilever(left=0.0)[0], cantilever(right=0.0)[0]
    thickness = {t: K0 + t**3 * Kt for t in (1.5, 2.0)}
    build({"t": {2.0: thickness[2.0]}})  # two are on a line, whatever they are
    message = r"changes\['t'\]: K is not affine.*at 1\.5 it is off.*47\.4% of its"
    with pytest.raises(ValueError, match=message):
        build({"t": thickness})
    cubed = build({"t3": {t**3: K for t, K in thickness.items()}})
    np.testing.assert_allclose(cubed.K["t3"], Kt, atol=1e-9 * abs(Kt).max())
    K, M = PLAIN
    changes = {"a": {3.0: (3 * K, M), 2.0: (2 * K, 1.1 * M)}}
    with pytest.raises(ValueError, match=r"changes\['a'\]: M is not affine"):
        build(changes)


def test_exports_of_another_mesh_are_refused(tmp_path):
    base = read(tmp_path)
    K, M, dofs = cantilever(left=2.0)
    dofs[:, 0] += 1
    other = ef.read_matrices(write_calculix(tmp_path, K, M, dofs))
    with pytest.raises(ValueError, match=r"a'\]\[2\.0\]: .*nodes and directions of"):
        build({"a": {2.0: other}}, base)
