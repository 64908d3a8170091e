"""Whether measured shapes agree much better with a model if one sensor had been wrong.

A sensor that is turned round, exchanged with another, or of another gain is looked for
by the model's shapes, changed as that sensor would show them, and paired anew.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, groupby
from typing import TypeAlias

import numpy as np

from ..contracts import Floats, read_declared
from ..likelihoods.shape import ShapeTerm
from ..measurements import Measurements
from ..models.paired import PairedModel
from .experiments import Experiment
from .log_posterior import LogPosterior

TURNED, EXCHANGED, GAIN = "turned", "exchanged", "gain"
FAULTY = 0.01  # prior probability that a test has a wrong sensor
# What shapes of unit length usually miss at a sensor, by noise and by the model. It
# counts like so many data: few sensors, or a lucky small misfit, then decide nothing.
USUAL_ERROR = 0.03
USUAL_WEIGHT = 4.0
SHOWN = 3  # of the alternatives in a warning
DRAWS_ASKED = 16  # of the prior: other parameters may explain what seems a wrong sensor
Alternative: TypeAlias = tuple[str, tuple[int, ...]]  # its kind, and the sensors


@dataclass(frozen=True)
class SuspectSensor:
    """One way to explain measured shapes by a wrong sensor.

    Attributes:
        experiment: The experiment of a joint posterior; empty for a single one.
        kind: "turned", "exchanged" or "gain".
        sensors: Their DOFs if these have labels, else their names; two if exchanged.
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
        names, of = " and ".join(self.sensors), f"{self.experiment}: "
        what, done = {
            TURNED: (f"sensor {names} seems to point the other way", TURNED),
            EXCHANGED: (f"sensors {names} seem to be exchanged", "exchanged back"),
            GAIN: (
                f"sensor {names} seems to read {self.gain:.3g} times too much",
                "corrected",
            ),
        }[self.kind]
        macs = f"mean MAC {self.before:.3g}, {done} {self.after:.3g}"
        return f"{of * bool(self.experiment)}{what} ({macs})"


def suspect_sensors(
    posterior: LogPosterior, theta: Floats
) -> tuple[list[SuspectSensor], list[str], int]:
    """Look for a wrong sensor wherever shapes were measured, from one solve per point.

    Only where one is suspected, the model is also solved at draws of the prior: other
    parameters may explain the shapes as well.

    Args:
        posterior: The posterior.
        theta: Points ``(n, d)``. The test as it is is judged where it agrees best with
            the model, and so is each that a sensor put right would give.

    Returns:
        By experiment, what explains the shapes best, and what does so as well; the
        names of experiments with shapes; how many parameter sets were solved.
    """
    suspects: list[SuspectSensor] = []
    names, solves = [], 0
    for experiment in posterior.experiments:
        if (paired := pair_measured(experiment)) is None:
            continue
        names.append(experiment.name)
        tried = _try_sensors(paired, posterior, theta)
        solves = max(solves, len(theta))
        if found := weigh_sensors(paired, tried, experiment.name):
            draws = posterior.prior.sample(np.random.default_rng(0), DRAWS_ASKED)
            solves = len(theta) + DRAWS_ASKED
            try:
                more = _try_sensors(paired, posterior, draws)
            except Exception:  # of any kind: it is the user's model that raised
                more = tried
            both = map(np.concatenate, zip(tried, more, strict=True))
            found = weigh_sensors(paired, tuple(both), experiment.name)
        suspects += found
    return suspects, names, solves


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
    used = np.flatnonzero(np.isfinite(paired.compared).any(axis=1)).tolist()
    singles = [(sensor,) for sensor in used]
    pairs = [(EXCHANGED, pair) for pair in combinations(used, 2)]
    return [*((TURNED, i) for i in singles), *pairs, *((GAIN, i) for i in singles)]


def _try_sensors(
    paired: PairedModel, posterior: LogPosterior, theta: Floats
) -> tuple[Floats, Floats, Floats]:
    r"""Return gains ``(n, a)`` of alternatives, and MACs ``(n, 1 + a, n_modes)``.

    The first MACs are those of the test as it is. Behind them stands the number of
    sensors that move in each of its modes by the model, ``(n, n_modes)``,
    :math:`(\sum_s \phi_s^2)^2 / \sum_s \phi_s^4`.
    """
    frequencies, shapes = paired.read_candidates(
        paired.model(posterior.parameters(theta))
    )
    solved = paired.match(frequencies, shapes)
    gains, macs = [], [solved.mac]
    for kind, sensors in list_alternatives(paired):
        altered = shapes.copy()
        altered[:, [*sensors]] = shapes[:, [*sensors[::-1]]]
        gain = np.full(len(theta), -1.0 if kind == TURNED else 1.0)
        if kind == GAIN:
            gain = _fit_gain(paired, frequencies, shapes, sensors[0])
        altered[:, sensors[0]] *= gain[:, None]
        gains.append(gain)
        macs.append(paired.match(frequencies, altered).mac)
    squares = np.where(np.isfinite(paired.compared), solved.shapes, 0.0) ** 2
    size = np.maximum((squares**2).sum(axis=1), np.finfo(float).tiny)
    moving = squares.sum(axis=1) ** 2 / size
    return np.stack(gains, axis=1), np.stack(macs, axis=1), moving


def _fit_gain(
    paired: PairedModel, frequencies: Floats, shapes: Floats, sensor: int
) -> Floats:
    """Return what a sensor reads by what the model and all others say, ``(n,)``."""
    there = np.isfinite(paired.compared)
    others, measured = there.copy(), np.nan_to_num(paired.compared)
    others[sensor] = False
    without = shapes * (np.arange(len(there)) != sensor)[:, None]
    chosen = paired.match(frequencies, without).model_mode - 1
    model = np.take_along_axis(shapes, chosen[:, None], axis=2)
    size = (model**2).sum(axis=1, where=others)
    scale = (measured * model).sum(axis=1, where=others)
    expected = there[sensor] * model[:, sensor] * scale
    expected = np.divide(expected, size, out=np.zeros_like(size), where=size > 0)
    size = (expected**2).sum(axis=1)
    gain = np.divide(expected @ measured[sensor], size, out=size + 1.0, where=size > 0)
    return np.asarray(gain)


def weigh_sensors(
    paired: PairedModel, tried: tuple[Floats, ...], experiment: str
) -> list[SuspectSensor]:
    r"""Return what explains measured shapes best, if by more than chance.

    .. math:: \ln B = \frac{\nu + \nu_0}{2} \ln \frac{\nu_0 \delta^2
        + \sum_i (1 - MAC_i)}{\nu_0 \delta^2 + \sum_i (1 - MAC_i')}

    is the log Bayes factor of an alternative, if the errors of unit shapes are
    Gaussian, with a variance known to be near :math:`\delta^2` as from :math:`\nu_0`
    data. The alternatives share a prior probability of .01. A shape counts as one datum
    less than sensors that move in it. Alternatives whose odds to the best are above 1
    to 100 are returned with it.

    Args:
        paired: What pairs them.
        tried: Gains, MACs and moving sensors, as of :func:`_try_sensors`.
        experiment: The name of the experiment.
    """
    gains, macs, moving = tried
    best = macs.mean(axis=2).argmax(axis=0)  # of the points, for each alternative
    before, after = np.split(macs[best, np.arange(len(best))], [1])
    told = np.maximum(before, after) >= paired.min_mac  # others resemble nothing
    known = USUAL_WEIGHT * USUAL_ERROR**2
    lost, left = (known + (told * (1 - each)).sum(axis=1) for each in (before, after))
    data = told @ np.maximum(moving[best[0]] - 1, 0) + USUAL_WEIGHT
    log_factors = 0.5 * data * np.log(lost / left)
    most = log_factors.max(initial=0.0)
    if most <= np.log(max(len(after), 1) / FAULTY):
        return []
    order = np.argsort(-log_factors)
    close = order[log_factors[order] > most + np.log(FAULTY)].tolist()
    every = list_alternatives(paired)
    turned = {every[i][1] for i in close if every[i][0] == TURNED}
    return [
        SuspectSensor(
            experiment,
            kind,
            tuple(_name(paired.measurements, sensor) for sensor in sensors),
            float(gains[best[1 + i], i]),
            float(before.mean()),
            float(after[i].mean()),
        )
        for i, (kind, sensors) in ((i, every[i]) for i in close)
        if kind != GAIN or sensors not in turned  # by -1: that is no other gain
    ]


def in_words(suspects: Sequence[SuspectSensor]) -> list[str]:
    """Return a sentence for each experiment, with what its shapes cannot tell apart."""
    return [
        "; or ".join(map(str, list(alike)[:SHOWN])) + "; see check_test(posterior)"
        for _, alike in groupby(suspects, key=lambda suspect: suspect.experiment)
    ]


def _name(test: Measurements, sensor: int) -> str:
    dof = None if test.dofs is None else test.dofs.tolist()[sensor]
    return dof if isinstance(dof, str) else test.sensors[sensor]
