"""The benchmarks, at their smallest: what they print is what their pages quote."""

import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from support.examples import load


@pytest.mark.slow
def test_benchmark(capsys):
    """The law of its page: "auto" finds the weight, and beats what emcee has."""
    compared = load("benchmark").main(steps=400, targets=("bim5",))["bim5"]
    assert compared.efficiency["auto"][0] > 60  # per 1000; emcee's DEMove has 17
    x1 = compared.idata["auto"]["posterior"]["x0"].values
    assert abs((x1 < 0).mean() - 0.3) < 0.03  # the weight of the left mode
    assert "end to end" in capsys.readouterr().out


@pytest.mark.slow
@pytest.mark.parametrize(
    ("method", "problem"), [("auto", "Gaussian, d=2"), ("anneal", "two modes")]
)
def test_evidence(method, problem, monkeypatch, capsys):
    """What the page quotes is printed, of one target, and it is near the truth."""
    evidence = load("evidence")
    monkeypatch.setattr(evidence, "MEMBERS", 200)
    found = evidence.main(2, (problem,), (method,))
    assert abs(found.column("bias")[0]) < 1 and problem in capsys.readouterr().out


def test_commands(monkeypatch, capsys):
    """A function's arguments are the options, by their defaults."""
    commands = load("commands")
    called = []

    def main(seeds: int = 3, steps: int = 4, names: tuple = ("a", "b")):
        called.append((seeds, steps, names))

    monkeypatch.setattr(sys, "argv", ["x.py", "--steps", "5", "--names", "c"])
    commands.command(main)
    assert called == [(3, 5, ["c"])]
    table = commands.tabulate("squares", {"n": "d"}, map(lambda n: (n * n,), [2]))
    assert table.column("n") == [4] and "squares" in capsys.readouterr().out


@pytest.mark.slow
def test_hamiltonian():
    """The law of its page: gradients win in twenty dimensions."""
    table = load("benchmarks/hamiltonian").main((20,), 4_000, 1)
    assert table.column("HMC")[0] > 5 * table.column("DE-MC")[0]


@pytest.mark.slow
def test_products():
    """Data that say a product alone, as a model and as a bare density."""
    table = load("benchmarks/products").main(1, 3, ("uniform",), (1.0,))
    assert table.column("converged") == [1] * 4 and not any(table.column("wrong"))
    assert max(table.column("most")) < 40_000  # in the parameters themselves 200,000


@pytest.mark.slow
@pytest.mark.parametrize("light", ["0.1, 1.0", "0.4, 1.5"])
def test_of_two_parts_across_each_other_none_is_lost(light):
    """Where the curvature at a maximum is that of neither part."""
    name = f"pancakes, d=8, {light} off"
    ((run,),) = load("benchmarks/hard_targets").main(1, name, 4).values()
    assert run.converged and not run.wrong and run.right


@pytest.mark.slow
def test_damage_alarms(capsys):
    """What the page quotes is printed: intervals hold, in some pairs of each loss."""
    table = load("damage_alarms").main(4)
    assert table.column("pairs") == [3, 1]
    assert min(table.column("95 %")) > 60 and "Alarms" in capsys.readouterr().out


@pytest.mark.slow
def test_default_runs():
    """The law of its page: a run of the README's example ends within 8,000 solves."""
    table = load("default_runs").main(1, 0, ("two springs",))
    assert table.column("converged") == [1]
    assert table.column("search")[0] < table.column("solves")[0] < 8_000


@pytest.mark.slow
def test_paper_runs():
    """The law of its page: the published means are ours, and the lobe is small."""
    compared, others = load("paper_runs").main(1_500, 100)
    assert max(compared.column("apart, sd")) < 0.5
    assert 1 < others.column("ours")[1] < 6  # %


@pytest.mark.slow
def test_fit_calibration():
    """The law of its page: right tests fit, and wrong ones never do."""
    table = load("benchmarks/fit_calibration").main(10, 10, 78)
    right = [i for i, test in enumerate(table.column("test")) if test == "right"]
    counts = [(table.column("tests")[i], table.column("fits")[i]) for i in right]
    assert all(fits >= tests - 1 for tests, fits in counts)
    assert sum(table.column("fits")) == sum(fits for _, fits in counts)
    assert sum(table.column("named")) >= 7


def test_constants_stay_sensible():
    """Whole numbers stay whole, shares below one, degrees of freedom above two."""
    scale = load("constants").scale
    assert scale("TESTED", 8, 0.5) == 4 and scale("UNTESTED", 1, 0.5) == 1
    assert scale("VALLEY", 0.5, 2.0) == 0.95 and scale("LACK", 2.5, 2.0) == 5.0
    assert scale("DFS", (3.0, 8.0), 0.5) == (2.1, 4.0)
    assert scale("LOOK_FURTHER", 1.25, 0.5) == 1.125


@pytest.mark.slow
def test_stages():
    """A search of fewer points takes fewer solves, one that adapts nothing more."""
    changes = "today", "1,000 p.", "no adapt"
    has, takes = load("benchmarks/stages").main(1, 41, ("ring of four",), changes, 1)
    ((_, today, fewer, plain),) = takes.rows
    assert has.column("today") == [1] and fewer < 0.8 * today < plain


@pytest.mark.slow
def test_constants(monkeypatch, capsys):
    """A search of fewer points takes fewer solves, one of more takes more."""
    constants = load("constants")
    monkeypatch.setattr(constants, "TARGETS", ("two springs",))
    before = constants.MODULES["auto"].SETTINGS
    table = constants.main(1, ("searched_share",))
    today, row = table.rows
    assert today[2:] == (1.0, 1, 0, 0) * 2 and row[0] in capsys.readouterr().out
    assert table.column("half")[1] < 1 < table.column("twice")[1]
    assert row[5] == row[9] == 1  # run that differs
    assert constants.MODULES["auto"].SETTINGS is before  # as it was


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
def test_hard_targets(capsys):
    """The law of its page, of crossed lobes; of all targets it has the rates."""
    (runs,) = HARD.main(seeds=3, targets="crossed, d=6", first=70).values()
    assert "called converged" in capsys.readouterr().out
    assert not any(run.wrong for run in runs if run.converged)
    assert sum(run.converged for run in runs) >= 2


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
    found = FEW.PROBLEMS[name](FEW.ValuesOnly).posterior(theta)[:, 0]
    np.testing.assert_allclose(np.diff(found), np.diff(exact()(theta)[:, 0]), rtol=1e-9)


@pytest.mark.slow
def test_few_solves(monkeypatch, capsys):
    """The law of its page: twelve solves with derivatives suffice."""
    monkeypatch.setattr(FEW, "EVALUATIONS", 4_000)
    options = {"problem": ("beck_au",), "learned": ("with derivatives",)}
    ((one,),) = FEW.main(seeds=1, first=7, **options).values()
    assert one.good("beck_au") and one.solves == 12
    assert one.efficiency > 0.9 and one.verdict == "certified"
    assert "worst of 1 seeds" in capsys.readouterr().out


@pytest.mark.slow
def test_cluster_scaling(capsys):
    """The law of a simulated cluster: closed forms."""
    scaling = load("cluster_scaling")
    measured = scaling.main(most=8, solve=1e-3)[-1]
    assert str(measured) in capsys.readouterr().out
    for workers, jobs in [(1, 5), (4, 5), (7, 30), (1_000, 1_500)]:  # equal times
        expected = jobs / (workers * -(-jobs // workers))
        assert scaling.efficiency(workers, jobs, 0.0) == pytest.approx(expected)
    # A master that hands out nothing else: its own time is the limit.
    limited = scaling.efficiency(1_000, 4_000, 0.0, dispatch=0.1)
    assert limited == pytest.approx(4_000 / (1_000 * (4_000 * 0.1 + 1)))


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


@pytest.mark.slow
def test_buildings(capsys):
    """What the page quotes is printed."""
    table = load("buildings").main(seeds=1, steps=20)
    assert str(table) in capsys.readouterr().out and min(table.column("ESS")) > 20


def test_a_uniform_building_has_its_closed_form_and_data_scatter_as_is_said():
    module = load("buildings")
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


@pytest.mark.slow
def test_sensor_doctor(capsys):
    """The law of its page: no right sensor is suspect, and wrong ones are found."""
    table = load("benchmarks/sensor_doctor").main(30, 15, 20_000)
    faults, found = table.column("fault"), np.array(table.column("found %"))
    shares = {fault: found[np.equal(faults, fault)].mean() for fault in faults}
    assert shares["none"] == 100
    assert min(shares["turned"], shares["exchanged"], shares["gain 1000"]) > 82
    assert max(table.column("other %")) < 20 and "turned" in capsys.readouterr().out


@pytest.mark.slow
def test_given_moves(capsys):
    """The law of its page, of the README's example: the burn-in is enough."""
    found = load("benchmarks/given_moves").main(2, 300, ("two springs",), ("DE-MC",))
    assert found.column("converged") == [2] and found.column("wrong") == [0]
    assert found.column("solves")[0] < 15_000 and "DE-MC" in capsys.readouterr().out


@pytest.mark.slow
def test_one_call(monkeypatch, capsys):
    """The law of its page: what is certified is right, within the budget."""
    one_call = load("benchmarks/one_call")
    monkeypatch.setattr(one_call, "TRUE_SIZE", 2_000)
    one_call.main(1, 7, ("beck_au",), ("with derivatives",), (90,), 1)
    said = capsys.readouterr().out
    (row,) = [line.split() for line in said.splitlines() if line.startswith("90 ")]
    budget, calls, certified, wrong, *_ = map(int, row)
    assert calls == 1 and certified <= 1 and wrong == 0
