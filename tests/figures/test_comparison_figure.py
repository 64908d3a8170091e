import dataclasses

import numpy as np
import pytest
from matplotlib.colors import to_hex
from numpy.testing import assert_allclose, assert_array_equal
from support.figures import assert_nothing_is_clipped, legend

import emcee_femu as ef
from emcee_femu.results.fit import Statement

LONG = (
    "a mixture of 90 % DE-MC and 10 % Metropolis-Hastings, as an engineer may name it"
)
PRIOR = ef.GaussianPrior(["a", "b"], [1.0, 2.0], 0.3)
MODEL = ef.FunctionModel(lambda p: [p["a"], p["a"] + p["b"]], n_modes=2)
TERM = ef.FrequencyTerm([1.0, 3.0], relative_sd=0.05)
ANNEALED = ef.anneal(ef.LogPosterior(MODEL, TERM, PRIOR), 40, seed=1)
MOVES = {
    "M-H": ef.MetropolisMove(sd=0.002),
    LONG: [(ef.DEMCMove(), 0.9), (ef.MetropolisMove(sd=0.05), 0.1)],
    "DE-MC": ef.DEMCMove(),
}


@pytest.fixture(scope="module")
def comparison():
    """Two converged moves and one that crawls, whatever their chains are."""
    posterior = ef.LogPosterior(MODEL, TERM, PRIOR)
    found = ef.compare_moves(posterior, MOVES, 8, 200, ensembles=2, seed=1)
    crawling = Statement("not converged", "too short: 3 tau", "")
    good = Statement("converged", "converged", "")
    chains = dict(zip(MOVES, [crawling, good, good], strict=True))
    diagnoses = {
        label: dataclasses.replace(diagnosis, chains=chains[label])
        for label, diagnosis in found.diagnoses.items()
    }
    return dataclasses.replace(found, diagnoses=diagnoses)


def shown(axes):
    return [text.get_text().replace("\n", " ") for text in axes.get_yticklabels()]


def test_bars_are_sorted_and_show_value_spread_and_verdict(comparison):
    axes = ef.figures.plot_comparison(comparison).axes[0]
    numbers = np.array(list(comparison.efficiency.values()))
    column = comparison.table.column
    assert_array_equal(numbers.T, [column("ESS per 1000"), column("+-")])
    order = np.argsort(numbers[:, 0])
    values, errors = numbers[order].T
    assert_allclose([bar.get_width() for bar in axes.patches], values, rtol=1e-12)
    (bars,) = (box for box in axes.containers if hasattr(box, "patches"))
    lines = bars.errorbar.lines[2][0].get_segments()
    drawn = [np.abs(np.diff(line[:, 0]))[0] for line in lines]
    assert_allclose(drawn, 2 * errors, rtol=1e-12)
    failed = {"M-H": "M-H (too short: 3 tau)"}
    labels = [failed.get(label, label) for label in MOVES]
    assert shown(axes) == [labels[i] for i in order]
    for bar, i in zip(axes.patches, order, strict=True):
        fit = comparison.diagnoses[list(MOVES)[i]].converged
        assert bool(bar.get_hatch()) != fit
        assert (bar.get_facecolor()[3] == 1) == fit
    assert [text.get_text() for text in axes.texts] == [f"{v:.3g}" for v in values]
    trust = "not converged, so the number cannot be trusted"
    assert legend(axes.figure) == ["converged", trust]


def test_error_curves_are_those_of_the_kept_steps_in_the_colours_of_the_bars(
    comparison,
):
    bars, axes = ef.figures.plot_comparison(comparison).axes
    edge = {
        label.split(" (")[0]: to_hex(bar.get_edgecolor())
        for label, bar in zip(shown(bars), bars.patches, strict=True)
    }
    assert len(set(edge.values())) == len(axes.lines) == len(MOVES)
    for line, (label, idata) in zip(axes.lines, comparison.idata.items(), strict=True):
        whole = ef.figures.plot_tae(idata, comparison.posterior).axes[0].lines[0]
        generations, tae = whole.get_data()
        assert generations[0] == 51  # a quarter of 200 was dropped
        assert_array_equal(line.get_xdata(), generations - 50)
        assert_array_equal(line.get_ydata(), tae)
        assert to_hex(line.get_color()) == edge[label]
        assert line.get_linestyle() == ("--" if label == "M-H" else "-")
    assert axes.get_title() == "same colours; dashed: not converged"


def test_nothing_is_clipped_and_the_headline_is_the_conclusion(comparison):
    """Also where there are many moves with long names, without frequencies."""
    labels = [f"{LONG} number {i}" for i in range(12)]
    diagnoses, efficiency = (
        dict(zip(labels, 4 * [*held.values()], strict=True))
        for held in (comparison.diagnoses, comparison.efficiency)
    )
    many = dataclasses.replace(
        comparison, diagnoses=diagnoses, efficiency=efficiency, idata={}
    )
    for item in (comparison, many):
        figure = ef.figures.plot_comparison(item)
        headline = figure.get_suptitle()
        assert headline.replace("\n", " ") == item.conclusion.splitlines()[0]
        assert_nothing_is_clipped(figure, headline)
        panel = figure.axes[0]
        ends = [text.get_window_extent().x1 for text in panel.texts]
        assert max(ends) <= panel.get_window_extent().x1  # clear of the next panel
    assert len(figure.axes) == 1
    low = [label.get_window_extent() for label in panel.get_yticklabels()]
    assert all(a.y1 <= b.y0 + 1 for a, b in zip(low, low[1:], strict=False))  # legible


def evidence(value, error):
    """Return an evidence that was found elsewhere."""
    known = ef.log_evidence(ANNEALED)
    return dataclasses.replace(known, log_evidence=value, log_evidence_error=error)


def drawn(**classes):
    found = {name: evidence(*pair) for name, pair in classes.items()}
    return ef.figures.plot_model_comparison(ef.compare_models(found))


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
    assert_allclose(segment[:, 0], [-3.0, -1.0])  # two combined errors
    odds = np.exp([0.0, -0.2, -2.0])
    widths = [bar.get_width() for bar in right.patches]
    assert_allclose(widths, odds / odds.sum())
    assert figure.get_suptitle().startswith("Undecided between b and c")


def test_what_has_no_error_has_no_bar_and_says_so():
    left = drawn(a=(-3.0, np.inf), b=(-1.0, 0.4)).axes[0]
    assert [t.get_text() for t in left.texts] == ["no error can be claimed"]
    assert not left.containers[1].has_xerr


def test_a_hopeless_class_is_named_and_does_not_hide_the_others():
    left, right = drawn(a=(-10.0, 0.1), b=(-10.5, 0.1), c=(-900.0, 0.1)).axes
    assert left.get_xlim()[0] > -3
    assert [text.get_text() for text in left.texts] == ["-890, far left"]
    assert [text.get_text() for text in right.texts] == ["0.622", "0.378", "< 0.001"]
