"""A posterior from few solves: what it finds, when it stops, what it refuses."""

import logging
import pickle
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy import stats
from support.few_solves import (
    DATA,
    DESIGN,
    PRIOR,
    SD,
    Gaussian,
    bent,
    broken,
    linear,
    posed,
    rippled,
    square,
)
from support.pool_problems import forks
from support.printed import unwrapped

import emcee_femu as ef
from emcee_femu.extensions.emulation import draws as emulated_draws
from emcee_femu.extensions.emulation.draws import Explorer
from emcee_femu.extensions.emulation.emulate import _Emulation
from emcee_femu.extensions.emulation.problem import EmulationProblem
from emcee_femu.sampling.coordinates import Coordinates

SLOW = pytest.mark.slow
GRID = np.stack(np.meshgrid(*[np.linspace(-3.0, 3.0, 241)] * 2), axis=-1).reshape(-1, 2)


def shares(log_p):
    """Return the posterior's shares of grid points."""
    weights = np.exp(log_p - log_p.max())
    return weights / weights.sum()


def exact(function, term, prior, theta):
    """Return the log-posterior of points but for a constant, by the full model."""
    y = np.array([function(row) for row in theta])
    return prior.logpdf(theta) - 0.5 * (((y - term.data) / term.sd) ** 2).sum(axis=1)


def total_variation(close, full):
    return 0.5 * np.abs(shares(close) - shares(full)).sum()


# --- what it finds ----------------------------------------------------------------


def test_a_linear_model_is_known_exactly_after_two_batches():
    emulated = ef.emulate(posed(linear), 60, seed=1)
    assert emulated.solves == 6 + 2 * 2
    precision = DESIGN.T @ DESIGN / SD**2 + np.eye(2)
    expected = np.linalg.solve(precision, DESIGN.T @ DATA / SD**2)
    weights = shares(emulated.posterior(GRID)[:, 0])
    mean = weights @ GRID
    covariance = (weights * (GRID - mean).T) @ (GRID - mean)
    assert_allclose(mean, expected, atol=1e-3)
    assert_allclose(covariance, np.linalg.inv(precision), atol=1e-4)


@SLOW
def test_both_modes_are_found_with_their_weights():
    term = Gaussian(np.array([1.0, 0.2]), 0.2)
    prior = ef.GaussianPrior(["a", "b"], [0.3, 0.0], 1.0, [(-3.0, 3.0)] * 2)
    emulated = ef.emulate(posed(square, term=term, prior=prior), 30, seed=2)
    full, close = exact(square, term, prior, GRID), emulated.posterior(GRID)[:, 0]
    left = GRID[:, 0] < 0
    assert abs(shares(close)[left].sum() - shares(full)[left].sum()) < 0.01
    assert total_variation(close, full) < 0.03


SPRING = stats.loguniform(1e3, 1e9)


def support(x):
    """Return frequencies of a beam on a spring that is soft, middling or fixed."""
    fixed = x[1] / (x[1] + 1e6)
    return np.sqrt(x[0]) * np.array([3 + 2 * fixed, 9 + 1.5 * fixed**1.5, 17 + fixed])


def spring_alone(x):
    return support([1.0, x[0]])


@pytest.mark.parametrize(
    ("function", "solves"), [(spring_alone, 12), pytest.param(support, 22, marks=SLOW)]
)
def test_a_spring_over_six_decades_takes_few_solves(function, solves):
    beam = {"e": (0.5, 1.5)} if function is support else {}
    prior = ef.IndependentPrior(beam | {"k": SPRING})
    term = Gaussian(np.array([4.0, 9.6, 17.4]), 0.04)
    emulated = ef.emulate(posed(function, term=term, prior=prior), solves, seed=1)
    axes = [np.linspace(0.9, 1.1, 61)] * len(beam), [np.linspace(3, 9, 241)]
    grid = np.stack(np.meshgrid(*axes[0], *axes[1]), axis=-1).reshape(-1, len(beam) + 1)
    theta = np.column_stack([grid[:, :-1], np.clip(10 ** grid[:, -1], 1e3, 1e9)])
    logs = np.log(theta[:, -1])  # of equal steps of them
    full = exact(function, term, prior, theta) + logs
    assert total_variation(emulated.posterior(theta)[:, 0] + logs, full) < 0.03
    # The derivatives are those by the spring, not by its logarithm.
    at = {name: np.array([1.0]) for name in beam} | {"k": np.array([1e6])}
    step = at | {"k": np.array([1e6 + 100.0])}
    slope = emulated.jacobian(at)[1]["y"]["k"]
    change = (emulated(step)["y"] - emulated(at)["y"]) / 100.0
    assert_allclose(slope, change, rtol=1e-3)


def test_inferred_errors_are_no_inputs_of_the_emulator():
    model = ef.FunctionModel(lambda p: [p["k"] ** 0.5, (3 * p["k"]) ** 0.5], n_modes=2)
    prior = ef.IndependentPrior({"k": (5.0, 12.0), "s": stats.halfnorm(scale=0.02)})
    term = ef.FrequencyTerm([3.0, 5.2], discrepancy="s")
    posterior = ef.LogPosterior(model, term, prior)
    emulated = ef.emulate(posterior, 12, seed=1)
    assert emulated.names == ("k",)
    theta = prior.sample(np.random.default_rng(1), 50)
    close, full = emulated.posterior(theta)[:, 0], posterior(theta)[:, 0]
    near = full > full.max() - 10
    assert_allclose(close[near], full[near], atol=0.1)


@pytest.mark.slow
@pytest.mark.parametrize("n_terms", [pytest.param(1, marks=SLOW), 2])
def test_modes_that_are_paired_are_emulated_in_units_of_their_errors(n_terms):
    """Candidates, each with the error of its measured one; shapes tell the pairs."""
    K = {"a": np.diag([1.0, 0.0, 0.0]), "b": np.array([[1, -1, 0], [-1, 2, -1],
                                                       [0, -1, 1.0]])}  # fmt: skip
    model = ef.MatrixModel(np.zeros((3, 3)), np.eye(3), K, n_modes=3, shapes=True)
    true = model({"a": np.array([1.1]), "b": np.array([0.9])})
    chosen = [2, 0]  # in another order than the model's, one of them not measured
    measured = ef.Measurements(
        np.sort(true.frequencies[0, chosen]), shapes=true.shapes[0][:, sorted(chosen)]
    )
    paired = ef.PairedModel(model, measured, candidates=3)
    terms = [
        ef.FrequencyTerm(measured, sd=[0.002, 0.02]),
        ef.ShapeTerm(measured, delta=[0.1, 0.02]),
    ]
    prior = ef.IndependentPrior({"a": (0.5, 2.0), "b": (0.5, 2.0)})
    posterior = ef.LogPosterior(paired, terms[:n_terms], prior)
    emulated = ef.emulate(posterior, 24, seed=1)
    theta = prior.sample(np.random.default_rng(1), 2_000)
    close, full = emulated.posterior(theta)[:, 0], posterior(theta)[:, 0]
    near = full > full.max() - 6
    assert near.sum() > 5
    assert_allclose(close[near], full[near], atol=0.3)
    sent = pickle.loads(pickle.dumps(emulated.posterior))  # to another process
    assert_array_equal(sent(theta), emulated.posterior(theta))


# --- a thin ridge -----------------------------------------------------------------

TRUTH = {"E": 1.1, "t": 1.025, "k": 1.16}
SLAB_PRIOR = ef.GaussianPrior(
    [*TRUTH],
    [1.0, 1.0, 1.0],
    [0.13, 0.05, 0.33],
    [(0.5, 1.5), (0.7, 1.3), (0.15, 2.5)],
)


def slab(x):
    """Four frequencies that two of the three parameters' combinations decide."""
    s, b = x[0] * x[1] ** 2, x[2] / x[1]
    return np.sqrt([s * b / (s + b), b, 5 * s + b, 27 * s + b])


def posed_slab(relative_sd):
    data = slab([*TRUTH.values()])
    return posed(slab, term=Gaussian(data, relative_sd * data), prior=SLAB_PRIOR)


def draw_ridge(n, relative_sd):
    """Return draws of that posterior: both combinations are Gaussian, and t is free."""
    rng = np.random.default_rng(1)
    s, b = TRUTH["E"] * TRUTH["t"] ** 2, TRUTH["k"] / TRUTH["t"]
    data, step = slab([s, 1.0, b]), 1e-6
    ahead = [slab([s + step, 1.0, b]), slab([s, 1.0, b + step])]
    slopes = np.array([(moved - data) / step for moved in ahead]) / data
    covariance = np.linalg.inv(slopes @ slopes.T) * relative_sd**2
    t = rng.uniform(0.7, 1.3, 50 * n)
    s, b = rng.multivariate_normal([s, b], covariance, len(t)).T
    ridge = np.stack([s / t**2, t, b * t], axis=1)
    log_p = SLAB_PRIOR.logpdf(ridge) - np.log(t)  # dE dk = t^-2 t ds db
    return ridge[rng.choice(len(t), n, p=shares(log_p))]


@SLOW
@pytest.mark.parametrize("seed", [3, 11])
def test_a_thin_ridge_is_emulated_right(seed):
    """Few members of a population ever come upon it, and they become copies."""
    emulated = ef.emulate(posed_slab(5e-4), 60, seed=seed)
    assert emulated.solves < 40
    theta = draw_ridge(400, 5e-4)
    data, sd = slab([*TRUTH.values()]), 5e-4 * slab([*TRUTH.values()])
    full = exact(slab, Gaussian(data, sd), SLAB_PRIOR, theta)
    apart = full - emulated.posterior(theta)[:, 0]
    assert apart.std() < 0.2  # as of errors of a tenth of the measurement's


@SLOW
def test_where_all_becomes_copies_the_history_tells():
    emulated = ef.emulate(posed_slab(1e-6), 20, seed=1)
    assert emulated.solves == 20
    assert emulated.history.column("predicted error")[-1] > 0.1


# --- a posterior a thousand times narrower than its prior ------------------------

SIX = [f"x{i}" for i in range(6)]
SIX_PRIOR = ef.GaussianPrior(SIX, np.zeros(6), 1.0, [(-4.0, 4.0)] * 6)
MIXED, PHASES = np.random.default_rng(7).standard_normal((2, 8, 6)) / np.sqrt(6)
MIXED[:6] += np.eye(6)


def swaying(x):
    return MIXED @ x + 0.3 * np.sin(1.5 * PHASES @ x)


def swaying_slopes(x):
    return MIXED + 0.45 * np.cos(1.5 * PHASES @ x)[:, None] * PHASES


@SLOW
@pytest.mark.parametrize("derivatives", [True, False])
def test_a_sharp_posterior_is_reached_in_stages(derivatives):
    """First errors are hundreds of those of the measurement."""
    truth = np.array([0.7, -0.5, 1.0, 0.2, -0.9, 0.4])
    term = Gaussian(swaying(truth), 1e-3)
    posterior, _ = sloped(swaying, swaying_slopes, SIX_PRIOR, term)
    emulated = ef.emulate(posterior, 90, seed=1, derivatives=derivatives)
    assert emulated.solves < (30 if derivatives else 90)
    predicted = emulated.history.column("predicted error")
    assert predicted[0] > 100 and predicted[-1] < 0.5
    assert emulated.history.column("effective draws")[-1] > 50
    steep = swaying_slopes(truth)
    covariance = np.linalg.inv(steep.T @ steep / 1e-6 + np.eye(6))
    assert np.linalg.det(covariance) ** (1 / 12) < 1.2e-3  # a geometric mean
    theta = np.random.default_rng(1).multivariate_normal(truth, covariance, 300)
    full = exact(swaying, term, SIX_PRIOR, theta)
    assert (full - emulated.posterior(theta)[:, 0]).std() < 0.2


# --- walkers that are kept ----------------------------------------------------


@pytest.mark.parametrize(
    ("d", "power"), [(3, 1.0), (3, 0.05), pytest.param(18, 1.0, marks=SLOW)]
)
def test_draws_are_carried_from_one_emulated_posterior_to_the_next(d, power):
    """Conjugate ones, tempered or not; the second is narrower, beside the first."""
    rng = np.random.default_rng(3)
    mixing = rng.standard_normal((d + 2, d)) / 3.0
    prior = ef.GaussianPrior([f"x{i}" for i in range(d)], np.zeros(d), 1.0)
    data, points = mixing @ rng.standard_normal(d), rng.standard_normal((d + 3, d))
    explorer = None
    for share in (0.6, 1.0):  # of what the model makes of its parameters
        design, term = share * mixing, Gaussian(data, 0.3)
        posterior = posed(lambda x, a=design: a @ x, term=term, prior=prior)
        emulator = ef.emulate(posterior, 2 * d + 2, seed=1, starts=points)
        if explorer is None:
            explorer = Explorer(EmulationProblem.of(posterior, derivatives=False))
        coordinates = Coordinates.plain(prior)
        rng = np.random.default_rng(4)
        draws = explorer.draw(emulator, coordinates, 32, rng, power=power)
        precision = power / 0.3**2
        covariance = np.linalg.inv(precision * design.T @ design + np.eye(d))
        white = np.linalg.inv(np.linalg.cholesky(covariance))
        mean = precision * covariance @ design.T @ data
        z = (draws.members - mean) @ white.T
        assert draws.size > 200
        assert np.abs(z.mean(axis=0)).max() * np.sqrt(draws.size) < 5.0
        assert abs((z**2).mean() - 1.0) < 0.15


def test_copies_are_not_carried_to_the_next_posterior():
    """A few members of a population are left, to which no mixture can be fitted."""
    posterior = posed()
    emulator = ef.emulate(posterior, 12, seed=1)
    explorer = Explorer(EmulationProblem.of(posterior, derivatives=False))
    coordinates, rng = Coordinates.plain(PRIOR), np.random.default_rng(1)
    draws = explorer.draw(emulator, coordinates, 12, rng)
    explorer._last = tuple(
        (evaluator, np.repeat(theta[:3], 100, axis=0))
        for evaluator, theta in explorer._last
    )
    again = explorer.draw(emulator, coordinates, 12, rng)
    apart = again.members.mean(axis=0) - draws.members.mean(axis=0)
    size = min(again.size, draws.size)
    assert size > 100
    z = apart / draws.members.std(axis=0) / np.sqrt(2 / size)
    assert np.abs(z).max() < 5.0


def test_errors_temper_the_draws_and_end_in_looks_at_the_whole_prior(monkeypatch):
    rounds, draw = [], Explorer.draw
    anneal, predict = emulated_draws.anneal_population, EmulationProblem.predict_error

    def follow(explorer, emulator, coordinates, size, rng, *, power):
        rounds.append({"size": size, "power": power, "errors": [], "looked": False})
        return draw(explorer, emulator, coordinates, size, rng, power=power)

    def listen(*arguments, begin=None):
        rounds[-1]["looked"] |= begin is None
        return anneal(*arguments, begin=begin)

    def note(*arguments):
        square = predict(*arguments)
        rounds[-1]["errors"].append(np.sqrt(square.mean()))
        return square

    monkeypatch.setattr(Explorer, "draw", follow)
    monkeypatch.setattr(EmulationProblem, "predict_error", note)
    monkeypatch.setattr(emulated_draws, "anneal_population", listen)
    history = ef.emulate(posed_slab(1e-3), 22, seed=1, tolerance=0).history
    errors = np.array(history.column("true error")[:-1])
    assert errors.max() > 3 and errors.min() < 0.1
    first = rounds.pop(0)
    assert first["power"] == 1.0 and first["looked"]  # nothing is known of errors
    reached, last, small = 0.0, first["size"], 0
    for i, each in enumerate(rounds, 1):
        worst = errors[max(i - 2, 0) : i].max()
        reached = min(max(9.0 / worst**2, 4.0 * reached), 1.0)
        assert each["power"] == pytest.approx(reached)
        grown, well = each["size"] >= 1.5 * last, each["errors"][0] <= 0.1  # carried
        assert each["looked"] == (grown or well)
        last = each["size"] if grown or well else last
        small += not grown and well
    assert small > 1 and not all(each["looked"] for each in rounds)


def test_frequencies_that_are_powers_of_parameters_are_exact_after_a_design():
    """Their logarithms are straight lines, those of a bar, say."""

    def bar(p):
        return [30.0 * p["E"] ** 0.5 / p["L"], 70.0 * p["E"] ** 0.4 * p["L"] ** -2.0]

    prior = ef.IndependentPrior({"E": (1.0, 4.0), "L": (0.5, 2.0)})
    term = ef.FrequencyTerm([40.0, 120.0], relative_sd=0.01)
    posterior = ef.LogPosterior(ef.FunctionModel(bar, n_modes=2), term, prior)
    emulated = ef.emulate(posterior, 10, seed=1)
    theta = dict(zip("EL", prior.sample(np.random.default_rng(1), 200).T, strict=True))
    assert_allclose(emulated(theta).frequencies, np.transpose(bar(theta)), rtol=1e-4)
    assert "logarithms of E, L" in unwrapped(emulated)


def test_a_parameter_is_seen_by_itself_however_the_draws_lie():
    """They lie along a + b = 0, and part of the response waves along b alone."""

    def waving(x):
        return np.array([x[0] + x[1], 0.3 * np.sin(4.0 * x[1]), 0.1 * x[0]])

    term = Gaussian(np.array([0.0, 0.1, 0.0]), 0.01)
    emulated = ef.emulate(posed(waving, term=term), 24, seed=1, tolerance=0)
    theta = PRIOR.sample(np.random.default_rng(1), 300)
    wrong = emulated(dict(zip("ab", theta.T, strict=True)))["y"][:, 1]
    wrong = wrong - [waving(x)[1] for x in theta]
    assert np.sqrt((wrong**2).mean()) < 0.1


# --- where and how long it solves -------------------------------------------------


def crossed(x):
    """Return two variables, one waving along either parameter."""
    return {"y": [np.sin(2.0 * x[0])], "z": [0.4 * np.sin(3.0 * x[1])]}


class Crossed:
    """Independent errors of both."""

    reads = {name: ef.Variable({"point": range(1)}) for name in "yz"}

    def deviations(self, parameters, response):
        r = np.hstack([response["y"] - 0.5, response["z"] + 0.1])
        return r, np.full_like(r, 0.1)

    def __call__(self, parameters, response):
        return -0.5 * ((self.deviations(parameters, response)[0] / 0.1) ** 2).sum(1)


@SLOW
def test_a_solve_goes_where_it_lowers_the_expected_error_most(monkeypatch):
    """Second route: processes conditioned on a point more, for each that it may be."""
    chosen, choose = [], _Emulation._choose

    def listen(emulation, number, emulator, draws):
        points = choose(emulation, number, emulator, draws)
        chosen.append((emulator, draws, points[0]))
        return points

    monkeypatch.setattr(_Emulation, "_choose", listen)
    model = ef.FunctionModel(
        lambda p: crossed([p["a"], p["b"]]), variables=Crossed.reads
    )
    ef.emulate(ef.LogPosterior(model, Crossed(), PRIOR), 24, seed=1, tolerance=0)
    rounds = [given for given in chosen if len(given[0].processes) > 1]
    assert rounds
    for emulator, draws, point in rounds[:3]:
        at = emulator.coordinates(draws.wide)
        traces = [each.covariance.trace() for each in emulator.processes]
        variances = [each.unit_sd(at) ** 2 for each in emulator.processes]
        weights = draws.errors[len(at) :] / np.dot(traces, variances)
        errors = np.zeros(len(at))
        for each, trace in zip(emulator.processes, traces, strict=True):
            values = np.concatenate([each.values, each.values[:1]])
            for i, candidate in enumerate(at):
                points = np.vstack([each.points, candidate])
                more = each.condition(points, values, each.lengths, each.rough)
                errors[i] += trace * (weights @ more.unit_sd(at) ** 2)
        taken = np.flatnonzero((draws.wide == point).all(axis=1))[0]
        assert errors[taken] < errors.min() + 1e-3 * np.ptp(errors)


@SLOW
@pytest.mark.parametrize("seed", range(1, 6))
def test_it_ends_once_two_true_errors_running_are_within_tolerance(seed):
    """Waves that no few points can show: predicted errors would end it elsewhere."""
    history = ef.emulate(posed(rippled), 22, seed=seed, tolerance=0.1).history
    spent = history.column("solves")
    assert spent[-1] == 22
    errors = np.array(history.column("true error")[:-1])
    pairs = np.maximum(errors[:-1], errors[1:])  # of rounds that follow each other
    first = int(np.argmin(pairs))
    ended = ef.emulate(posed(rippled), 22, seed=seed, tolerance=pairs[first])
    assert ended.solves == spent[first + 2]


def test_no_tolerance_spends_all_solves_and_history_tells():
    posterior = posed()
    emulated = ef.emulate(posterior, 11, seed=1, tolerance=0.0)
    assert emulated.solves == len(posterior.model.solved) == 11
    assert emulated.history.column("solves") == [6, 8, 10, 11]
    assert np.isfinite(emulated.history.column("true error")[:-1]).all()
    assert "11" in unwrapped(emulated)
    again = pickle.loads(pickle.dumps(emulated))
    theta = PRIOR.sample(np.random.default_rng(1), 5)
    assert_array_equal(again.posterior(theta), emulated.posterior(theta))


def test_hardly_any_of_the_error_is_left_out_of_the_likelihood():
    emulated = ef.emulate(posed(rippled), 12, seed=1, tolerance=0.0)
    processes = replace(emulated.processes[0], covariance=np.diag([0.01, 0.5, 1.0]))
    emulated = replace(emulated, processes=(processes,))
    theta = PRIOR.sample(np.random.default_rng(1), 20)
    moves = emulated.spread(dict(zip("ab", theta.T, strict=True)))[1]["y"]
    square = sum(((move / SD) ** 2).sum(axis=1) for move in moves.values())
    variance = processes.unit_sd(emulated.coordinates(theta)) ** 2
    share = square / (variance * processes.covariance.trace())
    assert share.min() > 0.95 and share.max() < 1.0 + 1e-9


def first_solves(starts, n):
    posterior = posed()
    ef.emulate(posterior, n + 2, seed=1, starts=starts)
    return np.array(posterior.model.solved[:n])


@pytest.mark.parametrize("around", [None, [0.5, -0.5]])
def test_the_first_design_spreads_over_the_prior_or_about_a_point(around):
    centre, first = around or [0.0, 0.0], first_solves(around, 6)
    assert np.isfinite(PRIOR.logpdf(first)).all()
    assert_allclose(first[0], centre, atol=0.01)
    reach = np.abs(first - centre).max()
    assert 1.0 < reach < 4.0 if around is None else 0.1 < reach < 0.8


def test_the_first_design_may_be_chosen():
    points = [[0.1, 0.2], [0.5, -0.4], [0.6, 0.9], [-0.3, 0.1]]
    assert_array_equal(first_solves(points, 4), points)
    with pytest.raises(ValueError, match="starts: .*differ"):
        first_solves([[0.0, x] for x in range(3)], 3)


def hopeless(x):
    raise ArithmeticError("no equilibrium")


@pytest.mark.slow
def test_failed_solves_are_left_out_and_not_asked_again(caplog):
    caplog.set_level(logging.CRITICAL, "emcee_femu")
    reject = {"seed": 3, "on_failure": "reject"}
    posterior = posed(broken)
    emulated = ef.emulate(posterior, 14, **reject, max_failures=0.5, tolerance=0.0)
    solved = np.array(posterior.model.solved)
    failed = solved[:, 0] > 0.9
    assert 0 < failed.sum() < 7 and emulated.solves == len(solved) == 14
    assert len(np.unique(solved, axis=0)) == 14
    # The batches keep away from what failed in the first design, and from each other.
    apart = np.linalg.norm(solved[6:, None] - solved[None, :6][:, failed[:6]], axis=2)
    assert apart.min() > 0.05
    with pytest.raises(ArithmeticError, match="no equilibrium"):
        ef.emulate(posed(broken), 24, seed=3)
    with pytest.raises(RuntimeError, match="0 of 6"):
        ef.emulate(posed(hopeless), 24, **reject, max_failures=1.0)
    with pytest.raises(RuntimeError, match="of 6"):
        ef.emulate(posed(broken), 24, **reject, max_failures=0.0)


def test_a_prior_most_of_which_fails_is_emulated_all_the_same(caplog):
    caplog.set_level(logging.CRITICAL, "emcee_femu")

    def mostly(x):
        if x[0] > -0.4:  # of the prior two thirds, of the posterior as many
            raise ArithmeticError("no equilibrium")
        return bent(x)

    emulated = ef.emulate(posed(mostly), 24, seed=1, on_failure="reject")
    assert 3 <= emulated.solves <= 24


@pytest.mark.slow
def test_a_region_that_fails_is_not_asked_again():
    """Half of the posterior, about: there the emulator knows least."""

    def half(x):
        if x[0] > 0.6:
            raise ArithmeticError("no equilibrium")
        return bent(x)

    posterior, options = posed(half), {"on_failure": "reject", "max_failures": 1.0}
    ef.emulate(posterior, 30, seed=1, tolerance=0.0, **options)
    failed = np.array(posterior.model.solved)[6:, 0] > 0.6
    assert 0 < failed.sum() <= 7  # of 24; 9 where only failed points are kept away from
    assert failed[-12:].sum() <= 4


@pytest.mark.slow
def test_a_round_is_as_wide_as_the_pool(tmp_path):
    options = {"seed": 1, "tolerance": 0.0, "backend": str(tmp_path / "run.solves")}
    with ThreadPoolExecutor(5) as executor:
        emulated = ef.emulate(posed(), 16, pool=executor, **options)
        assert emulated.history.column("solves") == [6, 11, 16]
        assert "3 rounds" in unwrapped(emulated)
        full = exact(bent, Gaussian(), PRIOR, GRID)
        assert total_variation(emulated.posterior(GRID)[:, 0], full) < 0.05
        again = ef.emulate(posed(), 18, pool=executor, resume=True, **options)
        assert again.history.column("solves") == [6, 11, 16, 18]
    with pytest.raises(ValueError, match="solves at a time: was 5, is 2"):
        ef.emulate(posed(), 16, resume=True, **options)
    posterior = posed()
    with pytest.raises(ValueError, match="10 at a time"), ThreadPoolExecutor(10) as ten:
        ef.emulate(posterior, 11, seed=1, pool=ten)
    assert posterior.model.solved == []


@forks
def test_workers_that_a_round_keeps_busy_anyway_change_nothing():
    here, there = (ef.emulate(posed(), 8, seed=4, workers=n) for n in (None, 2))
    theta = PRIOR.sample(np.random.default_rng(1), 5)
    assert here.solves == there.solves
    assert_allclose(there.posterior(theta), here.posterior(theta), rtol=1e-6)


def test_what_cannot_be_emulated_is_refused_before_the_first_solve():
    model = posed().model
    tests = {name: (model, Gaussian()) for name in ("empty", "loaded")}
    joint = ef.LogPosterior.joint(tests, PRIOR)
    with pytest.raises(ValueError, match="'empty', 'loaded'"):
        ef.emulate(joint, 20, seed=1, cheap=[*tests])
    assert model.solved == []


# --- derivatives and logarithms ---------------------------------------------------


def sloped(function, jacobian, prior=PRIOR, term=None):
    """Return the posterior of a problem whose model has derivatives, and its calls."""
    asked, names = [], prior.names

    def read(p):
        asked.append(p)
        return np.array([p[name] for name in names])

    def differentiate(p):
        slopes = jacobian(read(p))
        return function(read(p)), {"y": dict(zip(names, slopes.T, strict=True))}

    term = Gaussian() if term is None else term
    model = ef.FunctionModel(
        lambda p: function(read(p)), variables=term.reads, jacobian=differentiate
    )
    return ef.LogPosterior(model, term, prior), asked


def bent_slopes(x):
    steep = 0.6 * np.cos(2.0 * x[0]) * np.array([1.0, 0.5, -1.0])
    return DESIGN + np.column_stack([steep, np.zeros(3)])


def test_with_derivatives_a_conjugate_posterior_takes_five_solves():
    posterior, _ = sloped(linear, lambda x: DESIGN)
    emulated = ef.emulate(posterior, 20, seed=1)
    assert emulated.solves == 3 + 2
    assert "derivatives at 5 points" in unwrapped(emulated)
    precision = DESIGN.T @ DESIGN / SD**2 + np.eye(2)
    expected = np.linalg.solve(precision, DESIGN.T @ DATA / SD**2)
    weights = shares(emulated.posterior(GRID)[:, 0])
    mean = weights @ GRID
    assert_allclose(mean, expected, atol=1e-3)
    covariance = (weights * (GRID - mean).T) @ (GRID - mean)
    assert_allclose(covariance, np.linalg.inv(precision), atol=1e-4)


@pytest.mark.slow
def test_derivatives_save_solves_and_can_be_switched_off():
    def waves(x):
        return DESIGN @ x + 0.3 * np.sin(4.0 * x[0]) * np.array([1.0, 0.5, -1.0])

    def slopes(x):
        steep = 1.2 * np.cos(4.0 * x[0]) * np.array([1.0, 0.5, -1.0])
        return DESIGN + np.column_stack([steep, np.zeros(3)])

    apart = {}
    full = exact(waves, Gaussian(), PRIOR, GRID)
    for derivatives in (True, False):
        options = {"seed": 1, "tolerance": 0.0, "derivatives": derivatives}
        emulated = ef.emulate(sloped(waves, slopes)[0], 8, **options)
        apart[derivatives] = total_variation(emulated.posterior(GRID)[:, 0], full)
        assert emulated.solves == 8
        assert ("without derivatives" in unwrapped(emulated)) is not derivatives
    assert 3 * apart[True] < 0.001 < apart[False]
    off, plain = emulated, ef.emulate(posed(waves), 8, seed=1, tolerance=0.0)
    theta = PRIOR.sample(np.random.default_rng(1), 5)
    assert_array_equal(off.posterior(theta), plain.posterior(theta))


@pytest.mark.slow
def test_points_without_derivatives_are_learned_by_their_values():
    def refuse(x):
        if x[0] > 0.5:
            raise ValueError("two modes coincide")
        return bent_slopes(x)

    emulated = ef.emulate(sloped(bent, refuse)[0], 14, seed=1, tolerance=0.0)
    assert emulated.solves == 14
    known = int(str(emulated).split("derivatives at ")[1].split()[0])
    assert 3 < known < 14
    full = exact(bent, Gaussian(), PRIOR, GRID)
    assert total_variation(emulated.posterior(GRID)[:, 0], full) < 0.01

    def broken_slopes(x):
        raise TypeError("not a derivative")

    with pytest.raises(TypeError, match="not a derivative"):
        ef.emulate(sloped(bent, broken_slopes)[0], 14, seed=1)


def test_wrong_derivatives_are_left_aside():
    emulated = ef.emulate(sloped(bent, lambda x: -bent_slopes(x))[0], 24, seed=1)
    assert "without derivatives" in unwrapped(emulated)
    full = exact(bent, Gaussian(), PRIOR, GRID)
    assert total_variation(emulated.posterior(GRID)[:, 0], full) < 0.05


@pytest.mark.slow
def test_with_derivatives_a_file_is_gone_on_with_to_the_bit(tmp_path):
    options = {"seed": 1, "tolerance": 0.0}
    whole = ef.emulate(sloped(bent, bent_slopes)[0], 7, **options)
    path = str(tmp_path / "run.solves")
    ef.emulate(sloped(bent, bent_slopes)[0], 5, backend=path, **options)
    options |= {"backend": path, "resume": True}
    with pytest.raises(ValueError, match="derivatives"):
        ef.emulate(sloped(bent, bent_slopes)[0], 9, derivatives=False, **options)
    with pytest.raises(ValueError, match="y by parameter"):
        ef.emulate(sloped(bent, lambda x: bent_slopes(x) * 1.01)[0], 7, **options)
    posterior, asked = sloped(bent, bent_slopes)
    again = ef.emulate(posterior, 7, **options)
    theta = PRIOR.sample(np.random.default_rng(1), 5)
    assert_array_equal(again.posterior(theta), whole.posterior(theta))


@pytest.mark.parametrize("function", [np.log, np.array])
def test_logarithms_are_taken_where_they_leave_smaller_errors(function):
    prior = ef.GaussianPrior(["a", "b"], [1.0, 1.0], 0.3, [(0.1, 3.0)] * 2)
    posed_in = posed(
        lambda x: DESIGN @ function(x), term=Gaussian(DESIGN @ function([1.2, 0.9])),
        prior=prior,
    )  # fmt: skip
    emulated = ef.emulate(posed_in, 16, seed=1, tolerance=0.0)
    assert ("logarithms of a, b" in unwrapped(emulated)) is (function is np.log)


def test_derivatives_are_taken_by_logarithms_too():
    bounds = [(1.0, 6.0), (10.0, 60.0)]
    prior = ef.GaussianPrior(["a", "b"], [3.0, 30.0], [0.9, 9.0], bounds)
    term = Gaussian(DESIGN @ np.log([3.6, 27.0]))
    posterior, _ = sloped(
        lambda x: DESIGN @ np.log(x), lambda x: DESIGN / x, prior, term
    )
    text = unwrapped(ef.emulate(posterior, 6, seed=1, tolerance=0.0))
    assert "with derivatives at 6 points; logarithms of a, b" in text


def test_derivatives_by_the_inputs_alone_are_learned():
    def slopes(p):
        return [p["k"] ** 0.5], {"frequency": {"k": np.array([0.5 * p["k"] ** -0.5])}}

    model = ef.FunctionModel(lambda p: [p["k"] ** 0.5], n_modes=1, jacobian=slopes)
    prior = ef.IndependentPrior({"s": stats.halfnorm(scale=0.02), "k": (5.0, 12.0)})
    term = ef.FrequencyTerm([3.0], discrepancy="s")
    emulated = ef.emulate(ef.LogPosterior(model, term, prior), 4, seed=1, tolerance=0)
    assert emulated.names == ("k",) and "derivatives at 4 points" in unwrapped(emulated)
    k = np.linspace(7.0, 11.0, 5)
    assert_allclose(emulated({"k": k}).frequencies[:, 0], k**0.5, rtol=1e-4)


def test_a_jacobian_that_lacks_a_variable_is_refused_by_name():
    posterior, _ = sloped(bent, bent_slopes)
    model = posterior.model

    def lacking(p):
        return bent(np.array([*p.values()])), {}

    lacks = ef.FunctionModel(
        model.function, variables=model.variables, jacobian=lacking
    )
    with pytest.raises(TypeError, match=r"jacobian.*'y'.*derivatives=False"):
        ef.emulate(ef.LogPosterior(lacks, posterior.terms, PRIOR), 14, seed=1)
