"""Figures of compared moves and model classes, and of FRFs: their numbers."""

import dataclasses

import numpy as np
import pytest
from matplotlib.colors import to_hex
from numpy.testing import assert_allclose, assert_array_equal
from support.figures import assert_nothing_is_clipped

import emcee_femu as ef

LONG = "a mixture of 90 % DE-MC and 10 % Metropolis-Hastings, as an engineer names it"
PRIOR = ef.GaussianPrior(["a", "b"], [1.0, 2.0], 0.3)
MODEL = ef.FunctionModel(lambda p: [p["a"], p["a"] + p["b"]], n_modes=2)
POSTERIOR = ef.LogPosterior(
    MODEL, ef.FrequencyTerm([1.0, 3.0], relative_sd=0.05), PRIOR
)
MOVES = {"M-H": ef.MetropolisMove(sd=0.002), LONG: ef.DEMCMove()}
MOVES["DE-MC"] = ef.DEMCMove()


@pytest.fixture(scope="module")
def comparison():
    """Two converged moves and one that crawls, whatever their chains are."""
    found = ef.compare_moves(POSTERIOR, MOVES, 8, 40, ensembles=2, seed=1)
    diagnoses = {}
    for label, diagnosis in found.diagnoses.items():
        status = "not converged" if label == "M-H" else "converged"
        chains = dataclasses.replace(diagnosis.chains, status=status, short=status)
        diagnoses[label] = dataclasses.replace(diagnosis, chains=chains)
    return dataclasses.replace(found, diagnoses=diagnoses)


def names(axes):
    return [text.get_text().replace("\n", " ") for text in axes.get_yticklabels()]


def test_bars_are_sorted_and_curves_are_of_the_kept_steps_in_their_colours(comparison):
    figure = ef.figures.plot_comparison(comparison)
    assert_nothing_is_clipped(figure)
    left, right = figure.axes
    numbers = np.array(list(comparison.efficiency.values()))
    order = np.argsort(numbers[:, 0])
    widths = [bar.get_width() for bar in left.patches]
    assert_allclose(widths, numbers[order, 0], rtol=1e-12)
    colours, labels = {}, [list(MOVES)[i] for i in order]
    for bar, label, shown in zip(left.patches, labels, names(left), strict=True):
        assert shown.startswith(label)
        colours[label] = to_hex(bar.get_edgecolor())
    for line, (label, idata) in zip(right.lines, comparison.idata.items(), strict=True):
        whole = ef.figures.plot_tae(idata, comparison.posterior).axes[0].lines[0]
        generations, tae = whole.get_data()
        assert generations[0] == 11  # a quarter of 40 was dropped
        assert_array_equal(line.get_xdata(), generations - 10)
        assert_array_equal(line.get_ydata(), tae)
        assert to_hex(line.get_color()) == colours[label]


@pytest.fixture(scope="module")
def known():
    return ef.log_evidence(ef.anneal(POSTERIOR, 40, seed=1))


def test_points_bars_and_probabilities_of_model_classes(known):
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
    assert len(left.texts) == 1 and not left.containers[1].has_xerr
    # A hopeless class does not hide the others.
    left, _ = drawn(a=(-10.0, 0.1), b=(-10.5, 0.1), c=(-900.0, 0.1))
    assert left.get_xlim()[0] > -3 and "-890" in left.texts[0].get_text()


def test_measured_amplitudes_of_frfs_are_drawn_by_channel():
    lines, channels = np.linspace(0.5, 6.0, 40), [(0, 1), (1, 1)]
    K = {"k1": np.diag([1.0, 0.0]), "k2": np.array([[1.0, -1.0], [-1.0, 1.0]])}
    two = ef.MatrixModel(np.zeros((2, 2)), np.eye(2), K, n_modes=2, shapes=True)
    model = ef.frf.FRFModel(two, lines, channels, damping=0.02)
    values = model({"k1": [550.0], "k2": [380.0]})["receptance"][0] @ [1, 1j]
    measured = ef.frf.FRFMeasurements(lines, values, channels, kind="receptance")
    prior = ef.GaussianPrior(["k1", "k2"], [550.0, 380.0], 50.0, [(9.0, 999.0)] * 2)
    posterior = ef.LogPosterior(model, ef.frf.FRFTerm(measured, sd=1e-3), prior)
    run = ef.run(posterior, ef.DEMCMove(), 8, 20, seed=1, ensembles=1)
    for axes, value in zip(ef.frf.plot_frf(run).axes, values, strict=True):
        assert_allclose(axes.lines[0].get_ydata(), np.abs(value))
