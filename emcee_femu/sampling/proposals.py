"""Adaptive importance sampling: a proposal refined by the weights of its own draws."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import TypeAlias

import numpy as np
from scipy.special import logsumexp, softmax

from ..contracts import Floats
from ..moves.mixture import Mixture
from .importance import FAIR_SHARE, GOOD_K, find_acceptance, kish_share, pareto_k

REFINING_ROUNDS = 12
GOOD_SHARE = 0.9  # effective share of a round's draws that ends the refinement
HIGH_SHARE = 0.8  # where a heavy tail counts little
FAIR_K = 0.4  # of a tail that is not heavy
DFS = (3.0, 5.0, 8.0, 16.0, 50.0)
MOST_REFINED = 30
NEW_WEIGHT = 0.2
STRESSED = 10  # iterations
LACK, CARRIES = 2.5, 1e-5  # ln(p / q) that is let pass, share of draws that it counts
COVERS = ((0.05, 1.5), (0.05, 3.0))  # weights and widths of those that fill gaps
MOST_ADDED = 0.35  # weight of all components that are added at once
# The variance of a parameter is known where its ten largest terms hold no more of it
# (a Gaussian's hold .06 of 1,500 draws); else what carries it gets a component, of so
# much weight, about draws whose ln(p / q) is above what a good proposal leaves.
TERMS, HELD_BY_TERMS, CARRIER_WEIGHT, CARRIER_LACK = 10, 0.08, 0.02, 0.3
CARRIER_RIDGE = 0.3  # of the nearest component, in its matrix
# Rounds of these, and their draws by those of a round of the refinement: they are of
# the new components alone, which are little of a mixture.
CARRYING_ROUNDS, CARRYING_SHARE = 4, 1 / 3
FEWEST_OF_KURTOSIS = 100  # effective draws: it comes from a few of them
RELEVANT = 8.0  # a draw whose log-weight is so far below the largest carries no mass

# Draws from a mixture, and evaluates: draws (size, d) and their rows.
Component: TypeAlias = tuple[float, Floats, Floats]  # weight, mean (d,), matrix (d, d)
Propose: TypeAlias = Callable[[Mixture, int], tuple[Floats, Floats]]


class Draws:
    r"""All draws so far, weighted as if they came from the mixture of all proposals.

    .. math:: w(x) = \frac{p(x)}{\sum_t n_t q_t(x) / \sum_t n_t}

    Source: Cornuet, Marin, Mira and Robert (2012),
    doi:10.1111/j.1467-9469.2011.00756.x.

    Attributes:
        x: Draws of finite log-posterior, ``(n, d)``.
        log_p: Their log-posteriors.
        log_q: ln of the sum over the proposals of n_t q_t; the first is the prior.

    Args:
        x: Draws of the prior.
        rows: Their rows.
    """

    def __init__(self, x: Floats, rows: Floats) -> None:
        possible = np.isfinite(rows[:, 0])
        self.x, self.log_p = x[possible], rows[possible, 0]
        self.log_q: Floats = np.log(len(x)) + rows[possible, 1]
        self._from_prior = len(x)
        self._proposals: list[tuple[int, Mixture]] = []

    def add(self, x: Floats, rows: Floats, mixture: Mixture) -> None:
        """Add draws of another proposal."""
        n = len(x)
        self.log_q = np.logaddexp(self.log_q, np.log(n) + mixture.log_density(self.x))
        self._proposals.append((n, mixture))
        possible = np.isfinite(rows[:, 0])
        x, log_q = x[possible], np.log(self._from_prior) + rows[possible, 1]
        for count, other in self._proposals:
            log_q = np.logaddexp(log_q, np.log(count) + other.log_density(x))
        self.x = np.vstack([self.x, x])
        self.log_p = np.append(self.log_p, rows[possible, 0])
        self.log_q = np.append(self.log_q, log_q)

    @property
    def log_weights(self) -> Floats:
        """The logarithms of w, up to a constant."""
        return np.asarray(self.log_p - self.log_q)

    @property
    def shares(self) -> Floats:
        """The weights, which sum to one."""
        return np.asarray(softmax(self.log_weights))

    @property
    def log_evidence(self) -> float:
        """The log evidence, for log_q counts the draws."""
        return float(logsumexp(self.log_weights))

    @property
    def effective(self) -> float:
        """So many equal weights would know a mean as well."""
        return len(self.x) * kish_share(self.log_weights)

    def kurtosis(self) -> Floats:
        """Return that of each parameter; 0 where few draws weigh, or it is constant."""
        shares = self.shares
        squares = (self.x - shares @ self.x) ** 2
        second, fourth = shares @ squares, shares @ squares**2
        known = (second > 0) & (self.effective > FEWEST_OF_KURTOSIS)
        return np.divide(fourth, second**2, out=np.zeros_like(second), where=known)

    def lack(self, mixture: Mixture) -> Floats:
        """Return ln(p / q) of each draw, p normalised."""
        log_q = mixture.log_density(self.x)
        return np.asarray(self.log_p - self.log_evidence - log_q)

    def effective_share(self, mixture: Mixture) -> float:
        """Return what the effective share of draws of a mixture would be."""
        excess = self.log_p - mixture.log_density(self.x)
        top = excess.max()
        ratio = np.exp(excess - top)
        # E_q[w]^2 / E_q[w^2] = Z / E_p[p / q]
        return float(np.exp(self.log_evidence - top) / (self.shares @ ratio))


class Trial:
    """A proposal, judged by fresh draws of it.

    Args:
        mixture: The proposal.
        theta: Its draws ``(n, d)``.
        rows: Their rows.

    Attributes:
        log_q: The log density of the mixture at each.
        log_weights: ln(p / q) of each.
        pareto_k: Of the weights.
        efficiency: Their effective share.
        log_evidence: By importance sampling.
    """

    def __init__(self, mixture: Mixture, theta: Floats, rows: Floats) -> None:
        self.mixture, self.theta, self.rows = mixture, theta, rows
        self.log_q = mixture.log_density(theta)
        self.log_weights = rows[:, 0] - self.log_q
        self.pareto_k = pareto_k(self.log_weights)
        self.efficiency = kish_share(self.log_weights)
        self.log_evidence = float(logsumexp(self.log_weights)) - np.log(len(theta))

    @property
    def narrow(self) -> bool:
        """Whether it lacks part of the posterior; nearly equal weights do not."""
        return self.pareto_k > GOOD_K and self.efficiency < FAIR_SHARE

    @property
    def acceptance(self) -> float:
        """The acceptance of independence proposals in equilibrium."""
        return find_acceptance(self.rows[:, 0], self.log_q, self.log_q)


def refine(
    draws: Draws, mixture: Mixture, size: int, most: int, propose: Propose
) -> Mixture:
    """Return the mixture after rounds of drawing from it, weighting and fitting.

    Args:
        draws: What was drawn before; it is added to.
        mixture: The first proposal, without covering components.
        size: Draws of a round at least; later rounds have more.
        most: Draws after which no round begins.
        propose: What draws and evaluates.

    Returns:
        The proposal of the last round, with its covering components.
    """
    rounds: list[Trial] = []
    for number in range(REFINING_ROUNDS):
        wide = cover(mixture)
        trial = Trial(wide, *propose(wide, size * max(2, number) // 2))
        draws.add(trial.theta, trial.rows, wide)
        rounds.append(trial)
        shares = [past.efficiency for past in rounds]
        # As good as can be, or two rounds without a gain and no heavy tail that counts.
        settled = number > 2 and max(shares[-2:]) < 1.05 * max(shares[:-2])
        enough = settled and (trial.pareto_k < FAIR_K or shares[-1] > HIGH_SHARE)
        spent = sum(len(past.theta) for past in rounds)
        if not len(draws.x) or spent >= most:
            break
        good = shares[-1] > GOOD_SHARE or enough
        if good and draws.lack(wide)[draws.shares > CARRIES].max() < LACK:
            break
        mixture = _refit(draws, mixture)
    return wide


def add_components(mixture: Mixture, added: Sequence[Component]) -> Mixture:
    """Return a mixture with more components: weights, means and matrices."""
    weights, means, matrices = map(np.array, zip(*added, strict=True))
    weights = weights * min(1.0, MOST_ADDED / weights.sum())
    return Mixture(
        np.append((1 - weights.sum()) * mixture.weights, weights),
        np.vstack([mixture.means, means]),
        np.concatenate([mixture.matrices, matrices]),
        mixture.df,
    )


def extend(
    draws: Draws, mixture: Mixture, added: Sequence[Component], n: int, propose: Propose
) -> Mixture:
    """Return a covered mixture with more components, after draws of these alone."""
    weights, means, matrices = map(np.array, zip(*added, strict=True))
    alone = Mixture(weights / weights.sum(), means, matrices, mixture.df)
    draws.add(*propose(alone, n), alone)
    return cover(add_components(uncover(mixture), added))


def carry(
    draws: Draws, mixture: Mixture, size: int, propose: Propose, heavy: float
) -> Mixture:
    """Return a proposal with components, so heavy, where few draws carry a variance."""
    weight = heavy * CARRIER_WEIGHT
    for _ in range(CARRYING_ROUNDS):
        carriers = [(weight, *place) for place in _carriers(draws, mixture)]
        if not carriers:
            break
        number = round(CARRYING_SHARE * size)
        mixture = extend(draws, mixture, carriers, number, propose)
    return mixture


def _carriers(draws: Draws, mixture: Mixture) -> Iterator[tuple[Floats, Floats]]:
    """Yield mean and matrix of draws that carry the variance of a parameter."""
    x, shares = draws.x, draws.shares
    if len(x) <= TERMS:
        return
    lack = draws.lack(mixture)
    squares = shares[:, None] * (x - shares @ x) ** 2
    for terms in squares.T:
        held = np.partition(terms, -TERMS)[-TERMS:].sum()
        if held <= HELD_BY_TERMS * terms.sum():  # of one draw with all mass, both 0
            continue
        part = np.where(lack > CARRIER_LACK, terms, 0.0)
        if not part.sum() > 0:
            continue
        part /= part.sum()
        mean = part @ x
        nearest = np.argmin(mixture.squared_distances(mean[None])[0])
        centred = x - mean
        matrix = (part * centred.T) @ centred
        matrix += CARRIER_RIDGE * mixture.matrices[nearest]
        yield mean, matrix


def cover(mixture: Mixture) -> Mixture:
    """Return a mixture with wide components, for gaps between others and for tails."""
    mean = mixture.weights @ mixture.means
    apart = mixture.means - mean
    spread = (mixture.weights * apart.T) @ apart * (mixture.df - 2) / mixture.df
    wide = np.einsum("k,kij->ij", mixture.weights, mixture.matrices) + spread
    added = [(weight, mean, width**2 * wide) for weight, width in COVERS]
    return add_components(mixture, added)


def uncover(mixture: Mixture, wide: int = len(COVERS)) -> Mixture:
    """Return the mixture without its last components, which are wide."""
    weights = mixture.weights[:-wide]
    return replace(
        mixture,
        weights=weights / weights.sum(),
        means=mixture.means[:-wide],
        matrices=mixture.matrices[:-wide],
    )


def _refit(draws: Draws, mixture: Mixture) -> Mixture:
    """Return the mixture that fits the weighted draws best, by Akaike's criterion."""
    shares = draws.shares
    # Truncated, so that one draw where the mixture lacks mass does not outweigh all
    # others (Ionides 2008, doi:10.1198/106186008X320456).
    shares = np.minimum(shares, len(shares) ** -0.5)
    shares /= shares.sum()
    use = shares > 1e-12 * shares.max()
    x, shares = draws.x[use], shares[use]
    size, d = 1.0 / np.sum(shares**2), x.shape[1]
    candidates = []
    for df in DFS:
        other = replace(mixture, df=df)
        candidates.append((-2 * size * float(shares @ other.log_density(x)), other))
    for fitted, gained in _fits(x, shares, draws.log_p[use], mixture):
        parameters = len(fitted.weights) * (1 + d + d * (d + 1) / 2)
        candidates.append((2 * parameters - 2 * size * gained, fitted))
    chosen = min(candidates, key=lambda pair: pair[0])[1]

    def share(fitted: Mixture) -> float:
        return draws.effective_share(cover(fitted))

    tails = [replace(chosen, df=df) for df in DFS]
    # In many dimensions a fit looks better by its own draws than it is.
    if chosen.means is mixture.means and max(map(share, tails)) > HIGH_SHARE:
        return max(tails, key=share)
    # By the effective share, which regions of large weights spoil most: EM on weights
    # that stress them brings the mixture nearer to its largest effective share.
    excess = draws.log_p[use] - chosen.log_density(x)
    stressed = shares * np.exp(0.5 * (excess - excess.max()))
    again = chosen.improve(x, stressed / stressed.sum(), STRESSED)[0]
    tails += [replace(again, df=df) for df in DFS]
    return max(tails, key=share)


def _fits(
    x: Floats, shares: Floats, log_p: Floats, mixture: Mixture
) -> Iterator[tuple[Mixture, float]]:
    """Yield the fit, and one with a component more where the mixture lacks most."""
    fitted, gained = mixture.improve(x, shares)
    yield fitted, gained
    if len(fitted.weights) >= MOST_REFINED:
        return
    relevant = np.log(shares / shares.max()) > -RELEVANT
    lacking = np.where(relevant, log_p - fitted.log_density(x), -np.inf)
    place = x[np.argmax(lacking)]
    nearest = np.argmin(fitted.squared_distances(place[None])[0])
    near = fitted.matrices[nearest]
    distances = ((x - place) @ np.linalg.inv(fitted.factors[nearest]).T) ** 2
    order = np.argsort(distances.sum(axis=1))
    enough = np.searchsorted(np.cumsum(shares[order]), 0.1)
    some = order[: max(int(enough), 3 * x.shape[1])]
    share = 0.5 * shares[some] / shares[some].sum() + 0.5 / len(some)
    centred = x[some] - place
    matrix = (share * centred.T) @ centred + 0.01 * near
    yield add_components(fitted, [(NEW_WEIGHT, place, matrix)]).improve(x, shares)
