import ast
import csv
from collections import Counter

import numpy as np
import pytest
from support.universal_file import F, write_modes

from emcee_femu import Measurements

RNG = np.random.default_rng(22)
FIELDS = "frequencies sd covariance shapes shape_sd dofs phase_collinearity".split()
FIELDS += ["damping", "damping_sd"]
# Numbers whose shortest decimal form is long or odd, or that are tiny.
NASTY = np.array([np.pi, 0.1 + 0.2, 1e22, 5e-324, -0.0, 1 / 3, -1.7976931348623157e30])
LABELS = ["roof, north", 'the "old" one', "5:x", " blank ", "a;b\tc", "Ä", "two\nlines"]
FILLED_IN = """\
quantity,sensor,dof,mode 1,mode 2
frequency [Hz],,,3.13,9.83
sd [Hz],,,0.01,0.02
shape,roof,12,1.0,0.62
shape,floor 1,6,0.61,-1.0
shape sd,roof,,0.02,0.03
shape sd,floor 1,,0.02,0.03
"""


def assert_same_bits(first, second):
    assert first.sensors == second.sensors
    for field in FIELDS:
        a, b = getattr(first, field), getattr(second, field)
        assert (a is None) == (b is None), field
        if a is not None:
            assert a.dtype == b.dtype and a.tobytes() == b.tobytes(), field


def full(**options):
    f = np.nextafter([0.1, 3.0, 1e4], 9.0)
    root = RNG.standard_normal((3, 3)) * [[1e-3], [0.1], [3.0]]
    shapes = RNG.standard_normal((7, 3))
    shapes[:, 1] = NASTY
    values = {
        "covariance": root @ root.T,
        "shapes": shapes,
        "shape_sd": RNG.random((7, 3)),
        "sensors": LABELS,
        "dofs": [4, 0, 22, 7, 1, 3, 1_000_000],
        "phase_collinearity": [1 / 3 + 0.6, 0.1 + 0.85, 1.0],
        "damping": [0.01 + 0.02, 1e-3 / 3, 5e-324],
        "damping_sd": [1e-9 / 7, 1 / 3, 1.0],
    }
    return Measurements(f, **(values | options))


@pytest.mark.parametrize(
    "measurements",
    [
        full(),
        full(dofs=["3:uy", "12:ux", "0:rz", "4:uz", "4:uy", "4:ux", "roof, x"]),
        full(shapes=full().shapes * np.exp(2j), phase_collinearity=None),
        full(dofs=["1", "02", "'3'", "12.3", "4:uy", "٣", "²"]),
        full(covariance=None, sd=[None, 1 / 3, np.nan], damping=[None, None, 0.01]),
        Measurements([1 / 3], sd=[1e-300]),
        Measurements([0.1, 0.2]),
    ],
    ids=["all", "labels", "complex", "like numbers", "in part", "one mode", "bare"],
)
def test_a_file_returns_every_bit(measurements, tmp_path):
    path = tmp_path / "modes.csv"
    measurements.to_csv(path)
    assert_same_bits(Measurements.from_csv(path), measurements)


def written(tmp_path, text):
    path = tmp_path / "test.csv"
    path.write_text(text, encoding="utf-8")
    return path


def test_the_file_is_a_table_that_a_person_can_read(tmp_path):
    m = Measurements(
        [3.13, 9.83],
        sd=[0.01, 0.02],
        shapes=[[1.0, 0.62], [0.61, -1.0]],
        shape_sd=[[0.02, 0.03], [0.02, 0.03]],
        sensors=["roof", "floor 1"],
        dofs=[12, 6],
    )
    m.to_csv(tmp_path / "modes.csv")
    lines = (tmp_path / "modes.csv").read_text(encoding="utf-8").splitlines()
    lines.remove("phase collinearity,,,1.0,1.0")
    assert lines == FILLED_IN.splitlines()
    assert_same_bits(Measurements.from_csv(written(tmp_path, FILLED_IN)), m)


def test_a_blank_cell_is_a_missing_sensor(tmp_path):
    text = FILLED_IN.replace("shape,roof,12,1.0", "shape,roof,12,")
    text = text.replace("shape sd,roof,,0.02", "shape sd,roof,,")
    measured = Measurements.from_csv(written(tmp_path, text))
    assert np.isnan(measured.shapes[0, 0]) and np.isnan(measured.shape_sd[0, 0])
    assert np.isnan(measured.shapes).sum() == np.isnan(measured.shape_sd).sum() == 1
    measured.to_csv(tmp_path / "again.csv")
    assert "shape,roof,12,," in (tmp_path / "again.csv").read_text(encoding="utf-8")
    assert_same_bits(Measurements.from_csv(tmp_path / "again.csv"), measured)


@pytest.mark.parametrize(
    "change",
    [
        lambda text: "\ufeff" + text,  # Excel
        lambda text: text.replace("\n", ",,\r\n"),  # columns once used, and Windows
        lambda text: text.replace("\n", "\n\n,,,,\n"),
        lambda text: text.replace(",", ";").replace(".", ","),  # of other countries
        lambda text: text.replace(",", "\t"),
        lambda text: text.replace("frequency [Hz]", "Frequency").replace("sd", "SD"),
        lambda text: text.replace("frequency [Hz]", "f").replace("sd [Hz]", "Std"),
        lambda text: text.replace(",0", ", 0").replace("],,", "] , ,"),
        lambda text: "".join(  # rows in another order
            text.splitlines(keepends=True)[i] for i in (0, 3, 5, 1, 4, 6, 2)
        ),
    ],
    ids=["byte order mark", "Windows", "empty lines", "decimal commas", "tabs"]
    + ["titles", "short titles", "blanks", "order"],
)
def test_what_spreadsheets_add_does_not_matter(change, tmp_path):
    plain = Measurements.from_csv(written(tmp_path, FILLED_IN))
    changed = Measurements.from_csv(written(tmp_path, change(FILLED_IN)))
    assert_same_bits(changed, plain)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (",", "|", "line 1: .*separated by commas, semicolons or tabs"),
        ("1.0,0.62", "n/a,0.62", "line 4, column 'mode 1': .*'n/a'.*blank"),
        ("3.13,9.83", "3.13,", "line 2, column 'mode 2': .*no column"),
        ("quantity", "Mode", "line 1: .*pandas.*shapes="),
        ("sd [Hz]", "sigma", "line 3, column 'quantity': .*'sigma'"),
        ("0.01,0.02", "0,01,0,02", "line 3: 7 cells under 5 titles.*decimal point"),
        ("floor 1,6", "floor 1,", "column 'dof': .*'floor 1' has none"),
        ("shape,floor 1", "shape,", "line 5, columns 'sensor' .*got '' and '6'"),
        ("frequency [Hz],,,3.13,9.83\n", "", "no row 'frequency"),
    ],
)
def test_errors_name_line_and_column(old, new, message, tmp_path):
    assert old in FILLED_IN
    path = written(tmp_path, FILLED_IN.replace(old, new))
    with pytest.raises(ValueError, match=message) as caught:
        Measurements.from_csv(path)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize(("title", "factor"), [("zeta", 1), ("Damping [%]", 100)])
def test_damping_is_a_ratio_or_in_percent(title, factor, tmp_path):
    text = FILLED_IN + f"{title},,,{0.02 * factor},{0.01 * factor}\n"
    found = Measurements.from_csv(written(tmp_path, text))
    np.testing.assert_allclose(found.damping, [0.02, 0.01], rtol=1e-12)


def test_a_file_in_another_encoding_says_how_to_save_it(tmp_path):
    (tmp_path / "test.csv").write_bytes("quantity,Mode \xe4".encode("latin-1"))
    with pytest.raises(ValueError, match="test.csv: .*UTF-8"):
        Measurements.from_csv(tmp_path / "test.csv")


CSV = FILLED_IN.partition("shape sd")[0]


def cut(path, text, step, tail, read):
    """Yield the texts that end anywhere and were read all the same, and as what."""
    for end in range(0, len(text), step):
        path.write_bytes((text[:end] + tail).encode("latin-1"))
        try:
            yield text[:end] + tail, read(path)
        except ValueError as error:
            arguments = ("frequencies", "sd", "shapes", "sensors", "dofs")
            assert str(error).startswith((str(path), *arguments)), error


def cells(text):
    """Return how often each filled cell below the titles is there."""
    rows = [*csv.reader(text.splitlines())][1:]
    filled = [c for row in rows for c in row if c.strip("-") not in ("", "nan")]
    return Counter(c.removesuffix("0").removesuffix(".") for c in filled)


@pytest.mark.parametrize("tail", ["", "nan\n", '"', "\0", "1e999\n"])
def test_a_csv_file_that_ends_anywhere_is_refused_or_read_in_full(tmp_path, tail):
    path = tmp_path / "modes"
    for text, found in cut(path, CSV, 3 if tail else 1, tail, Measurements.from_csv):
        assert tail or found.shapes is None or np.isfinite(found.shapes).all()
        found.to_csv(path)
        assert not cells(text) - cells(path.read_text()), text


def test_modes_that_a_universal_file_has_twice_are_left_out_as_it_says(tmp_path):
    path = write_modes(tmp_path / "modes")
    plain = Measurements.from_uff(path)
    path.write_text(2 * path.read_text())
    with pytest.raises(ValueError, match="the same") as error:
        Measurements.from_uff(path)
    wanted = ast.literal_eval(str(error.value).rpartition("modes=")[2])
    found = Measurements.from_uff(path, modes=wanted)
    np.testing.assert_array_equal(found.frequencies, plain.frequencies)
    np.testing.assert_array_equal(found.shapes, plain.shapes)


@pytest.mark.parametrize("tail", ["", "    -1\n", "\0", "1e999\n"])
def test_a_universal_file_that_ends_anywhere_is_refused_or_read(tmp_path, tail):
    path = write_modes(tmp_path / "modes")
    for _, found in cut(path, path.read_text(), 97, tail, Measurements.from_uff):
        np.testing.assert_array_equal(found.frequencies, F[: found.n_modes])
