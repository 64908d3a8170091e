"""Where an emulator solves next, by another route."""

import numpy as np
import pytest
from support.stored import PRIOR

import emcee_femu as ef
from emcee_femu.extensions.emulation.emulate import _Emulation


def crossed(x):
    """Return two variables, one waving along either parameter."""
    return {"y": [np.sin(2.0 * x[0])], "z": [0.4 * np.sin(3.0 * x[1])]}


class Crossed(ef.likelihoods.term.Term):
    """Independent errors of both."""

    reads = {name: ef.Variable({"point": range(1)}) for name in "yz"}

    def deviations(self, parameters, response):
        r = np.hstack([response["y"] - 0.5, response["z"] + 0.1])
        return r, np.full_like(r, 0.1)


@pytest.mark.slow
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
