"""Efficiency on three targets, against the samplers that a user would pick instead.

fe5   five spring stiffnesses from five frequencies: bounded, correlated to 0.98
g20   a Gaussian in 20 dimensions, correlation 0.95, scales from 0.1 to 10
bim5  two Gaussians in 5 dimensions, ten standard deviations apart, weights 0.3 and 0.7

Every sampler gets the same vectorised log-density, the same over-dispersed starts and
the same number of walkers, on one thread, and they take turns, so that a drift of the
machine's speed hits all alike. The effective sample size is ArviZ's bulk ESS of the
worst parameter, walkers as chains. "/1000" and "/CPU-s" count what comes after the
burn-in; "end to end" counts all evaluations, those of the burn-in and of the search of
"auto" included. Peers that are not installed are left out:

    pip install dime-sampler bumps zeus-mcmc

Run it:  OMP_NUM_THREADS=1 python examples/benchmarks/benchmark.py
"""

import argparse
import importlib.util
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import emcee
import numpy as np
from scipy import stats

import emcee_femu as ef
from emcee_femu.results.arviz_objects import effective_sizes

Floats = np.ndarray


@dataclass(frozen=True)
class Target:
    """A log-density with its exact moments; the prior only spreads the starts."""

    name: str
    posterior: ef.LogPosterior
    mean: Floats
    sd: Floats
    limits: Floats  # for samplers that want a box


@dataclass(frozen=True)
class FreeModel:
    """No FE model: the density stands in the likelihood term."""

    n_modes: int = 1

    def __call__(self, parameters: Any) -> ef.ModalSolution:
        """Return one frequency that nobody reads."""
        return ef.ModalSolution(np.ones((len(next(iter(parameters.values()))), 1)))


def free_target(
    name: str, log_density: Callable[[Floats], Floats], spread: Floats, mean: Floats,
    sd: Floats,
) -> Target:  # fmt: skip
    """Return a target of given density, with Gaussian starts of given spread."""
    names = [f"x{i}" for i in range(len(spread))]
    prior = ef.GaussianPrior(names, np.zeros(len(spread)), spread)

    def density(parameters: Any, modes: Any) -> Floats:
        theta = np.stack([parameters[key] for key in names], axis=1)
        return log_density(theta) - prior.logpdf(theta)  # so that the prior cancels

    posterior = ef.LogPosterior(FreeModel(), density, prior)
    limits = np.array([[-1e3, 1e3]] * len(spread)) * spread[:, None]
    return Target(name, posterior, mean, sd, limits)


def fe5() -> Target:
    """Return the five-spring target; its moments come from importance sampling."""
    ends = [(0, 1), (1, 2), (2, 3), (3, 4), (4, 5), (5, 0), (1, 3), (2, 4), (3, 5)]
    stiffness = [4010.0, 2210.0, 3200.0, 2130.0, 1840.0, 2595.0, 2200.0, 2398.0, 2800.0]
    springs = {
        f"k{i}": (*pair, k)
        for i, (pair, k) in enumerate(zip(ends, stiffness, strict=True), 1)
    } | {"k10": (0, 3, 2000.0)}
    model = ef.MassSpringModel([2.7, 1.7, 6.1, 5.3, 2.9], springs)
    measured = model({}).frequencies[0]
    centre = np.array([4600.0, 2580.0, 1680.0, 3100.0, 2350.0])
    bounds = np.array(
        [(3200, 4800), (1800, 2600), (1600, 2670), (1800, 3400), (2050, 2750)]
    )
    names = ["k1", "k2", "k4", "k6", "k8"]
    prior = ef.GaussianPrior(names, centre, 0.2 * centre, bounds)
    posterior = ef.LogPosterior(model, ef.FrequencyTerm(measured, beta=4.5e5), prior)
    pilot = ef.run(posterior, None, 40, 4_000, seed=1)[0].get_chain(discard=1_000)
    law = ef.IndependenceMove.fit(pilot.reshape(-1, 5), "auto", df=5)
    draws = np.vstack(
        [
            stats.multivariate_t(m, S, df=5, seed=i).rvs(round(400_000 * w))
            for i, (w, m, S) in enumerate(
                zip(law.weights, law.means, law.scale_matrices, strict=True)
            )
        ]
    )
    log_weights = np.concatenate(
        [posterior(x)[:, 0] - law.log_density(x) for x in np.array_split(draws, 80)]
    )
    weights = np.exp(log_weights - log_weights.max())
    weights /= weights.sum()
    mean = weights @ draws
    sd = np.sqrt(weights @ (draws - mean) ** 2)
    return Target("fe5", posterior, mean, sd, bounds.astype(float))


def g20() -> Target:
    """Return the 20-dimensional Gaussian."""
    sd = np.geomspace(0.1, 10, 20)
    precision = np.linalg.inv(0.05 * np.eye(20) + 0.95) / np.outer(sd, sd)
    return free_target(
        "g20",
        lambda x: -0.5 * np.einsum("ni,ni->n", x @ precision, x),
        3 * sd,
        np.zeros(20),
        sd,
    )


def bim5() -> Target:
    """Return the two Gaussians, at -5 (0.3) and +5 (0.7) of the first axis."""

    def log_density(x: Floats) -> Floats:
        rest = -0.5 * (x[:, 1:] ** 2).sum(axis=1)
        left = np.log(0.3) - 0.5 * (x[:, 0] + 5) ** 2
        return rest + np.logaddexp(left, np.log(0.7) - 0.5 * (x[:, 0] - 5) ** 2)

    mean = np.array([2.0, 0, 0, 0, 0])
    sd = np.array([np.sqrt(1 + 25 - 4), 1, 1, 1, 1])
    return free_target("bim5", log_density, np.full(5, 4.0), mean, sd)


@dataclass(frozen=True)
class Result:
    """Kept draws ``(steps, walkers, d)`` and what they, and all before, cost."""

    chain: Floats
    evaluations: int
    seconds: float
    all_evaluations: int
    all_seconds: float


def with_emcee(move: Any, target: Target, start: Floats, steps: int) -> Result:
    """Run any emcee move with plain emcee; the first quarter is burn-in."""
    nwalkers, d = start.shape
    log_prob = target.posterior
    sampler = emcee.EnsembleSampler(
        nwalkers, d, lambda x: log_prob(x)[:, 0], moves=move, vectorize=True
    )
    burn_in = steps // 4
    begin = time.process_time()
    state = sampler.run_mcmc(start, burn_in)
    middle = time.process_time()
    sampler.run_mcmc(state, steps - burn_in)
    end = time.process_time()
    chain = sampler.get_chain(discard=burn_in)
    kept = nwalkers * (steps - burn_in)
    return Result(chain, kept, end - middle, nwalkers * (1 + steps), end - begin)


class Clock(emcee.backends.Backend):
    """Keep the time at which a chain begins."""

    def grow(self, *args: Any) -> None:
        """Make room for the chain."""
        self.began = time.process_time()
        super().grow(*args)


def automatic(target: Target, start: Floats, steps: int, seed: int) -> Result:
    """Run ``moves="auto"``; its search is extra and counts end to end."""
    begin, clock = time.process_time(), Clock()
    nwalkers, kept = len(start), steps - steps // 4
    (sampler,) = ef.run(
        target.posterior, "auto", nwalkers, kept, seed=seed, initial=start,
        backend=clock,
    )  # fmt: skip
    end = time.process_time()
    evaluations = sampler.burn_in_evaluations + nwalkers * kept
    chain, seconds = sampler.get_chain(), end - clock.began
    return Result(chain, nwalkers * kept, seconds, evaluations, end - begin)


def with_zeus(target: Target, start: Floats, steps: int) -> Result:
    """Run zeus's ensemble slice sampler for about the same number of evaluations."""
    import zeus

    nwalkers, d = start.shape
    log_prob = target.posterior
    sampler = zeus.EnsembleSampler(
        nwalkers, d, lambda x: log_prob(x)[:, 0], vectorize=True, verbose=False
    )
    steps //= 5  # a slice step takes about five evaluations per walker
    begin = time.process_time()
    sampler.run_mcmc(start, steps, progress=False)
    seconds = time.process_time() - begin
    chain = sampler.get_chain(discard=steps // 4)
    calls = int(sampler.ncall)
    return Result(chain, calls * 3 // 4, 0.75 * seconds, calls, seconds)


def with_bumps(target: Target, start: Floats, steps: int) -> Result:
    """Run the DREAM of bumps, snooker off, with a vectorised map."""
    from bumps.dream.core import Dream

    log_prob, (nwalkers, d) = target.posterior, start.shape

    class Model:
        labels = [f"p{i}" for i in range(d)]
        bounds = target.limits.T

        def map(self, population: Floats) -> Floats:
            return log_prob(population)[:, 0]  # not nllf: the core wants log p

    burn_in = steps // 4 * nwalkers
    dream = Dream(
        model=Model(),
        population=start[None].copy(),
        draws=steps * nwalkers - burn_in,
        burn=burn_in,
        DE_snooker_rate=0.0,
        monitor=lambda *_: None,
    )
    begin = time.process_time()
    _, chain, _ = dream.sample().chains()
    seconds = time.process_time() - begin
    calls = nwalkers * (1 + steps)
    return Result(chain, calls * 3 // 4, 0.75 * seconds, calls, seconds)


def samplers() -> dict[str, Callable[[Target, Floats, int, int], Result]]:
    """Return what is compared: ours, stock emcee, and the peers that are installed."""

    def plain(move: Callable[[], Any]) -> Callable[..., Result]:
        return lambda target, start, steps, seed: with_emcee(
            move(), target, start, steps
        )

    found: dict[str, Callable[..., Result]] = {
        "auto (ours)": automatic,
        "DEMCMove (ours)": plain(ef.DEMCMove),
        "emcee DEMove": plain(emcee.moves.DEMove),
        "emcee StretchMove": plain(emcee.moves.StretchMove),
    }
    if importlib.util.find_spec("dime_sampler"):
        from dime_sampler import DIMEMove

        found["dime-sampler"] = plain(DIMEMove)
    if importlib.util.find_spec("zeus"):
        found["zeus"] = lambda t, start, steps, seed: with_zeus(t, start, steps)
    if importlib.util.find_spec("bumps"):
        found["bumps DREAM"] = lambda t, start, steps, seed: with_bumps(t, start, steps)
    return found


def measured(result: Result, target: Target) -> tuple[float, ...]:
    """Return ESS /1000, ESS /CPU-s, end to end /1000, errors, and share x1 < 0."""
    chain = result.chain
    ess = effective_sizes(chain.transpose(1, 0, 2))[0].min()
    draws = chain.reshape(-1, chain.shape[2])
    return (
        1000 * ess / result.evaluations,
        ess / result.seconds,
        1000 * ess / result.all_evaluations,
        float(np.abs((draws.mean(axis=0) - target.mean) / target.sd).max()),
        float(100 * np.abs(draws.std(axis=0) / target.sd - 1).max()),
        float((draws[:, 0] < 0).mean()),
    )


def main(
    steps: int = 8_000, repeats: int = 3, only: str = ""
) -> dict[tuple[str, str], Floats]:
    """Print a table a target; return the medians over the repeats."""
    result = {}
    for make, nwalkers in ((fe5, 32), (g20, 64), (bim5, 32)):
        if only and make.__name__ != only:
            continue
        target = make()
        runs: dict[str, list[tuple[float, ...]]] = {name: [] for name in samplers()}
        for seed in range(repeats):
            start = target.posterior.start(nwalkers, seed)
            for name, sample in samplers().items():
                np.random.seed(seed)  # noqa: NPY002 - emcee and the peers use it
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore")  # the peers' own
                    try:
                        if seed == 0 and name == "bumps DREAM":
                            sample(target, start.copy(), 60, seed)  # numba compiles
                        found = sample(target, start.copy(), steps, seed)
                    except Exception as error:  # noqa: BLE001 - a peer's failure
                        print(f"{name}: {type(error).__name__}: {error}")
                        continue
                runs[name].append(measured(found, target))
        print(
            f"\n{target.name}, {nwalkers} walkers, {steps} generations, medians of "
            f"{repeats} paired runs\n{'sampler':<18} ESS /1000  /CPU-s  end to end "
            " mean error (sd)  sd error %  share x1 < 0"
        )
        for name, rows in runs.items():
            if not rows:
                continue
            row = np.median(rows, axis=0)
            result[target.name, name] = row
            print(
                f"{name:<18} {row[0]:9.1f} {row[1]:7.0f} {row[2]:11.1f} {row[3]:16.3f} "
                f"{row[4]:11.1f} {row[5]:13.3f}"
            )
    return result


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=int, default=8_000)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--only", default="", help="fe5, g20 or bim5")
    main(**vars(parser.parse_args()))
