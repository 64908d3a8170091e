"""emcee's own moves that sample wrongly are named by what the installed ones do."""

import emcee
import numpy as np
import pytest

import emcee_femu as ef
from emcee_femu.moves.proposing import find_stock_fault

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
WRONG = {  # if the installed one is
    "alone": (GAUSSIAN, GAUSSIAN),
    "mixed": ([(ef.DEMCMove(), 0.8), (SNOOKER, 0.2)], SNOOKER),
}
RIGHT = {
    "variance": emcee.moves.GaussianMove(0.5),
    "variances": emcee.moves.GaussianMove([0.5, 1.0, 2.0]),
    "stretch": [(emcee.moves.DEMove(), 0.5), (emcee.moves.StretchMove(), 0.5)],
    "KDE": emcee.moves.KDEMove(),
    "ours": [(ef.DEMCMove(), 0.5), (ef.MetropolisMove(cov=COVARIANCE), 0.5)],
}


def test_a_comparison_warns_once_of_what_is_wrong_and_of_nothing_else():
    moves = {label: move for label, (move, _) in WRONG.items()} | RIGHT
    with pytest.warns(UserWarning) as caught:
        ef.compare_moves(POSTERIOR, moves, 16, 20, ensembles=2, seed=1)
    (warning,) = caught
    text = str(warning.message)
    for label, (_, move) in WRONG.items():
        assert (f"{label}: " in text) == installed_is_wrong(move)
    assert not any(f"{label}: " in text for label in RIGHT)
    assert warning.filename == __file__


@pytest.mark.parametrize("version", ["3.1.10", "3.2.0", "4.0.0.dev3+gabc", "3.1.7"])
def test_later_releases_of_emcee_are_not_denounced(version, monkeypatch):
    monkeypatch.setattr(emcee, "__version__", "3.1.6")
    assert find_stock_fault(SNOOKER, 3) and find_stock_fault(GAUSSIAN, 3)
    monkeypatch.setattr(emcee, "__version__", version)
    assert not find_stock_fault(SNOOKER, 3) and not find_stock_fault(GAUSSIAN, 3)


def test_a_run_and_its_report_print_what_emcees_moves_were_given():
    run = ef.run(POSTERIOR, emcee.moves.StretchMove(a=3.0), steps=2, seed=1)
    said = "1 x StretchMove(a=3.0, "
    assert said in str(run)
    assert said in ef.to_inference_data(run).posterior.attrs["moves"]
