"""The log-posterior: models, likelihood terms and prior, for a batch of walkers."""

import itertools
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property, partial
from typing import Any, Literal, Self, TypeAlias, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import checks
from ..contracts import LOG_POSTERIOR as LOG_POSTERIOR
from ..contracts import LOG_PRIOR as LOG_PRIOR
from ..contracts import (
    Floats,
    Linearization,
    Model,
    Parameters,
    Prior,
    Response,
    SolveError,
    Variable,
    read_declared,
)
from ..models.function import DensityModel
from ..table import Parts, Report
from .compatibility import check_names, check_parameters, check_prior
from .derivatives import along_tangents, difference, unstack
from .experiments import Experiment, Solved, Terms, Tests, check_joint, name_sets
from .priors import IndependentPrior, prior_centre, prior_scale, tabulate_prior

Units: TypeAlias = Mapping[str, str] | None  # by the names of parameters
Kept = TypeVar("Kept")
ANSWERS_KEPT = 4  # answers for each experiment
TRIED_DRAWS = 256  # of the prior, of which one must be possible to know the blobs

# What is evaluated at a point, side by side in one row that a pool or a file can hold:
# its row; with the gradient behind it; with the information behind that; or the row
# with the deviations of Gaussian terms and their standard deviations behind it.
Kind: TypeAlias = Literal["rows", "gradient", "linearization", "deviations"]


def log_likelihood(rows: Floats) -> Floats:
    """Return the log-likelihoods ``(n,)`` of rows."""
    return rows[:, LOG_POSTERIOR] - rows[:, LOG_PRIOR]


class LogPosterior(Report):
    r"""The log-posterior of one or several models, evaluated for a batch of walkers.

    .. math:: \ln p(\theta | D) = \ln p(\theta) + \sum_t \ln p_t(D | \theta)

    It combines a model, the likelihood terms t that compare its response with data D,
    and a prior. Pass it to :func:`run`, :func:`find_map`, :func:`anneal` or
    :func:`emulate`; use :meth:`joint` if several experiments share parameters.

    Called with parameter sets ``theta (n, d)``, it returns one row for each:
    ``(log_posterior, log_prior, one value per term, the stored variables of the
    response)``. Called with ``theta (d,)``, it returns one such row. emcee stores all
    columns but the first as blobs, so that tables and figures need no further solve.
    All sets inside the prior's support are solved in one call of the model. Sets
    outside get -inf and NaN variables and are not solved.

    Args:
        model: A callable that maps parameters to a response
            (:class:`contracts.Model`).
        terms: One likelihood term or a sequence of them
            (:class:`contracts.LikelihoodTerm`).
        prior: The prior, which defines names, order and bounds of the parameters
            (:class:`contracts.Prior`).
        units: Units of parameters by name, such as ``{"k1": "N/m"}``, for tables,
            figures and ArviZ objects. They change no number.

    Attributes:
        experiments: Models, terms and stored variables; a single entry unless made by
            :meth:`joint`.
        prior: The prior.
        units: Units by parameter name, for parameters that have one.
        term_names: Labels of the terms.
        names: Parameter names, in the order of ``theta``.
        ndim: Number of parameters d.
        terms: The likelihood terms of all experiments.
        variables: All stored variables, ``{name: Variable}``.
        columns: Their positions in a row, ``{name: slice}``, after "densities", the
            columns before them.
        draws: Points ``(n, d)`` from which "auto" searches, too; :func:`emulate` sets
            them.
        notes: Facts about how the posterior was made that its samples should carry;
            attributes of the posterior group of ArviZ objects. :func:`emulate` sets
            them.
        log_box: Natural logarithm of the volume of the box that was given to
            :meth:`from_function`; NaN otherwise.

    Raises:
        TypeError: If model or a term is not callable, prior is not a prior, or a unit
            is not text.
        ValueError: If parameter names do not match, units name an unknown parameter, a
            term needs a variable that the model does not return, or the prior admits a
            non-positive stiffness or mass, or values outside the model's bounds.

    Source: Eqs. 2.1 and 2.4 of Sherri, Boulkaibet, Marwala and Friswell.

    Examples:
        >>> import numpy as np
        >>> import emcee_femu as ef
        >>> model = ef.FunctionModel(lambda p: [p["k"] ** 0.5], n_modes=1)
        >>> term = ef.FrequencyTerm([3.0], relative_sd=0.01)
        >>> prior = ef.GaussianPrior(["k"], [8.0], [2.0], bounds=[(1.0, 20.0)])
        >>> posterior = ef.LogPosterior(model, term, prior)
        >>> posterior.labels
        ('log_posterior', 'log_prior', 'log_likelihood[frequency]', 'frequency[1]')
        >>> posterior([9.0]).round(4).tolist()
        [0.8508, -1.7369, 2.5876, 3.0]
    """

    draws: Floats | None = None
    notes: Mapping[str, object] | None = None
    log_box: float = np.nan

    def __init__(
        self, model: Model, terms: Terms, prior: Prior, units: Units = None
    ) -> None:
        self._set({"": (model, terms)}, prior, units)

    @classmethod
    def joint(cls, experiments: Tests, prior: Prior, units: Units = None) -> Self:
        r"""Return the posterior of several experiments that share parameters.

        .. math:: \ln p(\theta | D) = \ln p(\theta)
            + \sum_e \sum_{t \in e} \ln p_t(D_e | \theta)

        Use it for several states of one structure (empty and loaded, undamaged and
        damaged, at two temperatures) or for tests of different kinds. Each model is
        solved once per parameter set. Stored variables, their dimensions and the terms
        are prefixed with the experiment's name: ``empty.frequency (empty.mode)``.

        Args:
            experiments: ``{name: (model, terms)}``.
            prior: The prior of all parameters. Each model and term reads those that it
                uses.
            units: Units of parameters by name.

        Returns:
            The joint posterior, with one entry in ``experiments`` for each experiment.

        Raises:
            TypeError: If experiments is not such a mapping, or as for the class.
            ValueError: If it is empty, a name is not a plain word, or as for the class.

        Examples:
            >>> import emcee_femu as ef
            >>> empty = ef.FunctionModel(lambda p: [p["k"] ** 0.5], n_modes=1)
            >>> loaded = ef.FunctionModel(lambda p: [(p["k"] / 2) ** 0.5], n_modes=1)
            >>> tests = {"empty": (empty, ef.FrequencyTerm([3.0], relative_sd=0.01)),
            ...          "loaded": (loaded, ef.FrequencyTerm([2.1], relative_sd=0.01))}
            >>> prior = ef.GaussianPrior(["k"], [9.0], [1.0], [(1.0, 20.0)])
            >>> list(ef.LogPosterior.joint(tests, prior).variables)
            ['empty.frequency', 'loaded.frequency']
        """
        check_joint(experiments)
        self = cls.__new__(cls)
        self._set(experiments, prior, units)
        return self

    @classmethod
    def from_function(
        cls,
        log_likelihood: Callable[..., object],
        prior: Prior | Mapping[str, tuple[float, float]],
        vectorize: bool = False,
        args: Sequence[object] = (),
        kwargs: Mapping[str, object] | None = None,
        units: Units = None,
    ) -> Self:
        r"""Return the posterior of a log-likelihood function, such as emcee takes.

        Use it to sample a density that has no FE model. :func:`run`, :func:`find_map`,
        :func:`anneal`, :func:`log_evidence`, :func:`compare_moves`, :func:`diagnose`
        and ArviZ objects work as usual. Tables of measured quantities say that there
        are none, and :func:`emulate` refuses, because there is no response to learn.

        If your ``log_probability`` already includes the prior, pass it with bounds
        only; the samples follow it within these bounds. **The evidence is then that of
        the box**: the integral of ``exp(log_probability)`` over the box, divided by the
        volume V of the box, because the prior is taken to be uniform there. For the
        integral itself add ln V, which :func:`log_evidence` prints:

        .. math:: \ln \int p(D | \theta) \, p(\theta) \, d\theta = \ln Z + \ln V

        Args:
            log_likelihood: A function of ``(d,)`` that returns a number or, with blobs,
                ``log_likelihood, blob0, ...``. -inf means zero likelihood, not a
                failure; the blobs are then ignored. Each blob is a number or an array
                whose shape never changes; it is stored as the variable ``blob0``,
                ``blob1``, ... (in the group ``response`` of ArviZ objects). Their
                shapes are found by one extra evaluation at a draw of the prior. If you
                use ``workers``, define the function in a module.
            prior: Any prior whose names are those of the array's elements, in order; or
                ``{name: (low, high)}`` for a uniform prior between these bounds.
            vectorize: Whether the function takes all points at once, ``(n, d)``, and
                returns ``(n,)``, or n rows of a number and blobs.
            args: Further positional arguments of the function, as a tuple.
            kwargs: Further keyword arguments of the function, by name.
            units: Units of parameters by name.

        Returns:
            The posterior; its one term is called "density".

        Raises:
            TypeError: If an argument has the wrong type, or a log-likelihood or a blob
                is not a number.
            ValueError: If the function returns more than one number for a point, or is
                not finite at any of 256 draws of the prior.

        Examples:
            >>> import emcee_femu as ef
            >>> def log_likelihood(x, centre):
            ...     r = x - centre
            ...     return -0.5 * r @ r, r[0]
            >>> box = {"a": (-9.0, 9.0), "b": (-9.0, 9.0)}
            >>> posterior = ef.LogPosterior.from_function(
            ...     log_likelihood, box, args=([1.0, 2.0],))
            >>> posterior([1.5, 2.0]).round(3).tolist()
            [-5.906, -5.781, -0.125, 0.5]
        """
        boxes: list[tuple[float, float]] = []
        if isinstance(prior, Mapping):
            boxes, prior = [*prior.values()], IndependentPrior(prior)
        check_prior(prior)
        named = {} if kwargs is None else kwargs
        bare = DensityModel(log_likelihood, prior.names, vectorize, args, named)
        draws = prior.sample(np.random.default_rng(0), TRIED_DRAWS)
        self = cls(bare.declare_blobs(draws), bare.density, prior, units)
        if boxes and all(np.shape(ends) == (2,) for ends in boxes):
            self.log_box = float(np.log(np.diff(prior.bounds)).sum())
        return self

    def _set(self, pairs: Tests, prior: Prior, units: Units) -> None:
        check_prior(prior)
        self.units = checks.units_by_name("units", units, prior.names)
        self.prior, self.names, self.ndim = prior, prior.names, len(prior.names)
        self._recalled: dict[bytes, Floats] = {}
        self._answered: dict[tuple[str, bytes], Any] = {}
        self.experiments = tuple(Experiment(name, *pairs[name]) for name in pairs)
        self.terms = tuple(term for e in self.experiments for term in e.terms)
        labels = [[e.full_name(n) for n in e.term_names] for e in self.experiments]
        self.term_names = tuple(itertools.chain(*labels))
        self.variables = {
            e.full_name(name): Variable(
                {e.full_name(dim): labels for dim, labels in variable.coords.items()},
                variable.unit,
            )
            for e in self.experiments
            for name, variable in e.variables.items()
        }
        check_names(prior, self.variables, self.term_names)
        check_parameters([e.model for e in self.experiments], self.terms, prior)
        self.row_size = 2 + len(self.terms)
        self.columns = {"densities": slice(0, self.row_size)}
        for name, variable in self.variables.items():
            begin, self.row_size = self.row_size, self.row_size + variable.size
            self.columns[name] = slice(begin, self.row_size)

    def _parts(self) -> Parts:
        yield tabulate_prior("Log-posterior", self.prior, self.units)
        for experiment in self.experiments:
            name = f"{experiment.name}: " if experiment.name else ""
            terms = ", ".join(experiment.term_names)
            stored = ", ".join(experiment.variables) or "nothing"
            model = type(experiment.model).__name__
            yield f"{name}{model}; terms: {terms}; stored: {stored}"

    @property
    def model(self) -> Model:
        """The model, if there is only one experiment.

        Raises:
            ValueError: If there are several experiments.
        """
        if len(self.experiments) > 1:
            names = [experiment.name for experiment in self.experiments]
            raise ValueError(f"model: one for each of {names}; see experiments")
        return self.experiments[0].model

    @property
    def error_names(self) -> tuple[str, ...]:
        """Parameters that only terms read, such as errors and discrepancies."""
        models = [read_declared(e.model, "names") or () for e in self.experiments]
        by_terms = {name for term in self.terms for name in term.names or ()}
        errors = by_terms.difference(*models)
        return tuple(name for name in self.names if name in errors)

    @property
    def labels(self) -> tuple[str, ...]:
        """The label of each column of a row, such as ``frequency[1]``."""
        labels = ["log_posterior", "log_prior"]
        labels += [f"log_likelihood[{name}]" for name in self.term_names]
        for name, variable in self.variables.items():
            for at in itertools.product(*variable.coords.values()):
                labels.append(f"{name}[{', '.join(map(str, at))}]" if at else name)
        return tuple(labels)

    def with_models(self, wrap: Callable[[Model], Model]) -> Self:
        """Return the same posterior with each model replaced by ``wrap(model)``."""
        other = type(self).__new__(type(self))
        pairs = {e.name: (wrap(e.model), e.terms) for e in self.experiments}
        other._set(pairs, self.prior, self.units)
        other.log_box = self.log_box
        return other

    def parameters(self, theta: Floats) -> Parameters:
        """Return the columns of ``theta (n, d)`` as a dictionary by parameter name."""
        return dict(zip(self.prior.names, theta.T, strict=True))

    def split(self, stacked: Floats) -> tuple[slice, slice, slice]:
        """Return the slices of rows, r and sd in what "deviations" stacks."""
        middle = (self.row_size + stacked.shape[-1]) // 2
        return slice(self.row_size), slice(self.row_size, middle), slice(middle, None)

    def unfold(self, rows: Floats) -> dict[str, Floats]:
        """Return the stored variables in ``rows (..., columns)``, by name."""
        return {
            name: rows[..., self.columns[name]].reshape((*rows.shape[:-1], *v.shape))
            for name, v in self.variables.items()
        }

    def __call__(self, theta: ArrayLike) -> Floats:
        """Return the row of ``theta (d,)`` or the rows of ``theta (n, d)``."""
        return self.stack(theta, "rows")

    def gradient(self, theta: ArrayLike) -> tuple[Floats, Floats]:
        r"""Return the rows and the gradients ``(n, d)`` at ``theta (n, d)``.

        .. math:: \partial \ln p(\theta | D) / \partial \theta_i

        This takes one solve per point if all models have a ``jacobian``. Otherwise
        central differences are used: ``2 d + 1`` solves per point, in one batch and
        inside the prior's support. Terms and priors without derivatives of their own
        are differentiated numerically, without a solve. The gradient is NaN where the
        log-posterior is -inf.

        Args:
            theta: Parameter sets ``(n, d)``, or one set ``(d,)`` for one row and one
                gradient.

        Raises:
            ValueError: If a gradient is not finite at a point of finite density.

        Examples:
            >>> import numpy as np
            >>> import emcee_femu as ef
            >>> problem = ef.paper.mass_spring()
            >>> rows, gradient = problem.posterior.gradient([*problem.target.values()])
            >>> bool(np.abs(gradient * 100).max() < 1)  # per 100 N/m: near the maximum
            True
        """
        stacked = self.stack(theta, "gradient")
        rows, gradient, _ = unstack(self, np.atleast_2d(stacked))
        return (rows, gradient) if stacked.ndim == 2 else (rows[0], gradient[0])

    def linearize(self, theta: ArrayLike) -> Linearization:
        """Return rows, gradients and information matrices at ``theta (n, d)``.

        The information is the Fisher information of the likelihood minus the Hessian of
        the log-prior. Near a good fit, ``-information`` approximates the Hessian of the
        log-posterior (Gauss-Newton). It is None if a term has no ``deviations``. The
        cost in solves is that of :meth:`gradient`.
        """
        return unstack(self, self.stack(np.atleast_2d(theta), "linearization"))

    def stack(self, theta: ArrayLike, kind: Kind) -> Floats:
        """Return everything evaluated at each of ``theta (n, d)`` as one row.

        Rows outside the prior's support hold -inf, then NaN.
        """
        points = checks.numeric_array("theta", theta)
        if points.ndim not in (1, 2) or points.shape[-1] != self.ndim:
            raise ValueError(
                f"theta: expected shape ({self.ndim},) or (n, {self.ndim}) for "
                f"{self.names}, got {points.shape}"
            )
        batch = points if points.ndim == 2 else points[None]
        log_prior, supported = self.support(batch)
        if supported.all() and len(batch):  # as nearly always: no copies
            stacked = self._stack(batch, log_prior, kind)
        else:
            rejected = self.rejected()
            values = rejected[None][:0]
            if supported.any():
                values = self._stack(batch[supported], log_prior[supported], kind)
            stacked = np.full((len(batch), values.shape[1]), np.nan)
            stacked[:, : len(rejected)] = rejected
            stacked[supported] = values
        return stacked if points.ndim == 2 else stacked[0]

    def _stack(self, theta: Floats, log_prior: Floats, kind: Kind) -> Floats:
        """Return what :meth:`stack` does, inside the prior's support."""
        information = kind == "linearization"
        gradient = information or kind == "gradient"
        if gradient and not self.differentiable:
            around = partial(self.stack, kind="deviations")
            return difference(self, theta, around, information)
        parameters = self.parameters(theta)
        solved = [e.solve(parameters, self.names, gradient) for e in self.experiments]
        rows = self._gather(theta, log_prior, solved)
        if gradient:
            rest = along_tangents(self, theta, rows, solved, information)
            return np.hstack([rows, rest])
        if kind == "rows":
            return rows
        every = [(t, part.response) for part in solved for t in part.terms]
        pairs = [term.deviations(parameters, response) for term, response in every]
        r_and_sd = zip(*filter(None, pairs), strict=True)
        return np.hstack([rows, *itertools.chain(*r_and_sd)])

    def _gather(
        self, theta: Floats, log_prior: Floats, solved: Sequence[Solved]
    ) -> Floats:
        """Assemble the rows from what experiments return; refuse NaN and infinity."""
        values = [value for part in solved for value in part.log_likelihoods]
        stored = [value for part in solved for value in part.stored]
        total = sum(values, start=log_prior)
        densities = [column[:, None] for column in (total, log_prior, *values)]
        rows: Floats = np.concatenate([*densities, *stored], axis=1)
        # NaN and infinity survive a sum: one look finds them anywhere.
        first = self.columns["densities"].stop
        if np.isfinite(rows[:, first:].sum()) and total.max() < np.inf:
            return rows
        wrong = ~(rows < np.inf)
        # What is impossible need not have been solved, as of blobs.
        unsolved = np.isnan(rows[:, first:]) & (total == -np.inf)[:, None]
        wrong[:, first:] = ~(np.isfinite(rows[:, first:]) | unsolved)
        if wrong.any():  # else the sum overflowed, not a number
            row = int(np.argmax(wrong.any(axis=1)))
            columns = zip(self.labels, rows[row].tolist(), wrong[row], strict=True)
            raise SolveError(
                "not finite",
                f"at {name_sets(self.parameters(theta[row : row + 1]))}: "
                f"{ {label: value for label, value, bad in columns if bad} }; a model "
                "must return finite numbers, a term finite ones, or -inf to reject. If "
                "the parameters make no sense, give the prior bounds",
            )
        return rows

    def rejected(self) -> Floats:
        """Return the row of a point that is not solved: -inf, then NaN."""
        row = np.full(self.row_size, np.nan)
        row[self.columns["densities"]] = -np.inf
        return row

    def support(self, theta: Floats) -> tuple[Floats, NDArray[np.bool_]]:
        """Return the log-prior and whether it is finite, each ``(n,)``."""
        log_prior = self.prior.logpdf(theta)
        supported = log_prior > -np.inf
        if not supported.all() and np.isnan(log_prior).any():
            row = int(np.argmax(np.isnan(log_prior)))
            values = name_sets(self.parameters(theta[row : row + 1]))
            raise ValueError(f"prior: its log-density is NaN at {values}")
        return log_prior, supported

    @property
    def one_by_one(self) -> bool:
        """Whether any model solves parameter sets one at a time."""
        return any(read_declared(e.model, "one_by_one") for e in self.experiments)

    @property
    def differentiable(self) -> bool:
        """Whether all models have ``jacobian``, so that a gradient takes one solve."""
        return all(e.jacobian is not None for e in self.experiments)

    @property
    def normal(self) -> bool:
        """Whether all terms are Gaussian in the measured quantities."""
        return all(term.gaussian for term in self.terms)

    @cached_property
    def scale(self) -> Floats:
        """The prior scale of each parameter, computed from its quartiles, ``(d,)``."""
        return prior_scale(self.prior)

    @cached_property
    def initial(self) -> Floats:
        """The row at the prior mean, from one solve; NaN if that solve fails."""
        try:
            return self(prior_centre(self.prior))
        except Exception:  # of any kind: it is the user's model that raised
            return self.rejected()

    def recall(self, theta: Floats) -> Floats:
        """Return the row of a point ``(d,)``, solving it only the first time.

        Tables ask for the same few points each time they are printed.
        """
        key = theta.tobytes()
        if key not in self._recalled:
            self._recalled[key] = self(theta)
        return self._recalled[key]

    def answer(self, theta: Floats, experiment: Experiment) -> Response:
        """Return a model's response to ``theta (n, d)``, solved only the first time."""

        def solve() -> Response:
            solved = experiment.solve(self.parameters(theta), self.names)
            return solved.response

        return self.remember(experiment.name, theta, solve)

    def remember(self, what: str, theta: Floats, solve: Callable[[], Kept]) -> Kept:
        """Return what was solved before at ``theta (n, d)``, or solve it now.

        A few answers are kept, for what asks again about the same samples.
        """
        key = what, theta.tobytes()
        if key not in self._answered:
            if len(self._answered) >= ANSWERS_KEPT * len(self.experiments):
                self._answered.clear()
            self._answered[key] = solve()
        kept: Kept = self._answered[key]
        return kept

    def start(
        self, nwalkers: int, seed: int | np.random.SeedSequence | np.random.Generator
    ) -> Floats:
        """Draw starting positions ``(nwalkers, d)`` from the prior.

        Such starts are over-dispersed, which independent ensembles need to reveal a
        maximum that one of them missed.

        Args:
            nwalkers: Number of walkers.
            seed: Any seed that ``numpy.random.default_rng`` accepts.

        Raises:
            TypeError: If nwalkers is not a whole number.
            ValueError: If nwalkers < 1.

        Examples:
            >>> import emcee_femu as ef
            >>> posterior = ef.paper.mass_spring().posterior
            >>> posterior.start(20, seed=1).shape
            (20, 5)
        """
        nwalkers = checks.whole_number("nwalkers", nwalkers, 1)
        try:
            rng = np.random.default_rng(seed)
        except (TypeError, ValueError) as error:
            taken = "what numpy.random.default_rng takes"
            raise type(error)(
                f"seed: expected {taken}, got {seed!r} ({error})"
            ) from None
        return self.prior.sample(rng, nwalkers)

    def check_inside(self, argument: str, theta: Floats) -> None:
        """Raise a ValueError that names the first row of ``theta`` out of bounds."""
        if theta.ndim != 2 or theta.shape[1] != self.ndim:
            each = f"one number for each of {self.names}"
            raise ValueError(f"{argument}: expected {each}, got shape {theta.shape}")
        low, high = self.prior.bounds.T
        outside = np.argwhere(~((theta >= low) & (theta <= high)))
        for row, column in outside[:1]:
            place = f" of point {row}" if len(theta) > 1 else ""
            raise ValueError(
                f"{argument}: {self.names[column]} = {theta[row, column]:g}{place} is "
                f"outside its bounds ({low[column]:g}, {high[column]:g})"
            )
