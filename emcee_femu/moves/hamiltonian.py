"""Hamiltonian Monte Carlo: trajectories along gradients, for many parameters."""

from collections.abc import Callable
from typing import NamedTuple, Self, TypeAlias

import numpy as np
from emcee import State
from emcee.model import Model
from emcee.moves import Move
from numpy.random import Generator
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtri

from .. import checks
from ..contracts import LOG_POSTERIOR, Floats, split_rows
from .proposing import Indices, ProposingMove, check_state, refresh

JITTER = 0.2  # of the step size, so that trajectories do not return to their start
# Share of trajectories with steps down to a thirtieth: far from the posterior, in
# valleys that are narrower than it, no other would be accepted.
CAREFUL, LEAST_STEP = 0.1, 1 / 30
# Of the tuning.
FEWEST_TUNED = 8  # samples
BEST_ACCEPTANCE = 0.8  # target acceptance of the step size
TUNING_ROUNDS = 5  # of trajectories that adjust the step size
RECORDED = 4  # trajectories that determine the number of steps
FIRST_STEP = 0.4  # step size of the first round
LONGEST = 3.3  # sum of the steps: half a period of the slowest oscillation, if it fits
MOST_LEAPS = 64  # steps, should the metric fit badly

# Points (k, d) to rows (k, columns), which begin with the log density, and its
# gradients (k, d).
Evaluate: TypeAlias = Callable[[Floats], tuple[Floats, Floats]]


class HamiltonianMove(Move):
    r"""Hamiltonian Monte Carlo: several steps along the gradient of the log-posterior.

    .. math:: u \sim N(0, I), \qquad (\theta^*, u^*) = \text{leapfrog}^{steps}
        (\theta_i, u), \qquad r = \min\left\{1, \frac{p(\theta^*)}{p(\theta_i)}
        e^{(|u|^2 - |u^*|^2) / 2}\right\}

    One step is ``u += h/2 L^T g``, ``theta += h L u``, ``u += h/2 L^T g``, where g is
    the gradient and ``L L^T = metric``. The step size h is drawn for each trajectory
    within 20 % of ``step_size``, so that no trajectory keeps returning to its start.
    For a tenth of the trajectories it is smaller, down to a thirtieth; otherwise a
    walker far out in the tails might never move.

    Use it from about ten parameters on, with a :class:`LogPosterior` whose models have
    a ``jacobian``. A gradient then costs one solve, and a proposal costs ``steps``
    solves. Any other log-probability function needs a method ``gradient(theta (n, d))``
    that returns rows ``(n, columns)``, with the log-probability and its blobs, and
    gradients ``(n, d)``. Walkers move independently of each other, so one walker is
    enough. A trajectory that leaves the bounds, or on which a solve fails, is rejected
    at that point and costs no more.

    No other move is as efficient in many dimensions if the metric is close to the
    posterior's covariance. Take it from a Laplace approximation or from earlier draws,
    ``numpy.cov(draws, rowvar=False)``, and let :meth:`tuned` choose steps and step
    size. The move does not cross between maxima: mix it with one that does. Start it at
    a maximum or after a burn-in, because it is slow from draws of the prior.

    Args:
        metric: Covariance of the posterior ``(ndim, ndim)``, or variances ``(ndim,)``:
            the inverse of the mass matrix. None for the variances of the prior, with
            which many more and smaller steps are needed.
        steps: Leapfrog steps per proposal. With a good metric, choose ``steps *
            step_size`` between 1.5 and 2.5.
        step_size: Mean step size h, in standard deviations of the metric. About 80 % of
            the proposals should be accepted; steps above 2 diverge.

    Raises:
        TypeError: If an argument does not hold numbers. When it proposes: if the
            log-probability function has no gradients.
        ValueError: If the metric is not positive definite, steps or step_size is not
            positive, or (when it proposes) a shape does not match ndim.

    Source: Neal (2011), doi:10.1201/b10905-6.

    Examples:
        >>> from emcee_femu.moves import HamiltonianMove
        >>> HamiltonianMove([4.0], steps=3)
        HamiltonianMove(metric=[4.0], steps=3, step_size=0.25)
    """

    __repr__ = ProposingMove.__repr__

    def __init__(
        self, metric: ArrayLike | None = None, steps: int = 8, step_size: float = 0.25
    ) -> None:
        self.metric = None if metric is None else checks.real_array("metric", metric)
        self.steps = checks.whole_number("steps", steps, 1)
        self.step_size = checks.positive_array("step_size", step_size, 0).item()
        self._factor: Floats | None = None
        if self.metric is not None:
            if not self.metric.size:
                raise ValueError("metric: expected one row per parameter, got none")
            matrix = np.diag(self.metric) if self.metric.ndim == 1 else self.metric
            self._factor = checks.covariance_factor("metric", matrix)
        self._before: tuple[Floats, Floats] | None = None

    @classmethod
    def tuned(
        cls,
        posterior: object,
        samples: ArrayLike,
        metric: ArrayLike | None = None,
        *,
        seed: int,
    ) -> Self:
        """Return the move with the best step size and number of steps for a posterior.

        The step size gives 80 % acceptance; the number of steps gives the most
        effective samples per gradient. Both are then fixed. This takes about 70
        gradients per sample.

        Args:
            posterior: A :class:`LogPosterior`, or another function with ``gradient``.
            samples: Draws of the posterior ``(n, ndim)``, about 20 of them, from a
                burn-in that is not used for estimates.
            metric: As for the class.
            seed: A whole number.

        Returns:
            The move, with fixed steps.

        Raises:
            TypeError: If an argument does not hold numbers, or there are no gradients.
            ValueError: If fewer than 8 samples have a positive posterior density, or as
                for the class.

        Examples:
            >>> import emcee_femu as ef
            >>> posterior = ef.paper.mass_spring().posterior
            >>> found = ef.find_map(posterior, 4, seed=1, check=0)
            >>> draws, metric = found.draw(8, seed=1), found.maxima[0].covariance
            >>> move = ef.moves.HamiltonianMove.tuned(posterior, draws, metric, seed=1)
            >>> move.steps >= 1, 0.0 < move.step_size < 2.0
            (True, True)
        """
        draws = checks.real_array("samples", samples, 2)
        move = cls(metric)
        move.check(*draws.shape)
        rng = np.random.default_rng(checks.whole_number("seed", seed))
        return cls(metric, *tune_steps(move.leapfrog(posterior), draws, rng))

    def check(self, nwalkers: int, ndim: int) -> None:
        """Refuse a dimension that differs from the metric's."""
        if self._factor is not None:
            checks.shaped("metric", self._factor.shape, (ndim, ndim))

    def propose(self, model: Model, state: State) -> tuple[State, NDArray[np.bool_]]:
        """Move every walker once; return the state and who was accepted."""
        n, ndim = state.coords.shape
        self.check(n, ndim)
        check_state(state)
        function = getattr(model.log_prob_fn, "f", model.log_prob_fn)  # in emcee's call
        leapfrog = self.leapfrog(function)
        random = model.random
        momenta = random.standard_normal((n, ndim))
        usual = random.uniform(1 - JITTER, 1 + JITTER, n)
        careful = LEAST_STEP ** random.uniform(0, 1, n)
        factors = np.where(random.uniform(0, 1, n) < CAREFUL, careful, usual)
        sizes = self.step_size * factors
        # Only those that moved cost a solve. The rest is not stored with the state: a
        # resumed run finds it again, to the bit.
        gradient = refresh(
            self._before, state.coords, lambda x: leapfrog.evaluate(x)[1]
        )
        rows = state.log_prob[:, None]
        here = Points(np.arange(n), state.coords, momenta, rows, gradient)
        # log U = -Exp(1)
        threshold = here.log_density - random.standard_exponential(n)
        here = here.finite()  # no walker moves from where the posterior is zero
        for _ in range(self.steps):
            here = leapfrog.step(here, sizes)
        new = here.take(here.log_density > threshold[here.walkers])
        accepted = np.zeros(n, dtype=bool)
        accepted[new.walkers] = True
        state.coords[new.walkers] = new.coords
        state.log_prob[new.walkers], blobs = split_rows(new.rows)
        if state.blobs is not None:
            state.blobs[new.walkers] = blobs
        gradient[new.walkers] = new.gradient
        self._before = state.coords.copy(), gradient
        return state, accepted

    def leapfrog(self, function: object) -> "Leapfrog":
        """Return the leapfrog integrator for a log-probability function.

        Raises:
            TypeError: If it has no gradients, or only differences of 2 d + 1 solves.
        """
        gradient: Evaluate | None = getattr(function, "gradient", None)
        if gradient is None or not getattr(function, "differentiable", True):
            raise TypeError(
                "posterior (log_prob_fn): HamiltonianMove needs a LogPosterior whose "
                "models have jacobian(parameters) (see contracts), or a function with "
                f"gradient(theta), got {type(function).__name__}; use DEMCMove()"
            )
        if self._factor is not None:
            return Leapfrog(gradient, self._factor)
        scale: Floats | None = getattr(function, "scale", None)
        if scale is None:
            raise ValueError(
                "metric: expected a covariance, since the log-probability function "
                "defines no scale"
            )
        return Leapfrog(gradient, np.diag(scale))


class Points(NamedTuple):
    """Where walkers are on their trajectories.

    Attributes:
        walkers: Which of the walkers, ``(k,)``; the trajectories of others have ended.
        coords: Positions, ``(k, d)``.
        momenta: Standardised momenta, ``(k, d)``: normal with unit covariance.
        rows: Rows of the posterior there, ``(k, columns)``.
        gradient: Gradients of the log-posterior there, ``(k, d)``.
    """

    walkers: Indices
    coords: Floats
    momenta: Floats
    rows: Floats
    gradient: Floats

    @property
    def log_density(self) -> Floats:
        """The joint log density of positions and momenta, ``(k,)``."""
        kinetic = 0.5 * np.einsum("nd,nd->n", self.momenta, self.momenta)
        return np.asarray(self.rows[:, LOG_POSTERIOR] - kinetic)

    def take(self, chosen: NDArray[np.bool_]) -> "Points":
        """Return the chosen walkers; the object itself if all are chosen."""
        return self if chosen.all() else Points._make(part[chosen] for part in self)

    def finite(self) -> "Points":
        """Return the walkers whose position and gradient are finite."""
        finite = np.isfinite(self.coords + self.gradient)
        return self.take(np.logical_and.reduce(finite, axis=1))


class Leapfrog(NamedTuple):
    r"""Steps of trajectories by the leapfrog scheme.

    .. math:: u \mathrel{+}= \tfrac h2 L^T \nabla \ln p(\theta), \qquad
        \theta \mathrel{+}= h L u, \qquad
        u \mathrel{+}= \tfrac h2 L^T \nabla \ln p(\theta)

    A trajectory ends where the posterior is zero: out of bounds, where nothing is
    solved, or where a solve failed. Whether it ends is told by the points on it alone,
    in whichever direction they are passed; so to reject then is reversible.

    Attributes:
        evaluate: Rows and gradients of points; a row begins with the log-posterior.
        factor: L, ``(d, d)``.
    """

    evaluate: Evaluate
    factor: Floats

    def step(self, start: Points, sizes: Floats) -> Points:
        """Return where trajectories are after a step, without those that ended.

        Args:
            start: Where they are.
            sizes: Step sizes h of all walkers, also of those that ended, ``(n,)``.
        """
        h = sizes[start.walkers, None]
        with np.errstate(over="ignore", invalid="ignore"):  # such a trajectory ends
            momenta = start.momenta + 0.5 * h * (start.gradient @ self.factor)
            coords = start.coords + h * (momenta @ self.factor.T)
        moved = start._replace(coords=coords, momenta=momenta).finite()
        if not len(moved.walkers):
            return moved
        rows, gradient = self.evaluate(moved.coords)
        here = moved._replace(rows=rows, gradient=gradient).finite()
        kick = 0.5 * sizes[here.walkers, None] * (here.gradient @ self.factor)
        return here._replace(momenta=here.momenta + kick)


def tune_steps(leapfrog: Leapfrog, theta: Floats, rng: Generator) -> tuple[int, float]:
    r"""Return the number of steps and the step size, by some 70 gradients per walker.

    The step size h is adjusted until 80 % of the proposals would be accepted. In theory
    the accepted share is ``2 Phi(-c h^2)``, so that each round tells the next h. With
    it longer trajectories are recorded. A proposal may end at any of their points; the
    number of steps is the one with most effective samples per gradient,

    .. math:: \frac{1 - \rho}{(1 + \rho) \, steps}, \qquad
        \rho_j = 1 - \frac{E[\alpha \, (\theta^*_j - \theta_j)^2]}{2 \sigma_j^2}

    with the probability alpha of acceptance, in the worst quarter of the parameters.

    Args:
        leapfrog: The steps along a gradient.
        theta: Points of the posterior ``(n, d)``, such as the walkers of a burn-in.
        rng: The random stream.

    Source: Beskos et al. (2013), doi:10.3150/12-BEJ414, for the accepted share.
    """
    rows, gradient = leapfrog.evaluate(theta)
    here = Points(np.arange(len(theta)), theta, 0 * theta, rows, gradient).finite()
    n = len(here.walkers)
    if n < FEWEST_TUNED:
        raise ValueError(
            f"samples: expected at least {FEWEST_TUNED} where the posterior is above "
            f"zero, got {n}"
        )
    here = here._replace(walkers=np.arange(n))
    size, sizes = FIRST_STEP, []
    for _ in range(TUNING_ROUNDS):
        end, chance = _travel(leapfrog, here, LONGEST / 2, size, rng)[-1]
        # Those that left the bounds say nothing of h, unless most of them did.
        most_left = len(end.walkers) < n / 2
        accepted = chance.sum() / (n if most_left else max(1, len(end.walkers)))
        ratio = ndtri(BEST_ACCEPTANCE / 2) / ndtri(np.clip(accepted, 0.02, 0.98) / 2)
        size *= float(np.clip(np.sqrt(ratio), 0.3, 1.6))
        sizes.append(size)
        here = _accept(here, end, chance, rng)
    size = float(np.exp(np.mean(np.log(sizes[-3:]))))  # each is as uncertain as another

    places, squares = [], []
    for _ in range(RECORDED):
        path = _travel(leapfrog, here, LONGEST, size, rng)
        jumps = [end.coords - here.coords[end.walkers] for end, _ in path]
        pairs = zip(path, jumps, strict=True)
        squares.append([chance @ jump**2 / n for (_, chance), jump in pairs])
        places.append(here.coords)
        here = _accept(here, *path[len(path) // 2], rng)
    visited = np.concatenate(places)
    metric = (leapfrog.factor**2).sum(axis=1)  # its diagonal
    # The metric's, where all walkers are at one place, which nothing was accepted from.
    apart = np.ptp(visited, axis=0) > 0
    variance = np.where(apart, visited.var(axis=0), metric)
    rho = 1 - np.mean(squares, axis=0) / (2 * variance)  # (steps, d)
    # Where rho is below zero the squares mix worse than the parameters: rho^2 tells it.
    rho = np.where(rho < 0, rho**2, rho)
    efficiency = np.sort((1 - rho) / (1 + rho), axis=1)
    worst = efficiency[:, : -(-rho.shape[1] // 4)].mean(axis=1)
    return int(np.argmax(worst / np.arange(1, len(rho) + 1))) + 1, size


def _travel(
    leapfrog: Leapfrog, start: Points, length: float, size: float, rng: Generator
) -> list[tuple[Points, Floats]]:
    """Return the points of trajectories, and how likely each would be accepted."""
    sizes = size * rng.uniform(1 - JITTER, 1 + JITTER, len(start.walkers))
    here = start._replace(momenta=rng.standard_normal(start.coords.shape))
    before, path = here.log_density, []
    for _ in range(int(np.clip(np.ceil(length / size), 1, MOST_LEAPS))):
        here = leapfrog.step(here, sizes)
        gain = here.log_density - before[here.walkers]
        path.append((here, np.exp(np.minimum(gain, 0))))
    return path


def _accept(here: Points, end: Points, chance: Floats, rng: Generator) -> Points:
    """Return where the walkers are after a Metropolis step."""
    moved = end.take(rng.random(len(here.walkers))[end.walkers] < chance)
    parts = Points._make(part.copy() for part in here)
    for part, new in zip(parts, moved, strict=True):
        part[moved.walkers] = new
    return parts
