"""Annealing in a file: a stop at any time costs one batch, and changes no bit."""

import os

import numpy as np
import pytest
from support.tempered_laws import GaussianLaw

import emcee_femu as ef

LAW = GaussianLaw()


class Counted:
    """A model that counts its solves, stops at one of its calls, and may be changed."""

    variables = ef.modal_variables(4)

    def __init__(self, stop=0, offset=0.0):
        self._stop, self._offset, self.calls, self.solves = stop, offset, 0, 0

    def __call__(self, parameters):
        self.calls += 1
        if self.calls == self._stop:
            raise KeyboardInterrupt
        found = LAW.solve(parameters)
        if (parameters["a"] > 0.5 + 1.645).any():
            raise ArithmeticError("no equilibrium")
        self.solves += len(parameters["a"])
        return ef.ModalSolution(found.frequencies + self._offset)


def annealed(path=None, stop=0, offset=0.0, relative_sd=0.03, **options):
    """Return the model, and the population or what stopped it."""
    model = Counted(stop, offset)
    term = ef.FrequencyTerm(LAW.measured, relative_sd=relative_sd)
    posterior = ef.LogPosterior(model, term, LAW.posterior.prior)
    options = {"size": 80, "seed": 1, "on_failure": "reject", **options}
    try:
        return model, ef.anneal(posterior, backend=path, **options)
    except KeyboardInterrupt as error:
        return model, error


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A model, its population, and the file of it."""
    path = tmp_path_factory.mktemp("whole") / "run.annealing"
    return *annealed(path), path


def assert_same(one, other):
    for name in ("theta", "rows", "powers", "acceptance", "sweeps", "effective_size"):
        assert getattr(one, name).tobytes() == getattr(other, name).tobytes(), name
    for name in ("log_evidence", "log_evidence_error", "solves", "failed_solves"):
        assert getattr(one, name) == getattr(other, name), name


def test_a_file_changes_no_bit(whole):
    _, population, _ = whole
    assert population.failed_solves > 0
    assert_same(annealed()[1], population)


def test_stopped_anywhere_it_goes_on_to_the_same_bits(whole, tmp_path):
    model, population, _ = whole
    path = tmp_path / "run.annealing"
    spent, stops = 0, [int(model.calls * share) for share in (0.1, 0.3, 0.5, 0.5)]
    for stop in stops:  # counted anew each time, so that the last ones end it
        part, stopped = annealed(path, stop, resume=True)
        assert isinstance(stopped, KeyboardInterrupt)
        spent += part.solves
    part, again = annealed(path, resume=True)
    assert part.calls < model.calls / 2
    assert_same(again, population)
    # A probe each time, and what was lost with the batch.
    most = model.solves + (len(stops) + 1) * (16 + 80 + 80)
    assert model.solves < spent + part.solves < most


def test_a_torn_batch_is_evaluated_again(whole, tmp_path):
    _, population, finished = whole
    path, content = tmp_path / "run.annealing", finished.read_bytes()
    for cut in (1, 1_000, len(content) // 2):
        path.write_bytes(content[:-cut])
        assert_same(annealed(path, resume=True)[1], population)
        assert path.read_bytes() == content


def test_a_finished_one_costs_a_probe_and_stays(whole):
    _, population, path = whole
    content = path.read_bytes()
    model, again = annealed(path, resume=True)
    assert_same(again, population)
    assert model.solves in (14, 15, 16)  # one or two fail
    assert path.read_bytes() == content
    assert os.listdir(path.parent) == [path.name]


@pytest.mark.parametrize(
    ("other", "said"),
    [
        ({"seed": 2}, "seed: was 1, is 2"),
        ({"size": 100}, "size: was 80, is 100"),
        ({"relative_sd": 0.04}, r"terms.frequency.*was 1111.1+, is 625"),
        ({"offset": 1e-3}, "another posterior: in ensemble 1 .* of walker"),
    ],
)
def test_the_file_of_another_one_is_refused(whole, other, said):
    path = whole[2]
    content = path.read_bytes()
    with pytest.raises(ValueError, match=f"(?s)run.annealing holds a run of .*{said}"):
        annealed(path, resume=True, **other)
    assert path.read_bytes() == content


def test_a_tolerance_lets_a_solver_pass_that_scatters(whole):
    _, population, path = whole
    _, again = annealed(path, resume=True, offset=1e-3, probe_tolerance=1.0)
    assert_same(again, population)


def test_a_file_is_not_run_over_nor_mixed_with_that_of_a_chain(whole, tmp_path):
    with pytest.raises(ValueError, match="run.annealing exists; go on .* resume"):
        annealed(whole[2])
    path = tmp_path / "run.chain"
    ef.run(LAW.posterior, nsteps=2, seed=1, backend=path)
    with pytest.raises(ValueError, match="expected the file of a run.*another file"):
        annealed(path, resume=True)
    beside = tmp_path / "auto.chain.burn-in"
    beside.write_bytes(whole[2].read_bytes())
    with pytest.raises(ValueError, match="moves: was anneal, is auto"):
        ef.run(
            LAW.posterior,
            "auto",
            nsteps=2,
            seed=1,
            backend=tmp_path / "auto.chain",
            resume=True,
        )
    with pytest.raises(TypeError, match="resume: expected backend to be the name of"):
        ef.anneal(LAW.posterior, 80, seed=1, resume=True)


def test_what_a_solve_that_failed_stopped_goes_on_without_it(whole, tmp_path):
    path = tmp_path / "run.annealing"
    with pytest.raises(ArithmeticError):
        annealed(path, on_failure="raise")
    assert_same(annealed(path, resume=True)[1], whole[1])
    np.testing.assert_array_less(whole[1].theta[:, 0], 0.5 + 1.645)
