"""The recipe behind ``run(..., moves="auto")``: burn in, check, fit, freeze."""

from collections.abc import Sequence
from typing import NamedTuple, TypeAlias
from warnings import warn

import emcee
import numpy as np

from ..interfaces import Backend, Floats, Move
from ..moves import DEMCMove, IndependenceMove
from .arguments import Moves
from .evaluation import Evaluation

FIRST, LONGEST = 512, 16_384  # generations of burn-in, doubled until it is long enough
ENOUGH_TAU = 20  # autocorrelation times in its second half
TRIAL = 20  # generations of independence proposals that tell how good the fit is
# Share of independence proposals by their acceptance in the trial.
SHARES = ((0.2, 0.9), (0.05, 0.6), (0.0, 0.2))


Backends: TypeAlias = Sequence[Backend | None]


class Recipe(NamedTuple):
    """How a chain begins.

    Attributes:
        moves: The moves for sampling.
        states: Where the ensembles are, with their random streams.
        evaluations: Log-posterior evaluations spent per ensemble.
        sentence: What was done, in words; empty if the moves were given.
    """

    moves: Moves
    states: list[emcee.State]
    evaluations: int
    sentence: str


def mixture(fitted: IndependenceMove, share: float) -> list[tuple[Move, float]]:
    """Return independence proposals and DE-MC, whose tenth steps jump between modes."""
    return [(fitted, share), (DEMCMove(mode_jump=0.1), 1.0 - share)]


def prepare(
    evaluation: Evaluation, states: list[emcee.State], backends: Backends
) -> Recipe:
    """Return how the chain begins, with given moves or found ones."""
    moves = evaluation.settings.moves
    if moves is None:
        return burn_in_and_fit(evaluation, states, backends)
    return Recipe(moves, states, len(states[0].coords), "")


def burn_in_and_fit(
    evaluation: Evaluation, states: list[emcee.State], backends: Backends
) -> Recipe:
    """Burn in with DE-MC, fit an independence proposal to it, and return the mixture.

    DE-MC with gamma = 1 in every tenth step runs until the second half of the burn-in
    is 20 autocorrelation times long in every ensemble. A mixture of Student-t laws is
    fitted to that half of all ensembles; with it and DE-MC as many generations again
    are run, the fit is repeated on these, then frozen, and tried for 20 generations.
    The better its proposals are accepted, the larger their share.

    Args:
        evaluation: Evaluates the posterior.
        states: Evaluated starts of the ensembles.
        backends: For the burn-in of each ensemble, then for its second fit; what
            they hold already is not run again.
    """
    progress, ensembles = evaluation.settings.progress, len(states)
    local = DEMCMove(mode_jump=0.1)
    samplers = [evaluation.sampler(local, own) for own in backends[:ensembles]]
    generations, per_tau = 0, 0.0
    while per_tau < ENOUGH_TAU and generations < LONGEST:
        generations = max(FIRST, 2 * generations)
        ends = _advance(samplers, states, generations, progress, "burn-in")
        # Backends may hold more: this may be the repetition of a run that was stopped.
        halves = [s.get_chain()[generations // 2 : generations] for s in samplers]
        # A walker that never moved has no tau, NaN: then the burn-in is too short.
        with np.errstate(invalid="ignore"):
            taus = [emcee.autocorr.integrated_time(half, tol=0) for half in halves]
        per_tau = float(np.nan_to_num(len(halves[0]) / np.max(taus)))
    if per_tau < ENOUGH_TAU:
        warn(
            f"moves='auto': the burn-in of {generations} generations is only "
            f"{per_tau:.0f} autocorrelation times long in its second half, "
            f"{ENOUGH_TAU} are wanted; the chain is exact, but its proposal may fit "
            "badly. Use more walkers, or tighter bounds",
            stacklevel=3,
        )
    fitted = _fit(halves)
    # DE-MC alone leaves few independent draws in the tails; with a first fit there are
    # many more, and the second fit covers them.
    moves = mixture(fitted, 0.7)
    mixed = [evaluation.sampler(moves, own) for own in backends[ensembles:]]
    second = len(halves[0])
    ends = _advance(mixed, ends, second, progress, "second fit")
    fitted = _fit([sampler.get_chain() for sampler in mixed])

    trials = [evaluation.sampler(fitted) for _ in ends]
    ends = _advance(trials, ends, TRIAL, False, "")
    acceptance = float(np.mean([trial.acceptance_fraction for trial in trials]))
    share = next(share for least, share in SHARES if acceptance >= least)
    k = len(fitted.weights)
    return Recipe(
        moves=mixture(fitted, share),
        states=ends,
        evaluations=len(ends[0].coords) * (1 + generations + second + TRIAL),
        sentence=(
            f"burn-in of {generations} generations of DE-MC, {2 * per_tau:.0f} "
            f"autocorrelation times, and {second} of DE-MC with a first fit; {k} "
            f"Student-t component{'s' if k > 1 else ''} fitted to the latter; "
            f"{100 * acceptance:.0f} % of their proposals accepted in a trial; then "
            f"{100 * share:.0f} % independence, {100 - 100 * share:.0f} % DE-MC steps"
        ),
    )


def _fit(chains: list[Floats]) -> IndependenceMove:
    """Return the fit to all ensembles' chains ``(steps, walkers, d)``."""
    draws = np.concatenate([chain.reshape(-1, chain.shape[2]) for chain in chains])
    return IndependenceMove.fit(draws, components="auto")


def _advance(
    samplers: list[emcee.EnsembleSampler],
    starts: list[emcee.State],
    generations: int,
    progress: bool | str,
    label: str,
) -> list[emcee.State]:
    """Run every ensemble up to ``generations``, and return copies of the last states.

    Raises:
        BaseException: Whatever sampling raises, with the samplers as ``samplers``.
    """
    ends = []
    for number, (sampler, start) in enumerate(zip(samplers, starts, strict=True), 1):
        done = sampler.iteration
        state = sampler.get_last_sample() if done else start
        if done < generations:
            try:
                state = sampler.run_mcmc(
                    state,
                    generations - done,
                    progress=progress,
                    progress_kwargs={"desc": f"{label} {number}"},
                    skip_initial_state_check=True,
                )
            except BaseException as error:
                error.samplers = samplers  # type: ignore[attr-defined]
                raise
        ends.append(emcee.State(state, copy=True))
    return ends
