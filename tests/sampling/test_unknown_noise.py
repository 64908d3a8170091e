"""Noise that the data do not bound: a likelihood with a spike, and exact moments."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import stats

import emcee_femu as ef

MEASURED = {"k1": 8.0, "k2": 10.5}
BOUNDS = {"k1": (5.0, 9.0), "k2": (9.0, 14.0)}
HALF_NORMAL = stats.halfnorm(scale=0.02)
RANGE = stats.uniform(0.001, 0.049)  # what pages and messages advise


class Frequencies:
    """A model whose frequencies are parameters."""

    def __init__(self, names):
        self.modes, self.names = names, tuple(dict.fromkeys(names))
        self.variables = ef.modal_variables(len(names))

    def __call__(self, parameters):
        return ef.ModalSolution(np.column_stack([parameters[n] for n in self.modes]))


def posterior_of(names, law, modes):
    """Return that of parameters that each fit a frequency, or several."""
    term = ef.FrequencyTerm([MEASURED[name] for name in modes], discrepancy="noise")
    laws = {name: BOUNDS[name] for name in names} | {"noise": law}
    return ef.LogPosterior(Frequencies(modes), term, ef.IndependentPrior(laws))


def exact_sds(names, law, repeats):
    """Return standard deviations: given the noise, frequencies are cut normals."""
    noise = law.ppf((np.arange(4_000) + 0.5) / 4_000)
    cut = []
    for name in names:
        centre, spread = MEASURED[name], MEASURED[name] * noise / repeats**0.5
        ends = [(end - centre) / spread for end in BOUNDS[name]]
        cut.append(stats.truncnorm(*ends, centre, spread))
    mass = [stats.norm.cdf(one.args[1]) - stats.norm.cdf(one.args[0]) for one in cut]
    weights = np.prod(mass, axis=0) * noise ** (len(names) * (1 - repeats))
    moments = [(one.mean(), one.var()) for one in cut] + [(noise, 0.0 * noise)]

    def sd(mean, variance):
        centre = np.average(mean, weights=weights)
        return np.average(variance + (mean - centre) ** 2, weights=weights) ** 0.5

    return [sd(*pair) for pair in moments]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("names", "law", "repeats"),
    [(["k1"], HALF_NORMAL, 1), (["k1", "k2"], RANGE, 1), (["k1"], RANGE, 2)],
)
def test_noise_that_the_data_do_not_bound_has_exact_moments(names, law, repeats):
    """The law of a likelihood with a spike: exact moments, and no false alarm."""
    run = ef.run(posterior_of(names, law, repeats * names), steps=150, seed=1)
    draws = np.concatenate([one.get_chain(flat=True) for one in run])
    assert_allclose(draws.std(axis=0), exact_sds(names, law, repeats), rtol=0.12)
    if law is RANGE and repeats == 1:
        assert ef.diagnose(run).chains.status == "converged"


def test_an_integral_without_bound_is_refused_before_sampling():
    """Two frequencies that one parameter fits: the integral of 1 / noise."""
    posterior = posterior_of(["k1"], HALF_NORMAL, ["k1", "k1"])
    with pytest.raises(ValueError, match=r"'noise'.*0\.001"):
        ef.run(posterior, steps=20, seed=1)
