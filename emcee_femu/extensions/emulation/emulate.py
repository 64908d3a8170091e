"""Emulate a model from few solves, chosen where the posterior needs them."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import replace
from os import PathLike

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import stats
from scipy.spatial.distance import cdist

from ... import checks
from ...contracts import Floats
from ...evaluation.evaluator import Evaluation
from ...evaluation.pools import count_workers
from ...evaluation.progress import caption, check_progress, progress_bar
from ...evaluation.resume import open_evaluator
from ...posterior.log_posterior import LogPosterior
from ...search.coordinates import Coordinates
from ...table import Table
from .design import FEWEST_FITTED, Design, plan
from .draws import GROWN, EmulatedDraws, Explorer
from .emulated import EmulatedExperiments, EmulatedModel, emulate_each
from .gaussian_process import NUGGET
from .partition import fit_outputs

UNITS = 8  # points at which measurement errors are taken from the terms
TOLERANCE = 0.1  # true error, in measurement errors, that hardly shifts a posterior
SETTLED = 2  # consecutive rounds whose true error must be small
# True error above which a wider, tempered posterior is drawn from.
LARGE_TRUE_ERROR = 3.0
STAGE = 4.0  # least growth of the power per round, which halves the width
SURPRISE = 5.0  # predicted error, in tolerances, above which it goes on
FAR_POINT = 3.0  # squared distance per dimension beyond which a point counts less
# Error of leaving one out, in measurement errors, that is small enough.
SMALL_LEFT_OUT = 0.01
LEAST_VARIANCE = 1e-300  # variance of processes that are exact
BY_CHANCE = 0.01  # least probability at which many failures count as chance
# Predicted error, in measurement errors, below which none is measured.
UNMEASURED = 1e-6


def emulate(
    posterior: LogPosterior,
    solves: int = 60,
    *,
    seed: int,
    workers: int | None = None,
    pool: object = None,
    backend: str | PathLike[str] | None = None,
    resume: bool = False,
    tolerance: float = TOLERANCE,
    derivatives: bool = True,
    starts: ArrayLike | None = None,
    cheap: Sequence[str] | None = None,
    on_failure: str = "raise",
    max_failures: float = 0.8,
    progress: bool | str | None = None,
    probe_tolerance: float = 1e-6,
) -> EmulatedModel | EmulatedExperiments:
    r"""Replace the model of a posterior by Gaussian processes fitted to a few solves.

    Use it if one solve takes seconds or more and the model is not affine in its
    parameters. The emulator predicts the response (eigenvalues, mode shapes at the
    sensors, or any vector that a term reads), not the log-posterior, and the
    likelihood includes the emulator's own uncertainty. Typical cost: 10 solves per
    parameter, or 3 if the model has a ``jacobian``.

    The first ``d + 4`` solves are spread over the prior of the ``d`` parameters.
    Batches of ``d / 2 + 1`` follow, at those draws of the emulated posterior whose
    solves reduce the expected error most. With derivatives, ``max(d / 2 + 1, 3)`` and
    ``d / 4 + 1`` suffice. The page "A posterior in few solves, measured" explains the
    method and how often it was right.

    The error of an emulated response r' is its distance from the full response r in
    standard deviations of the measurement,

    .. math:: e = \Big[\sum_i (r_i - r'_i)^2 / \sigma_i^2\Big]^{1/2}.

    An error of 0.1 shifts a posterior mean by at most a tenth of a posterior standard
    deviation. The *true error* of a round is the root mean square of e predicted at
    draws of the emulated posterior, multiplied by the ratio of actual to predicted
    errors at the newest solves. Solving stops when the true error is below
    ``tolerance`` for two consecutive rounds and the error predicted at the final draws
    is at most five times ``tolerance``.

    The emulator cannot detect regions that it wrongly excludes. Check the result with
    :func:`certify`.

    The experiments of :meth:`LogPosterior.joint` are emulated one after another, in
    their order. Solves for the second one are placed where the first leaves the
    posterior undecided, so list the most informative experiment first.

    Args:
        posterior: The posterior to emulate. A :class:`PairedModel` pairs the emulated
            modes as it pairs those of a full solve.
        solves: Maximum number of full solves per experiment.
        seed: A whole number; the same seed gives the same emulator, bit for bit.
        workers: Number of worker processes, as in :func:`run`. The first design and
            each batch have at least one point per worker, so more workers mean fewer
            rounds and different points.
        pool: A pool to solve in, instead of workers; see :func:`run`.
        backend: File in which each solve is stored as soon as it is done, such as
            "emulate.chain". Each experiment of a joint posterior has its own file,
            whose name ends with the experiment's.
        resume: Whether to continue from the file if it exists. Stored solves are not
            repeated, and the result is the same as without the interruption, bit for
            bit. ``solves`` and ``tolerance`` may differ from the first call; the number
            of workers must not, because it sets the batch size.
        tolerance: True error at which to stop; 0 to spend all solves.
        derivatives: Whether to use the model's ``jacobian``, if it has one.
        starts: A point ``(d,)``, such as a maximum from :func:`find_map`: the first
            design then covers a quarter of the prior's spread around it. Or the points
            ``(n, d)`` of the first design. By default it covers the whole prior.
        cheap: Names of experiments whose models are fast enough to be solved at every
            evaluation of the posterior, and are therefore not emulated.
        on_failure: "raise" to stop at the first failed solve; "reject" to leave its
            point out of the fit and avoid its surroundings. Failed solves are counted.
        max_failures: Fraction of failed solves above which "reject" stops. The default
            is higher than in :func:`run` because the first design covers the prior.
        progress: Whether to show solves, errors and the remaining time, as in
            :func:`run`.
        probe_tolerance: Relative difference between a stored and a repeated solve above
            which the model is considered changed.

    Returns:
        The emulated model. Pass its ``posterior`` to :func:`run`; ``solves`` is the
        number of full solves, and ``history`` lists the errors round by round. For a
        joint posterior ``models`` holds such a model for each experiment.

    Raises:
        TypeError: If posterior is not a LogPosterior, or a count is not a whole number.
        ValueError: If solves is too small for a first design and one batch, a start is
            out of bounds, cheap names an unknown experiment, or the file belongs to
            another calculation. These are raised before the first solve.
        ImportError: If progress is "notebook" and ipywidgets is not installed.
        RuntimeError: If too many solves failed, or all solves of the first design did.
        UserWarning: If all solves of the first design are far from the measurements.

    Source: Sinsbeck and Nowak (2017), Sequential design of computer experiments for the
    solution of Bayesian inverse problems, doi:10.1137/15M1047659.

    Examples:
        >>> import emcee_femu as ef
        >>> model = ef.FunctionModel(lambda p: [p["k"] ** 0.5, (3 * p["k"]) ** 0.5])
        >>> term = ef.FrequencyTerm([3.0, 5.2], relative_sd=0.01)
        >>> prior = ef.GaussianPrior(["k"], [8.0], [2.0], [(1.0, 20.0)])
        >>> emulated = ef.emulate(ef.LogPosterior(model, term, prior), 12, seed=1)
        >>> emulated.solves <= 12, emulated.posterior.names
        (True, ('k',))
    """
    options = {k: v for k, v in locals().items() if k not in ("posterior", "cheap")}
    checks.instance("posterior", posterior, LogPosterior)
    if len(posterior.experiments) > 1 or cheap is not None:
        return emulate_each(posterior, cheap, emulate, options)
    width = count_workers(pool, workers)
    design = plan(posterior, width, seed, derivatives, starts)
    first, batch = design.first, design.few
    if checks.whole_number("solves", solves, 1) < len(first) + batch:
        raise ValueError(
            f"solves: expected at least {len(first) + batch} for {posterior.ndim} "
            f"parameters and {width} at a time, {len(first)} of a first design and a "
            f"batch of {batch}, got {solves}; about {10 * posterior.ndim} are usual"
        )
    tolerance = checks.real_number("tolerance", tolerance, 0)
    display = check_progress(progress)
    how = workers, pool, on_failure, max_failures, backend, resume, probe_tolerance
    recorder, asked = design.problem.recorder(), design.describe("emulate")
    with (
        open_evaluator(recorder, asked, *how) as evaluator,
        progress_bar(display, solves, "emulate") as evaluator.bar,
    ):
        return Emulation(design, evaluator).run(solves, tolerance)


class Emulation:
    """The full solves so far, and the fit to them.

    Args:
        design: What is emulated, and how.
        evaluator: Runs the full solves.

    Attributes:
        coordinates: Those in which the last fit sees the parameters.
        theta: The solved points, ``(N, d)``.
        rows: Their rows ``(N, columns)``; -inf and NaN if a solve failed.
        history: One row per round: solves, predicted and true error, draws.
        settled: Whether the last call of ``run`` ended within tolerance.
    """

    def __init__(self, design: Design, evaluator: Evaluation) -> None:
        self.design, self.problem = design, design.problem
        self.evaluator, self.few = evaluator, design.few
        self.history: list[tuple[int, float, float, float]] = []
        self.settled = False
        self._explorer, self._power = Explorer(design.problem), 0.0
        self._last: tuple[EmulatedModel, EmulatedDraws] | None = None
        self.coordinates, self._compared = (first := self.problem.coordinates), 0
        positive = Coordinates.positive(first.prior)
        same = (positive.logs == first.logs)[self.problem.inputs].all()
        self._maps = [first] if same else [first, positive]  # it may be smoothest in
        self.theta = np.empty((0, self.problem.posterior.ndim))
        self.rows = np.empty((0, evaluator.posterior.row_size))

    def run(self, solves: int, tolerance: float) -> EmulatedModel:
        """Add batches until the true error is small or there are so many points.

        It goes on from where an earlier call has ended.
        """
        if not len(self.theta):
            self._begin(solves)
        settled, history = 0, self.history
        while True:
            emulator = self._fit()
            rng = np.random.default_rng([self.design.seed, len(history)])
            if history:
                true = [error for _, _, error, _ in history[-SETTLED:]]
                largest = max([LARGE_TRUE_ERROR, *filter(np.isfinite, true)])
                wanted = (LARGE_TRUE_ERROR / largest) ** 2
                self._power = min(max(wanted, STAGE * self._power), 1.0)
            # At first no error is known.
            power = self._power or 1.0
            draws = self._explorer.draw(emulator, self.coordinates, rng, power)
            self._last, spent = (emulator, draws), len(self.theta)
            # Fresh draws of the whole prior may have come upon something new.
            known = draws.predicted <= SURPRISE * tolerance
            if spent >= solves or (settled >= SETTLED and known):
                break
            number = min(self.design.batch, solves - spent)
            self.solve(self._choose(number, emulator, draws))
            error = self._close_round(number, emulator, draws)
            settled = settled + 1 if error <= tolerance else 0
            text = f"emulate, error {draws.predicted:.2g} predicted, {error:.2g} true"
            caption(self.evaluator.bar, text)
        promise = max(tolerance, TOLERANCE)  # of a smaller one, more is wanted only
        last = [error for _, _, error, _ in history[-SETTLED:]]
        close = len(last) == SETTLED and max(last) <= promise
        self.settled = close and draws.predicted <= SURPRISE * promise
        return self._hand_over(emulator, (spent, draws.predicted, np.nan, draws.size))

    def refit(self) -> EmulatedModel:
        """Return an emulator fitted to all solves so far, which cost no solve more."""
        return self._hand_over(self._fit())

    def _hand_over(
        self, emulator: EmulatedModel, *latest: tuple[int, float, float, float]
    ) -> EmulatedModel:
        """Return an emulator with its posterior and its history."""
        table = Table(
            "Errors at draws of the posterior, in units of measurement error",
            ("solves", "predicted error", "true error", "effective draws"),
            ("d", ".3g", ".3g", ".0f"),
            (*self.history, *latest),
        )
        failed = self.evaluator.failed
        emulator = replace(emulator, failed_solves=failed, settled=self.settled)
        posterior = self.problem.replace_model(emulator)
        if self._last is not None:
            posterior.draws = self._last[1].members
        posterior.notes = emulator.notes
        return replace(emulator, history=table, posterior=posterior)

    def _begin(self, solves: int) -> None:
        """Solve the first design, and say what is odd about it."""
        self.solve(self.design.first)
        rng = np.random.default_rng([self.design.seed, 0, 1])
        while 0 < self._solved.sum() < FEWEST_FITTED and len(self.theta) < solves:
            number = min(self.design.batch, solves - len(self.theta))
            self.solve(self.coordinates.prior.sample(rng, number))
        solved = self.evaluator.posterior.unfold(self.rows[self._solved])
        for text in self.problem.doubt(solved):
            warnings.warn(text, stacklevel=4)
        if (number := int(self._solved.sum())) < FEWEST_FITTED:
            raise RuntimeError(
                f"on_failure: only {number} of {len(self.theta)} solves succeeded, and "
                f"a fit needs at least {FEWEST_FITTED}. Fix the model, or narrow the "
                "prior to where it can be solved"
            )

    def take_in(self, theta: Floats) -> None:
        """Learn from draws of the posterior too, as a round, ``(n, d)``."""
        self.solve(theta)
        if self._last is not None:
            self._close_round(len(theta), *self._last)

    def _close_round(
        self, number: int, emulator: EmulatedModel, draws: EmulatedDraws
    ) -> float:
        """Return the true error at the last points, and add it to the history."""
        error = self._scaled_error(number, emulator, draws.predicted)
        spent = len(self.theta) - number
        self.history.append((spent, draws.predicted, error, draws.size))
        return error

    @property
    def _solved(self) -> NDArray[np.bool_]:
        """Which points could be solved, ``(N,)``."""
        return np.isfinite(self.rows[:, 0])

    def solve(self, points: Floats) -> None:
        """Solve in full; each solve is stored as it arrives."""
        rows = [row for _, row in sorted(self.evaluator.each(points))]
        failures = self.evaluator.failures
        if failures is not None:  # by itself it begins at a hundred
            known = failures.evaluations, failures.max_failures
            if stats.binom.sf(failures.causes.total() - 1, *known) < BY_CHANCE:
                failures.check(len(points))
        self.theta = np.vstack([self.theta, points])
        self.rows = np.vstack([self.rows, rows])

    def _fit(self) -> EmulatedModel:
        """Return an emulator fitted to all solves so far.

        Leave-one-out errors decide between the explored coordinates and the logarithms
        of all positive parameters, and whether to use the derivatives. The decision is
        repeated when the number of solves has grown by half.
        """
        last, draws = self._last or (None, None)
        problem, inputs = self.problem, self.problem.inputs
        prior, theta = problem.posterior.prior, self.theta[self._solved]
        recorded = self.evaluator.posterior.unfold(self.rows[self._solved])
        response, tangents = problem.part(recorded)
        newest = {name: values[-UNITS:] for name, values in response.items()}
        units = problem.measurement_errors(theta[-UNITS:], newest)
        limits = zip(np.take(prior.names, inputs), prior.bounds[inputs], strict=True)
        bounds = {str(name): (float(low), float(high)) for name, (low, high) in limits}
        start = () if last is None else last.processes
        same = last is not None and len(theta) < GROWN * self._compared
        if not same:
            self._compared = len(theta)
        weights = self._weigh(theta, draws)
        fits = list[tuple[float, EmulatedModel, Coordinates]]()
        for coordinates in [self.coordinates] if same else self._maps:
            logs = coordinates.logs[inputs]
            x = coordinates.coordinates(theta)[:, inputs]
            mean, sd = x.mean(axis=0), x.std(axis=0)
            points = (x - mean) / sd
            steps = np.where(logs, theta[:, inputs], 1.0) * sd
            slopes = {
                name: np.einsum("n...j,nj->n...j", tangent, steps)
                for name, tangent in tangents.items()
            }
            for known in (slopes, {}) if slopes else ({},):
                if last is not None and same and bool(known) != start[0].sloped:
                    continue
                how = units, weights, bool(logs.any()), start, same
                outputs, processes, cost = fit_outputs(points, response, known, *how)
                emulator = EmulatedModel(
                    bounds=bounds,
                    variables={name: problem.variables[name] for name in units},
                    outputs=outputs,
                    processes=processes,
                    solves=self.evaluator.solves,
                    _scale=(mean, np.asarray(sd)),
                    _logs=logs,
                )
                fits.append((max(cost, SMALL_LEFT_OUT**2), emulator, coordinates))
        _, emulator, self.coordinates = min(fits, key=lambda fit: fit[0])
        return emulator

    def _weigh(self, theta: Floats, draws: EmulatedDraws | None) -> Floats:
        """Return the weight of each point, ``(N,)``: less if far from the draws."""
        weights, inputs = np.ones(len(theta)), self.problem.inputs
        if draws is not None:
            x = self.coordinates.coordinates(theta)[:, inputs]
            members = self.coordinates.coordinates(draws.members)[:, inputs]
            mean, sd = members.mean(axis=0), members.std(axis=0)
            # In units of spreads, so that a parameter of 1e10 and one of 1 are alike
            inverse = np.linalg.pinv(np.atleast_2d(np.corrcoef(members.T)))
            z = (x - mean) / sd
            squares = ((z @ inverse) * z).sum(axis=1) / len(mean)
            weights /= 1.0 + (squares / FAR_POINT) ** 2
        return np.asarray(weights / weights.sum())

    def _choose(
        self, number: int, emulator: EmulatedModel, draws: EmulatedDraws
    ) -> Floats:
        """Return the next points, each reducing the error most after those before.

        The error is the mean square error at draws of the emulated posterior. The first
        point of a batch, and a few more of a wide one, are chosen where the posterior
        may still turn out to be. Points whose nearest solved neighbour failed are used
        only if nothing else is left.
        """
        inputs, processes = self.problem.inputs, emulator.processes
        theta, count = np.vstack([draws.members, draws.wide]), len(draws.members)
        known = emulator.coordinates(self.theta[:, inputs])
        at = emulator.coordinates(theta[:, inputs])
        fails = ~self._solved[cdist(at, known).argmin(axis=1)]
        traces = np.array([each.covariance.trace() for each in processes])
        traces += LEAST_VARIANCE
        shares = traces / traces.sum()  # of the error, by processes
        sds = np.array([each.unit_sd(at) for each in processes])
        weights = draws.errors / np.maximum(shares @ sds**2, NUGGET)
        chosen = self.theta[~self._solved]
        for place in range(number):
            extra = emulator.coordinates(chosen[:, inputs])
            among = slice(count) if place % self.few else slice(count, None)
            gain = np.zeros(len(at))
            for share, each in zip(shares, processes, strict=True):
                left = each.unit_covariance(at, extra)
                # Solving at a draw takes cov^2 / var from the variance at another.
                lowered = weights[among] @ left[among] ** 2
                gain += share * lowered / np.maximum(left.diagonal(), NUGGET)
            gain[fails] -= 1.0 + gain.max()
            taken = np.vstack([self.theta, chosen])
            gain[(theta[:, None] == taken).all(axis=2).any(axis=1)] = -np.inf
            chosen = np.vstack([chosen, theta[among][np.argmax(gain[among])]])
        return chosen[-number:]

    def _scaled_error(
        self, number: int, emulator: EmulatedModel, predicted: float
    ) -> float:
        """Return the true error at draws of the posterior, scaled by the last solves.

        It is infinite if none of the last points could be solved.
        """
        solved = np.flatnonzero(self._solved[-number:]) - number
        if not len(solved):
            return np.inf
        theta, emulated = self.theta[solved], self.problem.replace_model(emulator)
        square = self.problem.predict_error(emulated, theta)
        true = self._deviate(theta, self.rows[solved], emulated)
        factor = np.sqrt((true**2 / np.maximum(square, UNMEASURED**2)).mean())
        return float(factor * np.maximum(predicted, UNMEASURED))

    def true_error(
        self, emulator: EmulatedModel, theta: Floats, weights: Floats
    ) -> float:
        """Return the root mean square error of an emulator at weighted points."""
        theta, weights = theta[weights > 0], weights[weights > 0]
        rows = np.array([row for _, row in self.evaluator.each(theta)])
        true = self._deviate(theta, rows, self.problem.replace_model(emulator))
        return float(np.sqrt(weights @ true**2 / weights.sum()))

    def _deviate(self, theta: Floats, rows: Floats, emulated: LogPosterior) -> Floats:
        """Return how far an emulator is from what was solved, ``(n,)``."""
        full, _ = self.problem.part(self.evaluator.posterior.unfold(rows))
        return self.problem.deviate(theta, full, emulated)
