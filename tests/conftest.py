import os

# One thread for each of xdist's workers and of what they start: matrices are small.
for library in ("OMP", "OPENBLAS", "MKL"):
    os.environ.setdefault(f"{library}_NUM_THREADS", "1")  # before NumPy is imported

import signal
import sys
import warnings

import matplotlib
import pytest

# What a shell starts in the background, as CI may be, ignores the keyboard's interrupt,
# and so would all that the tests start.
signal.signal(signal.SIGINT, signal.default_int_handler)

# ArviZ 0.23 notes the day of its first import in a file; xdist's workers may do so at
# once, and one of them fails. The process that starts them has no use for it.
if "PYTEST_XDIST_WORKER" in os.environ:
    with warnings.catch_warnings(action="ignore"):
        try:
            import arviz
        except FileNotFoundError:  # another has noted it meanwhile
            import arviz  # noqa: F401

matplotlib.use("Agg")  # no display on a server


@pytest.fixture(autouse=True)
def closed_figures():
    """Leave no figure open, for matplotlib warns of more than 20."""
    yield
    if "matplotlib.pyplot" in sys.modules:
        sys.modules["matplotlib.pyplot"].close("all")


@pytest.fixture
def path(tmp_path):
    """Return the name of a run's file."""
    return tmp_path / "run.chain"


# Doctests that take seconds; what they show, tests of their modules hold as laws.
SLOW_EXAMPLES = {
    "population.pool_tests.pool_tests",
    "population.figure.plot_population",
    "report.report.report",
    "emulation.run_emulated.run_emulated",
    "emulation.emulate.emulate",
    "comparison.compare.compare_moves",
    "comparison.figure.plot_comparison",
}


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items):
    for item in items:
        if ".".join(item.name.split(".")[-3:]) in SLOW_EXAMPLES:
            item.add_marker(pytest.mark.slow)
