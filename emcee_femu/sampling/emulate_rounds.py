"""The rounds of an emulation: solve, fit, draw, choose where to solve next."""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..interfaces import Floats, read
from ..surrogates.emulated import EmulatedModel, fit_emulated
from ..table import Table
from .design import batch_size, choose_batch, first_points
from .emulate_draws import EmulatedDraws, Explorer
from .emulate_problem import EmulationProblem, Response
from .journal import Journal
from .log_scale import LogScale

UNITS = 8  # points by which the errors of the measurement are read off the terms
FEWEST = 3  # points to which a process can be fitted
SETTLED = 2  # rounds in a row whose true error is to be small
TINY = 1e-6  # predicted error, in measurement errors, below which none is measured


@dataclass(eq=False)
class Rounds:
    """What was solved, and what was learned of it.

    Attributes:
        problem: What is emulated.
        journal: Solves in full.
        most: Full solves that may be spent.
        bar: Shows the progress.
        theta: Points ``(N, d)``.
        rows: What they gave ``(N, columns)``; -inf and NaN where a solve failed.
        explorer: Draws from emulated posteriors.
        emulator: The last fit.
        draws: Of its posterior.
        history: Solves, predicted and true error by round.
    """

    problem: EmulationProblem
    journal: Journal
    most: int
    bar: Any
    theta: Floats = field(init=False)
    rows: Floats = field(init=False)
    explorer: Explorer = field(init=False)
    emulator: EmulatedModel = field(init=False)
    draws: EmulatedDraws = field(init=False)
    history: list[tuple[int, float, float]] = field(init=False, default_factory=list)

    def run(self, seed: int, initial: Floats | None, tolerance: float) -> None:
        """Go on until the true error is small, or all solves are spent."""
        prior = self.problem.posterior.prior
        first, *_ = np.random.SeedSequence(seed).spawn(1)
        scale = LogScale.of(prior)
        self.theta = first_points(scale, first, initial)
        self.rows = self._solve(self.theta)
        self._check_solved()
        self.explorer = Explorer(self.problem, scale)
        settled = 0
        while True:
            self._fit(np.random.default_rng([seed, len(self.history)]))
            left = self.most - len(self.theta)
            if not left or settled == SETTLED:
                break
            points = self._choose(min(batch_size(len(prior.names)), left))
            rows = self._solve(points)
            error = self._true_error(points, rows)
            settled = settled + 1 if error <= tolerance else 0
            self._note(error)
            self.theta = np.vstack([self.theta, points])
            self.rows = np.vstack([self.rows, rows])
        self._note(np.nan)

    def result(self) -> EmulatedModel:
        """Return the last emulator, with what was spent and learned on the way."""
        solves, predicted, true = zip(*self.history, strict=True)
        columns: list[tuple[str, str, Any]] = [
            ("solves", "d", list(solves)),
            ("predicted error", ".3g", list(predicted)),
            ("true error", ".3g", list(true)),
        ]
        title = "Errors at draws of the posterior, in units of measurement error"
        return replace(
            self.emulator,
            history=Table.from_columns(title, columns),
            posterior=self.problem.replace_model(self.emulator),
        )

    @property
    def _solved(self) -> NDArray[np.bool_]:
        """Which points could be solved, ``(N,)``."""
        return np.isfinite(self.rows[:, 0])

    def _solve(self, points: Floats) -> Floats:
        """Return rows of full solves; each is stored as it arrives."""
        rows = np.empty((len(points), len(self.journal.posterior.rejected())))
        for number, row in self.journal.each(points):
            rows[number] = row
            self.bar.update(1)
        if failures := self.journal.evaluation.failures:
            failures.check(len(points))  # it begins by itself at a hundred solves
        return rows

    def _check_solved(self) -> None:
        """Stop if too few solves came through for a fit."""
        if (number := int(self._solved.sum())) < FEWEST:
            raise RuntimeError(
                f"on_failure: only {number} of {len(self.theta)} solves of the first "
                f"design came through, and {FEWEST} are the least for a fit. Mend the "
                "model, or narrow the prior to where it can be solved"
            )

    def _unfold(self, rows: Floats) -> Response:
        return self.journal.posterior.unfold(rows)

    def _fit(self, rng: np.random.Generator) -> None:
        """Fit the emulator to all that was solved, and draw from its posterior."""
        solved, problem = self._solved, self.problem
        theta, response = self.theta[solved], self._unfold(self.rows[solved])
        last = {name: values[-UNITS:] for name, values in response.items()}
        inputs = problem.inputs
        names = [problem.posterior.names[i] for i in inputs]
        limits = problem.posterior.prior.bounds[inputs].tolist()
        whiten = None
        if self.history:
            covariance = self.draws.covariance[np.ix_(inputs, inputs)]
            whiten = self.draws.mean[inputs], covariance
        self.emulator = fit_emulated(
            theta[:, inputs],
            response,
            problem.units(theta[-UNITS:], last),
            dict(zip(names, limits, strict=True)),
            variables=problem.variables,
            whiten=whiten,
            start=self.emulator if self.history else None,
            solves=self.journal.solves,
            logs=self.explorer.scale.logs[inputs],
        )
        self.draws = self.explorer.draw(self.emulator, len(theta), rng)

    def _choose(self, number: int) -> Floats:
        """Return the next points, the first where the posterior may yet turn out."""
        draws, processes = self.draws, self.emulator.processes

        def remaining(points: Floats, extra: Floats) -> Floats:
            at, new = self._coordinates(points), self._coordinates(extra)
            before = processes.variance_after(at, new[:0]).sum(axis=1)
            after = processes.variance_after(at, new).sum(axis=1)
            left: Floats = np.divide(
                after, before, out=np.zeros_like(after), where=before > 0
            )
            return left

        return choose_batch(
            [draws.wide, draws.theta],
            [draws.wide_errors, draws.errors],
            self.theta[~self._solved],
            number,
            remaining,
        )

    def _coordinates(self, theta: Floats) -> Floats:
        return self.emulator.coordinates(theta[:, self.problem.inputs])

    def _true_error(self, points: Floats, rows: Floats) -> float:
        """Return the true error at draws of the posterior, by that at new points."""
        solved = np.isfinite(rows[:, 0])
        if not solved.any():
            return np.inf
        points, full = points[solved], self._unfold(rows[solved])
        posterior = self.problem.posterior
        names = self.emulator.names
        given = posterior.parameters(points)
        response = self.emulator({name: given[name] for name in names})
        emulated = {
            name: np.asarray(read(response, name)) for name in self.emulator.variables
        }
        true = self.problem.deviate(points, full, emulated)
        own = self.problem.replace_model(self.emulator)
        predicted = np.maximum(self.problem.predict_error(own, points), TINY)
        factor = np.sqrt(((true / predicted) ** 2).mean())
        return float(factor * np.maximum(self.draws.predicted, TINY))

    def _note(self, error: float) -> None:
        predicted = self.draws.predicted
        self.history.append((len(self.theta), predicted, error))
        if hasattr(self.bar, "set_postfix_str") and np.isfinite(error):
            text = f"error {predicted:.2g} predicted, {error:.2g} true"
            self.bar.set_postfix_str(text)
