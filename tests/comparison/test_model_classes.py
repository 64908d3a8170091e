"""Model classes: Bayes factors, probabilities and verdicts from known evidences."""

from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from support.tempered_laws import GaussianLaw

import emcee_femu as ef
from emcee_femu.results.evidence import Evidence


def known(value, error=0.1, *problems):
    return Evidence(value, error, "known", problems)


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
        (2.9, "positive"),
        (3.1, "strong"),
        (4.9, "strong"),
        (5.1, "very strong"),
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


def test_it_takes_samplers_and_what_anneal_returns():
    law = GaussianLaw()
    move = ef.TemperedMove(ef.DEMCMove(), np.linspace(1, 0, 6) ** 3)
    runs = ef.run(law.posterior, move, nwalkers=96, nsteps=200, seed=1)
    annealed = SimpleNamespace(log_evidence=-3.0, log_evidence_error=0.1)
    found = ef.compare_models({"run": runs, "annealed": annealed}, discard=50)
    direct = ef.log_evidence(runs, discard=50)
    assert found.evidences["run"].log_evidence == direct.log_evidence
    assert found.evidences["annealed"].log_evidence == -3.0


def test_it_prints_and_shows_the_table_and_the_conclusion():
    found = ef.compare_models({"one & two": known(-2.0), "three": known(-9.0)})
    assert str(found) == f"{found.table}\n{found.conclusion}"
    assert "one &amp; two" in found._repr_html_() and "Ahead" in found._repr_html_()


PAIR = {"x": known(-1.0), "y": known(-1.1)}
REFUSED = {
    "no mapping": ({"models": [known(1.0)]}, TypeError, "models: .* by label"),
    "one": ({"models": {"x": known(1.0)}}, ValueError, "at least two classes"),
    "a label": ({"models": {1: known(1.0), "x": known(0)}}, TypeError, "labels"),
    "no samplers": ({"models": {**PAIR, "z": 3}}, TypeError, r"models\['z'\]: sampl"),
    "NaN": ({"models": {**PAIR, "z": known(np.nan)}}, ValueError, "finite log evid"),
    "prior": ({"prior": [1, 2]}, TypeError, "prior: expected"),
    "prior of two": ({"prior": {"x": 1.0}}, ValueError, "prior: .* each of"),
    "prior of zero": ({"prior": {"x": 1.0, "y": 0.0}}, ValueError, r"prior\['y'\]"),
    "discard": ({"discard": 1.5}, TypeError, "discard"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_wrong_arguments_are_refused(case):
    given, error, match = REFUSED[case]
    with pytest.raises(error, match=match):
        ef.compare_models(**{"models": PAIR, **given})


def test_a_refusal_does_not_print_the_objects():
    law = GaussianLaw()
    samplers = ef.run(law.posterior, nwalkers=16, nsteps=2, seed=1)
    idata = ef.to_inference_data(samplers, law.posterior)
    for models in (
        idata,
        {"x": known(-1.0), "y": object},
        {"x": known(0.0), "y": [[]]},
    ):
        with pytest.raises((TypeError, ValueError)) as error:
            ef.compare_models(models)
        assert len(str(error.value)) < 150
    with pytest.raises(TypeError) as error:
        ef.compare_models(PAIR, prior=[idata])
    assert len(str(error.value)) < 80
