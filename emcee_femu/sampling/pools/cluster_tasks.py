"""Tasks of dask and ray, which find and replace workers by themselves."""

from importlib import import_module
from typing import Any

from .tasks import worker_lost
from .worker import Outcome, evaluate

MOST_LOSSES = 10  # tasks that dask may lose in one map, before it is given up


class DaskTasks:
    """Of a ``distributed.Client``."""

    def __init__(self, client: Any) -> None:
        """See the class."""
        _check_open(client)
        self._client = client
        self._completed = import_module("distributed").as_completed(with_results=True)
        self._arguments: dict[str, tuple[int, str | None, Any, Any]] = {}
        self._carrier: Any = None  # the payload, which the workers pass on
        self._losses = 0

    def submit(
        self, number: int, digest: str | None, points: Any, payload: Any = None
    ) -> None:
        """See :class:`tasks.Tasks`."""
        carrier = None
        if payload is not None:
            if self._carrier is None:
                try:
                    self._carrier = self._client.scatter(payload, hash=False)
                except TimeoutError as error:  # none came within half a minute
                    raise worker_lost("the dask cluster") from error
            carrier = self._carrier
        future = self._client.submit(evaluate, digest, points, carrier, pure=False)
        self._arguments[future.key] = (number, digest, points, payload)
        self._completed.add(future)

    def wait(self) -> tuple[int, Outcome]:
        """See :class:`tasks.Tasks`."""
        distributed = import_module("distributed")
        while True:
            try:
                future, outcome = next(self._completed)
            except distributed.KilledWorker as error:
                raise worker_lost("the dask cluster") from error
            if isinstance(outcome, Outcome):
                return self._arguments[future.key][0], outcome
            # What dask could not compute again: the payload was on the lost worker.
            self._losses += 1
            if self._losses > MOST_LOSSES:
                raise worker_lost("the dask cluster") from outcome
            if not self._carrier_holds():
                self._carrier = None
            self.submit(*self._arguments[future.key])

    def _carrier_holds(self) -> bool:
        return self._carrier is not None and self._carrier.status == "finished"

    def abandon(self) -> None:
        """See :class:`tasks.Tasks`."""
        self._completed.clear()  # dask forgets a future that nobody holds


class RayTasks:
    """Of the module ray."""

    def __init__(self, ray: Any, remote: Any) -> None:
        """See the class."""
        _check_started(ray)
        self._ray, self._remote = ray, remote
        self._numbers: dict[Any, int] = {}
        self._carrier: Any = None  # the payload, in ray's store

    def submit(
        self, number: int, digest: str | None, points: Any, payload: Any = None
    ) -> None:
        """See :class:`tasks.Tasks`."""
        if payload is not None:
            if self._carrier is None:
                self._carrier = self._ray.put(payload)
            payload = self._carrier
        self._numbers[self._remote.remote(digest, points, payload)] = number

    def wait(self) -> tuple[int, Outcome]:
        """See :class:`tasks.Tasks`."""
        (done,), _ = self._ray.wait(list(self._numbers), num_returns=1)
        try:
            return self._numbers.pop(done), self._ray.get(done)
        except self._ray.exceptions.RayError as error:
            raise worker_lost("ray") from error

    def abandon(self) -> None:
        """See :class:`tasks.Tasks`."""
        for reference in self._numbers:
            self._ray.cancel(reference)


def dask_size(client: Any) -> int:
    """Return how many evaluations run at once."""
    _check_open(client)
    return sum(client.nthreads().values())


def _check_open(client: Any) -> None:
    if getattr(client, "status", "") in ("closed", "closing"):
        raise RuntimeError("pool: the dask Client was closed; make a new one")


def ray_size(ray: Any) -> int:
    """Return how many evaluations run at once."""
    _check_started(ray)
    return int(ray.cluster_resources().get("CPU", 1))


def _check_started(ray: Any) -> None:
    if not ray.is_initialized():  # a task would start another cluster, unasked
        raise RuntimeError("pool: ray was shut down; call ray.init() again")
