"""A response surface: polynomials of the parameters, fitted to solves.

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
from ..posterior.log_posterior import LOG_POSTERIOR, LOG_PRIOR
from .coordinates import Coordinates
from .importance import resample
from .proposal import Proposal

# Most terms of a polynomial: it is cubic for 9 to 12 parameters.
MOST_TERMS = 500
# Highest degree of a polynomial.
MOST_DEGREE = 4
# Solves for the first fit, per term of a polynomial.
SOLVES_PER_TERM = 2
# Fits after the first one; also the most attempts to draw for it, if draws are out of
# bounds or fail.
SURFACE_ROUNDS = 5
# Solves for each fit.
SURFACE_SOLVES = 600
# Most solves that a surface takes.
SURFACE_COST = SOLVES_PER_TERM * MOST_TERMS + SURFACE_ROUNDS * SURFACE_SOLVES
# Draws of a mixture from which walkers on a surface start.
CHEAP = 8_000
# Steps of these walkers.
SURFACE_STEPS = 60
# Share of independent proposals among these steps.
INDEPENDENT = 0.3
# Temperatures of walkers on a surface, with equal shares in the proposal. Hot ones see
# tails that draws of the posterior hardly meet, where a walker would stay long.
SURFACE_TEMPERATURES = (1.0, 2.0, 4.0)
HOTTEST = max(SURFACE_TEMPERATURES)
# Weight of a point at least: if few points had any, each would be fitted exactly, and
# nothing could be said of its error.
LEAST_WEIGHT = 1e-4
# Ridge that draws coefficients to zero, relative to one point.
COEFFICIENT_RIDGE = 1e-6


@dataclass(frozen=True, eq=False, repr=False)
class ResponseSurface:
    r"""Polynomials of all deviations, of the logs of their errors, and of the rest.

    .. math:: \ln c(\theta) = \ln p(\theta) + \sum_i \ln N(\hat r_i; 0, \hat\sigma_i)
        + \hat\ell(\theta)

    with the prior p itself. Called with ``theta (n, d)`` it returns ln c, ``(n,)``.

    Attributes:
        prior: The prior; None if nothing will be evaluated.
        logs: Which parameters are replaced by their logarithms, ``(d,)``.
        centre: Centre of these coordinates, ``(d,)``.
        scale: Unit of these coordinates, ``(d,)``.
        coefficients: Those of r, of ln sd and of the rest, ``(2 m + 1, terms)``.
        degree: Degree of the polynomials.
        most: Largest rest at all solves. It is a limit, since the polynomial may grow
            without bound.
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
        # Far from all solves polynomials run away, to errors of zero too.
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            terms = monomials((x - self.centre) / self.scale, self.degree)
            *pairs, rest = self.coefficients @ terms
            r, log_sd = np.split(np.array(pairs), 2)
            likelihood = log_normal(r, np.exp(log_sd)).sum(axis=0)
            likelihood += np.minimum(rest, self.most)
        values[inside] += np.nan_to_num(likelihood, nan=-np.inf, neginf=-np.inf)
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
        degree: Degree of the polynomials.
    """
    possible = np.isfinite(solved).all(axis=1)
    theta, solved = theta[possible], solved[possible]
    d = theta.shape[1]
    log_p, log_prior = solved[:, LOG_POSTERIOR], solved[:, LOG_PRIOR]
    both = np.delete(solved, [LOG_POSTERIOR, LOG_PRIOR], axis=1)
    r, sd = np.split(both, 2, axis=1)
    rest = log_p - log_prior - log_normal(r, sd).sum(axis=1)
    targets = np.column_stack([r, np.log(sd), rest])
    units = np.column_stack([sd, np.ones_like(sd), np.ones_like(rest)])
    # Points weigh less if they are lower than walkers at the highest temperature are
    # on average: by half of it for each parameter, as for a Gaussian.
    below = np.maximum(log_p.max() - log_p - HOTTEST / 2 * d, 0.0)
    weights = np.maximum(np.exp(-below / HOTTEST), LEAST_WEIGHT)[:, None]
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


def degree_of(d: int) -> int:
    """Return the degree of polynomials of d parameters; 0 if there are too many."""
    degrees = range(1, MOST_DEGREE + 1)
    return max((k for k in degrees if comb(d + k, k) <= MOST_TERMS), default=0)


def learn_surface(
    evaluator: Evaluation, law: Mixture, rng: np.random.Generator
) -> tuple[ResponseSurface, Proposal] | None:
    """Return a surface that is refined where its own draws are, and what proposes.

    Args:
        evaluator: Evaluates the posterior.
        law: A proposal from which draws begin.
        rng: The random stream.

    Returns:
        The surface, and a proposal that fits draws of it; None where walkers on it are
        no sample.
    """
    d, prior = evaluator.posterior.ndim, evaluator.posterior.prior
    degree = degree_of(d)
    if (first := _solve_first(evaluator, law, rng, comb(d + degree, degree))) is None:
        return None
    theta, solved = first
    for _ in range(SURFACE_ROUNDS):
        surface = fit_surface(prior, theta, solved, degree)
        new = np.vstack(_walk(surface, law, rng, SURFACE_SOLVES))
        theta = np.vstack([theta, new])
        solved = np.vstack([solved, _solve(evaluator, new)])
    surface = fit_surface(prior, theta, solved, degree)
    try:
        # A fit's own wide component would join separate maxima.
        fits = [
            Mixture.fit(law.coordinates(x), "auto", covered=False)
            for x in _walk(surface, law, rng, CHEAP)
        ]
    except ValueError:  # nearly all walkers are at one place, or far from any solve
        return None
    weights = np.concatenate([fit.weights for fit in fits]) / len(fits)
    means = np.vstack([fit.means for fit in fits])
    matrices = np.concatenate([fit.matrices for fit in fits])
    proposal = Proposal.fitted(Mixture(weights, means, matrices, logs=law.logs))
    return surface, proposal


def _solve(evaluator: Evaluation, theta: Floats) -> Floats:
    """Return log-posteriors, log-priors, deviations and standard deviations."""
    stacked = evaluator.stack(theta, "deviations")
    densities = stacked[:, [LOG_POSTERIOR, LOG_PRIOR]]
    return np.hstack([densities, stacked[:, evaluator.posterior.row_size :]])


def _solve_first(
    evaluator: Evaluation, law: Mixture, rng: np.random.Generator, terms: int
) -> tuple[Floats, Floats] | None:
    """Return draws of a law and their solves: more that succeed than there are terms.

    None if there are not so many: polynomials through every point say nothing of their
    error.
    """
    points: list[Floats] = []
    values: list[Floats] = []
    for _ in range(SURFACE_ROUNDS):
        drawn = law.draw(rng, SOLVES_PER_TERM * terms)
        inside = np.isfinite(evaluator.posterior.prior.logpdf(drawn))
        points.append(drawn[inside])
        values.append(_solve(evaluator, points[-1]))
        theta, solved = np.vstack(points), np.vstack(values)
        if np.isfinite(solved).all(axis=1).sum() > terms:
            return theta, solved
    return None


def _walk(
    surface: ResponseSurface, law: Mixture, rng: np.random.Generator, number: int
) -> list[Floats]:
    """Return draws of a surface at each temperature, by so many walkers on it."""
    x = law.draw(rng, CHEAP)
    log_c, log_q = surface(x), law.log_density(x)
    independent = IndependenceMove(
        law.weights, law.means, law.matrices, law.df, law.logs
    )
    moves = [(independent, INDEPENDENT), (DEMCMove(), 1.0 - INDEPENDENT)]
    drawn = []

    def heat(theta: Floats, hot: float) -> Floats:
        return surface(theta) / hot

    for hot in SURFACE_TEMPERATURES:
        size = number // len(SURFACE_TEMPERATURES)
        start = x[resample(softmax(log_c / hot - log_q), size, rng.random())]
        sampler = emcee.EnsembleSampler(
            *start.shape, heat, args=[hot], moves=moves, vectorize=True
        )
        sampler.random_state = np.random.RandomState(rng.integers(2**31)).get_state()
        # Starts may coincide, until independent proposals part them.
        state = sampler.run_mcmc(
            start, SURFACE_STEPS, skip_initial_state_check=True, store=False
        )
        drawn.append(state.coords)
    return drawn


def _coordinates(prior: Prior, logs: NDArray[np.bool_]) -> Coordinates:
    return Coordinates(prior, logs, np.zeros_like(logs))
