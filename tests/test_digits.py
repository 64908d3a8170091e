"""Two digits of the uncertainty decide how a number is printed."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from support.chains import by_hand

import emcee_femu as ef
from emcee_femu.digits import MOST_PLAIN, choose_units, show
from emcee_femu.table import number_columns

RNG = np.random.default_rng(5)
SDS = 10 ** RNG.uniform(-14, 14, 3_000)
VALUES = SDS * 10 ** RNG.uniform(-1, 4, 3_000) * RNG.choice([-1, 1], 3_000)


def test_what_is_printed_is_off_by_less_than_a_twentieth_of_the_uncertainty():
    printed = np.array(show(VALUES, SDS), float)
    assert (np.abs(printed - VALUES) / SDS).max() <= 0.0501


def test_no_third_digit_of_the_uncertainty_is_printed():
    for text, sd in zip(show(SDS, SDS), SDS, strict=True):
        digits = text.partition("e")[0].replace(".", "").strip("0")
        assert len(digits) <= 2, (text, sd)
        assert float(text) == pytest.approx(float(f"{sd:.1e}"))


def test_numbers_of_a_row_end_at_the_same_place():
    for sd in SDS[:300]:
        texts = show(sd * np.array([12.3, 1.23, 123.4]), sd)
        mantissas = [t.partition("e") for t in texts]
        ends = {int(power or 0) - len(m.partition(".")[2]) for m, _, power in mantissas}
        assert len(ends) == 1, texts


def test_special_numbers():
    assert show([np.nan, np.inf, -np.inf], 1.0) == ["", "inf", "-inf"]
    assert show([-1e-9, 0.0, 0.0], [1.0, 1.0, 1e9]) == ["0.0", "0.0", "0"]
    assert show([0.12345678, 2.374e10], [np.nan, 0.0]) == ["0.12346", "2.374e+10"]
    assert show([9.96, 9.94], [0.996, 0.994]) == ["10.0", "9.94"]  # 1.0 and 0.99


SCALE = {"": 1.0, "k": 1e3, "M": 1e6, "G": 1e9, "T": 1e12}
SCALE |= {"m": 1e-3, "µ": 1e-6, "n": 1e-9}


@pytest.mark.parametrize("unit, base", [("Pa", "Pa"), ("N/m", "N/m"), ("N m", "N m")])
@pytest.mark.parametrize("before", ["", "k", "M"])
def test_a_changed_prefix_keeps_the_quantity(unit, base, before):
    for size in 10.0 ** np.arange(-9, 13):
        ((shown, factor),) = choose_units([before + unit], [size])
        prefix = shown.removesuffix(base)
        assert_allclose(SCALE[prefix] * size / factor, SCALE[before] * size)
        if 1e-9 < SCALE[before] * size < 1e15:
            assert 1e-2 <= size / factor < MOST_PLAIN


@pytest.mark.parametrize("unit", ["", "m^4", "m²", "kg", "kg/m^3", "mm^2", "%", "1/m"])
def test_a_unit_without_such_a_prefix_is_left(unit):
    assert choose_units([unit], [3e8]) == [(unit, 1.0)]


@pytest.mark.parametrize("unit", ["N/m^2", "N/m2", "N/m²"])
def test_a_stress_is_shown_in_pascal(unit):
    assert choose_units([unit], [2e11]) == [("GPa", 1e9)]
    assert choose_units([f"k{unit}"], [2e8]) == [("GPa", 1e6)]
    assert choose_units([unit], [200.0]) == [(unit, 1.0)]


def test_cells_keep_their_own_unit():
    columns = [("mean", [2.374e10, 5.0], [1.5e9, 0.1]), ("2.5 %", [2e10, 4.8], 1e9)]
    (unit,), (mean, low) = number_columns(["Pa", "mm"], columns)
    assert unit == ("unit", ["GPa", "mm"], ["Pa", "mm"])
    assert mean[1] == ["23.7", "5.00"] and [*mean[2]] == [2.374e10, 5.0]
    assert low[1][0] == "20.0"


def test_a_difference_near_zero_has_no_coefficient_of_variation():
    draws = {"difference": RNG.normal(0.01, 1.0, (2, 500))}
    draws["sum"] = 5.0 + RNG.normal(0.0, 1.0, (2, 500))
    idata = by_hand(draws)
    near, far = ef.parameter_table(idata).column("c.o.v. %")
    assert np.isnan(near) and far == pytest.approx(20, rel=0.2)
