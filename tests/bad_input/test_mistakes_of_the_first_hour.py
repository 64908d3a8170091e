"""What users write in their first hour: each is refused with what to write."""

import sys

import numpy as np
import pytest

import emcee_femu as ef

POSTERIOR = ef.paper.mass_spring().posterior
MODEL = POSTERIOR.model


class Emulated:
    posterior = POSTERIOR

    def __call__(self, parameters):  # as an emulated model is called
        return {}


M = np.eye(2)


@pytest.mark.parametrize(
    ("call", "error", "cure"),
    [
        (lambda: ef.run(Emulated(), seed=1), TypeError, r"\.posterior"),
        (lambda: ef.run(POSTERIOR, ef.DEMCMove, seed=1), TypeError, r"DEMCMove\(\)"),
        (lambda: ef.run(lambda theta: 0.0, seed=1), TypeError, "from_function"),
        (lambda: ef.diagnose(Emulated()), TypeError, r"\.posterior"),
        (lambda: MODEL([1.0]), TypeError, "{name"),
        (lambda: MODEL({"k1": [1.0], "k3": [1.0, 2.0]}), ValueError, "one length"),
        (lambda: ef.GaussianPrior({"k1": (50, 9)}), TypeError, r"\['k1'\], mean, sd"),
        (lambda: ef.GaussianPrior(["k1"], [50.0]), ValueError, "sd"),
        (lambda: ef.MatrixModel("K.mtx", M, {}, n_modes=1), TypeError, "read_matrices"),
        (lambda: ef.MatrixModel(None, M, {}, n_modes=1), TypeError, r"0 \* M0"),
        (lambda: ef.MetropolisMove([[1.0, 0.0], [0.0, 1.0]]), ValueError, "cov="),
        (lambda: ef.report(None, "tower.pdf"), ValueError, "tower.html"),
        (lambda: ef.frf.FRFMeasurements.from_uff("a"), ImportError, r"femu\[uff\]"),
    ],
)
def test_the_message_has_the_cure(call, error, cure, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyuff", None)
    with pytest.raises(error, match=cure):
        call()


STOREYS = {"k1": np.diag([1.0, 0.0]), "k2": np.array([[1.0, -1.0], [-1.0, 1.0]])}
BOUNDS = [(20, 90), (1, 15)]


def storeys(measured=(0.53, 1.08), bounds=BOUNDS):
    model = ef.MatrixModel(np.zeros((2, 2)), np.eye(2), STOREYS, n_modes=2)
    term = ef.FrequencyTerm(measured, relative_sd=0.1)
    prior = ef.GaussianPrior(["k1", "k2"], [50, 10], [30, 10], bounds)
    return ef.LogPosterior(model, term, prior)


@pytest.mark.parametrize(
    ("posed", "named"),
    [
        ({"bounds": None}, "bounds"),
        ({"measured": [0.53, 1.08, 1.4]}, r"3 modes|got \(\d+, 2\)"),
    ],
)
def test_a_first_mistake_is_named_and_no_page_of_emcee_printed(posed, named, capsys):
    with pytest.raises((ValueError, RuntimeError), match=named):
        ef.run(storeys(**posed), steps=5, ensembles=1, seed=1)
    assert capsys.readouterr() == ("", "")  # emcee would print sixty lines
