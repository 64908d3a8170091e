"""The doctor of sensors by every door: posterior, maxima, run, file, joint."""

import numpy as np
import pytest
from support.chains import stored_and_read

import emcee_femu as ef

SPRINGS = {f"k{i}": (i, i + 1, 1.0) for i in range(4)}
MODEL = ef.MassSpringModel([1.0] * 4, SPRINGS, shapes=True)
PRIOR = ef.IndependentPrior(dict.fromkeys(SPRINGS, (0.6, 1.6)))
SOLVED = MODEL({name: np.array([1.1]) for name in SPRINGS})
SHAPES = SOLVED.shapes[0][:, :3]
RIGHT = ef.Measurements(SOLVED.frequencies[0, :3], SHAPES, dofs=range(4))
WRONG = ef.Measurements(
    SOLVED.frequencies[0, :3], SHAPES * [[1], [1], [-1], [1]], dofs=range(4)
)
TURNED = [("turned", ("s3",))]


def terms(test):
    return [ef.FrequencyTerm(test, relative_sd=0.01), ef.ShapeTerm(test, delta=0.03)]


def posterior(test):
    return ef.LogPosterior(
        ef.PairedModel(MODEL, test, candidates=4), terms(test), PRIOR
    )


def named(check):
    return [(suspect.kind, suspect.sensors) for suspect in check.suspects]


@pytest.mark.parametrize(("test", "expected"), [(RIGHT, []), (WRONG, TURNED)])
def test_every_door_says_the_same(test, expected, tmp_path):
    target = posterior(test)
    found = ef.find_map(ef.LogPosterior(MODEL, terms(RIGHT), PRIOR), 2, seed=1)
    by_number = ef.LogPosterior(MODEL, terms(test), PRIOR)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("emcee_femu.sampling.run.check_first_solve", lambda _: (0.1, []))
        run = ef.run(target, ef.DEMCMove(), 12, 20, seed=1, ensembles=1)
    idata = ef.to_inference_data(run)
    read = stored_and_read(idata, tmp_path / "run.nc")
    for check in (
        ef.check_test(target),
        ef.check_test(by_number),
        ef.check_test(run),
        ef.check_test(idata, target),
        ef.check_test(read, target),
    ):
        assert named(check) == expected
        assert check.status == ("suspect" if expected else "nothing suspect")
        assert ("s3" in str(check)) == bool(expected)
    assert ef.check_test(found).solves == 1 + len(found.maxima)


def test_a_run_warns_before_it_samples_and_remembers(tmp_path):
    """By frequencies alone, which fit: the warning is all that tells."""
    shapes = SHAPES * [[1], [1], [1], [2.5]]
    test = ef.Measurements(RIGHT.frequencies, shapes, dofs=range(4))
    paired = ef.PairedModel(MODEL, test, candidates=4)
    target = ef.LogPosterior(paired, terms(test)[0], PRIOR)
    options = {"seed": 1, "ensembles": 1, "backend": tmp_path / "run.chain"}
    with pytest.warns(UserWarning, match="sensor s4 seems to read 2.5 times"):
        run = ef.run(target, ef.DEMCMove(), 12, 150, **options)
    assert "s4" in run.doubts[0] and "s4" in ef.diagnose(run).fit.sentence
    assert "s4" in ef.diagnose(options["backend"]).fit.sentence
    again = ef.run(posterior(RIGHT), ef.DEMCMove(), 12, 40, seed=1, ensembles=1)
    assert not again.doubts


def test_experiments_are_checked_each_by_its_own_shapes():
    tests = {
        name: (ef.PairedModel(MODEL, test, candidates=4), terms(test))
        for name, test in (("before", RIGHT), ("after", WRONG))
    }
    check = ef.check_test(ef.LogPosterior.joint(tests, PRIOR))
    assert named(check) == TURNED and check.suspects[0].experiment == "after"
    assert str(check).startswith("after: sensor s3")


def test_labels_of_dofs_name_the_sensors():
    bar = ef.Section(E=(7e10, "E"), GJ=700, rho=2700, A=3e-4, Iy=2e-9, Iz=1e-8)
    nodes, bars = [(x, 0, 0) for x in range(5)], [(i, i + 1, "bar") for i in range(4)]
    dofs = ["1:uy", "2:uy", "3:uy", "4:uy", "2:uz", "4:uz", "4:rz"]
    model = ef.FrameModel(nodes, bars, {"bar": bar}, {0: "all"}, n_modes=6, shapes=dofs)
    solved = model({"E": np.ones(1)})
    shapes = solved.shapes[0][:, :4].copy()
    shapes[2] *= -1
    shapes[-1] *= -1  # a rotation, which no MAC compares
    test = ef.Measurements(solved.frequencies[0, :4], shapes, dofs=dofs)
    paired = ef.PairedModel(model, test, candidates=6)
    term = ef.FrequencyTerm(test, relative_sd=0.01)
    prior = ef.IndependentPrior({"E": (0.5, 2.0)})
    check = ef.check_test(ef.LogPosterior(paired, term, prior))
    assert named(check) == [("turned", ("3:uy",))]


def test_without_measured_shapes_nothing_is_checked():
    only = ef.FrequencyTerm([0.06, 0.16], relative_sd=0.01)
    reference = ef.PairedModel(
        MODEL, [0.06, 0.16], reference=dict.fromkeys(SPRINGS, 1.0), candidates=4
    )
    for model in (MODEL, reference):
        check = ef.check_test(ef.LogPosterior(model, only, PRIOR))
        assert (check.status, check.suspects, check.solves) == ("not checked", (), 0)
        assert "Not checked" in str(check)


def test_what_holds_no_posterior_is_refused():
    with pytest.raises(TypeError, match="idata"):
        ef.check_test(3.0)
