"""A program that is started from a command line, one process per solve.

Little code stands between an FE program and a posterior, but each line of it has a
reason. For your own program copy `finished_job`, change `COMMAND`, and replace
`read_frequencies`, which reads the table of CalculiX. Note:

* Each solve has a new, empty folder, named after the worker process and removed after
  the solve, even a failed one. So no result is read for that of another solve.
* A time limit ends the program and all that it started: to kill the script that starts
  a solver leaves the solver behind.
* Exit status 0 does not mean that there is a result. So the reader checks that the
  result is one complete table whose columns fit each other.
* An error due to the parameters is an exception. An error of the machine says nothing
  about the parameters: `Unavailable` stops the run in any case. The page "Use a
  program as a black box" (examples/how_to/black_box.py) has both.

CalculiX is free software and needs no licence: apt install calculix-ccx

Run it:  python examples/calculix_program.py job.inp
"""

import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np

COMMAND = ("ccx", "-i", "job")  # reads job.inp of the folder in which it is started
# What a program prints that got no licence: put the words of yours here.
NO_LICENCE = re.compile("no licen[cs]e|licen[cs]e.*not available", re.IGNORECASE)
PAUSE = 10.0  # s before a solve without a licence is tried again


class Unavailable(BaseException):
    """The machine cannot solve now. Not an Exception: it stops also what rejects."""


def find_command() -> tuple[str, ...]:
    """Return the command with the full name of CalculiX, ``ccx`` or ``ccx_2.20``.

    Raises:
        FileNotFoundError: If there is none on the search path.
    """
    folders = [Path(folder) for folder in os.get_exec_path()]
    names = [COMMAND[0], *sorted({p.name for f in folders for p in f.glob("ccx_*")})]
    found = [path for name in names if (path := shutil.which(name))]
    if not found:
        raise FileNotFoundError(
            "CalculiX is not installed: there is no ccx on the search path. On Debian "
            "and Ubuntu: apt install calculix-ccx"
        )
    return (found[0], *COMMAND[1:])


@contextmanager
def finished_job(
    deck: str,
    command: Sequence[str] = COMMAND,
    limit: float = 60.0,
    patience: float = 600.0,
    scratch: str | Path | None = None,
) -> Iterator[Path]:
    """Yield the folder of a finished job, which is removed afterwards.

    Args:
        deck: The input file.
        command: What is started in the folder; it finds the deck as ``job.inp``.
        limit: Seconds that one solve may take, ten times what it usually takes.
        patience: Seconds to wait for a licence.
        scratch: Where the folders are made, best a local disk; None for that of the
            system.

    Raises:
        subprocess.TimeoutExpired: If it took too long.
        RuntimeError: If the program failed; with the end of what it printed.
        Unavailable: If the machine is to blame: no program, no disk, no licence.
    """
    try:
        folder = Path(tempfile.mkdtemp(prefix=f"worker-{os.getpid()}-", dir=scratch))
    except OSError as error:
        raise Unavailable(f"no scratch folder: {error}") from error
    try:
        try:
            (folder / "job.inp").write_text(deck, encoding="ascii")
            _try_until_licensed(folder, command, limit, patience)
        except OSError as error:
            raise Unavailable(f"{command[0]} did not run: {error}") from error
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _try_until_licensed(
    folder: Path, command: Sequence[str], limit: float, patience: float
) -> None:
    end = time.monotonic() + patience
    while status := _run(folder, command, limit):
        printed = (folder / "printed.txt").read_text(errors="replace")
        message = f"{command[0]} ended with status {status}: {printed[-500:].strip()}"
        if not NO_LICENCE.search(printed):
            raise RuntimeError(message)
        if time.monotonic() + PAUSE > end:
            raise Unavailable(f"no licence in {patience:g} s; {message}")
        time.sleep(PAUSE)


def _run(folder: Path, command: Sequence[str], limit: float) -> int:
    """Return the exit status of the program, which does not outlive the call."""
    with (folder / "printed.txt").open("w") as printed:
        process = subprocess.Popen(
            command,
            cwd=folder,
            stdin=subprocess.DEVNULL,  # some programs ask a question, and wait
            stdout=printed,  # a file: a pipe stays open as long as anybody has it
            stderr=subprocess.STDOUT,
            env=os.environ | {"OMP_NUM_THREADS": "1"},  # the workers share the cores
            start_new_session=True,  # of POSIX: a group of its own, ended as a whole
        )
        try:
            return process.wait(limit)
        except BaseException:  # a time-out, or the run was interrupted
            _end(process)
            raise


def _end(process: subprocess.Popen) -> None:
    """End a program and all that it started."""
    if os.name == "nt":
        tree = ["taskkill", "/F", "/T", "/PID", str(process.pid)]
        subprocess.run(tree, capture_output=True)
    else:
        with suppress(ProcessLookupError, PermissionError):  # it has just ended
            os.killpg(process.pid, signal.SIGKILL)
    process.wait()


def read_frequencies(text: str, n_modes: int) -> np.ndarray:
    """Return the lowest frequencies in Hz from a .dat file of CalculiX.

    Raises:
        ValueError: If there is not one table of that many modes, complete and sound.
    """
    _, *tables = text.split("E I G E N V A L U E   O U T P U T")
    if len(tables) != 1:
        raise ValueError(f"expected one table of eigenvalues, got {len(tables)}")
    number = r" +(-?\d\.\d{7}E[+-]\d\d)"
    row = re.compile(r"^ +(\d+)" + 4 * number + r" *$", re.MULTILINE)
    table = tables[0].split("P A R T I C I P A T I O N")[0]
    rows = np.array(row.findall(table), dtype=float).reshape(-1, 5)[:n_modes]
    if rows[:, 0].tolist() != [*range(1, n_modes + 1)]:
        raise ValueError(
            f"expected modes 1 to {n_modes}, got {rows[:, 0].astype(int).tolist()}: "
            "the program found fewer, or the file is damaged"
        )
    _, eigenvalue, omega, frequency, imaginary = rows.T
    if (eigenvalue <= 0).any() or imaginary.any():
        raise ValueError(f"expected positive eigenvalues, got {eigenvalue}")
    # Seven digits each: of the frequencies those of the eigenvalue are the better ones.
    sound = np.isclose(omega**2, eigenvalue, rtol=1e-5)
    sound &= np.isclose(2 * np.pi * frequency, omega, rtol=1e-5)
    if not sound.all() or (np.diff(eigenvalue) < 0).any():
        raise ValueError(
            f"the columns of a table do not fit: the file is damaged\n{table}"
        )
    return np.sqrt(eigenvalue) / (2 * np.pi)


if __name__ == "__main__":
    with finished_job(Path(sys.argv[1]).read_text(), find_command()) as solved:
        print(read_frequencies((solved / "job.dat").read_text(), 1), "Hz")
