"""Five masses, ten springs: the paper's first application.

Of ten stiffnesses five are unknown; only the five natural frequencies are measured:

    K phi = (2 pi f)^2 M phi,    K = sum_s k_s b_s b_s^T,    M = diag(m).

The posterior is a weak Gaussian prior about the initial guess, cut at bounds, times
Gaussian relative errors of the frequencies with standard deviation beta^-1/2 = 0.12 %
(Eqs. 2.2 to 2.4). The frequencies are matched to 0.01 %, a hundred times closer than
any stiffness (1 to 2.7 %): see the tilted ellipses.

Run it:  python examples/mass_spring.py
"""

import argparse
import sys
from pathlib import Path
from textwrap import fill
from time import perf_counter

import matplotlib

matplotlib.use("Agg")  # figures go to files

import emcee_femu as ef

SEED = 2026


def update(output: str = "figures/mass_spring") -> None:
    """Update the model within seconds; print what was learned."""
    problem = ef.paper.mass_spring()
    started = perf_counter()
    run = ef.run(problem.posterior, seed=SEED)
    seconds = perf_counter() - started
    idata = ef.to_inference_data(run)
    parameters = ef.parameter_table(idata, published={"true": problem.target})
    frequencies = ef.frequency_table(idata)
    before, after = (frequencies.column(name)[-1] for name in ("error %", "error % "))

    what = (
        "Five masses are connected by ten springs; the stiffnesses of five springs are "
        f"unknown. They were updated by five measured frequencies, with {run.solves:,} "
        f"solves of the model in {seconds:.0f} s. The tables compare the model before "
        "updating (prior mean) with the posterior, and the three statements below say "
        "whether it can be trusted."
    )
    print(f"{fill(what, 80)}\n\n{parameters}\n\n{frequencies}")
    print(f"Mean error (TAE): {before:.2f} % before updating, {after:.2f} % after.\n")
    for statement in ef.diagnose(run).verdict.splitlines():
        print(fill(statement, 80, subsequent_indent="    "))

    figures = {
        "scatter": ef.figures.plot_scatter(idata, truths=problem.target),
        "frequencies": ef.figures.plot_predictive(idata, problem.posterior),
        "prior_posterior": ef.figures.plot_prior_posterior(run),
    }
    write(output, figures, parameters, frequencies)
    python = Path(sys.executable)
    if python.is_relative_to(Path.cwd()):
        python = python.relative_to(Path.cwd())
    print("\nNext, a frame with mode shapes, from a CSV file to a verdict:")
    print(f"    {python} examples/tutorials/modal_test.py")


def write(output, figures, parameters, frequencies):
    """Write figures and tables; print their names."""
    folder = Path(output)
    folder.mkdir(parents=True, exist_ok=True)
    for name, figure in figures.items():
        figure.savefig(folder / f"{name}.png", dpi=150)
    parameters.to_frame().to_csv(folder / "parameters.csv", index=False)
    frequencies.to_frame().to_csv(folder / "frequencies.csv", index=False)
    names = [*(f"{name}.png" for name in figures), "parameters.csv", "frequencies.csv"]
    print(f"\nWritten to {folder}:")
    print(fill(", ".join(names), 80, initial_indent="    ", subsequent_indent="    "))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", default="figures/mass_spring", help="a folder")
    update(parser.parse_args().output)
