"""The ledger: every solve has a payer, and what is kept for a stage stays."""

import re

import numpy as np
import pytest
from support.campaigns import by_hand
from support.free_posterior import box, free_posterior
from support.gradients import LinearDerived, LinearTerm

import emcee_femu as ef

POSTERIOR = free_posterior(lambda x: -0.5 * (x**2).sum(axis=1), box(-9, 9, 2))


def linear():
    model = LinearDerived()
    prior = ef.GaussianPrior(model.names, np.zeros(3), 1.0)
    return ef.LogPosterior(model, LinearTerm(), prior)


def test_a_stage_inside_another_pays_for_itself():
    c = by_hand(POSTERIOR)

    def solve(n):
        c.evaluator.rows(np.zeros((n, 2)))

    with c.ledger.charge("outer"):
        solve(1)
        with c.ledger.charge("inner"):
            solve(20)
        solve(300)
        with pytest.raises(ZeroDivisionError), c.ledger.charge("inner"):
            solve(4_000)
            raise ZeroDivisionError
    assert c.ledger.spent == {"first solve": 0, "outer": 301, "inner": 4_020}


def test_others_end_where_what_is_kept_begins():
    ledger = by_hand(POSTERIOR, total=9_000, kept={"adapt": 10, "judge": 200}).ledger
    ends = ledger.end("judge"), ledger.end("adapt", "judge"), ledger.end()
    assert ends == (8_800, 8_790, 8_790)


@pytest.mark.parametrize("posterior", [POSTERIOR, linear()])
def test_who_spent_what_adds_up_and_is_printed(posterior, tmp_path):
    where = str(tmp_path / "run.chain")
    options = {"backend": where, "resume": True, "ensembles": 2, "seed": 1}
    found = ef.run(posterior, steps=2, **options).search
    assert sum(found.spent.values()) == found.solves
    assert found.spent["explore"] > 0 < found.spent["judge"]
    shown = str(found)
    for stage, solves in found.spent.items():
        row = f"{stage.replace('_', ' ')} +{solves:,} "
        assert not solves or re.search(row, shown)
    again = ef.run(posterior, steps=3, **options).search  # as the file has it
    assert again.spent == found.spent and str(again) == shown
