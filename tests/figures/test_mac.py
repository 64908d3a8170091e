"""The MAC matrix before and after updating, by closed forms of a tower."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from support.chains import dataset
from support.figures import assert_readable
from support.tower import HERTZ, MEASURED, MODEL, PRIOR, SHAPES, at_mean, solved

import emcee_femu as ef


def run_of(shapes):
    test = ef.Measurements(HERTZ, shapes=shapes, dofs=[0, 1])
    term = ef.FrequencyTerm(test, relative_sd=0.01)
    paired = ef.PairedModel(MODEL, test, candidates=2)
    posterior = ef.LogPosterior(paired, term, PRIOR)
    return ef.run(posterior, ef.DEMCMove(), 8, 20, ensembles=1, seed=1)


def test_the_matrix_has_the_mac_before_and_after_with_frames_around_the_pairs():
    for shapes, pairs in (
        (MEASURED, [[0, 0], [1, 1]]),
        (SHAPES[:, ::-1], [[1, 0], [0, 1]]),
    ):
        source = run_of(shapes)
        figure = ef.figures.plot_mac(source)
        assert_readable(figure)
        before_and_after = solved(*PRIOR.mean), at_mean(source)
        for axes, own in zip(figure.axes, before_and_after, strict=False):
            expected = (shapes.T @ own) ** 2 / (shapes**2).sum(axis=0)[:, None]
            assert_allclose(axes.images[0].get_array(), expected, rtol=1e-9)
            centres = [np.mean(p.get_corners(), axis=0) for p in axes.patches]
            assert_allclose(centres, pairs, atol=1e-12)
        mac = dataset(ef.to_inference_data(source), "response")["mac"].values
        for x, mode in pairs:  # to three digits, since many are close to 1
            (text,) = (t for t in axes.texts if t.get_position() == (x, mode))
            ends = [float(end) for end in text.get_text().split("\n")[1].split("–")]
            expected = np.quantile(mac[..., mode], [0.025, 0.975])
            assert_allclose(ends, expected, rtol=0, atol=6e-4)


@pytest.mark.parametrize(("gap", "names"), [(0.0199, "of 1, 2"), (0.0201, "")])
def test_a_pair_of_close_modes_names_all_whose_subspace_it_is_compared_with(gap, names):
    model = ef.FunctionModel(
        lambda p: ef.ModalSolution(np.array([p["k1"], p["k1"] * (1 + gap)]), np.eye(2)),
        variables=ef.modal_variables(2, [0, 1]),
    )
    test = ef.Measurements([12.0], shapes=[[1.0], [0.1]], dofs=[0, 1])
    term = ef.FrequencyTerm(test, relative_sd=0.01)
    posterior = ef.LogPosterior(ef.PairedModel(model, test), term, PRIOR)
    run = ef.run(posterior, ef.DEMCMove(), 8, 20, ensembles=1, seed=1)
    figure = ef.figures.plot_mac(run)
    assert_readable(figure)
    for axes in figure.axes[:2]:
        pair, other = (text.get_text().partition("\n")[0] for text in axes.texts)
        assert pair.partition(" ")[2] == names and " " not in other
