"""Where a full model is solved next."""

import numpy as np
import pytest
from support.few_solves import broken, posed

import emcee_femu as ef
from emcee_femu.sampling import emulate_rounds
from emcee_femu.sampling.design import choose_batch, first_points, first_size
from emcee_femu.sampling.log_scale import LogScale

LINE = np.linspace(0.0, 10.0, 101)[:, None]


def remaining(points, extra):
    """Return what is left beside points that teach all within about 1."""
    if not len(extra):
        return np.ones(len(points))
    return 1 - np.exp(-((points - extra.T) ** 2)).max(axis=1)


def test_each_point_of_a_batch_counts_with_those_before():
    error = np.exp(-((LINE[:, 0] - 4.0) ** 2) / 8)
    found = choose_batch([LINE], [error], LINE[:0], 3, remaining)
    assert found[0] == 4.0
    assert (np.diff(np.sort(found[:, 0])) > 1.0).all()
    # Growth: a shorter batch is the beginning of a longer one.
    assert (choose_batch([LINE], [error], LINE[:0], 2, remaining) == found[:2]).all()


def test_what_failed_is_not_asked_again():
    error = np.exp(-((LINE[:, 0] - 4.0) ** 2) / 8)
    (found,) = choose_batch([LINE], [error], np.array([[4.0]]), 1, remaining)
    assert abs(found[0] - 4.0) > 0.9


def test_no_point_is_taken_twice_even_if_all_is_known():
    none = np.zeros(len(LINE))
    found = choose_batch([LINE], [none], LINE[:0], 4, remaining)
    assert len(np.unique(found)) == 4


def test_the_first_point_comes_from_the_first_candidates():
    far = LINE + 100.0
    batch = choose_batch([far, LINE], [np.ones(101)] * 2, LINE[:0], 3, remaining)
    assert (batch[:, 0] > 50).tolist() == [True, False, False]


@pytest.mark.parametrize("around", [None, np.array([-0.5, 0.0, 0.9])])
def test_a_first_design_spreads_inside_the_prior(around):
    prior = ef.GaussianPrior(["a", "b", "c"], np.zeros(3), 1.0, [(-1.0, 1.0)] * 3)
    points = first_points(LogScale.of(prior), np.random.SeedSequence(1), around)
    assert points.shape == (first_size(3), 3)
    assert np.isfinite(prior.logpdf(points)).all()
    centre = np.zeros(3) if around is None else around
    np.testing.assert_allclose(points[0], centre, atol=0.01)
    reach = abs(points[1:] - centre).max()
    assert 0.5 < reach < 0.81 if around is None else reach < 0.26


def test_failed_solves_are_told_to_the_design(monkeypatch, caplog):
    told = []

    def choose(candidates, errors, known, number, remaining):
        told.append(known)
        return choose_batch(candidates, errors, known, number, remaining)

    monkeypatch.setattr(emulate_rounds, "choose_batch", choose)
    caplog.set_level("CRITICAL", "emcee_femu")
    posterior = posed(broken)
    ef.emulate(posterior, 8, seed=3, on_failure="reject", max_failures=0.5)
    first = np.array(posterior.model.solved[:6])
    assert (told[0] == first[first[:, 0] > 0.9]).all() and len(told[0])
