"""Malformed settings of the moves, and samples that they are fitted to."""

import numpy as np
from emcee.moves import StretchMove
from support.border import Target, arguments, properties
from support.kinds import either, flag, floats, moderate, none, numbers, unless, whole

import emcee_femu as ef

DRAWS = np.random.default_rng(3).standard_normal((45, 2)) * [1.0, 1e3] + [5.0, 2e4]
COV = np.array([[1.0, 30.0], [30.0, 4e3]])
SCALES = np.stack([COV, 2 * COV])
WALKERS, GUIDES = DRAWS[:4], DRAWS[4:12]
SPLITS = {
    "nsplits": (2, whole(2)),
    "randomize_split": (True, flag),
    "live_dangerously": (False, flag),
}


def proposal(move):
    """Return what a move proposes, or where sigma and walkers do not fit, its text."""
    sigma = getattr(move, "sigma", None)
    if sigma is not None and sigma.shape not in ((), (2,)):
        return repr(move)
    return repr(move), move.get_proposal(WALKERS, [GUIDES], np.random.RandomState(1))


def noise(value):
    given = numbers(value)
    if given is None or not given.size:
        return False
    return moderate(floats((), (None,), low=0.0))(value)


def covariance(value):
    given = numbers(value)
    if given is None or not given.size:
        return False
    if given.ndim < 2:
        return moderate(floats((), (None,), above=0.0))(value)
    found = moderate(floats((None, None)))(value)
    if not found:
        return found
    if given.shape[0] != given.shape[1] or (np.diag(given) <= 0).any():
        return False
    sd = np.sqrt(np.diag(given))
    correlation = given / np.outer(sd, sd)
    if np.abs(correlation - correlation.T).max() > 1e-7:
        return False
    lowest = np.linalg.eigvalsh(correlation)[0]
    return True if lowest > 1e-9 else False if lowest < -1e-9 else None


def probabilities(value):
    given = numbers(value)
    found = floats((None,), above=0.0, high=1.0)(value)
    return found if given is not None and given.size else False


def descending(value):
    found = floats((None,), low=0.0, high=1.0)(value)
    if found is False:
        return False
    betas = numbers(value)
    right = len(betas) > 1 and betas[0] == 1 and (np.diff(betas) < 0).all()
    return found if right else False


def interval(value):
    found = moderate(floats((2,), above=0.0))(value)
    return found if found is False or np.diff(numbers(value))[0] >= 0 else False


def automatic(value):
    return isinstance(value, str) and value == "auto"


def moves(value):
    return None if hasattr(value, "propose") else False


def sigma_scale(samples):
    centred = samples - samples.mean(axis=0)
    return 2.38**2 / 2 * centred.T @ centred / (len(samples) - 1)


def density(move):
    return repr(move), move.log_density(DRAWS[:5, : move.means.shape[1]])


def screened(result):
    """Move three walkers once by a cheap posterior that returns ``result``."""
    move = ef.DelayedAcceptanceMove(ef.MetropolisMove(1.0), lambda theta: result)
    return move._evaluate(WALKERS)


def below_infinity(value):
    """Log-probabilities of four walkers, or rows that begin with them."""
    given = numbers(value)
    if given is None or given.ndim not in (1, 2) or len(given) != 4 or not given.size:
        return False
    first = given if given.ndim == 1 else given[:, 0]
    return None if (first < np.inf).all() else False


TARGETS = {
    "DEMCMove": Target(
        ef.DEMCMove,
        arguments(
            sigma=(np.array([0.1, 2.0]), either(none, noise)),
            gamma0=(0.5, either(none, moderate(floats((), low=0.0)))),
            mode_jump=(0.1, floats((), low=0.0, high=1.0)),
            **SPLITS,
        ),
        probe=proposal,
    ),
    "SnookerMove": Target(
        ef.SnookerMove,
        arguments(gamma=(np.array([1.2, 2.2]), interval), **SPLITS),
        probe=proposal,
    ),
    "CrossoverMove": Target(
        ef.CrossoverMove,
        arguments(
            pairs=(2, whole(1, 3)),
            crossover=(np.array([0.3, 1.0]), probabilities),
            sigma=(np.array([0.1, 2.0]), either(none, noise)),
            **SPLITS,
        ),
        probe=proposal,
    ),
    "MetropolisMove": Target(
        ef.MetropolisMove,
        arguments(cov=(COV, covariance)),
        probe=vars,
        examples=40,
    ),
    "MetropolisMove.tuned": Target(
        ef.MetropolisMove.tuned,
        arguments(samples=(DRAWS, unless(floats((None, None))))),
        probe=lambda move: move.cov,
        truth=sigma_scale,
        examples=40,
    ),
    "IndependenceMove": Target(
        ef.IndependenceMove,
        arguments(
            weights=(np.array([0.3, 0.7]), unless(floats((2,), above=0.0))),
            means=(DRAWS[:2], floats((2, 2))),
            scale_matrices=(SCALES, moderate(unless(floats((2, 2, 2))))),
            df=(8.0, moderate(unless(floats((), above=0.0)))),
        ),
        probe=density,
        tied=("weights", "means", "scale_matrices"),
        examples=40,
    ),
    "IndependenceMove.fit": Target(
        ef.IndependenceMove.fit,
        arguments(
            samples=(DRAWS, unless(floats((None, None)))),
            components=(
                1,
                either(unless(whole(1)), automatic),
            ),
            df=(8.0, unless(floats((), above=0.0))),
        ),
        probe=density,
        tied=("samples", "components"),
    ),
    "TemperedMove": Target(
        ef.TemperedMove,
        arguments(
            inner=(StretchMove(), moves),
            betas=(np.array([1.0, 0.3, 0.0]), descending),
        ),
        probe=lambda move: move.betas,
        examples=40,
    ),
    "DelayedAcceptanceMove": Target(
        ef.DelayedAcceptanceMove,
        arguments(
            inner=(ef.MetropolisMove(1.0), moves),
            cheap=(len, callable),
        ),
        probe=str,
        examples=40,
    ),
    "DelayedAcceptanceMove of a bad cheap posterior": Target(
        screened,
        arguments(result=(np.array([-1.0, -2.0, -3.0, -4.0]), below_infinity)),
        alias={"result": "cheap"},
        examples=40,
    ),
}
test_a_malformed_argument = properties(TARGETS)
