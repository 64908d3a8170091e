"""Does the H structure keep the order of its modes, as the paper takes for granted?

The paper compares measured and computed frequencies index by index, which holds only
while the modes keep their order. It prints no mode shapes, so this page takes those of
the initial structure, at three directions of every node, as if they had been measured.
It pairs the modes of other parameter sets with them by MAC and counts how often the
order differs: over the box of the bounds, over the prior, and over the posteriors of
beta = 10 (printed) and 5e4 (behind the printed results). Then it samples the second
posterior again with paired modes, to show what index-by-index comparison decided.

Run it:  python examples/mode_order.py
"""

import argparse

import numpy as np

import emcee_femu as ef
from emcee_femu.table import Table

HOME = np.array([1, 2, 4, 5, 7])  # the elastic modes of the paper's table
SEARCHED = 12
BETA = 5e4


def paired_model() -> ef.PairedModel:
    """Return the H model in the order of the modes of the initial structure."""
    problem = ef.paper.h_structure()
    model = ef.paper.h_frame(range(1, SEARCHED + 1), shapes=True)
    modes = model({name: np.array([x]) for name, x in problem.initial.items()})
    rows = [row for row, dof in enumerate(model.dofs) if ":u" in dof]
    shapes = modes.shapes[0][np.ix_(rows, HOME - 1)]
    dofs = [model.dofs[row] for row in rows]
    test = ef.Measurements(problem.measured, shapes=shapes, dofs=dofs)
    # Close modes stay apart (min_gap=0): here their order is the question.
    return ef.PairedModel(model, test, candidates=SEARCHED, min_gap=0.0)


def switched(model: ef.PairedModel, names: tuple[str, ...], theta: np.ndarray) -> list:
    """Return in percent how often the order differs, at all and for each mode."""
    pairing = model(dict(zip(names, theta.T, strict=True))).pairing
    elsewhere = pairing.model_modes != HOME
    columns = [elsewhere.any(axis=1), *elsewhere.T, pairing.unpaired.any(axis=1)]
    return [100 * float(column.mean()) for column in columns]


def main(draws: int = 4_000, generations: int = 2_000, seed: int = 1) -> dict:
    """Print the shares and the two posteriors; return them."""
    model, rng = paired_model(), np.random.default_rng(seed)
    problems = {beta: ef.paper.h_structure(beta) for beta in (10.0, BETA)}
    first = problems[BETA].posterior
    low, high = first.prior.bounds.T
    regions = {
        "box of the bounds": rng.uniform(low, high, (draws, first.ndim)),
        "prior": first.prior.sample(rng, draws),
    }
    runs = {}
    for beta, problem in problems.items():
        runs[beta] = ef.run(problem.posterior, "auto", 28, generations, seed=seed)
        chain = runs[beta][0].get_chain(flat=True)
        regions[f"posterior, beta = {beta:g}"] = rng.permutation(chain)[:draws]
    shares = Table(
        "Parameter sets whose modes are not in the initial order, %",
        ("region", "any", *(f"mode {mode}" for mode in HOME), "a MAC < 0.5"),
        ("", *7 * (".1f",)),
        tuple(
            (label, *switched(model, first.names, theta))
            for label, theta in regions.items()
        ),
    )
    print(shares)

    term = ef.FrequencyTerm(problems[BETA].measured, beta=BETA)
    paired = ef.LogPosterior(model, term, first.prior)
    runs["paired"] = ef.run(paired, "auto", 28, generations, seed=seed)
    idata = {
        "index by index": ef.to_inference_data(runs[BETA], first),
        "paired": ef.to_inference_data(runs["paired"], paired),
    }
    for label, data in idata.items():
        print(f"\n===== {label}, beta = {BETA:g} =====")
        print(ef.parameter_table(data))
        print(ef.frequency_table(data))
    return {"shares": shares, "idata": idata}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--draws", type=int, default=4_000)
    parser.add_argument("--generations", type=int, default=2_000)
    parser.add_argument("--seed", type=int, default=1)
    main(**vars(parser.parse_args()))
