"""Notice that a process of a ``multiprocessing.Pool`` died: the pool itself hangs."""

import queue
from multiprocessing.pool import RUN, ThreadPool
from typing import Any

INTERVAL = 0.2  # s between two looks, only while no result comes
BRIEF = 0.02  # s, where processes come and go: one must be seen before it dies


class ProcessWatch:
    """The processes of a pool, as far as it has any.

    ``multiprocessing.Pool`` replaces a dead process, but the task that it worked on is
    lost, and so may be a lock that it held; ``map`` then waits for ever. A process
    that ends because of ``maxtasksperchild`` exits with code 0 and is no loss.
    (One that is started and dies between two looks escapes notice. An executor,
    ``ProcessPoolExecutor(max_tasks_per_child=...)``, has no such gap.)
    """

    def __init__(self, pool: Any) -> None:
        """See the class."""
        self._pool = pool
        self._replaced = getattr(pool, "_maxtasksperchild", None) is not None
        self._seen = set(self._processes())

    def get(self, done: "queue.SimpleQueue[Any]") -> Any:
        """Return the next item, or raise if a process died.

        Raises:
            RuntimeError: If so, with its number and its exit code.
        """
        interval = BRIEF if self._replaced else INTERVAL
        while True:
            try:
                return done.get(timeout=interval)
            except queue.Empty:
                self.check()

    def check(self) -> None:
        """Raise if a process died since the pool was made."""
        if getattr(self._pool, "_state", RUN) != RUN:
            raise RuntimeError("pool: it was closed or terminated; make a new one")
        self._seen.update(self._processes())
        for process in self._seen:
            code = process.exitcode
            if code is None or (self._replaced and code == 0):
                continue
            self._dismantle()
            cause = f"signal {-code}" if code < 0 else f"exit code {code}"
            raise RuntimeError(
                f"pool: worker process {process.pid} died ({cause}: out of memory, "
                "killed, or a crash in the solver's own code), and "
                "multiprocessing.Pool would wait for ever; what was sampled so far is "
                "kept in the backend: make a new pool and resume"
            )
        if self._replaced:  # those that ended as they should are forgotten
            self._seen = {process for process in self._seen if process.exitcode != 0}

    def _processes(self) -> list[Any]:
        if isinstance(self._pool, ThreadPool):
            return []  # its threads end with the program
        processes = list(getattr(self._pool, "_pool", ()))
        return [process for process in processes if hasattr(process, "exitcode")]

    def _dismantle(self) -> None:
        """End the pool's processes, and free the locks that a dead one may hold.

        Else ``Pool.terminate``, and so the end of a ``with`` block, would hang.
        """
        pool = self._pool
        pool._worker_handler._state = "TERMINATE"  # it would start new processes
        pool._change_notifier.put(None)
        pool._worker_handler.join()
        for process in pool._pool:
            process.kill()
            process.join()
        for lock in (pool._inqueue._rlock, pool._outqueue._wlock):
            # The dead hold it if the pool's own threads do not give it up at once.
            lock.acquire(timeout=1)
            lock.release()
