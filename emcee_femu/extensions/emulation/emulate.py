"""Emulate a model from few solves, chosen where the posterior needs them."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from os import PathLike

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import stats
from scipy.spatial.distance import cdist

from ... import checks
from ...contracts import Floats
from ...evaluation.evaluator import Evaluation
from ...evaluation.pools import count_workers
from ...evaluation.resume import describe, open_evaluator
from ...evaluation.samplers import check_progress, progress_bar
from ...posterior.log_posterior import LogPosterior
from ...sampling.coordinates import Coordinates
from ...table import Table
from .draws import GROWN, EmulatedDraws, Explorer
from .emulated import EmulatedExperiments, EmulatedModel, emulate_each
from .gaussian_process import NUGGET
from .partition import fit_outputs
from .problem import FEWEST_FITTED, EmulationProblem, check_starts, first_points

UNITS = 8  # points by which the errors of the measurement are read off the terms
MORE = 4  # points of a first design than parameters: some more than a linear trend
SETTLED = 2  # rounds in a row whose true error is to be small
# True error above which draws are of a wider, tempered posterior.
LARGE_TRUE_ERROR = 3.0
STAGE = 4.0  # times the power of the round before, at least: its width halves
SURPRISE = 5.0  # times the tolerance: a predicted error with which it does not stop
FAR_POINT = 3.0  # squared distance per dimension beyond which a point counts less
# Error of leaving one out, in measurement errors, that is small enough.
SMALL_LEFT_OUT = 0.01
LEAST_VARIANCE = 1e-300  # variance of processes that are exact
BY_CHANCE = 0.01  # probability of so many failures where fewer are allowed
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
    tolerance: float = 0.1,
    derivatives: bool = True,
    starts: ArrayLike | None = None,
    cheap: Sequence[str] | None = None,
    on_failure: str = "raise",
    max_failures: float = 0.8,
    progress: bool | str | None = None,
    probe_tolerance: float = 1e-6,
) -> EmulatedModel | EmulatedExperiments:
    r"""Emulate the model of a posterior by Gaussian processes, from few full solves.

    For a model whose solve takes seconds or more and that is not affine in its
    parameters. The response (eigenvalues, shapes at the sensors, any real vector that
    a term reads) is emulated, not the scalar posterior, and the likelihood knows how
    far the emulator may be off. The first ``d + 4`` solves are spread over the prior,
    then batches of ``d / 2 + 1`` go to those draws of the emulated posterior whose
    solves lower its expected error most, averaged over all draws, the first of each
    batch among draws of a wider one, whose emulator errs twice as much as it says. The
    draws are walkers kept from round to round. While the true error (below) is above 3
    they are draws of a tempered posterior, at most as wide as if the measurement erred
    as much as the emulator, and half as wide in each round, so that solves reach a
    sharp posterior in stages. Whenever the solves have grown by half, and in each
    round that predicts an error below 0.1, half of the draws come anew from the whole
    prior, so that modes that one emulator excludes come back with a later one, and
    modes that are not there are found out. A parameter whose prior spans decades is
    seen by its logarithm; so are all positive ones, and eigenvalues with them, as long
    as the solves are predicted better so, each from the others.

    **Derivatives** of the model, its ``jacobian``, are learned beside the response: a
    first design of ``d / 2 + 1`` points, three at least, and batches of ``d / 4 + 1``
    then do, and a third to a half of the solves. They are left aside as long as the
    solves are predicted better without them. Where the model refuses them (two modes
    coincide) the response alone is learned, from a second call that is not counted.

    **The error** of an emulated response r' is its distance from the full one as the
    data see it,

    .. math:: e = \Big[\sum_i (r_i - r'_i)^2 / \sigma_i^2\Big]^{1/2}

    over all data, paired as a full solve would be. ``e = 0.1`` moves a posterior mean
    by a tenth of a standard deviation at the very most, and weights that correct the
    draws are then about 99 % efficient. The **true error** of a round is the root mean
    square of e that was predicted at draws of the emulated posterior, times the factor
    by which the full solves of the round exceeded what was predicted for them (the
    root mean square of the ratios): a prediction alone understates. It stops
    once the error stays below ``tolerance`` in two rounds running, and no more than
    five times that is predicted at the last draws.

    Regions that the emulator wrongly rules out are never visited; use :func:`certify`
    to check.

    **Several experiments** (:meth:`LogPosterior.joint`) are emulated one after another,
    each by solves of its own model alone, at draws of the posterior of those before it
    and of the cheap ones, in the order in which the posterior has them. So name first
    what says most.

    Args:
        posterior: What is to be sampled. A :class:`PairedModel` pairs the emulated
            modes as it would those of a full solve.
        solves: The most full solves, all counted; of each experiment.
        seed: A whole number; the same seed gives the same emulator, to the bit.
        workers: Number of processes to start, as in :func:`run`.
        pool: Where to solve instead, as in :func:`run`. Rounds are what a user waits
            for, so first design and batches have at least as many points as there are
            workers: more of them mean fewer rounds, and other points.
        backend: Name of a file that keeps every solve as it arrives, such as
            "run.chain"; of several experiments one for each, "run.solves.empty".
        resume: Whether to go on with the file if it is there, as in :func:`run`: the
            solves in it are not repeated, whether a call was killed, or ended and is
            now given more ``solves`` or a smaller ``tolerance``. The result is that of
            one call, to the bit. It takes as many points at a time, so as many workers.
        tolerance: True error at draws of the posterior at which to stop, in standard
            deviations of the measurement, see above; 0 to spend all solves.
        derivatives: Whether those of the model are learned, if it has ``jacobian``.
        starts: A point ``(d,)`` about which the first design lies, within a quarter of
            the prior's spread, such as that of :func:`find_map`; or points ``(n, d)``
            that are the first design; None for the whole prior.
        cheap: Names of experiments whose models are not emulated, but solved wherever
            the posterior is evaluated; None for none.
        on_failure: What a failed solve does: "raise", or "reject" to leave the point
            out of the fit, and not ask there again, nor where a failed point is nearer
            than all that were solved. It counts as a solve.
        max_failures: Fraction of the solves above which "reject" stops, unless so many
            of a few may have failed by chance. It is more than in :func:`run`, for the
            first design spans the prior. It stops, too, where all of that failed.
        progress: Whether to show solves, errors and the time left, as in :func:`run`.
        probe_tolerance: Relative difference at solves of the file above which the model
            counts as another, as in :func:`run`.

    Returns:
        The emulated model: ``posterior`` is ready to :func:`run`, ``solves`` the
        full solves spent, ``history`` the errors round by round, and how many
        independent draws of the emulated posterior its draws are worth. Of several
        experiments ``posterior``, ``solves`` of all, and ``models``, such a model for
        each name.

    Raises:
        TypeError: If posterior is not a LogPosterior, or a count not a whole number.
        ValueError: If solves do not suffice for a first design and a batch, an initial
            point is out of bounds, cheap names no experiment, or the file is of
            something else. All but what the model does are raised before a solve.
        ImportError: If progress is "notebook" and ipywidgets is not installed.
        RuntimeError: If too many solves failed.
        UserWarning: Where all solves of the first design are far off, as of
            :func:`run`.

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
    problem = EmulationProblem.of(posterior, checks.flag("derivatives", derivatives))
    seed = checks.whole_number("seed", seed)
    coordinates = Coordinates.of(posterior.prior)
    d, fewer, width = posterior.ndim, problem.derivatives, count_workers(pool, workers)
    number = max(d // 2 + 1, FEWEST_FITTED) if fewer else d + MORE
    places = check_starts(starts, problem)
    first = first_points(coordinates, max(number, width), seed, places)
    batch = d // (4 if fewer else 2) + 1
    if checks.whole_number("solves", solves, 1) < len(first) + batch:
        raise ValueError(
            f"solves: expected at least {len(first) + batch} for {posterior.ndim} "
            f"parameters and {width} at a time, {len(first)} of a first design and a "
            f"batch of {batch}, got {solves}; about {10 * posterior.ndim} are usual"
        )
    tolerance = checks.real_number("tolerance", tolerance, 0)
    display = check_progress(progress)
    asked = {
        "moves": "emulate",
        "seed": seed,
        "starts": first,
        "derivatives": problem.derivatives,
        "solves at a time": max(batch, width),
    }
    with (
        open_evaluator(
            problem.recorder(),
            describe(posterior, asked),
            workers=workers,
            pool=pool,
            on_failure=on_failure,
            max_failures=max_failures,
            backend=backend,
            resume=resume,
            probe_tolerance=probe_tolerance,
        ) as evaluator,
        progress_bar(display, solves, "emulate") as evaluator.bar,
    ):
        emulation = _Emulation(problem, evaluator, coordinates, batch)
        emulation.solve(first)
        return emulation.run(solves, max(batch, width), seed, tolerance)


@dataclass(eq=False)
class _Emulation:
    """Full solves so far, and what was learned of them.

    Attributes:
        problem: What is emulated.
        evaluator: Solves in full.
        coordinates: Those in which the last fit sees the parameters.
        few: Of so many points of a batch one is to find what is not yet seen.
        theta: Where it was solved, ``(N, d)``.
        rows: What that gave ``(N, columns)``; -inf and NaN where a solve failed.
    """

    problem: EmulationProblem
    evaluator: Evaluation
    coordinates: Coordinates
    few: int
    theta: Floats = field(init=False)
    rows: Floats = field(init=False)
    _maps: list[Coordinates] = field(init=False)  # in which it may be smoothest
    _compared: int = field(default=0, init=False)

    def __post_init__(self) -> None:
        inputs = self.problem.inputs
        positive = Coordinates.positive(self.coordinates.prior)
        same = (positive.logs == self.coordinates.logs)[inputs].all()
        self._maps = [self.coordinates] if same else [self.coordinates, positive]
        self.theta = np.empty((0, self.problem.posterior.ndim))
        self.rows = np.empty((0, self.evaluator.posterior.row_size))

    def run(
        self, solves: int, batch: int, seed: int, tolerance: float
    ) -> EmulatedModel:
        """Go on until the true error is small, or all solves are spent."""
        rng = np.random.default_rng([seed, 0, 1])  # (a last zero changes no stream)
        while 0 < self._solved.sum() < FEWEST_FITTED and len(self.theta) < solves:
            number = min(batch, solves - len(self.theta))
            self.solve(self.coordinates.prior.sample(rng, number))
        solved = self.evaluator.posterior.unfold(self.rows[self._solved])
        for text in self.problem.doubt(solved):
            warnings.warn(text, stacklevel=3)
        if (number := int(self._solved.sum())) < FEWEST_FITTED:
            raise RuntimeError(
                f"on_failure: only {number} of {len(self.theta)} solves succeeded, and "
                f"a fit needs at least {FEWEST_FITTED}. Fix the model, or narrow the "
                "prior to where it can be solved"
            )
        explorer = Explorer(self.problem)
        emulator, draws, settled, power = None, None, 0, 0.0
        history: list[tuple[int, float, float, float]] = []
        while True:
            emulator = self._fit(emulator, draws)
            rng = np.random.default_rng([seed, len(history)])
            number = int(self._solved.sum())
            if history:
                true = [error for _, _, error, _ in history[-SETTLED:]]
                largest = max([LARGE_TRUE_ERROR, *filter(np.isfinite, true)])
                wanted = (LARGE_TRUE_ERROR / largest) ** 2
                power = min(max(wanted, STAGE * power), 1.0)
            draws = explorer.draw(  # at first no error is known
                emulator, self.coordinates, number, rng, power=power or 1.0
            )
            spent = len(self.theta)
            # Fresh draws of the whole prior may have come upon something new.
            known = draws.predicted <= SURPRISE * tolerance
            if spent == solves or (settled >= SETTLED and known):
                break
            number = min(batch, solves - spent)
            self.solve(self._choose(number, emulator, draws))
            error = self._true_error(number, emulator, draws.predicted)
            settled = settled + 1 if error <= tolerance else 0
            history.append((spent, draws.predicted, error, draws.size))
            if hasattr(bar := self.evaluator.bar, "set_postfix_str"):
                text = f"error {draws.predicted:.2g} predicted, {error:.2g} true"
                bar.set_postfix_str(text)
        history.append((spent, draws.predicted, np.nan, draws.size))
        table = Table(
            "Errors at draws of the posterior, in units of measurement error",
            ("solves", "predicted error", "true error", "effective draws"),
            ("d", ".3g", ".3g", ".0f"),
            tuple(history),
        )
        posterior = self.problem.replace_model(emulator)
        posterior.draws = draws.members
        return replace(emulator, history=table, posterior=posterior)

    @property
    def _solved(self) -> NDArray[np.bool_]:
        """Which points could be solved, ``(N,)``."""
        return np.isfinite(self.rows[:, 0])

    def solve(self, points: Floats) -> None:
        """Solve in full; each solve is stored as it arrives."""
        rows = np.empty((len(points), self.rows.shape[1]))
        for number, row in self.evaluator.each(points):
            rows[number] = row
        failures = self.evaluator.failures
        if failures is not None:  # by itself it begins at a hundred
            known = failures.evaluations, failures.max_failures
            if stats.binom.sf(failures.causes.total() - 1, *known) < BY_CHANCE:
                failures.check(len(points))
        self.theta = np.vstack([self.theta, points])
        self.rows = np.vstack([self.rows, rows])

    def _fit(
        self, last: EmulatedModel | None, draws: EmulatedDraws | None
    ) -> EmulatedModel:
        """Return an emulator fitted to all that was solved.

        In the explored coordinates or in the logarithms of all positive parameters,
        with the derivatives or without them, as leaving one point out tells. That is
        asked again when the solves have grown by half.
        """
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
        """Return how much each point matters, ``(N,)``; less if far from the draws."""
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
        """Return the next points, each what lowers the error most after those before.

        The mean square error at draws of the emulated posterior; the first point, and
        some more of a wide batch, that where the posterior may yet turn out to be.
        None where solves fail, as far as the nearest point tells that was solved or
        failed, if there are others.
        """
        inputs, processes = self.problem.inputs, emulator.processes
        theta, count = np.vstack([draws.members, draws.wide]), len(draws.members)
        known = emulator.coordinates(self.theta[:, inputs])
        at = emulator.coordinates(theta[:, inputs])
        fails = ~self._solved[cdist(at, known).argmin(axis=1)]
        traces = np.array([each.covariance.trace() for each in processes])
        traces += LEAST_VARIANCE
        shares = traces / traces.sum()  # of the error, by processes
        variance = sum(
            share * each.unit_sd(at) ** 2
            for share, each in zip(shares, processes, strict=True)
        )
        weights = draws.errors / np.maximum(variance, NUGGET)
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

    def _true_error(
        self, number: int, emulator: EmulatedModel, predicted: float
    ) -> float:
        """Return the true error at draws of the posterior, by that at the last points.

        Infinite if none of them could be solved.
        """
        solved = np.flatnonzero(self._solved[-number:]) - number
        if not len(solved):
            return np.inf
        theta, emulated = self.theta[solved], self.problem.replace_model(emulator)
        recorded = self.evaluator.posterior.unfold(self.rows[solved])
        full, _ = self.problem.part(recorded)
        true = self.problem.deviate(theta, full, emulated)
        square = self.problem.predict_error(emulated, theta)
        factor = np.sqrt((true**2 / np.maximum(square, UNMEASURED**2)).mean())
        return float(factor * np.maximum(predicted, UNMEASURED))
