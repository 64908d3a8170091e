"""A posterior from few solves in one call: what it spends, finds, keeps and says."""

import logging
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy import stats
from support.chains import stored_and_read
from support.few_solves import DATA, DESIGN, PRIOR, SD, Counted, Gaussian, posed

import emcee_femu as ef
from emcee_femu.extensions.emulation import run_emulated as module
from emcee_femu.extensions.emulation.emulate import Emulation

SLOW = pytest.mark.slow
LEAST = 6 + 2 * 2 + 49  # a first design, two batches, a certificate


def linear(x):
    return DESIGN @ x


def rippled(x):
    """What no few points can show: waves of a tenth of the spread."""
    return DESIGN @ x + SD * np.sin(60.0 * x[0] + 47.0 * x[1])


def unwrapped(printed):
    """Return a text with each sentence in one line."""
    return str(printed).replace("\n  ", " ")


def exact_moments():
    """Return means, standard deviations and the log evidence of the linear problem."""
    precision = DESIGN.T @ DESIGN / SD**2 + np.eye(2)
    mean = np.linalg.solve(precision, DESIGN.T @ DATA / SD**2)
    marginal = DESIGN @ DESIGN.T + SD**2 * np.eye(3)
    log_evidence = stats.multivariate_normal(np.zeros(3), marginal).logpdf(DATA)
    return mean, np.sqrt(np.diag(np.linalg.inv(precision))), log_evidence


class Unnormalised(Gaussian):
    """The same errors, with the constant that an evidence needs."""

    def __call__(self, parameters, response):
        r, sd = self.deviations(parameters, response)
        return stats.norm.logpdf(r, 0.0, sd).sum(axis=1)


@pytest.fixture(scope="module")
def certified():
    """A certificate, and the model that counted."""
    posterior = posed(linear, term=Unnormalised())
    return ef.run_emulated(posterior, 110, seed=1), posterior.model


@pytest.fixture(scope="module")
def refused():
    """One of an emulator that cannot settle, and the model that counted."""
    posterior = posed(rippled)
    return ef.run_emulated(posterior, 68, seed=1), posterior.model


def test_it_is_certified_and_right_and_counts_each_solve_once(certified):
    found, model = certified
    mean, sd, _ = exact_moments()
    assert found.short == "certified" and found.settled
    assert found.solves == len(model.solved) == 6 + 2 * 2 + 48
    assert len(np.unique(model.solved, axis=0)) == found.solves
    z = np.hstack([(found.mean - mean) / found.mean_error, (found.sd - sd) / sd * 20])
    assert (np.abs(z) < 4.5).all()
    assert f"{found.solves} of 110 solves" in unwrapped(found)


def known_points(emulator, theta):
    """Return which points an emulator was fitted to."""
    steps = emulator.coordinates(theta)[:, None] - emulator.processes[0].points
    return (np.abs(steps).max(axis=2) < 1e-9).any(axis=1)


def test_what_is_handed_over_has_learned_from_the_draws(certified):
    found, _ = certified
    assert found.refitted and known_points(found.emulated, found.theta).all()


@SLOW
def test_an_emulator_that_learning_changes_much_is_not_certified(monkeypatch):
    other = ef.emulate(posed(lambda x: 0.7 * linear(x)), 20, seed=2)
    monkeypatch.setattr(Emulation, "refit", lambda self: other)
    found = ef.run_emulated(posed(linear), 70, seed=1)
    assert found.short == "corrected" and found.refitted
    table = ef.parameter_table(found)
    assert_allclose(table.column("mean"), found.mean, rtol=1e-6)
    assert (np.abs(found.sd / found.emulated_sd - 1) > 0.2).any()  # of another chain
    assert "weight" not in found.idata["sample_stats"]  # the chain, not the draws


@pytest.mark.slow
def test_what_it_returns_goes_into_every_table_and_judgement(certified, tmp_path):
    found, model = certified
    spent = len(model.solved)
    idata = ef.to_inference_data(found)
    table = ef.parameter_table(found)
    assert "certified by 58 full solves" in table.title
    assert str(table) == str(ef.parameter_table(idata))
    assert ef.diagnose(found).converged
    evidence, (*_, log_evidence) = ef.log_evidence(found), exact_moments()
    inside = 1 - stats.norm.sf(4) * 2  # of the prior, in each direction
    error = evidence.log_evidence - (log_evidence - 2 * np.log(inside))
    assert abs(error) < 4.5 * evidence.log_evidence_error < 0.5
    assert "full solves" in str(evidence)
    read = stored_and_read(idata, tmp_path / "found.nc")
    assert str(ef.log_evidence(read)) == str(evidence)
    assert str(ef.identifiability(found)) == str(ef.identifiability(idata))
    for draw in (ef.figures.plot_prior_posterior, ef.figures.plot_scatter):
        draw(found)
    assert ef.report(found, tmp_path / "found.html").exists()
    again = ef.certify(found, posed(linear, term=Unnormalised()), 60, seed=5)
    assert again.short == "certified"
    assert str(ef.log_evidence(again)).count("full solves") == 1  # corrected once
    assert len(model.solved) == spent  # none of these solves


@SLOW
def test_a_budget_that_does_not_reach_is_never_exceeded_and_says_so(refused, tmp_path):
    found, model = refused
    assert found.short == "refused" and not found.settled
    assert 40 < found.solves == len(model.solved) <= 68
    assert "true error of the emulator" in unwrapped(found)
    diagnosis = ef.diagnose(found)
    assert diagnosis.chains.status == "refused" and not diagnosis.converged
    assert found.verdict in diagnosis.chains.sentence
    assert "refused" in ef.parameter_table(found).title
    evidence = ef.log_evidence(found)
    assert evidence.problems and evidence.log_evidence_error == np.inf
    page = ef.report(found, tmp_path / "refused.html").read_text("utf-8")
    assert "do not use these numbers" in page
    read = stored_and_read(found.idata, tmp_path / "refused.nc")
    assert ef.diagnose(read).chains.status == "refused"


@SLOW
def test_the_draws_prove_an_emulator_that_had_no_solves_left_to_settle():
    found = [ef.run_emulated(posed(), LEAST, seed=seed) for seed in range(1, 5)]
    assert not all(each.emulated.settled for each in found)
    for each in found:  # whose errors at the draws are some 1e-4
        assert each.short == "certified" and each.settled
        said = "had not settled" in unwrapped(each)
        assert said == (not each.emulated.settled)


@SLOW
def test_an_emulator_that_is_not_certified_learns_from_the_draws(monkeypatch):
    """It is made to believe that it settled at once, and is certified twice."""
    monkeypatch.setattr(module, "TOLERANCE", 1e9)
    posterior = posed(rippled)
    found = ef.run_emulated(posterior, 130, seed=1)
    solved = np.array(posterior.model.solved)
    assert "certificate 2" in unwrapped(found)
    assert found.solves == len(solved) == len(np.unique(solved, axis=0)) <= 130
    # Of all that was solved before the last certificate it has learned what climbs
    # did not need.
    known = known_points(found.emulated, solved)
    assert known[:10].all() and known[10:58].sum() >= 36
    points = len(found.emulated.processes[0].points)
    assert points == known.sum() <= found.solves - 36 * (not found.refitted)


class Stopping(Counted):
    """A model that stops the program at a call."""

    def __init__(self, function, stop):
        super().__init__(function, len(DATA))
        self.stop = stop

    def __call__(self, parameters):
        if len(self.solved) == self.stop:
            raise KeyboardInterrupt
        return super().__call__(parameters)


@SLOW
@pytest.mark.parametrize("stop", [8, 25])
def test_a_kill_loses_nothing_and_files_and_pools_change_nothing(
    stop, certified, tmp_path
):
    """Eight: in the emulation; 25: in the certificate."""
    whole, file = certified[0], {"backend": tmp_path / "run.chain", "resume": True}
    models = [Stopping(linear, stop), Stopping(linear, None)]
    cut, rest = (ef.LogPosterior(m, Unnormalised(), PRIOR) for m in models)
    with ThreadPoolExecutor(2) as pool:
        with pytest.raises(KeyboardInterrupt, match="resume=True"):
            ef.run_emulated(cut, 110, seed=1, pool=pool, **file)
        found = ef.run_emulated(rest, 110, seed=1, pool=pool, **file)
    assert str(found) == str(whole)
    assert_array_equal(found.theta, whole.theta)
    assert_array_equal(found.log_posterior, whole.log_posterior)
    # As many as were missing, and up to sixteen that show that the model is the same.
    assert len(models[1].solved) <= 58 - stop + 16
    with pytest.raises(ValueError, match="exists"):
        ef.run_emulated(rest, 110, seed=1, backend=file["backend"])
    with pytest.raises(ValueError, match="seed"):
        ef.run_emulated(rest, 110, seed=2, **file)


@SLOW
def test_more_solves_go_on_from_the_file_of_fewer(refused, tmp_path):
    few, more, file = posed(rippled), posed(rippled), tmp_path / "run.chain"
    with ThreadPoolExecutor(2) as pool:
        options = {"seed": 1, "pool": pool, "backend": file}
        first = ef.run_emulated(few, 60, **options)
        found = ef.run_emulated(more, 68, **options, resume=True)
    assert str(found) == str(refused[0])  # the same as at once
    fresh = np.array(more.model.solved)[16:]
    before = np.array(few.model.solved)
    assert not (fresh[:, None] == before).all(axis=2).any()
    assert first.solves <= 60 and len(fresh) < found.solves


def broken(x):
    """Fail at a tenth of all points, which chance has chosen."""
    if (x * 1e6 % 1).sum() % 1 < 0.1:
        raise ArithmeticError("no convergence")
    return linear(x)


@SLOW
def test_failed_solves_are_counted_and_cost_no_more_than_themselves(caplog):
    """The last certificate has so many draws that a tenth of them may fail."""
    caplog.set_level(logging.CRITICAL, "emcee_femu")
    posterior = posed(broken)
    found = ef.run_emulated(posterior, 160, seed=2, on_failure="reject")
    solved = np.array(posterior.model.solved)
    failed = ((solved * 1e6 % 1).sum(axis=1) % 1 < 0.1).sum()
    assert found.solves == len(solved) == len(np.unique(solved, axis=0)) <= 160
    assert found.failed_solves == failed > 0
    assert (found.weights == 0).sum() <= failed and found.short != "refused"
    with pytest.raises(ArithmeticError, match="no convergence"):
        ef.run_emulated(posed(broken), 160, seed=2)


def test_what_is_wrong_is_refused_before_the_first_solve(tmp_path):
    posterior, file = posed(), tmp_path / "run.chain"
    bare = ef.LogPosterior.from_function(lambda x: -(x @ x), {"a": (-1, 1)})
    for given, options, match in (
        (posterior, {"solves": LEAST - 1}, f"^solves: expected at least {LEAST}"),
        (posterior, {"seed": -1}, "^seed"),
        (posterior, {"cheap": ["static"]}, "^cheap"),
        (posterior, {"starts": [9.0, 0.0]}, "^starts"),
        (posterior, {"on_failure": "ignore"}, "^on_failure"),
        (bare, {}, "bare log-likelihood"),
    ):
        with pytest.raises(ValueError, match=match):
            ef.run_emulated(given, **{"seed": 1, "backend": file} | options)
    with pytest.raises(TypeError, match="posterior"):
        ef.run_emulated(posterior.model, seed=1)
    with pytest.raises(TypeError, match="solves"):
        ef.run_emulated(posterior, 100.5, seed=1)
    assert posterior.model.solved == []


def test_a_figure_of_many_solves_asks_for_the_posterior(certified):
    found, model = certified
    spent = len(model.solved)
    with pytest.raises(TypeError, match="posterior"):
        ef.figures.plot_tae(found)
    assert len(model.solved) == spent
