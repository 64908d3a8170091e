"""Whether a test holds a wrong sensor: turned round, exchanged, or of another gain."""

from dataclasses import dataclass
from itertools import chain

import numpy as np

from .. import checks
from ..posterior.log_posterior import LogPosterior
from ..posterior.priors import prior_centre
from ..posterior.sensors import SuspectSensor, suspect_sensors
from ..search.find_map import FoundMap
from ..table import Parts, Report
from .arviz_objects import dataset, samples
from .to_arviz import read_samples_and_model

SUSPECT, CLEAR, NOT_CHECKED = "suspect", "nothing suspect", "not checked"
SAID = {
    CLEAR: "No sensor seems to be turned round, exchanged with another, or of another "
    "gain: none of these explains the measured shapes better than chance does.",
    NOT_CHECKED: "Not checked: measured shapes are neither compared by a ShapeTerm nor "
    "paired by a PairedModel.",
}


@dataclass(frozen=True, eq=False, repr=False)
class SensorCheck(Report):
    """The result of :func:`.check_test`; ``print`` it.

    Attributes:
        status: "suspect", "nothing suspect", or "not checked" without measured shapes.
        suspects: What explains the measured shapes much better than the test as it is,
            the best first (:class:`.SuspectSensor`). Several of one experiment exclude
            each other, and the shapes cannot tell which it is.
        solves: Model solves spent.
    """

    status: str
    suspects: tuple[SuspectSensor, ...]
    solves: int

    def _parts(self) -> Parts:
        if not self.suspects:
            yield SAID[self.status]
        yield from map(str, self.suspects)


def check_test(source: object, posterior: LogPosterior | None = None) -> SensorCheck:
    """Look for a sensor that is turned round, exchanged, or of another gain.

    Use it before sampling, and again with what was found: :func:`run` asks it at the
    prior mean, and warns. Each single sensor is turned, each pair exchanged, and each
    single gain fitted; modes are paired anew each time. What raises the MACs of the
    paired modes by far more than chance does is named. The shapes tell nothing where
    an exchange changes nothing, as in a symmetric structure; of two sensors turning one
    equals turning the other, and both are named.

    By chance means: if the errors of unit shapes, of noise and model together, are near
    3 % at a sensor, the odds that one sensor is wrong must be above one, when one test
    in twenty has such a sensor. The errors stated in a :class:`ShapeTerm` are not
    used. Two wrong sensors at once are named only if putting one right helps by itself.
    A sensor at another place, or along another axis, than the test says is not looked
    for, unless another sensor is there: then the two seem to be exchanged. If shapes do
    not fit and no sensor is suspect, look at the places and directions yourself.

    Args:
        source: The posterior, tried at its prior mean; the result of :func:`find_map`,
            tried at its maxima too; or the result of :func:`run`, or an ArviZ object,
            tried at the best sample too. One solve each, and 16 more at draws of the
            prior if a sensor is suspect.
        posterior: The sampled posterior if source is an ArviZ object.

    Returns:
        A record of the suspects; ``print`` it.

    Raises:
        TypeError: If source is none of these, or the posterior is missing.

    Source: Allemang (2003), The modal assurance criterion: twenty years of use and
    abuse, Sound and Vibration 37(8).

    Examples:
        >>> import numpy as np
        >>> import emcee_femu as ef
        >>> springs = {"a": (0, 1, 10.0), "b": (1, 2, 10.0), "c": (2, 3, 10.0)}
        >>> model = ef.MassSpringModel([1.0, 1.0, 1.0], springs, shapes=True)
        >>> shapes = [[0.33, 0.74], [-0.60, -0.33], [0.74, -0.60]]  # the second points
        >>> test = ef.Measurements([0.22, 0.63], shapes)  # the other way
        >>> term = ef.FrequencyTerm(test, relative_sd=0.01)
        >>> prior = ef.IndependentPrior({name: (5.0, 20.0) for name in springs})
        >>> paired = ef.PairedModel(model, test, candidates=3)
        >>> (suspect,) = ef.check_test(ef.LogPosterior(paired, term, prior)).suspects
        >>> suspect.kind, suspect.sensors
        ('turned', ('s2',))
    """
    points: list[np.ndarray] = []
    if isinstance(source, FoundMap):
        posterior, points = source.posterior, [m.theta for m in source.maxima]
    elif isinstance(source, LogPosterior):
        posterior = source
    else:
        idata, posterior = read_samples_and_model(source, posterior)
        draws = samples(idata)[1].reshape(-1, len(samples(idata)[0]))
        height = dataset(idata, "sample_stats")["lp"].transpose("chain", "draw")
        points = [draws[int(np.argmax(height.values))]]
    posterior = checks.instance("posterior", posterior, LogPosterior)
    theta = np.array([prior_centre(posterior.prior), *points])
    found, solves = suspect_sensors(posterior, theta)
    suspects = tuple(chain.from_iterable(found))
    status = SUSPECT if suspects else CLEAR if found else NOT_CHECKED
    return SensorCheck(status, suspects, solves)
