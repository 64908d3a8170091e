"""Which lines of an FRF tell something of the parameters."""

import numpy as np

from ..interfaces import Floats
from ..likelihoods.frf import FRFTerm
from ..posterior.differences import gather_tangents
from ..posterior.experiments import Experiment
from ..posterior.log_posterior import LogPosterior


def find_frf(
    posterior: LogPosterior, experiment: str | None
) -> tuple[Experiment, FRFTerm]:
    """Return the experiment with an FRF, and the term that compares it.

    Raises:
        ValueError: If there is none of that name, or several.
    """
    found = [
        (own, term)
        for own in posterior.experiments
        for term in own.terms
        if isinstance(term, FRFTerm) and experiment in (None, own.name)
    ]
    if len(found) != 1:
        names = [own.name for own in posterior.experiments]
        raise ValueError(
            f"posterior, experiment: expected one FRFTerm, found {len(found)}; name "
            f"one of the experiments {names} with experiment="
        )
    return found[0]


def inform_lines(
    posterior: LogPosterior, experiment: Experiment, term: FRFTerm, theta: Floats
) -> Floats | None:
    r"""Return how much each line tells of the parameters, ``(n_lines,)``.

    .. math:: I_l = \mathrm{tr}(\Sigma F_l)

    with the posterior's covariance and Fisher's information of a line, all channels
    together, at the posterior mean. Over all data they sum to the number of parameters
    that the data tell and the prior does not, about.

    Args:
        posterior: The sampled posterior.
        experiment: The experiment of the FRF.
        term: Its term.
        theta: Posterior draws ``(n, d)``.

    Returns:
        None if the model has no ``jacobian``.
    """
    jacobian = getattr(experiment.model, "jacobian", None)
    if jacobian is None:
        return None
    mean = theta.mean(axis=0)[None]
    parameters = posterior.parameters(mean)
    response, derivatives = jacobian(posterior.parameters(mean.copy()))
    tangents = gather_tangents("jacobian", response, derivatives, posterior.names)
    units = np.eye(posterior.ndim)[:, None]
    tangents |= dict(zip(posterior.names, units, strict=True))
    scores = term.linearize(parameters, response, tangents)[1][0]
    covariance = np.atleast_2d(np.cov(theta.T))
    told = np.einsum("ri,ij,rj->r", scores, covariance, scores)
    channels, lines = term.measured.values.shape
    by_line = told.reshape(-1, channels, lines, 1 if term.amplitude else 2)
    result: Floats = by_line.sum(axis=(0, 1, 3))
    return result
