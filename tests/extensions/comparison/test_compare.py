"""Moves compared by runs made alone."""

import itertools
import time

import arviz as az
import numpy as np
import pytest
import xarray
from numpy.testing import assert_allclose, assert_array_equal

import emcee_femu as ef

C = np.array([[1.0, 0.2, 0.0], [0.5, 1.0, 0.3], [0.1, 0.4, 2.0]])
NAMES, TRUTH, SD = ("a", "b", "c"), np.array([40.0, 60.0, 20.0]), 4.0
WALKERS, STEPS, ENSEMBLES, SEED, DISCARD = 10, 60, 3, 5, 20
KEPT = 40


class Linear:
    """Frequencies C theta; counts the parameter sets that it is given."""

    variables = ef.modal_variables(3)

    def __init__(self):
        self.rows = 0

    def __call__(self, parameters):
        theta = np.stack([parameters[name] for name in NAMES], axis=-1)
        self.rows += len(theta)
        return ef.ModalSolution(theta @ C.T)


class Uncertain(Linear):
    """As an emulator: the likelihood is averaged over what it does not know."""

    def spread(self, parameters):
        response = self(parameters)
        return response, {"frequency": {"seed": 0.01 * response.frequencies}}


def linear(model=Linear):
    bounds = np.stack([TRUTH - 2.5 * SD, TRUTH + 2.5 * SD], axis=1)
    term = ef.FrequencyTerm(C @ TRUTH, relative_sd=0.05)
    return ef.LogPosterior(model(), term, ef.GaussianPrior(NAMES, TRUTH, SD, bounds))


SMALL = {"nwalkers": WALKERS, "steps": STEPS, "ensembles": ENSEMBLES, "seed": SEED}
MOVES = {"DE-MC": ef.DEMCMove(), "auto": "auto"}
MOVES["M-H"] = [(ef.MetropolisMove(sd=4.0), 0.5), (ef.MetropolisMove(sd=2.0), 0.5)]
REFERENCE = {"c": (20.4, 1.1), "a": (39.0, 2.5)}


@pytest.fixture(scope="module")
def small():
    clock = itertools.count()  # a run takes one CPU second
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(time, "process_time", lambda: float(next(clock)))
        options = {"discard": DISCARD, "reference": REFERENCE}
        return ef.compare_moves(linear(), MOVES, **SMALL, **options)


def bulk_ess(walkers):
    """Return the least bulk ESS of chains ``(steps, walkers, d)``."""
    columns = enumerate(np.moveaxis(walkers, -1, 0))
    data = {str(i): (("chain", "draw"), values.T) for i, values in columns}
    table = xarray.Dataset(data, attrs={"sample_dims": ["chain", "draw"]})
    return min(float(v) for v in az.ess(table, method="bulk").values())


@pytest.mark.parametrize("label", MOVES)
def test_all_numbers_are_those_of_the_samplers(small, label):
    posterior = linear()
    samplers = ef.run(posterior, MOVES[label], **SMALL)
    numbers = small.table.rows[list(MOVES).index(label)]
    row = dict(zip(small.table.columns, numbers, strict=True))
    chains = [sampler.get_chain()[DISCARD:] for sampler in samplers]
    everything = np.concatenate(chains, axis=1)
    bulk = bulk_ess(everything)
    alone = 1000 * np.array([bulk_ess(chain) for chain in chains]) / (KEPT * WALKERS)
    before = samplers.evaluations
    evaluations = STEPS * WALKERS * ENSEMBLES + before
    assert_allclose(small.ess_per_1000[label], alone, rtol=1e-9)
    found = ef.diagnose(samplers, DISCARD)
    draws = everything.reshape(-1, 3)
    mean, sd = draws.mean(axis=0), draws.std(axis=0, ddof=1)
    expected = {
        "solves": posterior.model.rows,
        "before chain": before,
        "burn-in": DISCARD,
        "acceptance": np.mean([s.acceptance_fraction for s in samplers]),
        "tau": found.tau.max(),
        "steps/tau": found.steps_per_tau.min(),
        "ESS bulk": bulk,
        "ESS tail": found.ess_tail.min(),
        "ESS per 1000": 1000 * bulk / (KEPT * WALKERS * ENSEMBLES),
        "+-": alone.std(ddof=1) / np.sqrt(ENSEMBLES),
        "ESS per CPU s": bulk * evaluations / (KEPT * WALKERS * ENSEMBLES),
        "R-hat ensembles": found.rhat_between.max(),
        "mean error/sd": max(abs(mean[0] - 39) / 2.5, abs(mean[2] - 20.4) / 1.1),
        "sd error %": 100 * max(abs(sd[0] / 2.5 - 1), abs(sd[2] / 1.1 - 1)),
        "end to end": 1000 * bulk / evaluations,
    }
    assert {"move", "verdict", *expected} == {*row}
    for title, value in expected.items():
        assert_allclose(row[title], value, rtol=1e-9, err_msg=title)
    assert small.diagnoses[label].verdict == found.verdict
    group = small.idata[label]["posterior"]
    kept = np.stack([group[name].values for name in NAMES], axis=-1)
    # Also: all moves start where run starts with this seed, which is the same for all.
    assert_array_equal(kept, np.moveaxis(everything, 0, 1))
    # Proposals out of bounds cost no solve; before a chain are starts, or a search.
    assert before < row["solves"] < evaluations
    assert before > 1_000 if label == "auto" else before == WALKERS * ENSEMBLES


@pytest.mark.parametrize(("evaluations", "steps"), [(2079, 25), (2080, 26)])
def test_the_budget_of_evaluations_is_for_all_ensembles(evaluations, steps):
    """Also of an uncertain model, whose solves the table counts (fault 10)."""
    posterior = linear(Uncertain)
    options = {"max_evaluations": evaluations, "seed": 1, "discard": steps // 2}
    found = ef.compare_moves(posterior, {"DE-MC": ef.DEMCMove()}, 20, **options)
    sizes = dict(found.idata["DE-MC"]["posterior"].sizes)
    assert sizes == {"chain": 4 * 20, "draw": steps - steps // 2}
    assert found.table.column("solves") == [posterior.model.rows]
    assert posterior.model.rows > 4 * 20 * steps / 2


def test_what_a_run_leaves_out_is_left_out_but_paid_for():
    moves = {"DE-MC": ef.DEMCMove(), "auto": "auto"}
    found = ef.compare_moves(linear(), moves, **SMALL | {"steps": 40})
    sizes = [idata["posterior"].sizes["draw"] for idata in found.idata.values()]
    burnt = found.table.column("burn-in")
    assert sizes == [40 - burn_in for burn_in in burnt]
    assert burnt[0] > 0 and burnt[1] == 0
    # All that was evaluated counts for both.
    spent, before, efficiency, whole = (
        np.array(found.table.column(name))
        for name in ("solves", "before chain", "ESS per 1000", "end to end")
    )
    each = WALKERS * ENSEMBLES
    kept = each * np.array(sizes)
    assert_allclose(whole, efficiency * kept / (each * 40 + before), rtol=1e-9)
    assert (spent <= each * 40 + before).all()


STEP_SIZES = {"good": 2.4, "crawling": 0.02}


class OtherStream(ef.MetropolisMove):
    """The same law from other random numbers."""

    def propose(self, model, state):
        model.random.standard_normal()
        return super().propose(model, state)


@pytest.mark.slow
@pytest.mark.parametrize(("other", "winner"), [(1.0, "good"), (2.4, None)])
def test_the_winner_has_converged_and_leads_by_two_combined_errors(other, winner):
    """Of one parameter; a step of 2.4 sds is the best. Nine ensembles to be judged."""

    def model(parameters):
        return ef.ModalSolution(parameters["a"][:, None])

    prior = ef.GaussianPrior(["a"], [10.0], [1.0])
    posterior = ef.LogPosterior(model, ef.FrequencyTerm([10.0], sd=1.0), prior)
    sd = 0.5**0.5
    moves = {name: ef.MetropolisMove(sd=x * sd) for name, x in STEP_SIZES.items()}
    moves["other"] = OtherStream(sd=other * sd)
    found = ef.compare_moves(posterior, moves, 8, 1_000, ensembles=3, seed=2)
    assert not found.diagnoses["crawling"].converged
    able = {k: v for k, v in found.efficiency.items() if found.diagnoses[k].converged}
    assert {*able} == {"good", "other"}
    (low, low_error), (high, error) = sorted(able.values())
    assert (high - low > 2 * np.hypot(error, low_error)) == (winner is not None)
    assert found.winner == winner


@pytest.mark.parametrize(
    ("message", "changes"),
    [
        ("sd: ", {"moves": {"x": ef.MetropolisMove(sd=[1.0, 2.0])}}),
        ("max_eval.*128", {"steps": None, "max_evaluations": 127}),
        ("7 of 20", {"discard": 13}),
        (r"reference\['a'\]", {"reference": {"a": (1, 0)}}),
    ],
)
def test_what_does_not_fit_is_refused_before_sampling(message, changes):
    posterior = linear()
    arguments = {"moves": {"DE-MC": ef.DEMCMove()}, "nwalkers": 8, "steps": 20}
    arguments |= {"ensembles": 2, "seed": 1} | changes
    with pytest.raises(ValueError, match=message):
        ef.compare_moves(posterior, **arguments)
    assert posterior.model.rows == 0
