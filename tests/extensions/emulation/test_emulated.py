"""EmulatedModel: its mean, its slopes, its spread against draws, where modes cross."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.linalg import logm
from support.contracts import assert_model

import emcee_femu as ef
from emcee_femu.extensions.emulation import partition
from emcee_femu.extensions.emulation.gaussian_process import fit_processes


def matrices(x, coupling=0.3):
    """Return symmetric ``(n, 3, 3)`` whose eigenvalues meet as ``x (n, 2)`` changes."""
    n = len(x)
    A = np.zeros((n, 3, 3))
    A[:, 0, 0] = 100.0 + 8.0 * x[:, 0]
    A[:, 1, 1] = 100.0 - 6.0 * x[:, 0] + 3.0 * x[:, 1] + 0.5 * x[:, 1] ** 2
    A[:, 2, 2] = 101.0 + 5.0 * x[:, 1]
    for i, j in ((0, 1), (1, 2), (0, 2)):
        A[:, i, j] = A[:, j, i] = coupling * (1.0 + 0.2 * x[:, 0])
    return A


def respond(x, coupling=0.3, seed=None):
    """Return frequencies, and shapes at five sensors, with random signs if seeded."""
    values, vectors = np.linalg.eigh(matrices(x, coupling))
    base = np.random.default_rng(5).standard_normal((5, 3))
    shapes = base @ vectors * (1.0 + 0.05 * x[:, :1, None])
    if seed is not None:
        rng = np.random.default_rng(seed)
        shapes = shapes * rng.choice([-1.0, 1.0], size=(len(x), 1, 3))
    return {"frequency": np.sqrt(values) / (2 * np.pi), "shapes": shapes}


SCALE = np.array([1e-3, 1e10])  # of the parameters, far apart
NAMES = ["E", "t"]
PRIOR = ef.GaussianPrior(NAMES, [0.0, 0.0], SCALE, [(-9 * s, 9 * s) for s in SCALE])
SD = {"frequency": 0.002, "shapes": 0.02, "sorted": 0.002}
MIDDLE = respond(np.zeros((1, 2)))
MIDDLE["sorted"] = MIDDLE["frequency"]


class Errors(ef.likelihoods.term.Term):
    """Gaussian errors of what the model returns in the middle."""

    def __init__(self, reads):
        self.reads = reads

    def deviations(self, parameters, response):
        parts = []
        for name in self.reads:
            r = values_of(response, name) - MIDDLE[name]
            parts.append(r.reshape(len(r), -1) / SD[name])
        r = np.hstack(parts)
        return r, np.ones_like(r)


@cache
def emulate(*reads, beside=(), n=13):
    """Return a model emulated from points that were given, and a batch of two more."""
    names = [*reads, *beside]
    declared = ef.modal_variables(3, dofs=range(5))
    declared["sorted"] = declared["frequency"]

    def solve(p):
        x = np.array([[p["E"], p["t"]]]) / SCALE
        full = respond(x, seed=int(1e6 * abs(p["E"])))
        full["sorted"] = full["frequency"]
        return {name: full[name][0] for name in names}

    model = ef.FunctionModel(solve, variables={name: declared[name] for name in names})
    term = Errors({name: declared[name] for name in reads})
    points = np.random.default_rng(2).standard_normal((n, 2))
    posterior = ef.LogPosterior(model, term, PRIOR)
    return ef.emulate(posterior, n + 2, seed=1, tolerance=0, starts=points * SCALE)


def at(x):
    return dict(zip(NAMES, (x * SCALE).T, strict=True))


RNG = np.random.default_rng(7)
X, FRESH = RNG.standard_normal((6, 2)), 0.7 * RNG.standard_normal((300, 2))


def test_it_is_a_modal_model_that_a_posterior_takes():
    model = emulate("frequency", "shapes")
    assert_model(model, at(X))
    assert model.names == ("E", "t") and model.solves == 15
    assert isinstance(model(at(X)), ef.ModalSolution)
    assert np.isfinite(model.posterior(X * SCALE)[:, 0]).all()
    solved = np.random.default_rng(2).standard_normal((13, 2))
    found, truth = model(at(solved)).frequencies, respond(solved)["frequency"]
    assert_allclose(found, truth, atol=0.2 * SD["frequency"])
    outside = at(X) | {"t": np.full(6, 1e11)}
    for call in (model, model.jacobian, model.spread):
        with pytest.raises(ValueError, match=r"t = 1e\+11 of row 0"):
            call(outside)


def by_logarithms(model):
    """Return a model that takes its numbers for entries of ln(Lambda)."""
    blocks = [
        replace(block, usual=np.linspace(95.0, 105.0, len(block.unit)))
        for block in model.outputs.blocks
    ]
    return replace(model, outputs=replace(model.outputs, blocks=tuple(blocks)))


def by_own_lengths(model):
    """Return a model whose first number has processes of its own."""
    (fitted,) = model.processes
    parts = fitted.values[:, :, :1], fitted.values[:, :, 1:]
    apart = (
        type(fitted)(fitted.points, part, scale * fitted.lengths, False)
        for part, scale in zip(parts, (0.5, 1.0), strict=True)
    )
    return replace(model, processes=tuple(apart))


CASES = {
    "shapes": lambda: emulate("frequency", "shapes"),
    "by shapes": lambda: emulate("frequency", beside=("shapes",)),
    "three moments": lambda: emulate("frequency"),
    "numbers": lambda: emulate("sorted"),
    "logarithms": lambda: by_logarithms(emulate("frequency", "shapes")),
    "own lengths": lambda: by_own_lengths(emulate("sorted")),
}
every_case = pytest.mark.parametrize("case", CASES)


def values_of(response, name):
    return np.asarray(ef.contracts.read(response, name))


@every_case
def test_jacobian_is_the_slope_of_a_call(case):
    model = CASES[case]()
    response, slopes = model.jacobian(at(X))
    for key in model.variables:
        assert_array_equal(values_of(response, key), values_of(model(at(X)), key))
        for i, name in enumerate(NAMES):
            move = 1e-5 * np.eye(2)[i]
            ahead, behind = (values_of(model(at(X + s * move)), key) for s in (1, -1))
            if key == "shapes":  # a shape has no sign of its own
                ahead, behind = (
                    v * np.sign((v * values_of(response, key)).sum(1, keepdims=True))
                    for v in (ahead, behind)
                )
            expected = (ahead - behind) / (2e-5 * SCALE[i])
            size = np.abs(expected).max()
            assert_allclose(slopes[key][name], expected, rtol=1e-4, atol=1e-5 * size)


def test_blocks_know_how_they_move_where_modes_nearly_meet():
    """Second route: what they are at points aside, encoded again."""
    response, h = respond(X), 1e-6
    sides = [respond(X + s * h * np.eye(2)[j]) for j in range(2) for s in (1, -1)]
    modes = {name: np.array([side[name] for side in sides]) for name in response}
    ahead, behind = modes["shapes"][::2], modes["shapes"][1::2]
    for shapes in (ahead, behind):  # a shape has no sign of its own
        shapes *= np.sign((shapes * response["shapes"]).sum(axis=2, keepdims=True))
    tangents = {
        name: np.moveaxis(values[::2] - values[1::2], 0, -1) / (2 * h)
        for name, values in modes.items()
    }
    tangents["frequency"][1] = tangents["shapes"][1] = np.nan  # not known
    for case in ("shapes", "by shapes", "three moments", "logarithms"):
        outputs = CASES[case]().outputs
        observed = partition.observe(outputs, response, tangents)
        assert_array_equal(observed[:, 0], outputs.encode(response))
        rest = np.arange(len(X)) != 1
        assert np.isnan(observed[1, 1:]).all()
        for j in range(2):
            moved = [outputs.encode(sides[2 * j + k]) for k in (0, 1)]
            expected = (moved[0] - moved[1]) / (2 * h)
            size = np.abs(expected).max()
            assert_allclose(
                observed[rest, 1 + j], expected[rest], rtol=1e-3, atol=1e-4 * size
            )


@every_case
def test_finite_moves_stay_finite_wherever_modes_may_be(case):
    outputs = CASES[case]().outputs
    values = 100.0 * np.random.default_rng(1).standard_normal((50, outputs.size))
    values[::2] = np.round(values[::2], -2)  # many coincide
    tangents = np.tile(3 * np.eye(outputs.size), (50, 1, 1))
    moved = outputs.decode(values, tangents, True)[1]
    assert all(np.isfinite(move).all() for move in moved.values())


def test_logarithms_of_eigenvalues_are_those_of_the_aligned_matrix():
    response = respond(X)
    (block,) = by_logarithms(emulate("frequency", "shapes")).outputs.blocks
    entries, upper = block.encode(response), np.triu_indices(3)
    plain = replace(block, usual=None)
    for row, logs in zip(plain.encode(response), entries, strict=True):
        A = np.empty((3, 3))
        A[upper] = A.T[upper] = row[:6]
        expected = logm(A * np.sqrt(np.outer(block.unit, block.unit)))
        relative = block.unit / block.usual  # errors of logarithms
        expected = expected / np.sqrt(np.outer(relative, relative))
        assert_allclose(logs[:6], expected[upper], rtol=1e-9, atol=1e-9)
        assert_array_equal(logs[6:], row[6:])
    still = np.empty((*entries.shape, 0))
    decoded = block.decode(entries, still, False)[0]["eigenvalues"]
    assert_allclose(np.sqrt(decoded) / (2 * np.pi), response["frequency"])


@pytest.mark.slow
@pytest.mark.parametrize("own_lengths", [False, True])
def test_spread_is_the_scatter_of_sampled_outputs(own_lengths):
    # Second route: draw the outputs, decode each draw. Few points: much uncertainty.
    model, far = emulate("frequency", "shapes", n=4), 2.0 * X
    model = by_own_lengths(model) if own_lengths else model
    points, draws, values = model.coordinates(far * SCALE), 1_000, []
    rng = np.random.default_rng(0)
    for processes in model.processes:
        q = len(processes.covariance)
        squares, axes = np.linalg.eigh(processes.covariance)
        factor = axes * np.sqrt(np.maximum(squares, 0.0))  # of more than points
        z = rng.standard_normal((len(far), draws, q))
        sd, mean = processes.unit_sd(points), processes.predict(points)
        values.append(mean[:, None] + sd[:, None, None] * (z @ factor.T))
    values, q = np.concatenate(values, axis=2), model.outputs.size
    still = np.empty((len(far) * draws, q, 0))
    decoded = model.outputs.decode(values.reshape(-1, q), still)[0]["frequency"]
    expected = decoded.reshape(len(far), draws, 3).std(axis=1)
    response, moves = model.spread(at(far))
    claimed = np.sqrt(sum(move**2 for move in moves["frequency"].values()))
    assert_array_equal(response.frequencies, model(at(far)).frequencies)
    assert np.count_nonzero(expected > 0.1 * SD["frequency"]) > 3
    assert_allclose(claimed, expected, rtol=0.13, atol=0.02 * SD["frequency"])


@pytest.mark.slow
@pytest.mark.parametrize("beside", [("shapes",), ()])
def test_modes_that_cross_are_emulated_together_to_advantage(beside):
    """As numbers under another name they are sorted, with the kinks; 42 solves each."""

    def error(model, name):
        wrong = values_of(model(at(FRESH)), name) - respond(FRESH)["frequency"]
        return np.sqrt((wrong**2).mean())

    together = error(emulate("frequency", beside=beside, n=40), "frequency")
    alone = error(emulate("sorted", n=40), "sorted")
    assert together < (0.1 if beside else 0.4) * alone
    if beside:
        shapes = emulate("frequency", "shapes", n=40)(at(FRESH)).shapes
        truth = respond(FRESH)["shapes"]
        products = (shapes * truth).sum(axis=1) ** 2
        squares = (shapes**2).sum(axis=1) * (truth**2).sum(axis=1)
        assert np.quantile(1 - products / squares, 0.95) < 1e-3


def test_blocks_have_lengths_of_their_own_where_that_is_better():
    """One of them waves along the first coordinate, the other along the second."""
    x, fresh = RNG.standard_normal((2, 30, 2))
    units, even = {"y": np.ones(1), "z": np.ones(1)}, np.full(30, 1 / 30)

    def wave(x, column):
        return 9.0 * np.sin(4.0 * x[:, [column]])

    def answer(x, second):
        return {"y": wave(x, 0), "z": wave(x, second)}

    def error(processes, second):
        truth = np.hstack([*answer(fresh, second).values()])
        return np.abs(np.hstack([p.predict(fresh) for p in processes]) - truth).mean()

    apart = partition.fit_outputs(x, answer(x, 1), {}, units, even)[1]
    together = fit_processes(x, np.hstack([wave(x, 0), wave(x, 1)])[:, None])
    assert len(apart) == 2 and error(apart, 1) < 0.5 * error([together], 1)
    alike = partition.fit_outputs(x, answer(x, 0), {}, units, even)[1]
    assert len(alike) == 1 and error(alike, 0) < 0.5 * error([together], 1)
    again = partition.fit_outputs(x, answer(x, 1), {}, units, even, start=apart)[1]
    assert len(again) == 2


def test_modes_out_of_order_at_some_points_leave_blocks_as_they_are():
    x = np.random.default_rng(7).standard_normal((40, 2))
    near = respond(x, coupling=0.1)["frequency"]
    near[7, :2] = near[7, 1::-1]
    far = [3.0, 3.25] + 0.1 * x[:, :1] * [1.0, -1.0]  # told by other means
    assert 0 < (far[:, 0] > far[:, 1]).sum() < 4
    response = {"frequency": np.hstack([near, far])}
    units, even = {"frequency": np.full(5, SD["frequency"])}, np.full(40, 1 / 40)
    outputs = partition.fit_outputs(x, response, {}, units, even)[0]
    sizes = {block.first: block.size for block in outputs.blocks}
    assert sizes == {0: 3, 3: 1, 4: 1} and not outputs.ascending
