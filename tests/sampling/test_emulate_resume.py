"""Solves in a file: a kill loses none, and more of them go on from there."""

import numpy as np
import pytest
from support.few_solves import PRIOR, bent, posed

import emcee_femu as ef

SLOW = pytest.mark.slow
THETA = PRIOR.sample(np.random.default_rng(1), 5)


def emulated(posterior, path, solves=12, **options):
    options = {"seed": 1, "tolerance": 0.0, **options}
    return ef.emulate(posterior, solves, backend=path, **options)


def numbers(found):
    """Return what a result is, to the bit."""
    history = str(found.history.rows)
    return found.posterior(THETA).tobytes(), found.solves, history


@pytest.fixture(scope="module")
def whole():
    return numbers(emulated(posed(), None))


def test_a_file_changes_no_bit_and_is_read_again(whole, tmp_path):
    path = tmp_path / "run.solves"
    assert numbers(emulated(posed(), path)) == whole
    again = posed()
    assert numbers(emulated(again, path)) == whole
    assert len(again.model.solved) == 1  # tells a changed model


@pytest.mark.parametrize(
    "stop", [4, *(pytest.param(n, marks=SLOW) for n in (1, 8, 12))]
)
def test_a_kill_loses_no_solve(whole, tmp_path, stop):
    path = tmp_path / "run.solves"
    with pytest.raises(KeyboardInterrupt):
        emulated(posed(stop=stop), path)
    after = posed()
    assert numbers(emulated(after, path)) == whole
    assert len(after.model.solved) == 12 - (stop - 1) + (stop > 1)


@SLOW
def test_a_record_cut_short_is_solved_again(whole, tmp_path):
    path = tmp_path / "run.solves"
    emulated(posed(), path)
    content = path.read_bytes()
    path.write_bytes(content[:-5])
    after = posed()
    assert numbers(emulated(after, path)) == whole
    assert len(after.model.solved) == 2


# Within a batch, and at the end of one.
@pytest.mark.parametrize("first", [9, pytest.param(8, marks=SLOW)])
def test_more_solves_go_on_from_the_file(whole, tmp_path, first):
    path = tmp_path / "run.solves"
    assert emulated(posed(), path, first).solves == first
    after = posed()
    assert numbers(emulated(after, path)) == whole
    assert len(after.model.solved) == 12 - first + 1


@SLOW
def test_a_smaller_tolerance_goes_on_too(whole, tmp_path):
    path = tmp_path / "run.solves"
    assert emulated(posed(), path, tolerance=100.0).solves == 10
    assert numbers(emulated(posed(), path)) == whole


@SLOW
def test_workers_store_what_they_solved(whole, tmp_path):
    path = tmp_path / "run.solves"
    assert numbers(emulated(posed(), path, workers=2)) == whole
    assert numbers(emulated(posed(), path)) == whole


def test_the_file_of_something_else_is_refused(tmp_path):
    path = tmp_path / "run.solves"
    emulated(posed(), path, 8)
    with pytest.raises(ValueError, match="seed: was 1, is 2"):
        emulated(posed(), path, 8, seed=2)
    with pytest.raises(ValueError, match="holds a run of another posterior"):
        emulated(posed(lambda x: bent(x) + 0.01), path, 8)
