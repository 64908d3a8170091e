"""The public function: pools, failures, printing, conversion."""

import numpy as np
import pytest
from support.tempered_laws import GaussianLaw

import emcee_femu as ef

LAW = GaussianLaw()
POPULATION = ef.anneal(LAW.posterior, 120, seed=1)


def failing(parameters):
    """Fail for a twentieth of the prior."""
    if (parameters["a"] > 0.5 + 1.645).any():
        raise ArithmeticError("no equilibrium")
    return LAW.solve(parameters)


def with_model(model):
    (term,) = LAW.posterior.terms
    return ef.LogPosterior(model, term, LAW.posterior.prior)


def test_a_pool_gives_the_same_population_to_the_bit():
    pooled = ef.anneal(LAW.posterior, 120, seed=1, workers=2)
    assert pooled.theta.tobytes() == POPULATION.theta.tobytes()
    assert (pooled.log_evidence, pooled.solves) == (
        POPULATION.log_evidence,
        POPULATION.solves,
    )


def test_rows_are_those_of_the_posterior():
    assert np.array_equal(LAW.posterior(POPULATION.theta), POPULATION.rows)


def test_a_failed_solve_stops_or_is_rejected():
    posterior = with_model(failing)
    with pytest.raises(ArithmeticError):
        ef.anneal(posterior, 120, seed=1)
    found = ef.anneal(posterior, 120, seed=1, on_failure="reject")
    assert found.failed_solves > 0
    assert (found.theta[:, 0] <= 0.5 + 1.645).all()
    assert "failed" in str(found)
    with pytest.raises(RuntimeError, match="max_failures"):
        ef.anneal(posterior, 120, seed=1, on_failure="reject", max_failures=0.001)


def test_it_prints_what_it_found_and_what_it_cost():
    text = str(POPULATION)
    assert "Population of 120" in text
    assert f"{POPULATION.log_evidence:.3f} +- " in text
    assert f"{POPULATION.solves} solves" in text
    assert POPULATION.table.column("parameter") == ["a", "b", "c"]
    np.testing.assert_allclose(
        POPULATION.table.column("mean"), POPULATION.theta.mean(axis=0)
    )


def test_it_becomes_tables_and_figures_but_no_chain():
    idata = ef.to_inference_data(POPULATION, LAW.posterior)
    table = ef.parameter_table(idata)
    np.testing.assert_allclose(table.column("mean"), POPULATION.theta.mean(axis=0))
    assert len(ef.frequency_table(idata).rows) == 5
    chain = idata["posterior"]["a"].transpose("chain", "draw").values
    assert np.array_equal(chain, POPULATION.theta[None, :, 0])
    with pytest.raises(ValueError, match="population"):
        ef.diagnose(idata)
    with pytest.raises(TypeError, match="population"):
        ef.diagnose(POPULATION)
    for wrong in ({"discard": 1}, {"thin": 2}):
        with pytest.raises(ValueError, match="burn-in"):
            ef.to_inference_data(POPULATION, LAW.posterior, **wrong)


def test_too_few_members_are_refused():
    with pytest.raises(ValueError, match="size: expected at least 60"):
        ef.anneal(LAW.posterior, 59, seed=1)
    assert len(ef.anneal(LAW.posterior, 61, seed=1).theta) == 61
