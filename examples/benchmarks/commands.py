"""What the benchmarks share: options, tables and moments by importance sampling.

The options of a benchmark are the arguments of its ``main``:
``python examples/benchmarks/evidence.py --help`` lists them. What it prints begins with
its command, the version, the commit and the day. Pages include it from ``measured/``:

    python examples/benchmarks/evidence.py > examples/benchmarks/measured/evidence.txt
"""

import argparse
import inspect
import shlex
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from datetime import date
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

import emcee_femu as ef
from emcee_femu.moves.mixture import Mixture
from emcee_femu.table import Table

Floats = np.ndarray
BATCH, BATCHES = 2_000, 200  # draws at a time, and at most
DF, FEWEST = 8.0, 15  # of the mixture; draws per dimension that a fit takes


def command(main: Callable[..., object]) -> None:
    """Call a function with what the command line gives; the rest are its defaults."""
    shown = argparse.RawDescriptionHelpFormatter
    text = inspect.getmodule(main).__doc__
    parser = argparse.ArgumentParser(description=text, formatter_class=shown)
    for name, argument in inspect.signature(main).parameters.items():
        default = argument.default
        several = isinstance(default, tuple)
        parser.add_argument(
            f"--{name}",
            type=type(default[0] if several else default),
            nargs="+" if several else None,
            default=default,
            help=f"default: {' '.join(map(str, default)) if several else default}",
        )
    given = vars(parser.parse_args())
    script = f"examples/benchmarks/{Path(sys.argv[0]).name}"
    print("$ OMP_NUM_THREADS=1 python", shlex.join([script, *sys.argv[1:]]))
    made_by = f"emcee_femu {version('emcee-femu')}{of_commit()}"
    print(f"{made_by}, {date.today()}\n", flush=True)
    main(**given)


def of_commit() -> str:
    """Name the commit of this checkout, or nothing outside of one."""
    ask = ["git", "describe", "--always", "--dirty", "--exclude=*"]
    here = Path(__file__).parent
    answer = subprocess.run(ask, cwd=here, capture_output=True, text=True)
    return f" ({answer.stdout.strip()})" if answer.returncode == 0 else ""


def tabulate(title: str, formats: Mapping[str, str], rows: Iterable[Any]) -> Table:
    """Print each row as soon as it is there, then the table, and return it."""
    found = []
    for row in rows:
        found.append(tuple(row))
        print(*found[-1], file=sys.stderr, flush=True)
    table = Table(title, tuple(formats), tuple(formats.values()), tuple(found))
    print(table)
    return table


def share_out(
    function: Callable[[Any], Any], cases: Iterable[Any], workers: int
) -> Iterator[Any]:
    """Yield what a function returns of each case, by so many processes if not by one.

    The processes know what this one has cached.
    """
    if workers == 1:
        yield from map(function, cases)
        return
    with ProcessPoolExecutor(workers) as pool:
        yield from pool.map(function, cases)


def draws_of(run: Iterable[Any]) -> Floats:
    """Return all draws of a run, ``(n, d)``."""
    return np.concatenate([sampler.get_chain(flat=True) for sampler in run])


def weigh(
    posteriors: Sequence[ef.LogPosterior],
    chain: Floats,
    size: int,
    seed: int = 1,
    first: Callable[[Floats], Floats] | None = None,
) -> tuple[Floats, Floats, Floats]:
    """Return means and standard deviations of posteriors, and weights of a mode.

    All are by the same weighted draws of a mixture fitted to a chain, of which at least
    ``size`` are effective for the last posterior, if BATCHES do. ``first`` says which
    draws are in the first of two modes; each mode then has half of the draws.
    """
    parts = [chain]
    if first is not None:
        parts = [chain[first(chain)], chain[~first(chain)]]
        parts = [part for part in parts if len(part) > FEWEST * part.shape[1]]
    fits = [ef.IndependenceMove.fit(part, "auto", DF) for part in parts]
    laws = [(f.weights / len(fits), f.means, f.scale_matrices) for f in fits]
    mixture = Mixture(*map(np.concatenate, zip(*laws, strict=True)), DF)
    rng, x, log_weights = np.random.default_rng(seed), [], []
    for _ in range(BATCHES):
        x.append(mixture.draw(rng, BATCH))
        density = mixture.log_density(x[-1])
        log_weights.append([p(x[-1])[:, 0] - density for p in posteriors])
        ratios = np.concatenate(log_weights, axis=1)
        weights = np.exp(ratios - ratios.max(axis=1, keepdims=True))
        weights /= weights.sum(axis=1, keepdims=True)
        if (weights[-1] ** 2).sum() < 1 / size:
            break
    points = np.concatenate(x)
    means = weights @ points
    sds = np.sqrt(np.maximum(weights @ points**2 - means**2, 0))
    return means, sds, weights @ (first(points) if first else 0 * points[:, 0])
