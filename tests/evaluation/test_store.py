"""The file of a run, by itself: which of its points a resume solves again."""

import numpy as np

import emcee_femu as ef
from emcee_femu.evaluation.store import Store


def test_points_to_solve_again_are_spread_over_the_whole_run(tmp_path):
    posterior, path = ef.paper.mass_spring().posterior, tmp_path / "run.chain"
    run = ef.run(posterior, ef.DEMCMove(), 20, 30, ensembles=2, seed=1, backend=path)
    store = Store(str(path), read_only=True)
    points = np.array([theta for theta, _ in store.spread(9)])
    rows = np.array([row for _, row in store.spread(9)])
    store.close()
    np.testing.assert_allclose(posterior(points)[:, 0], rows[:, 0], rtol=1e-12)
    stored = [sampler.get_chain() for sampler in run]

    def is_in(part):
        return any((part == point).all(axis=-1).any() for point in points)

    for chain in stored:  # a model may have changed at any time
        assert is_in(chain[:15]) and is_in(chain[15:])
