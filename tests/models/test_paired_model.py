"""Modes are paired one-to-one by MAC, also where frequencies cross or coincide."""

import numpy as np
import pytest
from scipy import stats

import emcee_femu as ef
from emcee_femu import Measurements, ModalSolution, PairedModel, ShapeTerm
from emcee_femu.likelihoods.frequency import UNPAIRED
from emcee_femu.models.pairing import mac
from emcee_femu.results.arviz_objects import dataset


def random_shapes(seed, *shape):
    return np.random.default_rng(seed).normal(size=shape)


class Fixed:
    """A model that returns given modes, whatever the parameters."""

    def __init__(self, frequencies, shapes):
        self.solution = ModalSolution(np.asarray(frequencies), shapes)
        self.n_modes = self.solution.frequencies.shape[1]

    def __call__(self, parameters):
        return self.solution


def turned(angle):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s], [s, c]])


def test_modes_are_put_in_the_order_of_the_measured_ones():
    shapes = random_shapes(3, 1, 8, 6)
    frequencies = np.array([[1.0, 2.0, 3.0, 4.0, 5.0, 6.0]])
    order = [4, 0, 2]
    test = Measurements([1.0, 2.0, 3.0], shapes=-0.5 * shapes[0][:, order])
    paired = PairedModel(Fixed(frequencies, shapes), test)({})
    np.testing.assert_array_equal(paired.frequencies, [[5.0, 1.0, 3.0]])
    np.testing.assert_array_equal(paired.pairing.model_modes, [[5, 1, 3]])
    np.testing.assert_allclose(paired.pairing.mac, 1.0, rtol=1e-12)
    np.testing.assert_array_equal(paired.shapes, shapes[:, :, order])
    assert not paired.pairing.unpaired.any()


@pytest.mark.parametrize("angle", [0.0, 0.4, np.pi / 4, 1.2])
def test_two_equal_frequencies_are_paired_however_their_shapes_are_turned(angle):
    basis = np.linalg.qr(random_shapes(4, 7, 4))[0]
    model_shapes = basis.copy()
    model_shapes[:, 1:3] = basis[:, 1:3] @ turned(angle)
    frequencies = np.array([[1.0, 2.0, 2.0 * 1.001, 3.0]])
    test = Measurements([1.0, 2.0, 2.1], shapes=basis[:, :3])
    model = Fixed(frequencies, model_shapes[None])
    paired = PairedModel(model, test, candidates=4)({})
    np.testing.assert_allclose(paired.pairing.mac, 1.0, rtol=1e-12)
    assert set(paired.pairing.model_modes[0]) == {1, 2, 3}
    # The paired shapes of the cluster are the measured ones: no turning is left.
    np.testing.assert_allclose(np.diag(mac(basis[:, :3], paired.shapes[0])), 1.0)
    if angle:
        alone = PairedModel(model, test, candidates=4, min_gap=0.0)({})
        expected = max(np.cos(angle), np.sin(angle)) ** 2
        np.testing.assert_allclose(alone.pairing.mac[0, 1], expected, rtol=1e-9)


def test_modes_farther_apart_than_the_gap_are_no_cluster():
    shapes = np.eye(5)
    shapes[:2, :2] = turned(0.5)
    model = Fixed(np.array([[1.0, 1.03, 2.0, 3.0, 4.0]]), shapes[None])
    test = Measurements([1.0, 1.1], shapes=np.eye(5)[:, :2])
    single = np.cos(0.5) ** 2
    for min_gap, expected in ((0.02, single), (0.029, single), (0.061, 1.0)):
        found = PairedModel(model, test, min_gap=min_gap)({}).pairing.mac
        np.testing.assert_allclose(found, expected, rtol=1e-12)


def test_a_cluster_wins_by_its_span_where_none_of_its_modes_would_alone():
    shape = np.array([0.8, 0.8, 0.8, 0.6 * np.sqrt(3)]) / np.sqrt(3)
    test = Measurements([1.0], shapes=shape[:, None])  # MACs 0.213 three times, 0.36
    model = Fixed(np.array([[1.0, 1.01, 1.02, 2.0]]), np.eye(4)[None])
    pairing = PairedModel(model, test, candidates=4)({}).pairing
    assert pairing.model_modes[0, 0] < 4
    np.testing.assert_allclose(pairing.mac, 0.64, rtol=1e-12)


def test_a_cluster_of_three_spans_its_subspace_and_no_more():
    shapes = random_shapes(5, 9, 5)
    measured = shapes[:, 1:4] @ random_shapes(6, 3, 2)
    outside = shapes[:, 1:4] @ [1.0, 1.0, 1.0] + 2.0 * random_shapes(7, 9)
    test = Measurements([1, 2, 3], shapes=np.column_stack([measured, outside]))
    frequencies = np.array([[1.0, 2.0, 2.01, 2.02, 3.0]])
    model = Fixed(frequencies, shapes[None])
    found = PairedModel(model, test, candidates=5)({}).pairing.mac[0]
    np.testing.assert_allclose(found[:2], 1.0, rtol=1e-12)
    fit = shapes[:, 1:4] @ np.linalg.lstsq(shapes[:, 1:4], outside)[0]
    cosine = (fit @ outside) ** 2 / (fit @ fit) / (outside @ outside)
    np.testing.assert_allclose(found[2], cosine, rtol=1e-10)


def test_few_sensors_that_cannot_tell_a_cluster_apart_give_finite_numbers():
    shapes = np.array([[[1.0, 1.0, 0.5, 0.0], [1.0, 1.0, -0.5, 0.0]]])
    frequencies = np.array([[1.0, 1.001, 1.002, 5.0]])
    test = Measurements([1.0, 1.1], shapes=[[1.0, 1.0], [0.0, 2.0]])
    paired = PairedModel(Fixed(frequencies, shapes), test, candidates=4)({})
    np.testing.assert_allclose(paired.pairing.mac, 1.0, rtol=1e-12)  # they span all
    assert np.isfinite(paired.shapes).all()


def test_rows_are_the_same_to_the_bit_alone_and_in_a_batch():
    frequencies = np.sort(np.random.default_rng(8).uniform(1, 1.3, (40, 8)), axis=1)
    shapes = random_shapes(9, 40, 11, 8)
    test = Measurements([1.0, 1.1, 1.2, 1.3], shapes=random_shapes(10, 11, 4))
    whole = PairedModel(Fixed(frequencies, shapes), test)({})
    for row in range(40):
        one = [part[row : row + 1] for part in (frequencies, shapes)]
        alone = PairedModel(Fixed(*one), test)({})
        for a, b in zip(
            (alone.frequencies, alone.shapes, *alone.pairing),
            (whole.frequencies, whole.shapes, *whole.pairing),
            strict=True,
        ):
            np.testing.assert_array_equal(a[0], b[row])


# --- frequencies that cross inside the bounds

TRUTH = {"a": 10.0, "b": 10.5}
SD = 0.3


class Crossing:
    """Two uncoupled oscillators: their shapes are the two axes."""

    n_modes = 2

    def __call__(self, parameters):
        values = np.column_stack([parameters["a"], parameters["b"]])
        order = np.argsort(values, axis=1)
        shapes = np.eye(2)[order].transpose(0, 2, 1)
        return ModalSolution(np.sort(values, axis=1), shapes)


def crossing_posterior(pair):
    test = Measurements([*TRUTH.values()], sd=[SD, SD], shapes=np.eye(2))
    model = Crossing()
    if pair:
        model = PairedModel(model, test, candidates=2)
    prior = ef.IndependentPrior(dict.fromkeys("ab", stats.norm(10.0, 1.0)))
    return ef.LogPosterior(model, ef.FrequencyTerm(test), prior)


def exact_moments():
    """Return mean and sd of the conjugate Gaussian posterior."""
    precision = 1 / SD**2 + 1.0
    return np.array([(v / SD**2 + 10.0) / precision for v in TRUTH.values()]), (
        precision**-0.5
    )


def test_where_modes_cross_pairing_gives_the_exact_posterior():
    posterior = crossing_posterior(pair=True)
    theta = posterior.prior.sample(np.random.default_rng(0), 500)
    mean, sd = exact_moments()
    exact = stats.norm(mean, sd).logpdf(theta).sum(axis=1)
    difference = posterior(theta)[:, 0] - exact
    np.testing.assert_allclose(difference, difference[0], atol=1e-9)


def test_where_modes_cross_the_order_of_frequencies_gives_a_wrong_posterior():
    mean, sd = exact_moments()
    moments, switched = {}, {}
    for pair in (True, False):
        posterior = crossing_posterior(pair)
        (sampler,) = ef.run(posterior, nwalkers=32, nsteps=900, seed=3)
        idata = ef.to_inference_data(sampler, posterior, discard=200)
        draws = sampler.get_chain(discard=200, flat=True)
        moments[pair] = draws.mean(axis=0)
        if pair:
            predicted = dataset(idata, "response")
            modes = predicted["model_mode"].values
            switched = (modes[..., 0] > modes[..., 1]).mean()
            np.testing.assert_allclose(predicted["mac"].values, 1.0)
            by_frequency = draws[:, 0] > draws[:, 1]
            np.testing.assert_allclose(switched, by_frequency.mean())
    np.testing.assert_allclose(moments[True], mean, atol=0.2 * sd)
    crossed = stats.norm.cdf((mean[0] - mean[1]) / (sd * np.sqrt(2)))
    assert abs(switched - crossed) < 0.03
    # Without pairing the two parameters are exchangeable: both modes of the
    # posterior are equally high, and the means meet.
    unpaired = crossing_posterior(pair=False)
    there, swapped = unpaired(np.array([[9.9, 10.6], [10.6, 9.9]]))[:, 0]
    assert there == swapped
    assert np.abs(moments[False] - mean).max() > 0.4 * sd


def test_a_mode_without_a_pair_costs_a_finite_penalty():
    shapes = np.eye(4)[None, :, :]
    lonely = np.array([1.0, 1.0, 1.0, 1.0])
    test = Measurements(
        [1.0, 2.0], sd=[0.1, 0.1], shapes=np.c_[np.eye(4)[:, 0], lonely]
    )
    model = PairedModel(Fixed(np.array([[1.0, 2.0, 3.0, 4.0]]), shapes), test)
    modes = model({})
    assert modes.pairing.unpaired.tolist() == [[False, True]]
    np.testing.assert_allclose(modes.pairing.mac, [[1.0, 0.25]])
    term = ef.FrequencyTerm(test)
    same = term({}, ModalSolution(modes.frequencies))
    np.testing.assert_allclose(term({}, modes), same - UNPAIRED)
    neither = modes.pairing._replace(unpaired=np.array([[True, True]]))
    both = ef.PairedSolution(modes.frequencies, modes.shapes, neither)
    np.testing.assert_allclose(term({}, both), same - 2 * UNPAIRED)
    stored = {"frequency": modes.frequency, "unpaired": both.unpaired.astype(float)}
    by_mode = term.pointwise({}, stored)["frequency"]
    np.testing.assert_allclose(by_mode.sum(axis=1), same - 2 * UNPAIRED)


def test_the_models_own_statements_pass_through():
    K = {"k": np.diag([1.0, 2.0, 3.0])}
    model = ef.MatrixModel(np.zeros((3, 3)), np.eye(3), K, n_modes=3, shapes=True)
    test = Measurements([1.0], shapes=np.ones((3, 1)))
    paired = PairedModel(model, test)
    assert (paired.names, paired.required, paired.n_modes) == (("k",), ("k",), 1)
    assert not hasattr(paired, "bounds")
    prior = ef.IndependentPrior({"q": stats.uniform(1, 2)})
    with pytest.raises(ValueError, match=r"no parameter \['k'\]"):
        ef.LogPosterior(paired, ef.FrequencyTerm(test, relative_sd=0.01), prior)


GOOD = Measurements([1.0, 2.0], shapes=np.eye(3)[:, :2])
MODEL = Fixed(np.ones((1, 4)), np.ones((1, 3, 4)))


@pytest.mark.parametrize(
    ("arguments", "options", "error", "message"),
    [
        ((3, GOOD), {}, TypeError, "model: expected a callable"),
        ((MODEL, [1.0]), {}, TypeError, "measurements: expected Measurements"),
        ((MODEL, Measurements([1.0])), {}, ValueError, "measurements: no shapes"),
        ((MODEL, GOOD), {"candidates": 5}, ValueError, "5 modes .* returns 4"),
        (
            (MODEL, GOOD),
            {"candidates": 1},
            ValueError,
            "candidates: expected at least 2",
        ),
        ((MODEL, GOOD), {"candidates": 4.0}, TypeError, "candidates"),
        (
            (MODEL, GOOD),
            {"min_mac": 1.2},
            ValueError,
            "min_mac: expected a number from",
        ),
        ((MODEL, GOOD), {"min_mac": -0.1}, ValueError, "min_mac"),
        ((MODEL, GOOD), {"min_gap": -0.1}, ValueError, "min_gap"),
    ],
)
def test_arguments_are_checked(arguments, options, error, message):
    with pytest.raises(error, match=message):
        PairedModel(*arguments, **options)


def test_a_model_without_shapes_or_with_too_few_modes_is_refused():
    class Bare:
        def __init__(self, *modes):
            self.solution = ModalSolution(*modes)

        def __call__(self, parameters):
            return self.solution

    with pytest.raises(ValueError, match="paired by their shapes"):
        PairedModel(Bare(np.ones((1, 4))), GOOD)({})
    for returned, remedy in ((2, r", or give PairedModel\(candidates=2\)"), (1, "")):
        bare = Bare(np.ones((1, returned)), np.ones((1, 3, returned)))
        message = (
            "^candidates: 4 modes are searched for 2 measured ones, but the model "
            f"returns {returned}; let it return 4{remedy}$"
        )
        with pytest.raises(ValueError, match=message):
            PairedModel(bare, GOOD)({})


def test_mac_and_number_of_the_paired_modes_are_stored_with_each_sample():
    test = Measurements([1.0, 2.0], sd=[0.1, 0.1], shapes=[[0.0, 0.8], [0.6, 0.6]])
    model = PairedModel(
        Fixed(np.array([[1.0, 2.0]]), np.eye(2)[None]), test, candidates=2
    )
    prior = ef.IndependentPrior({"q": stats.uniform(1, 2)})
    posterior = ef.LogPosterior(model, ef.FrequencyTerm(test), prior)
    row, where = posterior([1.5]), posterior.columns
    np.testing.assert_array_equal(row[where["frequency"]], [2.0, 1.0])
    np.testing.assert_allclose(row[where["mac"]], [1.0, 0.64])
    np.testing.assert_array_equal(row[where["model_mode"]], [2, 1])
    np.testing.assert_array_equal(row[where["unpaired"]], [0, 0])
    assert len(row) == where["unpaired"].stop == 3 + 8
    outside = posterior([0.5])
    assert np.isneginf(outside[where["densities"]]).all()
    assert np.isnan(outside[3:]).all()


# --- what was wrong in 0.1.0


def two_storeys(k2, turn):
    """Two equal oscillators of 10 Hz and a little more, seen by turned sensors."""
    frequencies = np.array([[10.0, 10.0 * (1 + k2)]])
    return Fixed(frequencies, turned(turn)[None])


@pytest.mark.parametrize("term", ["shape", "both"])
def test_the_likelihood_has_no_step_where_modes_come_near(term):
    test = Measurements([10.0, 10.2], sd=[0.1, 0.1], shapes=np.eye(2))
    terms = [ShapeTerm(test, delta=0.05), ef.FrequencyTerm(test)]
    gaps = np.linspace(0.005, 0.025, 401)  # half the least gap of 2 %, and past it
    values = []
    for gap in gaps:
        paired = PairedModel(two_storeys(gap, np.radians(20)), test, candidates=2)({})
        of_terms = [each({}, paired)[0] for each in terms]
        values.append(of_terms[0] if term == "shape" else sum(of_terms))
        mac = np.cos(np.radians(20)) ** 2
        assert mac - 1e-12 <= paired.mac.min() <= paired.mac.max() <= 1 + 1e-12
        alone = {"mac": paired.mac, "frequency": paired.frequency}
        whole = terms[0].pointwise({}, alone)["mac"].sum()
        np.testing.assert_allclose(whole, of_terms[0], rtol=1e-9)
    if term == "shape":  # from the whole space of both to each mode's own
        assert values[0] - values[-1] > 40
    assert np.abs(np.diff(values)).max() < 1.5  # it fell by 46.8 from 1.999 to 2.001 %


@pytest.mark.parametrize("leaving", [0, 2])
def test_neighbours_that_drift_apart_take_nothing_with_them(leaving):
    # Three modes in a row: the last or the first leaves, while the others stay.
    shapes = random_shapes(11, 1, 6, 3)
    measured = shapes[0] @ random_shapes(12, 3, 1)
    test = Measurements([1.0], shapes=measured)
    macs = []
    for gap in np.linspace(0.009, 0.021, 241):
        ratios = [1.001, 1 + gap] if leaving else [1 + gap, 1.001]
        frequencies = np.cumprod([[1.0, *ratios]], axis=1)
        model = Fixed(frequencies, shapes)
        macs.append(PairedModel(model, test, candidates=3)({}).mac[0, 0])
    np.testing.assert_allclose(macs[0], 1.0, rtol=1e-12)  # in the span of all three
    pair = np.delete(shapes[0], leaving, axis=1)
    fit = pair @ np.linalg.lstsq(pair, measured)[0]
    pair = ((fit * measured).sum() ** 2 / (fit**2).sum() / (measured**2).sum()).item()
    alone = mac(measured, shapes[0][:, [leaving]]).item()
    np.testing.assert_allclose(macs[-1], max(pair, alone), rtol=1e-10)
    assert np.abs(np.diff(macs)).max() < 0.02


def test_sensors_and_dofs_are_matched_in_any_order():
    K = {"k": np.diag([4.0, 3.0, 2.0, 1.0]) + 0.2}
    full = ef.MatrixModel(np.zeros((4, 4)), np.eye(4), K, n_modes=4, shapes=True)
    solution = full({"k": np.array([9.0])})
    frequencies, shapes = solution.frequencies[0], solution.shapes[0]
    test = Measurements(frequencies[:2], shapes=shapes[[3, 1]][:, :2], dofs=[3, 1])
    for given in (True, [1, 3], [3, 1], [3, 0, 1]):
        model = ef.MatrixModel(full.K0, full.M0, K, n_modes=4, shapes=given)
        paired = PairedModel(model, test)({"k": np.array([9.0])})
        np.testing.assert_allclose(paired.mac, 1.0, rtol=1e-12)
    model = ef.MatrixModel(full.K0, full.M0, K, n_modes=4, shapes=[0, 1])
    with pytest.raises(ValueError, match=r"^dofs: .* sensors at \[3\]"):
        PairedModel(model, test)
    prior = ef.IndependentPrior({"k": stats.uniform(5, 9)})
    model = ef.MatrixModel(full.K0, full.M0, K, n_modes=4, shapes=[1, 3])
    for rows, dofs in ([1, 2, 3], [2, 1, 3]), ([1, 2, 3], [1, 3]):  # labels, not places
        other = Measurements(frequencies[:2], shapes=shapes[dofs][:, :2], dofs=dofs)
        model = ef.MatrixModel(full.K0, full.M0, K, n_modes=4, shapes=rows)
        with pytest.raises(ValueError, match="was measured at dof"):
            ef.LogPosterior(model, ShapeTerm(other, delta=0.1), prior)
        paired = PairedModel(model, other)({"k": np.array([9.0])})
        np.testing.assert_allclose(paired.mac, 1.0, rtol=1e-12)
    model = ef.MatrixModel(full.K0, full.M0, K, n_modes=4, shapes=[1, 3])
    term = ShapeTerm(test, delta=0.1)
    with pytest.raises(ValueError, match=r"measured at dof \[3, 1\], .* at \[1, 3\]"):
        ef.LogPosterior(model, term, prior)
    paired = ef.LogPosterior(PairedModel(model, test), term, prior)
    best = -2 * np.log(2 * np.pi * 0.1**2) / 2  # of two modes at two sensors
    np.testing.assert_allclose(paired([9.0])[2], best, rtol=1e-12)


@pytest.mark.parametrize("as_solution", [False, True])
def test_a_function_may_return_frequencies_and_shapes_by_name(as_solution):
    shapes = random_shapes(13, 4, 3)
    test = Measurements([1.0, 2.0], shapes=shapes[[3, 1]][:, :2], dofs=[3, 1])

    def solve(p):
        frequencies = p["k"] * np.array([1.0, 2.0, 3.0])
        if as_solution:
            return ModalSolution(frequencies, shapes)
        return {"frequency": frequencies, "shapes": shapes}

    model = ef.FunctionModel(solve, variables=ef.modal_variables(3, range(4)))
    paired = PairedModel(model, test, candidates=3)({"k": np.array([1.0])})
    np.testing.assert_allclose(paired.mac, 1.0, rtol=1e-12)
