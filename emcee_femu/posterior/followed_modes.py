"""Which modes of the structure are which, at points far from the prior mean."""

import numpy as np

from ..contracts import Floats, read_declared
from ..models.paired import PairedModel
from .log_posterior import LogPosterior
from .priors import prior_centre

# MAC from which a mode is the same one: of two modes that turned into each other both
# have less.
FOLLOWED_MAC = 0.8


def follow_modes(posterior: LogPosterior, theta: Floats) -> dict[str, Floats]:
    """Return which modes the model has at points, in their order at the prior mean.

    Modes are followed by the model's own shapes, where it has shapes and its modes are
    compared in ascending order. If two of them change places, so do the frequencies
    that they are compared with. It takes a solve at each point, and two at the prior
    mean.

    Args:
        posterior: What was searched.
        theta: Points ``(g, d)``.

    Returns:
        The numbers of the modes ``(g, p)``, 1 = the lowest, by experiment; 0 for a mode
        that no longer has its shape, or is so close to another at the prior mean that
        they have no order. Empty where nothing is known.
    """
    centre = prior_centre(posterior.prior)
    reference = dict(zip(posterior.names, centre.tolist(), strict=True))
    followed = {}
    for experiment in posterior.experiments:
        offered = read_declared(experiment.model, "variables") or {}
        read = [variables for term in experiment.terms if (variables := term.reads)]
        sizes = [v["frequency"].size for v in read if "frequency" in v]
        if "shapes" not in offered or "model_mode" in offered or not sizes:
            continue
        try:
            at_mean = PairedModel(
                experiment.model,
                1.0 + np.arange(max(sizes)),  # any: modes are paired by shapes alone
                reference=reference,
                candidates=offered["frequency"].size,
                min_mac=FOLLOWED_MAC,
            )
            found = at_mean(posterior.parameters(np.vstack([centre, theta])))
        except Exception:  # of any kind: it is the user's model that raised
            continue
        frequencies = found.frequencies[0]
        close = np.diff(frequencies) < at_mean.min_gap * frequencies[1:]
        unclear = np.append(close, False) | np.append(False, close)
        numbers = np.where(found.unpaired | unclear, 0, found.model_mode)
        followed[experiment.name] = numbers[1:]
    return followed
