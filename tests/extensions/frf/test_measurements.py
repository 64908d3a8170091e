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
    zero = np.array([[0.0], [0.0]])
    with pytest.warns(UserWarning, match="0 Hz is left out"):
        found = ef.frf.FRFMeasurements(
            [0.0, *LINES],
            np.hstack([zero, H]),
            CHANNELS,
            kind="accelerance",
            coherence=np.hstack([zero, COHERENCE]),
            averages=50,
        )
    np.testing.assert_array_equal(found.lines, LINES)
    np.testing.assert_array_equal(found.sd, measured().sd)


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
    double = changes.get("ord_data_type", 6) == 6
    path.unlink(missing_ok=True)  # pyuff cannot overwrite with binary ones
    pyuff.UFF(str(path)).write_sets(sets, "add", force_double=double)
    return path


def test_what_fills_the_last_line_of_an_even_function_is_left_out(tmp_path):
    path = write(tmp_path / "frf.uff")
    plain = ef.frf.FRFMeasurements.from_uff(path)
    padded, last = [], ""
    for line in path.read_text().splitlines():  # each function ends in a filled line
        values = last.count("e+") + last.count("e-")
        if line == "    -1" and values:
            padded[-1] = last + (4 - values) * f"{0:20.11e}"
        padded.append(line)
        last = line
    path.write_text("\n".join([*padded, ""]))
    found = ef.frf.FRFMeasurements.from_uff(path)
    np.testing.assert_array_equal(found.values, plain.values)
    np.testing.assert_array_equal(found.lines, plain.lines)


def test_a_direction_against_the_axis_turns_the_sign():
    channels = [("4:-x", "7:z"), ("12:-y", "7:-z")]
    found = ef.frf.FRFMeasurements(LINES, H, channels, kind="mobility")
    assert found.channels == tuple(map(tuple, CHANNELS))
    np.testing.assert_array_equal(found.values, H * [[-1], [1]])


@pytest.mark.parametrize("number", ["<c8", ">c8", "<c16", ">c16"])
def test_every_form_of_binary_data(tmp_path, number):
    """Made from text: the header has a line more of fields, and numbers follow."""
    single = number.endswith("8")
    path, parts = write(tmp_path / "frf.uff", ord_data_type=5 if single else 6), []
    for text in path.read_text().split("    -1\n")[1:-1:4]:  # without coherences
        head = text.splitlines()
        head[0] = f"    58b{1 + (number[0] == '>'):6d}{2:6d}{11:12d}{0:12d}"
        values = H[len(parts)].astype(number).tobytes()
        parts.append("\n".join(["    -1", *head[:12], ""]).encode() + values)
    path.write_bytes(b"".join(part + b"\n    -1\n" for part in parts))
    found = ef.frf.FRFMeasurements.from_uff(path)
    np.testing.assert_allclose(found.values, H, rtol=1e-6 if single else 1e-12)
    path.write_bytes(
        path.read_bytes().replace(
            f"{2:6d}{11:12d}".encode(), b"     3" + b"%12d" % 11, 1
        )
    )
    with pytest.raises(ValueError, match="data set 1: .*binary numbers .*3"):
        ef.frf.FRFMeasurements.from_uff(path)


@pytest.mark.parametrize(
    ("above", "below", "kind", "expected"),
    [
        (8, 13, None, "receptance"),
        (11, 13, "mobility", "mobility"),
        (1, 0, "mobility", "mobility"),
        (12, 0, None, "data set 1: .*give kind="),
        (12, 13, "mobility", "data set 1: .*12 over 13 .*kind=.mobility"),
        (12, 12, "accelerance", "data set 1: .*12 over 12"),  # a transmissibility
    ],
)
def test_the_kind_is_what_the_file_says_or_else_given(
    tmp_path, above, below, kind, expected
):
    types = {"ordinate_spec_data_type": above, "orddenom_spec_data_type": below}
    path = write(tmp_path / "frf.uff", **types)
    if "data set" not in expected:
        assert ef.frf.FRFMeasurements.from_uff(path, kind=kind).kind == expected
        return
    with pytest.raises(ValueError, match=expected):
        ef.frf.FRFMeasurements.from_uff(path, kind=kind)


@pytest.mark.parametrize(
    ("response", "reference", "factor"),
    # Millimetres and millinewtons; a rotation has no length, a moment one more.
    [(1, 3, 1e3 / 1e3), (4, 3, 1e3), (1, 5, 1e3), (6, 5, 1e3 * 1e3), (0, 0, 1.0)],
)
def test_values_are_converted_to_si(tmp_path, response, reference, factor):
    path = write(tmp_path / "frf.uff", rsp_dir=response, ref_dir=reference)
    import pyuff

    units = pyuff.prepare_164(
        units_code=5, length=1e3, force=1e3, temp=1.0, temp_offset=273.15
    )
    sets = pyuff.UFF(str(path)).read_sets()
    pyuff.UFF(str(path)).write_sets([units, *sets], "overwrite")
    with pytest.warns(UserWarning, match="converted to SI .*164"):
        found = ef.frf.FRFMeasurements.from_uff(path)
    np.testing.assert_allclose(found.values, factor * H, rtol=1e-4)
    axes = ["", ":x", "", ":z", ":rx", ":ry", ":rz"]
    assert found.channels[0] == (f"4{axes[response]}", f"7{axes[reference]}")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("\n        18 ", "\n        17 ", "data set 1: .*abscissa .*17"),
        ("         4   1", "         4   7", "data set 1: .*response direction .*7"),
        ("    3         1", "    5         1", r"data set 1: .*\(5,\), got 3"),
    ],
)
def test_a_function_that_is_not_read_is_named(tmp_path, old, new, message):
    path = write(tmp_path / "frf.uff", abscissa_spec_data_type=18)
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(ValueError, match=message):
        ef.frf.FRFMeasurements.from_uff(path)


@pytest.mark.parametrize("spacing", [0, 1])
@pytest.mark.parametrize("double", [False, True])
@pytest.mark.parametrize("signs", [(1, 1), (-1, 1)])
def test_universal_files_of_every_form_of_text(tmp_path, signs, double, spacing):
    """A direction against its axis turns the sign."""
    form = {"ord_data_type": 6 if double else 5, "abscissa_spacing": spacing}
    path = write(tmp_path / "frf.uff", signs=signs, **form)
    found = ef.frf.FRFMeasurements.from_uff(path)
    assert found.channels == tuple(map(tuple, CHANNELS))
    assert found.kind == "accelerance" and found.coherence is None
    np.testing.assert_allclose(found.lines, LINES, rtol=1e-5)
    np.testing.assert_allclose(found.values, H, rtol=1e-10 if double else 1e-5)
    part = ef.frf.FRFMeasurements.from_uff(path, between=(1, 2))
    np.testing.assert_array_equal(part.values, found.values[:, :2])
    if double:  # as write has the coherences, which are read if they are of use
        known = ef.frf.FRFMeasurements.from_uff(path, averages=50)
        np.testing.assert_allclose(known.coherence, COHERENCE, rtol=1e-10)
        assert known.averages == 50
