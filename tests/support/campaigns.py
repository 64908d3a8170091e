"""Campaigns made by hand, on which one stage of a search is tested by itself."""

import numpy as np

from emcee_femu.evaluation.evaluator import Evaluation, Solver
from emcee_femu.search.campaign import Campaign, Sizes
from emcee_femu.search.ledger import Ledger

KEPT = {"adapt": 3_000, "judge": 4_000, "bend": 0, "tune": 0}


def by_hand(posterior, seed=1, ensembles=1, total=30_000, kept=KEPT):
    """Return a campaign before its first stage."""
    evaluator = Evaluation(Solver(posterior, False))
    streams = [np.random.default_rng([seed, i]) for i in range(ensembles)]
    sizes = Sizes(points=1_000, batch=300, refined=1_500, judged=2_000, chain=10_000)
    return Campaign(evaluator, streams, Ledger(evaluator, total, kept), sizes)
