"""What an evaluator asks of a model that fails at some points."""

import numpy as np
from scipy import stats

import emcee_femu as ef
from emcee_femu.evaluation.evaluator import Evaluation, Solver
from emcee_femu.evaluation.failures import FailureLog

NAMES = ("a", "b", "c")


class Fails:
    """Frequencies that cannot be solved above a = 2, nor differentiated below 1."""

    names, one_by_one = NAMES, True
    variables = ef.modal_variables(3)

    def __init__(self):
        self.solved = []

    def __call__(self, parameters):
        a = parameters["a"]
        self.solved += a.tolist()
        if (a > 2).any():
            raise RuntimeError("no equilibrium")
        return ef.ModalSolution(np.stack([parameters[k] for k in NAMES], axis=1))

    def jacobian(self, parameters):
        if (parameters["a"] < 1).any():
            raise ef.contracts.RepeatedModes("two modes coincide")
        units = {k: np.eye(3)[i][None] for i, k in enumerate(NAMES)}
        return self(parameters), {"frequency": units}


def test_derivatives_are_differenced_where_they_fail_and_not_where_the_solve_does():
    model, n = Fails(), 3
    term = ef.FrequencyTerm([1.5, 1.0, 1.0], relative_sd=0.1)
    laws = dict.fromkeys(NAMES, stats.uniform(0.1, 4.9))
    posterior = ef.LogPosterior(model, term, ef.IndependentPrior(laws))
    evaluation = Evaluation(Solver(posterior, True), failures=FailureLog(1.0))
    theta = np.array([[0.7, 1.1, 0.9], [1.4, 1.1, 0.9], [2.5, 1.1, 0.9]])
    found = evaluation.linearize(theta)
    assert np.isfinite(found.rows[:, 0]).tolist() == [True, True, False]
    assert np.isfinite(found.gradient).all(axis=1).tolist() == [True, True, False]
    exact = (np.array([1.5, 1.0, 1.0]) - theta) / (0.1 * np.array([1.5, 1, 1])) ** 2
    np.testing.assert_allclose(found.gradient[:2], exact[:2], rtol=1e-3)
    # By differences d + 1 solves; beside a failed solve none, but it may be repeated.
    solved = np.array(model.solved)
    assert (solved < 1).sum() == 1 + n + 1 and set(solved[solved > 1]) == {1.4, 2.5}
