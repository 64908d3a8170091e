"""Every argument of every public name is thrown the mistakes of its kind.

A new public name needs no entry where ARGUMENTS has its arguments. Otherwise add a
valid value and its kind there, or to CALLS where the same word means another thing.
"""

import inspect
import sys
import tempfile
from collections import defaultdict
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import ModuleType, SimpleNamespace

import emcee
import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.figure import Figure
from scipy import stats
from support.mistakes import (
    Kind,
    anything,
    array,
    by_name,
    file,
    find_faults,
    flag,
    names,
    number,
    text,
    whole,
    wholes,
)
from support.public import public_names
from support.universal_file import LABELS, read_universal

import emcee_femu as ef

HERTZ, SD = np.array([3.0, 9.0]), np.array([0.1, 0.2])
SHAPES = np.array([[1.0, 1.5], [1.6, -0.6], [0.3, 0.8]])
SQUARES = SHAPES**2
rng = np.random.default_rng(1)
REPEATS = HERTZ * (1 + 0.01 * rng.standard_normal((5, 2)))
TESTS = SHAPES + 0.05 * rng.standard_normal((5, 3, 2))
DRAWS = rng.standard_normal((45, 2)) * [1.0, 1e3] + [5.0, 2e4]
COV = np.array([[1.0, 30.0], [30.0, 4e3]])
MODES = ef.ModalSolution(HERTZ[None] * 1.02, (SHAPES + 0.05)[None])
MEASURED = ef.Measurements(HERTZ, shapes=SHAPES, sd=SD)
K0, M0 = np.diag([9.0, 4.0]), np.array([[2.0, 0.5], [0.5, 1.0]])
K2 = np.array([[1.0, -1.0], [-1.0, 1.0]])
BLOCK = Path(__file__).parents[1] / "data/block.sti"
FRF_FILE = BLOCK.parent / "frf.uff"  # two channels at three lines
NODES = np.array([[0.0, 0.0, 0.0], [0.5, 0.0, 0.1], [1.0, 0.0, 0.0]])
BARS, UP = [(0, 1, "bar"), (1, 2, "bar")], np.array([0.0, 0.0, 1.0])
BAR = {"E": 7e10, "GJ": 700.0, "rho": 2700.0, "A": 3e-4, "Iy": 2e-9, "Iz": 3e-9}
SPRINGS = {"k1": (0, 1, 10.0), "k2": (1, 2, 5.0)}
MODEL = ef.MassSpringModel([1.0, 2.0], SPRINGS)
PRIOR = ef.GaussianPrior(["k1", "k2"], [10.0, 5.0], 2.0, [(2.0, 20.0), (1.0, 9.0)])
TERM = ef.FrequencyTerm(MODEL({}).frequencies[0], relative_sd=0.05)
POSTERIOR = ef.LogPosterior(MODEL, TERM, PRIOR)
JOINT = ef.LogPosterior.joint({"empty": (MODEL, TERM), "loaded": (MODEL, TERM)}, PRIOR)
POINT, START = np.array([9.0, 6.0]), POSTERIOR.start(16, 1).reshape(2, 8, 2)
RUN = ef.run(POSTERIOR, ef.DEMCMove(), nwalkers=8, steps=16, seed=1, ensembles=1)
LADDER = ef.moves.TemperedMove(ef.DEMCMove(), [1.0, 0.2, 0.0])
TEMPERED = ef.run(POSTERIOR, LADDER, nwalkers=24, steps=16, seed=1, ensembles=1)
EVIDENCE = ef.log_evidence(TEMPERED)
CLASSES = {"a": EVIDENCE, "b": EVIDENCE}
PLAIN = emcee.EnsembleSampler(8, 2, lambda x: -float(x @ x))
PLAIN.run_mcmc(START[0], 3)
IDATA = ef.to_inference_data(RUN, POSTERIOR)
PAIRED = ef.PairedModel(
    ef.MassSpringModel([1.0, 2.0], SPRINGS, shapes=True),
    ef.Measurements(MODEL({}).frequencies[0], shapes=SHAPES[:2]),
    candidates=2,
)
PAIRED_RUN = ef.run(
    ef.LogPosterior(PAIRED, TERM, PRIOR), ef.DEMCMove(), 8, 16, seed=1, ensembles=1
)
COLUMN = ef.Geometry(
    {0: (0.0, 0.0), 1: (0.0, 1.0)}, [(0, 1)], {0: (0, "ux"), 1: (1, "ux")}
)
PAIRS, FRF = [(0, 1), (1, 1)], np.array([[1.0 + 2.0j, 0.5], [0.3, 1.0j]])
SHAKER = ef.MatrixModel(K0, M0, {"k2": K2}, n_modes=2, shapes=True)
SHAKEN = ef.LogPosterior(
    ef.frf.FRFModel(SHAKER, HERTZ, PAIRS, damping=0.05, kind="mobility"),
    ef.frf.FRFTerm(ef.frf.FRFMeasurements(HERTZ, FRF, PAIRS, kind="mobility"), sd=0.5),
    ef.GaussianPrior(["k2"], [5.0], 1.0, [(1.0, 9.0)]),
)
SHAKEN_IDATA = ef.to_inference_data(
    ef.run(SHAKEN, ef.DEMCMove(), steps=16, ensembles=1, seed=1), SHAKEN
)
VARIABLES, NORMAL = {"y": ef.Variable({})}, stats.norm(3.0, 9.0)
LONGER = ef.run(POSTERIOR, ef.DEMCMove(), nwalkers=8, steps=100, seed=1, ensembles=1)
TWO_TESTS = dict.fromkeys("ab", ef.to_inference_data(LONGER))
POPULATION, BY_TEST = ef.population.NormalPopulation(["k1", "k2"]), {"a": 1.0, "b": 2.0}
# Nothing of it is drawn.
POOLED = object.__new__(sys.modules[ef.pool_tests.__module__].PooledTests)
vars(POOLED).update(population=POPULATION)
MOVES = {"DE-MC": ef.DEMCMove(), "M-H": [(ef.MetropolisMove(sd=1.0), 1.0)]}
RESULT = SimpleNamespace(Fn=HERTZ, Phi=SHAPES, Fn_std=None)  # of pyOMA2
ANSWERS = {"getNodeTags": [7], "nodeCoord": [0.0], "getNDF": [1], "nodeDOFs": [0]}
ANSWERS |= {"systemSize": 1, "printA": [4.0]}
NOTHING = "getConstrainedNodes getConstrainedDOFs getFixedDOFs getEleTags wipeAnalysis"
NOTHING += " system numberer constraints algorithm integrator analysis analyze"
ANSWERS |= dict.fromkeys(NOTHING.split(), [])
OPS = ModuleType("opensees")  # one DOF
vars(OPS).update({name: lambda *_, x=answer: x for name, answer in ANSWERS.items()})
AXES = ("DX", "DY", "DZ", "RX", "RY", "RZ")
NODE = SimpleNamespace(name="a", ID=0, X=0.0, Y=0.0, Z=0.0)
vars(NODE).update({f"support_{axis}": axis != "DX" for axis in AXES})
vars(NODE).update({f"Enforced{axis}": None for axis in AXES})
FREE = SimpleNamespace(  # of PyNite
    nodes={"a": NODE},
    load_combos=["mass"],
    Ke=lambda *_, **__: np.eye(6),
    M=lambda *_, **__: np.eye(6),
    **dict.fromkeys(["members", "springs", "plates", "quads"], {}),
)
NO_DOFS = np.zeros((0, 0), dtype=int)
BASIS = SimpleNamespace(  # of scikit-fem
    N=2,
    nodal_dofs=np.array([[0, 1]]),
    **dict.fromkeys(["facet_dofs", "edge_dofs", "interior_dofs"], NO_DOFS),
    doflocs=np.array([[0.0, 1.0]]),
    elem=SimpleNamespace(dofnames=["u"]),
    mesh=SimpleNamespace(dim=lambda: 1, t=np.array([[0], [1]])),
)


positive, above_zero = array(positive=True), number(above=0.0)
per_mode = positive.but("one number")
partly = per_mode.but("with NaN")
small = per_mode.but(percent=np.array([2.0, 2.0]))  # for 0.02
chosen = names.but("one less")
relative = per_mode.but("a word", "one less", empty="")
fraction = number(low=0.0).but(above_one=1.1)
ordered = array().but(swapped=lambda v: v[..., ::-1])
shown = number().but("NaN", "infinite")  # as it is: a dash would do as well
limits = ordered.but("infinite", "masked", "integers")
rising = positive.but("one less", falling=[9.0, 3.0])
unchecked = chosen.but("one twice", "one empty", "numbers")
scattered = array(positive=True, shaped=False)
listed = array().but("with NaN", "infinite")
steps = array(True, False).but("[]", "empty")  # of as many parameters as a run has
counted = whole().but("True", "low")
labels = anything.but("[]", "{'x': None}")
axes = by_name(labels, known=False).but("numbered")
many = array().but("one less")  # draws or shapes
probabilities = array().but("infinite", above_one=[1.1, 1.0])
stiffness = by_name(array(), known=False).but("numbered", "in it infinite")
noise = array(shaped=False).but(negative=[-0.1, 2.0])
matrix = array().but(asymmetric=[[1.0, 0.5], [0.0, 1.0]], oblong=np.ones((2, 3)))
records = by_name(anything, every=True, known=False)
named = records.but("numbered")
covariance = per_mode.but("zero", "0", asymmetric=[[1.0, 0.5], [0.0, 1.0]])
covariance = covariance.but(indefinite=[[1.0, 2.0], [2.0, 1.0]])
ladder = array(shaped=False).but("integers", rising=[0.0, 1.0], low=[0.5, 0.0])
by_test = by_name(number(), known=False).but("numbered")
spring = anything.but(float=(0.0, 1, 1.0), missing=(0, 9, 1.0), itself=(1, 1, 1.0))
spring = spring.but(two=(0, 1), negative=(0, 1, -1.0), nan=(0, 1, np.nan))
bars = anything.but(float=[(0.0, 1, "bar")], missing=[(0, 9, "bar")], two=[(0, 1)])
bars = bars.but(itself=[*BARS, (1, 1, "bar")], unknown=[(0, 1, "rod")])
loads = anything.but(
    "[]", missing=[(9, 1.0)], nan=[(1, np.nan)], far=[(1, 1.0, (1, 2))]
)
loads = loads.but(negative=[(1, 1.0, None, (0, 0, -1.0))], one=[(1,)], word=[(1, "")])
joints = anything.but(
    "[]", missing=[(9, None, {"ux": 1.0})], itself=[(1, 1, {"ux": 1.0})]
)
joints = joints.but(unknown=[(1, None, {"x": 1.0})], zero=[(1, None, {"ux": 0.0})])
KINDS = [  # of arguments, by their names; None is valid where it is the default
    (whole(), {"discard": 0, "seed": 1, "skip": 0}),
    (whole(1), {"nwalkers": 8, "steps": 9, "ensembles": 2, "thin": 1, "thin_by": 1}),
    (whole(1), {"max_solves": 20, "n_modes": 2, "test_points": 4, "components": 1}),
    (whole(1), {"pairs": 2, "chunksize": 2}),
    (whole(2), {"nsplits": 2, "candidates": 3}),
    (flag, {"correlated": True, "live_dangerously": False, "progress": False}),
    (flag, {"randomize_split": True, "resume": False, "vectorize": False}),
    (flag, {"shapes": False}),
    (above_zero, {"df": 8.0, "tolerance": 1e-4, "beta": 10.0}),
    (above_zero.but("a word", "numeral", empty=""), BAR),
    (above_zero.but(one=1.0), {"probability": 0.95}),
    (fraction, {"max_failures": 0.1, "min_mac": 0.5, "mode_jump": 0.1}),
    (chosen, {"var_names": ["k1", "k2"]}),
    (number(low=0.0), {"min_gap": 0.02, "gamma0": 0.5, "probe_tolerance": 1e-6}),
    (number().but(above_high=9.0), {"low": 1.0}),
    (number().but(below_low=0.0), {"high": 5.0}),
    (records.but("one less"), {"experiments": {"empty": (MODEL, TERM)}}),
    (axes, {"coords": {"point": [1, 2]}}),
    (flag.but("of NumPy"), {"stored": False}),
    (anything.but("a word"), {"unit": "m"}),
    (text, {"name": "frequency", "discrepancy": "sigma"}),
    (file, {"path": None, "backend": None}),
    (names, {"names": ["k1", "k2"], "sensors": ["roof", "two", "one"]}),
    (wholes, {"modes": [1, 2]}),
    (wholes.but("numerals"), {"dofs": [7, 1, 3]}),
    (array(), {"mean": POINT, "means": DRAWS[:2], "nodes": NODES}),
    (array().but(zero=0 * UP), {"orientation": UP}),
    (many.but(few=DRAWS[:2]), {"samples": DRAWS}),
    (array().but(outside=99.0 * START), {"starts": START}),
    (partly, {"damping_sd": SD}),
    (probabilities, {"phase_collinearity": np.array([0.95, 1.0])}),
    (ladder, {"betas": np.array([1.0, 0.3, 0.0])}),
    (noise, {"sigma": SD}),
    (positive, {"masses": POINT, "measured": HERTZ, "weights": np.array([0.3, 0.7])}),
    (positive, {"shape_sd": np.ones((3, 2))}),
    (positive.but(falling=[9.0, 3.0]), {"frequencies": HERTZ}),
    (positive.but("0"), {"scale_matrices": np.stack([COV, 2 * COV])}),
    (per_mode, {"sd": SD}),
    (small, {"relative_sd": SD}),
    (relative, {"delta": SD}),
    (covariance, {"cov": COV, "covariance": COV, "metric": COV}),
    (matrix, {"K0": K0, "M0": M0}),
    (by_name(matrix, known=False), {"K": {"k2": K2}, "M": {"m": M0}}),
    (ordered.but("infinite"), {"bounds": PRIOR.bounds}),
    (bars, {"elements": BARS}),
    (by_name(spring, known=False), {"springs": SPRINGS}),
    (anything.but(node={9: "all"}, dof={0: ["u"]}), {"supports": {0: "all"}}),
    (records, {"sections": {"bar": ef.Section(**BAR)}, "marginals": {"k1": NORMAL}}),
    (by_name(shown), {"nominal": {"k1": 10.0}}),
    (by_name(by_name(shown), known=False), {"published": {"a": {"k1": 9.0}}}),
    (by_name(array()), {"reference": {"k1": POINT}}),
    (by_name(number()), {"truths": {"k1": 10.0}}),
    (by_name(anything.but("a word")), {"units": {"k1": "N/m"}}),
    (anything.but(negative=[(ef.DEMCMove(), -1)]), {"moves": [(ef.DEMCMove(), 1.0)]}),
    (anything, {"inner": ef.DEMCMove(), "cheap": len, "function": lambda p: HERTZ}),
    (anything, {"idata": IDATA, "posterior": POSTERIOR, "source": RUN}),
    (anything, {"model": MODEL, "terms": [TERM], "prior": PRIOR}),
    (anything, {"measurements": MEASURED, "result": RESULT, "comparison": None}),
    (anything, {"executor": ThreadPoolExecutor(1), "pool": None}),
    (anything, {"on_failure": "raise", "experiment": None}),
]
ARGUMENTS = {name: (v, kind) for kind, given in KINDS for name, v in given.items()}
TIED = {
    "frequencies": "shapes covariance",
    "damping": "damping_sd",
    "shapes": "shape_sd",
    "masses": "springs",
}
TIED |= {
    "measured": "sd beta covariance",
    "parameters": "k1",
    "dofs": "coords",
    "changes": "at:",
    "names": "hyperpriors:",
    "marginals": "bounds:",
    "source": "samplers: backend:",
}
EMPTY = inspect.Parameter.empty
OFF = None, None  # left out: it excludes another, or is thrown elsewhere


def only(name, **thrown):
    """Return what is thrown at, with the other optional arguments left out."""
    own = inspect.signature(getattr(ef, name)).parameters
    optional = [key for key, parameter in own.items() if parameter.default is not EMPTY]
    return dict.fromkeys(optional, OFF) | thrown


# By name, perhaps with a variant: the arguments that are unlike those of ARGUMENTS.
CALLS = {
    "Measurements": dict(
        shapes=(SHAPES, array().but("with NaN")),
        covariance=OFF,
        damping=(SD, partly),
        sd=(SD, partly),
    ),
    "Measurements, covariance": only("Measurements", covariance=(COV, covariance)),
    "Measurements.from_repeats": dict(
        frequencies=(REPEATS, positive.but("one less")),
        shapes=(TESTS, array().but("complex")),
    ),
    "Measurements.from_uff": dict(sensors=OFF, dofs=OFF, modes=OFF),
    "Measurements.from_uff, sensors": dict(path=OFF, sensors=(LABELS[:3], chosen)),
    "Measurements.from_pyoma2": dict(shape_sd=(False, flag)),
    "Measurements.to_csv": {},
    "MassSpringModel called": dict(parameters=({"k1": SD, "k2": HERTZ}, stiffness)),
    "FrameModel": dict(n_modes=OFF, masses=OFF, springs=OFF),
    "FrameModel, n_modes": dict(modes=OFF, masses=OFF, springs=OFF),
    "FrameModel, masses": dict(
        n_modes=OFF,
        masses=([(1, 0.3, (0.0, 0.0, 0.1), (1e-4, 0.0, 0.0))], loads),
        springs=([(1, None, {"uy": 9.0, "rz": 0.5})], joints),
    ),
    "MatrixModel": dict(shapes=([0, 1], wholes.but("True"))),
    "AssembledModel": dict(
        assemble=(lambda p: (K0 + K2, M0), anything),
        names=(["k2"], labels.but("one less", "another")),
        shapes=([0, 1], wholes),
    ),
    "MatrixModel.from_differences": dict(
        base=((K0, M0), anything),
        changes=({"k2": {2.0: K0 + K2, 3.0: K0 + 2 * K2}}, named),
        at=({"k2": 1.0}, by_name(number())),
        shapes=([0, 1], wholes.but("True")),
    ),
    "read_matrices": dict(path=(BLOCK, file)),
    "from_opensees": dict(ops=(OPS, anything)),
    "from_pynite": dict(
        model=(FREE, anything),
        mass_combo_name=("mass", text),
        mass_direction=("Y", anything),
        gravity=(9.81, above_zero),
    ),
    "from_skfem": dict(
        basis=(BASIS, anything),
        K=(K0, matrix),
        M=(M0, matrix),
        held=([1], wholes.but("[]", "one twice")),
    ),
    "StaticModel": dict(
        loads=({"pull": np.array([1.0, 0.5])}, by_name(array(), known=False)),
        points=([1, 0], wholes.but("True")),
    ),
    "DisplacementTerm": dict(
        measured=(SHAPES.T, many),
        sd=(SQUARES.T, scattered),
        relative_sd=OFF,
        cases=(["pull", "push"], unchecked),
        points=(["a", "b", "c"], unchecked),
    ),
    "DisplacementTerm, relative_sd": only(
        "DisplacementTerm",
        measured=(SHAPES.T, many),
        relative_sd=(SQUARES.T / 30, scattered.but(percent=9 + SQUARES.T)),
    ),
    "FRFMeasurements": dict(
        values=(FRF, array().but("complex", "0")),
        coherence=(0.1 * SQUARES[:2], per_mode.but("one number")),
        averages=(9, whole(2)),
        channels=(PAIRS, labels.but("a word", "one less")),
        lines=(HERTZ, rising.but("zero")),
        kind=("mobility", anything),
        unit=("m/N", anything.but("a word")),
    ),
    "FRFMeasurements.from_uff": dict(
        path=(FRF_FILE, file),
        averages=(9, whole(2)),
        between=((1.0, 3.0), anything.but(above=(5.0, 6.0), one=(1.0,))),
        kind=("accelerance", anything.but(unlike="mobility")),
    ),
    "FRFTerm": dict(
        measured=(SHAKEN.terms[0].measured, anything),
        sd=(SQUARES[:2], scattered),
        amplitude=(False, flag),
    ),
    "FRFModel": dict(
        model=(SHAKEN.model.model, anything),
        lines=(HERTZ, rising),
        channels=(PAIRS, labels.but("a word")),
        damping=(0.01, anything.but("a word", "1.5")),
        kind=("mobility", anything),
        residual=(False, flag),
        stored=(False, flag),
    ),
    "plot_frf": dict(posterior=(SHAKEN, anything), idata=(SHAKEN_IDATA, anything)),
    "FunctionModel": dict(variables=OFF),
    "FunctionModel, jacobian": dict(
        variables=OFF, jacobian=(abs, anything.but("None"))
    ),
    "FunctionModel, variables": dict(n_modes=OFF, variables=(VARIABLES, named)),
    "modal_variables": dict(n_modes=(2, counted), dofs=([1], labels)),
    "PairedModel": dict(
        model=(ef.FunctionModel(lambda p: MODES, n_modes=4), anything), reference=OFF
    ),
    "PairedModel, reference": dict(
        model=(
            lambda p: ef.ModalSolution(np.ones((1, 4)), np.eye(3, 4)[None]),
            anything,
        ),
        measurements=(HERTZ, positive.but("one less")),
        reference=({"k1": 9.0}, by_name(number(), known=False)),
    ),
    "IndependentPrior": dict(bounds=({"k1": np.array([0.0, 9.0])}, by_name(limits))),
    "reduce_model": dict(
        model=(ef.MatrixModel(K0, M0, {"k2": K2}, n_modes=1), anything),
        bounds=({"k2": np.array([3.0, 5.0])}, by_name(ordered, every=True)),
    ),
    "FrequencyTerm": dict(relative_sd=OFF, beta=OFF, covariance=OFF),
    "FrequencyTerm, relative_sd": only("FrequencyTerm", relative_sd=(SD / 4, small)),
    "FrequencyTerm, beta": only("FrequencyTerm", beta=(SD, per_mode)),
    "FrequencyTerm, covariance": only("FrequencyTerm", covariance=(COV, covariance)),
    "ShapeTerm": only(
        "ShapeTerm", measured=(SHAPES, array().but("with NaN")), sd=(SQUARES, per_mode)
    ),
    "ShapeTerm, delta": only(
        "ShapeTerm", measured=(SHAPES, many.but("with NaN")), delta=(SD, relative)
    ),
    "ShapeTerm, discrepancy": dict(
        measured=(SHAPES, many.but("with NaN")), sd=OFF, delta=OFF
    ),
    "LogPosterior called": dict(theta=(POINT, array().but("infinite", "with NaN"))),
    "LogPosterior.start": dict(seed=(1, anything.but("None", "True", "[]"))),
    "compare_moves": dict(
        moves=(MOVES, records.but("one less")),
        ensembles=(2, whole(2)),
        max_evaluations=OFF,
    ),
    "compare_moves, max_evaluations": only(
        "compare_moves",
        moves=(MOVES, anything),
        max_evaluations=(1_000, whole(128)),
    ),
    "MetropolisMove, sd": dict(cov=OFF, sd=(SD, steps)),
    "MetropolisMove, cov": dict(sd=OFF, cov=(COV, covariance.but("[]"))),
    "DelayedAcceptanceMove": dict(steps=(2, whole(1))),
    "HamiltonianMove": dict(steps=(2, whole(1)), step_size=(0.2, above_zero)),
    "HamiltonianMove.tuned": dict(samples=(POSTERIOR.start(8, 1), many)),
    "run": dict(workers=OFF),
    "find_map": dict(workers=OFF, starts=(2, whole(1)), check=(30, whole())),
    "find_map, starts": only(
        "find_map", starts=(START[0], array().but("one less", outside=99.0 * START[0]))
    ),
    "anneal": dict(workers=OFF, size=(40, whole(40))),
    "certify": dict(workers=OFF, solves=(10, whole(10))),
    "emulate": dict(
        workers=OFF,
        cheap=OFF,
        solves=(10, whole(10)),
        derivatives=(False, flag),
        tolerance=(0.1, number(low=0.0)),
        starts=(START[0], array().but("one less", outside=99.0 * START[0])),
    ),
    "run, workers": only(
        "run",
        workers=(1, whole(1)),
        moves=(ef.DEMCMove(), anything),
        steps=(9, whole(1)),
    ),
    "find_map, workers": only("find_map", workers=(1, whole(1))),
    "anneal, workers": only("anneal", workers=(1, whole(1)), size=(40, whole(40))),
    "certify, workers": only("certify", workers=(1, whole(1))),
    "emulate, workers": only("emulate", workers=(1, whole(1))),
    "emulate, cheap": only(
        "emulate",
        posterior=(JOINT, anything),
        cheap=(["loaded"], chosen.but("one twice")),
    ),
    "to_inference_data": dict(names=OFF),
    "to_inference_data, names": only(
        "to_inference_data", source=(PLAIN, anything), names=(["k1", "k2"], names)
    ),
    "log_evidence": dict(source=(TEMPERED, anything)),
    "compare_models": dict(
        models=(CLASSES, records),
        prior=({"a": 1.0, "b": 2.0}, by_name(number(above=0.0), every=True)),
    ),
    "NormalPopulation": dict(
        names=(["k1", "k2"], chosen.but("one more")),
        covariates=({"T": BY_TEST}, by_name(by_test, known=False)),
        hyperpriors=({"sd k1": stats.halfnorm()}, by_name(anything)),
    ),
    "pool_tests": dict(
        tests=(TWO_TESTS, records),
        population=(POPULATION, anything),
        draws=(100, whole(100)),
        posteriors=({"a": POSTERIOR}, by_name(anything)),
    ),
    "Geometry": dict(
        nodes=({0: (0.0, 0.0), 1: (0.0, 3.0)}, anything),
        lines=([(0, 1)], anything.but("[]")),
        sensors=({0: (1, "ux"), 1: (1, "uy")}, anything),
        supports=([0], anything.but("[]")),
    ),
    "report": dict(
        path=(Path(tempfile.mkdtemp(), "report.html"), file), title=("Tower", text)
    ),
    "plot_scatter": dict(ellipse=(False, flag)),
    "plot_prior_posterior": {},
    "plot_mac": dict(idata=(PAIRED_RUN, anything), posterior=(None, anything)),
    "plot_shapes": dict(
        idata=(PAIRED_RUN, anything),
        posterior=(None, anything),
        geometry=(COLUMN, anything),
        modes=([1, 2], wholes),
    ),
    "plot_population": dict(pooled=(POOLED, anything), against=("T", anything)),
    "plot_model_comparison": dict(comparison=(ef.compare_models(CLASSES), anything)),
    "frequency_table": dict(published=({"a": HERTZ}, by_name(listed, known=False))),
}
COSTLY = (
    "emulate",
    "pool_tests",
    "compare_moves",
    "report",
)  # of which no other way to write is tried
STAND_INS = {
    "Measurements.from_uff, sensors": read_universal,
    "Measurements.to_csv": MEASURED.to_csv,
    "MassSpringModel called": MODEL,
    "LogPosterior called": POSTERIOR,
    "LogPosterior.start": POSTERIOR.start,
    "reduce_model": lambda **given: ef.reduce_model(**given).tolerance,
    "paper.h_frame": lambda **given: ef.paper.h_frame(**given).modes,
}
ANY = defaultdict(lambda: np.array([0.1]))
PROBES = {  # what is compared, by the type of the result; otherwise its text
    ef.MassSpringModel: lambda model: model({}).frequencies,
    ef.MatrixModel: lambda model: model({"k2": HERTZ, "m": SD}).frequencies,
    ef.FrameModel: lambda model: model({}).frequencies,
    ef.StaticModel: lambda model: model({"k2": SD})["displacement"],
    ef.Section: lambda section: np.array([getattr(section, key) for key in BAR]),
    ef.FrequencyTerm: lambda term: term(ANY, MODES),
    ef.ShapeTerm: lambda term: term(ANY, MODES),
    ef.DisplacementTerm: lambda term: term(ANY, {"displacement": SHAPES.T[None]}),
    ef.IndependentPrior: lambda prior: prior.bounds,
    type(stats.norm()): lambda law: law.args,
    ef.GaussianPrior: lambda prior: prior.logpdf(POINT[None]),
    ef.MetropolisMove: lambda move: move.cov if move.sd is None else move.sd,
    ef.moves.HamiltonianMove: repr,
    ef.IndependenceMove: lambda move: move.log_density(DRAWS),
    ef.moves.TemperedMove: lambda move: move.betas,
    ef.ModalSolution: lambda modes: modes.frequencies,
    ef.paper.Problem: lambda problem: problem.measured,
    ef.EvaluationPool: type,
    ef.FunctionModel: type,
    Figure: plt.close,
    np.ndarray: lambda array: array,
    list: lambda samplers: samplers[0].get_chain(),
}
# The package makes them, and users read them.
RECORDS = "ModalSolution", "PairedSolution", "ReducedModel", "EmulatedModel"
RECORDS += "Matrices", "Published", "Problem"


def find_public():
    """Return functions, classes and class methods that users call, by name."""
    found = {}
    for name, value in public_names().items():
        if not name.startswith("paper."):
            name = name.rpartition(".")[2]
        if name.rpartition(".")[2].startswith(RECORDS):
            continue
        found[name] = value
        for key, method in vars(value).items() if inspect.isclass(value) else ():
            if isinstance(method, classmethod):
                found[f"{name}.{key}"] = getattr(value, key)
    return found


PUBLIC = find_public()


def describe(name):
    """Return what is called, and a valid value and kind of each argument thrown at."""
    public = PUBLIC.get(name.split(",")[0], STAND_INS.get(name))
    given = {}
    for key, parameter in inspect.signature(public).parameters.items():
        value, kind = CALLS.get(name, {}).get(key) or ARGUMENTS.get(key, OFF)
        if kind is not None:
            given[key] = value, kind.but("None") if parameter.default is None else kind
    return STAND_INS.get(name, public), given


VARIED = {name.split(",")[0] for name in CALLS}
CASES = {k: describe(k) for k in (*CALLS, *(k for k in PUBLIC if k not in VARIED))}


def test_no_public_name_and_no_argument_is_left_out():
    thrown = defaultdict(set)
    for name, (_, given) in CASES.items():
        thrown[name.split(",")[0]] |= {*given}
    own = {name: {*inspect.signature(v).parameters} for name, v in PUBLIC.items()}
    assert {k: v - thrown[k] for k, v in own.items() if v - thrown[k]} == {}


@pytest.mark.filterwarnings("ignore:the reduction does not pay")
@pytest.mark.parametrize(
    ("name", "argument"), [(k, a) for k, (_, given) in CASES.items() for a in given]
)
def test_mistakes_are_refused_by_the_name_of_the_argument(name, argument):
    if name.endswith("from_uff"):
        pytest.importorskip("pyuff", reason='pip install "emcee_femu[uff]"')
    call, given = CASES[name]
    valid = {key: value for key, (value, _) in given.items()}

    def probe(**values):
        result = call(**values)
        return PROBES.get(type(result), str)(result)

    kind, tied = given[argument][1], TIED.get(argument, "")
    if name.startswith(COSTLY):
        kind = Kind(kind.wrong)
    assert find_faults(probe, valid, argument, kind, tied) == []
