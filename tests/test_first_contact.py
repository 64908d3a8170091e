"""What a newcomer meets first says what to do, and no page of emcee's stands before."""

import sys

import emcee
import numpy as np
import pytest

import emcee_femu as ef

STOREYS = {"k1": np.diag([1.0, 0.0]), "k2": np.array([[1.0, -1.0], [-1.0, 1.0]])}
BOUNDS = [(20, 90), (1, 15)]


def posterior(measured=(6.8, 3.3), bounds=BOUNDS):
    model = ef.MatrixModel(np.zeros((2, 2)), np.eye(2), STOREYS, n_modes=2)
    term = ef.FrequencyTerm(sorted(measured), relative_sd=0.1)
    prior = ef.GaussianPrior(["k1", "k2"], [50, 10], [30, 10], bounds)
    return ef.LogPosterior(model, term, prior)


def test_a_missing_extra_is_named_with_its_command(monkeypatch):
    monkeypatch.setitem(sys.modules, "pyuff", None)
    with pytest.raises(ImportError, match=r'pip install "emcee_femu\[uff\]"'):
        ef.Measurements.from_uff("test.uff")


def test_too_few_walkers_are_refused_before_the_first_solve():
    with pytest.raises(ValueError, match=r"nwalkers: .* at least 4 walkers"):
        ef.run(posterior(), ef.DEMCMove(), nwalkers=3, nsteps=5, seed=1)


def test_a_stiffness_without_bounds_is_told_to_have_some(capsys):
    with pytest.raises(ValueError, match=r"not elastic .*give the prior bounds"):
        ef.run(posterior(bounds=None), nsteps=5, seed=1)
    assert capsys.readouterr() == ("", "")  # emcee would print sixty lines


def test_another_number_of_modes_is_named(capsys):
    with pytest.raises(ValueError, match=r"3 modes|\(16, 3\), got \(16, 2\).* more"):
        model = ef.FunctionModel(lambda p: [p["k1"] ** 0.5, p["k2"] ** 0.5])
        term = ef.FrequencyTerm([3.0, 7.0, 9.0], relative_sd=0.1)
        prior = ef.GaussianPrior(["k1", "k2"], [50, 10], [9, 3], BOUNDS)
        ef.run(ef.LogPosterior(model, term, prior), nsteps=5, seed=1)
    assert capsys.readouterr() == ("", "")


def test_a_start_outside_the_bounds_is_refused_also_in_a_script_of_emcee():
    outside = [10.0, 5.0] + np.random.default_rng(1).normal(size=(8, 2))
    with pytest.raises(ValueError, match=r"initial: k1 = .* outside its bounds"):
        ef.run(posterior(), nwalkers=8, nsteps=5, seed=1, initial=outside)
    sampler = emcee.EnsembleSampler(
        8, 2, posterior(), moves=ef.DEMCMove(), vectorize=True
    )
    with pytest.raises(ValueError, match=r"initial_state: .* posterior\.start"):
        sampler.run_mcmc(outside, 5)


def test_a_start_that_is_partly_outside_goes_on():
    target = posterior()
    start = target.start(8, seed=1)
    start[0] = [10.0, 5.0]
    sampler = emcee.EnsembleSampler(8, 2, target, moves=ef.DEMCMove(), vectorize=True)
    sampler.run_mcmc(start, 50)
    assert np.isfinite(sampler.get_log_prob()[-1]).all()
