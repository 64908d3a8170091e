"""Tables of parameters and frequencies by hand, and units wherever values are seen."""

import numpy as np
import pytest
import xarray
from numpy.testing import assert_allclose, assert_array_equal
from support.chains import by_hand, dataset

import emcee_femu as ef

NAMES = ["stiff", "alpha"]  # not in alphabetical order
DRAWS = {  # 2 chains of 3 draws
    "stiff": [[1.0, 1.2, 0.8], [1.2, 1.4, 0.4]],  # running means 1.1, 1.2, 1.0
    "alpha": [[1.0, 1.3, 1.5], [1.2, 1.5, 1.3]],  # running means 1.1, 1.25, 1.3
}
FREQUENCY = np.array(  # three modes, two of them measured
    [
        [[9.0, 26.0, 1.0], [10.0, 27.0, 2.0], [11.0, 28.0, 3.0]],
        [[9.5, 26.5, 4.0], [10.5, 27.5, 5.0], [13.0, 27.0, 6.0]],
    ]
)
MEASURED = [10.0, 25.0]
INITIAL, PRIOR_SD, INITIAL_HZ = [1.1, 1.2], [0.5, 0.8], [12.0, 22.0, 7.0]


class Square:
    variables = ef.modal_variables(3)

    def __call__(self, p):
        rows = np.stack([10 * p["stiff"] ** 2, 20 * p["alpha"], 90 + p["stiff"]], 1)
        return ef.ModalSolution(rows)


PRIOR = ef.GaussianPrior(NAMES, INITIAL, 0.1, [(0.1, 9.0)] * 2)
TERM = ef.FrequencyTerm(MEASURED, beta=1e3)
TERMS = [lambda p, modes: 0 * p["stiff"], TERM]
POSTERIOR = ef.LogPosterior(Square(), TERMS, PRIOR, units={"stiff": "N/m"})


@pytest.fixture(scope="module")
def idata():
    """Return what to_inference_data would, of draws by hand."""
    constants = {"initial": INITIAL, "prior_sd": PRIOR_SD, "prior_mean": INITIAL}
    constants |= {"is_error": [False] * 2, "lower": [0.1] * 2, "upper": [9.0] * 2}
    constants["initial_frequency"] = "mode", INITIAL_HZ
    predicted, measured = {"frequency": FREQUENCY}, {"frequency": MEASURED}
    return by_hand(DRAWS, constants, measured, response=predicted)


@pytest.fixture(scope="module")
def run():
    return ef.run(POSTERIOR, ef.DEMCMove(), 8, 90, seed=1, ensembles=1)


def tae(*args, **options):
    """Return the curve of the figure of total average errors."""
    return ef.figures.plot_tae(*args, **options).axes[0].get_lines()[0].get_data()


SPREAD = np.array(  # sqrt(sum of squared deviations / 5)
    [np.sqrt((0 + 0.04 * 3 + 0.16 + 0.36) / 5), np.sqrt((0.09 + 0.04 * 2 + 0.01) / 5)]
)


def test_parameter_table_equals_numbers_by_hand(idata):
    true = {"alpha": 1.25}  # the other is not known
    published = {"paper": {"alpha": 7.0, "stiff": 8.0}, "c.o.v.": {"stiff": 3.5}}
    table = ef.parameter_table(idata, true, published)
    assert table.column("parameter") == NAMES and table.column("prior mean") == INITIAL
    # Sorted, 0.4 0.8 1.0 1.2 1.2 1.4 and 1.0 1.2 1.3 1.3 1.5 1.5: an eighth of a step.
    for title, values in (
        ("2.5 %", [0.45, 1.025]),
        ("97.5 %", [1.375, 1.5]),
        ("mean", [1.0, 1.3]),
        ("c.o.v. %", 100 * SPREAD / [1.0, 1.3]),
        ("sd/prior sd", SPREAD / PRIOR_SD),
        ("true", [np.nan, 1.25]),
        ("error %", [np.nan, 4.0]),
        ("error % ", [np.nan, 4.0]),
        ("paper", [8.0, 7.0]),
        ("c.o.v.", [3.5, np.nan]),
    ):
        assert_allclose(table.column(title), values, rtol=1e-12)
    plain = ef.parameter_table(idata).columns
    assert not {"true", "error %", "paper", "unit"} & {*plain}
    engineer = ef.parameter_table(idata, true, before={"alpha": 1.5})
    assert_allclose(engineer.column("before"), [np.nan, 1.5])
    assert_allclose(engineer.column("error %"), [np.nan, 20.0])
    assert "prior mean" not in engineer.columns


def test_what_is_published_is_printed_as_it_was_given():
    """A percentage has neither the unit of its row nor the digits of the row's sd."""

    def log_likelihood(x):
        return -0.5 * ((x[0] - 2.1e11) / 4e9) ** 2

    bounds, units = {"E": (1e11, 3e11)}, {"E": "Pa"}
    posterior = ef.LogPosterior.from_function(log_likelihood, bounds, units=units)
    run = ef.run(posterior, ef.DEMCMove(), 8, 40, seed=1, ensembles=1)
    published = {"paper": {"E": 2.0625e11}, "c.o.v. %": {"E": 1.03}}
    words = str(ef.parameter_table(run, published=published)).split()
    assert {"2.0625e+11", "1.03", "Pa"} < {*words} and "GPa" not in words
    assert "GPa" in str(ef.parameter_table(run)).split()


FREQUENCY_SD = np.sqrt([(2.25 + 0.25 + 0.25 + 1 + 0 + 6.25) / 5, 2.5 / 5])


@pytest.mark.parametrize(
    "posterior, what, updated, errors",
    [
        (None, "updated Hz", [10.5, 27.0], [5.0, 8.0, 6.5]),
        (POSTERIOR, "at mean parameters Hz", [10.0, 26.0], [0.0, 4.0, 2.0]),
    ],
)
def test_frequency_table_equals_numbers_by_hand(
    idata, posterior, what, updated, errors
):
    published = {"Hz": (9.0, 24.0), "paper error %": (0.5, 0.7, 0.6)}
    table = ef.frequency_table(idata, posterior, published)
    assert table.column("mode") == ["1", "2", "TAE"]
    for title, values in (
        ("Hz", [9.0, 24.0, np.nan]),
        ("paper error %", [0.5, 0.7, 0.6]),
        ("measured Hz", [*MEASURED, np.nan]),
        ("prior mean Hz", [12.0, 22.0, np.nan]),
        ("error %", [20, 12, 16]),
        (what, [*updated, np.nan]),
        ("c.o.v. %", [*(100 * FREQUENCY_SD / [10.5, 27.0]), np.nan]),
        ("error % " if posterior is None else "error %  ", errors),
    ):
        assert_allclose(table.column(title), values, rtol=1e-12, atol=1e-12)


def test_running_tae_equals_a_computation_by_hand(idata):
    generations, errors = tae(idata, POSTERIOR)
    assert_array_equal(generations, [1, 2, 3])
    # 10 * mean**2 against 10 and 20 * mean against 25, in percent
    assert_allclose(errors, [(21 + 12) / 2, (44 + 0) / 2, (0 + 4) / 2], rtol=1e-12)


def test_derived_quantities_are_rows_only_if_asked_for_with_their_own_units(run):
    idata = ef.to_inference_data(run, POSTERIOR)
    before, group = ef.parameter_table(idata), dataset(idata, "posterior")
    assert before.column("unit") == ["N/m", ""]
    ratio = group["alpha"] / group["stiff"]
    idata["posterior"]["ratio"] = ratio.assign_attrs(units="m/N")
    with xarray.set_options(keep_attrs=True):  # which hands on "N/m", that it is not
        idata["posterior"]["fall"] = 100 * (1 - group["stiff"] / 9.0)
    assert str(ef.parameter_table(idata)) == str(before)
    assert str(ef.diagnose(idata).table) == str(ef.diagnose(run).table)
    table = ef.parameter_table(idata, var_names=["ratio", "alpha", "fall"])
    assert table.column("parameter") == ["ratio", "alpha", "fall"]
    assert table.column("unit") == ["m/N", "", ""]
    assert_allclose(table.column("mean")[0], ratio.mean(), rtol=1e-12)
    assert_array_equal(table.column("prior mean"), [np.nan, 1.2, np.nan])
    with pytest.raises(ValueError, match="^var_names: .*'sum'"):
        ef.parameter_table(idata, var_names=["sum"])


def test_the_frequencies_of_one_experiment_of_a_joint_posterior():
    loaded = ef.FunctionModel(lambda p: [3 * p["alpha"]], n_modes=1)
    of_loaded = ef.FrequencyTerm([4.0], beta=1e3)
    tests = {"empty": (Square(), TERM), "loaded": (loaded, of_loaded)}
    joint = ef.LogPosterior.joint(tests, PRIOR)
    run = ef.run(joint, ef.DEMCMove(), 8, 6, seed=1, ensembles=1)
    stiff, alpha = ef.parameter_table(run).column("mean")
    for name, expected, at_prior in (
        ("empty", [10 * stiff**2, 20 * alpha], [12.1, 24.0]),
        ("loaded", [3 * alpha], [3.6]),
    ):
        table = ef.frequency_table(run, joint, experiment=name)
        assert name in table.title
        assert_allclose(table.column("prior mean Hz")[:-1], at_prior, rtol=1e-12)
        assert_allclose(table.column("at mean parameters Hz")[:-1], expected, rtol=1e-9)
        last = tae(run, experiment=name)[1][-1]
        assert_allclose(table.column("error %  ")[-1], last, rtol=1e-9)
    every = ef.frequency_table(run, joint)
    labels = ["empty, 1", "empty, 2", "empty, TAE", "loaded, 1", "loaded, TAE"]
    assert every.column("mode") == labels
    parts = [ef.frequency_table(run, joint, experiment=name) for name in tests]
    for title in parts[0].columns[1:]:
        column = [cell for part in parts for cell in part.column(title)]
        assert_array_equal(every.column(title), column)
    with pytest.raises(ValueError, match="published: .*loaded"):
        ef.frequency_table(run, published={"a": [1.0]})
    curves = [tae(run, experiment=name)[1] for name in tests]
    (axes,) = ef.figures.plot_tae(run).axes
    for name, curve, line in zip(tests, curves, axes.lines, strict=True):
        assert line.get_label() == name
        assert_allclose(line.get_ydata(), curve, rtol=1e-12)


def test_measured_data_are_needed_for_an_error():
    bare = ef.LogPosterior(Square(), TERMS[0], PRIOR)
    unmeasured = ef.run(bare, ef.DEMCMove(), 8, 4, seed=1, ensembles=1)
    for table in (ef.frequency_table, ef.predictive_table):
        with pytest.raises(ValueError, match="measured"):
            table(unmeasured)


def test_units_outlive_what_is_made_of_a_posterior(run, tmp_path):
    joint = ef.LogPosterior.joint({"empty": (Square(), TERMS)}, PRIOR, {"alpha": "kg"})
    assert joint.with_models(lambda model: model).units == {"alpha": "kg"}
    certificate = ef.certify(ef.to_inference_data(run), POSTERIOR, solves=60, seed=1)
    assert ef.parameter_table(certificate.idata).column("unit") == ["N/m", ""]
    # A run goes on after units were added.
    without, file = ef.LogPosterior(Square(), TERMS, PRIOR), tmp_path / "run.db"
    options = {"nwalkers": 8, "ensembles": 1, "seed": 1, "backend": file}
    ef.run(without, ef.DEMCMove(), steps=10, **options)
    again = ef.run(POSTERIOR, ef.DEMCMove(), steps=20, resume=True, **options)
    assert again[0].iteration == 20
