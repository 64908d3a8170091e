"""The log-posterior: models, likelihood terms and prior, for a batch of walkers."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import product
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import checks
from ..interfaces import (
    Floats,
    LikelihoodTerm,
    Linearization,
    Model,
    Parameters,
    Prior,
    Variable,
)
from ..table import Parts, Report
from .compatibility import check_names, check_parameters
from .differences import prior_scale
from .experiments import Experiment, check_joint, gather_experiments
from .linearize import linearize, split, unstack
from .messages import name_sets, not_finite
from .numerical import difference, extend
from .prior_table import tabulate_prior
from .starting import check_inside, draw_start


@dataclass(frozen=True, eq=False, init=False)
class LogPosterior(Report):
    r"""Log-posterior of one model or several, given data, for a batch of walkers.

    .. math:: \ln p(\theta | D) = \ln p(\theta) + \sum_t \ln p_t(D | \theta)

    Called with ``theta (n, d)`` it returns rows ``(log_posterior, log_prior, one value
    per term, the stored variables of the response)``; with ``(d,)`` one such row.
    emcee stores all but the first number as blobs, so that no FE solve is repeated.
    Rows outside the prior's support get -inf and NaN variables without a model call,
    and all others share one call of each model.

    Args:
        model: Parameters to response (:class:`interfaces.Model`).
        terms: One likelihood term or a sequence of them
            (:class:`interfaces.LikelihoodTerm`).
        prior: Owner of names, order and bounds (:class:`interfaces.Prior`).

    Attributes:
        experiments: Models, terms and stored variables; one unless made by
            :meth:`joint`.
        prior: The prior.
        term_names: Labels of all terms.
        variables: All stored variables, ``{name: Variable}``.
        columns: Where they are in a row, ``{name: slice}``, after "densities".

    Raises:
        TypeError: If model or a term is not callable, or prior is not a prior.
        ValueError: If names do not match, a term needs what the model does not return,
            or the prior admits a non-positive stiffness or mass, or a point outside the
            model's own bounds.

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

    experiments: tuple[Experiment, ...]
    prior: Prior
    term_names: tuple[str, ...] = field(repr=False)
    variables: dict[str, Variable] = field(repr=False)
    columns: dict[str, slice] = field(repr=False)
    _width: int = field(repr=False)
    takes_batches: ClassVar[bool] = True

    def __init__(
        self,
        model: Model,
        terms: LikelihoodTerm | Sequence[LikelihoodTerm],
        prior: Prior,
    ) -> None:
        self._set({"": (model, terms)}, prior)

    @classmethod
    def joint(cls, experiments: Mapping[str, tuple[Model, Any]], prior: Prior) -> Self:
        r"""Return the posterior of several experiments that share parameters.

        .. math:: \ln p(\theta | D) = \ln p(\theta)
            + \sum_e \sum_{t \in e} \ln p_t(D_e | \theta)

        States of one structure (empty and loaded, at two temperatures) or tests of
        different kinds. Each model is solved once per parameter set. Stored variables,
        their dimensions and the terms carry the experiment's name: ``empty.frequency
        (empty.mode)``.

        Args:
            experiments: ``{name: (model, terms)}``.
            prior: The prior of all parameters; a model or term reads those it knows.

        Returns:
            The posterior, with an entry of ``experiments`` for each.

        Raises:
            TypeError: If experiments is not such a mapping; see also the class.
            ValueError: If it is empty, or a name is not a plain word; see also the
                class.

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
        self._set(experiments, prior)
        return self

    def _set(self, given: Mapping[str, tuple[Model, Any]], prior: Prior) -> None:
        experiments = gather_experiments(given, prior)
        names = [e.full_name(name) for e in experiments for name in e.term_names]
        variables = {
            e.full_name(name): Variable(
                {e.full_name(dim): labels for dim, labels in own.coords.items()},
                own.unit,
            )
            for e in experiments
            for name, own in e.variables.items()
        }
        check_names(prior, variables, names)
        terms = [term for e in experiments for term in e.terms]
        check_parameters(tuple(e.model for e in experiments), terms, prior)
        ends = np.cumsum([2 + len(terms), *(v.size for v in variables.values())])
        slices = map(slice, (0, *ends[:-1].tolist()), ends.tolist())
        checks.set_fields(
            self,
            experiments=experiments,
            prior=prior,
            term_names=tuple(names),
            variables=variables,
            columns=dict(zip(["densities", *variables], slices, strict=True)),
            _width=int(ends[-1]),
        )

    def _parts(self) -> Parts:
        yield tabulate_prior("Log-posterior", self.prior)
        for one in self.experiments:
            name = f"{one.name}: " if one.name else ""
            terms, stored = ", ".join(one.term_names), ", ".join(one.variables)
            yield f"{name}{type(one.model).__name__}; terms: {terms}; stored: {stored}"

    @property
    def model(self) -> Model:
        """The model, if there is only one.

        Raises:
            ValueError: If there are several experiments.
        """
        if len(self.experiments) > 1:
            names = [experiment.name for experiment in self.experiments]
            raise ValueError(
                f"model: there is one for each of {names}; see experiments"
            )
        return self.experiments[0].model

    @property
    def terms(self) -> tuple[LikelihoodTerm, ...]:
        """The likelihood terms of all experiments, in the order of ``term_names``."""
        return tuple(term for e in self.experiments for term in e.terms)

    @property
    def names(self) -> tuple[str, ...]:
        """Parameter names, in the order of the sampled vector."""
        return self.prior.names

    @property
    def ndim(self) -> int:
        """Number of parameters."""
        return len(self.prior.names)

    @property
    def error_names(self) -> tuple[str, ...]:
        """Parameters that only terms read, such as errors and discrepancies."""
        read_by_models = {n for e in self.experiments for n in _names(e.model)}
        by_terms = {n for term in self.terms for n in _names(term)}
        return tuple(n for n in self.names if n in by_terms - read_by_models)

    @property
    def one_by_one(self) -> bool:
        """Whether a model solves one parameter set after another."""
        return any(getattr(e.model, "one_by_one", False) for e in self.experiments)

    @property
    def labels(self) -> tuple[str, ...]:
        """What each column of a row is, such as ``frequency[1]``."""
        densities = ["log_posterior", "log_prior"]
        densities += [f"log_likelihood[{name}]" for name in self.term_names]
        numbers = [
            name + (f"[{', '.join(map(str, where))}]" if where else "")
            for name, variable in self.variables.items()
            for where in product(*variable.coords.values())
        ]
        return (*densities, *numbers)

    def with_models(self, wrap: Callable[[Model], Model]) -> Self:
        """Return the same posterior with wrapped models, which may count solves."""
        other = type(self).__new__(type(self))
        given = {e.name: (wrap(e.model), e.terms) for e in self.experiments}
        other._set(given, self.prior)
        return other

    def parameters(self, theta: Floats) -> Parameters:
        """Return the columns of ``theta (n, d)`` by parameter name."""
        return dict(zip(self.prior.names, theta.T, strict=True))

    def unfold(self, rows: Floats) -> dict[str, Floats]:
        """Return the stored variables of ``rows (..., columns)``, by name."""
        return {
            name: rows[..., self.columns[name]].reshape((*rows.shape[:-1], *v.shape))
            for name, v in self.variables.items()
        }

    def __call__(self, theta: ArrayLike) -> Floats:
        """Return the row or the rows of ``theta``, see the class."""
        batch = self._batch(theta)
        if batch.ndim == 1:
            single: Floats = self._rows(batch[None])[0]
            return single
        return self._rows(batch)

    def _batch(self, theta: ArrayLike) -> Floats:
        # A copy in rows, so that sums round alike.
        if type(theta) is not np.ndarray or theta.dtype != np.float64:
            theta = checks.numeric_array("theta", theta)
        batch = np.array(theta, order="C")
        if batch.ndim not in (1, 2) or batch.shape[-1] != self.ndim:
            raise ValueError(
                f"theta: expected shape ({self.ndim},) or (n, {self.ndim}) for "
                f"{self.names}, got {batch.shape}"
            )
        return batch

    def _rows(self, theta: Floats) -> Floats:
        log_prior, supported = self.support(theta)
        n_supported = np.count_nonzero(supported)
        if n_supported == len(theta) > 0:
            return self.solve(theta, log_prior)
        rows = np.tile(self.rejected(), (len(theta), 1))
        if n_supported:
            rows[supported] = self.solve(theta[supported], log_prior[supported])
        return rows

    def support(self, theta: Floats) -> tuple[Floats, NDArray[np.bool_]]:
        """Return the log-prior, and where there is one, each ``(n,)``."""
        log_prior = self.prior.logpdf(theta)
        supported: NDArray[np.bool_] = log_prior > -np.inf
        if not supported.all() and np.isnan(log_prior).any():
            row = int(np.argmax(np.isnan(log_prior)))
            values = name_sets(self.names, theta[row : row + 1])
            raise ValueError(f"prior: its log-density is NaN at {values}")
        return log_prior, supported

    @property
    def differentiable(self) -> bool:
        """Whether every model has ``jacobian``, so that gradients take one solve."""
        return all(
            getattr(e.model, "jacobian", None) is not None for e in self.experiments
        )

    @cached_property
    def scale(self) -> Floats:
        """The scale of each parameter under the prior ``(d,)``."""
        return prior_scale(self.prior)

    def gradient(self, theta: ArrayLike) -> tuple[Floats, Floats]:
        r"""Return the rows of ``theta (n, d)`` and the gradients ``(n, d)``.

        .. math:: \partial \ln p(\theta | D) / \partial \theta_i

        One solve per point where the models have ``jacobian``; else central
        differences, whose ``2 d + 1`` points are solved in one batch, all inside the
        prior's support. Terms and priors without derivatives of their own are
        differenced without a solve. Where a row is -inf the gradient is NaN.

        Args:
            theta: Parameter sets ``(n, d)``; with ``(d,)`` one row and gradient.

        Raises:
            ValueError: If a gradient is not finite where the posterior is.

        Examples:
            >>> import numpy as np
            >>> import emcee_femu as ef
            >>> problem = ef.paper.mass_spring()
            >>> rows, gradient = problem.posterior.gradient([*problem.target.values()])
            >>> bool(np.abs(gradient * 100).max() < 1)  # per 100 N/m: near the maximum
            True
        """
        return split(self, self.stack_gradient(theta))

    def linearize(self, theta: ArrayLike) -> Linearization:
        r"""Return rows, gradients and information of ``theta (n, d)``.

        The information is that of Fisher of the likelihood, minus the Hessian of the
        log-prior: ``-information`` is near the Hessian of the log-posterior where the
        model fits (Gauss-Newton). None if a term has neither ``linearize`` with scores
        nor ``deviations``. See also :meth:`gradient`.
        """
        return unstack(self, self.stack_linearization(np.atleast_2d(theta)))

    def stack_gradient(self, theta: ArrayLike) -> Floats:
        """Return rows with the gradients behind them, which a pool can carry."""
        return self._stack(theta, False)

    def stack_linearization(self, theta: ArrayLike) -> Floats:
        """Return rows with gradients and information behind them."""
        return self._stack(theta, True)

    def stack_deviations(self, theta: ArrayLike) -> Floats:
        """Return rows with the terms' deviations behind them, to be differenced."""
        batch = self._batch(theta)
        result = extend(self, np.atleast_2d(batch))
        return result[0] if batch.ndim == 1 else result

    def _stack(self, theta: ArrayLike, information: bool) -> Floats:
        batch = self._batch(theta)
        points = np.atleast_2d(batch)
        if self.differentiable:
            result = linearize(self, points, information)
        else:
            result = difference(self, points, self.stack_deviations, information)
        return result[0] if batch.ndim == 1 else result

    def rejected(self) -> Floats:
        """Return the row of a point that is not evaluated: -inf, then NaN."""
        row = np.full(self._width, np.nan)
        row[self.columns["densities"]] = -np.inf
        return row

    def solve(
        self, theta: Floats, log_prior: Floats, solve: Any = Experiment.solve
    ) -> Floats:
        """Return the rows of parameter sets inside the prior's support.

        Args:
            theta: Parameter sets ``(n, d)``.
            log_prior: Their log-prior ``(n,)``.
            solve: What ``Experiment.solve`` does, and perhaps more.
        """
        rows = np.empty((len(theta), self._width))
        rows[:, 1] = total = log_prior
        parameters = self.parameters(theta)
        column, first = 2, self.columns["densities"].stop
        end = first
        for experiment in self.experiments:
            own = self.parameters(theta.copy())  # which a model may overwrite
            values, stored = solve(
                experiment,
                own,
                parameters,
                len(theta),
                lambda: name_sets(self.names, theta),
            )
            for value in values:
                rows[:, column] = value
                total = total + value
                column += 1
            for value in stored:
                start, end = end, end + value.shape[1]
                rows[:, start:end] = value
        rows[:, 0] = total
        # NaN and infinity survive a sum: one look finds them anywhere.
        if not np.isfinite(np.add.reduce(rows[:, first:], axis=None)) or not (
            np.maximum.reduce(total) < np.inf
        ):
            raise not_finite(self, rows, theta)
        return rows

    def start(
        self, nwalkers: int, seed: Any, around: ArrayLike | None = None
    ) -> Floats:
        """Draw starting positions ``(nwalkers, d)``, all inside the bounds.

        The default is over-dispersed, a draw from the prior: only then can independent
        ensembles reveal a mode that one of them missed.

        Args:
            nwalkers: Number of walkers.
            seed: Anything that ``numpy.random.default_rng`` takes.
            around: A point ``(d,)``; the walkers are then Gaussian about it with a
                tenth of the prior's standard deviation, cut at the bounds.

        Raises:
            TypeError: If nwalkers is not a whole number.
            ValueError: If nwalkers < 1, or around lies outside the bounds.

        Examples:
            >>> import emcee_femu as ef
            >>> posterior = ef.paper.mass_spring().posterior
            >>> posterior.start(20, seed=1).shape
            (20, 5)
        """
        return draw_start(self.prior, nwalkers, seed, around)

    def check_inside(self, argument: str, theta: Floats) -> None:
        """Raise ValueError, by name, if a row of ``theta (n, d)`` is out of bounds."""
        check_inside(self.prior, argument, theta)


def _names(reader: Any) -> tuple[str, ...]:
    return tuple(getattr(reader, "names", None) or ())
