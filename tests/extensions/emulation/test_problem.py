"""Several experiments are emulated each by itself, against quadrature."""

import numpy as np
import pytest
from scipy import stats
from support.runs import Counting

import emcee_femu as ef

PRIOR = ef.IndependentPrior(
    {
        "k1": stats.lognorm(0.4, scale=10.0),
        "k2": stats.lognorm(0.4, scale=5.0),
        "noise": stats.uniform(0.005, 0.02),
    }
)
MASSES = {"empty": 1.0, "loaded": 1.6}
K = {"k1": np.diag([1.0, 0.0]), "k2": np.array([[1.0, -1.0], [-1.0, 1.0]])}


def structure(mass):
    """Return two masses on two springs, the upper one heavier in one state."""
    model = ef.MatrixModel(np.zeros((2, 2)), np.diag([1.0, mass]), K, n_modes=2)
    counting = Counting(model)
    counting.names, counting.bounds = model.names, dict.fromkeys(K, (0.0, np.inf))
    return counting


def push(p):
    push.solves += len(p["k1"])
    return {"tip": 1 / p["k1"] + 1 / p["k2"]}


push.variables = {"tip": ef.Variable({}, "m")}
push.names = ("k1", "k2")


def tip_term(parameters, response):
    return stats.norm.logpdf(response["tip"], 0.31, 0.01)


def joint_of():
    push.solves = 0
    truth, experiments = {"k1": np.array([9.0]), "k2": np.array([5.5])}, {}
    for name, mass in MASSES.items():
        model = structure(mass)
        measured = model.model(truth).frequencies[0] * [1.005, 0.997]
        error = {"discrepancy": "noise"} if name == "loaded" else {"relative_sd": 0.02}
        term = ef.FrequencyTerm(measured, **error)
        experiments[name] = (model, term)
    experiments["static"] = (push, tip_term)
    return ef.LogPosterior.joint(experiments, PRIOR)


AXES = [np.linspace(5, 15, 31), np.linspace(3.5, 8, 31), np.linspace(0.0052, 0.0248, 9)]
GRID = np.stack(np.meshgrid(*AXES, indexing="ij"), axis=-1).reshape(-1, 3)


def moments(posterior):
    """Return means and standard deviations, by quadrature."""
    heights = posterior(GRID)[:, 0]
    weights = np.exp(heights - heights.max())
    weights /= weights.sum()
    mean = weights @ GRID
    return mean, np.sqrt(weights @ (GRID - mean) ** 2)


@pytest.mark.slow
def test_each_is_learned_from_its_own_solves_and_the_joint_posterior_is_right():
    """The law of joint emulation: moments by quadrature, no solve for others."""
    joint = joint_of()
    found = ef.emulate(joint, 25, seed=1, cheap=["static"])
    models = {e.name: e.model for e in joint.experiments}
    assert [*found.models] == ["empty", "loaded"]
    for name, model in found.models.items():
        # One does not wait for the other, nor is it solved for it.
        assert model.solves == models[name].solves <= 25
        assert model.names == ("k1", "k2")
        assert model.posterior is found.posterior
    assert found.solves == sum(model.solves for model in found.models.values())
    assert found.solves < 50 < push.solves
    solved = [model.solves for model in models.values() if model is not push]
    mean, sd = moments(found.posterior)
    assert solved == [m.solves for m in models.values() if m is not push]  # none more
    exact = moments(joint_of())
    assert (np.abs(mean - exact[0]) < 0.05 * exact[1]).all()
    np.testing.assert_allclose(sd, exact[1], rtol=0.03)
    assert found.posterior.labels == joint.labels
    assert "loaded: " in str(found) and "full solves" in str(found)
    assert found.settled and found.posterior.notes == {"settled": 1}


@pytest.mark.slow
def test_files_and_arguments(tmp_path):
    """The law of their files: one each, gone on with together or not at all."""
    joint, file = joint_of(), {"backend": tmp_path / "run.solves", "resume": True}
    first = ef.emulate(joint, 9, seed=1, cheap=["static"], **file)
    assert [m.settled for m in first.models.values()] != [True, True]  # too few solves
    assert not first.settled and first.posterior.notes == {"settled": 0}
    names = {path.name for path in tmp_path.iterdir()}
    assert names == {"run.solves.empty", "run.solves.loaded"}
    fresh = joint_of()
    again = ef.emulate(fresh, 9, seed=1, cheap=["static"], **file)
    np.testing.assert_array_equal(again.posterior(GRID[:9]), first.posterior(GRID[:9]))
    assert [e.model.solves for e in fresh.experiments[:2]] == [9, 9]  # which tell it
    (tmp_path / "run.solves.empty").unlink()
    with pytest.raises(ValueError, match="run.solves.loaded exists"):
        ef.emulate(fresh, 9, seed=1, cheap=["static"], backend=file["backend"])
    assert fresh.experiments[0].model.solves == 9


def test_what_is_cheap_is_some_experiments_but_not_all():
    alone = ef.paper.mass_spring().posterior
    for posterior, wrong in (
        (joint_of(), ["other"]),
        (joint_of(), ["empty", "loaded", "static"]),
        (alone, ["empty"]),
    ):
        with pytest.raises(ValueError, match="^cheap"):
            ef.emulate(posterior, 12, seed=1, cheap=wrong)


@pytest.mark.slow
def test_an_emulator_learns_the_parameters_that_its_model_reads():
    """One that does not declare them: all but those that only terms read."""
    empty, loaded, _ = joint_of().experiments
    pairs = {
        "empty": (empty.model, empty.terms),
        "loaded": (lambda p: loaded.model(p), loaded.terms),
    }
    laws = {"k1": (5.0, 15.0), "k2": (3.5, 8.0), "noise": (0.005, 0.025)}
    prior = ef.IndependentPrior(laws | {"other": stats.norm()})
    found = ef.emulate(ef.LogPosterior.joint(pairs, prior), 11, seed=1)
    names = [model.names for model in found.models.values()]
    assert names == [("k1", "k2"), ("k1", "k2", "other")]
