"""What a message advises works when it is followed."""

import numpy as np
import pytest
from scipy import io, sparse, stats

import emcee_femu as ef
from emcee_femu.sampling.arguments import check_starts, weigh_moves

K = np.array([[3.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 1.0]])
HELD = np.diag([1.0, 0.0, 1.0])
ZERO, M = np.zeros((3, 3)), np.eye(3)
F = [3.0, 9.0]
MODEL = ef.MassSpringModel([1.0, 1.0], {"k1": (0, 1, 5e2), "k2": (1, 2, 5e2)})
TERM = ef.FrequencyTerm(F, relative_sd=0.02)
MARGINALS = {"k1": stats.lognorm(0.2, scale=5e2), "k2": stats.lognorm(0.2, scale=5e2)}
PRIOR = ef.IndependentPrior(MARGINALS)
BOX = {"a": (-1.0, 1.0), "b": (-1.0, 1.0)}
PRIOR_ONLY = ef.LogPosterior.from_function(lambda x: 0.0, BOX)
POINTS = [[0, 0, 0], [1, 0, 0], [2, 0, 0]]
BARS = [(0, 1, "bar"), (1, 2, "bar")]
BAR = {"E": 2.0e11, "GJ": 1e5, "rho": 7800.0, "A": 1e-3, "Iy": 1e-6, "Iz": 1e-6}


def frame(supports, **options):
    sections = {"bar": ef.Section(**(BAR | {"E": (2.0e11, "E")}))}
    options = {"n_modes": 2} | options
    return ef.FrameModel(POINTS, BARS, sections, supports, **options)


def solved(model):
    return model({name: np.ones(1) for name in model.names}).frequencies


def matrices(K0, M0, K):
    return solved(ef.MatrixModel(K0, M0, {"k": K}, n_modes=1))


def paired(dofs):
    test = ef.Measurements(F, [[1.0, 0.5], [0.6, -1.0]], dofs=dofs)
    return ef.PairedModel(frame({0: "fixed"}, shapes=True), test, candidates=2)


KEPT = np.ix_([0, 2], [0, 2])
FREE = frame({0: "fixed"})
# A mistake; what its message must name; and what was advised.
CURES = {
    "one number": (
        lambda: MODEL({"k1": 5e2, "k2": 5e2}),
        r"parameters\['k1'\].*\[500\.0\]",
        lambda: MODEL({"k1": [500.0], "k2": [500.0]}),
    ),
    "order": (
        lambda: ef.LogPosterior(TERM, MODEL, PRIOR),
        r"FrequencyTerm.*LogPosterior\(model, terms, prior\)",
        lambda: ef.LogPosterior(MODEL, TERM, PRIOR),
    ),
    "order of the prior": (
        lambda: ef.LogPosterior(PRIOR, MODEL, TERM),
        r"FrequencyTerm.*LogPosterior\(model, terms, prior\)",
        lambda: ef.LogPosterior(MODEL, TERM, PRIOR),
    ),
    "no sum": (
        lambda: ef.LogPosterior.from_function(lambda x: -(x**2), BOX),
        r"log_likelihood: .*number.*shape \(2,\); sum it",
        lambda: ef.LogPosterior.from_function(lambda x: -(x**2).sum(), BOX),
    ),
    "names without bounds": (
        lambda: ef.LogPosterior.from_function(lambda x: -(x @ x), ["a", "b"]),
        r"prior: .*\{'a': \(low, high\), ...\}",
        lambda: ef.LogPosterior.from_function(lambda x: -(x @ x), BOX),
    ),
    "one weighted move": (
        lambda: weigh_moves((ef.DEMCMove(), 1.0)),
        r"moves: .*\[\(move, weight\)\]",
        lambda: weigh_moves([(ef.DEMCMove(), 1.0)]),
    ),
    "positions for moves": (
        lambda: weigh_moves(np.zeros((8, 2))),
        "moves: .*starts=",
        lambda: check_starts(np.eye(2), PRIOR_ONLY, 1, 2),
    ),
    "prior": (
        lambda: ef.LogPosterior(MODEL, TERM, MARGINALS),
        r"prior: .*IndependentPrior",
        lambda: ef.LogPosterior(MODEL, TERM, ef.IndependentPrior(MARGINALS)),
    ),
    "decimal comma": (
        lambda: ef.Measurements(["3,13", "9,8"]),
        r"frequencies: .*'3,13'.*decimal point",
        lambda: ef.Measurements([3.13, 9.8]),
    ),
    "not identified": (
        lambda: ef.Measurements([3.1, None, 9.8]),
        "frequencies: .*None; leave out",
        lambda: ef.Measurements([3.1, 9.8]),
    ),
    "one mode": (
        lambda: ef.Measurements([3.1], [1.0, 0.5]),
        r"np\.reshape\(shapes, \(-1, 1\)\)",
        lambda: ef.Measurements([3.1], np.reshape([1.0, 0.5], (-1, 1))),
    ),
    "no shape": (
        lambda: ef.Measurements(F, [[1.0, np.nan], [0.5, np.nan]]),
        "mode 2 .* leave the mode out",
        lambda: ef.Measurements(F[:1], [[1.0], [0.5]]),
    ),
    "scale": (
        lambda: ef.IndependentPrior({"k": stats.uniform(0.5, -1.0)}),
        r"marginals\['k'\]: .*loc to loc \+ scale",
        lambda: ef.IndependentPrior({"k": stats.uniform(0.5, 1.0)}),
    ),
    "triangle": (
        lambda: matrices(ZERO, M, np.triu(K)),
        r"K\['k'\]: .*triangle.*A \+ A\.T",
        lambda: matrices(ZERO, M, np.triu(K) + np.triu(K, 1).T),
    ),
    "sparse triangle": (
        lambda: matrices(sparse.csc_array((3, 3)), M, sparse.csc_array(np.tril(K))),
        r"K\['k'\]: .*triangle",
        lambda: matrices(sparse.csc_array((3, 3)), M, sparse.csc_array(K)),
    ),
    "unsymmetric": (
        lambda: matrices(ZERO, M, K + 1e-3 * np.eye(3, k=1)),
        r"0\.5 \* \(A \+ A\.T\)",
        lambda: matrices(ZERO, M, K + 0.5e-3 * (np.eye(3, k=1) + np.eye(3, k=-1))),
    ),
    "complex": (
        lambda: matrices(ZERO, M, K * (1 + 0.02j)),
        r"K\['k'\]: .*\.real",
        lambda: matrices(ZERO, M, (K * (1 + 0.02j)).real),
    ),
    "held rows": (
        lambda: matrices(ZERO, HELD, HELD),
        r"DOFs 1 have .*np\.ix_\(kept, kept\)",
        lambda: matrices(ZERO[KEPT], HELD[KEPT], np.ones((2, 2)) + HELD[KEPT]),
    ),
    "free": (
        lambda: solved(frame(None)),
        "mode 1 .*supports .*skip=6",
        lambda: solved(frame(None, skip=6)),
    ),
    "hinge": (
        lambda: solved(frame({0: "pinned"})),
        "mode 1 .*supports",
        lambda: solved(frame({0: "pinned", 2: ["uy", "uz", "rx"]})),
    ),
    "support": (
        lambda: frame({0: "clamped"}),
        r"supports\[0\]: .*'fixed'.*'clamped'",
        lambda: frame({0: "fixed"}),
    ),
    "supports": (
        lambda: frame([0]),
        "supports: .*{0: 'fixed'}",
        lambda: frame({0: "fixed"}),
    ),
    "property": (
        lambda: solved(ef.FrameModel(POINTS, BARS, {"bar": ef.Section(
            **(BAR | {"E": ("E", 2e11)}))}, {0: "fixed"}, n_modes=1)),
        r"E: .*\(number, name\), got \('E'",
        lambda: frame({0: "fixed"}),
    ),
    "bar twice": (
        lambda: ef.FrameModel(POINTS, [*BARS, (1, 0, "bar")], {"bar": ef.Section(
            **BAR)}, {0: "fixed"}, n_modes=1),
        r"elements\[2\]: .*elements\[0\] again",
        lambda: ef.FrameModel(POINTS, [*BARS, (1, 0, "wire")], {"bar": ef.Section(
            **BAR), "wire": ef.Section(**BAR)}, {0: "fixed"}, n_modes=1),
    ),
    "one case": (
        lambda: ef.DisplacementTerm([12.0, 3.0], relative_sd=0.01),
        r"measured: .*\[\[\.\.\]\]",
        lambda: ef.DisplacementTerm([[12.0, 3.0]], relative_sd=0.01),
    ),
    "places": (
        lambda: paired(None),
        r"dofs: .*Measurements\(dofs=",
        lambda: paired(["1:uy", "2:uy"]),
    ),
    "load case": (
        lambda: FREE.static({"2:uz": 5.0}),
        r"loads=\{'case': \{'2:uz': 5\.0\}\}",
        lambda: FREE.static({"case": {"2:uz": 5.0}}),
    ),
    "direction": (
        lambda: paired(["1:uy", "2:u30"]),
        r"'2:u30'.*\{'2:ux': 0\.87, '2:uy': 0\.5\}",
        lambda: paired(["1:uy", {"2:ux": 0.87, "2:uy": 0.5}]),
    ),
    "a letter too much": (
        lambda: paired(["1:uy", "2:uxx"]),
        "'2:uxx'.*did you mean '2:ux'",
        lambda: paired(["1:uy", "2:ux"]),
    ),
    "numbers for labels": (
        lambda: paired([1, 2]),
        "labels, such as '1:ux'",
        lambda: paired(["1:ux", "2:ux"]),
    ),
    "decibels": (
        lambda: ef.frf.FRFTerm(
            ef.frf.FRFMeasurements([1.0], [[-20.0]], [(0, 0)], kind="receptance"),
            amplitude=True, sd=0.1,
        ),
        r"10 \*\* \(values / 20\)",
        lambda: ef.frf.FRFTerm(
            ef.frf.FRFMeasurements([1.0], [[0.1]], [(0, 0)], kind="receptance"),
            amplitude=True, sd=0.1,
        ),
    ),
}  # fmt: skip


@pytest.mark.parametrize("mistake", CURES)
def test_the_cure_of_a_message_works(mistake):
    wrong, message, cured = CURES[mistake]
    with pytest.raises((TypeError, ValueError), match=message):
        wrong()
    assert cured() is not None


def test_damping_in_percent_is_doubted():
    modal = ef.MatrixModel(ZERO, M, {"k": K}, n_modes=2, shapes=True)
    with pytest.warns(UserWarning, match="damping: .*0.01"):
        ef.frf.FRFModel(modal, [1.0], [(0, 0)], damping=2.0)


@pytest.mark.parametrize(
    ("rows", "hertz", "sd"),
    [
        (["frequency [rad/s],,,6.283185307179586", "sd [Hz],,,0.02"], 1.0, 0.02),
        (["frequency [kHz],,,1.5", "sd [rad/s],,,6.283185307179586"], 1500.0, 1.0),
    ],
)
def test_frequencies_in_other_units_are_converted(rows, hertz, sd, tmp_path):
    path = tmp_path / "test.csv"
    path.write_text("\n".join(["quantity,sensor,dof,mode 1", *rows, ""]))
    test = ef.Measurements.from_csv(path)
    np.testing.assert_allclose([*test.frequencies, *test.sd], [hertz, sd])


def test_the_unit_of_an_sd_is_stated_beside_frequencies_in_another(tmp_path):
    path = tmp_path / "test.csv"
    path.write_text("quantity,sensor,dof,mode 1\nfrequency [rad/s],,,6.28\nsd,,,0.1\n")
    with pytest.raises(ValueError, match=r"'sd'.*'sd \[rad/s\]'"):
        ef.Measurements.from_csv(path)


def test_a_row_that_is_too_short_is_counted(tmp_path):
    path = tmp_path / "test.csv"
    path.write_text("quantity,sensor,dof,mode 1,mode 2\nfrequency [Hz],,,6.28\n")
    with pytest.raises(ValueError, match="line 2: 4 cells under 5 titles"):
        ef.Measurements.from_csv(path)


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ("frequency [Hz];;;03. Dez", "'03. Dez'.*dates"),
        ("frequency [Hz];;;1.234,5", r"'1\.234,5'.*thousands"),
        ("sd [%];;;1", "relative_sd"),
        ("damping ratio [rad/s];;;1", "damping ratio"),
    ],
)
def test_cells_of_spreadsheets_that_are_no_numbers(row, message, tmp_path):
    path = tmp_path / "test.csv"
    path.write_text(f"quantity;sensor;dof;mode 1\n{row}\n")
    with pytest.raises(ValueError, match=message):
        ef.Measurements.from_csv(path)


def test_a_modal_set_of_matlab_is_no_matrix(tmp_path):
    path = tmp_path / "model.mat"
    io.savemat(path, {"Phi": K[:, :2], "f": F})
    with pytest.raises(ValueError, match=r"\{'Phi': \(3, 2\).*Measurements\("):
        ef.read_matrices(path)


def test_a_last_line_without_an_end(tmp_path):
    path = tmp_path / "K.csv"
    text = "\n".join(";".join(f"{x:g}".replace(".", ",") for x in row) for row in K)
    path.write_text(text)
    with pytest.raises(ValueError, match="line 3: .*add a line break"):
        ef.read_matrices({"K": path, "M": path})
    path.write_text(text + "\n")
    read = ef.read_matrices({"K": path, "M": path})
    np.testing.assert_array_equal(read.matrices["K"].toarray(), K)
