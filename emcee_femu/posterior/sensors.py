"""Whether measured shapes agree much better with a model if one sensor had been wrong.

A sensor that is turned round, exchanged with another, or of another gain is looked for
by the model's shapes, changed as that sensor would show them, and paired anew.
"""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import combinations
from typing import TypeAlias

import numpy as np

from ..contracts import Floats, read_declared
from ..likelihoods.shape import ShapeTerm
from ..measurements import Measurements
from ..models.paired import PairedModel
from .experiments import Experiment
from .log_posterior import LogPosterior

TURNED, EXCHANGED, GAIN, DEAD = "turned", "exchanged", "gain", "dead"
WORDS = {
    TURNED: "sensor {} seems to point the other way",
    EXCHANGED: "sensors {} seem to be exchanged",
    GAIN: "sensor {} seems to read {:.3g} times what it should",
    DEAD: "sensor {} seems to be dead: it reads next to nothing in all modes",
}
DEAD_GAIN = 1e-9  # below which no unit explains what a sensor reads
FAULTY = 0.05  # prior probability that a test has a wrong sensor
# What shapes of unit length usually miss at a sensor, by noise and by the model. It
# counts like so many data: few sensors, or a lucky small misfit, then decide nothing.
USUAL_ERROR = 0.03
USUAL_WEIGHT = 4.0
DRAWS_ASKED = 16  # of the prior: other parameters may explain what seems a wrong sensor
TINY = np.finfo(float).tiny  # for 0 / 0
Alternative: TypeAlias = tuple[str, tuple[int, ...]]  # its kind, and the sensors
Tried: TypeAlias = tuple[Floats, Floats, Floats]


@dataclass(frozen=True)
class SuspectSensor:
    """One way to explain measured shapes by a wrong sensor; ``print`` it.

    Attributes:
        experiment: The experiment of a joint posterior; empty for a single one.
        kind: "turned", "exchanged", "gain" or "dead".
        sensors: Their names; two if exchanged.
        gain: What the sensor reads divided by what it should; -1 if turned.
        before: Mean MAC of the measured modes as they are.
        after: Mean MAC with this put right.
    """

    experiment: str
    kind: str
    sensors: tuple[str, ...]
    gain: float
    before: float
    after: float

    def __str__(self) -> str:
        """Return what seems to be wrong, in words."""
        what = WORDS[self.kind].format(" and ".join(self.sensors), self.gain)
        where = f"{self.experiment}: " if self.experiment else ""
        return f"{where}{what} (mean MAC {self.before:.3g}, put right {self.after:.3g})"


def suspect_sensors(
    posterior: LogPosterior, theta: Floats
) -> tuple[list[list[SuspectSensor]], int]:
    """Look for a wrong sensor wherever shapes were measured, from one solve per point.

    Only where one is suspected, the model is also solved at draws of the prior: other
    parameters may explain the shapes as well.

    Args:
        posterior: The posterior.
        theta: Points ``(n, d)``. The test as it is is judged where it agrees best with
            the model, and so is each that a sensor put right would give.

    Returns:
        For each experiment with shapes, what explains them best, and what does so as
        well; and how many parameter sets were solved.
    """
    suspects, solves = [], 0
    for experiment in posterior.experiments:
        if (paired := pair_measured(experiment)) is not None:
            tried = [_try_sensors(paired, posterior, theta)]
            found = weigh_sensors(paired, tried, experiment.name)
            solves = max(solves, len(theta))
            if found:
                draws = posterior.prior.sample(np.random.default_rng(0), DRAWS_ASKED)
                with suppress(Exception):  # of any kind: the user's model raised
                    tried.append(_try_sensors(paired, posterior, draws))
                found = weigh_sensors(paired, tried, experiment.name)
                solves = len(theta) + DRAWS_ASKED
            suspects.append(found)
    return suspects, solves


def pair_measured(experiment: Experiment) -> PairedModel | None:
    """Return what pairs measured shapes with a model's; None if none were measured."""
    offered = read_declared(experiment.model, "variables") or {}
    if experiment.paired is not None:
        return experiment.paired if experiment.paired.reference is None else None
    for term in experiment.terms:  # a stand-in of what pairs knows no other modes
        if isinstance(term, ShapeTerm) and "model_mode" not in offered:
            shapes = np.where(term.there, term.measured, np.nan)
            numbers = np.arange(1.0, 1.0 + term.n_modes)  # any: shapes alone pair
            test = Measurements(numbers, shapes, dofs=term.dofs)
            count = offered["frequency"].size if "frequency" in offered else None
            return PairedModel(experiment.model, test, candidates=count or term.n_modes)
    return None


def list_alternatives(paired: PairedModel) -> list[Alternative]:
    """Return each single sensor turned, each pair exchanged, each single gain."""
    there = np.isfinite(paired.measurements.compared)
    used = np.flatnonzero(there.any(axis=1)).tolist()
    singles = [(kind, (sensor,)) for kind in (TURNED, GAIN) for sensor in used]
    return [*singles, *((EXCHANGED, pair) for pair in combinations(used, 2))]


def _try_sensors(paired: PairedModel, posterior: LogPosterior, theta: Floats) -> Tried:
    r"""Return gains ``(n, a)`` of alternatives, and MACs ``(n, 1 + a, n_modes)``.

    The first MACs are those of the test as it is. Behind them stands the number of
    sensors that move in each of its modes by the model, ``(n, n_modes)``,
    :math:`(\sum_s \phi_s^2)^2 / \sum_s \phi_s^4`.
    """
    solved = paired.model(posterior.parameters(theta))
    frequencies, shapes = paired.read_candidates(solved)
    compared = paired.measurements.compared
    there, measured = np.isfinite(compared), np.nan_to_num(compared)
    pairs = paired.match(frequencies, shapes)
    gains, macs = [], [pairs.mac]
    for kind, sensors in list_alternatives(paired):
        gain = np.full(len(theta), -1.0 if kind == TURNED else 1.0)
        if kind == GAIN:  # what the other sensors and the model make of this one
            others = (np.arange(len(there)) != sensors[0])[:, None]
            number = paired.match(frequencies, shapes * others).model_mode - 1
            model = np.take_along_axis(shapes, number[:, None], axis=2) * there
            size = ((model * others) ** 2).sum(axis=1)
            scale = (measured * model * others).sum(axis=1) / (size + TINY)
            expected = model[:, sensors[0]] * scale
            gain = expected @ measured[sensors[0]] + TINY
            gain /= (expected**2).sum(axis=1) + TINY
        altered = shapes.copy()
        altered[:, [*sensors]] = shapes[:, [*sensors[::-1]]]
        altered[:, sensors[0]] *= gain[:, None]
        gains.append(gain)
        macs.append(paired.match(frequencies, altered).mac)
    squares = (pairs.shapes * there) ** 2
    moving = squares.sum(axis=1) ** 2 / ((squares**2).sum(axis=1) + TINY)
    return np.stack(gains, axis=1), np.stack(macs, axis=1), moving


def weigh_sensors(
    paired: PairedModel, tried: Sequence[Tried], experiment: str
) -> list[SuspectSensor]:
    r"""Return what explains measured shapes best, if by more than chance.

    .. math:: \ln B = \frac{\nu + \nu_0}{2} \ln \frac{\nu_0 \delta^2
        + \sum_i (1 - MAC_i)}{\nu_0 \delta^2 + \sum_i (1 - MAC_i')}

    is the log Bayes factor of an alternative, if the errors of unit shapes are
    Gaussian, with a variance known to be near :math:`\delta^2` as from :math:`\nu_0`
    data. The alternatives share a prior probability of .05. A shape counts as one datum
    less than sensors that move in it. Alternatives whose odds to the best are above 1
    to 20 are returned with it.

    Args:
        paired: What pairs them.
        tried: Gains, MACs and moving sensors, as of :func:`_try_sensors`.
        experiment: The name of the experiment.
    """
    gains, macs, moving = map(np.concatenate, zip(*tried, strict=True))
    best = macs.mean(axis=2).argmax(axis=0)  # of the points, for each alternative
    before, after = np.split(macs[best, np.arange(len(best))], [1])
    told = np.maximum(before, after) >= paired.min_mac  # others resemble nothing
    known = USUAL_WEIGHT * USUAL_ERROR**2
    lost, left = (known + (told * (1 - each)).sum(axis=1) for each in (before, after))
    data = told @ np.maximum(moving[best[0]] - 1, 0) + USUAL_WEIGHT
    log_factors = 0.5 * data * np.log(lost / left)
    most, every = log_factors.max(), list_alternatives(paired)
    if most <= np.log(len(every) / FAULTY):
        return []
    close = np.flatnonzero(log_factors > most + np.log(FAULTY))
    turned = [every[i][1] for i in close if every[i][0] == TURNED]
    labels = paired.measurements.sensors
    return [
        SuspectSensor(
            experiment,
            DEAD if kind == GAIN and abs(gain) < DEAD_GAIN else kind,
            tuple(labels[sensor] for sensor in sensors),
            gain,
            float(before.mean()),
            float(after[i].mean()),
        )
        for i in close[np.argsort(-log_factors[close])]
        for (kind, sensors), gain in [(every[i], float(gains[best[1 + i], i]))]
        if kind != GAIN or sensors not in turned  # that is the gain of -1
    ]
