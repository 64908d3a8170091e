"""What was solved in full for one purpose, and is known for any other."""

from collections.abc import Iterator

import numpy as np

from ...contracts import Derivatives, Floats, Parameters, RepeatedModes, Response
from ...evaluation.evaluator import LOGGED, Bar, Evaluation, Failures, Solver
from ...evaluation.failures import FailureLog
from ...evaluation.resume import StoredEvaluation
from ...posterior.log_posterior import Kind
from .emulated import as_modal
from .encoding import Named
from .problem import EmulationProblem


class Archive(Evaluation):
    """An evaluation that solves no point twice, also none that a file holds.

    What was solved for one purpose is known for any other, so that a run may go on
    from a file in whatever order it asks. Only points that were asked for are counted.

    Args:
        evaluation: What solves, and stores.
        bar: What shows how many there are.
    """

    def __init__(self, evaluation: Evaluation, bar: Bar) -> None:
        super().__init__(evaluation.solver, evaluation.pool, evaluation.failures)
        self.bar, self._evaluation, self._asked = bar, evaluation, set[bytes]()
        self._known: dict[bytes, Floats] = {}
        if isinstance(evaluation, StoredEvaluation):
            store = evaluation.store
            for record in store.read(0, range(store.lengths().get(0, 0))):
                self._learn(record.theta)

    def each(self, theta: Floats) -> Iterator[tuple[int, Floats]]:
        """Yield number and row of each point; what is new is solved at once."""
        keys = [point.tobytes() for point in theta]
        new = {key: i for i, key in enumerate(keys) if key not in self._known}
        self._learn(theta[[*new.values()]])
        for number, key in enumerate(keys):
            if key not in self._asked:
                self._asked.add(key)
                self.solves += 1
                self.rejected += int(self._known[key][0] == -np.inf)
                self.bar.update(1)
            yield number, self._known[key]

    @property
    def failed(self) -> int:
        """Number of points that could not be solved."""
        return self.rejected

    def _learn(self, theta: Floats) -> None:
        for number, row in self._evaluation.each(theta):
            self._known[theta[number].tobytes()] = row


class RecalledModel:
    """The full model, by what an archive holds of it; the rest is solved there.

    Args:
        problem: What is emulated.
        archive: Evaluates its recorder.
    """

    one_by_one = True  # so that a failure is known

    def __init__(self, problem: EmulationProblem, archive: Archive) -> None:
        self.problem, self.archive = problem, archive
        self.variables, names = problem.variables, problem.posterior.names
        self.names = tuple(names[i] for i in problem.inputs)
        if problem.derivatives:
            self.jacobian = self._differentiate

    def __call__(self, parameters: Parameters) -> Response:
        """Return the response.

        Raises:
            ValueError: If a point could not be solved.
        """
        return as_modal(self._recall(parameters)[0])

    def _differentiate(self, parameters: Parameters) -> tuple[Response, Derivatives]:
        """Return the response and its derivatives, where they are known."""
        response, tangents = self._recall(parameters)
        if any(np.isnan(tangent).any() for tangent in tangents.values()):
            raise RepeatedModes("the model gave no derivatives at this point")
        slopes = {
            name: {other: tangent[..., j] for j, other in enumerate(self.names)}
            for name, tangent in tangents.items()
        }
        return as_modal(response), slopes

    def _recall(self, parameters: Parameters) -> tuple[Named, Named]:
        names = self.problem.posterior.names
        theta = np.column_stack([parameters[name] for name in names])
        rows = np.array([row for _, row in self.archive.each(theta)])
        if not np.isfinite(rows[:, 0]).all():
            raise ValueError("the model could not be solved at this point")
        return self.problem.part(self.archive.posterior.unfold(rows))


class RecalledEvaluation(Evaluation):
    """Evaluates the true posterior by an archive, all points of a batch at once."""

    def __init__(self, problem: EmulationProblem, archive: Archive) -> None:
        posterior = problem.replace_model(RecalledModel(problem, archive))
        super().__init__(Solver(posterior, True), None, FailureLog(1.0))
        self.archive, self.rejected = archive, LOGGED  # it has said so already

    def each(self, theta: Floats) -> Iterator[tuple[int, Floats]]:
        """Yield number and row of each point."""
        self._solve(theta)
        return super().each(theta)

    def _results(self, theta: Floats, kind: Kind) -> tuple[Floats, Failures]:
        self._solve(theta)
        return super()._results(theta, kind)

    def _solve(self, theta: Floats) -> None:
        for _ in self.archive.each(theta[self.posterior.support(theta)[1]]):
            pass
