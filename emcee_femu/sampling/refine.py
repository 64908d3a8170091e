"""Adaptive importance sampling: a proposal refined by the weights of its own draws."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np
from scipy.special import logsumexp

from ..interfaces import Floats
from ..moves.mixture_em import Mixture, improve, invert_factors, log_density, log_parts
from .importance import kish_share, pareto_k

ROUNDS = 12
GOOD_SHARE = 0.9  # effective share of a round's draws that ends the refinement
HIGH_SHARE = 0.8  # where a heavy tail counts little
FAIR_SHARE, FAIR_K = 0.2, 0.4  # beyond which it may end without
DFS = (3.0, 5.0, 8.0, 16.0, 50.0)
MOST_COMPONENTS = 30
NEW_WEIGHT = 0.2
STRESSED = 10  # iterations
LACK, CARRIES = 2.5, 1e-5  # ln(p / q) that is let pass, share of draws that it counts
COVERS = ((0.05, 1.5), (0.05, 3.0))  # weights and widths of those that fill gaps
RELEVANT = 8.0  # a draw whose log-weight is so far below the largest carries no mass

# Draws from a law, and evaluates: draws (size, d) and their rows.
Propose: TypeAlias = Callable[[Mixture, int], tuple[Floats, Floats]]


@dataclass
class Draws:
    r"""All draws so far, weighted as if they came from the mixture of all their laws.

    .. math:: w(x) = \frac{p(x)}{\sum_t n_t q_t(x) / \sum_t n_t}

    Source: Cornuet, Marin, Mira and Robert (2012),
    doi:10.1111/j.1467-9469.2011.00756.x.

    Attributes:
        x: Draws of finite log-posterior, ``(n, d)``.
        log_p: Their log-posteriors.
        crowd: ln of the sum over the laws of n_t q_t; the first law is the prior.
        laws: Number of draws and mixture, by round.
        from_prior: Number of draws of the prior.
    """

    x: Floats
    log_p: Floats
    crowd: Floats
    from_prior: int
    laws: list[tuple[int, Mixture]] = field(default_factory=list)

    @classmethod
    def of_prior(cls, x: Floats, rows: Floats) -> "Draws":
        """Return the draws of the prior, with their rows."""
        here = np.isfinite(rows[:, 0])
        log_p, log_prior = rows[here, 0], rows[here, 1]
        return cls(x[here], log_p, np.log(len(x)) + log_prior, len(x))

    def add(self, x: Floats, rows: Floats, law: Mixture) -> None:
        """Add draws of another law."""
        n = len(x)
        own = np.log(n) + log_density(self.x, law) if len(self.x) else np.empty(0)
        self.crowd = np.logaddexp(self.crowd, own)
        self.laws.append((n, law))
        here = np.isfinite(rows[:, 0])
        x, log_p, log_prior = x[here], rows[here, 0], rows[here, 1]
        crowd = np.log(max(self.from_prior, 1e-300)) + log_prior
        for count, other in self.laws:
            if len(x):
                crowd = np.logaddexp(crowd, np.log(count) + log_density(x, other))
        self.x = np.vstack([self.x, x])
        self.log_p = np.append(self.log_p, log_p)
        self.crowd = np.append(self.crowd, crowd)

    @property
    def log_weights(self) -> Floats:
        """The logarithms of w, up to a constant."""
        return self.log_p - self.crowd

    @property
    def shares(self) -> Floats:
        """The weights, which sum to one."""
        weights = np.exp(self.log_weights - self.log_weights.max())
        result: Floats = weights / weights.sum()
        return result

    def lack(self, law: Mixture) -> float:
        """Return the largest ln(p / q) of draws that carry mass, p normalised."""
        excess = self.log_p - self._log_evidence() - log_density(self.x, law)
        return float(excess[self.shares > CARRIES].max())

    def _log_evidence(self) -> float:
        return float(logsumexp(self.log_weights))  # the crowd counts the draws

    def effective_share(self, law: Mixture) -> float:
        """Return what the effective share of draws of ``law`` would be."""
        excess = self.log_p - log_density(self.x, law)
        top = excess.max()
        ratio = np.exp(excess - top)
        # E_q[w]^2 / E_q[w^2] = Z / E_p[p / q]
        return float(np.exp(self._log_evidence() - top) / (self.shares @ ratio))


def refine(
    draws: Draws, law: Mixture, size: int, most: int, propose: Propose
) -> Mixture:
    """Return the mixture after rounds of drawing from it, weighting and fitting.

    Args:
        draws: All draws until now; those of each round are added.
        law: Where to start.
        size: Draws per round; later rounds have more.
        most: Draws after which no round begins.
        propose: ``propose(law, size) -> (x, rows)`` draws and evaluates.
    """
    laws: list[Mixture] = []
    shares: list[float] = []
    spent = 0
    for number in range(ROUNDS):
        wide = cover(law)
        x, rows = propose(wide, size * max(2, number) // 2)
        log_weights = rows[:, 0] - log_density(x, wide)
        draws.add(x, rows, wide)
        laws.append(wide)
        shares.append(kish_share(log_weights))
        # As good as can be, or two rounds without a gain and no heavy tail that counts.
        settled = number > 2 and max(shares[-2:]) < 1.05 * max(shares[:-2])
        light = shares[-1] > FAIR_SHARE and pareto_k(log_weights) < FAIR_K
        enough = settled and (light or shares[-1] > HIGH_SHARE)
        spent += len(x)
        if not len(draws.x) or spent >= most:
            break
        if (shares[-1] > GOOD_SHARE or enough) and draws.lack(wide) < LACK:
            break
        law = refit(draws, law)
    # The fits of early rounds know too little to be compared.
    return max(laws[-3:], key=draws.effective_share) if len(draws.x) else law


def cover(law: Mixture) -> Mixture:
    """Return the law with wide components, for gaps between the others and for tails.

    They are the last ones.
    """
    mean = law.weights @ law.means
    apart = law.means - mean
    spread = (law.weights * apart.T) @ apart * (law.df - 2) / law.df
    wide = np.einsum("k,kij->ij", law.weights, law.matrices) + spread
    weights, widths = np.array(COVERS).T
    return law._replace(
        weights=np.append((1 - weights.sum()) * law.weights, weights),
        means=np.vstack([law.means, *[mean] * len(COVERS)]),
        matrices=np.concatenate([law.matrices, widths[:, None, None] ** 2 * wide]),
    )


def uncover(law: Mixture) -> Mixture:
    """Return the law without its wide components."""
    own = slice(-len(COVERS))
    weights = law.weights[own]
    return Mixture(weights / weights.sum(), law.means[own], law.matrices[own], law.df)


def refit(draws: Draws, law: Mixture) -> Mixture:
    """Return the mixture that fits the weighted draws best, by Akaike's criterion.

    To be beaten is the present mixture with other degrees of freedom: in many
    dimensions few draws know the matrices worse than a Laplace approximation does.
    """
    shares = draws.shares
    # Truncated, so that one draw where the law lacks mass does not outweigh all others
    # (Ionides 2008, doi:10.1198/106186008X320456).
    shares = np.minimum(shares, len(shares) ** -0.5)
    shares /= shares.sum()
    use = shares > 1e-12 * shares.max()
    x, shares = draws.x[use], shares[use]
    size, d = 1.0 / np.sum(shares**2), x.shape[1]
    found = []
    for df in DFS:
        other = law._replace(df=df)
        found.append((-2 * size * float(shares @ log_density(x, other)), other))
    for fitted, gained in _fit_both(x, shares, draws.log_p[use], law):
        parameters = len(fitted.weights) * (1 + d + d * (d + 1) / 2)
        if size > parameters / len(fitted.weights):
            found.append((2 * parameters - 2 * size * gained, fitted))
    chosen = min(found, key=lambda pair: pair[0])[1]
    # By the effective share, which regions of large weights spoil most: EM on weights
    # that stress them brings the mixture nearer to its largest effective share.
    excess = draws.log_p[use] - log_density(x, chosen)
    stressed = shares * np.exp(0.5 * (excess - excess.max()))
    again = improve(x, stressed / stressed.sum(), chosen, STRESSED)[0]
    laws = [law._replace(df=df) for law in (chosen, again) for df in DFS]
    return max(laws, key=lambda one: draws.effective_share(cover(one)))


def _fit_both(
    x: Floats, shares: Floats, log_p: Floats, law: Mixture
) -> Iterator[tuple[Mixture, float]]:
    """Yield the fit, and one with a component more where the law lacks most mass."""
    fitted, gained = improve(x, shares, law)
    yield fitted, gained
    if len(fitted.weights) >= MOST_COMPONENTS:
        return
    relevant = np.log(shares / shares.max()) > -RELEVANT
    place = x[np.argmax(np.where(relevant, log_p - log_density(x, fitted), -np.inf))]
    near = _nearest_matrix(place, fitted)
    inverse = invert_factors(np.linalg.cholesky(near[None]))[0]
    order = np.argsort((((x - place) @ inverse.T) ** 2).sum(axis=1))
    enough = np.searchsorted(np.cumsum(shares[order]), 0.1)
    some = order[: max(int(enough), 3 * x.shape[1])]
    share = 0.5 * shares[some] / shares[some].sum() + 0.5 / len(some)
    centred = x[some] - place
    matrix = (share * centred.T) @ centred + 0.01 * near
    larger = Mixture(
        np.append((1 - NEW_WEIGHT) * fitted.weights, NEW_WEIGHT),
        np.vstack([fitted.means, place]),
        np.concatenate([fitted.matrices, matrix[None]]),
        fitted.df,
    )
    yield improve(x, shares, larger)


def _nearest_matrix(place: Floats, law: Mixture) -> Floats:
    """Return the scale matrix of the component by which a point is nearest."""
    nearest = np.argmin(log_parts(place[None], law)[1][0])
    matrix: Floats = law.matrices[nearest]
    return matrix
