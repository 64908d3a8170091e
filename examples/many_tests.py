"""One structure tested at many temperatures: what changes, and by how much next time.

A two-storey frame on soft soil is tested on 24 days between -4 and 33 degrees. Its
frame loses stiffness with temperature, by 0.4 % a degree; its soil does not, but
differs from day to day by 6 %, whatever the temperature. Each test has three
frequencies with errors of 0.5 %. (The tests are simulated.)

Each test is sampled by itself first, under the same prior. From these 24 posteriors,
without another solve, ``pool_tests`` infers the means of both parameters, their spread
from day to day, and their slopes along the temperature; each test's own parameters in
the light of all others; and those of a test not yet made, at 40 degrees.

What the tables say:

    mean, per T     known better with each test, as in one posterior of all data
    sd soil         does not shrink with the number of tests: it is the structure's own
    next test       what to expect of the parameters next time, and what to design for

Run it:  python examples/many_tests.py
"""

import argparse
from pathlib import Path

import numpy as np

import emcee_femu as ef

TESTS, ERROR = 24, 0.005
FRAME, SOIL = 1.0, 1.0  # factors of the nominal stiffness, at 15 degrees
SLOPE, SCATTER_FRAME, SCATTER_SOIL = -0.004, 0.015, 0.06

K_FRAME = 9e6 * np.array([[1.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 1.0]])
K_SOIL = 12e6 * np.diag([1.0, 0.0, 0.0])
M = np.diag([9e3, 6e3, 5e3])  # footing, first floor, roof; kg


def frame() -> ef.MatrixModel:
    """Return the model; its parameters are factors of the nominal stiffness."""
    stiffness = {"frame": K_FRAME, "soil": K_SOIL}
    return ef.MatrixModel(np.zeros((3, 3)), M, stiffness, n_modes=3)


def make_tests(seed: int) -> dict[str, tuple[float, np.ndarray]]:
    """Simulate the tests: ``{day: (temperature, measured frequencies in Hz)}``."""
    rng = np.random.default_rng(seed)
    temperatures = rng.permutation(np.linspace(-4.0, 33.0, TESTS)).round(1)
    truth = {
        "frame": FRAME
        + SLOPE * (temperatures - 15)
        + SCATTER_FRAME * rng.standard_normal(TESTS),
        "soil": SOIL + SCATTER_SOIL * rng.standard_normal(TESTS),
    }
    exact = frame()(truth).frequencies
    measured = exact * (1 + ERROR * rng.standard_normal(exact.shape))
    return {
        f"day {i + 1}": (float(temperatures[i]), np.sort(measured[i]))
        for i in range(TESTS)
    }


def update(measured: np.ndarray, generations: int, seed: int) -> object:
    """Sample the posterior of one test by itself."""
    prior = ef.GaussianPrior(
        ["frame", "soil"], [1.0, 1.0], 0.3, [(0.3, 2.0), (0.3, 2.0)]
    )
    term = ef.FrequencyTerm(measured, relative_sd=ERROR)
    posterior = ef.LogPosterior(frame(), term, prior)
    samplers = ef.run(posterior, nsteps=generations, seed=seed)
    return ef.to_inference_data(samplers, posterior, discard=generations // 4)


def main(generations: int = 800, seed: int = 1, out: str = "") -> dict:
    """Update the frame by each test, pool the tests, print and draw."""
    tests = make_tests(seed)
    updated = {
        day: update(measured, generations, seed + i)
        for i, (day, (_, measured)) in enumerate(tests.items())
    }
    temperatures = {day: temperature for day, (temperature, _) in tests.items()}
    population = ef.NormalPopulation(["frame", "soil"], covariates={"T": temperatures})
    pooled = ef.pool_tests(updated, population, seed=seed)
    print(pooled.population, pooled, sep="\n\n")
    hot = pooled.next_test(T=40.0)
    for name, values in hot.items():
        low, high = np.quantile(values, [0.025, 0.975])
        print(f"{name} at 40 degrees: {low:.3f} to {high:.3f}")
    directory = Path(out or Path("figures") / "many_tests")
    directory.mkdir(parents=True, exist_ok=True)
    for name, against in [("tests", None), ("temperature", "T")]:
        figure = ef.plot_population(pooled, against)
        figure.savefig(directory / f"{name}.png", dpi=150)
    print(f"\nfigures in {directory.resolve()}")
    return {"pooled": pooled, "hot": hot}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--generations", type=int, default=800)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", default="", help="directory of the figures")
    main(**vars(parser.parse_args()))
