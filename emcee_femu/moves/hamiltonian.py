"""Hamiltonian Monte Carlo: trajectories along gradients, for many parameters."""

from typing import Any

import numpy as np
from emcee.ensemble import _FunctionWrapper
from emcee.moves import Move
from numpy.typing import ArrayLike, NDArray

from .. import checks
from ..interfaces import Floats
from ..posterior.linearize import split
from .acceptance import ProposingMove, check_state, overwrite
from .hamiltonian_tuning import tune_steps
from .leapfrog import Evaluate, Points, energies_of, leap
from .metropolis import factorize

JITTER = 0.2  # of the step size, against trajectories that come back to their start
# Share of trajectories with steps down to a thirtieth: far from the posterior, in
# valleys that are narrower than it, no other would be accepted.
CAREFUL, LEAST = 0.1, 1 / 30


class HamiltonianMove(Move):
    r"""Follow the gradient of the log-posterior along a trajectory of several steps.

    .. math:: u \sim N(0, I), \qquad (\theta^*, u^*) = \text{leapfrog}^{steps}
        (\theta_i, u), \qquad r = \min\left\{1, \frac{p(\theta^*)}{p(\theta_i)}
        e^{(|u|^2 - |u^*|^2) / 2}\right\}

    One step is ``u += h/2 L^T g``, ``theta += h L u``, ``u += h/2 L^T g``, with the
    gradient g, ``L L^T = metric`` and h within 20 % of ``step_size``, drawn anew for
    each trajectory, so that none comes back to its start again and again; a tenth of
    them have smaller steps, down to a thirtieth, without which a walker in the far
    tails might never move.

    For a :class:`LogPosterior` whose models have ``jacobian``: a gradient then costs
    one solve, and a proposal ``steps`` of them. All walkers move at once, each on its
    own; one is enough. A trajectory that leaves the bounds, or comes where a solve
    fails, is rejected there and costs no more.

    From ten parameters on, nothing else is as efficient if the metric is near the
    posterior's covariance. Take it from a Laplace approximation or earlier draws,
    ``numpy.cov(draws, rowvar=False)``, and choose the other two by :meth:`tuned`. It
    does not cross between modes: mix it with a move that does; and start it where a
    burn-in or a maximum is, since from draws of the prior it is slow.

    Args:
        metric: Covariance of the posterior ``(ndim, ndim)``, or variances ``(ndim,)``:
            the inverse of the mass matrix. None for the variances of the prior, which
            needs many more and smaller steps.
        steps: Leapfrog steps per proposal. ``steps * step_size`` of 1.5 to 2.5 suits a
            metric that fits.
        step_size: Mean step size h, in standard deviations of the metric. Accepting 80
            % of the proposals is good; steps of more than 2 diverge.
        reciprocal_about: A value of each parameter ``(ndim,)``, such as the maximum of
            the posterior, about which its reciprocal moves: trajectories are then those
            of flexibilities, in which posteriors of stiffnesses are less curved. Zero
            for what moves as it is, such as masses and standard deviations; None for
            all of them. The metric remains a covariance of the parameters themselves.

    Raises:
        TypeError: If an argument does not hold numbers; when it proposes: if the
            log-probability is no LogPosterior with gradients.
        ValueError: If the metric is not positive definite, steps or step_size not above
            zero, or (when it proposes) a shape does not fit ndim.

    Source: Neal (2011), doi:10.1201/b10905-6.

    Examples:
        >>> from emcee_femu import HamiltonianMove
        >>> HamiltonianMove([4.0], steps=3)
        HamiltonianMove(metric=[4.0], steps=3, step_size=0.25, reciprocal_about=None)
    """

    __repr__ = ProposingMove.__repr__

    def __init__(
        self,
        metric: ArrayLike | None = None,
        steps: int = 8,
        step_size: float = 0.25,
        reciprocal_about: ArrayLike | None = None,
    ) -> None:
        self.metric = None if metric is None else checks.real_array("metric", metric)
        self.steps = checks.whole_number("steps", steps, 1)
        self.step_size = checks.positive_array("step_size", step_size, 0).item()
        self._factor: Floats | None = None
        if self.metric is not None and not self.metric.size:
            raise ValueError("metric: expected one row per parameter, got none")
        if self.metric is not None and self.metric.ndim == 1:
            self._factor = np.sqrt(checks.positive_array("metric", self.metric))
        elif self.metric is not None:
            self._factor = factorize("metric", self.metric)
        self.reciprocal_about = (
            None
            if reciprocal_about is None
            else checks.real_array("reciprocal_about", reciprocal_about, 1)
        )
        self._known: tuple[Floats, Floats] | None = None

    @classmethod
    def tuned(
        cls,
        posterior: Any,
        samples: ArrayLike,
        metric: ArrayLike | None = None,
        *,
        seed: int,
        reciprocal_about: ArrayLike | None = None,
    ) -> "HamiltonianMove":
        """Return the move with steps that were tried out on a posterior, then frozen.

        The step size is that of 80 % acceptance, the number of steps the one with most
        effective samples per gradient. It takes some 70 gradients per sample.

        Args:
            posterior: A :class:`LogPosterior`; or what evaluates one, with its
                ``linearize``.
            samples: Draws of the posterior ``(n, ndim)``, about 20 of them, from a
                burn-in that is not used for estimates.
            metric: See the class.
            seed: A whole number.
            reciprocal_about: See the class.

        Returns:
            The move, with fixed steps.

        Raises:
            TypeError: If an argument does not hold numbers, or there are no gradients.
            ValueError: If there are fewer than 8 samples where the posterior is above
                zero; see also the class.

        Examples:
            >>> import emcee_femu as ef
            >>> posterior = ef.paper.mass_spring().posterior
            >>> found = ef.find_map(posterior, 4, seed=1, check=0)
            >>> draws, metric = found.draw(8, seed=1), found.maxima[0].covariance
            >>> move = ef.HamiltonianMove.tuned(posterior, draws, metric, seed=1)
            >>> move.steps >= 1, 0.0 < move.step_size < 2.0
            (True, True)
        """
        draws = checks.real_array("samples", samples, 2)
        move = cls(metric, reciprocal_about=reciprocal_about)
        move.check(*draws.shape)
        bare = getattr(posterior, "posterior", posterior)
        move.check_with(bare)
        factor = bare.scale if move._factor is None else move._factor

        def evaluate(theta: Floats) -> tuple[Floats, Floats]:
            if bare is posterior:
                rows, gradient = posterior.gradient(theta)
            else:
                rows, gradient, _ = posterior.linearize(theta)
            return rows, gradient

        rng = np.random.default_rng(checks.whole_number("seed", seed))
        about = move.reciprocal_about
        steps, step_size = tune_steps(evaluate, draws, factor, JITTER, rng, about)
        return cls(metric, steps, step_size, about)

    def __getstate__(self) -> dict[str, Any]:
        """Leave out the known gradients, which are found again."""
        return {**vars(self), "_known": None}

    @property
    def cost(self) -> int:
        """Evaluations per walker and generation, a gradient for each step."""
        return self.steps

    def check(self, nwalkers: int, ndim: int) -> None:
        """Refuse a dimension that the metric or the centre does not have."""
        parts = {"metric": self._factor, "reciprocal_about": self.reciprocal_about}
        for argument, part in parts.items():
            if part is not None and len(part) != ndim:
                raise ValueError(
                    f"{argument}: expected that of {ndim} parameters, got shape "
                    f"{part.shape}"
                )

    def check_with(self, posterior: Any) -> None:
        """Refuse a log-probability function without gradients."""
        if not hasattr(posterior, "stack_gradient"):
            raise TypeError(
                "posterior (log_prob_fn): HamiltonianMove needs a LogPosterior, which "
                f"has gradients, got {type(posterior).__name__}; use DEMCMove(), or "
                "write the density as a likelihood term"
            )
        if not posterior.differentiable:
            raise TypeError(
                "posterior: HamiltonianMove needs models with jacobian(parameters), or "
                "every gradient would take 2 d + 1 solves; give the models one (see "
                "interfaces), or use moves='auto'"
            )

    def propose(self, model: Any, state: Any) -> tuple[Any, NDArray[np.bool_]]:
        """Move every walker once; return the state and who was accepted."""
        n, ndim = state.coords.shape
        self.check(n, ndim)
        check_state(state)
        posterior, evaluate = self._evaluation(model)
        factor = posterior.scale if self._factor is None else self._factor
        momenta = model.random.standard_normal((n, ndim))
        sizes = self.step_size * draw_factors(model.random, n)
        gradient = self._gradient_at(state.coords, evaluate)
        rows, about = state.log_prob[:, None], self.reciprocal_about
        here = Points(np.arange(n), state.coords, momenta, rows, gradient)
        # log U = -Exp(1)
        threshold = energies_of(here, about) - model.random.standard_exponential(n)
        here = here.finite()  # no walker moves from where the posterior is zero
        for _ in range(self.steps):
            here = leap(evaluate, here, sizes, factor, about)
        energy = energies_of(here, about)
        new = here.take(energy > threshold[here.walkers])
        accepted = np.zeros(n, dtype=bool)
        accepted[new.walkers] = True
        blobs = new.rows[:, 1:] if new.rows.shape[1] > 1 else None
        overwrite(state, new.walkers, new.coords, new.rows[:, 0], blobs)
        gradient[new.walkers] = new.gradient
        self._known = state.coords.copy(), gradient
        return state, accepted

    def _evaluation(self, model: Any) -> tuple[Any, Evaluate]:
        """Return the posterior, and what gives its rows and gradients."""
        function = model.log_prob_fn
        if isinstance(function, _FunctionWrapper) and not function.args:
            function = function.f
        posterior = getattr(function, "posterior", function)  # behind its guard
        self.check_with(posterior)

        def evaluate(theta: Floats) -> tuple[Floats, Floats]:
            if model.map_fn is map:
                stacked = function.stack_gradient(theta)
            else:
                stacked = np.array([*model.map_fn(function.stack_gradient, theta)])
            return split(posterior, stacked)

        return posterior, evaluate

    def _gradient_at(self, coords: Floats, evaluate: Evaluate) -> Floats:
        """Return the gradients at the walkers; only those that moved cost a solve.

        What is known saves solves and nothing else: it is not stored with the state, so
        a resumed run finds it again, to the bit.
        """
        if self._known is None or self._known[0].shape != coords.shape:
            return evaluate(coords)[1].copy()
        changed = (self._known[0] != coords).any(axis=1)
        gradient = self._known[1].copy()  # kept should the model raise
        if changed.any():
            gradient[changed] = evaluate(coords[changed])[1]
        return gradient


def draw_factors(random: Any, n: int) -> Floats:
    """Return by what the step sizes of ``n`` trajectories differ, ``(n,)``."""
    usual = random.uniform(1 - JITTER, 1 + JITTER, n)
    careful = LEAST ** random.uniform(0, 1, n)
    result: Floats = np.where(random.uniform(0, 1, n) < CAREFUL, careful, usual)
    return result
