"""A file whose writer was killed in the middle of a record."""

import subprocess
import sys

from support.systems import posix

import emcee_femu as ef

# Pages of the file are written before the record is complete, as of a large one.
KILLED = """
import os, signal, sqlite3, sys
file = sqlite3.connect(sys.argv[1], isolation_level=None)
file.execute("PRAGMA cache_size = 1")
file.execute("BEGIN IMMEDIATE")
file.execute("UPDATE entry SET name = name || '?'")
file.execute("CREATE TABLE more (content)")
file.executemany("INSERT INTO more VALUES (?)", [(bytes(100_000),)] * 20)
os.kill(os.getpid(), signal.SIGKILL)
"""


@posix
def test_it_is_read_by_its_name_as_before_that_record(tmp_path):
    path = tmp_path / "run.chain"
    posterior = ef.paper.mass_spring().posterior
    ef.run(posterior, ef.DEMCMove(), 12, 20, ensembles=1, seed=1, backend=str(path))
    whole = str(ef.diagnose(path))
    subprocess.run([sys.executable, "-c", KILLED, path], check=False)
    assert path.with_name("run.chain-journal").stat().st_size
    assert str(ef.diagnose(path)) == whole
