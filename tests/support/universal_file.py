"""Universal files of three modes at three nodes."""

from pathlib import Path

import numpy as np
import pytest

F = [3.1, 9.8, 20.4]
NODES = [4, 12, 7]
# Rows: 4:x 4:y 4:z 12:x ...; every z is zero, as of a test with biaxial sensors.
X, Y, Z = (
    np.array([[0.3, -0.8, 1.0], [0.7, -0.2, -0.9], [1.0, 1.0, 0.4]]),
    np.array([[0.2, 0.5, -0.3], [0.1, 0.9, 0.2], [0.5, -0.4, 0.0]]),
    np.zeros((3, 3)),
)
LABELS = ("4:x", "4:y", "12:x", "12:y", "7:x", "7:y")


def a_mode(pyuff, number, turn=1.0, **changes):
    i = number - 1
    data = {
        "model_type": 1,
        "id1": "NONE",
        "analysis_type": 2,
        "data_ch": 2,
        "spec_data_type": 12,
        "node_nums": NODES,
        "load_case": 1,
        "mode_n": number,
        "freq": F[i],
        "r1": X[:, i] * turn,
        "r2": Y[:, i] * turn,
        "r3": Z[:, i] * turn,
    }
    return {**pyuff.prepare_55(**(data | changes)), "data_type": 5}


def write_modes(path: Path) -> Path:
    pyuff = pytest.importorskip("pyuff", reason='pip install "emcee_femu[uff]"')
    modes = [a_mode(pyuff, i, r3=np.ones(3)) for i in (1, 2, 3)]
    pyuff.UFF(str(path)).write_sets(modes, "overwrite")
    return path
