"""What users write in their first hour: each is refused with what to write."""

import pytest

import emcee_femu as ef

POSTERIOR = ef.paper.mass_spring().posterior


class Emulated:
    posterior = POSTERIOR

    def __call__(self, parameters):  # as an emulated model is called
        return {}


@pytest.mark.parametrize(
    ("call", "error", "cure"),
    [
        (lambda: ef.run(Emulated(), seed=1), TypeError, r"\.posterior"),
        (lambda: ef.find_map(Emulated(), seed=1), TypeError, r"\.posterior"),
        (lambda: ef.run(POSTERIOR, ef.DEMCMove, seed=1), TypeError, r"DEMCMove\(\)"),
        (lambda: ef.run(lambda theta: 0.0, seed=1), TypeError, "EnsembleSampler"),
        (lambda: ef.diagnose(Emulated()), TypeError, r"\.posterior"),
        (lambda: ef.GaussianPrior({"k1": (50, 9)}), TypeError, r"\['k1'\], mean, sd"),
        (lambda: ef.GaussianPrior(["k1"], [50.0]), ValueError, "sd"),
        (lambda: ef.MetropolisMove([[1.0, 0.0], [0.0, 1.0]]), ValueError, "cov="),
        (lambda: ef.report(None, "tower.pdf"), ValueError, "tower.html"),
    ],
)
def test_the_message_has_the_cure(call, error, cure):
    with pytest.raises(error, match=cure):
        call()
