"""Priors: a bounded Gaussian (Eq. 2.3), or independent scipy.stats marginals."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import stats

from .. import checks
from ..contracts import Floats, Prior, read_declared
from ..table import Column, Parts, Report, Table, unit_column

MOMENT_DRAWS = 20_000  # of a prior, for its moments
SCALE_DRAWS = 256  # of a prior, for scales, as of derivatives


class Marginal(Protocol):
    """The law of one parameter, as a frozen distribution of scipy.stats is."""

    def logpdf(self, x: Floats) -> Floats:
        """Return the log density, -inf outside of the support."""

    def rvs(self, size: int, random_state: np.random.Generator) -> Floats:
        """Draw so many values."""

    def support(self) -> tuple[float, float]:
        """Return the ends of the support."""


class KnownPrior(Report):
    """What the priors of this package tell beside the contract of a prior."""

    names: tuple[str, ...]
    bounds: Floats
    marginals: dict[str, Marginal]  # by name; a Gaussian's before truncation

    def _parts(self) -> Parts:
        return (tabulate_prior("Prior", self),)

    def logpdf(self, theta: Floats) -> Floats:
        """Return the log density ``(n,)`` of ``theta (n, d)``, -inf out of bounds."""
        return np.asarray(self.logpdfs(theta).sum(axis=1))

    def logpdfs(self, theta: Floats) -> Floats:
        """Return each parameter's log density ``(n, d)``, -inf out of bounds."""
        found = np.empty(theta.shape)
        for columns, family in self._families:
            found[:, columns] = family.logpdf(theta[:, columns])
        return found

    @cached_property
    def _families(self) -> list[tuple[list[int], Marginal]]:
        return join_families([*self.marginals.values()])

    @cached_property
    def _moments(self) -> tuple[Floats, Floats]:
        """Mean and standard deviation ``(d,)`` of draws, which are made once."""
        return _find_moments(self)

    def sample(self, rng: np.random.Generator, n: int) -> Floats:
        """Draw ``(n, d)`` parameter sets inside the bounds."""
        columns = [m.rvs(size=n, random_state=rng) for m in self.marginals.values()]
        return np.column_stack(columns).astype(float)


class GaussianPrior(KnownPrior):
    r"""Independent Gaussian priors, truncated at bounds and normalised (Eq. 2.3).

    .. math:: p(\theta) \propto
        \exp\left(-\tfrac12 \sum_i \alpha_i (\theta_i - \theta_{0,i})^2\right),
        \qquad \alpha_i = 1 / \mathrm{sd}_i^2

    Args:
        names: Parameter names, in the order of the sampled vector.
        mean: :math:`\theta_0`, ``(d,)``, in parameter units.
        sd: Standard deviations before truncation, ``(d,)`` or one number for all.
        bounds: ``(low, high)`` per parameter, ``(d, 2)``; None for unbounded.

    Raises:
        TypeError: If an argument does not hold real numbers, or a name is not a string.
        ValueError: If shapes do not match, sd <= 0, a bound is NaN, or low >= high.

    Source: Eq. 2.3 of Sherri, Boulkaibet, Marwala and Friswell.

    Examples:
        >>> import numpy as np
        >>> from emcee_femu import GaussianPrior
        >>> prior = GaussianPrior(["k1", "k2"], [4e3, 2e3], 1e3, [(3e3, 5e3)] * 2)
        >>> prior.logpdf(np.array([[4e3, 3e3], [4e3, 9e3]])).round(2).tolist()
        [-13.92, -inf]
    """

    def __init__(
        self,
        names: Sequence[str],
        mean: ArrayLike = (),
        sd: ArrayLike = (),
        bounds: ArrayLike | None = None,
    ) -> None:
        if isinstance(names, Mapping):
            raise TypeError(
                "names: expected names, then means and standard deviations, as in "
                f"GaussianPrior({[*names]}, mean, sd), got a mapping"
            )
        self.names = checks.parameter_names("names", names)
        self.mean = mean = checks.real_array("mean", mean, 1)
        sd = checks.positive_array("sd", sd)
        d = len(self.names)
        checks.shaped("mean", mean.shape, (d,), remedy="one for each of names")
        checks.shaped("sd", sd.shape, (), (d,), remedy="one for each of names")
        self.sd = sd = np.broadcast_to(sd, (d,)).copy()
        free = np.tile([-np.inf, np.inf], (d, 1))
        self.bounds = check_bounds(free if bounds is None else bounds, self.names)
        low, high = (self.bounds.T - mean) / sd
        self._cut = stats.truncnorm(low, high, mean, sd)
        nearest = np.clip(0.0, low, high)  # the densest point of the cut Gaussian
        peak = stats.truncnorm.logpdf(nearest, low, high) - np.log(sd)
        self._log_constant = float((peak + 0.5 * nearest**2).sum())
        self.marginals = dict(zip(self.names, map(stats.norm, mean, sd), strict=True))

    def logpdf(self, theta: Floats) -> Floats:
        """Return the log density ``(n,)`` of ``theta (n, d)``, -inf out of bounds."""
        standard = (theta - self.mean) / self.sd
        log_density = self._log_constant - 0.5 * (standard**2).sum(axis=1)
        return np.where(inside(theta, self.bounds), log_density, -np.inf)

    def logpdfs(self, theta: Floats) -> Floats:
        """Return each parameter's log density ``(n, d)``, -inf out of bounds."""
        return np.asarray(self._cut.logpdf(theta))

    def sample(self, rng: np.random.Generator, n: int) -> Floats:
        """Draw ``(n, d)`` parameter sets inside the bounds."""
        draws = self._cut.rvs(size=(n, len(self.names)), random_state=rng)
        # Rounding may put one an ulp beyond a bound that was hit.
        return np.asarray(np.clip(draws, *self.bounds.T))


class IndependentPrior(KnownPrior):
    """Independent priors, each a frozen continuous distribution of scipy.stats.

    ``p(theta) = prod_i p_i(theta_i)``, normalised inside the bounds. Use it for
    lognormal, uniform or any other marginals. For a uniform prior on [1000, 5000], give
    the pair ``(1000, 5000)``; scipy's own notation, ``uniform(loc=1000, scale=4000)``,
    is easily misread.

    Args:
        marginals: ``{name: frozen distribution}``, or ``{name: (low, high)}`` for a
            uniform one, in the order of the sampled vector.
        bounds: ``{name: (low, high)}`` at which marginals are truncated, such as the
            bounds of a reduced model. Other marginals keep their supports.

    Raises:
        TypeError: If a marginal is not a frozen continuous distribution.
        ValueError: If there is no marginal, one has an undefined support, bounds names
            an unknown parameter, low >= high, or there is no probability inside bounds.

    Examples:
        >>> from scipy import stats
        >>> from emcee_femu import IndependentPrior
        >>> marginals = {"E": stats.lognorm(0.2), "k1": (1e3, 5e3)}
        >>> IndependentPrior(marginals, bounds={"E": (0.5, 1.5)}).bounds.tolist()
        [[0.5, 1.5], [1000.0, 5000.0]]
    """

    def __init__(
        self,
        marginals: Mapping[str, Any],
        bounds: Mapping[str, tuple[float, float]] | None = None,
    ) -> None:
        checks.mapping("marginals", marginals, "{name: distribution}")
        self.names = names = checks.parameter_names("marginals", list(marginals))
        ends = checks.by_name("bounds", {} if bounds is None else bounds, names)
        self.marginals = {}
        for name, marginal in marginals.items():
            if np.shape(marginal) == (2,):
                low, high = checks.numeric_array(f"marginals[{name!r}]", marginal)
                if not (low < high and np.isfinite(high - low)):
                    raise ValueError(
                        f"marginals[{name!r}]: expected finite low < high, got "
                        f"{marginal}; without bounds, and for a mean and a standard "
                        "deviation, it is scipy.stats.norm(mean, sd)"
                    )
                marginal = stats.uniform(low, high - low)
            methods = {"logpdf", "rvs", "support", "freeze"} & {*dir(marginal)}
            if methods != {"logpdf", "rvs", "support"}:  # what can be frozen is not
                raise TypeError(
                    f"marginals[{name!r}]: expected a frozen continuous distribution, "
                    f"scipy.stats.norm(0, 1), or a pair (low, high), got {marginal!r}"
                )
            if np.isnan(marginal.support()).any():
                raise ValueError(
                    f"marginals[{name!r}]: its arguments are outside the range that "
                    "scipy.stats allows, such as a scale that is not above zero; "
                    "scipy's uniform(loc, scale) is from loc to loc + scale"
                )
            if name in ends:
                ((low, high),) = check_bounds([ends[name]], (name,)).tolist()
                marginal = _Cut(name, marginal, low, high)
            self.marginals[name] = marginal
        supports = [marginal.support() for marginal in self.marginals.values()]
        self.bounds = check_bounds(supports, names)


class _Cut:
    """A marginal truncated at ``low`` and ``high`` and normalised between them."""

    def __init__(self, name: str, marginal: Any, low: float, high: float) -> None:
        least, most = marginal.support()
        self.low, self.high = max(low, float(least)), min(high, float(most))
        self.marginal = marginal
        # Far up, probabilities from below differ by less than rounding.
        upper = marginal.cdf(self.low) > 0.5
        self._quantile = marginal.isf if upper else marginal.ppf
        beyond = marginal.sf if upper else marginal.cdf
        self._start, self._stop = beyond(self.low), beyond(self.high)
        with np.errstate(divide="ignore"):  # is an error below
            self._log_mass = np.log(abs(self._stop - self._start))
        if not np.isfinite(self._log_mass):
            raise ValueError(f"bounds: {name!r} has no probability inside its bounds")

    def logpdf(self, x: Floats) -> Floats:
        within = (x >= self.low) & (x <= self.high)
        return np.where(within, self.marginal.logpdf(x) - self._log_mass, -np.inf)

    def rvs(self, size: int, random_state: np.random.Generator) -> Floats:
        share = random_state.random(size)
        draws = self._quantile(self._start + (self._stop - self._start) * share)
        return np.asarray(np.clip(draws, self.low, self.high))

    def mean(self) -> float:
        shares = (np.arange(MOMENT_DRAWS) + 0.5) / MOMENT_DRAWS
        shares = self._start + (self._stop - self._start) * shares
        return float(self._quantile(shares).mean())

    def support(self) -> tuple[float, float]:
        return self.low, self.high


def join_families(marginals: Sequence[Any]) -> list[tuple[list[int], Marginal]]:
    """Return columns and their distribution: of one family of scipy.stats, one.

    It has arrays for its arguments, since a call of scipy takes longer than the
    arithmetic of a hundred parameters.
    """
    columns: dict[tuple[object, ...], list[int]] = {}
    for i, one in enumerate(marginals):
        key: tuple[object, ...] = (i,)
        if isinstance(one, type(stats.norm())):
            of_scipy = type(getattr(stats, one.dist.name, None)) is type(one.dist)
            if of_scipy and not any(map(np.ndim, (*one.args, *one.kwds.values()))):
                key = one.dist.name, len(one.args), *sorted(one.kwds)
        columns.setdefault(key, []).append(i)
    joined = []
    for which in columns.values():
        first, alike = marginals[which[0]], [marginals[i] for i in which]
        if len(alike) > 1:
            args = np.array([one.args for one in alike]).T
            kwds = {k: np.array([one.kwds[k] for one in alike]) for k in first.kwds}
            first = first.dist(*args, **kwds)
        joined.append((which, first))
    return joined


def check_bounds(bounds: ArrayLike, names: tuple[str, ...]) -> Floats:
    """Return bounds as ``(d, 2)``, refusing NaN and low >= high by name."""
    array = checks.numeric_array("bounds", bounds)
    shape = len(names), 2
    checks.shaped("bounds", array.shape, shape, remedy="(low, high) of each name")
    for name, (low, high) in zip(names, array.tolist(), strict=True):
        if not low < high:
            raise ValueError(f"bounds: {name!r} has low >= high, ({low:g}, {high:g})")
    return array


def inside(theta: Floats, bounds: Floats) -> NDArray[np.bool_]:
    """Return which rows of ``theta (n, d)`` lie inside ``bounds (d, 2)``."""
    within = (theta >= bounds[:, 0]) & (theta <= bounds[:, 1])
    return np.asarray(np.logical_and.reduce(within, axis=1))


def summarize_prior(prior: Prior) -> tuple[Floats, Floats]:
    """Return the prior's mean and standard deviation inside the bounds, each ``(d,)``.

    Both are computed from samples, for any prior; the standard deviation has a Monte
    Carlo error of 0.5 %. A prior of this package remembers them.
    """
    known = prior._moments if isinstance(prior, KnownPrior) else _find_moments(prior)
    return known[0].copy(), known[1].copy()


def _find_moments(prior: Prior) -> tuple[Floats, Floats]:
    sample = prior.sample(np.random.default_rng(0), MOMENT_DRAWS)
    return sample.mean(axis=0), sample.std(axis=0)


def prior_scale(prior: Prior) -> Floats:
    """Return the spread of each parameter under a prior, from its quartiles, ``(d,)``.

    From draws of a fixed seed; a tail as that of a Cauchy law does not matter.
    """
    draws = prior.sample(np.random.default_rng(0), SCALE_DRAWS)
    low, high = np.quantile(draws, [0.25, 0.75], axis=0)
    return np.asarray((high - low) / 1.35)


def prior_centre(prior: Prior) -> Floats:
    """Return the parameters before updating: a Gaussian's mean before truncation.

    Means are exact where a marginal knows its own, as those of scipy.stats do.
    """
    if isinstance(prior, GaussianPrior):
        return prior.mean
    centre = summarize_prior(prior)[0]
    for name, marginal in (read_declared(prior, "marginals") or {}).items():
        if hasattr(marginal, "mean") and np.isfinite(mean := marginal.mean()):
            centre[prior.names.index(name)] = mean
    return centre


def list_laws(prior: Prior) -> list[str]:
    """Return a prior's marginals before truncation, as scipy writes them, if any."""
    return [*map(describe_marginal, (read_declared(prior, "marginals") or {}).values())]


def tabulate_prior(
    title: str, prior: Prior, units: Mapping[str, str] | None = None
) -> Table:
    """Return a table of names and bounds, and of this package's marginals."""
    columns: list[Column] = [("parameter", "", list(prior.names))]
    columns += unit_column((units or {}).get(name, "") for name in prior.names)
    if laws := list_laws(prior):
        # scipy's uniform(loc, scale) would be taken for the bounds, which stand beside.
        laws = [re.sub(r"^uniform\(.*", "uniform", law) for law in laws]
        columns.append(("prior", "", laws))
    low, high = np.transpose(prior.bounds)
    columns += [("lower", ".4g", low), ("upper", ".4g", high)]
    return Table.from_columns(title, columns)


def describe_marginal(marginal: Any) -> str:
    """Return a frozen distribution in scipy's notation: its name and arguments."""
    whole = marginal.marginal if isinstance(marginal, _Cut) else marginal
    if not hasattr(whole, "dist"):  # of a class of the user's own
        return f"{type(whole).__name__}()"
    arguments = [f"{value:.4g}" for value in whole.args]
    arguments += [f"{key}={value:.4g}" for key, value in whole.kwds.items()]
    return f"{whole.dist.name}({', '.join(arguments)})"
