"""Malformed arguments of what reads a run: conversion, tables, figures, verdicts."""

from unittest import mock

import numpy as np
from border import Target, arguments, properties
from kinds import either, flag, floats, many, none, one_of, unless, unsaid, whole

import emcee_femu as ef
from emcee_femu.diagnostics import running_tae
from emcee_femu.ellipses import covariance_ellipse
from emcee_femu.inference_data import dataset, samples

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
    with mock.patch("emcee_femu.comparison._sampled", side_effect=Reached):
        try:
            return ef.compare_moves(seed=given.pop("seed", 1), **given)
        except Reached:
            return "begun"


def numbers_of(idata):
    return [samples(idata)[1], dataset(idata, "sample_stats")["lp"].values]


def posterior_or_none():
    return either(none, lambda value: value is POSTERIOR or None)


def endless(value):
    """Valid, for who has the time."""
    return isinstance(value, int) and value > 2**60


share = unless(floats((), above=0.0, high=np.nextafter(1.0, 0.0)))
READ = {"samplers": (SAMPLER, unsaid), "discard": (0, unless(whole(0)))}
MOVES = {"DE-MC": ef.DEMCMove(), "M-H": [(ef.MetropolisMove(1.0), 1.0)]}
TARGETS = {
    "to_inference_data": Target(
        ef.to_inference_data,
        arguments(
            samplers=(SAMPLER, unsaid),
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
        arguments(samplers=(LADDER, unsaid), discard=(0, unless(whole(0)))),
        examples=100,
    ),
    "identifiability": Target(
        ef.identifiability,
        arguments(idata=(IDATA, an_idata)),
        examples=100,
    ),
    "parameter_table": Target(
        ef.parameter_table,
        arguments(
            idata=(IDATA, an_idata),
            nominal=({"k1": 10.0, "k2": 5.0}, either(none, unsaid)),
            published=({"paper": {"k1": 9.0}}, either(none, unsaid)),
        ),
        probe=lambda table: table.rows,
        examples=80,
    ),
    "frequency_table": Target(
        ef.frequency_table,
        arguments(
            idata=(IDATA, an_idata),
            posterior=(POSTERIOR, posterior_or_none()),
            published=({"paper": np.array([0.3, 0.9])}, either(none, unsaid)),
        ),
        probe=lambda table: table.rows,
        examples=60,
    ),
    "predictive_table": Target(
        ef.predictive_table,
        arguments(idata=(IDATA, an_idata), posterior=(POSTERIOR, posterior_or_none())),
        probe=lambda table: table.rows,
        examples=80,
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
            points=(np.random.default_rng(1).standard_normal((9, 2)), unsaid),
            probability=(0.95, share),
        ),
        examples=100,
    ),
    "plot_scatter": Target(
        drawn(ef.plot_scatter),
        arguments(
            idata=(IDATA, an_idata),
            units=({"k1": "N/m"}, either(none, unsaid)),
            truths=({"k1": 10.0}, either(none, unsaid)),
            probability=(0.95, share),
        ),
    ),
    "plot_tae": Target(
        drawn(ef.plot_tae),
        arguments(
            idata=({"a": IDATA, "b": IDATA}, unsaid),
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
        examples=80,
    ),
    "compare_moves": Target(
        compared,
        arguments(
            posterior=(POSTERIOR, one_of(ef.LogPosterior)),
            moves=(MOVES, unsaid),
            nwalkers=(8, unless(either(none, whole(4))), many),
            nsteps=(16, unless(whole(1)), many),
            ensembles=(2, whole(2), many),
            seed=(1, whole(0)),
            discard=(0.25, unless(floats((), low=0.0, high=1.0))),
            reference=({"k1": (10.0, 1.0)}, either(none, unsaid)),
            progress=(False, either(flag, unsaid), lambda v: v is True),
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
