"""The log-posterior: model, likelihood terms and prior, for a batch of walkers."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike
from scipy import stats

from .. import checks
from ..interfaces import (
    PLACE,
    Floats,
    LikelihoodTerm,
    ModalModel,
    PairedSolution,
    Parameters,
    Prior,
    SolveError,
)
from .compatibility import check_names, check_types, stored_modes
from .priors import inside, prior_summary


@dataclass(frozen=True, eq=False, init=False)
class LogPosterior:
    r"""Log-posterior of an FE model given modal data, for a batch of walkers.

    .. math:: \ln p(\theta | D) = \ln p(\theta) + \sum_t \ln p_t(D | \theta)

    Called with ``theta (n, d)`` it returns rows
    ``(log_posterior, log_prior, one value a term, f_1 .. f_m)``; with ``(d,)`` one
    such row. Of a model that pairs modes, the MAC of every pair and the number of the
    model's mode follow. emcee stores all but the first number as blobs, so that no FE
    solve is repeated. Rows outside the prior's support get -inf and NaN frequencies
    without a model call, and all others share one call of the model.

    Args:
        model: Parameters to modal solution (:class:`interfaces.ModalModel`).
        terms: One likelihood term or a sequence of them
            (:class:`interfaces.LikelihoodTerm`).
        prior: Owner of names, order and bounds (:class:`interfaces.Prior`).

    Raises:
        TypeError: If model or a term is not callable, or prior is not a prior.
        ValueError: If names do not match, more modes were measured than the model
            returns, or the prior admits a non-positive stiffness or mass, or a point
            outside the model's own bounds.

    Source: Eqs. 2.1 and 2.4 of Sherri, Boulkaibet, Marwala and Friswell.
    """

    model: ModalModel
    terms: tuple[LikelihoodTerm, ...]
    prior: Prior
    n_modes: int
    n_paired: int = field(repr=False)
    takes_batches: ClassVar[bool] = True
    term_names: tuple[str, ...] = field(repr=False)

    def __init__(
        self,
        model: ModalModel,
        terms: LikelihoodTerm | Sequence[LikelihoodTerm],
        prior: Prior,
    ) -> None:
        """See the class."""
        sequence = tuple(terms) if isinstance(terms, Sequence) else (terms,)
        check_types(model, sequence, prior)
        check_names(model, sequence, prior)
        names = tuple(
            str(getattr(term, "name", None) or getattr(term, "__name__", f"term{i}"))
            for i, term in enumerate(sequence)
        )
        object.__setattr__(self, "model", model)
        object.__setattr__(self, "terms", sequence)
        object.__setattr__(self, "prior", prior)
        object.__setattr__(self, "n_modes", stored_modes(model, sequence))
        paired = bool(getattr(model, "paired", False))
        object.__setattr__(self, "n_paired", self.n_modes if paired else 0)
        object.__setattr__(
            self, "term_names", checks.parameter_names("terms (their names)", names)
        )

    @property
    def names(self) -> tuple[str, ...]:
        """Parameter names, in the order of the sampled vector."""
        return self.prior.names

    @property
    def ndim(self) -> int:
        """Number of parameters."""
        return len(self.prior.names)

    def parameters(self, theta: Floats) -> Parameters:
        """Return the columns of ``theta (n, d)`` by parameter name."""
        return dict(zip(self.prior.names, theta.T, strict=True))

    @property
    def columns(self) -> dict[str, slice]:
        """Where in a row the densities, the frequencies and the pairing stand."""
        ends = np.cumsum([2 + len(self.terms), self.n_modes, *2 * [self.n_paired]])
        starts = (0, *ends[:-1].tolist())
        labels = ("densities", "frequency", "mac", "model_mode")
        return dict(zip(labels, map(slice, starts, ends.tolist()), strict=True))

    def __call__(self, theta: ArrayLike) -> Floats:
        """Return the row or the rows of ``theta``, see the class."""
        # Own copy, since a model may overwrite it; in rows, so that sums round alike.
        if type(theta) is not np.ndarray or theta.dtype != np.float64:
            theta = checks.numeric_array("theta", theta)
        batch = np.array(theta, order="C")
        if batch.ndim not in (1, 2) or batch.shape[-1] != self.ndim:
            raise ValueError(
                f"theta: expected shape ({self.ndim},) or (n, {self.ndim}) for "
                f"{self.names}, got {batch.shape}"
            )
        if batch.ndim == 1:
            single: Floats = self._rows(batch[None])[0]
            return single
        return self._rows(batch)

    def _rows(self, theta: Floats) -> Floats:
        log_prior = self.prior.logpdf(theta)
        supported = log_prior > -np.inf
        n_supported = np.count_nonzero(supported)
        if n_supported == len(theta) > 0:
            return self._solved(theta, log_prior)
        rows = np.tile(self.rejected(), (len(theta), 1))
        if np.isnan(log_prior).any():
            row = int(np.argmax(np.isnan(log_prior)))
            values = self._values(theta[row : row + 1])
            raise ValueError(f"prior: its log-density is NaN at {values}")
        if n_supported:
            rows[supported] = self._solved(theta[supported], log_prior[supported])
        return rows

    def rejected(self) -> Floats:
        """Return the row of a point that is not evaluated: -inf, then NaN."""
        columns = self.columns
        row = np.full(columns["model_mode"].stop, np.nan)
        row[columns["densities"]] = -np.inf
        return row

    def _solved(self, theta: Floats, log_prior: Floats) -> Floats:
        """Return the rows of parameter sets inside the prior's support."""
        n, first_mode = len(theta), 2 + len(self.terms)
        parameters = self.parameters(theta)
        try:
            modes = self.model(parameters)
        except (StopIteration, SystemExit) as error:
            # The one would lose its notes in emcee's generator, the other end the
            # program without a word, and with exit code 0.
            raise RuntimeError(
                f"model: it raised {error!r} at {self._values(theta)}"
            ) from error
        except Exception as error:
            notes = getattr(error, "__notes__", ())
            if not any(note.startswith(PLACE) for note in notes):
                error.add_note(f"{PLACE} {self._values(theta)}")
            raise
        frequencies = getattr(modes, "frequencies", None)
        if (
            not isinstance(frequencies, np.ndarray)
            or isinstance(frequencies, np.ma.MaskedArray)
            or frequencies.dtype.kind not in "fiu"
        ):
            raise TypeError(
                "model: expected a ModalSolution with an array of real frequencies, "
                f"got {modes!r} at {self._values(theta)}"
            )
        shape = frequencies.shape
        if len(shape) != 2 or shape[0] != n or shape[1] < self.n_modes:
            raise SolveError(
                "wrong number of modes",
                f"model: expected frequencies of shape ({n}, {self.n_modes}) or more "
                f"modes, got {shape} at {self._values(theta)}",
            )
        end = first_mode + self.n_modes
        rows = np.empty((n, end + 2 * self.n_paired))
        rows[:, 1] = total = log_prior
        for column, term in enumerate(self.terms, 2):
            value = term(parameters, modes)
            if type(value) is not np.ndarray or value.dtype != np.float64:
                value = checks.numeric_array(f"terms ({self._label(column)})", value)
            if value.shape != (n,):  # one number would do for all rows, unseen
                raise ValueError(
                    f"terms: expected {n} log-likelihoods of {self._label(column)}, "
                    f"got shape {value.shape}"
                )
            rows[:, column] = value
            total = total + value
        rows[:, 0] = total
        rows[:, first_mode:end] = frequencies[:, : self.n_modes]
        if self.n_paired:
            if not isinstance(modes, PairedSolution):
                raise TypeError(
                    "model: it says that it is paired, so expected a PairedSolution, "
                    f"got {type(modes).__name__}"
                )
            rows[:, end : end + self.n_paired] = modes.pairing.mac
            rows[:, end + self.n_paired :] = modes.pairing.model_modes
        # NaN and infinity survive a sum: one look finds them anywhere.
        if not np.isfinite(np.add.reduce(rows[:, first_mode:], axis=None)) or not (
            np.maximum.reduce(total) < np.inf
        ):
            raise self._not_finite(rows, theta)
        return rows

    def _label(self, column: int) -> str:
        return repr(self.term_names[column - 2])

    def _values(self, theta: Floats) -> Any:
        """Return parameter sets by name, for a message."""
        sets = [dict(zip(self.names, row, strict=True)) for row in theta.tolist()]
        return sets[0] if len(sets) == 1 else sets

    def _not_finite(self, rows: Floats, theta: Floats) -> SolveError:
        first_mode = 2 + len(self.terms)
        wrong = ~(rows[:, 0] < np.inf) | ~np.isfinite(rows[:, first_mode:]).all(axis=1)
        row = int(np.argmax(wrong))
        values = self._values(theta[row : row + 1])
        densities = dict(
            zip(("prior", *self.term_names), rows[row, 1:].tolist(), strict=False)
        )
        return SolveError(
            "not finite",
            f"the log-posterior is {rows[row, 0]} at {values}: log-densities "
            f"{densities}, frequencies {rows[row, first_mode:].tolist()}; a model "
            "must return finite frequencies, a term finite numbers, or -inf to reject",
        )

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
        """
        nwalkers = checks.whole_number("nwalkers", nwalkers, 1)
        try:
            rng = np.random.default_rng(seed)
        except (TypeError, ValueError) as error:
            raise type(error)(
                f"seed: expected what numpy.random.default_rng takes, got {seed!r} "
                f"({error})"
            ) from None
        if around is None:
            return self.prior.sample(rng, nwalkers)
        centre = checks.real_array("around", around, 1)
        self.check_inside("around", centre[None])
        spread = 0.1 * prior_summary(self.prior)[1]
        low, high = (self.prior.bounds.T - centre) / spread
        standard = stats.truncnorm.rvs(
            low, high, size=(nwalkers, self.ndim), random_state=rng
        )
        result: Floats = np.clip(  # rounding alone can pass a bound, by an ulp
            centre + spread * standard, *self.prior.bounds.T
        )
        return result

    def check_inside(self, argument: str, theta: Floats) -> None:
        """Raise ValueError, by name, if a row of ``theta (n, d)`` is out of bounds."""
        if theta.ndim != 2 or theta.shape[1] != self.ndim:
            raise ValueError(
                f"{argument}: expected one number for each of {self.names}, "
                f"got shape {theta.shape}"
            )
        bounds = self.prior.bounds
        if inside(theta, bounds).all():
            return
        within = (theta >= bounds[:, 0]) & (theta <= bounds[:, 1])
        row, column = np.argwhere(~within)[0]
        low, high = bounds[column]
        raise ValueError(
            f"{argument}: {self.names[column]} = {theta[row, column]:g} of point "
            f"{row} is outside its bounds ({low:g}, {high:g})"
        )
