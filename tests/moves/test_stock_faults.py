import emcee
import numpy as np
import pytest

import emcee_femu as ef
from emcee_femu.moves.stock_faults import find_stock_fault

COVARIANCE = 0.01 * np.array([[2.0, 0.3, 0.1], [0.3, 1.0, 0.2], [0.1, 0.2, 3.0]])


class MendedSnooker(emcee.moves.DESnookerMove):
    """Eq. 4 of ter Braak and Vrugt (2008), written anew."""

    def get_proposal(self, s, c, random):
        q, factors = np.empty_like(s), np.empty(len(s))
        for i, x in enumerate(s):
            z, z1, z2 = random.permutation(
                [part[random.randint(len(part))] for part in c]
            )
            line = (x - z) / np.linalg.norm(x - z)
            q[i] = x + self.gammas * line * (line @ (z1 - z2))
            factors[i] = np.log(np.linalg.norm(q[i] - z) / np.linalg.norm(x - z))
        return q, (s.shape[1] - 1) * factors


class HalfFactor(MendedSnooker):
    def get_proposal(self, s, c, random):
        q, factors = super().get_proposal(s, c, random)
        return q, 0.5 * factors


class OffTheLine(MendedSnooker):
    def get_proposal(self, s, c, random):
        q, factors = super().get_proposal(s, c, random)
        z = c[0][0]  # the same distance from a guide, another direction
        return z + np.roll(q - z, 1, axis=1), factors


class MendedProposal(emcee.moves.GaussianMove):
    def __init__(self, cov):
        super().__init__(cov)
        factor = np.linalg.cholesky(cov)
        self.get_proposal = lambda x, random: (
            x + random.standard_normal(x.shape) @ factor.T,
            np.zeros(len(x)),
        )


def installed_is_wrong(move):
    """Return whether the reviewers' numbers hold: equal steps, or a wrong factor."""
    random = np.random.RandomState(3)
    if isinstance(move, emcee.moves.GaussianMove):
        steps = move.get_proposal(np.zeros((2, 3)), random)[0]
        return np.array_equal(*steps)
    same = [np.array([[1.0, 0.0, 0.0]])] * 3  # z = z1 = z2: no step, whatever is drawn
    same = [same[0], same[0] + [[0, 1.0, 0]], same[0] + [[0, 0, 1.0]]]
    x = np.array([[0.0, 0.2, -0.3]])
    q, factor = move.get_proposal(x, same, random)
    ratios = [np.log(np.linalg.norm(q - z) / np.linalg.norm(x - z)) for z in same]
    return not np.isclose(2 * np.array(ratios), factor).any()


@pytest.mark.parametrize(
    ("move", "name"),
    [
        (emcee.moves.GaussianMove(COVARIANCE), "GaussianMove"),
        (emcee.moves.DESnookerMove(), "DESnookerMove"),
    ],
)
def test_a_stock_move_is_named_as_long_as_the_installed_one_is_wrong(move, name):
    fault = find_stock_fault(move, 3)
    assert bool(fault) == installed_is_wrong(move)
    assert not fault or name in fault


@pytest.mark.parametrize("move", [HalfFactor(), OffTheLine()])
def test_a_wrong_snooker_of_any_kind_is_found(move):
    assert "DESnookerMove" in find_stock_fault(move, 3)


@pytest.mark.parametrize(
    "move",
    [
        MendedSnooker(),
        MendedProposal(COVARIANCE),
        emcee.moves.GaussianMove(0.5),
        emcee.moves.GaussianMove([0.5, 1.0, 2.0]),
        emcee.moves.DEMove(),
        emcee.moves.StretchMove(),
        emcee.moves.KDEMove(),
        ef.DEMCMove(),
        ef.MetropolisMove(cov=COVARIANCE),
    ],
    ids=lambda move: type(move).__name__,
)
def test_a_right_move_is_not_blamed(move):
    assert find_stock_fault(move, 3) == ""


def test_trying_a_move_leaves_it_as_it_was():
    move = emcee.moves.GaussianMove(0.5, mode="sequential")
    find_stock_fault(move, 3)
    assert move.get_proposal.index == 0


POSTERIOR = ef.LogPosterior(
    lambda p: ef.ModalSolution(np.stack([p["a"], p["b"], p["c"]], axis=-1)),
    ef.FrequencyTerm([1.0, 2.0, 3.0], relative_sd=0.1),
    ef.GaussianPrior(["a", "b", "c"], [1.0, 2.0, 3.0], 0.3),
)


def test_a_comparison_warns_once_and_by_name():
    moves = {
        "alone": emcee.moves.GaussianMove(COVARIANCE),
        "mixed": [(ef.DEMCMove(), 0.8), (emcee.moves.DESnookerMove(), 0.2)],
        "right": ef.DEMCMove(),
        "mended": [(MendedProposal(COVARIANCE), 0.5), (MendedSnooker(), 0.5)],
    }
    if not all(map(installed_is_wrong, (moves["alone"], moves["mixed"][1][0]))):
        pytest.skip("this release of emcee has mended the moves")
    with pytest.warns(UserWarning) as caught:
        ef.compare_moves(POSTERIOR, moves, 16, 60, ensembles=2, seed=1)
    (warning,) = caught
    text = str(warning.message)
    assert "alone: GaussianMove" in text and "mixed: DESnookerMove" in text
    assert "right" not in text and "mended" not in text
    assert warning.filename == __file__
