"""How many solves ``emulate`` needs for a posterior, and how accurate it then is.

Every model stands for an FE program: it gives a response, with derivatives or without.
``emulate`` gets as many solves as the bar allows, and "auto" samples the emulated
posterior. Both posteriors are compared by the same weighted draws of a mixture fitted
to their chains, so that chance hardly affects the difference. The page
docs/explanation/few_solves_measured.md has the bar. ``certify`` has solves of its own.

Run it:  OMP_NUM_THREADS=1 python examples/benchmarks/few_solves.py --seeds 10

With ``--workers 16`` a round has 16 points: a third more solves, in at most six rounds.
"""

import functools
import sys
import time
import warnings
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from buildings import draw, measure, shear_building, terms_of
from commands import command, draws_of, tabulate, weigh
from evidence import beck_au as beck_au_exactly

import emcee_femu as ef
from emcee_femu.sampling.record import Run

Floats = np.ndarray
EVALUATIONS = 20_000  # of the emulated posterior, in two ensembles
SIZE = 4_000  # effective draws by which moments are compared
WIDER, ROUNDS = 4 / 3, 6  # times as many solves, and rounds at most, by workers
SOLVED = 400  # draws that certify
MEAN, SD, WEIGHT, EFFICIENCY = 0.05, 0.05, 0.02, 0.75
COLUMNS = {
    "problem": "", "learned": "", "solves": "d", "rounds": "d", "met": "d",
    "mean off": ".3f", "sd off": ".3f", "certified": "d",
}  # fmt: skip


class ValuesOnly:
    """A model without its derivatives."""

    def __init__(self, model: Any) -> None:
        self.model, self.variables, self.names = model, model.variables, model.names
        self.bounds = getattr(model, "bounds", {})

    def __call__(self, parameters: Any) -> Any:
        """Solve."""
        return self.model(parameters)


@dataclass(frozen=True)
class RatioTerm:
    """Gaussian errors of (f / f_measured)^power - 1 of some of the model's modes."""

    measured: Sequence[float]
    sd: float
    modes: Sequence[int]  # from 0
    power: int = 1
    name: str = "frequency"
    reads: Mapping[str, Any] = field(default_factory=lambda: ef.modal_variables(1))

    def __call__(self, parameters: Any, response: Any) -> Floats:
        """Return the log-likelihood of every parameter set, without its constant."""
        r, sd = self.deviations(parameters, response)
        return -0.5 * ((r / sd) ** 2).sum(axis=1)

    def deviations(self, parameters: Any, response: Any) -> tuple[Floats, Floats]:
        """Return the deviations and their standard deviations (contracts.py)."""
        f = ef.contracts.read(response, "frequency")[:, list(self.modes)]
        r = (f / np.array(self.measured)) ** self.power - 1
        return r, np.full(r.shape, self.sd)


class Problem(NamedTuple):
    """A posterior and how many solves it may take."""

    posterior: ef.LogPosterior  # the true one
    solves: tuple[int, int]  # the bar, values only and with derivatives
    first: Callable[[Floats], Floats] | None = None  # is a draw in that of two modes?


def beck_au(learned: Any) -> Problem:
    """Return Beck and Au's shear frame, with two modes."""
    exact = beck_au_exactly().posterior
    term = RatioTerm((3.13, 9.83), 0.5**4, (0, 1), power=2)
    posterior = ef.LogPosterior(learned(exact.model), term, exact.prior)
    return Problem(posterior, (30, 12), lambda x: x[:, 0] < 1)


def mass_spring(learned: Any) -> Problem:
    """Return the paper's five masses and ten springs; there is a lobe at small k4."""
    posterior = ef.paper.mass_spring().posterior.with_models(learned)
    return Problem(posterior, (45, 15), lambda x: x[:, 2] < 1980)


def h_structure(learned: Any, beta: float = 500.0) -> Problem:
    """Return the paper's H structure, whose modes cross; the lowest seven are closed.

    Shapes are known, but not measured. The paper compares five modes. The next two
    cross modes above them: returned without those they would only hurt
    (examples/how_to/emulated_crossing_modes.py).
    """
    given = ef.paper.h_structure(beta)
    rows = [f"{node}:u{axis}" for node in range(13) for axis in "xyz"]
    frame = ef.paper.h_frame(modes=range(1, 8), shapes=rows)
    wanted = [mode - 1 for mode in given.model.modes]
    term = RatioTerm(tuple(given.measured), beta**-0.5, wanted)
    posterior = ef.LogPosterior(learned(frame), term, given.posterior.prior)
    return Problem(posterior, (90, 40) if beta < 5e3 else (180, 80))


MASS = 1e5  # kg
HEIGHT, SENSORS = 8, (1, 3, 5, 7)  # of the tower


def shear(learned: Any) -> Problem:
    """Return a shear building of ten storeys, five of whose floors were measured."""
    names = [f"s{i}" for i in range(1, 11)]
    model, prior = shear_building(names, MASS, 7, (0, 2, 4, 7, 9), 1.0)
    return _paired(learned, model, prior, 5, 7, (80, 30))


def tower(learned: Any) -> Problem:
    """Return a tower whose two directions are nearly alike: modes in close pairs."""
    names = [f"{axis}{i}" for axis in "xy" for i in range(1, HEIGHT + 1)]
    along = [np.outer(b, b) for b in np.eye(HEIGHT) - np.eye(HEIGHT, k=-1)]
    K = {
        name: np.kron(np.diag([axis, 1 - axis]), (2e8 * axis + 2.04e8 * (1 - axis)) * k)
        for name, (axis, k) in zip(names, product((1, 0), along), strict=True)
    }  # N/m
    _, prior = shear_building(names, MASS, 1, (), 1.0)
    model = ef.MatrixModel(
        np.kron([[0.0, 1.0], [1.0, 0.0]], 2e5 * sum(along)),  # couples x and y, N/m
        MASS * np.eye(2 * HEIGHT), K, n_modes=6,
        shapes=[*SENSORS, *(HEIGHT + floor for floor in SENSORS)],
    )  # fmt: skip
    return _paired(learned, model, prior, 4, 6, (250, 90))


def _paired(
    learned: Any, model: ef.MatrixModel, prior: ef.GaussianPrior, n_modes: int,
    candidates: int, bar: tuple[int, int],
) -> Problem:  # fmt: skip
    """Return the problem of a draw of the prior, whose modes are measured."""
    truth = draw(prior, np.random.default_rng(3))
    measured = measure(model, truth, n_modes, np.random.default_rng(4))
    paired = ef.PairedModel(learned(model), measured, candidates=candidates)
    return Problem(ef.LogPosterior(paired, terms_of(measured), prior), bar)


KINDS: dict[str, Callable[[Any], Any]]
KINDS = {"values only": ValuesOnly, "with derivatives": lambda model: model}
PROBLEMS: dict[str, Callable[..., Problem]] = {
    "beck_au": beck_au,
    "mass_spring": mass_spring,
    "h_structure": h_structure,
    "h_sharp": functools.partial(h_structure, beta=5e4),  # errors ten times smaller
    "shear": shear,
    "tower": tower,
}


def sample(posterior: ef.LogPosterior, evaluations: int, seed: int) -> Run:
    """Return a run of "auto"."""
    nwalkers = max(32, 4 * posterior.ndim)
    steps = evaluations // (2 * nwalkers)
    return ef.run(posterior, nwalkers=nwalkers, steps=steps, ensembles=2, seed=seed)


@functools.cache
def true_draws(name: str) -> Floats:
    """Return draws of a true posterior."""
    posterior = PROBLEMS[name](KINDS["with derivatives"]).posterior
    return draws_of(sample(posterior, 5 * EVALUATIONS, seed=0))


class Seed(NamedTuple):
    """What one seed gave."""

    solves: int  # spent by ``emulate``
    rounds: int  # in which it solved, the first design among them
    mean: float  # the worst error of a mean, in posterior standard deviations
    sd: float  # the worst relative error of a standard deviation
    weight: float  # error of that of the first mode, or of the lobe; 0 without one
    efficiency: float  # effective share of weights of full solves
    pareto_k: float  # of these weights
    verdict: str  # of ``certify``
    seconds: float  # overhead

    def good(self, name: str) -> bool:
        """Return whether the posterior meets the bar."""
        if name == "tower":
            return self.efficiency >= EFFICIENCY
        right = self.mean <= MEAN and self.sd <= SD
        return right and (name != "beck_au" or self.weight <= WEIGHT)


def judge(name: str, learned: str, seed: int, workers: int) -> Seed:
    """Emulate, sample, compare and certify."""
    problem = PROBLEMS[name](KINDS[learned])
    most = problem.solves[list(KINDS).index(learned)]
    if workers > 1:
        most = min(int(WIDER * most), ROUNDS * workers)
    begin = time.process_time()
    with ThreadPoolExecutor(workers) as pool:
        options = {"seed": seed, "pool": pool, "tolerance": 0}
        emulated = ef.emulate(problem.posterior, most, **options)
    run = sample(emulated.posterior, EVALUATIONS, seed)
    idata = ef.to_inference_data(run)
    certificate = ef.certify(idata, problem.posterior, SOLVED, seed=seed)
    seconds = time.process_time() - begin
    together = np.concatenate([draws_of(run), true_draws(name)])
    posteriors = (problem.posterior, emulated.posterior)
    means, sds, weights = weigh(posteriors, together, SIZE, seed, problem.first)
    return Seed(
        emulated.solves,
        len(emulated.history.rows),
        float(np.abs((means[1] - means[0]) / sds[0]).max()),
        float(np.abs(sds[1] / sds[0] - 1).max()),
        float(abs(weights[1] - weights[0])),
        certificate.efficiency,
        certificate.pareto_k,
        certificate.short,
        seconds,
    )


def summarize(name: str, learned: str, seeds: list[Seed]) -> tuple[object, ...]:
    """Return the row of a problem: the worst of its seeds, and how many are good."""
    columns = zip(*(s._replace(verdict="") for s in seeds), strict=True)
    worst = Seed(*map(max, columns))
    met = sum(s.good(name) for s in seeds)
    sure = sum(s.verdict == "certified" for s in seeds)
    return (
        name, learned, worst.solves, worst.rounds, met, worst.mean, worst.sd, sure
    )  # fmt: skip


def main(
    seeds: int = 20,
    first: int = 501,
    problem: tuple[str, ...] = tuple(PROBLEMS),
    workers: int = 1,
    learned: tuple[str, ...] = tuple(KINDS),
) -> dict[tuple[str, str], list[Seed]]:
    """Print a line a seed as it ends, then the table."""
    results: dict[tuple[str, str], list[Seed]] = {}
    warnings.simplefilter("ignore")  # the weights are what counts
    for name, kind, seed in product(problem, learned, range(first, first + seeds)):
        one = judge(name, kind, seed, workers)
        results.setdefault((name, kind), []).append(one)
        shown = (f"{v:.3g}" if isinstance(v, float) else v for v in one)
        mark = "met" if one.good(name) else "MISSED"
        print(name, kind, seed, mark, *shown, sep="  ", file=sys.stderr, flush=True)
    title = f"Posteriors in few solves; the worst of {seeds} seeds"
    tabulate(title, COLUMNS, (summarize(*key, found) for key, found in results.items()))
    return results


if __name__ == "__main__":
    command(main)
