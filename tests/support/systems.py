"""What only some systems have, for which tests are skipped, or leave behind."""

import multiprocessing
import os
import signal
import sys

import pytest

LINUX = sys.platform == "linux"
KILL = getattr(signal, "SIGKILL", signal.SIGTERM)  # either ends a process of Windows

posix = pytest.mark.skipif(
    not hasattr(os, "fork"), reason="it needs fork, signals or a shell of POSIX"
)
inherits = pytest.mark.skipif(
    not LINUX, reason="only on Linux do a run's own processes inherit what is unpickled"
)

# distributed leaves sockets and loops of its own to the garbage collector.
leaves_sockets = pytest.mark.filterwarnings(
    "ignore::ResourceWarning", "ignore::pytest.PytestUnraisableExceptionWarning"
)


def need_start_method(name):
    """Skip a test of processes that this system does not start so, or not safely."""
    known = multiprocessing.get_all_start_methods()
    if name not in known or (name == "fork" and not LINUX):
        pytest.skip(f"no processes are started by {name} here")
