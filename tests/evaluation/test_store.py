"""The file of a run: what it keeps and refuses, and what is solved again of it."""

import sqlite3

import numpy as np
import pytest

import emcee_femu as ef
from emcee_femu.evaluation.store import Record, Store


def test_points_to_solve_again_are_spread_over_the_whole_run(tmp_path):
    posterior, path = ef.paper.mass_spring().posterior, tmp_path / "run.chain"
    run = ef.run(posterior, ef.DEMCMove(), 20, 30, ensembles=2, seed=1, backend=path)
    store = Store(str(path), read_only=True)
    points = np.array([theta for theta, _ in store.sample_records(9)])
    rows = np.array([row for _, row in store.sample_records(9)])
    store.close()
    np.testing.assert_allclose(posterior(points)[:, 0], rows[:, 0], rtol=1e-12)
    stored = [sampler.get_chain() for sampler in run]

    def is_in(part):
        return any((part == point).all(axis=-1).any() for point in points)

    for chain in stored:  # a model may have changed at any time
        assert is_in(chain[:15]) and is_in(chain[15:])


def record(stream, number, points=3):
    rng = np.random.default_rng([stream, number])
    theta, values = rng.normal(size=(points, 2)), rng.normal(size=(points, 4))
    return Record("rows", theta, values, [10 * number + stream, 1])


@pytest.fixture
def filled(tmp_path):
    """Return a file of two streams, of five and of two records."""
    store = Store(str(tmp_path / "run.chain"))
    for stream, count in ((0, 5), (1, 2)):
        for number in range(count):
            store.append(stream, number, record(stream, number))
    yield store
    store.close()


def test_records_come_back_to_the_bit_in_the_asked_order(filled):
    assert filled.lengths() == {0: 5, 1: 2}
    for numbers in (range(5), range(1, 5, 2), range(4, 5)):
        for number, found in zip(numbers, filled.read(0, numbers), strict=True):
            for one, other in zip(found, record(0, number), strict=True):
                np.testing.assert_array_equal(one, other)
    assert filled.spent() == [40 + 11, 2]  # the last counts of both streams


def test_entries_are_replaced_and_missing_ones_are_none(filled):
    assert filled["moves"] is None
    for value in ([1.5, None, "a"], {"k": [1, 2]}):
        filled["moves"] = value
        assert filled["moves"] == value


def test_a_record_and_the_position_of_its_ensemble_are_there_both_or_neither(filled):
    with pytest.raises(ValueError, match="another run writes to it"):
        filled.append(1, 1, record(1, 1), position="new")
    assert filled["position 1"] is None and filled.lengths()[1] == 2


def test_one_changed_bit_is_refused(filled):
    filled["moves"] = "DEMCMove"
    filled.verify()
    filled.close()
    with sqlite3.connect(filled.path) as file:
        file.execute("UPDATE entry SET content = '\"DEMCmove\"'")
    file.close()
    with pytest.raises(ValueError, match="does not match its checksum"):
        filled.verify()


def test_another_file_is_refused_and_left_as_it_is(tmp_path):
    other = tmp_path / "notes.db"
    with sqlite3.connect(other) as file:
        file.execute("CREATE TABLE notes (text TEXT)")
    file.close()
    before = other.read_bytes()
    with pytest.raises(ValueError, match="not the file of a run"):
        Store(str(other))
    with pytest.raises(ValueError, match="there is no file"):
        Store(str(tmp_path / "absent"), read_only=True)
    assert other.read_bytes() == before and not (tmp_path / "absent").exists()
