"""Gradient and Fisher information of the terms, for all their options."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import stats
from support.gradients import MEASURED, SHAPES, Derived, numerical

import emcee_femu as ef

SD = np.diag([0.02, 0.03, 0.05])
COVARIANCE = SD @ (0.6 + 0.4 * np.eye(3)) @ SD
SENSORS = np.random.default_rng(1).uniform(0.1, 0.3, SHAPES.shape)
FRF = ef.frf.FRFMeasurements(
    [1.0, 2.0, 3.0],
    (SHAPES[::2] + 1j * SHAPES[1::2]),
    [(0, 1), (1, 1)],
    kind="mobility",
)
SOME = ef.Measurements(MEASURED, shapes=SHAPES[[2, 0]], dofs=[2, 0])
TERMS = {
    "beta": ef.FrequencyTerm(MEASURED, beta=[1e4, 2e4, 5e3]),
    "fewer modes": ef.FrequencyTerm(MEASURED[:2], sd=[0.02, 0.03]),
    "covariance": ef.FrequencyTerm(MEASURED, covariance=COVARIANCE),
    "discrepancy": ef.FrequencyTerm(MEASURED, discrepancy="s"),
    "discrepancy and sd": ef.FrequencyTerm(MEASURED, sd=0.02, discrepancy="s"),
    "discrepancy and covariance": ef.FrequencyTerm(
        MEASURED, covariance=COVARIANCE, discrepancy="s"
    ),
    "delta": ef.ShapeTerm(SHAPES, delta=0.1),
    "delta of each mode": ef.ShapeTerm(SHAPES, delta=[0.1, 0.05, 0.2]),
    "inferred delta": ef.ShapeTerm(SHAPES, discrepancy="s"),
    "sensors": ef.ShapeTerm(SHAPES, sd=SENSORS),
    "fewer shapes": ef.ShapeTerm(SHAPES[:, :2], sd=SENSORS[:, :2]),
    "one sensor moves": ef.ShapeTerm([[-1.0], [0.0], [0.0], [0.0]], delta=0.5),
    "some sensors": ef.ShapeTerm(SOME, delta=0.1),
    "displacement": ef.DisplacementTerm(SHAPES.T, sd=0.2),
    "displacement, discrepancy": ef.DisplacementTerm(SHAPES.T, discrepancy="s"),
    "FRF": ef.frf.FRFTerm(FRF, sd=0.1, discrepancy="s"),
    "amplitudes": ef.frf.FRFTerm(FRF, sd=0.1, amplitude=True, discrepancy="s"),
}
THETA = np.random.default_rng(2).uniform([0.8, 0.8, 0.05], [1.3, 1.3, 0.2], (5, 3))
FLAT = {"a": (0.5, 2.0), "b": (0.5, 2.0), "s": (1e-3, 1.0)}


class Scaled:
    """Shapes times a factor, which does not matter; as displacements and as an FRF."""

    names = ("a", "b", "s")
    variables = ef.modal_variables(3, range(4)) | {
        "displacement": ef.Variable({"load_case": range(3), "point": range(4)}),
        **TERMS["FRF"].reads,
    }

    def __init__(self, sign):
        self.sign = sign

    def __call__(self, parameters):
        return self.jacobian(parameters)[0]

    def jacobian(self, parameters):
        solution, slopes = Derived().jacobian(parameters)

        def extended(frequency, shapes):
            moved = shapes.swapaxes(1, 2)
            scaled = self.sign * shapes
            parts = np.stack([shapes[:, ::2], shapes[:, 1::2]], axis=-1)
            found = {"frequency": frequency, "shapes": scaled, "displacement": moved}
            return found | {"mobility": parts}

        by_name = {n: extended(*(by[n] for by in slopes.values())) for n in "ab"}
        by_variable = {
            variable: {name: by_name[name][variable] for name in "ab"}
            for variable in self.variables
        }
        return extended(solution.frequencies, solution.shapes), by_variable


def posterior_of(term, sign=1.0):
    return ef.LogPosterior(Scaled(sign), term, ef.IndependentPrior(FLAT))


@pytest.mark.parametrize("sign", [1.0, -3.0])
@pytest.mark.parametrize("term", TERMS.values(), ids=TERMS)
def test_the_gradient_is_that_of_the_log_likelihood(term, sign):
    posterior = posterior_of(term, sign)
    gradient = posterior.gradient(THETA)[1]
    expected = numerical(lambda theta: posterior(theta)[:, 2], THETA)
    assert_allclose(gradient, expected, rtol=1e-6, atol=1e-6 * np.abs(expected).max())


@pytest.mark.parametrize("term", TERMS.values(), ids=TERMS)
def test_the_information_is_fishers_of_the_deviations(term):
    """That of a Gaussian: dmu dmu / sigma^2 + 2 dsigma dsigma / sigma^2."""
    posterior = posterior_of(term)

    def deviations(theta):
        parameters = dict(zip("abs", theta.T, strict=True))
        return term.deviations(parameters, posterior.model(parameters))

    r, sd = deviations(THETA)
    normal = stats.norm.logpdf(r, 0, sd).sum(axis=1)
    assert_allclose(np.ptp(posterior(THETA)[:, 2] - normal), 0, atol=1e-11)
    slopes = [numerical(lambda x, i=i: deviations(x)[i], THETA) for i in (0, 1)]
    means, sds = (slope.swapaxes(1, 2) / sd[:, :, None] for slope in slopes)
    expected = means.swapaxes(1, 2) @ means + 2 * sds.swapaxes(1, 2) @ sds
    information = posterior.linearize(THETA).information
    scale = np.abs(expected).max()
    assert_allclose(information, expected, rtol=1e-6, atol=1e-6 * scale)
