"""Residuals of a likelihood term, and the record of what they say of the data.

Here are the plain records alone: terms return the first, and ``results/fit.py`` makes
the second from samples.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..contracts import Floats

# What a record says of its data.
FITS, MISFIT, NOT_JUDGED = "fits", "does not fit", "not judged"
RESEMBLES_NONE = "resembles none"  # a measured mode, of all the model's modes
ELSEWHERE = "elsewhere"  # a measured mode, whose shape is one of another frequency
SKIPPED = "not measured"  # a mode of the model, between two that were measured
SUSPECT = "suspect"  # a sensor which, put right, explains the measured shapes
NONE_SUSPECT = "none suspect"  # of the sensors: none explains them, put right
TERM, EXPERIMENT, MODE, SENSOR = "term", "experiment", "mode", "sensor"


class Residuals(NamedTuple):
    """Residuals of a term over their standard deviations, at n parameter sets.

    Attributes:
        independent: Independent residuals, ``(n, m)``.
        by_datum: The residual of each datum ``(n, k)``, which may be correlated with
            others; the same array where they are not.
        inferred: Whether their standard deviations are inferred.
        places: ``{dimension: label of each datum (k,)}``; empty where unknown.
        shapes: Where the data are mode shapes; else None.
    """

    independent: Floats
    by_datum: Floats
    inferred: bool
    places: Mapping[str, NDArray[Any]]
    shapes: "ComparedShapes | None" = None


class ComparedShapes(NamedTuple):
    """Measured shapes and the model's, sensor by sensor, of unit length.

    The model's are scaled to fit best, which takes a degree of freedom of each mode.
    Both are divided by the standard deviations of the sensors, if these differ.

    Attributes:
        measured: The measured shapes, ``(k,)``, mode and sensor as in ``places``.
        fitted: The model's, ``(n, k)``.
        mac: The MAC of each mode, ``(n, n_modes)``.
    """

    measured: Floats
    fitted: Floats
    mac: Floats


@dataclass(frozen=True)
class FitRecord:
    """What the samples say of some of the data: chi^2 and its chance.

    Attributes:
        status: "fits", "does not fit", "not judged", "resembles none" (a measured mode
            that resembles no mode of the model), "elsewhere" (one with the shape of a
            mode of quite another frequency), "not measured" (a mode of the model
            between two that were measured), "suspect" (sensors which, put right,
            explain the measured shapes: see :func:`.check_test`), or "none suspect" (of
            all sensors of an experiment).
        experiment: Name of the experiment; empty for a single one.
        term: Name of the term; empty for all terms of an experiment.
        kind: What is judged: "term", "experiment", or a group of a term's data:
            "mode", "sensor", "channel", "point", and so on.
        label: Which of these; two suspect sensors are joined by "and".
        chi2: Sum of squared residuals over their variances, mean over the samples.
        size: What a right model gives on average: the number of data, less one for each
            fitted scale of a shape.
        low: Lower end of the 95 % range that a right model gives.
        high: Upper end of this range.
        p: Probability that a right model gives more, for the most extreme of all groups
            that were looked at (Bonferroni).
        share: Its share of the term's chi^2, at the samples or at the prior mean,
            whichever is less likely; NaN for a whole term.
        p_share: Probability that a right model gives it a larger share, for any size of
            the errors; NaN for a whole term. The group with the least one is where the
            data are off.
        mac: MAC of a mode's shape, mean over the samples; of a suspect sensor, the mean
            MAC with it put right; NaN elsewhere.
        mac_expected: The MAC that the errors make likely.
        mac_before: Its MAC at the prior mean; of a suspect, the mean MAC as it is.
        error: Name of the parameter that is its inferred error; empty without.
        variable: Name of the measured variable; empty where the term names none.
        paired: Whether the modes were paired by shape.
        reason: Why nothing was judged, what a sensor is suspected of, or what a mode is
            like in place of its own.
    """

    status: str
    experiment: str
    term: str
    kind: str
    label: str = ""
    chi2: float = np.nan
    size: float = np.nan
    low: float = np.nan
    high: float = np.nan
    p: float = np.nan
    share: float = np.nan
    p_share: float = np.nan
    mac: float = np.nan
    mac_expected: float = np.nan
    mac_before: float = np.nan
    error: str = ""
    variable: str = ""
    paired: bool = False
    reason: str = ""
