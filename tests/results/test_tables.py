import numpy as np
import pytest
from matplotlib import pyplot as plt
from numpy.testing import assert_allclose, assert_array_equal
from support.chains import dataset, wrap

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


POSTERIOR = ef.LogPosterior(
    Square(),
    [lambda p, modes: 0 * p["stiff"], ef.FrequencyTerm(MEASURED, beta=1e3)],
    ef.GaussianPrior(NAMES, INITIAL, 0.1, [(0.1, 9.0)] * 2),
)


@pytest.fixture(scope="module")
def idata():
    sampled = {"sample_dims": ["chain", "draw"]}
    draws = {name: (("chain", "draw"), values) for name, values in DRAWS.items()}
    predicted = {"frequency": (("chain", "draw", "mode"), FREQUENCY)}
    constants = {
        "initial": ("parameter", INITIAL),
        "prior_sd": ("parameter", PRIOR_SD),
        "initial_frequency": ("mode", INITIAL_HZ),
    }
    modes = {"mode": [1, 2, 3]}
    return wrap(
        {
            "posterior": {"data_vars": draws, "attrs": sampled},
            "response": {"data_vars": predicted, "coords": modes, "attrs": sampled},
            "observed_data": {
                "data_vars": {"frequency": ("mode", MEASURED)},
                "coords": {"mode": [1, 2]},
            },
            "constant_data": {
                "data_vars": constants,
                "coords": {"parameter": NAMES, **modes},
            },
        }
    )


def tae(*args, **options):
    """Return the curve of the figure of total average errors."""
    figure = ef.figures.plot_tae(*args, **options)
    plt.close(figure)
    return figure.axes[0].get_lines()[0].get_data()


SPREAD = np.array(  # sqrt(sum of squared deviations / 5)
    [np.sqrt((0 + 0.04 * 3 + 0.16 + 0.36) / 5), np.sqrt((0.09 + 0.04 * 2 + 0.01) / 5)]
)


def test_parameter_table_equals_numbers_by_hand(idata):
    table = ef.parameter_table(idata)
    titles = "parameter,prior mean,mean,2.5 %,97.5 %,c.o.v. %,sd/prior sd"
    assert table.columns == tuple(titles.split(","))
    assert table.column("parameter") == NAMES
    assert table.column("prior mean") == INITIAL
    # Sorted, 0.4 0.8 1.0 1.2 1.2 1.4 and 1.0 1.2 1.3 1.3 1.5 1.5: an eighth of a step.
    assert_allclose(table.column("2.5 %"), [0.45, 1.025], rtol=1e-12)
    assert_allclose(table.column("97.5 %"), [1.375, 1.5], rtol=1e-12)
    assert_allclose(table.column("mean"), [1.0, 1.3], rtol=1e-12)
    assert_allclose(table.column("c.o.v. %"), 100 * SPREAD / [1.0, 1.3], rtol=1e-12)
    assert_allclose(table.column("sd/prior sd"), SPREAD / PRIOR_SD, rtol=1e-12)


def test_parameter_table_compares_with_nominal_and_published(idata):
    nominal = {"alpha": 1.25}  # the other is not known
    published = {"paper": {"alpha": 7.0, "stiff": 8.0}, "c.o.v.": {"stiff": 3.5}}
    table = ef.parameter_table(idata, nominal, published)
    titles = "parameter,prior mean,nominal,error %,mean,error % ,2.5 %,97.5 %,c.o.v. %,"
    assert table.columns == (*f"{titles}sd/prior sd".split(","), "paper", "c.o.v.")
    assert_allclose(table.column("nominal"), [np.nan, 1.25])
    assert_allclose(table.column("error %"), [np.nan, 4.0], rtol=1e-12)
    assert_allclose(table.column("mean"), [1.0, 1.3], rtol=1e-12)
    assert_allclose(table.column("error % "), [np.nan, 4.0], rtol=1e-12)
    assert_allclose(table.column("c.o.v. %"), 100 * SPREAD / [1.0, 1.3], rtol=1e-12)
    assert table.column("paper") == [8.0, 7.0]
    assert_array_equal(table.column("c.o.v."), [3.5, np.nan])


def test_derived_quantities_are_rows_only_if_asked_for():
    run = ef.run(POSTERIOR, ef.DEMCMove(), 8, 12, seed=1, ensembles=1)
    idata = ef.to_inference_data(run, POSTERIOR)
    before = ef.parameter_table(idata)
    group = dataset(idata, "posterior")
    ratio = group["alpha"] / group["stiff"]
    idata["posterior"]["ratio"] = ratio
    assert str(ef.parameter_table(idata)) == str(before)
    assert str(ef.diagnose(idata).table) == str(ef.diagnose(run).table)
    table = ef.parameter_table(idata, var_names=["ratio", "alpha"])
    assert table.column("parameter") == ["ratio", "alpha"]
    assert_allclose(table.column("mean")[0], ratio.mean(), rtol=1e-12)
    assert_array_equal(table.column("prior mean"), [np.nan, 1.2])
    with pytest.raises(ValueError, match="var_names: .*'sum'"):
        ef.parameter_table(idata, var_names=["sum"])


HEADER = "mode,measured Hz,prior mean Hz,error %,{} Hz,c.o.v. %,error % "
FREQUENCY_SD = np.sqrt([(2.25 + 0.25 + 0.25 + 1 + 0 + 6.25) / 5, 2.5 / 5])


@pytest.mark.parametrize(
    "posterior, what, updated, errors",
    [
        (None, "sample mean", [10.5, 27.0], [5.0, 8.0, 6.5]),
        (POSTERIOR, "posterior mean", [10.0, 26.0], [0.0, 4.0, 2.0]),
    ],
)
def test_frequency_table_equals_numbers_by_hand(
    idata, posterior, what, updated, errors
):
    published = {"Hz": (9.0, 24.0), "paper error %": (0.5, 0.7, 0.6)}
    table = ef.frequency_table(idata, posterior, published)
    assert table.columns[-2:] == ("Hz", "paper error %")
    assert_array_equal(table.column("Hz"), [9.0, 24.0, np.nan])
    assert table.column("paper error %") == [0.5, 0.7, 0.6]
    assert table.columns[:-2] == tuple(HEADER.format(what).split(","))
    assert table.column("mode") == ["1", "2", "TAE"]
    assert_array_equal(table.column("measured Hz"), [*MEASURED, np.nan])
    assert_array_equal(table.column("prior mean Hz"), [12.0, 22.0, np.nan])
    assert_allclose(table.column("error %"), [20, 12, 16], rtol=1e-12)
    assert_allclose(table.column(f"{what} Hz"), [*updated, np.nan], rtol=1e-12)
    expected = [*(100 * FREQUENCY_SD / updated), np.nan]
    assert_allclose(table.column("c.o.v. %"), expected, rtol=1e-12)
    assert_allclose(table.column("error % "), errors, rtol=1e-12, atol=1e-12)


def test_the_frequencies_of_one_experiment_of_a_joint_posterior():
    first, second = Square(), ef.FunctionModel(lambda p: [3 * p["alpha"]], n_modes=1)
    joint = ef.LogPosterior.joint(
        {
            "empty": (first, ef.FrequencyTerm(MEASURED, beta=1e3)),
            "loaded": (second, ef.FrequencyTerm([4.0], beta=1e3)),
        },
        POSTERIOR.prior,
    )
    idata = ef.to_inference_data(
        ef.run(joint, ef.DEMCMove(), 8, 6, seed=1, ensembles=1), joint
    )
    stiff, alpha = ef.parameter_table(idata).column("mean")
    for name, expected, at_prior in (
        ("empty", [10 * stiff**2, 20 * alpha], [12.1, 24.0]),
        ("loaded", [3 * alpha], [3.6]),
    ):
        table = ef.frequency_table(idata, joint, experiment=name)
        assert table.title == f"Natural frequencies of '{name}'"
        assert_allclose(table.column("prior mean Hz")[:-1], at_prior, rtol=1e-12)
        assert_allclose(table.column("posterior mean Hz")[:-1], expected, rtol=1e-9)
        last = tae(idata, joint, experiment=name)[1][-1]
        assert_allclose(table.column("error % ")[-1], last, rtol=1e-9)
    with pytest.raises(ValueError, match=r"has measured .frequency.*loaded.freq.*exp"):
        ef.frequency_table(idata, joint)


def test_running_tae_equals_a_computation_by_hand(idata):
    generations, errors = tae(idata, POSTERIOR)
    assert_array_equal(generations, [1, 2, 3])
    # 10 * mean**2 against 10 and 20 * mean against 25, in percent
    assert_allclose(errors, [(21 + 12) / 2, (44 + 0) / 2, (0 + 4) / 2], rtol=1e-12)
    assert_allclose(
        errors[-1], ef.frequency_table(idata, POSTERIOR).column("error % ")[-1]
    )


def test_measured_data_are_needed_for_an_error():
    bare = ef.LogPosterior(Square(), POSTERIOR.terms[0], POSTERIOR.prior)
    unmeasured = ef.run(bare, ef.DEMCMove(), 8, 4, seed=1, ensembles=1)
    with pytest.raises(ValueError, match=r"no term has measured .* are \[\]$"):
        ef.frequency_table(unmeasured)
    with pytest.raises(ValueError, match="no likelihood term says what it measured"):
        ef.predictive_table(unmeasured)
