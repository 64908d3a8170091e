"""Model classes compared by known evidences."""

import dataclasses

import numpy as np
import pytest
from numpy.testing import assert_allclose
from support.tempered_laws import GaussianLaw

import emcee_femu as ef

LAW = GaussianLaw()
ANNEALED = ef.anneal(LAW.posterior, 100, seed=1)


def known(value, error=0.1, *problems):
    """Return an evidence that was found elsewhere."""
    changes = {"log_evidence": value, "log_evidence_error": error}
    found = ef.log_evidence(ANNEALED)
    return dataclasses.replace(found, **changes, problems=problems)


def test_bayes_factors_and_probabilities_are_exact():
    classes = {"a": known(-10.0, 0.3), "b": known(-8.0, 0.4), "c": known(-13.5, 0.0)}
    found = ef.compare_models(classes, prior={"a": 3.0, "b": 1.0, "c": 1.0})
    column = found.table.column
    assert column("model class") == ["b", "a", "c"] == list(found.probabilities)
    assert_allclose(column("log evidence"), [-8.0, -10.0, -13.5])
    assert_allclose(column("ln Bayes factor"), [0.0, 2.0, 5.5])
    assert_allclose(column("its +-"), [0.0, 0.5, 0.4])
    odds = np.array([1.0, 3 * np.exp(-2.0), np.exp(-5.5)])
    assert_allclose(column("probability"), odds / odds.sum(), rtol=1e-12)
    assert found.winner == "b"
    equal = ef.compare_models(classes)
    assert_allclose(equal.probabilities["a"], np.exp(-2) / np.exp([0, -2, -5.5]).sum())


@pytest.mark.parametrize(
    ("lead", "verdict"),
    [(0.9, "weak"), (1.1, "positive"), (4.9, "strong"), (9_000.0, "very strong")],
)
def test_words_are_those_of_kass_and_raftery(lead, verdict):
    found = ef.compare_models({"x": known(-5.0 - lead), "y": known(-5.0)})
    assert found.table.column("verdict") == ["first", f"behind, {verdict}"]


@pytest.mark.parametrize(
    ("winner", "classes"),
    [  # two combined errors decide; a third is behind in any case
        (None, {"x": known(-0.99, 0.4), "y": known(0.0, 0.3)}),
        ("y", {"x": known(-1.01, 0.4), "y": known(0.0, 0.3)}),
        (None, {"x": known(-1.0), "y": known(-1.1), "z": known(-5.0)}),
        (None, {"x": known(-99.0, np.inf, "lost"), "y": known(0.0)}),
    ],
)
def test_a_difference_within_two_combined_errors_is_undecided(winner, classes):
    found = ef.compare_models(classes)
    assert found.winner == winner
    if winner is None:
        assert "z" not in found.conclusion.splitlines()[0]


def test_it_takes_runs_and_what_anneal_returns_and_names_what_it_refuses():
    move = ef.moves.TemperedMove(ef.DEMCMove(), np.linspace(1, 0, 4) ** 3)
    run = ef.run(LAW.posterior, move, nwalkers=32, steps=60, seed=1, ensembles=1)
    direct = ef.log_evidence(run, discard=10)
    found = ef.compare_models({"run": run, "later": direct, "annealed": ANNEALED})
    assert found.evidences["later"] is direct
    assert found.evidences["run"].log_evidence == ef.log_evidence(run).log_evidence
    assert found.evidences["annealed"].log_evidence == ANNEALED.log_evidence
    plain = ef.run(LAW.posterior, ef.DEMCMove(), 16, 2, seed=1, ensembles=1)
    for second, match in (
        (object, r"models\['y'\]"),
        (plain, r"models\['y'\]: .*Tempered"),
        (known(np.nan), "finite"),
    ):
        with pytest.raises((TypeError, ValueError), match=match) as error:
            ef.compare_models({"x": known(-1.0), "y": second})
        assert len(str(error.value)) < 300  # without the objects
