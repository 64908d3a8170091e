"""The recipe behind ``run(..., moves="auto")``: burn in, check, fit, freeze."""

from collections.abc import Callable
from typing import Any, NamedTuple
from warnings import warn

import emcee
import numpy as np

from .interfaces import Floats
from .moves import DEMCMove, IndependenceMove

FIRST, LONGEST = 512, 16_384  # generations of burn-in, doubled until it is long enough
ENOUGH_TAU = 20  # autocorrelation times in its second half
TRIAL = 20  # generations of independence proposals that tell how good the fit is
# Share of independence proposals by their acceptance in the trial.
SHARES = ((0.2, 0.9), (0.05, 0.6), (0.0, 0.2))


class Recipe(NamedTuple):
    """What the burn-in found.

    Attributes:
        moves: The frozen mixture of moves for sampling.
        states: Where the ensembles stand, with their random streams.
        evaluations: Log-posterior evaluations spent, an ensemble.
        sentence: What was done, in words.
    """

    moves: list[tuple[Any, float]]
    states: list[emcee.State]
    evaluations: int
    sentence: str


def burn_in_and_fit(
    build: Callable[..., emcee.EnsembleSampler],
    states: list[emcee.State],
    progress: bool | str,
) -> Recipe:
    """Burn in with DE-MC, fit an independence proposal to it, and return the mixture.

    DE-MC with gamma = 1 in every tenth step runs until the second half of the burn-in
    is 20 autocorrelation times long in every ensemble. A mixture of Student-t laws is
    fitted to that half of all ensembles; with it and DE-MC as many generations again
    are run, the fit is repeated on these, then frozen, and tried for 20 generations.
    The better its proposals are accepted, the larger their share.

    Args:
        build: ``build(moves=...)`` makes an emcee sampler of the posterior.
        states: Evaluated starts of the ensembles.
        progress: Whether to show progress bars.
    """
    local = DEMCMove(mode_jump=0.1)
    samplers = [build(moves=local) for _ in states]
    generations, per_tau = 0, 0.0
    while per_tau < ENOUGH_TAU and generations < LONGEST:
        stretch = max(FIRST, generations)  # doubles what there is
        states = [
            _continued(sampler, state, stretch, progress, f"burn-in {number}")
            for number, (sampler, state) in enumerate(
                zip(samplers, states, strict=True), 1
            )
        ]
        generations += stretch
        halves = [s.get_chain(discard=generations // 2) for s in samplers]
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
    fitted = _fitted(halves)
    # DE-MC alone leaves few independent draws in the tails; with a first fit there are
    # many more, and the second fit covers them.
    mixed = [build(moves=[(fitted, 0.7), (local, 0.3)]) for _ in states]
    second = len(halves[0])
    states = [
        _continued(sampler, state, second, progress, f"second fit {number}")
        for number, (sampler, state) in enumerate(zip(mixed, states, strict=True), 1)
    ]
    fitted = _fitted([sampler.get_chain() for sampler in mixed])

    trials = [build(moves=fitted) for _ in states]
    states = [
        _continued(trial, state, TRIAL, False, "")
        for trial, state in zip(trials, states, strict=True)
    ]
    acceptance = float(np.mean([trial.acceptance_fraction for trial in trials]))
    share = next(share for least, share in SHARES if acceptance >= least)
    k = len(fitted.weights)
    return Recipe(
        moves=[(fitted, share), (local, 1.0 - share)],
        states=states,
        evaluations=len(states[0].coords) * (1 + generations + second + TRIAL),
        sentence=(
            f"burn-in of {generations} generations of DE-MC, {2 * per_tau:.0f} "
            f"autocorrelation times, and {second} of DE-MC with a first fit; {k} "
            f"Student-t component{'s' if k > 1 else ''} fitted to the latter; "
            f"{100 * acceptance:.0f} % of their proposals accepted in a trial; then "
            f"{100 * share:.0f} % independence, {100 - 100 * share:.0f} % DE-MC steps"
        ),
    )


def _fitted(chains: list[Floats]) -> IndependenceMove:
    """Return the fit to all ensembles' chains ``(steps, walkers, d)``."""
    draws = np.concatenate([chain.reshape(-1, chain.shape[2]) for chain in chains])
    return IndependenceMove.fit(draws, components="auto")


def _continued(
    sampler: emcee.EnsembleSampler,
    state: emcee.State,
    steps: int,
    progress: bool | str,
    label: str,
) -> emcee.State:
    """Run ``steps`` generations from a state and return a copy of the last one."""
    last = sampler.run_mcmc(
        state,
        steps,
        progress=progress,
        progress_kwargs={"desc": label},
        skip_initial_state_check=True,
    )
    return emcee.State(last, copy=True)
