"""The benchmarks, at their smallest: what they print is what their pages quote."""

import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from scipy import integrate, stats
from support.examples import load


@pytest.mark.slow
def test_benchmark(capsys):
    found = load("benchmark").main(steps=400, repeats=1, only="bim5")
    auto = found["bim5", "auto (ours)"]
    assert auto[0] > 60  # ESS per 1000 evaluations; emcee's DEMove has 17
    assert abs(auto[4] - 0.3) < 0.03  # the weight of the left mode
    assert "end to end" in capsys.readouterr().out


@pytest.mark.slow
def test_overhead(capsys):
    load("overhead").main(blocks=2, n=20)
    assert capsys.readouterr().out.count("x faster") == 12


@pytest.mark.slow
def test_evidence(monkeypatch, capsys):
    options = ["--seeds", "2", "--processes", "1", "--problem", "Gaussian, d=2"]
    monkeypatch.setattr(sys, "argv", ["evidence.py", *options, "--method", "auto"])
    module = load("evidence")  # whose functions no other process could import
    monkeypatch.setattr(module, "ProcessPoolExecutor", ThreadPoolExecutor)
    module.main()
    shown = capsys.readouterr().out
    assert "Gaussian, d=2" in shown and "2 seeds each" in shown


@pytest.mark.slow
def test_annealed_evidence(monkeypatch, capsys):
    options = ["--seeds", "2", "--size", "200", "--target", "two modes"]
    monkeypatch.setattr(sys, "argv", ["annealed_evidence.py", *options])
    load("annealed_evidence").main()
    shown = capsys.readouterr().out
    assert "two modes" in shown and "2 seeds each" in shown


@pytest.mark.slow
def test_hamiltonian():
    table = load("benchmarks/hamiltonian").main((20,), 4_000, 1)
    assert table.column("HMC")[0] > 5 * table.column("DE-MC")[0]


# --- hard targets -----------------------------------------------------------------

HARD = load("hard_targets")


@pytest.mark.parametrize("name", HARD.ALL)
def test_hard_posteriors(name):
    """A reversible step from exact draws may not change centre, spread or density."""
    target = HARD.ALL[name]()
    x = HARD.inside(target, 200_000 // max(10, len(target.box)), seed=3)
    rng = np.random.default_rng(4)
    # Along differences of draws, so that ridges are followed, some of them short.
    pairs = x[rng.permutation(len(x))] - x[rng.permutation(len(x))]
    y = x + 10 ** -rng.uniform(0, 2, (len(x), 1)) * pairs
    inside = ((y >= target.box[:, 0]) & (y <= target.box[:, 1])).all(axis=1)
    y[~inside] = x[~inside]  # a step that is not taken
    before, after = (np.column_stack([a, target.log_density(a)]) for a in (x, y))
    share = np.exp(np.minimum(after[:, -1:] - before[:, -1:], 0))
    assert share.mean() > 0.02
    low, centre, high = np.quantile(before, [0.2, 0.5, 0.8], axis=0)
    before, after = (np.tanh((a - centre) / (high - low)) for a in (before, after))
    for power in (1, 2):  # of what is bounded: moments of heavy tails scatter
        change = share * (after**power - before**power)
        z = change.mean(axis=0) / change.std(axis=0) * np.sqrt(len(x))
        assert np.abs(z).max() < 4.5


@pytest.mark.slow
@pytest.mark.parametrize("name", ["needle, d=5, 20 sd", "banana"])
def test_hard_targets(name, capsys):
    """What is called converged is right, and z says how far off it is."""
    (runs,) = HARD.main(seeds=3, targets=name, steps=1_000).values()
    assert "called converged" in capsys.readouterr().out
    good = [run for run in runs if run.short == "converged"]
    for run in good:
        assert np.abs(run.mean_z).max() < 5 and run.weight_error < 0.05
    assert not good or HARD.rms(run.mean_z for run in good) < 2
    assert len(good) > 1 or name == "banana"


# --- few solves -------------------------------------------------------------------

FEW = load("few_solves")


@pytest.mark.parametrize(
    ("name", "exact"),
    [
        ("beck_au", lambda: FEW.beck_au_exactly().posterior),
        ("h_structure", lambda: FEW.ef.paper.h_structure(500.0).posterior),
    ],
)
def test_their_posteriors_are_the_published_ones(name, exact):
    theta = exact().prior.sample(np.random.default_rng(2), 5)
    found = FEW.PROBLEMS[name]().posterior(theta)[:, 0]
    np.testing.assert_allclose(np.diff(found), np.diff(exact()(theta)[:, 0]), rtol=1e-9)


@pytest.mark.slow
def test_few_solves(monkeypatch, capsys):
    options = ["--seeds", "1", "--first", "7", "--problem", "beck_au"]
    monkeypatch.setattr("sys.argv", ["few_solves.py", *options])
    for (_, derivatives), (one,) in FEW.main().items():
        assert one.good("beck_au")
        assert one.solves == (12 if derivatives else 30)
        assert one.efficiency > 0.9 and one.verdict == "certified"
    assert capsys.readouterr().out.count("1 of 1") == 2


# --- clusters ---------------------------------------------------------------------


@pytest.mark.slow
def test_cluster_scaling(capsys):
    """A simulated cluster has the closed forms."""
    scaling = load("cluster_scaling")
    *tables, measured = scaling.main(most=8, solve=1e-3)
    shown = capsys.readouterr().out
    assert all(str(table) in shown for table in (*tables, measured))
    assert measured.column("workers") == [2]
    for table in tables:
        assert table.column("workers") == [1, 2, 8]
        for row in table.rows:
            assert (np.diff(row[1:]) > -1).all()  # a larger ensemble is used better
    for workers, jobs in [(1, 5), (4, 5), (7, 30), (1_000, 1_500)]:  # equal times
        expected = jobs / (workers * -(-jobs // workers))
        assert scaling.efficiency(workers, jobs, 0.0) == pytest.approx(expected)
    # One job a worker: the mean time over the expected longest one.
    sigma = np.sqrt(np.log1p(0.5**2))
    law = stats.lognorm(sigma, scale=np.exp(-0.5 * sigma**2))
    for n in (2, 200):
        longest, _ = integrate.quad(
            lambda t, n=n: -np.expm1(n * law.logcdf(t)), 0, 60, limit=200
        )
        found = scaling.efficiency(n, n, 0.5, repeats=4_000)
        assert found == pytest.approx(1 / longest, rel=0.03)
    # A master that hands out nothing else: its own time is the limit.
    limited = scaling.efficiency(1_000, 4_000, 0.0, dispatch=0.1)
    assert limited == pytest.approx(4_000 / (1_000 * (4_000 * 0.1 + 1)))


@pytest.mark.slow
def test_curved_posteriors(monkeypatch, capsys):
    options = ["--problem", "springs", "--seeds", "2", "--steps", "20"]
    monkeypatch.setattr(sys, "argv", ["curved_posteriors.py", *options])
    module = load("curved_posteriors")
    module.main()
    assert "springs" in capsys.readouterr().out
    for problem, _, nwalkers, _ in module.PROBLEMS.values():
        posterior, truth = problem(1)
        assert nwalkers >= max(20, 2 * posterior.ndim)  # what emcee asks for
        assert set(truth) <= set(posterior.names)
        theta = posterior.prior.sample(np.random.default_rng(1), 2)
        assert np.isfinite(posterior(theta)).all()


# --- large models -----------------------------------------------------------------


def test_a_solid_has_its_mass_and_strain_energy():
    module = load("large_model")
    M, parts = module.solid(750)
    above = module.SIZES[2] * np.arange(1, 11) / 10  # the foot is held
    density, volume = module.RHO, module.SIZES.prod()
    for axis in range(3):  # lumped: half of the lowest layer is at the foot
        unit = np.tile(np.eye(3)[axis], 250)
        assert unit @ M @ unit == pytest.approx(density * volume * 19 / 20)
        stretched = np.repeat(above, 25)[:, None] * np.eye(3)[axis]  # a strain of one
        lame = module.E * module.NU / ((1 + module.NU) * (1 - 2 * module.NU))
        shear = module.E / (2 * (1 + module.NU))
        modulus = shear if axis < 2 else lame + 2 * shear
        energy = [stretched.ravel() @ K @ stretched.ravel() for K in parts.values()]
        assert sum(energy) == pytest.approx(modulus * volume)
        shares = np.array([3, 3, 2, 2]) / 10  # layers of each quarter
        np.testing.assert_allclose(energy, modulus * volume * shares)


@pytest.mark.slow
def test_large_model(monkeypatch, capsys):
    """The law of reductions, beside a full model, as the page prints it."""
    pytest.importorskip("resource", reason="there is none on Windows")
    monkeypatch.setitem(sys.modules, "pypardiso", None)
    monkeypatch.setenv("MKL_NUM_THREADS", "1")
    module = load("large_model")  # whose functions no other process could import
    monkeypatch.setattr(
        module, "ProcessPoolExecutor", lambda *_, **__: ThreadPoolExecutor(1)
    )
    table = module.main(dofs=(300,))
    assert str(table) in capsys.readouterr().out
    (row,) = table.rows
    assert row[:2] == (384, "SuperLU")
    assert 0 < table.column("error")[0] < 1e-4 and table.column("basis")[0] < 100


def test_buildings(capsys):
    """A uniform chain has its closed form; data scatter as is said."""
    module = load("buildings")
    measured = module.main()
    assert str(measured) in capsys.readouterr().out and measured.n_modes == 5
    model, prior = module.shear_building([*"abcd"], 2.0, 4, (1, 3))
    nominal = dict(zip("abcd", prior.mean[:, None], strict=True))
    i = np.arange(1, 5)
    expected = np.sqrt(2e8 / 2.0) / np.pi * np.sin((2 * i - 1) * np.pi / 18)
    np.testing.assert_allclose(model(nominal).frequencies[0], expected)
    rng = np.random.default_rng(1)
    tests = [module.measure(model, nominal, 4, rng) for _ in range(200)]
    ratios = [test.frequencies / expected - 1 for test in tests]
    assert np.std(ratios) == pytest.approx(module.RELATIVE_SD, rel=0.1)
    assert tests[0].shapes.shape == (2, 4) and tests[0].dofs.tolist() == [1, 3]
