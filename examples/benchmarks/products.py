"""Data that know products alone: how often does a default run converge, and right?

Frequencies say what two stiffnesses, or a modulus and a thickness, give together:
``sqrt(a b)`` and ``3 sqrt(c e)`` are measured to so many percent. With six parameters
there is a third pair, of which both are measured. Three priors; once as an FE model and
once as a bare density. Each pair is independent of the others, so that quadrature in
the logarithms of its product and of its ratio gives exact means and standard
deviations.

Run it:  OMP_NUM_THREADS=1 python examples/benchmarks/products.py  (fifteen minutes)
"""

import itertools

import numpy as np
from commands import command, tabulate
from hard_targets import Run, Truth, compare
from scipy import stats

import emcee_femu as ef
from emcee_femu.table import Table

PERCENT = 0.5, 1.0, 2.0, 5.0
LAWS = {
    "uniform": stats.uniform(0.2, 4.8),
    "lognormal": stats.lognorm(0.8, scale=1.5),
    "Gaussian": stats.truncnorm(-1.3, 3.5, loc=1.5, scale=1.0),
}
NAMES = "abcdef"
MEASURED = 1.0, 3 * 2**0.5, 1.2, 1.5  # Hz; the last two of the pair that is known
POINTS = 400  # of a quadrature, along each of two ways
COLUMNS = {
    "parameters": "", "prior": "", "as": "", "runs": "", "converged": "",
    "wrong": "", "worst sd %": ".0f", "solves": ",.0f", "most": ",",
}  # fmt: skip


def frequencies(values: list[np.ndarray]) -> list[np.ndarray]:
    """Return the frequencies of two pairs, and of both members of a third one."""
    a, b, c, e, *known = values
    return [np.sqrt(a * b), 3 * np.sqrt(c * e), *map(np.sqrt, known)]


def posterior_of(d: int, law: str, percent: float, bare: bool) -> ef.LogPosterior:
    """Return a posterior of products, of a model or of a density alone."""
    prior = ef.IndependentPrior({name: LAWS[law] for name in NAMES[:d]})
    measured, error = np.array(MEASURED[: d - 2]), percent / 100
    if bare:

        def log_density(x: np.ndarray) -> np.ndarray:
            far = (np.stack(frequencies([*x.T]), axis=1) / measured - 1) / error
            return -0.5 * (far**2).sum(axis=1)

        return ef.LogPosterior.from_function(log_density, prior, vectorize=True)
    model = ef.FunctionModel(
        lambda p: frequencies([p[name] for name in NAMES[:d]]), n_modes=d - 2
    )
    term = ef.FrequencyTerm(measured, relative_sd=error)
    return ef.LogPosterior(model, term, prior)


def moments_of(law: str, square: float, percent: float) -> tuple[float, float]:
    """Return mean and standard deviation of either of a pair with a known product."""
    low, high = np.log(LAWS[law].ppf([1e-12, 1 - 1e-12]))
    product = np.log(square) + 20 * percent / 100 * np.linspace(-1, 1, POINTS)
    ratio = 2 * (high - low) * np.linspace(-1, 1, 10 * POINTS + 1)
    u, v = np.meshgrid(product, ratio)
    a, b = np.exp((u + v) / 2), np.exp((u - v) / 2)
    far = (np.sqrt(a * b / square) - 1) / (percent / 100)
    log_p = -0.5 * far**2 + LAWS[law].logpdf(a) + LAWS[law].logpdf(b) + u
    weights = np.exp(log_p - log_p.max())
    mean = np.average(a, weights=weights)
    return mean, np.sqrt(np.average((a - mean) ** 2, weights=weights))


def truth_of(d: int, law: str, percent: float) -> Truth:
    """Return the exact moments."""
    pairs = [moments_of(law, square, percent) for square in (1.0, 1.0, 2.0, 2.0)]
    for frequency in MEASURED[2 : d - 2]:
        x = frequency**2 * np.exp(20 * percent / 100 * np.linspace(-1, 1, 10_001))
        far = (np.sqrt(x) / frequency - 1) / (percent / 100)
        weights = np.exp(-0.5 * far**2) * LAWS[law].pdf(x) * x
        mean = np.average(x, weights=weights)
        pairs.append((mean, np.sqrt(np.average((x - mean) ** 2, weights=weights))))
    mean, sd = np.array(pairs).T
    return Truth(mean, sd, np.ones(1), 10**9)


def judge(d: int, law: str, percent: float, bare: bool, **options: int) -> Run:
    """Run "auto" once, and compare."""
    truth = truth_of(d, law, percent)
    return compare(posterior_of(d, law, percent, bare), truth, None, **options)


def main(
    seeds: int = 1,
    first: int = 0,
    laws: tuple[str, ...] = tuple(LAWS),
    percents: tuple[float, ...] = PERCENT,
) -> Table:
    """Print and return the table; each row has a run for each error and seed."""
    numbers = range(first, first + seeds)

    def row(case: tuple[int, str, bool]) -> tuple[object, ...]:
        d, law, bare = case
        runs = [
            judge(d, law, percent, bare, seed=seed)
            for percent in percents
            for seed in numbers
        ]
        good = [run for run in runs if run.converged]
        solves = [run.solves for run in runs]
        worst = 100 * max((run.sd for run in good), default=np.nan)
        return (
            d, law, "density" if bare else "model", len(runs), len(good),
            sum(run.wrong for run in good), worst, np.median(solves), max(solves),
        )  # fmt: skip

    cases = itertools.product((4, 6), laws, (False, True))
    return tabulate("Data that know products", COLUMNS, map(row, cases))


if __name__ == "__main__":
    command(main)
