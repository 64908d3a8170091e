"""A posterior from few solves in one call: emulate, sample, certify, go on."""

import os
from collections.abc import Sequence
from dataclasses import replace
from os import PathLike
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ... import checks
from ...contracts import Floats
from ...evaluation.pools import count_workers
from ...evaluation.resume import check_path, open_evaluator
from ...evaluation.samplers import caption, check_progress, progress_bar
from ...posterior.log_posterior import LogPosterior
from ...results.fit import SOLVED_AGAIN, needs_solves
from ...results.to_arviz import read_samples
from ...sampling.run import run
from .archive import Archive, RecalledEvaluation
from .certificate import CERTIFIED, CORRECTED, REFUSED, Certificate
from .certify import certify, judge_chain, judge_draws
from .emulate import (
    SETTLED,
    TOLERANCE,
    Design,
    Emulation,
    emulate,
    plan,
    size_design,
)
from .emulated import EmulatedModel
from .emulated_chain import EmulatedChain

CHECKED = 40  # solves of a certificate: of thirty draws, and of climbs
KEPT = 1  # solve that is kept for the prior mean, which tables of weighted draws show
MOST_FAILED = 0.2  # share of the draws of a certificate
GROWTH = 0.25  # of the points between two certificates, whose draws are among them
CERTIFYING = 2  # stream of random numbers, beside those of emulate
HOW = (
    "workers pool on_failure max_failures backend resume probe_tolerance"
).split()  # arguments of an evaluator, in their order
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
    also call one by one: :func:`emulate` until the emulator has settled or 40 solves
    are left, :func:`run` on the emulated posterior, which costs no solve, and
    :func:`certify` with 40 solves. If the emulated posterior is not certified, the
    emulator learns from the draws of the certificate too, gets a quarter as many points
    again, and is certified anew, while solves last. The best verdict is returned,
    and the last of those that are equally good.

    Typical cost: 40 solves more than :func:`emulate` takes. "A posterior in few solves,
    measured" has numbers. The result is the same to the bit for the same seed, with or
    without a file, and if the call was stopped and resumed.

    The experiments of :meth:`LogPosterior.joint` share the solves in equal parts and
    are emulated once; the certificate has the rest, at most 80.

    Args:
        posterior: The posterior, with the slow model.
        solves: Maximum number of full solves, those of the certificates included.
        seed: A whole number.
        workers: Number of worker processes, as in :func:`run`. A batch of
            :func:`emulate` has at least one point per worker, so more workers than its
            batch choose other points.
        pool: A pool to solve in, instead of workers; see :func:`run`.
        on_failure: "raise" to stop at the first solve that fails; "reject" to leave its
            point out of the fit and to count its posterior as zero.
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
        of these say so, and a finding says what more solves would do.

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
    checks.instance("posterior", posterior, LogPosterior)
    checks.whole_number("solves", solves, 1)
    width = count_workers(pool, workers)
    how = workers, pool, on_failure, max_failures, backend, resume, probe_tolerance
    if len(posterior.experiments) > 1 or cheap is not None:
        options: dict[str, Any] = {"derivatives": derivatives, "starts": starts}
        options |= (
            {"cheap": cheap} | dict(zip(HOW, how, strict=True)) | {"progress": progress}
        )
        return _run_joint(posterior, solves, checks.whole_number("seed", seed), options)
    design = plan(posterior, width, seed, derivatives, starts)
    first, batch = len(design.first), design.batch
    if solves < (least := first + SETTLED * batch + CHECKED + KEPT):
        raise ValueError(
            f"solves: expected at least {least} for {posterior.ndim} parameters and "
            f"{width} at a time, {first} of a first design, {SETTLED} batches of "
            f"{batch} and {CHECKED + KEPT} of a certificate, got {solves}; 150 are "
            "usual"
        )
    display = check_progress(progress)
    asked = design.describe("run_emulated")
    with (
        open_evaluator(design.problem.recorder(), asked, *how) as evaluator,
        progress_bar(display, solves, "run_emulated") as bar,
    ):
        archive = Archive(evaluator)
        archive.bar = bar
        emulation, made = Emulation(design, archive), list[_Made]()
        target, tolerance = solves - CHECKED - KEPT, TOLERANCE
        while True:
            emulator = emulation.run(target, tolerance)
            caption(bar, "sampling the emulated posterior")
            left = solves - KEPT - archive.solves
            size = CHECKED if left >= 2 * CHECKED else left
            made.append(_certify(design, emulator, archive, size, len(made)))
            left = solves - KEPT - archive.solves
            if made[-1].certificate.short == CERTIFIED or left < CHECKED:
                break
            emulation.take_in(made[-1].certificate.theta)
            points = len(emulation.theta)
            more = min(int(GROWTH * points), left - CHECKED)
            target, tolerance = points + more, 0.0
        best = max(
            reversed(made), key=lambda each: BEST_LAST.index(each.certificate.short)
        )
        return best.sealed(archive, _tell(emulation, archive, solves, len(made), best))


class _Made(NamedTuple):
    """A certificate that is not sealed yet.

    Attributes:
        certificate: The certificate.
        rows: Rows of the draws, ``(n, columns)``.
        log_emulated: The emulated log-posterior there, ``(n,)``.
        posterior: The true posterior, as an archive recalls it.
    """

    certificate: Certificate
    rows: Floats
    log_emulated: Floats
    posterior: LogPosterior

    def sealed(self, archive: Archive, told: str) -> Certificate:
        """Return the certificate with all solves of an archive, and a finding."""
        notes = told, *self.certificate.notes
        whole = replace(self.certificate, solves=archive.solves, notes=notes)
        again = SOLVED_AGAIN * needs_solves(self.posterior)
        solved = self.posterior, self.rows, self.log_emulated
        sealed = whole.sealed(*solved, again)  # which may take one solve
        spent, failed = archive.solves, archive.failed
        return replace(sealed, solves=spent, failed_solves=failed)


def _certify(
    design: Design, emulator: EmulatedModel, archive: Archive, size: int, number: int
) -> _Made:
    """Sample an emulated posterior, and certify it with so many solves."""
    rng = np.random.default_rng([design.seed, number, CERTIFYING])
    posterior = checks.instance("posterior", emulator.posterior, LogPosterior)
    chains = run(posterior, seed=design.seed + number, progress=False)
    idata, _ = read_samples(chains, judged=True)
    chain = EmulatedChain(idata, design.problem.posterior.prior, rng)
    evaluator = RecalledEvaluation(design.problem, archive)
    again = SOLVED_AGAIN * needs_solves(evaluator.posterior)  # known already
    limits = size + again, again, emulator.settled, MOST_FAILED
    found = judge_draws(chain, judge_chain(idata), evaluator, *limits, rng)
    certificate = replace(found[0], emulated=emulator)
    return _Made(certificate, *found[1:], evaluator.posterior)


def _tell(
    emulation: Emulation,
    archive: Archive,
    solves: int,
    made: int,
    best: _Made,
) -> str:
    """Say what was spent, and what more solves would do."""
    count = f"{made} certificates" if made > 1 else "one certificate"
    text = f"{archive.solves} of {solves} solves were made, {count} among them"
    if best.certificate.short == CERTIFIED:
        return f"{text}."
    if emulation.settled:
        return (
            f"{text}. With solves={2 * solves} the emulator is refined and certified "
            "again; with the same backend and resume=True, no solve is lost."
        )
    rounds = [(n, e) for n, _, e, _ in emulation.history if 0 < e < np.inf][-RATE_BY:]
    spent, errors = np.array(rounds or [(1, np.nan)]).T
    text += (
        f". The true error of the emulator is {errors[-1]:.2g} measurement errors, and "
        f"{TOLERANCE:g} is needed"
    )
    rate = -np.polyfit(spent, np.log(errors), 1)[0] if len(rounds) > 1 else 0.0
    more = np.log(max(errors[-1] / TOLERANCE, 1.0)) / max(rate, 1e-300)
    if not more < MOST_OUTLOOK * solves:
        return (
            f"{text}; the last rounds made it no smaller. Look whether the response "
            "jumps, or modes cross that are not returned with their shapes."
        )
    more = 10 * int(np.ceil((more + 2 * emulation.design.batch) / 10))
    return (
        f"{text}: about {more} more solves, as its last rounds fell. Call again with "
        f"solves={solves + more}; with the same backend and resume=True, no solve is "
        "lost."
    )


def _run_joint(
    posterior: LogPosterior, solves: int, seed: int, options: dict[str, Any]
) -> Certificate:
    """Return the certificate of a joint posterior, which is emulated once.

    Args:
        posterior: The joint posterior.
        solves: All that may be made.
        seed: Of all that is drawn.
        options: Other arguments of ``emulate``.
    """
    width, cheap = count_workers(options["pool"], options["workers"]), options["cheap"]
    sizes = [
        size_design(posterior.ndim, options["derivatives"] and e.jacobian is not None)
        for e in posterior.experiments
        if e.name not in (cheap or ())
    ]
    least = max(
        max(n, width) + SETTLED * max(few, width) for n, few in sizes or [(0, 0)]
    )
    least = len(sizes) * least + CHECKED + KEPT
    if solves < least:
        raise ValueError(
            f"solves: expected at least {least} for {posterior.ndim} parameters and "
            f"{len(sizes)} experiments that are emulated, got {solves}"
        )
    file = None
    if (path := options["backend"]) is not None:
        file = f"{os.fspath(path)}.certificate"
        check_path(file, options["resume"])  # before a solve
    share = (solves - CHECKED - KEPT) // max(len(sizes), 1)
    emulated = emulate(posterior, share, seed=seed, **options)
    approximate = checks.instance("posterior", emulated.posterior, LogPosterior)
    chains = run(approximate, seed=seed, progress=False)
    left = min(solves - KEPT - emulated.solves, 2 * CHECKED)
    how = {name: options[name] for name in (*HOW, "progress")}
    how |= {"backend": file, "max_failures": MOST_FAILED}
    found = certify(chains, posterior, left, seed=seed, **how)
    spent = found.solves + emulated.solves
    return replace(
        found,
        solves=spent,
        failed_solves=found.failed_solves + emulated.failed_solves,
        emulated=emulated,
        notes=(f"{spent} of {solves} solves were made.", *found.notes),
    )
