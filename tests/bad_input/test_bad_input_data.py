"""Malformed priors, measurements, likelihood terms, MAC and pairing."""

import numpy as np
from scipy import stats
from support.border import Target, arguments, properties
from support.kinds import (
    by_name,
    either,
    flag,
    floats,
    moderate,
    none,
    numbers,
    of_complex,
    one_of,
    unless,
)

import emcee_femu as ef
from emcee_femu.posterior import priors

NAMES = ("k1", "k2")
POINTS = np.array([[4e3, 3e3], [3.5e3, 4.5e3], [4e3, 9e3]])
SHAPES = np.array([[1.0, 1.0], [1.6, -0.6], [0.3, 0.8]])
HERTZ = np.array([3.1, 9.8])


def labels(n=None):
    def accepts(value):
        if isinstance(value, str | bytes | set | dict):
            return False if not isinstance(value, dict) else None
        try:
            given = list(value)
        except TypeError:
            return False
        strings = all(isinstance(item, str) and item for item in given)
        if not (strings and given) or len(set(given)) < len(given):
            return False
        return n is None or len(given) == n

    return accepts


def intervals(n):
    def accepts(value):
        array = numbers(value)
        if array is None or array.shape != (n, 2):
            return False
        if not (array[:, 0] < array[:, 1]).all():
            return False
        if (np.diff(array) < 1e-9).any() or np.isinf(array).any():
            return None
        return None if (array[:, 0] > 9e3).any() or (array[:, 1] < -5e3).any() else True

    return accepts


def truncated(names, mean, sd, bounds):
    bounds = [(-np.inf, np.inf)] * 2 if bounds is None else bounds
    low, high = np.transpose(bounds)
    mean, sd = np.broadcast_to(mean, 2), np.broadcast_to(sd, 2)
    law = stats.truncnorm((low - mean) / sd, (high - mean) / sd, mean, sd)
    return law.logpdf(POINTS).sum(axis=1)


def increasing(*shapes):
    positive = floats(*shapes, above=0.0)

    def accepts(value):
        found = positive(value)
        if found is False:
            return False
        array = numbers(value)
        if (np.diff(array) < 0).any():
            return False
        return None if (np.diff(array) == 0).any() else found

    return accepts


def covariance(value):
    found = floats((2, 2))(value)
    if not found:
        return found
    C = numbers(value)
    if not np.allclose(C, C.T, rtol=1e-8, atol=0) or np.linalg.eigvalsh(C)[0] <= 0:
        return False
    return None if np.linalg.cond(C) > 1e8 else True


def dof_rows(value):
    array = numbers(value)
    if array is None or array.shape != (3,) or np.asarray(value).dtype.kind not in "iu":
        return False
    return bool((array >= 0).all() and len(set(array.tolist())) == 3)


def real_shapes(*shape):
    """Accept shapes of one size, none of which is zero at all sensors."""

    def accepts(value):
        found = floats(shape)(value)
        if found is False or not numbers(value).any(axis=-2).all():
            return False
        return found

    return accepts


def shapes(*shape):
    """Accept real ones, and say nothing of complex ones of the same size."""

    def accepts(value):
        found = real_shapes(*shape)(value)
        if found is not False or not of_complex(value):
            return found
        return None if np.shape(value) == shape else False

    return accepts


REPEATS = HERTZ * (1 + 0.01 * np.random.default_rng(1).standard_normal((5, 2)))
TESTS = SHAPES + 0.05 * np.random.default_rng(2).standard_normal((5, 3, 2))


class Result:
    def __init__(self, Fn, Phi, Fn_std):
        self.Fn, self.Phi, self.Fn_std = Fn, Phi, Fn_std


RESULT = Result(HERTZ, SHAPES, None)


def pyoma2(Fn, Phi, Fn_std, **options):
    return ef.Measurements.from_pyoma2(Result(Fn, Phi, Fn_std), **options)


def laws(value):
    """Accept frozen continuous distributions by name."""
    kind = by_name(
        lambda law: hasattr(law, "logpdf") and not isinstance(law, stats.rv_continuous)
    )
    return False if kind(value) is False or not len(value) else None


TARGETS = {
    "GaussianPrior": Target(
        ef.GaussianPrior,
        arguments(
            names=(NAMES, labels(2)),
            mean=(np.array([4e3, 2e3]), unless(floats((2,), low=-1e100, high=1e100))),
            sd=(np.array([1e3, 2e3]), moderate(unless(floats((), (2,), above=0.0)))),
            bounds=(np.array([(3e3, 5e3), (1e3, 5e3)]), either(none, intervals(2))),
        ),
        probe=lambda prior: prior.logpdf(POINTS),
        truth=truncated,
    ),
    "GaussianPrior without bounds": Target(
        ef.GaussianPrior,
        arguments(
            mean=(np.array([4e3, 2e3]), floats((2,), low=-1e100, high=1e100, huge=1e9)),
            sd=(np.array([1e3, 2e3]), moderate(floats((), (2,), above=0.0, huge=1e9))),
        ),
        fixed={"names": NAMES},
        probe=lambda prior: prior.logpdf(POINTS),
    ),
    "IndependentPrior": Target(
        ef.IndependentPrior,
        arguments(
            marginals=({"k1": stats.uniform(0, 9e3), "k2": stats.norm(3e3, 9)}, laws)
        ),
        probe=lambda prior: (
            prior.names,
            prior.logpdf(np.resize(POINTS, (3, len(prior.names)))),
        ),
        examples=40,
    ),
    "uniform_between": Target(
        priors.uniform_between,
        arguments(
            low=(1e3, floats((), high=np.nextafter(5e3, 0))),
            high=(5e3, floats((), above=1e3)),
        ),
        probe=lambda law: law.logpdf(np.array([2e3, 6e3])),
        truth=lambda low, high: [
            -np.log(high - low) if low <= x <= high else -np.inf for x in (2e3, 6e3)
        ],
        examples=40,
    ),
    "Measurements": Target(
        ef.Measurements,
        arguments(
            frequencies=(HERTZ, increasing((2,))),
            sd=(np.array([0.1, 0.2]), either(none, floats((2,), above=0.0))),
            shapes=(SHAPES, real_shapes(3, 2)),
            shape_sd=(0.1 * np.ones((3, 2)), either(none, floats((3, 2), above=0.0))),
            sensors=(["roof", "two", "one"], either(none, labels(3))),
            dofs=(np.array([7, 1, 3]), either(none, dof_rows)),
            phase_collinearity=(
                np.array([0.95, 1.0]),
                either(none, unless(floats((2,), low=0, high=1))),
            ),
        ),
        alias={"phase_collinearity": "phase.collinearity"},
        words=("covariance",),
        tied=("shapes", "shape_sd", "sensors", "dofs", "frequencies", "sd"),
    ),
    "Measurements of a covariance": Target(
        ef.Measurements,
        arguments(
            covariance=(np.array([[0.1, 0.02], [0.02, 0.3]]), either(none, covariance))
        ),
        fixed={"frequencies": HERTZ},
        examples=40,
    ),
    "Measurements.from_repeats": Target(
        ef.Measurements.from_repeats,
        arguments(
            frequencies=(REPEATS, unless(floats((5, 2), above=0.0))),
            shapes=(TESTS, unless(either(none, shapes(5, 3, 2)))),
            correlated=(True, flag),
            sensors=(["roof", "two", "one"], either(none, labels(3))),
            dofs=(np.array([7, 1, 3]), either(none, dof_rows)),
        ),
        tied=("frequencies", "shapes", "sensors", "dofs"),
    ),
    "Measurements.from_pyoma2 of junk": Target(
        ef.Measurements.from_pyoma2,
        arguments(
            result=(RESULT, one_of(Result)),
            shape_sd=(False, unless(flag)),
            dofs=(np.array([7, 1, 3]), either(none, dof_rows)),
        ),
        alias={"shape_sd": "shape_sd|result"},
    ),
    "Measurements.from_pyoma2": Target(
        pyoma2,
        arguments(
            Fn=(HERTZ, unless(floats((2,), above=0.0))),
            Phi=(SHAPES, unless(shapes(3, 2))),
            Fn_std=(0.1 * HERTZ, either(none, floats((2,), above=0.0))),
            sensors=(["roof", "two", "one"], either(none, labels(3))),
        ),
        alias={
            "Fn": "frequencies|Fn|result",
            "Phi": "shapes|Phi|result",
            "Fn_std": "sd|Fn_std",
        },
        words=("result", "frequencies", "shapes", "sd"),
        tied=("Fn", "Phi", "sensors"),
    ),
}
test_a_malformed_argument = properties(TARGETS)
