"""Measured FRFs: their errors, and universal files."""

import numpy as np
import pytest

import emcee_femu as ef

LINES = np.array([1.0, 2.0, 3.0])
CHANNELS = [("4:x", "7:z"), ("12:y", "7:z")]
RNG = np.random.default_rng(4)
H = RNG.normal(size=(2, 3)) + 1j * RNG.normal(size=(2, 3))
COHERENCE = RNG.uniform(0.7, 0.99, (2, 3))


def measured(**changes):
    good = {"kind": "accelerance", "coherence": COHERENCE, "averages": 50}
    return ef.frf.FRFMeasurements(LINES, H, CHANNELS, **(good | changes))


def test_the_error_of_an_h1_estimate_is_that_of_simulated_averages():
    """Noise at the output of a line: the spread of H1 against the formula."""
    averages, repeats, true = 40, 4_000, 0.7 - 0.2j

    def normal():
        shape = (repeats, averages)
        return RNG.normal(size=shape) + 1j * RNG.normal(size=shape)

    force = normal()
    output = true * force + 0.3 * normal()
    cross, auto = (output * force.conj()).mean(1), (np.abs(force) ** 2).mean(1)
    estimates = cross / auto
    coherence = abs(true) ** 2 / (abs(true) ** 2 + 0.3**2)
    found = ef.frf.FRFMeasurements(
        [1.0], [[true]], [(0, 0)], kind="receptance", coherence=[[coherence]],
        averages=averages,
    ).sd[0, 0]  # fmt: skip
    for part in (estimates.real, estimates.imag):
        assert part.std() == pytest.approx(found, rel=0.05)


def test_lines_between():
    part = measured().between(1.5, 3.0)
    np.testing.assert_array_equal(part.lines, [2.0, 3.0])
    np.testing.assert_array_equal(part.values, H[:, 1:])
    np.testing.assert_array_equal(part.coherence, COHERENCE[:, 1:])
    assert (part.kind, part.averages) == ("accelerance", 50)
    assert measured(coherence=None, averages=None).between(1, 2).sd is None
    with pytest.raises(ValueError, match="no line between 5 and 6 Hz"):
        measured().between(5.0, 6.0)


def write(path, *, signs=(1, 1), **changes):
    pyuff = pytest.importorskip("pyuff", reason='pip install "emcee_femu[uff]"')
    sets = []
    for i, (node, axis) in enumerate([(4, 1), (12, 2)]):
        for function, data in ((4, H[i]), (6, COHERENCE[i])):
            given = {
                "binary": 0,
                "func_type": function,
                "rsp_node": node,
                "rsp_dir": signs[i] * axis,
                "ref_node": 7,
                "ref_dir": 3,
                "x": LINES,
                "data": signs[i] * data if function == 4 else data,
                "abscissa_spacing": 1,
                "ordinate_spec_data_type": 12,
                "orddenom_spec_data_type": 13,
            }
            own = pyuff.prepare_58(**(given | changes))
            sets.append(own)
    pyuff.UFF(str(path)).write_sets(sets, "overwrite")
    return path


@pytest.mark.parametrize("signs", [(1, 1), (-1, 1)])
def test_universal_files(tmp_path, signs):
    path = write(tmp_path / "frf.uff", signs=signs)
    found = ef.frf.FRFMeasurements.from_uff(path, averages=50)
    assert found.channels == tuple(map(tuple, CHANNELS))
    assert (found.kind, found.averages) == ("accelerance", 50)
    np.testing.assert_allclose(found.lines, LINES)
    np.testing.assert_allclose(found.values, H, rtol=1e-4)
    np.testing.assert_allclose(found.coherence, COHERENCE, rtol=1e-4)
    assert ef.frf.FRFMeasurements.from_uff(path).coherence is None
