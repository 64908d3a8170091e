"""A posterior from few solves in one call: emulate, sample, certify, go on."""

import os
from collections.abc import Sequence
from dataclasses import replace
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ... import checks
from ...contracts import Prior
from ...evaluation.pools import count_workers
from ...evaluation.progress import caption, check_progress, progress_bar
from ...evaluation.resume import check_path, open_evaluator
from ...posterior.log_posterior import LogPosterior
from ...results.fit import SOLVED_AGAIN, needs_solves
from ...results.to_arviz import read_samples
from ...sampling.record import Run
from ...sampling.run import run
from .archive import Archive, RecalledEvaluation
from .certificate import CERTIFIED, CORRECTED, REFUSED, Certificate
from .certify import certify, judge_chain, judge_draws
from .design import plan
from .emulate import SETTLED, TOLERANCE, Emulation, emulate
from .emulated import EmulatedModel
from .emulated_chain import EmulatedChain

# Solves of a certificate: of climbs, 27 draws of the chain, and nine of a wider one.
CERTIFIED_BY = 48
# Effective ones of the emulated posterior, which cost no solve: so many know the
# standard deviation of a parameter with a kurtosis of 16 to 3 %.
DRAWS = 4_000
WALKERS = 48  # which are emulated at once; more take no longer a step
KEPT = 1  # solve that is kept for the prior mean, which tables of weighted draws show
MOST_FAILED = 0.2  # share of the draws of a certificate
GROWTH = 0.25  # of the points between two certificates, whose draws are among them
CERTIFYING = 2  # stream of random numbers, beside those of emulate
BEST_LAST = REFUSED, CORRECTED, CERTIFIED
RATE_BY = 5  # last rounds of an emulation that tell how fast its error falls
MOST_OUTLOOK = 10.0  # times as many solves, above which no number is named


def run_emulated(
    posterior: LogPosterior,
    solves: int = 150,
    *,
    seed: int,
    workers: int | None = None,
    pool: object = None,
    on_failure: str = "raise",
    max_failures: float = 0.8,
    backend: str | PathLike[str] | None = None,
    resume: bool = False,
    derivatives: bool = True,
    starts: ArrayLike | None = None,
    cheap: Sequence[str] | None = None,
    progress: bool | str | None = None,
    probe_tolerance: float = 1e-6,
) -> Certificate:
    """Sample a posterior whose model is slow, from few full solves in one call.

    Use it if a solve takes a second or more. It calls the three functions that you can
    also call one by one: :func:`emulate` until the emulator has settled or 48 solves
    are left, :func:`run` on the emulated posterior, which costs no solve, and
    :func:`certify` with 48 solves. The emulator then learns from the draws of the
    certificate too, and is sampled again: means and standard deviations are those of
    this chain, and if it changed either by more than a tenth of a standard deviation,
    nothing is certified. If the emulated posterior is not certified, it gets a quarter
    as many points again, and is certified anew, while solves last. The best verdict is
    returned, and the last of those that are equally good. A joint posterior's emulators
    do not learn from the draws.

    An emulator that the budget did not let settle is certified only if its true error
    is within the tolerance at the draws of the certificate.

    Typical cost: 48 solves more than :func:`emulate` takes. "A posterior in few solves,
    measured" has numbers. The result is the same to the bit for the same seed, with or
    without a file, and if the call was stopped and resumed.

    The experiments of :meth:`LogPosterior.joint` share the solves in equal parts and
    are emulated once; the certificate has the rest, at most 96, of which each solves
    all experiments.

    Args:
        posterior: The posterior, with the slow model.
        solves: Maximum number of full solves, those of the certificates included.
        seed: A whole number.
        workers: Number of worker processes, as in :func:`run`. A batch of
            :func:`emulate` has at least one point per worker, so more workers than its
            batch choose other points.
        pool: A pool to solve in, instead of workers; see :func:`run`.
        on_failure: "raise" to stop at the first solve that fails; "reject" to leave its
            point out of the fit and to judge draws without it, as :func:`certify` does.
        max_failures: Fraction of failed solves above which "reject" stops. Of the draws
            of a certificate a fifth may fail.
        backend: File in which each solve is stored as soon as it is done, such as
            "beam.chain". Of a joint posterior each experiment has its own file, and so
            has the certificate: their names end with the experiment's and with
            "certificate".
        resume: Whether to continue from the file if it exists. Stored solves are not
            repeated, but 16 of them are, to detect a changed model. ``solves`` may
            differ from the first call, so that a posterior that was not certified can
            be given more.
        derivatives: Whether to use the model's ``jacobian``, if it has one.
        starts: Where the first solves are, as in :func:`emulate`.
        cheap: Names of experiments that are not emulated, as in :func:`emulate`.
        progress: Whether to show solves and the remaining time, as in :func:`run`.
        probe_tolerance: Relative difference between a stored and a repeated solve above
            which the model is considered changed.

    Returns:
        The certificate, for all tables, figures, :func:`diagnose`, :func:`report`,
        :func:`to_inference_data` and :func:`log_evidence`; ``print`` it. Its ``solves``
        are all that were made, and ``emulated`` is the emulator. If it is refused, all
        of these say so, and a finding says what more solves would do. ``plot_shapes``
        and ``plot_mac`` take up to two full solves more; ``plot_tae``, which takes up
        to 200, asks for the posterior.

    Raises:
        TypeError: If posterior is not a LogPosterior, or a count is not a whole number.
        ValueError: If solves is too small for an emulator and its certificate, a start
            is out of bounds, cheap names an unknown experiment, the posterior is a bare
            log-likelihood, or the file belongs to another calculation. These are raised
            before the first solve.
        ImportError: If progress is "notebook" and ipywidgets is not installed.
        RuntimeError: If too many solves failed, or all solves of the first design did.
        UserWarning: If all solves of the first design are far from the measurements.

    Source: As of :func:`emulate` and :func:`certify`.

    Examples:
        >>> import emcee_femu as ef
        >>> model = ef.FunctionModel(lambda p: [p["k"] ** 0.5, (3 * p["k"]) ** 0.5])
        >>> term = ef.FrequencyTerm([3.0, 5.2], relative_sd=0.01)
        >>> prior = ef.GaussianPrior(["k"], [8.0], [2.0], [(1.0, 20.0)])
        >>> posterior = ef.LogPosterior(model, term, prior)
        >>> found = ef.run_emulated(posterior, 60, seed=1)
        >>> found.short, found.solves <= 60
        ('certified', True)
    """
    options = {k: v for k, v in locals().items() if k not in ("posterior", "solves")}
    checks.instance("posterior", posterior, LogPosterior)
    checks.whole_number("solves", solves, 1)
    if len(posterior.experiments) > 1 or cheap is not None:
        return _run_joint(posterior, solves, options)
    width = count_workers(pool, workers)
    design = plan(posterior, width, seed, derivatives, starts)
    first, batch = len(design.first), design.batch
    if solves < (least := first + SETTLED * batch + CERTIFIED_BY + KEPT):
        raise ValueError(
            f"solves: expected at least {least} for {posterior.ndim} parameters and "
            f"{width} at a time, {first} of a first design, {SETTLED} batches of "
            f"{batch} and {CERTIFIED_BY + KEPT} of a certificate, got {solves}; 150 "
            "are usual"
        )
    display, asked = check_progress(progress), design.describe("run_emulated")
    how = workers, pool, on_failure, max_failures, backend, resume, probe_tolerance
    with (
        open_evaluator(design.problem.recorder(), asked, *how) as evaluator,
        progress_bar(display, solves, "run_emulated") as bar,
    ):
        archive = Archive(evaluator, bar)
        emulation, made = Emulation(design, archive), list[Certificate]()
        target, tolerance = solves - CERTIFIED_BY - KEPT, TOLERANCE
        while True:
            emulator = emulation.run(target, tolerance)
            caption(bar, "sampling the emulated posterior")
            made.append(_certify(emulation, archive, emulator, solves, len(made)))
            left = solves - KEPT - archive.solves
            if made[-1].short == CERTIFIED or left < CERTIFIED_BY:
                break
            points = len(emulation.theta)
            target = points + min(int(GROWTH * points), left - CERTIFIED_BY)
            tolerance = 0.0
    best = max(reversed(made), key=lambda each: BEST_LAST.index(each.short))
    spent: dict[str, Any] = {"solves": archive.solves, "failed_solves": archive.failed}
    return replace(best, posterior=posterior, **spent)


def _certify(
    emulation: Emulation,
    archive: Archive,
    emulator: EmulatedModel,
    solves: int,
    number: int,
) -> Certificate:
    """Sample an emulated posterior, and certify it.

    Args:
        emulation: What made the emulator.
        archive: What solves.
        emulator: The emulator.
        solves: All that may be made, in the end.
        number: How many certificates were made before.
    """
    seed, left = emulation.design.seed, solves - KEPT - archive.solves
    size = CERTIFIED_BY if left >= 2 * CERTIFIED_BY else left
    rng = np.random.default_rng([seed, number, CERTIFYING])
    evaluator = RecalledEvaluation(emulation.problem, archive)
    true = evaluator.posterior
    again = SOLVED_AGAIN * needs_solves(true)  # of what is known already
    limits = size + again, again, emulator.settled, MOST_FAILED
    chain = _sample(emulator, true.prior, seed + number, rng)
    judged, approximate = judge_chain(chain.idata), emulator.posterior
    found, rows, at_draws = judge_draws(
        chain, judged, evaluator, approximate, *limits, rng
    )
    told = f"{archive.solves} of {solves} solves led to certificate {number + 1}."
    if not emulator.settled and found.weights.any():
        error = emulation.true_error(emulator, found.theta, found.weights)
        found = replace(found, settled=error <= TOLERANCE)
        told += (
            f" The emulator had not settled; at the draws of the certificate its true "
            f"error is {error:.2g} measurement errors, and {TOLERANCE:g} is enough."
        )
    emulation.take_in(found.theta)
    if found.short == CERTIFIED:
        emulator = emulation.refit()
        chain = _sample(emulator, true.prior, seed + number, rng)
        told += f" Before the emulator learned from its draws, {found.differences}."
        found = replace(
            found,
            refitted=True,
            mean=chain.draws.mean(axis=0),
            sd=chain.draws.std(axis=0, ddof=1),
            faults=tuple(judge_chain(chain.idata)[0]),
            idata=chain.idata,
        )
    if found.short != CERTIFIED:
        told += _look_ahead(emulation, solves)
    notes = told, *found.notes
    found = replace(found, solves=archive.solves, emulated=emulator, notes=notes)
    return found.sealed(true, rows, at_draws, again)


def _sample(
    emulator: EmulatedModel, prior: Prior, seed: int, rng: np.random.Generator
) -> EmulatedChain:
    """Return the chain of an emulated posterior, which costs no solve.

    Args:
        emulator: The emulator.
        prior: That of the true posterior.
        seed: Of the chain.
        rng: Puts walkers in random order.
    """
    approximate = checks.instance("posterior", emulator.posterior, LogPosterior)
    chains = _run(approximate, seed)
    return EmulatedChain(read_samples(chains, judged=True)[0], prior, rng)


def _run(approximate: LogPosterior, seed: int) -> Run:
    """Return the run of an emulated posterior by which sds are known, too."""
    walkers = max(WALKERS, 2 * approximate.ndim)
    return run(approximate, "auto", walkers, ess=DRAWS, seed=seed, progress=False)


def _look_ahead(emulation: Emulation, solves: int) -> str:
    """Say what more solves than so many would do."""
    goes_on = "with the same backend and resume=True, no solve is lost."
    if emulation.settled:
        return f" Twice as many refine the emulator and certify it again; {goes_on}"
    rounds = [(n, e) for n, _, e, _ in emulation.history if 0 < e < np.inf][-RATE_BY:]
    at, errors = np.array(rounds or [(1, np.inf)]).T
    told = (
        f" The true error of the emulator is {errors[-1]:.2g} measurement errors, and "
        f"{TOLERANCE:g} is needed: "
    )
    rate = -np.polyfit(at, np.log(errors), 1)[0] if len(rounds) > 1 else 0.0
    more = np.log(max(errors[-1] / TOLERANCE, 2.0)) / rate if rate > 0 else np.inf
    if more > MOST_OUTLOOK * solves:
        return (
            f"{told}the last rounds made it no smaller. Look whether the response "
            "jumps, or modes cross that are not returned with their shapes."
        )
    more = solves + 10 * -(-more // 10)
    return f"{told}at the rate of the last rounds solves={more:.0f} reach it; {goes_on}"


def _run_joint(
    posterior: LogPosterior, solves: int, options: dict[str, Any]
) -> Certificate:
    """Return the certificate of a joint posterior, which is emulated once.

    Args:
        posterior: The joint posterior.
        solves: All that may be made.
        options: The other arguments.
    """
    number = max(len(posterior.experiments) - len(options["cheap"] or ()), 1)
    if (file := options["backend"]) is not None:
        file = f"{os.fspath(file)}.certificate"
        check_path(file, options["resume"])  # before a solve
    try:
        share = (solves - CERTIFIED_BY - KEPT) // number
        emulated = emulate(posterior, share, **options)
    except ValueError as error:
        error.add_note(f"{CERTIFIED_BY + KEPT} of {solves} solves are to certify")
        error.add_note(f"the rest is shared by {number} experiments")
        raise
    approximate = checks.instance("posterior", emulated.posterior, LogPosterior)
    chains = _run(approximate, options["seed"])
    left = min(solves - KEPT - emulated.solves, 2 * CERTIFIED_BY)
    own = "derivatives", "starts", "cheap"  # of emulate
    how = {name: value for name, value in options.items() if name not in own}
    how |= {"backend": file, "max_failures": MOST_FAILED}
    found = certify(chains, posterior, left, **how)
    spent = found.solves + emulated.solves
    failed = found.failed_solves + emulated.failed_solves
    notes = f"{spent} of {solves} solves were made.", *found.notes
    found = replace(found, solves=spent, failed_solves=failed, notes=notes)
    return replace(found, emulated=emulated)
