"""All that can be stored in a file and gone on with, of one small posterior."""

from functools import partial

import numpy as np

import emcee_femu as ef
from support import few_solves
from support.few_solves import DATA, PRIOR, SD
from support.runs import failures

ALONE = ef.GaussianPrior(["a"], [0.0], 1.0, [(-4.0, 4.0)])
LINE = np.linspace(-1.0, 1.0, 5)[:, None]
# What the model does, and how often it was called; it is no part of it.
COUNT = {"calls": 0, "stop": 0, "offset": 0.0, "do": lambda: None}


def bent(p):
    """Solve one parameter set; be interrupted at a call, and fail for large a."""
    COUNT["calls"] += 1
    COUNT["do"]()
    if COUNT["calls"] == COUNT["stop"]:
        raise KeyboardInterrupt
    if p["a"] > 1.5:
        raise ArithmeticError("no equilibrium")
    return few_solves.bent([p["a"], p.get("b", 0.2)]) + COUNT["offset"]


VARIABLES = {"y": ef.Variable({"point": range(3)})}


class Gaussian(few_solves.Gaussian):
    """It keeps the measured values."""

    name = "strain"

    def __init__(self, data=DATA, sd=SD):
        super().__init__(np.asarray(data), sd)
        self.observed = {"y": self.data}


def posed(term=None, prior=PRIOR, model=None):
    model = model or ef.FunctionModel(bent, variables=VARIABLES)
    return ef.LogPosterior(model, term or Gaussian(), prior)


REJECT = {"on_failure": "reject", "max_failures": 1.0}


def sampled(path, posterior=None, moves=None, resume=True, **options):
    options = {"nwalkers": 12, "steps": 20, "ensembles": 2, "seed": 1} | options
    moves = moves or ef.DEMCMove()
    file = {"backend": path, "resume": resume} if path else {}
    return ef.run(posterior or posed(), moves, **REJECT | file | options)


def tempered(path, **options):
    inner = (ef.DEMCMove(), 0.6), (ef.MetropolisMove(sd=0.2), 0.4)
    moves = [(ef.moves.TemperedMove(move, [1.0, 0.3]), share) for move, share in inner]
    return sampled(path, moves=moves, nwalkers=24, thin_by=2, **options)


def annealed(path, posterior=None, steps=0, resume=True, **options):
    file = {"backend": path, "resume": resume} if path else {}
    options = {"size": 80, "seed": 1} | file | options
    return ef.anneal(posterior or posed(), **REJECT | options)


def emulated(path, posterior=None, steps=0, resume=True, **options):
    options = {"solves": 8, "seed": 1, "tolerance": 0.0} | options
    posterior = posterior or posed(prior=ALONE)
    file = {"backend": path, "resume": resume} if path else {}
    return ef.emulate(posterior, **REJECT | file | options)


KINDS = {
    "chain": sampled,
    "workers": partial(sampled, workers=2),
    "tempered": tempered,
    "auto": partial(sampled, moves="auto"),
    "anneal": annealed,
    "emulate": emulated,
}


def bits(result):
    """Return all numbers of a result, as bytes and text."""
    if hasattr(result, "history"):
        return [result.posterior(LINE).tobytes(), result.solves, str(result.history)]
    if hasattr(result, "powers"):
        arrays = ("theta", "rows", "powers", "acceptance", "sweeps", "effective_size")
        numbers = ("log_evidence", "log_evidence_error", "solves", "failed_solves")
        parts = [getattr(result, name).tobytes() for name in arrays]
        return parts + [getattr(result, name) for name in numbers]
    parts = [failures(result)[1]]
    for sampler in result:
        chain = sampler.get_chain(), sampler.get_log_prob(), sampler.get_blobs()
        state = sampler.get_last_sample().random_state
        accepted = sampler.acceptance_fraction
        parts += [np.ascontiguousarray(x).tobytes() for x in (*chain, accepted)]
        parts += [np.asarray(x).tobytes() for x in state[1:]]
    return parts
