"""The chain of an emulated posterior, and what draws of it solved in full tell."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.special import expit

from ...contracts import Floats, Prior
from ...results.arviz_objects import InferenceData, dataset, is_weighted
from ...results.chains import read_chains
from ...results.diagnose import diagnose
from ...search.climbing import Maximum
from ...search.coordinates import Coordinates
from ...verdict.statistics import effective_sizes, mean_sizes, size_by_means
from .certificate import FOUND, MISSED_SHARE

GAPS = 1.5  # in largest gaps between draws: beyond all of them
GAP_DRAWS = 2_000  # draws of the chain that are compared
ALONE = 1e-9  # weight of all other draws, below which one has no spread
PRIOR_FREE_DRAWS = 20_000  # which cost no solve
LEFT_OUT = 0.01  # share of the prior outside the emulator's bounds that is accepted
# Standard deviations from a bound; share of draws there.
NEAR_A_BOUND, PRESSED = 0.1, 0.005


class EmulatedChain:
    """What an ArviZ object holds of the emulated posterior.

    Args:
        idata: The ArviZ object.
        prior: That of the true posterior.
        rng: Puts walkers in random order at each step.

    Attributes:
        idata: The ArviZ object.
        searched: Whether "auto" sampled it, which knows an evidence.
        names: Parameter names, ``d`` of them.
        draws: All draws, step by step, ``(n, d)``.
        log_posterior: The emulated log-posterior there, ``(n,)``.
        coordinates: Logarithms of positive parameters, in which distances are.
        x: Those of all draws, ``(n, d)``.
        root: The Cholesky factor of their covariance, ``(d, d)``.
        bounds: Of the emulated posterior's prior, ``(d, 2)``.
        size: As many independent draws would know the centre as well, the worst
            parameter's.
        mean_sizes: The same for each parameter's mean and mean square, ``(2, d)``.

    Raises:
        ValueError: If idata lacks the bounds, or is not a chain but what an earlier
            certificate corrected.
    """

    def __init__(
        self, idata: InferenceData, prior: Prior, rng: np.random.Generator
    ) -> None:
        if is_weighted(idata):
            raise ValueError(
                "idata: expected draws of the emulated posterior, got those that a "
                "certificate has weighted; give it the object that you certified"
            )
        chains = read_chains(idata)
        self.idata, self.names = idata, chains.names
        self.searched = chains.search is not None
        n, _, _, d = chains.draws.shape
        by_step = chains.draws.reshape(n, -1, d)
        m, steps = by_step.shape[1], np.arange(n)[:, None]
        order = rng.permuted(np.tile(np.arange(m), (n, 1)), axis=1)
        self.draws: Floats = by_step[steps, order].reshape(-1, d)
        self.log_posterior = chains.log_prob.reshape(n, m)[steps, order].ravel()
        self.coordinates = Coordinates.positive(prior)
        self.x = self.coordinates.coordinates(self.draws)
        scale = np.atleast_2d(np.cov(self.x, rowvar=False))
        self.root = np.linalg.cholesky(scale + 1e-12 * np.diag(np.diag(scale)))
        constant = dataset(idata, "constant_data").reindex(parameter=list(self.names))
        self.bounds: Floats = constant[["lower", "upper"]].to_array().values.T
        by_walker = by_step.swapaxes(0, 1)
        bulk = effective_sizes(by_walker)[0]
        mean_size: Callable[[Floats], Floats] = mean_sizes
        if len(chains.betas) > 1:
            # Exchanges hand states over, which walker by walker look independent.
            bulk, mean_size = diagnose(idata).ess_bulk, size_by_means
            by_walker = chains.draws
        both = by_walker, (by_walker - self.draws.mean(axis=0)) ** 2
        # At least one; NaN is that of a chain too short.
        sizes = np.fmax(np.nan_to_num([bulk, *map(mean_size, both)], nan=1.0), 1.0)
        self.size, self.mean_sizes = float(min(sizes[0].min(), m * n)), sizes[1:]

    def whiten(self, theta: Floats) -> Floats:
        """Transform points ``(n, d)`` so that the draws have unit covariance."""
        x = self.coordinates.coordinates(theta)
        return np.asarray(np.linalg.solve(self.root, (x - self.x.mean(0)).T).T)

    def distance(self, theta: Floats) -> Floats:
        """Return how far points ``(n, d)`` are from draws, in their largest gaps."""
        some = np.unique(self.draws[:: -(-len(self.draws) // GAP_DRAWS)], axis=0)
        tree = cKDTree(self.whiten(some))
        gaps = tree.query(tree.data, k=2)[0][:, 1]
        return np.asarray(tree.query(self.whiten(theta))[0] / (GAPS * gaps.max()))

    def choose(
        self, n: int, rng: np.random.Generator
    ) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Return places of at most ``n`` different draws at equal intervals.

        Every draw of the chain is as likely to be taken as any other. A walker that
        stood still may be met again: its draw is solved once and counts as often as it
        was met, which is returned too.
        """
        total = len(self.draws)
        n = min(n, total)
        places = ((rng.random() + np.arange(n)) * total / n).astype(int)
        places = np.minimum(places, total - 1)
        _, first, counts = np.unique(
            self.draws[places], axis=0, return_index=True, return_counts=True
        )
        return places[first], counts

    def excess(self, n: int) -> float:
        """Return by how much a mean of n draws varies more than of independent ones.

        ``coth(size / n)`` is exact for draws at equal distances of an AR(1) chain that
        is worth ``size`` independent ones.
        """
        return float(1 / np.tanh(self.size / n))


def correct_moments(
    chain: EmulatedChain, theta: Floats, shares: Floats, weights: Floats
) -> Floats:
    r"""Return means and sds of the true posterior with standard errors, ``(5, d)``.

    .. math:: \hat f = \overline f + \sum_i (w_i - c_i) f_i

    with means over the whole chain, and the shares of the solved draws as draws of the
    emulated posterior, c, and of the true one, w: where all weights are equal it is the
    mean over the chain. Where that is out of bounds it is the mean by the weights
    alone. A standard deviation is NaN where one draw has all the weight. Last is the
    standard error of its difference from that of the chain.

    Args:
        chain: Of the emulated posterior.
        theta: The draws that were solved in full, ``(n, d)``.
        shares: c, ``(n,)``.
        weights: w, ``(n,)``.
    """
    n, centre = len(theta), chain.draws.mean(axis=0)
    moved = (weights - shares)[:, None]
    # First and second powers about the centre: means, and the influence of each draw.
    solved = np.stack([theta - centre, (theta - centre) ** 2])
    whole = np.stack([chain.draws - centre, (chain.draws - centre) ** 2])
    (low, high), mean = chain.bounds.T, centre + (moved * solved[0]).sum(axis=0)
    outside = (mean < low) | (mean > high)
    moved = np.where(outside, weights[:, None], moved)
    whole = np.where(outside, 0.0, whole)
    shift, squares = moments = whole.mean(axis=1) + (moved * solved).sum(axis=1)
    by_draws = moved * (solved - moments[:, None])
    by_chain = (whole - moments[:, None]) / np.sqrt(chain.mean_sizes)[:, None]

    def error(by_draws: Floats, by_chain: Floats) -> Floats:
        square = chain.excess(n) * (by_draws**2).sum(axis=0) * n / max(n - 1, 1)
        return np.asarray(np.sqrt(square + by_chain.var(axis=0)))

    mean_error = error(by_draws[0], by_chain[0])
    variance = squares - shift**2 + mean_error**2
    left = 1 - (weights**2).sum()
    if left > ALONE:  # of the weighted draws alone
        alone = weights @ (theta - weights @ theta) ** 2 / left
        variance = np.where(variance > 0, variance, alone)
    sd = np.sqrt(np.where(variance > 0, variance, np.nan))
    draws, chains = ((b[1] - 2 * shift * b[0]) / (2 * sd) for b in (by_draws, by_chain))
    errors = error(draws, chains), error(draws, np.zeros_like(chains))
    return np.array([centre + shift, mean_error, sd, *errors])


def compare_bounds(chain: EmulatedChain, prior: Prior) -> list[str]:
    """Return what is wrong with the emulated posterior's bounds, without a solve."""
    faults = []
    theta = prior.sample(np.random.default_rng(0), PRIOR_FREE_DRAWS)
    low, high = chain.bounds.T
    left_out = 1 - ((theta >= low) & (theta <= high)).all(axis=1).mean()
    if left_out > LEFT_OUT:
        faults.append(
            f"the emulated posterior's bounds leave out {100 * left_out:.2g} % of the "
            "prior, where the emulator knows nothing; emulate within the prior's, or "
            "certify against a posterior whose prior is cut at the emulator's"
        )
    near = NEAR_A_BOUND * chain.draws.std(axis=0)
    for end, sign in ((0, 1.0), (1, -1.0)):
        bounds = sign * chain.bounds[:, end]
        pressed = (sign * chain.draws < bounds + near).mean(axis=0)
        narrower = bounds > sign * prior.bounds[:, end] + NEAR_A_BOUND * near
        for i in np.flatnonzero(narrower & (pressed > PRESSED)):
            faults.append(
                f"the draws press against {chain.names[i]} = "
                f"{chain.bounds[i, end]:.5g} ({100 * pressed[i]:.2g} % of them within "
                f"{NEAR_A_BOUND:g} standard deviations), where the emulator ends but "
                "the prior does not; emulate within wider bounds"
            )
    return faults


def find_missed(
    chain: EmulatedChain,
    maxima: list[Maximum],
    theta: Floats,
    log_posterior: Floats,
    weights: Floats,
) -> tuple[str, ...]:
    """Return the most obvious maximum that climbs found and draws lack.

    Args:
        chain: Of the emulated posterior.
        maxima: Of the true one, where climbs ended.
        theta: The solved draws, ``(n, d)``.
        log_posterior: The true log-posterior there, ``(n,)``.
        weights: Their shares of the true posterior, ``(n,)``.
    """
    d = chain.draws.shape[1]
    log_volume = 0.5 * d * (1 + np.log(2 * np.pi)) + np.log(np.diag(chain.root)).sum()
    volume = chain.coordinates.log_volume(chain.coordinates.coordinates(theta))
    heights = np.where(weights > 0, log_posterior + volume, 0.0)
    log_evidence = float(weights @ heights) + log_volume  # of a Gaussian

    def place(top: Maximum) -> Floats:
        return np.asarray(chain.coordinates.parameters(top.theta[None])[0])

    def name(top: Maximum) -> str:
        pairs = zip(chain.names, place(top).tolist(), strict=True)
        return ", ".join(f"{name} = {value:.5g}" for name, value in pairs)

    for top in maxima:
        share = expit(top.log_evidence - log_evidence)
        # One that has not arrived is on its way, perhaps to what is known.
        if share < MISSED_SHARE or not top.converged:
            continue
        steps, precision = chain.x - top.theta, np.linalg.inv(top.covariance)
        squares = (steps @ precision * steps).sum(axis=1)
        if (squares < d + 4 * np.sqrt(d)).mean() < FOUND * share:
            return (
                f"a maximum of the true posterior is at {name(top)}, "
                f"about {100 * share:.0f} % of it by Laplace's approximation, where "
                "the emulated one has hardly a draw; emulate with a start there",
            )
    middle = np.median(log_posterior + volume)
    for top in sorted(maxima, key=lambda top: -top.log_posterior):
        if top.log_posterior > middle and chain.distance(place(top)[None])[0] > 1:
            return (
                "far from all draws of the emulated posterior, at "
                f"{name(top)}, the true one is as high as at half of them; emulate "
                "with a start there",
            )
    return ()
