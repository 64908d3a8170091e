"""Judge chains: autocorrelation time, ESS, R-hat, acceptance, and one verdict."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import emcee
import numpy as np

from .. import checks
from ..interfaces import Floats
from ..posterior.log_posterior import LogPosterior
from . import inference_data

ENOUGH_TAU = 50  # steps per autocorrelation time below which tau itself is unreliable
GOOD_RHAT = 1.01  # Vehtari et al. (2021), doi:10.1214/20-BA1221
# R-hat over walkers is about sqrt(1 + 2 tau / steps), 1.02 at 50 tau. More means
# walkers that stay apart, which tau cannot see: it centres each walker on its own mean.
WALKERS_APART = 1.05


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """What :func:`diagnose` found; ``print`` it for a table and the verdict.

    Attributes:
        names: Parameter names, ``d`` of them.
        steps: Stored steps an ensemble, after burn-in.
        tau: Integrated autocorrelation time in stored steps, ``(ensembles, d)``; NaN
            where no walker moved.
        steps_per_tau: ``steps / tau`` of the worst ensemble, ``(d,)``; from 50 on, tau
            and ESS can be believed.
        ess_bulk: Effective sample size for the centre, all ensembles, ``(d,)``.
        ess_tail: Effective sample size for the 5 % and 95 % quantiles, ``(d,)``.
        acceptance: Fraction of accepted proposals, ``(ensembles, walkers)``.
        stuck: ``(ensemble, walker)`` of walkers of which a parameter never changed.
        rhat_within: R-hat over the walkers of one ensemble, the worst, ``(d,)``: a
            mixing indicator, not convergence, since walkers depend on one another;
            NaN for a single walker.
        rhat_between: R-hat with each independent ensemble as one chain, ``(d,)``: the
            test for a missed mode; NaN for a single ensemble.
        failures: Number of rejected solves by cause (``run(on_failure="reject")``).
        verdict: One sentence.
    """

    names: tuple[str, ...]
    steps: int
    tau: Floats
    steps_per_tau: Floats
    ess_bulk: Floats
    ess_tail: Floats
    acceptance: Floats
    stuck: tuple[tuple[int, int], ...]
    rhat_within: Floats
    rhat_between: Floats
    failures: Mapping[str, int]
    verdict: str

    @property
    def converged(self) -> bool:
        """Whether every check that several ensembles allow was passed."""
        return self.verdict.startswith("Converged")

    def __str__(self) -> str:
        """Return the table and the verdict."""
        width = max(9, *map(len, self.names))
        lines = [
            f"{'parameter':<{width}}    tau  steps/tau  ESS bulk  ESS tail  "
            "R-hat walkers  R-hat ensembles"
        ]
        for i, name in enumerate(self.names):
            lines.append(
                f"{name:<{width}} {self.tau[:, i].max():6.1f} "
                f"{self.steps_per_tau[i]:10.0f} {self.ess_bulk[i]:9.0f} "
                f"{self.ess_tail[i]:9.0f} {self.rhat_within[i]:14.3f} "
                f"{self.rhat_between[i]:16.3f}"
            )
        lines.append(
            f"acceptance {self.acceptance.mean():.2f} (walkers "
            f"{self.acceptance.min():.2f} to {self.acceptance.max():.2f}), "
            f"{len(self.stuck)} stuck walkers"
        )
        if self.failures:
            lines.append(f"failed solves, taken for impossible: {dict(self.failures)}")
        return "\n".join([*lines, self.verdict])


def diagnose(
    samplers: emcee.EnsembleSampler | Sequence[emcee.EnsembleSampler],
    discard: int = 0,
) -> Diagnosis:
    """Judge whether the chains can be trusted.

    tau is emcee's, an ensemble at a time. R-hat is rank-normalised and split. Numbers
    of one ensemble cannot show that it missed a mode: run several from over-dispersed
    starts. Of tempered runs the cold walkers alone are judged.

    Args:
        samplers: What :func:`run` returned, or EnsembleSamplers of one target.
        discard: Stored steps to drop as burn-in.

    Raises:
        TypeError: If discard is not a whole number.
        ValueError: If fewer than 8 steps are left.

    Source: Goodman and Weare (2010), doi:10.2140/camcos.2010.5.65 (tau); Vehtari et
    al. (2021), doi:10.1214/20-BA1221 (R-hat, ESS).
    """
    runs = inference_data.as_list(samplers)
    chain = inference_data.stacked(runs, "chain", discard)
    steps, n_ensembles, n_walkers, ndim = chain.shape
    if steps < 8:
        raise ValueError(f"discard: expected at least 8 steps to judge, left {steps}")
    moved = (chain != chain[0]).any(axis=0).all(axis=2)  # (ensembles, walkers)
    stuck = tuple((int(e), int(w)) for e, w in np.argwhere(~moved))
    tau = np.array(
        [
            autocorrelation_time(chain[:, e, moved[e]])
            if moved[e].any()
            else np.full(ndim, np.nan)
            for e in range(n_ensembles)
        ]
    )
    by_ensemble = chain.transpose(1, 2, 0, 3)  # (ensembles, walkers, steps, d)
    everything = by_ensemble.reshape(-1, steps, ndim)
    bulk, tail = inference_data.effective_sizes(everything)
    within = [np.full(ndim, np.nan)]  # one walker alone has nothing to compare with
    if n_walkers > 1:
        within = [inference_data.rhat(walkers) for walkers in by_ensemble]
    between = np.full(ndim, np.nan)
    if n_ensembles > 1:
        pooled = by_ensemble.reshape(n_ensembles, -1, ndim)  # walker after walker
        between = inference_data.rhat(pooled)
    with np.errstate(divide="ignore"):
        steps_per_tau = steps / tau.max(axis=0)
    found: dict[str, Any] = {
        "names": _names(runs[0], ndim),
        "steps": steps,
        "tau": tau,
        "steps_per_tau": steps_per_tau,
        "ess_bulk": bulk,
        "ess_tail": tail,
        "acceptance": np.array([_acceptance(run) for run in runs]),
        "stuck": stuck,
        "rhat_within": np.max(within, axis=0),
        "rhat_between": between,
        # One log of all ensembles, where run made it.
        "failures": dict(getattr(getattr(runs[0], "failures", None), "causes", {})),
    }
    return Diagnosis(**found, verdict=_verdict(found, n_ensembles))


def autocorrelation_time(chain: Floats) -> Floats:
    """Return emcee's tau of ``chain (steps, walkers, d)``, ``(d,)``, however short."""
    # tol=0 because diagnose reports steps / tau itself.
    tau: Floats = emcee.autocorr.integrated_time(chain, tol=0)
    return tau


def _acceptance(run: Any) -> Floats:
    backend = getattr(run, "backend", run)
    fraction: Floats = backend.accepted / backend.iteration
    return fraction[inference_data.cold(run)]


def _names(run: Any, ndim: int) -> tuple[str, ...]:
    function = getattr(getattr(run, "log_prob_fn", None), "f", None)
    names = getattr(function, "names", None)
    if names is not None and len(names) == ndim:
        return tuple(names)
    return tuple(f"theta{i + 1}" for i in range(ndim))


def _verdict(found: dict[str, Any], n_ensembles: int) -> str:
    names, per_tau = found["names"], found["steps_per_tau"]
    if found["stuck"]:
        return (
            f"Not converged: {len(found['stuck'])} walkers never moved "
            f"(ensemble, walker): {list(found['stuck'][:5])}."
        )
    if not (per_tau >= ENOUGH_TAU).all():
        worst = int(np.argmin(np.nan_to_num(per_tau)))
        return (
            f"Not converged: the chain is {per_tau[worst]:.0f} autocorrelation times "
            f"long for {names[worst]} ({ENOUGH_TAU} are needed); run longer."
        )
    apart = int(np.argmax(found["rhat_within"]))
    if found["rhat_within"][apart] > WALKERS_APART:
        return (
            f"Not converged: the walkers of one ensemble stay apart in {names[apart]} "
            f"(R-hat {found['rhat_within'][apart]:.3f} over walkers), as they do "
            "between several modes; try DEMCMove(mode_jump=0.1)."
        )
    if n_ensembles == 1:
        return (
            "Well mixed, but one ensemble cannot show a missed mode: "
            f"{per_tau.min():.0f} autocorrelation times, ESS at least "
            f"{found['ess_bulk'].min():.0f}; run ensembles=4 to be sure."
        )
    worst = int(np.argmax(found["rhat_between"]))
    rhat = found["rhat_between"][worst]
    if rhat > GOOD_RHAT:
        return (
            f"Not converged: the ensembles disagree about {names[worst]} (R-hat "
            f"{rhat:.3f}, at most {GOOD_RHAT} is good); run longer, or "
            "try DEMCMove(mode_jump=0.1) if there are several modes."
        )
    return (
        f"Converged by every check: {n_ensembles} ensembles agree (R-hat at most "
        f"{rhat:.3f}), {per_tau.min():.0f} autocorrelation times, ESS at least "
        f"{found['ess_bulk'].min():.0f}."
    )


def running_tae(
    idata: Any, posterior: LogPosterior, points: int = 200
) -> tuple[Floats, Floats]:
    r"""Return generations and the total average error of the mean so far, in percent.

    .. math:: TAE(i) = \frac{100}{N_m} \sum_j \frac{|f_j^m - f_j(\bar\theta_i)|}{f_j^m},
        \qquad \bar\theta_i = \frac{1}{i} \sum_{s \le i} \theta_s

    with the mean over all walkers and ensembles up to generation i, at ``points``
    generations spaced geometrically.

    Raises:
        TypeError: If posterior is no LogPosterior.
        ValueError: If no term of the posterior has measured frequencies, or it has
            other parameters.

    Source: the text below Table 4.2 of Sherri, Boulkaibet, Marwala and Friswell.
    """
    points = checks.whole_number("points", points, 2)
    measured = measured_frequencies(idata)
    names, chains = inference_data.samples(idata)
    check_sampled(posterior, names)
    by_generation = chains.mean(axis=0)  # (draws, d)
    n = len(by_generation)
    means = np.cumsum(by_generation, axis=0) / np.arange(1, n + 1)[:, None]
    where = np.unique(np.geomspace(1, n, points).round().astype(int))
    frequencies = posterior(means[where - 1])[:, posterior.columns["frequency"]]
    group = inference_data.dataset(idata, "posterior")
    steps = 1.0 + group.get("step", group["draw"]).values[where - 1]
    return steps, total_average_error(measured, frequencies)


def total_average_error(measured: Floats, frequencies: Floats) -> Floats:
    """Return the mean of ``|f_m - f| / f_m`` over the measured modes, in percent."""
    errors = np.abs(frequencies[..., : len(measured)] / measured - 1)
    result: Floats = 100 * errors.mean(axis=-1)
    return result


def check_sampled(posterior: Any, names: Sequence[str]) -> None:
    """Refuse what is not the posterior that was sampled, by its parameters.

    Raises:
        TypeError: If it is no LogPosterior.
        ValueError: If its parameters are others, or in another order.
    """
    if not isinstance(posterior, LogPosterior):
        raise TypeError(
            f"posterior: expected a LogPosterior, got {type(posterior).__name__}"
        )
    if posterior.names != tuple(names):
        raise ValueError(
            f"posterior: expected the sampled one, with the parameters {list(names)}, "
            f"got {list(posterior.names)}"
        )


def measured_frequencies(idata: Any) -> Floats:
    """Return the measured frequencies of the first term that has some, ``(m,)``."""
    try:
        observed = inference_data.dataset(idata, "observed_data")
        frequencies: Floats = next(iter(observed.data_vars.values())).values
    except (ValueError, StopIteration):  # ArviZ < 1 drops a group without variables
        raise ValueError(
            "idata: no likelihood term of this posterior has measured frequencies"
        ) from None
    return frequencies[~np.isnan(frequencies)]  # terms are padded to one length
