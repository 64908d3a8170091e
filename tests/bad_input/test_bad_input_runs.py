"""Malformed posteriors, starts, runs, pools and comparisons."""

import warnings
from collections.abc import Sequence

import emcee
import numpy as np
from support.border import Target, arguments, properties
from support.kinds import (
    either,
    flag,
    floats,
    listed,
    many,
    none,
    numbers,
    one_of,
    unless,
    unsaid,
    whole,
)

import emcee_femu as ef

SPRINGS = {"k1": (0, 1, 10.0), "k2": (1, 2, 5.0)}
MODEL = ef.MassSpringModel([1.0, 2.0], SPRINGS)
PRIOR = ef.GaussianPrior(["k1", "k2"], [10.0, 5.0], 2.0, [(2.0, 20.0), (1.0, 9.0)])
MEASURED = MODEL({}).frequencies[0]
TERM = ef.FrequencyTerm(MEASURED, relative_sd=0.05)
POSTERIOR = ef.LogPosterior(MODEL, TERM, PRIOR)
POINT = np.array([9.0, 6.0])
START = POSTERIOR.start(8, 1)


def by_hand(theta):
    """The log-posterior of one point or several, term by term."""
    rows = []
    for k1, k2 in np.atleast_2d(theta):
        if PRIOR.logpdf(np.array([[k1, k2]]))[0] == -np.inf:
            rows.append([-np.inf] * 3 + [np.nan] * 2)
            continue
        f = MODEL({"k1": np.array([k1]), "k2": np.array([k2])}).frequencies[0]
        r = (f / MEASURED - 1) / 0.05
        likelihood = -0.5 * r @ r - np.log(0.05 * MEASURED * np.sqrt(2 * np.pi)).sum()
        prior = PRIOR.logpdf(np.array([[k1, k2]]))[0]
        rows.append([prior + likelihood, prior, likelihood, *f])
    return np.reshape(rows, (*np.shape(theta)[:-1], 5))


def inside(value):
    given = numbers(value)
    if given is None or given.shape[-1:] != (2,) or given.ndim > 2:
        return False
    return True if np.isfinite(given).all() else None


def in_bounds(value):
    low, high = PRIOR.bounds.T
    return bool(((numbers(value) >= low) & (numbers(value) <= high)).all())


def start_point(value):
    return either(none, lambda v: floats((2,))(v) and in_bounds(v))(value)


def positions(value):
    found = floats((8, 2), (1, 8, 2))(value)
    if not found:
        return none(value) or found
    given, (low, high) = numbers(value), PRIOR.bounds.T
    return bool(((given >= low) & (given <= high)).all())


def chains(samplers):
    return [(s.get_chain(), s.get_log_prob(), s.get_blobs()) for s in samplers]


def model_of(result):
    """Evaluate a posterior whose model returns ``result``."""
    posterior = ef.LogPosterior(lambda p: result, TERM, PRIOR)
    return posterior(POINT[None])


def term_of(result):
    """Evaluate a posterior whose term returns ``result``."""
    posterior = ef.LogPosterior(MODEL, [lambda p, m: result, TERM], PRIOR)
    return posterior(np.stack([POINT, POINT + 0.5]))


def compared(**given):
    with warnings.catch_warnings():
        return ef.compare_moves(seed=1, **given)


def runnable(value):
    move = one_of(emcee.moves.Move)
    return either(none, move, listed(either(move, pair)))(value)


def pair(value):
    if not isinstance(value, Sequence) or len(value) != 2:
        return False
    right = isinstance(value[0], emcee.moves.Move)
    return unless(floats((), low=0.0))(value[1]) if right else False


def two_modes(value):
    """An array of floats, (1, 2) or more modes, finite."""
    if not isinstance(value, np.ndarray) or isinstance(value, np.ma.MaskedArray):
        return False
    found = floats((1, None))(value)
    return found if found is False or value.shape[1] > 1 else False


def below_infinity(value):
    given = numbers(value)
    right = given is not None and given.shape == (2,) and (given < np.inf).all()
    return None if right else False


def has_map(value):
    """Whatever has a map is a pool, by the letter."""
    return hasattr(value, "map")


def policy(value):
    return isinstance(value, str) and value in ("raise", "reject")


def a_name(value):
    """The name of a file is one, whatever it is."""
    return isinstance(value, str) and bool(value)


def not_a_file(value):
    return value is None


def shown(value):
    """A bar would be drawn."""
    return value is True or value is np.True_


TARGETS = {
    "LogPosterior": Target(
        ef.LogPosterior,
        arguments(
            model=(MODEL, unless(callable)),
            terms=([TERM], either(unless(callable), listed(callable))),
            prior=(PRIOR, one_of(ef.GaussianPrior)),
        ),
        probe=lambda posterior: (posterior.names, posterior.n_modes),
        late=("terms", "model"),
        examples=40,
    ),
    "LogPosterior called": Target(
        POSTERIOR,
        arguments(theta=(np.stack([POINT, POINT + 1]), inside)),
        truth=by_hand,
        examples=40,
    ),
    "LogPosterior of a bad model": Target(
        model_of,
        arguments(
            result=(ef.ModalSolution(MEASURED[None]), unless(one_of(ef.ModalSolution)))
        ),
        alias={"result": "model"},
        words=("the",),
        examples=40,
    ),
    "LogPosterior of bad frequencies": Target(
        lambda result: model_of(ef.ModalSolution(result)),
        arguments(result=(MEASURED[None], two_modes)),
        alias={"result": "model"},
        words=("the",),
        examples=40,
    ),
    "LogPosterior of a bad term": Target(
        term_of,
        arguments(result=(np.array([-1.0, -2.0]), below_infinity)),
        alias={"result": "terms?"},
        words=("terms", "the"),
        examples=40,
    ),
    "LogPosterior.start": Target(
        POSTERIOR.start,
        arguments(
            nwalkers=(3, whole(1), many),
            seed=(1, unsaid, none),
            around=(POINT, start_point),
        ),
        examples=40,
    ),
    "run": Target(
        ef.run,
        arguments(
            posterior=(POSTERIOR, one_of(ef.LogPosterior)),
            moves=([(ef.DEMCMove(), 0.5), (ef.SnookerMove(), 0.5)], runnable),
            nwalkers=(8, unless(either(none, whole(4))), many),
            nsteps=(2, whole(1), many),
            ensembles=(1, unless(whole(1)), many),
            seed=(5, whole(0)),
            pool=(None, none, has_map),
            vectorize=(None, either(none, flag)),
            backend=(None, not_a_file, a_name),
            thin_by=(1, whole(1), many),
            progress=(False, flag, shown),
            initial=(START, positions),
            resume=(False, lambda v: flag(v) and (None if v else True)),
            on_failure=("raise", policy),
            max_failures=(0.1, floats((), low=0.0, high=1.0)),
        ),
        probe=chains,
        tied=("ensembles", "initial", "nwalkers", "moves"),
        words=("nsplits",),
        examples=60,
    ),
}
test_a_malformed_argument = properties(TARGETS)
