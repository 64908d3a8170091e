"""How many members ``anneal`` needs: on the mass-spring posterior, and for a needle.

The first table has the paper's mass-spring posterior. The error of the mean is that of
the worst parameter in posterior standard deviations, the median over the seeds, held
to a long run of "auto"; beside the spread of ln Z over the seeds stands the error that
was claimed (root mean square).

The second has two Gaussians in four dimensions, 5 standard deviations apart: a wide
one, and a narrow one of the given width with a fifth of the mass, in a centred box.
What counts is the share of the members in the narrow one, which should be 0.2.

Run it:  OMP_NUM_THREADS=1 python examples/benchmarks/tmcmc.py
"""

import argparse

import numpy as np
from hard_posteriors import box, gaussians, posterior_of

import emcee_femu as ef
from emcee_femu.table import Table


def mass_spring(sizes: list[int], seeds: int) -> Table:
    """Return errors of means and of the log evidence, by the number of members."""
    posterior = ef.paper.mass_spring().posterior
    samplers = ef.run(posterior, "auto", nsteps=2_000, ensembles=4, seed=1)
    long = np.concatenate([own.get_chain(flat=True) for own in samplers])
    rows = []
    for size in sizes:
        found = [ef.anneal(posterior, size, seed=seed) for seed in range(seeds)]
        means = np.array([own.theta.mean(axis=0) for own in found])
        errors = np.abs((means - long.mean(axis=0)) / long.std(axis=0)).max(axis=1)
        spread = float(np.std([own.log_evidence for own in found], ddof=1))
        claims = np.array([own.log_evidence_error for own in found])
        claimed = float(np.sqrt((claims**2).mean()))
        solves = np.mean([own.solves for own in found])
        rows.append((size, solves, float(np.median(errors)), spread, claimed))
    columns = ("members", "solves", "error of the mean", "spread of ln Z", "claimed")
    formats = ("d", ".0f", ".3f", ".3f", ".3f")
    return Table(f"Mass-spring, {seeds} seeds each", columns, formats, tuple(rows))


def needles(cases: list[tuple[float, float, int]], seeds: int) -> Table:
    """Return how many runs kept the needle, by its width, the box's, and members."""
    rows = []
    for width, side, size in cases:
        factors = [np.eye(4), width * np.eye(4)]
        means = [np.full(4, -1.25), np.full(4, 1.25)]  # 5 apart
        limits = box(4, -side / 2, side / 2)
        target = gaussians([0.8, 0.2], means, factors, limits)
        kept = []
        for seed in range(seeds):
            theta = ef.anneal(posterior_of(target), size, seed=seed).theta
            kept.append((target.label(theta) == 1).mean())
        share = np.array(kept)
        near = int((np.abs(share - 0.2) < 0.05).sum())
        rows.append((width, side, size, seeds, int((share > 0.02).sum()), near))
    columns = ("width", "box", "members", "runs", "above 0.02", "0.15 to 0.25")
    formats = (".1f", ".0f", "d", "d", "d", "d")
    return Table("Share of the needle", columns, formats, tuple(rows))


def main(
    sizes: tuple[int, ...] = (200, 500, 1_000),
    seeds: int = 10,
    cases: tuple[tuple[float, float, int], ...] = (
        (0.2, 20.0, 1_000),
        (0.2, 20.0, 4_000),
        (0.2, 20.0, 16_000),
        (0.2, 10.0, 4_000),
        (0.5, 20.0, 1_000),
    ),
) -> tuple[Table, Table]:
    """Print both tables."""
    first = mass_spring([*sizes], seeds)
    print(first, end="\n\n")
    second = needles([*cases], max(1, seeds // 2))
    print(second)
    return first, second


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=10)
    main(seeds=parser.parse_args().seeds)
