import itertools
import time

import arviz as az
import emcee
import numpy as np
import pytest
import xarray
from numpy.testing import assert_allclose, assert_array_equal

import emcee_femu as ef


def samples(idata):
    """Return draws ``(chain, draw, 3)``."""
    return np.stack([idata["posterior"][name].values for name in NAMES], axis=-1)


C = np.array([[1.0, 0.2, 0.0], [0.5, 1.0, 0.3], [0.1, 0.4, 2.0]])
NAMES, TRUTH, SD = ("a", "b", "c"), np.array([40.0, 60.0, 20.0]), 4.0
WALKERS, STEPS, ENSEMBLES, SEED, DISCARD = 10, 200, 3, 5, 60
KEPT = 140


class Linear:
    """Frequencies C theta; counts the parameter sets that it is given."""

    variables = ef.modal_variables(3)

    def __init__(self):
        self.rows = 0

    def __call__(self, parameters):
        theta = np.stack([parameters[name] for name in NAMES], axis=-1)
        self.rows += len(theta)
        return ef.ModalSolution(theta @ C.T)


def linear(relative_sd=0.05, width=2.5):
    bounds = np.stack([TRUTH - width * SD, TRUTH + width * SD], axis=1)
    term = ef.FrequencyTerm(C @ TRUTH, relative_sd=relative_sd)
    return ef.LogPosterior(Linear(), term, ef.GaussianPrior(NAMES, TRUTH, SD, bounds))


SMALL = {"nwalkers": WALKERS, "steps": STEPS, "ensembles": ENSEMBLES, "seed": SEED}
MOVES = {
    "DE-MC": ef.DEMCMove(),
    "M-H": [
        (ef.MetropolisMove(sd=4.0), 0.5),
        (ef.MetropolisMove(sd=[2.0, 2.0, 3.0]), 0.5),
    ],
    "stretch": emcee.moves.StretchMove(),
    "auto": "auto",
}
REFERENCE = {"c": (20.4, 1.1), "a": (39.0, 2.5)}


@pytest.fixture(scope="module")
def small():
    clock = itertools.count()  # a run takes one CPU second
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(time, "process_time", lambda: float(next(clock)))
        return ef.compare_moves(
            linear(), MOVES, **SMALL, discard=DISCARD, reference=REFERENCE
        )


@pytest.fixture(scope="module")
def by_hand():
    """Return samplers and the number of FE solves of each move, run alone."""
    result = {}
    for label, move in MOVES.items():
        posterior = linear()
        result[label] = (
            ef.run(posterior, move, **SMALL),
            posterior.model.rows,
        )
    return result


def bulk_ess(walkers):
    """Return the least bulk ESS of chains ``(steps, walkers, d)``."""
    data = {
        str(i): (("chain", "draw"), walkers[:, :, i].T) for i in range(walkers.shape[2])
    }
    table = xarray.Dataset(data, attrs={"sample_dims": ["chain", "draw"]})
    found = az.ess(table, method="bulk")
    return min(float(found[name]) for name in data)


@pytest.mark.parametrize("label", MOVES)
def test_all_numbers_are_those_of_the_samplers(small, by_hand, label):
    samplers, solves = by_hand[label]
    row = dict(
        zip(
            small.table.columns, small.table.rows[list(MOVES).index(label)], strict=True
        )
    )
    chains = [sampler.get_chain()[STEPS - KEPT :] for sampler in samplers]
    everything = np.concatenate(chains, axis=1)
    bulk = bulk_ess(everything)
    alone = 1000 * np.array([bulk_ess(chain) for chain in chains]) / (KEPT * WALKERS)
    before = samplers.evaluations
    evaluations = STEPS * WALKERS * ENSEMBLES + before
    assert_allclose(small.ess_per_1000[label], alone, rtol=1e-9)
    found = ef.diagnose(samplers, STEPS - KEPT)
    draws = everything.reshape(-1, 3)
    mean, sd = draws.mean(axis=0), draws.std(axis=0, ddof=1)
    expected = {
        "move": label,
        "FE solves": solves,
        "before chain": before,
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
        "verdict": row["verdict"],
    }
    assert list(row) == list(expected)
    for title, value in expected.items():
        if isinstance(value, str):
            assert row[title] == value
        else:
            assert_allclose(row[title], value, rtol=1e-9, err_msg=title)
    assert small.diagnoses[label].verdict == found.verdict
    kept = samples(small.idata[label])
    # Also: all moves start where run starts with this seed, which is the same for all.
    assert_array_equal(kept, np.moveaxis(everything, 0, 1))


def test_proposals_out_of_bounds_cost_no_solve(small):
    evaluations = STEPS * WALKERS * ENSEMBLES
    for solves, before in zip(
        small.table.column("FE solves"), small.table.column("before chain"), strict=True
    ):
        assert before < solves < evaluations + before
    least = small.table.column("before chain")
    assert least[:3] == [WALKERS * ENSEMBLES] * 3  # the starts
    assert least[3] > 1_000  # a search and a refinement too
    line = small.conclusion.splitlines()[-1]
    assert line.startswith("auto: a search by") and "evaluations in all before" in line


@pytest.mark.parametrize(("evaluations", "steps"), [(2079, 25), (2080, 26)])
def test_the_budget_of_evaluations_is_for_all_ensembles(evaluations, steps):
    found = ef.compare_moves(
        linear(),
        {"DE-MC": ef.DEMCMove()},
        20,
        max_evaluations=evaluations,
        seed=1,
        discard=steps // 2,
    )
    draws = samples(found.idata["DE-MC"])
    assert draws.shape == (4 * 20, steps - steps // 2, 3)


class OtherStream(ef.DEMCMove):
    """The same law from other random numbers."""

    def propose(self, model, state):
        model.random.standard_normal()
        return super().propose(model, state)


@pytest.mark.slow
def test_equal_moves_have_no_winner_and_a_crawling_one_is_not_converged():
    # A lead of two standard errors: one seed in twenty has a winner by chance.
    moves = {
        "crawling": ef.MetropolisMove(sd=0.02),
        "one": ef.DEMCMove(),
        "two": OtherStream(),
    }
    found = ef.compare_moves(linear(), moves, 10, 1_500, seed=4)
    crawling, one, two = found.table.column("verdict")
    assert one == two == "converged" and crawling == "too short"
    assert found.winner is None
    first, second = found.conclusion.splitlines()
    assert first.startswith("No winner: ") and "within the spread of the ens" in first
    assert second.startswith("Not converged, so excluded: crawling (too short")


@pytest.mark.parametrize(
    ("error", "message", "changes"),
    [
        (TypeError, r"moves\['x'\]: expected an emcee", {"moves": {"x": "demc"}}),
        (ValueError, "sd: ", {"moves": {"x": ef.MetropolisMove(sd=[1.0, 2.0])}}),
        (ValueError, "max_eval.*at least 128", {"steps": None, "max_evaluations": 127}),
        (ValueError, "to judge, got 7 of 20.*discard=13", {"discard": 13}),
        (ValueError, r"reference\['a'\]: .*sd above", {"reference": {"a": (1, 0)}}),
    ],
)
def test_what_does_not_fit_is_refused_before_sampling(error, message, changes):
    posterior = linear()
    arguments = {"posterior": posterior, "moves": {"DE-MC": ef.DEMCMove()}}
    arguments |= {"nwalkers": 8, "steps": 20, "ensembles": 2, "seed": 1}
    with pytest.raises(error, match=message):
        ef.compare_moves(**{**arguments, **changes})
    assert posterior.model.rows == 0


class Uncertain(Linear):
    """As an emulator: the likelihood is averaged over what it does not know."""

    def spread(self, parameters):
        response = self(parameters)
        return response, {"frequency": {"seed": 0.01 * response.frequencies}}


def test_the_solves_of_an_uncertain_model_are_counted():
    """Fault 10: of an emulated posterior the table said none."""
    usual = linear()
    posterior = ef.LogPosterior(Uncertain(), usual.terms, usual.prior)
    found = ef.compare_moves(posterior, {"DE-MC": ef.DEMCMove()}, 10, 20, seed=1)
    assert found.table.column("FE solves") == [posterior.model.rows]
    assert posterior.model.rows > 10 * 20
