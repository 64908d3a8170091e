"""Malformed arguments of what reads a run: conversion, tables, figures, verdicts."""

from collections.abc import Mapping, Sequence
from unittest import mock

import numpy as np
from support.border import Target, arguments, properties
from support.kinds import (
    by_name,
    either,
    flag,
    floats,
    listed,
    many,
    none,
    numbers,
    one_of,
    shaped,
    unless,
    whole,
)

import emcee_femu as ef
from emcee_femu.figures.ellipses import covariance_ellipse
from emcee_femu.results.diagnostics import running_tae
from emcee_femu.results.inference_data import dataset, samples

SPRINGS = {"k1": (0, 1, 10.0), "k2": (1, 2, 5.0)}
MODEL = ef.MassSpringModel([1.0, 2.0], SPRINGS)
PRIOR = ef.GaussianPrior(["k1", "k2"], [10.0, 5.0], 2.0, [(2.0, 20.0), (1.0, 9.0)])
TERM = ef.FrequencyTerm(MODEL({}).frequencies[0], relative_sd=0.05)
POSTERIOR = ef.LogPosterior(MODEL, TERM, PRIOR)
OTHER = ef.LogPosterior(
    MODEL, TERM, ef.GaussianPrior(["k2", "k1"], [5.0, 10.0], 1.0, [(1.0, 9.0)] * 2)
)
(SAMPLER,) = ef.run(POSTERIOR, nwalkers=8, nsteps=40, seed=1)
TEMPERED = ef.TemperedMove(ef.DEMCMove(), [1.0, 0.2, 0.0])
(LADDER,) = ef.run(POSTERIOR, TEMPERED, nwalkers=24, nsteps=40, seed=1)


class Reached(Exception):
    """The arguments were good enough to begin."""


IDATA = ef.to_inference_data(SAMPLER, POSTERIOR)


def an_idata(value):
    return value is IDATA or False


def drawn(function):
    """Return the function up to where it begins to draw."""

    def call(**given):
        with (
            mock.patch("matplotlib.pyplot.subplots", side_effect=Reached),
            mock.patch("corner.corner", side_effect=Reached),
        ):
            try:
                return function(**given)
            except Reached:
                return "drawn"

    return call


def compared(**given):
    with mock.patch("emcee_femu.comparison.compare._sampled", side_effect=Reached):
        try:
            return ef.compare_moves(seed=given.pop("seed", 1), **given)
        except Reached:
            return "begun"


def numbers_of(idata):
    return [samples(idata)[1], dataset(idata, "sample_stats")["lp"].values]


NAMES = ("k1", "k2")
numbers_by_name = by_name(shaped(()), NAMES)


def by_title(kind):
    """Refuse all but mappings of titles, which may be empty, to a kind."""

    def accepts(value):
        if not isinstance(value, Mapping) or not all(isinstance(k, str) for k in value):
            return False
        return None if all(kind(v) is not False for v in value.values()) else False

    return accepts


def labelled(value):
    """Any label will do: a figure shows it as text."""
    right = isinstance(value, dict) and all(v is IDATA for v in value.values())
    return None if right and value else False


def chains(value):
    own = one_of(type(SAMPLER))
    return unless(either(own, listed(own)))(value)


def is_text(value):
    return isinstance(value, str)


def plane(value):
    found = floats((None, 2))(value)
    return found if found is False or len(numbers(value)) > 2 else False


def some_moves(value):
    if hasattr(value, "propose") and not isinstance(value, type):
        return None
    return listed(a_move_or_pair)(value)


def a_move_or_pair(value):
    if isinstance(value, Sequence) and len(value) == 2:
        return hasattr(value[0], "propose") and floats((), low=0.0)(value[1])
    return hasattr(value, "propose")


def moments(value):
    found = floats((2,))(value)
    return found if found is False or numbers(value)[1] > 0 else False


def posterior_or_none():
    return either(none, lambda value: value is POSTERIOR or None)


def endless(value):
    """Valid, for who has the time."""
    return isinstance(value, int) and value > 2**60


share = unless(floats((), above=0.0, high=np.nextafter(1.0, 0.0)))
READ = {"samplers": ([SAMPLER], chains), "discard": (0, unless(whole(0)))}
MOVES = {"DE-MC": ef.DEMCMove(), "M-H": [(ef.MetropolisMove(1.0), 1.0)]}
TARGETS = {
    "to_inference_data": Target(
        ef.to_inference_data,
        arguments(
            samplers=([SAMPLER], chains),
            discard=(0, unless(whole(0))),
            thin=(1, unless(whole(1))),
        ),
        fixed={"posterior": POSTERIOR},
        probe=numbers_of,
        examples=60,
    ),
    "diagnose": Target(ef.diagnose, arguments(**READ), examples=60),
    "log_evidence": Target(
        ef.log_evidence,
        arguments(samplers=([LADDER], chains), discard=(0, unless(whole(0)))),
        examples=40,
    ),
    "identifiability": Target(
        ef.identifiability,
        arguments(idata=(IDATA, an_idata)),
        examples=40,
    ),
    "parameter_table": Target(
        ef.parameter_table,
        arguments(
            idata=(IDATA, an_idata),
            nominal=({"k1": 10.0, "k2": 5.0}, either(none, numbers_by_name)),
            published=(
                {"paper": {"k1": 9.0}},
                either(none, by_title(numbers_by_name)),
            ),
        ),
        probe=lambda table: table.rows,
        examples=40,
    ),
    "frequency_table": Target(
        ef.frequency_table,
        arguments(
            idata=(IDATA, an_idata),
            posterior=(POSTERIOR, posterior_or_none()),
            published=(
                {"paper": np.array([0.3, 0.9])},
                either(none, by_title(shaped((2,), (3,)))),
            ),
        ),
        probe=lambda table: table.rows,
        examples=60,
    ),
    "predictive_table": Target(
        ef.predictive_table,
        arguments(idata=(IDATA, an_idata), posterior=(POSTERIOR, posterior_or_none())),
        probe=lambda table: table.rows,
        examples=40,
    ),
    "pairing_table": Target(
        ef.pairing_table, arguments(idata=(IDATA, lambda v: False)), examples=100
    ),
    "running_tae": Target(
        running_tae,
        arguments(
            idata=(IDATA, an_idata),
            posterior=(POSTERIOR, one_of(ef.LogPosterior)),
            points=(20, whole(2), many),
        ),
    ),
    "covariance_ellipse": Target(
        covariance_ellipse,
        arguments(
            points=(np.random.default_rng(1).standard_normal((9, 2)), plane),
            probability=(0.95, share),
        ),
        examples=40,
    ),
    "plot_scatter": Target(
        drawn(ef.plot_scatter),
        arguments(
            idata=(IDATA, an_idata),
            units=({"k1": "N/m"}, either(none, by_name(is_text, NAMES))),
            truths=({"k1": 10.0}, either(none, by_name(floats(()), NAMES))),
            probability=(0.95, share),
        ),
    ),
    "plot_tae": Target(
        drawn(ef.plot_tae),
        arguments(
            idata=(
                {"a": IDATA, "b": IDATA},
                either(an_idata, labelled),
            ),
            posterior=(POSTERIOR, one_of(ef.LogPosterior)),
        ),
    ),
    "plot_correlation": Target(
        drawn(ef.plot_correlation), arguments(idata=(IDATA, an_idata)), examples=100
    ),
    "plot_predictive": Target(
        drawn(ef.plot_predictive),
        arguments(idata=(IDATA, an_idata), posterior=(POSTERIOR, posterior_or_none())),
    ),
    "plot_comparison": Target(
        drawn(ef.plot_comparison),
        arguments(comparison=(None, lambda v: False)),
        examples=40,
    ),
    "compare_moves": Target(
        compared,
        arguments(
            posterior=(POSTERIOR, one_of(ef.LogPosterior)),
            moves=(MOVES, by_title(some_moves)),
            nwalkers=(8, unless(either(none, whole(4))), many),
            nsteps=(16, unless(whole(1)), many),
            ensembles=(2, whole(2), many),
            seed=(1, whole(0)),
            discard=(0.25, unless(floats((), low=0.0, high=1.0))),
            reference=({"k1": (10.0, 1.0)}, either(none, by_name(moments, NAMES))),
            progress=(False, flag, lambda v: v is True or v is np.True_),
        ),
        words=("nwalkers", "nsplits", "max_evaluations"),
        tied=("nwalkers", "moves", "nsteps", "discard"),
    ),
    "compare_moves of max_evaluations": Target(
        compared,
        arguments(max_evaluations=(1_000, unless(whole(128)), endless)),
        fixed={"posterior": POSTERIOR, "moves": MOVES, "nwalkers": 8, "ensembles": 2},
        words=("nsteps", "discard"),
    ),
}
test_a_malformed_argument = properties(TARGETS)
