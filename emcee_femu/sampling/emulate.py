"""Emulate a model from few solves, chosen where the posterior needs them."""

from os import PathLike
from typing import Any

import emcee
import numpy as np
from numpy.typing import ArrayLike

from .. import checks
from ..interfaces import Floats
from ..posterior.log_posterior import LogPosterior
from ..surrogates.emulated import EmulatedModel
from .arguments import check_file, check_progress
from .design import batch_size, first_size
from .emulate_problem import EmulationProblem
from .emulate_rounds import FEWEST, Rounds
from .evaluation import Evaluation
from .journal import Journal
from .manifest import describe
from .pools.own_processes import open_pool


def emulate(
    posterior: LogPosterior,
    solves: int = 60,
    *,
    seed: int,
    pool: Any = None,
    workers: int | None = None,
    backend: str | PathLike[str] | None = None,
    tolerance: float = 0.1,
    initial: ArrayLike | None = None,
    on_failure: str = "raise",
    max_failures: float = 0.2,
    progress: bool | str = False,
    probe_tolerance: float = 1e-6,
) -> EmulatedModel:
    r"""Emulate the model of a posterior by Gaussian processes, from few full solves.

    For a model whose solve takes seconds or more and that is not affine in its
    parameters. The response (eigenvalues, shapes at the sensors, any real vector that
    a term reads) is emulated, not the scalar posterior, and the likelihood knows how
    far the emulator may be off. The first ``d + 4`` solves are spread over the prior,
    then batches of ``d / 2 + 1`` go where the emulator is most in doubt among draws of
    the emulated posterior, the first of each batch among draws of a wider one, whose
    emulator errs twice as much as it says. The draws are found anew from the whole
    prior after each batch, so that modes that one emulator excludes come back with the
    next. A parameter whose prior spans decades is seen by its logarithm.

    **The error** of an emulated response r' is its distance from the full one as the
    data see it,

    .. math:: e = \Big[\sum_i (r_i - r'_i)^2 / \sigma_i^2\Big]^{1/2}

    over all data, paired as a full solve would be. ``e = 0.1`` moves a posterior mean
    by a tenth of a standard deviation at the very most, and weights that correct the
    draws are then about 99 % efficient. The **true error** of a round is the root mean
    square of e that was predicted at draws of the emulated posterior, times the factor
    by which the full solves of the round exceeded what was predicted for them (the
    root mean square of the ratios): a prediction alone understates. Below
    ``tolerance`` in two rounds running, no more is solved.

    What the emulator excludes with confidence is not seen: let :func:`certify` decide.

    Args:
        posterior: What is to be sampled; of one experiment. A :class:`PairedModel`
            pairs the emulated modes as it would those of a full solve.
        solves: The most full solves, all counted.
        seed: A whole number; the same seed gives the same emulator, to the bit.
        pool: Where to solve, as in :func:`run`. A batch is solved at once, so
            ``d / 2 + 1`` workers can be busy.
        workers: Number of processes to start instead, as in :func:`run`.
        backend: Name of a file that keeps every solve as it arrives, such as
            "run.solves". If it is there, the solves in it are not repeated, whether a
            call was killed, or ended and is now given more ``solves`` or a smaller
            ``tolerance``: the result is that of one call, to the bit. One more solve
            then tells a changed model.
        tolerance: True error at draws of the posterior at which to stop, in standard
            deviations of the measurement, see above; 0 to spend all solves.
        initial: A point ``(d,)`` about which the first design lies, within a quarter of
            the prior's spread, such as that of :func:`find_map`; or points ``(n, d)``
            that are the first design; None for the whole prior.
        on_failure: What a failed solve does: "raise", or "reject" to leave the point
            out of the fit, and not ask there again. It counts as a solve.
        max_failures: Fraction of the solves, of the first design or more, above which
            "reject" stops.
        progress: Whether to show a bar with solves, errors and the time left (needs
            tqdm); "notebook" for the bar of notebooks (needs ipywidgets too).
        probe_tolerance: Relative difference above which the solve that tells a changed
            model counts as another.

    Returns:
        The emulated model: ``posterior`` is ready to :func:`run`, ``solves`` the
        full solves spent, ``history`` the errors round by round.

    Raises:
        TypeError: If posterior is not a LogPosterior, or a count not a whole number.
        ValueError: If solves do not suffice for a first design and a batch, an initial
            point is out of bounds, there are several experiments, or the file is of
            something else. All but what the model does are raised before a solve.
        ImportError: If progress is "notebook" and ipywidgets is not installed.
        RuntimeError: If too many solves failed.

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
    if not isinstance(posterior, LogPosterior):
        got = type(posterior).__name__
        raise TypeError(f"posterior: expected a LogPosterior, got {got}")
    problem = EmulationProblem.of(posterior)
    seed = checks.whole_number("seed", seed)
    design = _check_initial(initial, problem)
    solves = _check_solves(solves, posterior.ndim, design)
    tolerance = checks.real_number("tolerance", tolerance, 0)
    path = check_file(backend, False)
    bar = check_progress(progress)
    probe_tolerance = checks.real_number("probe_tolerance", probe_tolerance, 0)
    recorder = problem.recorder()
    manifest = describe(posterior, moves="emulate", seed=seed, initial=design)
    with open_pool(pool, workers, recorder.one_by_one) as evaluators:
        evaluation = Evaluation.of(recorder, evaluators, on_failure, max_failures)
        journal = Journal(evaluation, path, {"manifest": manifest})
        journal.probe(probe_tolerance)
        with emcee.pbar.get_progress_bar(bar, solves, desc="emulate") as shown:
            rounds = Rounds(problem, journal, solves, shown)
            rounds.run(seed, design, tolerance)
    return rounds.result()


def _check_initial(initial: Any, problem: EmulationProblem) -> Floats | None:
    """Return a point ``(d,)`` or points ``(n, d)`` inside the bounds, or None."""
    if initial is None:
        return None
    points, posterior = checks.real_array("initial", initial), problem.posterior
    posterior.check_inside("initial", np.atleast_2d(points))
    if points.ndim == 2 and len(points) < FEWEST:
        raise ValueError(
            f"initial: expected a point (d,), or at least {FEWEST} points (n, d), got "
            f"shape {points.shape}"
        )
    same = [i for i in problem.inputs if points.ndim == 2 and not np.ptp(points[:, i])]
    if same:
        raise ValueError(
            "initial: expected points that differ in every parameter of the model, got "
            f"one value of {[posterior.names[i] for i in same]}"
        )
    return points


def _check_solves(solves: Any, ndim: int, initial: Floats | None) -> int:
    """Return the budget, which is to suffice for a first design and a batch."""
    number = checks.whole_number("solves", solves, 1)
    first = first_size(ndim)
    if initial is not None and initial.ndim == 2:
        first = len(initial)
    fewest = first + batch_size(ndim)
    if number < fewest:
        raise ValueError(
            f"solves: expected at least {fewest} for {ndim} parameters, {first} of a "
            f"first design and a batch of {batch_size(ndim)}, got {number}; about "
            f"{10 * ndim} are usual"
        )
    return number
