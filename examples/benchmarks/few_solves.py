"""How many solves a posterior takes by ``emulate``, and how right it then is.

Each seed begins with nothing but the prior and the data. ``emulate`` gets as many
solves as the bar allows, counted by the model itself; "auto" samples the emulated
posterior, and a mixture is fitted to its chain; of the problems with two modes or a
lobe, which a chain may miss by chance, to one of the true posterior besides. Means and
standard deviations, of the emulated posterior and of the true one, are those of the
same weighted draws of the mixture, so that chance hardly counts in their difference;
where those of the true one are not the reference's (``few_solves_references.py``), the
emulated posterior is held to the reference instead. The bar: means within .05 standard
deviations, standard deviations within 5 %, and of Beck and Au's two modes the weight
within .02.

Then, with solves of their own: ``certify`` gives the effective share of full solves at
independent draws, and Pareto k; subchains of 100 cheap steps between full solves
(``--chain``) give effective samples per 1000 solves. Overhead is the process time of
emulator, sampling and certificate without the solves.

Run it:  OMP_NUM_THREADS=1 python examples/benchmarks/few_solves.py --seeds 20
"""

import argparse
import functools
import time
import warnings
from typing import NamedTuple

import emcee
import numpy as np
from few_solves_problems import PROBLEMS, Problem
from few_solves_references import load, sample, weigh

import emcee_femu as ef
from emcee_femu.results.arviz_objects import effective_sizes
from emcee_femu.table import Table

Floats = np.ndarray
FIRST_SEED = 100  # of the published table; others served to develop
EVALUATIONS = 20_000  # of the emulated posterior, in two ensembles
SIZE = 4_000  # effective draws by which its moments are told
AGREE = 0.1  # of a standard deviation: what chance leaves between these and a reference
SOLVED = 400  # draws that certify
MEAN, SD, WEIGHT = 0.05, 0.05, 0.02


class Seed(NamedTuple):
    """What one seed gave.

    Attributes:
        solves: Spent by ``emulate``, counted by the model.
        mean: The worst error of a mean, in posterior standard deviations.
        sd: The worst relative error of a standard deviation.
        weight: Error of the weight of the first mode, or of the lobe; 0 without one.
        efficiency: Effective share of weights of full solves.
        pareto_k: Of these weights.
        verdict: Of ``certify``.
        seconds: Overhead.
        error: The emulator's own opinion, the last true error of its history.
        chained: Effective samples per 1000 full solves with subchains, or NaN.
    """

    solves: int
    mean: float
    sd: float
    weight: float
    efficiency: float
    pareto_k: float
    verdict: str
    seconds: float
    error: float
    chained: float

    def good(self, name: str) -> bool:
        """Return whether the bar is met."""
        right = self.mean <= MEAN and self.sd <= SD and self.solves <= bar_of(name)
        return right and (name != "beck_au" or self.weight <= WEIGHT)


def bar_of(name: str) -> int:
    """Return the solves that a problem may take."""
    return PROBLEMS[name]().solves


@functools.cache
def true_draws(name: str) -> Floats:
    """Return draws of a true posterior that is cheap."""
    runs = sample(PROBLEMS[name]().posterior, 5 * EVALUATIONS, seed=0)
    return np.concatenate([run.get_chain(flat=True) for run in runs])


def compare(
    name: str, emulated: ef.LogPosterior, theta: Floats, seed: int
) -> tuple[float, float, float]:
    """Return the worst errors of means, standard deviations and weight."""
    problem, known = PROBLEMS[name](), load(name)
    if problem.first is not None:
        theta = np.concatenate([theta, true_draws(name)])
    found, true = weigh([emulated, problem.posterior], theta, problem.first, SIZE, seed)
    return found.compare(true if max(true.compare(known)) < AGREE else known)


def chain(problem: Problem, cheap: ef.LogPosterior, theta: Floats, seed: int) -> float:
    """Return effective samples per 1000 full solves, with subchains of 100."""
    nwalkers, steps = max(16, 2 * theta.shape[1]), 60
    rng = np.random.default_rng(seed)
    move = ef.DelayedAcceptanceMove(ef.DEMCMove(mode_jump=0.1), cheap, steps=100)
    sampler = emcee.EnsembleSampler(
        nwalkers, theta.shape[1], problem.posterior, moves=move, vectorize=True
    )
    start = theta[rng.choice(len(theta), nwalkers, replace=False)]
    random = np.random.RandomState(seed).get_state()
    state = sampler.run_mcmc(emcee.State(start, random_state=random), 1)
    before = problem.box.solves
    sampler.reset()
    sampler.run_mcmc(state, steps)
    bulk = effective_sizes(sampler.get_chain().transpose(1, 0, 2))[0]
    return 1000 * float(bulk.min()) / (problem.box.solves - before)


def judge(name: str, seed: int, solves: int | None, chained: bool) -> Seed:
    """Emulate, sample, compare and certify."""
    problem = PROBLEMS[name]()
    begin = time.process_time()
    emulated = ef.emulate(
        problem.posterior, solves or problem.solves, seed=seed, tolerance=0
    )
    spent = problem.box.solves
    runs = sample(emulated.posterior, EVALUATIONS, seed)
    idata = ef.to_inference_data(runs, emulated.posterior)
    certificate = ef.certify(idata, problem.posterior, SOLVED, seed=seed)
    seconds = time.process_time() - begin - problem.box.seconds
    theta = np.concatenate([run.get_chain(flat=True) for run in runs])
    per_1000 = np.nan
    if chained:
        per_1000 = chain(problem, emulated.posterior, theta, seed)
    return Seed(
        spent,
        *compare(name, emulated.posterior, theta, seed),
        certificate.efficiency,
        certificate.pareto_k,
        certificate.short,
        seconds,
        float(emulated.history.column("true error")[-2]),
        per_1000,
    )


def tabulate(results: dict[str, list[Seed]]) -> Table:
    """Return one row a problem: all its seeds, or the worst or the median of them."""
    found = list(results.items())

    def worst(field: str) -> list[float]:
        return [max(getattr(one, field) for one in seeds) for _, seeds in found]

    def middle(field: str) -> list[float]:
        return [np.median([getattr(s, field) for s in seeds]) for _, seeds in found]

    met = [f"{sum(s.good(n) for s in seeds)} of {len(seeds)}" for n, seeds in found]
    certified = [sum(s.verdict == "certified" for s in seeds) for _, seeds in found]
    return Table.from_columns(
        "Posteriors in few solves; medians of the seeds, and the worst of them",
        [
            ("problem", "", [name for name, _ in found]),
            ("solves", "d", worst("solves")),
            ("meet the bar", "", met),
            ("mean off", ".3f", middle("mean")),
            ("worst", ".3f", worst("mean")),
            ("sd off", ".3f", middle("sd")),
            ("worst ", ".3f", worst("sd")),
            ("efficiency", ".3f", middle("efficiency")),
            ("least", ".3f", [min(s.efficiency for s in v) for _, v in found]),
            ("worst k", ".2f", worst("pareto_k")),
            ("certified", "d", certified),
            ("chain / 1000", ".0f", middle("chained")),
            ("seconds", ".0f", middle("seconds")),
        ],
    )


def main() -> dict[str, list[Seed]]:
    """Print a line a seed as it ends, then the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first", type=int, default=FIRST_SEED)
    parser.add_argument("--problem", action="append", choices=list(PROBLEMS))
    parser.add_argument("--solves", type=int, help="others than the bar allows")
    parser.add_argument("--chain", action="store_true", help="subchains too")
    given = parser.parse_args()
    names = given.problem or list(PROBLEMS)
    results: dict[str, list[Seed]] = {name: [] for name in names}
    for seed in range(given.first, given.first + given.seeds):
        for name in names:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                one = judge(name, seed, given.solves, given.chain)
            results[name].append(one)
            shown = (f"{v:.3g}" if isinstance(v, float) else v for v in one)
            mark = "met" if one.good(name) else "MISSED"
            print(name, seed, mark, *shown, sep="  ", flush=True)
    print(tabulate(results))
    return results


if __name__ == "__main__":
    main()
