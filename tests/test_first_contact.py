"""What a newcomer meets first says what to do, and no page of emcee's stands before."""

import sys

import emcee
import numpy as np
import pytest

import emcee_femu as ef

STOREYS = {"k1": np.diag([1.0, 0.0]), "k2": np.array([[1.0, -1.0], [-1.0, 1.0]])}
BOUNDS = [(20, 90), (1, 15)]


def posterior(measured=(0.53, 1.08), bounds=BOUNDS):
    model = ef.MatrixModel(np.zeros((2, 2)), np.eye(2), STOREYS, n_modes=2)
    term = ef.FrequencyTerm(measured, relative_sd=0.1)
    prior = ef.GaussianPrior(["k1", "k2"], [50, 10], [30, 10], bounds)
    return ef.LogPosterior(model, term, prior)


def test_a_missing_extra_is_named_with_its_command(monkeypatch):
    monkeypatch.setitem(sys.modules, "pyuff", None)
    with pytest.raises(ImportError, match=r'pip install "emcee_femu\[uff\]"'):
        ef.frf.FRFMeasurements.from_uff("test.uff")


@pytest.mark.parametrize("moves", ["auto", ef.DEMCMove()], ids=["auto", "DE-MC"])
@pytest.mark.parametrize(
    ("bounds", "measured", "options", "message"),
    [
        (BOUNDS, 2, {"nwalkers": 3}, "nwalkers: .* at least"),
        (None, 2, {}, "not elastic .*give the prior bounds"),
        (BOUNDS, 3, {}, r"at 3 modes, but|of shape .* got \(\d+, 2\).* more"),
        (
            BOUNDS,
            2,
            {"starts": [[10.0, 5.0]] * 16},
            "starts: k1 = .* outside its bounds",
        ),
    ],
    ids=["few walkers", "no bounds", "another number of modes", "a start outside"],
)
def test_a_first_mistake_is_named_and_no_page_of_emcee_printed(
    moves, bounds, measured, options, message, capsys
):
    with pytest.raises((ValueError, RuntimeError), match=message):
        target = posterior([0.53, 1.08, 1.4][:measured], bounds)
        ef.run(target, moves, **({"steps": 5, "ensembles": 1, "seed": 1} | options))
    assert capsys.readouterr() == ("", "")  # emcee would print sixty lines


def test_a_start_outside_the_bounds_is_refused_also_in_a_script_of_emcee():
    target = posterior()
    start = target.start(8, seed=1)
    sampler = emcee.EnsembleSampler(8, 2, target, moves=ef.DEMCMove(), vectorize=True)
    with pytest.raises(ValueError, match=r"initial_state: .* posterior\.start"):
        sampler.run_mcmc(np.full((8, 2), [10.0, 5.0]) + start / 100, 5)
    start[0] = [10.0, 5.0]  # one alone goes on
    sampler.run_mcmc(start, 50)
    assert np.isfinite(sampler.get_log_prob()[-1]).all()


def test_models_and_terms_are_shown_by_what_they_have():
    posterior = ef.paper.mass_spring().posterior
    frame = ef.FunctionModel(lambda p: [1.0], n_modes=1)
    noisy = ef.FrequencyTerm([3.0, 9.0], discrepancy="noise")
    for shown, part in (
        (posterior.terms[0], "frequency [5]"),
        (posterior.experiments[0].model, "frequency [5]"),
        (frame, "frequency [1]"),
        (noisy, "FrequencyTerm(noise)"),
    ):
        assert part in repr(shown) and "0x" not in repr(shown)
