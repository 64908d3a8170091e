"""A response surface: what solves gave, as polynomials of the parameters.

The density of a posterior may be bent where the response of the model hardly is:
frequencies are smooth functions of the logarithms of stiffnesses. Polynomials that are
fitted to a thousand solves give a density that is nearer to such a posterior than any
mixture of ellipsoids, and so cheap that it screens many proposals for each solve.
"""

from dataclasses import dataclass
from math import comb
from typing import Any

import emcee
import numpy as np
from numpy.typing import NDArray
from scipy.special import softmax

from ..contracts import Floats, Prior
from ..evaluation.evaluator import Evaluation
from ..likelihoods.term import log_normal
from ..moves import DEMCMove, IndependenceMove
from ..moves.mixture import Mixture
from .coordinates import Coordinates
from .importance import resample
from .proposals import cover, uncover

MOST_TERMS, DEGREES = 500, range(1, 5)  # of polynomials: cubic for 9 to 12 parameters
SOLVES_PER_TERM = 2  # solves of the first fit
MOST_FIRST_DRAWS = 5  # times so many draws, if most are out of bounds or fail
SURFACE_ROUNDS, SURFACE_SOLVES = 5, 600  # fits after it, and solves for each
# Solves at most.
LEARNED = SOLVES_PER_TERM * MOST_TERMS + SURFACE_ROUNDS * SURFACE_SOLVES
CHEAP = 8_000  # draws of a mixture from which walkers on a surface start
# Steps before the first kept, between them, how many.
SURFACE_STEPS, SURFACE_THIN, SURFACE_KEPT = 60, 20, 10
INDEPENDENT = 0.3  # share of independent proposals among these steps
# Of walkers on a surface, and the shares of draws of each in a proposal: hot ones see
# tails that draws of the posterior hardly meet, and where a walker would stay long.
SURFACE_TEMPERATURES, TEMPERATURE_SHARES = (1.0, 2.0, 4.0), (0.5, 0.3, 0.2)
FITS, DF = 2, 5.0  # of the mixture, degrees of freedom of its components
# Log-density per parameter below the largest, from where points weigh less.
WEIGHED_LEVEL = 2.0
LEAST_WEIGHT = 1e-4
# By which coefficients are drawn to zero, relative to one point.
COEFFICIENT_RIDGE = 1e-6
NO_SENSE = -1e100  # log-density where the polynomials make no sense any more


@dataclass(frozen=True, eq=False, repr=False)
class ResponseSurface:
    r"""Polynomials of all deviations, of the logs of their errors, and of the rest.

    .. math:: \ln c(\theta) = \ln p(\theta) + \sum_i \ln N(\hat r_i; 0, \hat\sigma_i)
        + \hat\ell(\theta)

    with the prior p itself. Called with ``theta (n, d)`` it returns ln c, ``(n,)``.

    Attributes:
        prior: The prior; None where nothing is evaluated.
        logs: Which parameters are seen by their logarithms, ``(d,)``.
        centre: Of these coordinates, ``(d,)``.
        scale: Their unit, ``(d,)``.
        coefficients: Of r, of ln sd and of the rest, ``(2 m + 1, terms)``.
        degree: Of the polynomials.
        most: Of the rest at all solves; the polynomial may grow without bound.
    """

    prior: Prior | None
    logs: NDArray[np.bool_]
    centre: Floats
    scale: Floats
    coefficients: Floats
    degree: int
    most: float

    @property
    def arguments(self) -> dict[str, Any]:
        """All of it but the prior."""
        return {k: v for k, v in vars(self).items() if k != "prior"}

    def __repr__(self) -> str:
        """Return what it is, in a few words."""
        return f"<polynomials of degree {self.degree}>"

    def __call__(self, theta: Floats) -> Floats:
        """Return the log-density ``(n,)``, -inf out of bounds."""
        assert self.prior is not None
        values = self.prior.logpdf(theta)
        inside = np.isfinite(values)
        x = _coordinates(self.prior, self.logs).coordinates(theta[inside])
        with np.errstate(over="ignore", invalid="ignore"):  # far from all solves
            terms = monomials((x - self.centre) / self.scale, self.degree)
            *pairs, rest = self.coefficients @ terms
            r, log_sd = np.split(np.array(pairs), 2)
            likelihood = log_normal(r, np.exp(log_sd)).sum(axis=0)
            likelihood += np.minimum(rest, self.most)
        values[inside] += np.nan_to_num(likelihood, nan=NO_SENSE, neginf=NO_SENSE)
        return values


def monomials(z: Floats, degree: int) -> Floats:
    """Return all products of at most ``degree`` of the columns, ``(terms, n)``."""
    n, d = z.shape
    blocks, last, starts = [np.ones((1, n)), z.T], z.T, np.arange(d)
    for _ in range(1, degree):
        # Each product once: a column times those that begin with it or a later one.
        parts = [
            column * last[start:] for column, start in zip(z.T, starts, strict=True)
        ]
        starts = np.cumsum([0, *map(len, parts[:-1])])
        last = np.concatenate(parts)
        blocks.append(last)
    return np.concatenate(blocks)


def fit_surface(
    prior: Prior, theta: Floats, solved: Floats, degree: int
) -> ResponseSurface:
    """Return polynomials fitted to solves, in logarithms where these predict better.

    Args:
        prior: The prior.
        theta: Points ``(n, d)``.
        solved: Their log-posteriors, log-priors, deviations and standard deviations.
        degree: Of the polynomials.
    """
    possible = np.isfinite(solved).all(axis=1)
    theta, solved = theta[possible], solved[possible]
    d = theta.shape[1]
    log_p, log_prior = solved[:, :2].T
    r, sd = np.split(solved[:, 2:], 2, axis=1)
    rest = log_p - log_prior - log_normal(r, sd).sum(axis=1)
    targets = np.column_stack([r, np.log(sd), rest])
    units = np.column_stack([sd, np.ones_like(sd), np.ones_like(rest)])
    below = np.maximum(log_p.max() - log_p - WEIGHED_LEVEL * d, 0.0)
    weights = np.maximum(np.exp(-below / 4), LEAST_WEIGHT)[:, None]
    fits = []
    for logs in (np.zeros(d, dtype=bool), prior.bounds[:, 0] >= 0):
        x = _coordinates(prior, logs).coordinates(theta)
        centre = (weights * x).sum(axis=0) / weights.sum()
        scale = np.sqrt((weights * (x - centre) ** 2).sum(axis=0) / weights.sum())
        terms = weights * monomials((x - centre) / scale, degree).T
        ridge = COEFFICIENT_RIDGE * np.eye(terms.shape[1])
        basis, triangle = np.linalg.qr(np.vstack([terms, ridge]))
        basis = basis[: len(terms)]
        coefficients = np.linalg.solve(triangle, basis.T @ (weights * targets))
        surface = ResponseSurface(
            prior, logs, centre, scale, coefficients.T, degree, float(rest.max())
        )
        # Each point predicted without itself.
        left_out = (weights * targets - terms @ coefficients) / units
        left_out /= 1.0 - (basis**2).sum(axis=1, keepdims=True)
        fits.append((float((left_out**2).sum()), surface))
    return min(fits, key=lambda fit: fit[0])[1]


def learn_surface(
    evaluator: Evaluation, mixture: Mixture, rng: np.random.Generator
) -> tuple[ResponseSurface, Mixture] | None:
    """Return a surface that is refined where its own draws are, and what proposes.

    Args:
        evaluator: What evaluates.
        mixture: A proposal from which draws begin.
        rng: The random stream.

    Returns:
        The surface, and a mixture that fits draws of it, with covering components;
        None where walkers on it are no sample.
    """
    posterior = evaluator.posterior
    d, prior, width = posterior.ndim, posterior.prior, posterior.row_size
    degree = max(k for k in DEGREES if comb(d + k, k) <= MOST_TERMS)

    def solve(theta: Floats) -> Floats:
        stacked = evaluator.stack(theta, "deviations")
        return np.hstack([stacked[:, :2], stacked[:, width:]])

    terms = comb(d + degree, degree)
    points: list[Floats] = []
    values: list[Floats] = []
    for _ in range(MOST_FIRST_DRAWS):
        drawn = mixture.draw(rng, SOLVES_PER_TERM * terms)
        points.append(drawn[np.isfinite(prior.logpdf(drawn))])
        values.append(solve(points[-1]))
        theta, solved = np.vstack(points), np.vstack(values)
        if np.isfinite(solved).all(axis=1).sum() > terms:
            break
    else:  # polynomials through every point say nothing of their error
        return None
    for _ in range(SURFACE_ROUNDS):
        surface = fit_surface(prior, theta, solved, degree)
        walkers = _walk(surface, mixture, rng, 1)
        theta = np.vstack([theta, *walkers])
        solved = np.vstack([solved, solve(np.vstack(walkers))])
    surface = fit_surface(prior, theta, solved, degree)
    for _ in range(FITS):
        walked = _walk(surface, mixture, rng, SURFACE_KEPT)
        try:
            fits = [Mixture.fit(x, "auto", DF) for x in walked]
        except ValueError:  # nearly all walkers are at one place, or far from any solve
            return None
        # Without their own wide components, which would join separate modes.
        fits = [uncover(fit, 1) if len(fit.weights) > 1 else fit for fit in fits]
        weights = [
            share * fit.weights
            for share, fit in zip(TEMPERATURE_SHARES, fits, strict=True)
        ]
        means = np.vstack([fit.means for fit in fits])
        matrices = np.concatenate([fit.matrices for fit in fits])
        mixture = cover(Mixture(np.concatenate(weights), means, matrices, DF))
    return surface, mixture


def _walk(
    surface: ResponseSurface, mixture: Mixture, rng: np.random.Generator, kept: int
) -> list[Floats]:
    """Return draws ``(n, d)`` of a surface at each temperature, by walkers on it."""
    x = mixture.draw(rng, CHEAP)
    log_c, log_q = surface(x), mixture.log_density(x)
    independent = IndependenceMove(
        mixture.weights, mixture.means, mixture.matrices, mixture.df
    )
    moves = [(independent, INDEPENDENT), (DEMCMove(), 1.0 - INDEPENDENT)]
    drawn = []

    def heat(theta: Floats, hot: float) -> Floats:
        return surface(theta) / hot

    for hot in SURFACE_TEMPERATURES:
        size = SURFACE_SOLVES // len(SURFACE_TEMPERATURES)
        start = x[resample(softmax(log_c / hot - log_q), size, rng.random())]
        sampler = emcee.EnsembleSampler(
            *start.shape, heat, args=[hot], moves=moves, vectorize=True
        )
        sampler.random_state = np.random.RandomState(rng.integers(2**31)).get_state()
        # Starts may coincide, until independent proposals part them.
        steps = SURFACE_STEPS + SURFACE_THIN * (kept - 1)
        sampler.run_mcmc(start, steps, skip_initial_state_check=True)
        drawn.append(
            sampler.get_chain(
                discard=SURFACE_STEPS - SURFACE_THIN, thin=SURFACE_THIN, flat=True
            )
        )
    return drawn


def _coordinates(prior: Prior, logs: NDArray[np.bool_]) -> Coordinates:
    return Coordinates(prior, logs, np.zeros_like(logs))
