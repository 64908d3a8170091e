import numpy as np
import pytest
from matplotlib.colors import to_hex

import emcee_femu as ef
from emcee_femu.results.evidence import Evidence


def drawn(**classes):
    found = {name: Evidence(*pair, "known") for name, pair in classes.items()}
    return ef.plot_model_comparison(ef.compare_models(found))


def test_points_bars_and_probabilities_are_those_of_the_table():
    figure = drawn(a=(-3.0, 0.3), b=(-1.0, 0.4), c=(-1.2, 0.1))
    left, right = figure.axes
    points = [c.lines[0] for c in left.containers]
    assert [line.get_xdata()[0] for line in points] == [0.0, pytest.approx(-0.2), -2.0]
    assert [t.get_text() for t in left.get_yticklabels()] == ["b", "c", "a"]
    assert [to_hex(line.get_mfc()) == "#ffffff" for line in points] == [
        False,
        True,
        False,
    ]
    segment = left.containers[2].lines[2][0].get_segments()[0]
    np.testing.assert_allclose(segment[:, 0], [-3.0, -1.0])  # two combined errors
    odds = np.exp([0.0, -0.2, -2.0])
    widths = [bar.get_width() for bar in right.patches]
    np.testing.assert_allclose(widths, odds / odds.sum())
    assert figure.get_suptitle().startswith("Undecided between b and c")


def test_what_has_no_error_has_no_bar_and_says_so():
    left = drawn(a=(-3.0, np.inf), b=(-1.0, 0.4)).axes[0]
    assert [t.get_text() for t in left.texts] == ["no error can be claimed"]
    assert not left.containers[1].has_xerr


def test_other_things_are_refused():
    with pytest.raises(TypeError, match="comparison: expected what compare_models ret"):
        ef.plot_model_comparison({})


def test_a_hopeless_class_is_named_and_does_not_hide_the_others():
    left, right = drawn(a=(-10.0, 0.1), b=(-10.5, 0.1), c=(-900.0, 0.1)).axes
    assert left.get_xlim()[0] > -3
    assert [text.get_text() for text in left.texts] == ["-890, far left"]
    assert [text.get_text() for text in right.texts] == ["0.622", "0.378", "< 0.001"]
