import sys

import matplotlib
import pytest

matplotlib.use("Agg")  # no display on a server


@pytest.fixture(autouse=True)
def closed_figures():
    """Leave no figure open, for matplotlib warns of more than 20."""
    yield
    if "matplotlib.pyplot" in sys.modules:
        sys.modules["matplotlib.pyplot"].close("all")
