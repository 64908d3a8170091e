"""The posterior of a test under the population instead of its own prior."""

from typing import Any

from scipy import stats

from ..interfaces import Floats
from ..posterior.log_posterior import LogPosterior
from ..posterior.priors import GaussianPrior, IndependentPrior

WIDER = 1.2  # that weights towards the population stay even


def restate(posterior: Any, names: tuple[str, ...], drawn: Floats) -> LogPosterior:
    """Return a posterior whose prior of ``names`` is that of the draws ``(n, d)``."""
    if not isinstance(posterior, LogPosterior):
        raise TypeError(
            f"posterior: expected a LogPosterior, got {type(posterior).__name__}"
        )
    missing = [name for name in names if name not in posterior.names]
    if missing:
        raise ValueError(
            f"posterior: it has no parameter {missing}; there are {posterior.names}"
        )
    laws = _marginals(posterior.prior)
    for name, mean, sd in zip(names, drawn.mean(0), drawn.std(0), strict=True):
        laws[name] = stats.norm(mean, WIDER * sd)
    bounds = dict(zip(posterior.names, posterior.prior.bounds.tolist(), strict=True))
    prior = IndependentPrior(laws, bounds={name: tuple(bounds[name]) for name in names})
    given = {e.name: (e.model, e.terms) for e in posterior.experiments}
    if "" in given:
        return LogPosterior(*given[""], prior)
    return LogPosterior.joint(given, prior)


def _marginals(prior: Any) -> dict[str, Any]:
    if isinstance(prior, IndependentPrior):
        return dict(prior.marginals)
    if isinstance(prior, GaussianPrior):
        columns = zip(prior.names, prior.mean, prior.sd, prior.bounds, strict=True)
        return {
            name: stats.truncnorm(*((ends - mean) / sd), loc=mean, scale=sd)
            for name, mean, sd, ends in columns
        }
    raise TypeError(
        "posterior: expected a GaussianPrior or an IndependentPrior, whose marginals "
        f"are known, got {type(prior).__name__}; sample the test again under a prior "
        "of your own like the population's, and pool again"
    )
