"""The maxima of a posterior, before any sampling: a start, and a quick look."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import special

from .. import checks
from ..contracts import Floats
from ..evaluation.resume import open_evaluator
from ..evaluation.starts import MOST_START_DRAWS, check_first_solve
from ..moves.mixture import GAUSSIAN, Mixture
from ..posterior.derivatives import DIGITS, is_printed
from ..posterior.log_posterior import LOG_POSTERIOR, LogPosterior
from ..posterior.priors import inside, prior_centre, summarize_prior
from ..table import Column, Parts, Report, Table, number_columns
from .climbing import Maximum, climb, distinct
from .importance import FAIR_SHARE, FEWEST_WEIGHTS, GOOD_K, kish_share, pareto_k
from .maxima import HITS
from .quadratic import moments_inside

# Most maxima in the tables.
SHOWN_MAXIMA = 4


@dataclass(frozen=True, eq=False, repr=False)
class FoundMap(Report):
    """The result of :func:`.find_map`; ``print`` it for tables and findings.

    Attributes:
        posterior: The posterior.
        maxima: Its distinct maxima (:class:`.Maximum`), the one with the largest weight
            first: ``theta``, ``covariance``, ``log_evidence``, ``at_bound``, ...
        weights: Their shares of the posterior by Laplace's approximation, ``(k,)``.
        climbs: Number of climbs that ended at each, ``(k,)``.
        lost: Why other starts failed, one sentence each.
        solves: Number of model solves, including the check.
        draws: Number of draws in the check, 0 without one.
        pareto_k: Pareto k of their importance weights; NaN without a check.
        efficiency: Effective share of the weights (Kish); NaN without a check.
        printed: Whether the solver returns numbers with few digits, as if printed.
        from_prior: How many climbs began at draws of the prior.
    """

    posterior: LogPosterior
    maxima: tuple[Maximum, ...]
    weights: Floats
    climbs: NDArray[np.int_]
    lost: tuple[str, ...]
    solves: int
    draws: int = 0
    pareto_k: float = np.nan
    efficiency: float = np.nan
    printed: bool = False
    from_prior: int = 0

    def draw(self, n: int, seed: int) -> Floats:
        """Return draws ``(n, d)`` of the Gaussians, by weight, inside the bounds.

        Use them to start a chain: ``run(..., starts=found.draw(nwalkers, seed))``. They
        are not draws of the posterior; if it is wider than the Gaussians, allow a
        longer burn-in.

        Args:
            n: Number of draws.
            seed: A whole number.

        Returns:
            The draws, ``(n, d)``.

        Raises:
            TypeError: If an argument is not a whole number.
            ValueError: If n is below 1, or hardly any draw is inside the bounds.

        Examples:
            >>> import emcee_femu as ef
            >>> posterior = ef.paper.mass_spring().posterior
            >>> found = ef.find_map(posterior, 4, seed=1, check=0)
            >>> starts = found.draw(20, seed=1)
            >>> (sampler,) = ef.run(posterior, steps=20, seed=1, starts=starts,
            ...                       moves=ef.DEMCMove(), ensembles=1)
            >>> starts.shape
            (20, 5)
        """
        n = checks.whole_number("n", n, 1)
        rng = np.random.default_rng(checks.whole_number("seed", seed))
        bounds = self.posterior.prior.bounds
        draws, _ = _draw_inside(self.maxima, self.weights, bounds, n, rng)
        if len(draws) < n:
            raise ValueError(
                f"n: of {MOST_START_DRAWS * n} draws of the gaussians only "
                f"{len(draws)} are inside the bounds, fewer than {n}; start from the "
                "prior"
            )
        return draws

    @property
    def table(self) -> Table:
        """The prior, then maxima and sds inside the bounds, one row per parameter."""
        sd = summarize_prior(self.posterior.prior)[1]
        bounds = self.posterior.prior.bounds.T
        shown = [
            ("prior mean", prior_centre(self.posterior.prior), sd),
            ("prior sd", sd, sd),
        ]
        for number, maximum in enumerate(self.maxima[:SHOWN_MAXIMA], 1):
            about = np.sqrt(np.diag(moments_inside(*maximum.gaussian, *bounds)[1]))
            shown.append((f"maximum {number}", maximum.theta, about))
            shown.append((f"sd {number}", about, about))
        names = list(self.posterior.names)
        units = (self.posterior.units.get(name, "") for name in names)
        unit, numbers = number_columns(units, shown)
        columns: list[Column] = [("parameter", "", names), *unit, *numbers]
        return Table.from_columns("Maxima of the posterior", columns)

    @property
    def maxima_table(self) -> Table:
        """Weight, height, evidence and number of climbs, one row per maximum."""
        shown = self.maxima[:SHOWN_MAXIMA]
        names = np.array(self.posterior.names)
        at_bound = [" ".join(names[maximum.at_bound]) for maximum in shown]
        columns: list[Column] = [
            ("maximum", "d", [*range(1, len(shown) + 1)]),
            ("weight", ".3f", self.weights[:SHOWN_MAXIMA]),
            ("log-posterior", ".2f", [maximum.log_posterior for maximum in shown]),
            ("log evidence", ".2f", [maximum.log_evidence for maximum in shown]),
            ("climbs", "d", self.climbs[:SHOWN_MAXIMA]),
            ("at a bound", "", at_bound),
            ("converged", "", ["yes" if m.converged else "no" for m in shown]),
        ]
        return Table.from_columns("Gaussians about them (Laplace)", columns)

    @property
    def findings(self) -> tuple[str, ...]:
        """What to make of the result, in sentences."""
        k, n = len(self.maxima), int(self.climbs.sum()) + len(self.lost)
        sentences = [
            f"A start and a quick look: {k} maxim{'a' if k > 1 else 'um'} from {n} "
            f"climb{'s' if n > 1 else ''} and {self.solves} solves."
        ]
        few = self.from_prior // HITS
        sentences.append(
            f"A maximum at which fewer than one climb in {few} ends may be missing."
            if few > 1
            else "Others may be missing: so few starts of the prior do not tell."
        )
        if k > SHOWN_MAXIMA:
            sentences.append(f"{k - SHOWN_MAXIMA} of smaller weight are not shown.")
        for reason, count in Counter(self.lost).items():
            sentences.append(f"{count} of {n} starts failed: {reason}.")
        stopped = [maximum.message for maximum in self.maxima if not maximum.converged]
        for reason, count in Counter(stopped).items():
            sentences.append(f"{count} of {k} may not be maxima: {reason}.")
        if self.printed:
            sentences.append(
                f"The solver gives {DIGITS} digits or less: neighbouring maxima may be "
                "rounding, and standard deviations are inaccurate. Let it give more."
            )
        return (*sentences, self._judge())

    def _judge(self) -> str:
        if np.isnan(self.pareto_k):
            return (
                "Whether the posterior is Gaussian about them was not checked: "
                "check=100 tests it with 100 solves. Standard deviations and weights "
                "assume Gaussians; sample the posterior before you report them."
            )
        statistics = (
            f"Pareto k {self.pareto_k:.2f}, {100 * self.efficiency:.0f} % effective, "
            f"of {self.draws} draws"
        )
        if self.draws < FEWEST_WEIGHTS:
            statistics = "less than 1 % of their draws are inside the bounds"
        if not (self.pareto_k < GOOD_K and self.efficiency > FAIR_SHARE):
            return (
                f"The posterior is not Gaussian about them ({statistics}): take "
                "neither standard deviations nor weights from here; sample it."
            )
        return f"The posterior is nearly Gaussian about them ({statistics})."

    def _parts(self) -> Parts:
        return self.table, self.maxima_table, *self.findings


def find_map(
    posterior: LogPosterior,
    starts: int | ArrayLike = 16,
    *,
    seed: int,
    check: int = 0,
    workers: int | None = None,
    pool: object = None,
    on_failure: str = "raise",
    max_failures: float = 0.2,
) -> FoundMap:
    r"""Find the maxima of the posterior, and fit a Gaussian at each.

    Use it for a quick look, to see whether model and test fit together, or for starts
    of a chain. From each start it climbs inside the bounds, with Gauss-Newton steps if
    all terms are Gaussian. A climb takes about 4 solves if the models have a
    ``jacobian``, otherwise ``d + 1`` solves per step. The weight of a maximum is its
    share of the evidence by Laplace's approximation,

    .. math:: Z_k = p(D | \theta_k) p(\theta_k) (2\pi)^{d/2} |\Sigma_k|^{1/2}
        P_k(\mathrm{inside\ the\ bounds})

    The result is not the posterior: a maximum to which no start leads is missing, and
    the standard deviations are wrong where the posterior is not Gaussian. The same seed
    gives the same result.

    Args:
        posterior: The posterior to climb.
        starts: Number of draws from the prior to start from, or the starts themselves,
            ``(n, d)`` or ``(d,)``.
        seed: A whole number.
        check: Number of draws from the Gaussians, at least 25, whose importance weights
            show whether the posterior is close to them. Each costs one solve; 0 for no
            check.
        workers: Number of worker processes; see :func:`run`.
        pool: A pool to evaluate in, instead of workers; see :func:`run`.
        on_failure: "raise" to stop at the first failed solve and name its parameters;
            "reject" to log it, and give up the start or shorten the step.
        max_failures: Fraction of the evaluations, of at least 100, above which "reject"
            stops the search.

    Returns:
        The maxima, their Gaussians and weights; ``print`` it.

    Raises:
        TypeError: If posterior is not a LogPosterior, or a count is not a whole
            number.
        ValueError: If a start is out of bounds, or check is between 0 and 25.
        RuntimeError: If no start led to a maximum, or too many solves failed.
        UserWarning: If the model at the prior mean is far from the measurements.

    Examples:
        >>> import emcee_femu as ef
        >>> model = ef.FunctionModel(lambda p: [p["k"] ** 0.5], n_modes=1)
        >>> term = ef.FrequencyTerm([3.0], relative_sd=0.01)
        >>> prior = ef.GaussianPrior(["k"], [8.0], [2.0], [(1.0, 20.0)])
        >>> found = ef.find_map(ef.LogPosterior(model, term, prior), 4, seed=1)
        >>> (best,) = found.maxima
        >>> best.theta.round(2).tolist(), (best.covariance**0.5).round(2).tolist()
        ([8.99], [[0.18]])
    """
    posterior = checks.instance("posterior", posterior, LogPosterior)
    for_starts, for_check = np.random.SeedSequence(
        checks.whole_number("seed", seed)
    ).spawn(2)
    points = _choose_starts(posterior, starts, for_starts)
    check = checks.whole_number("check", check)
    if 0 < check < FEWEST_WEIGHTS:
        raise ValueError(
            f"check: expected 0 or at least {FEWEST_WEIGHTS} draws, got {check}"
        )
    how = workers, pool, on_failure, max_failures
    with open_evaluator(posterior, {}, *how) as evaluation:
        check_first_solve(evaluation)
        ends = climb(evaluation, points)
        # A climb that stopped on its way counts only if it is above all that arrived.
        top = max([e.log_posterior for e in ends if e.converged], default=-np.inf)
        tell = [end for end in ends if end.converged or end.log_posterior > top]
        reached = [end for end in tell if end.log_evidence > -np.inf]
        lost = [end.message for end in ends if end not in reached]
        if not reached:
            raise RuntimeError(
                f"starts: none of {len(ends)} led to a maximum ({dict(Counter(lost))});"
                " give starts where the posterior can be evaluated"
            )
        groups = distinct(reached)
        groups.sort(key=lambda group: -reached[group[0]].log_evidence)
        maxima = [reached[group[0]] for group in groups]
        weights = special.softmax([maximum.log_evidence for maximum in maxima])
        n, k, share = 0, np.nan, np.nan
        if check:
            rng = np.random.default_rng(for_check)
            bounds = posterior.prior.bounds
            draws, log_q = _draw_inside(maxima, weights, bounds, check, rng)
            log_weights = evaluation.rows(draws)[:, LOG_POSTERIOR] - log_q
            n, k, share = len(draws), pareto_k(log_weights), kish_share(log_weights)
    return FoundMap(
        posterior=posterior,
        maxima=tuple(maxima),
        weights=weights,
        climbs=np.array([len(group) for group in groups]),
        lost=tuple(lost),
        solves=evaluation.solves,
        draws=n,
        pareto_k=k,
        efficiency=share,
        printed=is_printed(posterior, np.array([end.row for end in ends])),
        from_prior=0 if np.iterable(starts) else len(points),
    )


def _choose_starts(
    posterior: LogPosterior, starts: int | ArrayLike, seed: np.random.SeedSequence
) -> Floats:
    """Return starts ``(n, d)``, drawn from the prior or given."""
    if not np.iterable(starts):
        return posterior.start(checks.whole_number("starts", starts, 1), seed)
    points = np.atleast_2d(checks.real_array("starts", starts))
    if not points.size:
        raise ValueError("starts: expected at least one, got none")
    posterior.check_inside("starts", points)
    return points


def _draw_inside(
    maxima: Sequence[Maximum],
    weights: Floats,
    bounds: Floats,
    n: int,
    rng: np.random.Generator,
) -> tuple[Floats, Floats]:
    """Draw from the Gaussians about maxima, inside the bounds.

    Draws cost no solve, but have to be inside as often as those of any start.

    Returns:
        Draws, fewer than n if most of the Gaussians is out of bounds, and the log of
        their density up to a constant: cutting at the bounds only rescales it.
    """
    centres = np.array([maximum.theta for maximum in maxima])
    covariances = np.array([maximum.covariance for maximum in maxima])
    mixture = Mixture(weights, centres, covariances, GAUSSIAN)
    draws = mixture.draw(rng, MOST_START_DRAWS * n)
    draws = draws[inside(draws, bounds)][:n]
    return draws, mixture.log_density(draws)
