r"""The likelihood of a population, from the draws of each test's own posterior.

.. math:: p(D_t | \phi) \propto
    \frac1S \sum_s \frac{N(\theta_{ts}; \phi)}{\pi_t(\theta_{ts})}

with theta_ts the draws under the prior pi_t. As a model its response is the logarithm
of that for each test, and no FE solve is needed. Where a normal law q_t resembles the
likelihood at the draws, the part of it that q_t explains is taken in closed form, and
the draws only correct it:

.. math:: \int N(\theta; \phi) q_t(\theta) d\theta \;
    \frac{\sum_s w_s}{\sum_s w_s r_s}, \qquad
    w_s = \frac{N(\theta_{ts}; \phi)}{\pi_t(\theta_{ts})}, \quad
    r_s = \frac{q_t(\theta_{ts})}{L_t(\theta_{ts})},

which is exact for a normal likelihood, however far the population pulls and in any
dimension. Both are consistent: the more draws, the smaller their error, whatever the
likelihood. Where less than 10 draws would be effective, the weights of that correction
are tempered, ``w_s^tau``.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import checks
from ..interfaces import Floats, Parameters, Variable
from .box import log_mass
from .draws import Drawn
from .normal import FLOOR, NormalPopulation
from .normal_law import NormalLaw, fit_normal_law
from .tempering import choose_powers

BLOCK = 250_000  # densities at once, that they stay near the processor
ABSENT = -1e30  # log weight of a draw that is not there
LN_2PI = np.log(2 * np.pi)


@dataclass(frozen=True, eq=False, init=False)
class PopulationModel:
    """The parameters of a population to the log-likelihood of each test.

    Args:
        population: With all hyperpriors.
        draws: Of each test, by its name.
        use_laws: Whether normal laws may stand for what they explain.

    Attributes:
        tests: Their names.
        names: The population's own parameters.
        laws: The normal law of each test.
        powers: By which the weights of each test's correction are tempered, ``(T,)``.
    """

    population: NormalPopulation
    tests: tuple[str, ...]
    draws: tuple[Drawn, ...]
    names: tuple[str, ...]
    variables: Mapping[str, Variable]
    laws: tuple[NormalLaw, ...]
    powers: Floats
    bounds_of: Floats
    centred: Floats
    _unit: tuple[Floats, Floats] = field(repr=False)
    _features: Floats = field(repr=False)
    _offsets: Floats = field(repr=False)
    _sums: Floats = field(repr=False)
    _quadratics: tuple[Floats, Floats, Floats] = field(repr=False)

    def __init__(
        self,
        population: NormalPopulation,
        draws: Mapping[str, Drawn],
        use_laws: bool = True,
    ) -> None:
        tests, found = tuple(draws), tuple(draws.values())
        covariates = {
            name: [own[test] for test in tests]
            for name, own in population.covariates.items()
        }
        centred = population.centre(covariates)
        variables = {"log_marginal": Variable({"test": tests})}
        if population.correlated:
            pairs = _name_pairs(population.names)
            variables["correlation"] = Variable({"pair": pairs})
        everywhere = np.concatenate([own.theta for own in found])
        centre, scale = everywhere.mean(axis=0), everywhere.std(axis=0)
        laws = tuple(fit_normal_law(own) for own in found)
        if not use_laws:
            laws = tuple(law._replace(good=False) for law in laws)
        powers = choose_powers(found, laws, centred)
        checks.set_fields(
            self,
            population=population,
            tests=tests,
            draws=found,
            names=population.parameters,
            variables=variables,
            laws=laws,
            powers=powers,
            bounds_of=found[0].bounds,
            centred=centred,
            _unit=(centre, scale),
        )
        self._prepare()

    def _prepare(self) -> None:
        """Arrange draws and laws in arrays, in units of all tests' scatter."""
        centre, scale = self._unit
        d, longest = len(centre), max(len(own.theta) for own in self.draws)
        pairs = self._pairs
        features = np.zeros((len(self.draws), d + len(pairs[0]), longest))
        offsets = np.full((len(self.draws), longest), ABSENT)
        sums = np.ones((len(self.draws), longest, 2))
        for t, (own, law) in enumerate(zip(self.draws, self.laws, strict=True)):
            s = len(own.theta)
            z = ((own.theta - centre) / scale).T
            features[t, :, :s] = [*z, *(z[pairs[0]] * z[pairs[1]])]
            offsets[t, :s] = -own.log_prior
            if law.good:
                sums[t, :s, 1] = np.exp(law.log_ratio)
            else:
                offsets[t, :s] -= np.log(s)
        powers = self.powers[:, None]
        checks.set_fields(
            self,
            _features=features * powers[:, :, None],
            _offsets=offsets * powers,
            _sums=sums,
            _quadratics=(
                np.stack([(law.centre - centre) / scale for law in self.laws]),
                np.stack([law.slope * scale for law in self.laws]),
                np.stack([law.curvature * np.outer(scale, scale) for law in self.laws]),
            ),
        )

    @property
    def _pairs(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """The products of parameters on which a log density depends."""
        d = len(self.population.names)
        if self.population.correlated:
            return np.triu_indices(d)
        return np.arange(d), np.arange(d)

    @property
    def required(self) -> tuple[str, ...]:
        """All its parameters."""
        return self.names

    def __call__(self, parameters: Parameters) -> dict[str, Floats]:
        """Return ``log_marginal (n, T)``, and correlations where there are any.

        Each test's is known but for a constant.
        """
        location, factor = self._standardize(parameters)
        coefficients, constant = self._expand(location, factor)
        sums, top = self._sum(coefficients)
        good = np.array([law.good for law in self.laws])
        with np.errstate(divide="ignore"):
            log_sums = np.log(sums)
        # A law's own integral holds the constant of the population's density.
        found = np.where(good, 0.0, constant + top + log_sums[:, :, 0])
        if good.any():
            closed, _, _ = self._integrate(location, factor)
            corrected = closed + log_sums[:, :, 0] - log_sums[:, :, 1]
            found = np.where(good, corrected, found)
        found -= self._log_mass(location, factor)
        result = {"log_marginal": found}
        if self.population.correlated:
            root = self.population.correlation_factor(parameters)
            whole = root @ root.transpose(0, 2, 1)
            i, j = np.triu_indices(len(self.population.names), 1)
            result["correlation"] = whole[:, i, j]
        return result

    def weights(self, parameters: Parameters) -> Floats:
        """Return each test's weights of its draws, ``(n, T, S)``, which sum to one."""
        coefficients, _ = self._expand(*self._standardize(parameters))
        powers = self.powers[:, None, None]
        own = (coefficients @ self._features + self._offsets[:, None]) / powers
        own -= own.max(axis=2, keepdims=True)
        np.exp(own, out=own)
        own /= own.sum(axis=2, keepdims=True)
        result: Floats = own.swapaxes(0, 1)
        return result

    def draw_from_laws(self, rng: np.random.Generator, parameters: Parameters) -> Any:
        """Draw each test's parameters by its normal law, ``(n, T, d)``."""
        location, factor = self._standardize(parameters)
        _, mean, precision = self._integrate(location, factor)
        root = np.linalg.cholesky(precision).swapaxes(2, 3)
        normal = rng.standard_normal((*mean.shape, 1))
        standard = mean + np.linalg.solve(root, normal)[..., 0]
        theta = location + np.einsum("nij,ntj->nti", factor, standard)
        return self._unit[0] + self._unit[1] * theta

    def _standardize(self, parameters: Parameters) -> tuple[Floats, Floats]:
        """Return means ``(n, T or 1, d)`` and factors ``(n, d, d)``, in the units."""
        centre, scale = self._unit
        location = (self.population.locate(parameters, self.centred) - centre) / scale
        factor = self.population.factor(parameters) / scale[:, None]
        diagonal = np.arange(len(scale))
        floored = np.maximum(factor[:, diagonal, diagonal], FLOOR)
        factor[:, diagonal, diagonal] = floored
        return location, factor

    def _expand(self, location: Floats, factor: Floats) -> tuple[Floats, Floats]:
        """Return ln N as coefficients of the features, and its constant ``(n, T)``."""
        root = np.linalg.inv(factor)
        precision = root.swapaxes(1, 2) @ root
        pull = np.einsum("nij,ntj->tni", precision, location)
        i, j = self._pairs
        bend = -precision[:, i, j] * np.where(i == j, 0.5, 1.0)
        bends = np.broadcast_to(bend, (len(pull), *bend.shape))
        size = np.einsum("tni,nti->nt", pull, location)
        diagonals = np.diagonal(factor, axis1=1, axis2=2)
        log_scale = np.log(diagonals).sum(axis=1) + 0.5 * factor.shape[1] * LN_2PI
        return np.concatenate([pull, bends], 2), -size / 2 - log_scale[:, None]

    def _sum(self, coefficients: Floats) -> tuple[Floats, Floats]:
        """Return sums over the draws ``(n, T, 2)``, divided by exp of ``(n, T)``."""
        n, tests = coefficients.shape[1], len(self.draws)
        sums, top = np.empty((tests, n, 2)), np.empty((tests, n))
        step = max(1, BLOCK // (n * self._offsets.shape[1]))
        for start in range(0, tests, step):
            block = slice(start, start + step)
            own = coefficients if len(coefficients) == 1 else coefficients[block]
            log_weights = own @ self._features[block]
            log_weights += self._offsets[block, None]
            top[block] = log_weights.max(axis=2)
            log_weights -= top[block, :, None]
            weights = np.exp(log_weights, out=log_weights)
            sums[block] = weights @ self._sums[block]
        return sums.swapaxes(0, 1), top.T

    def _integrate(
        self, location: Floats, factor: Floats
    ) -> tuple[Floats, Floats, Floats]:
        r"""Return ``ln \int N q (n, T)``, and mean and precision of the law ``N q``.

        Of eps in ``theta = location + factor eps``, of which N is the standard normal.
        """
        centre, slope, curvature = self._quadratics
        away = location - centre
        bent = np.einsum("tij,ntj->nti", curvature, away)
        at_mean = np.einsum("nti,nti->nt", away, slope - bent / 2)
        pull = np.einsum("nji,ntj->nti", factor, slope - bent)
        if self.population.correlated:
            inner = factor.swapaxes(1, 2)[:, None] @ curvature @ factor[:, None]
        else:
            sd = np.diagonal(factor, axis1=1, axis2=2)
            inner = curvature * (sd[:, :, None] * sd[:, None])[:, None]
        inner = inner + np.eye(inner.shape[-1])
        root = np.linalg.cholesky(inner)
        mean = np.linalg.solve(inner, pull[..., None])[..., 0]
        log_det = 2 * np.log(np.diagonal(root, axis1=2, axis2=3)).sum(axis=2)
        closed = at_mean + (np.einsum("nti,nti->nt", pull, mean) - log_det) / 2
        return closed, mean, inner

    def _log_mass(self, location: Floats, factor: Floats) -> Floats:
        bounds = (self.bounds_of - self._unit[0][:, None]) / self._unit[1][:, None]
        return log_mass(location, factor, bounds)


def _name_pairs(names: Sequence[str]) -> tuple[str, ...]:
    return tuple(f"{a}, {b}" for a, b in combinations(names, 2))
