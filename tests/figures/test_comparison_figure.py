"""Figures of compared moves and model classes, and of FRFs: their numbers."""

import dataclasses

import numpy as np
from matplotlib.colors import to_hex
from numpy.testing import assert_allclose, assert_array_equal

import emcee_femu as ef

PRIOR = ef.GaussianPrior(["a", "b"], [1.0, 2.0], 0.3)
MODEL = ef.FunctionModel(lambda p: [p["a"], p["a"] + p["b"]], n_modes=2)
POSTERIOR = ef.LogPosterior(
    MODEL, ef.FrequencyTerm([1.0, 3.0], relative_sd=0.05), PRIOR
)


def names(axes):
    return [text.get_text().partition("\n")[0] for text in axes.get_yticklabels()]


def test_bars_are_sorted_and_curves_are_of_the_kept_steps_in_their_colours():
    moves = {"M-H": ef.MetropolisMove(sd=0.002), "DE-MC": ef.DEMCMove()}
    found = ef.compare_moves(POSTERIOR, moves, 8, 40, ensembles=2, seed=1)
    left, right = ef.figures.plot_comparison(found).axes
    efficiency = {label: value for label, (value, _) in found.efficiency.items()}
    assert names(left) == sorted(efficiency, key=efficiency.get)
    widths = [bar.get_width() for bar in left.patches]
    assert_allclose(widths, sorted(efficiency.values()), rtol=1e-12)
    edges = [to_hex(bar.get_edgecolor()) for bar in left.patches]
    colours = dict(zip(names(left), edges, strict=True))
    for line, (label, idata) in zip(right.lines, found.idata.items(), strict=True):
        whole = ef.figures.plot_tae(idata, found.posterior).axes[0].lines[0]
        generations, tae = whole.get_data()
        assert generations[0] == 11  # a quarter of 40 was dropped
        assert_array_equal(line.get_xdata(), generations - 10)
        assert_array_equal(line.get_ydata(), tae)
        assert to_hex(line.get_color()) == colours[label]


def test_points_bars_and_probabilities_of_model_classes():
    known = ef.log_evidence(ef.anneal(POSTERIOR, 40, seed=1))

    def drawn(**classes):
        keys = "log_evidence", "log_evidence_error"
        found = {
            name: dataclasses.replace(known, **dict(zip(keys, pair, strict=True)))
            for name, pair in classes.items()
        }
        return ef.figures.plot_model_comparison(ef.compare_models(found)).axes

    left, right = drawn(a=(-3.0, 0.3), b=(-1.0, 0.4), c=(-1.2, 0.1))
    points = [c.lines[0].get_xdata()[0] for c in left.containers]
    assert_allclose(points, [0.0, -0.2, -2.0])
    assert names(left) == ["b", "c", "a"]
    segment = left.containers[2].lines[2][0].get_segments()[0]
    assert_allclose(segment[:, 0], [-3.0, -1.0])  # two combined errors
    odds = np.exp([0.0, -0.2, -2.0])
    assert_allclose([bar.get_width() for bar in right.patches], odds / odds.sum())
    left, _ = drawn(a=(-3.0, np.inf), b=(-1.0, 0.4))  # no error can be claimed
    assert not left.containers[1].has_xerr


def test_measured_amplitudes_of_frfs_are_drawn_by_channel():
    lines, channels = np.linspace(0.5, 6.0, 40), [(0, 1), (1, 1)]
    K = {"k": np.array([[2.0, -1.0], [-1.0, 1.0]])}
    two = ef.MatrixModel(np.zeros((2, 2)), np.eye(2), K, n_modes=2, shapes=True)
    model = ef.frf.FRFModel(two, lines, channels, damping=0.02)
    values = model({"k": [550.0]})["receptance"][0] @ [1, 1j]
    measured = ef.frf.FRFMeasurements(lines, values, channels, kind="receptance")
    term = ef.frf.FRFTerm(measured, sd=1e-3)
    posterior = ef.LogPosterior(model, term, ef.IndependentPrior({"k": (9, 999)}))
    run = ef.run(posterior, ef.DEMCMove(), 8, 20, seed=1, ensembles=1)
    for axes, value in zip(ef.frf.plot_frf(run).axes, values, strict=True):
        assert_allclose(axes.lines[0].get_ydata(), np.abs(value))
