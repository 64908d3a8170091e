"""Priors: a bounded Gaussian (Eq. 2.3), or independent scipy.stats marginals."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import stats

from .. import checks
from ..interfaces import Floats, Prior


@dataclass(frozen=True, eq=False, init=False)
class GaussianPrior:
    r"""Independent Gaussians, cut at bounds and normalised inside them (Eq. 2.3).

    .. math:: p(\theta) \propto
        \exp\left(-\tfrac12 \sum_i \alpha_i (\theta_i - \theta_{0,i})^2\right),
        \qquad \alpha_i = 1 / \mathrm{sd}_i^2

    Args:
        names: Parameter names; their order is that of the sampled vector.
        mean: :math:`\theta_0`, ``(d,)``, in parameter units.
        sd: Standard deviations before the cut, ``(d,)`` or one number for all.
        bounds: ``(low, high)`` per parameter, ``(d, 2)``; None for unbounded.

    Raises:
        TypeError: If an argument is not of real numbers, or names are no strings.
        ValueError: If shapes disagree, sd <= 0, a bound is NaN, low >= high, or
            the bounds hold no probability.

    Source: Eq. 2.3 of Sherri, Boulkaibet, Marwala and Friswell.

    Example:
        >>> prior = GaussianPrior(["k1", "k2"], [4e3, 2e3], 1e3, [(3e3, 5e3)] * 2)
        >>> prior.logpdf(np.array([[4e3, 3e3], [4e3, 9e3]])).round(2).tolist()
        [-13.92, -inf]
    """

    names: tuple[str, ...]
    mean: Floats
    sd: Floats
    bounds: Floats
    _log_constant: float = field(repr=False)

    def __init__(
        self,
        names: Sequence[str],
        mean: ArrayLike,
        sd: ArrayLike,
        bounds: ArrayLike | None = None,
    ) -> None:
        """See the class."""
        fixed = checks.parameter_names("names", names)
        mean = checks.real_array("mean", mean, 1)
        d = len(fixed)
        if mean.shape != (d,):
            raise ValueError(
                f"mean: expected one number for each of {d} names, "
                f"got shape {mean.shape}"
            )
        sd = checks.positive_array("sd", sd)
        if sd.shape not in ((), (d,)):
            raise ValueError(
                f"sd: expected one number or shape ({d},), got shape {sd.shape}"
            )
        sd = np.broadcast_to(sd, (d,)).copy()
        if bounds is None:
            bounds = np.tile([-np.inf, np.inf], (d, 1))
        bounds = checked_bounds(bounds, fixed)

        low, high = _standard_bounds(bounds, mean, sd)
        nearest = np.clip(0.0, low, high)  # the densest point of the cut Gaussian
        with np.errstate(over="ignore", invalid="ignore"):  # is an error below
            log_mass = stats.norm.logpdf(nearest) - stats.truncnorm.logpdf(
                nearest, low, high
            )
        if not np.isfinite(log_mass).all():
            name = fixed[int(np.argmin(np.isfinite(log_mass)))]
            raise ValueError(
                f"bounds: the Gaussian of {name!r} has no probability inside its "
                "bounds; move the bounds or the mean"
            )
        constant = -np.log(sd).sum() - 0.5 * d * np.log(2 * np.pi) - log_mass.sum()

        set_field = object.__setattr__
        set_field(self, "names", fixed)
        set_field(self, "mean", mean)
        set_field(self, "sd", sd)
        set_field(self, "bounds", bounds)
        set_field(self, "_log_constant", float(constant))

    def logpdf(self, theta: Floats) -> Floats:
        """Return the log density ``(n,)`` of ``theta (n, d)``, -inf out of bounds."""
        standard = (theta - self.mean) / self.sd
        with np.errstate(over="ignore"):  # beyond 1e154 sd the density is zero
            standard *= standard
        log_density: Floats = np.add.reduce(standard, axis=1)
        log_density *= -0.5
        log_density += self._log_constant
        log_density[~inside(theta, self.bounds)] = -np.inf
        return log_density

    def sample(self, rng: np.random.Generator, n: int) -> Floats:
        """Draw ``(n, d)`` parameter sets inside the bounds."""
        low, high = _standard_bounds(self.bounds, self.mean, self.sd)
        size = (n, len(self.names))
        standard = stats.truncnorm.rvs(low, high, size=size, random_state=rng)
        # Rounding may put mean + sd * low an ulp beyond a bound that was hit.
        theta = self.mean + self.sd * standard
        result: Floats = np.clip(theta, self.bounds[:, 0], self.bounds[:, 1])
        return result


@dataclass(frozen=True, eq=False)
class IndependentPrior:
    """Independent marginals, each a frozen continuous distribution of scipy.stats.

    ``p(theta) = prod_i p_i(theta_i)``; the bounds are the distributions' supports.
    scipy writes a uniform on [1000, 5000] as ``uniform(loc=1000, scale=4000)``;
    ``uniform_between(1000, 5000)`` says the same and cannot be misread.

    Args:
        marginals: ``{name: frozen distribution}``; their order is that of the vector.

    Raises:
        TypeError: If a marginal is not a frozen continuous distribution.
        ValueError: If there is no marginal, or one has an undefined support.

    Example:
        >>> from scipy import stats
        >>> prior = IndependentPrior({"k1": stats.uniform(1e3, 4e3)})
        >>> prior.bounds.tolist()
        [[1000.0, 5000.0]]
    """

    marginals: Mapping[str, Any]
    names: tuple[str, ...] = field(init=False)
    bounds: Floats = field(init=False)

    def __post_init__(self) -> None:
        """Check the marginals and read their supports."""
        if not isinstance(self.marginals, Mapping):
            raise TypeError(
                "marginals: expected {name: scipy.stats distribution}, got "
                f"{type(self.marginals).__name__}"
            )
        names = checks.parameter_names("marginals", list(self.marginals))
        for name, marginal in self.marginals.items():
            frozen = not isinstance(marginal, stats.rv_continuous)
            methods = ("logpdf", "rvs", "support")
            if not (frozen and all(hasattr(marginal, m) for m in methods)):
                raise TypeError(
                    f"marginals[{name!r}]: expected a frozen continuous distribution "
                    f"such as scipy.stats.norm(0, 1), got {marginal!r}"
                )
        supports = [self.marginals[name].support() for name in names]
        object.__setattr__(self, "marginals", dict(self.marginals))
        object.__setattr__(self, "names", names)
        object.__setattr__(self, "bounds", checked_bounds(supports, names))

    @property
    def mean(self) -> Floats:
        """The means of the marginals, ``(d,)``."""
        return np.array([marginal.mean() for marginal in self.marginals.values()])

    def logpdf(self, theta: Floats) -> Floats:
        """Return the log density ``(n,)`` of ``theta (n, d)``, -inf out of bounds."""
        total = np.zeros(len(theta))
        for column, marginal in zip(theta.T, self.marginals.values(), strict=True):
            with np.errstate(over="ignore"):  # as far out as that it is zero
                total += marginal.logpdf(column)
        return total

    def sample(self, rng: np.random.Generator, n: int) -> Floats:
        """Draw ``(n, d)`` parameter sets inside the bounds."""
        columns = [m.rvs(size=n, random_state=rng) for m in self.marginals.values()]
        return np.column_stack(columns).astype(float)


def uniform_between(low: float, high: float) -> Any:
    """Return the scipy.stats uniform distribution on ``[low, high]``.

    Raises:
        ValueError: If a bound is not finite or low >= high.

    Example:
        >>> uniform_between(1000.0, 5000.0).support()
        (np.float64(1000.0), np.float64(5000.0))
    """
    low, high = checks.real_number("low", low), checks.real_number("high", high)
    if low >= high:
        raise ValueError(f"low: expected below high = {high:g}, got {low:g}")
    if not math.isfinite(high - low):
        raise ValueError(
            f"high: expected within 1.8e308 of low = {low:g}, got {high:g}"
        )
    return stats.uniform(low, high - low)


def _standard_bounds(bounds: Floats, mean: Floats, sd: Floats) -> Floats:
    """Return bounds in standard deviations from the mean, ``(2, d)``."""
    with np.errstate(over="ignore"):  # so far away there is no bound
        result: Floats = ((bounds - mean[:, None]) / sd[:, None]).T
    return result


def checked_bounds(bounds: ArrayLike, names: tuple[str, ...]) -> Floats:
    """Return bounds as ``(d, 2)``, refusing NaN and low >= high by name."""
    array = checks.numeric_array("bounds", bounds)
    if array.shape != (len(names), 2):
        raise ValueError(
            f"bounds: expected (low, high) for each of {len(names)} parameters, "
            f"shape ({len(names)}, 2), got shape {array.shape}"
        )
    for name, (low, high) in zip(names, array.tolist(), strict=True):
        if not low < high:
            raise ValueError(
                f"bounds: expected low < high for {name!r}, got ({low:g}, {high:g})"
            )
    return array


def inside(theta: Floats, bounds: Floats) -> NDArray[np.bool_]:
    """Return which rows of ``theta (n, d)`` lie inside ``bounds (d, 2)``."""
    within = (theta >= bounds[:, 0]) & (theta <= bounds[:, 1])
    result: NDArray[np.bool_] = np.logical_and.reduce(within, axis=1)
    return result


def prior_summary(prior: Prior, draws: int = 20_000) -> tuple[Floats, Floats]:
    """Return the prior's mean and standard deviation inside the bounds, each ``(d,)``.

    Both are those of ``draws`` samples (the standard deviation has 0.5 % Monte Carlo
    error): one way for every prior that can be sampled.
    """
    sample = prior.sample(np.random.default_rng(0), draws)
    return sample.mean(axis=0), sample.std(axis=0)
