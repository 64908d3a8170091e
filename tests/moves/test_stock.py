"""emcee's own moves that sample wrongly are named by what the installed ones do."""

import warnings

import emcee
import numpy as np
import pytest

import emcee_femu as ef

COVARIANCE = 0.01 * np.array([[2.0, 0.3, 0.1], [0.3, 1.0, 0.2], [0.1, 0.2, 3.0]])


def installed_is_wrong(move):
    """Return whether emcee's issues hold: equal steps, or a wrong factor."""
    random = np.random.RandomState(3)
    if isinstance(move, emcee.moves.GaussianMove):
        return np.array_equal(*move.get_proposal(np.zeros((2, 3)), random)[0])
    guides = [np.array([[1.0, 0.0, 0.0]]) + shift for shift in np.eye(3) - np.eye(3)[0]]
    x = np.array([[0.0, 0.2, -0.3]])
    q, factor = move.get_proposal(x, guides, random)
    ratios = [np.log(np.linalg.norm(q - z) / np.linalg.norm(x - z)) for z in guides]
    return not np.isclose(2 * np.array(ratios), factor).any()


POSTERIOR = ef.LogPosterior(
    lambda p: ef.ModalSolution(np.stack([p["a"], p["b"], p["c"]], axis=-1)),
    ef.FrequencyTerm([1.0, 2.0, 3.0], relative_sd=0.1),
    ef.GaussianPrior(["a", "b", "c"], [1.0, 2.0, 3.0], 0.3),
)
GAUSSIAN, SNOOKER = emcee.moves.GaussianMove(COVARIANCE), emcee.moves.DESnookerMove()
MOVES = {
    "alone": GAUSSIAN,
    "mixed": [(ef.DEMCMove(), 0.8), (SNOOKER, 0.2)],
    "variances": emcee.moves.GaussianMove([0.5, 1.0, 2.0]),
    "stretch": [(emcee.moves.DEMove(), 0.5), (emcee.moves.StretchMove(), 0.5)],
}
WRONG = {"alone": GAUSSIAN, "mixed": SNOOKER}  # if the installed one is


SLOW = pytest.mark.slow


@pytest.mark.parametrize("version", [None, pytest.param("3.1.10", marks=SLOW)])
def test_a_comparison_warns_of_what_is_wrong(version, monkeypatch):
    """And of no later release."""
    if version:
        monkeypatch.setattr(emcee, "__version__", version)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        ef.compare_moves(POSTERIOR, MOVES, 16, 12, ensembles=2, seed=1)
    wrong = [label for label in WRONG if installed_is_wrong(WRONG[label])]
    assert len(caught) == (0 if version else len(wrong))


@pytest.mark.parametrize("label", MOVES)
def test_a_run_warns_of_what_is_wrong_before_it_solves(label):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        ef.run(POSTERIOR, MOVES[label], 16, 12, ensembles=1, seed=1)
    wrong = label in WRONG and installed_is_wrong(WRONG[label])
    assert [w.filename for w in caught] == [__file__] * wrong
