"""What tests of runs share: what they carry beside their chains, and what is run."""

from dataclasses import replace

import numpy as np

import emcee_femu as ef
from emcee_femu.search import auto
from emcee_femu.search.settings import SETTINGS


class Counting:
    """A model that counts its solves, without derivatives."""

    def __init__(self, model):
        self.model, self.variables, self.solves = model, model.variables, 0

    def __call__(self, parameters):
        self.solves += len(next(iter(parameters.values())))
        return self.model(parameters)


def never(*arguments):
    """Stand for a function of which nothing may be asked."""
    raise AssertionError("solved")


class Still(ef.DEMCMove):
    """A move that does not move: the starts alone are looked at."""

    def propose(self, model, state):
        return state, np.zeros(len(state.coords), bool)


def failures(run):
    """Return how many solves of a run there were, and how many failed by cause."""
    log = run.failures
    return log.evaluations, dict(log.causes)


def assert_same(one, other):
    """Compare runs in all that they leave, to the bit."""
    assert len(one) == len(other)
    for a, b in zip(one, other, strict=True):
        for get in ("get_chain", "get_log_prob", "get_blobs"):
            np.testing.assert_array_equal(getattr(a, get)(), getattr(b, get)())
        np.testing.assert_array_equal(a.acceptance_fraction, b.acceptance_fraction)
        states = (sampler.get_last_sample().random_state for sampler in (a, b))
        for mine, yours in zip(*states, strict=True):
            np.testing.assert_array_equal(mine, yours)
        assert a.iteration == b.iteration > 0


def leave_out(monkeypatch, *stages):
    """Let "auto" do without some of its stages: an ablation."""
    kept = tuple(stage for stage in auto.STAGES if stage not in stages)
    monkeypatch.setattr(auto, "STAGES", kept)


def shorten_search(monkeypatch):
    """Let "auto" take less care: starts that a valid sampler may well have."""
    monkeypatch.setattr("emcee_femu.search.auto.ROUND", 200)
    settings = replace(SETTINGS, fruitless=2, searched_share=0.08)
    monkeypatch.setattr("emcee_femu.search.auto.SETTINGS", settings)
