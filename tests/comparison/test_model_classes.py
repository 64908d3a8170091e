"""Model classes: Bayes factors, probabilities and verdicts from known evidences."""

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
    found = ef.log_evidence(ANNEALED)
    changes = {"log_evidence": value, "log_evidence_error": error}
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
    assert column("verdict") == ["first", "behind, positive", "behind, very strong"]
    assert found.winner == "b"
    equal = ef.compare_models(classes)
    assert_allclose(equal.probabilities["a"], np.exp(-2) / np.exp([0, -2, -5.5]).sum())
    assert_allclose(sum(equal.probabilities.values()), 1.0)


@pytest.mark.parametrize(
    ("lead", "verdict"),
    [
        (0.9, "weak"),
        (1.1, "positive"),
        (4.9, "strong"),
        (9_000.0, "very strong"),
    ],
)
def test_words_are_those_of_kass_and_raftery(lead, verdict):
    found = ef.compare_models({"x": known(-5.0 - lead), "y": known(-5.0)})
    assert found.table.column("verdict") == ["first", f"behind, {verdict}"]
    assert found.conclusion == f"Ahead: y; the evidence against x is {verdict}."


@pytest.mark.parametrize(("lead", "decided"), [(0.99, False), (1.01, True)])
def test_a_difference_within_two_combined_errors_is_undecided(lead, decided):
    found = ef.compare_models({"x": known(-lead, 0.4), "y": known(0.0, 0.3)})
    assert (found.winner == "y") == decided
    assert ("Undecided between y and x:" in str(found)) != decided


def test_of_three_the_close_ones_are_named_and_the_other_is_behind():
    classes = {"x": known(-1.0), "y": known(-1.1), "z": known(-5.0)}
    found = ef.compare_models(classes)
    assert found.winner is None
    assert found.conclusion.splitlines() == [
        "Undecided between x and y: the log evidences differ by less than two standard "
        "errors; run longer.",
        "Of the others, the evidence against z is strong.",
    ]


def test_without_an_error_nothing_is_decided():
    found = ef.compare_models({"x": known(-99.0, np.inf, "lost"), "y": known(0.0)})
    assert found.winner is None
    assert found.conclusion.splitlines()[1] == "x: no error can be claimed, for lost."


def test_it_takes_runs_and_what_anneal_returns():
    move = ef.moves.TemperedMove(ef.DEMCMove(), np.linspace(1, 0, 6) ** 3)
    run = ef.run(LAW.posterior, move, nwalkers=96, steps=200, seed=1, ensembles=1)
    direct = ef.log_evidence(run, discard=50)
    found = ef.compare_models({"run": run, "later": direct, "annealed": ANNEALED})
    assert found.evidences["later"] is direct
    direct = ef.log_evidence(run)
    assert found.evidences["run"].log_evidence == direct.log_evidence
    assert found.evidences["annealed"].log_evidence == ANNEALED.log_evidence


def test_a_refusal_names_the_class_and_does_not_print_the_objects():
    run = ef.run(LAW.posterior, ef.DEMCMove(), 16, 2, seed=1, ensembles=1)
    other = known(-1.0)
    for models, match in (
        ([run, other], "models: .* by label"),
        ({"x": other, "y": object}, r"models\['y'\]: source"),
        ({"x": other, "y": [[]]}, r"models\['y'\]: source"),
        ({"x": other, "y": run}, r"models\['y'\]: source.* 'auto' or of a Tempered"),
        ({"x": other, "y": known(np.nan)}, "a finite log evidence"),
    ):
        with pytest.raises((TypeError, ValueError), match=match) as error:
            ef.compare_models(models)
        assert len(str(error.value)) < 300
    for prior in ({"x": 1.0}, {"x": 1.0, "y": 0.0}):
        with pytest.raises(ValueError, match="^prior"):
            ef.compare_models({"x": other, "y": other}, prior=prior)
