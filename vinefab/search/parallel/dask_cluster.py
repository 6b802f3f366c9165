"""Evaluating points on the workers of a dask cluster, on this computer or on many.

The package is loaded only when a cluster is used. Every worker builds the run's evaluator once,
from its spec; then it gets points and poses and returns evaluations. Work on a worker that dies is
repeated by another. Points do not influence each other, so results depend neither on the workers
nor on how the points are divided.
"""

import importlib.util
import io
import json
import math
import pickle
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from types import MappingProxyType
from typing import Any

from vinefab.core.errors import BadInputError, UnknownNameError, WorkersLostError
from vinefab.core.hashing import sha256_of
from vinefab.core.validation import Floats
from vinefab.search.evaluator import Evaluations, Evaluator, EvaluatorSpec
from vinefab.search.parallel.executor import in_work_units
from vinefab.search.parallel.point_evaluator import Begin, Finish
from vinefab.search.record.result import package_versions, plugin_packages
from vinefab.search.timing import Ledger, Work
from vinefab.tasks.evaluate import Poses


class _Pickler(pickle.Pickler):
    """Pickles read-only views of dictionaries too."""

    def reducer_override(self, thing: object) -> Any:  # noqa: ANN401 - pickle's own contract
        """Reduce a view to its dictionary; pickle reduces everything else."""
        if isinstance(thing, MappingProxyType):
            return _view, (dict(thing),)
        return NotImplemented


def _view(content: dict[Any, Any]) -> MappingProxyType[Any, Any]:
    return MappingProxyType(content)


def serialized(thing: object) -> bytes:
    """Return an object as bytes."""
    stream = io.BytesIO()
    _Pickler(stream, protocol=pickle.HIGHEST_PROTOCOL).dump(thing)
    return stream.getvalue()


def deserialized(data: bytes) -> Any:  # noqa: ANN401 - any object
    """Return the object of `serialized`; only for bytes from a worker or the user's own run."""
    return pickle.loads(data)  # noqa: S301


ROUND_TRIP_S = 0.1
"""Least work to send at once: a round trip takes some milliseconds."""

PATIENCE_S = 300.0
"""How long a run waits without any worker before it gives up."""

CONNECT_S = 10.0
"""How long a scheduler may take to answer the first call."""

POLL_S = 2.0
"""Interval of checks for workers."""

RESTART_S = 60.0
"""Time without workers after which those of this computer are started anew: dask does not restart
a process that dies while it starts. Under heavy load a start takes ten seconds or more."""

MOST_RETRIES = 20
"""Retries of work that killed several workers, before the run gives up."""


@dataclass(frozen=True, slots=True, kw_only=True)
class WorkerPayload:
    """What every worker is sent once."""

    name: str  # the same for the same content
    spec: bytes  # the evaluator's spec, serialized
    versions: Mapping[str, str]  # package versions that all workers must have

    @classmethod
    def of(cls, spec: EvaluatorSpec) -> "WorkerPayload":
        """Return the payload of a run."""
        try:
            data = serialized(spec)
        except (pickle.PicklingError, AttributeError, TypeError) as error:
            allowed = "a penalty and a task that can be pickled"
            raise BadInputError("--cluster", str(error), allowed) from error
        return cls(
            name=sha256_of(data),
            spec=data,
            versions=package_versions(plugin_packages(spec.settings)),
        )


class DaskEvaluator:
    """The workers of a dask scheduler.

    Parameters
    ----------
    address
        ``local:N`` for N processes on this computer, else a scheduler's address
        (``tcp://host:8786``) or its file (``scheduler.json``).
    patience_s
        How long to wait without any worker.
    """

    def __init__(self, address: str, *, patience_s: float = PATIENCE_S) -> None:
        self.address = address
        self.count = self._local_count()
        self._patience_s = patience_s
        self._restart: Callable[[], object] | None = None
        if importlib.util.find_spec("distributed") is None:
            allowed = "only with the extra: pip install 'vinefab[cluster]'"
            raise BadInputError("--cluster", address, allowed)

    @contextmanager
    def started(self, evaluator: Evaluator, ledger: Ledger) -> Iterator[Begin]:
        """Connect to the workers for a run."""
        payload = WorkerPayload.of(evaluator.spec)
        with self._client() as client:
            ledger.workers = self.count = self._count_workers(client)
            # As a task that can be repeated, not as data that is lost with the worker that has it.
            sent = client.submit(_received, payload, key=f"vinefab-{payload.name}")
            evaluated = 0

            def begin(x: Floats, poses: Poses) -> Finish:
                usual_s = ledger.worked_s / evaluated if evaluated else 0.0
                parts = in_work_units(x, self._rows(len(x), usual_s))
                work = [client.submit(_evaluated, sent, p, poses, pure=False) for p in parts]

                def finish() -> Evaluations:
                    nonlocal evaluated
                    done = self._gathered(client, work)
                    for _, spent in done:
                        ledger.add(spent)
                    evaluated += len(x)
                    return Evaluations.concatenated([evaluations for evaluations, _ in done])

                return finish

            yield begin

    def _rows(self, count: int, usual_s: float) -> int:
        """Return how many points to send together: worth a round trip, but some per worker."""
        share = math.ceil(count / self.count)
        if usual_s <= 0.0:
            return share
        return min(share, max(math.ceil(ROUND_TRIP_S / usual_s), math.ceil(share / 4)))

    def _gathered(
        self,
        client: Any,  # noqa: ANN401 - distributed has no types
        futures: Sequence[Any],
    ) -> list[tuple[Evaluations, Work]]:
        """Return the results of futures, also when workers die meanwhile."""
        from distributed import KilledWorker  # noqa: PLC0415 - optional

        for _ in range(MOST_RETRIES):
            self._await(client, futures)
            try:
                return [deserialized(data) for data in client.gather(futures)]
            except KilledWorker:
                for future in futures:
                    if future.status == "error":
                        future.retry()
        problem = f"work that {MOST_RETRIES} times killed its workers"
        raise WorkersLostError(f"cluster {self.address}", problem)

    def _await(self, client: Any, futures: Sequence[Any]) -> None:  # noqa: ANN401 - as above
        """Wait until all futures are done or failed, as long as there are workers."""
        alone_since_s = started_s = time.monotonic()
        while unfinished := [future for future in futures if not future.done()]:
            now_s = time.monotonic()
            if client.nthreads():
                alone_since_s = started_s = now_s
            elif now_s - alone_since_s > self._patience_s:
                problem = f"no worker for {self._patience_s:g} s"
                raise WorkersLostError(f"cluster {self.address}", problem)
            elif self._restart is not None and now_s - started_s > RESTART_S:
                started_s = now_s
                self._restart()
            _wait(unfinished)

    def _local_count(self) -> int:
        """Return N of ``local:N``, or 1."""
        kind, _, count = self.address.partition(":")
        if kind != "local":
            if ":" in self.address or self.address.endswith(".json"):
                return 1
        elif count.isdecimal() and 1 <= int(count) <= 1024:
            return int(count)
        allowed = "local:N with N from 1 to 1024, tcp://HOST:PORT, or a scheduler's .json file"
        raise BadInputError("--cluster", self.address, allowed)

    @contextmanager
    def _client(self) -> Iterator[Any]:
        from distributed import Client, LocalCluster  # noqa: PLC0415 - optional

        if self.address.startswith("local:"):
            with (
                LocalCluster(  # type: ignore[no-untyped-call]
                    n_workers=self.count,
                    threads_per_worker=1,
                    dashboard_address=None,
                    memory_limit=0,
                    silence_logs="CRITICAL",
                ) as cluster,
                Client(cluster) as client,  # type: ignore[no-untyped-call]
            ):
                self._restart = lambda: (cluster.scale(0), cluster.scale(self.count))
                yield client
            return
        file = self.address.endswith(".json")
        if file and not _names_scheduler(Path(self.address)):
            # dask would wait until it appears, or end in a traceback
            allowed = "a file that a running dask scheduler wrote, tcp://HOST:PORT, or local:N"
            raise BadInputError("--cluster", self.address, allowed)
        where = {"scheduler_file": self.address} if file else {"address": self.address}
        try:
            client = Client(**where, timeout=CONNECT_S)  # type: ignore[no-untyped-call]
        except (OSError, ValueError) as error:
            allowed = f"a running dask scheduler ({' '.join(str(error).split())[:80]})"
            raise BadInputError("--cluster", self.address, allowed) from error
        with client:
            yield client

    def _count_workers(self, client: Any) -> int:  # noqa: ANN401 - as above
        """Return the number of worker threads, waiting for the first worker."""
        try:
            client.wait_for_workers(1, timeout=self._patience_s)
        except TimeoutError as error:
            problem = f"no worker within {self._patience_s:g} s"
            raise WorkersLostError(f"cluster {self.address}", problem) from error
        return sum(client.nthreads().values())


def _names_scheduler(path: Path) -> bool:
    """Return whether a file exists and holds the address of a scheduler."""
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return False
    return isinstance(document, dict) and isinstance(document.get("address"), str)


def _wait(unfinished: Sequence[Any]) -> None:
    from distributed import wait  # noqa: PLC0415 - optional

    try:
        wait(unfinished, timeout=POLL_S)  # type: ignore[no-untyped-call]
    except TimeoutError:
        return


def _received(payload: WorkerPayload) -> WorkerPayload:
    """Return a payload, as a dask task whose result the workers share."""
    return payload


def _evaluated(payload: WorkerPayload, x: Floats, poses: Poses) -> bytes:
    """Evaluate points on a worker and serialize the result."""
    own = _own_versions(tuple(payload.versions))
    if own != dict(payload.versions):
        other = next(name for name in payload.versions if own.get(name) != payload.versions[name])
        allowed = f"{other} {payload.versions[other]}, as the run has"
        raise BadInputError("a worker's version", f"{other} {own.get(other)}", allowed)
    try:
        with _BUILDING:
            evaluator = _evaluator(payload.name, payload.spec)
    except UnknownNameError as error:
        missing = f"without {error.kind} {error.name!r}"
        why = f" ({error.problem})" if error.problem else ""
        raise BadInputError("a worker", missing, f"{_INSTALLED}{why}") from None
    except (ImportError, AttributeError) as error:
        raise BadInputError("a worker", f"incomplete: {error}", _INSTALLED) from None
    return serialized(evaluator.evaluate(x, poses))


_INSTALLED = "workers with the same packages installed as where the run began"
_BUILDING = threading.Lock()


@lru_cache(maxsize=2)
def _own_versions(names: tuple[str, ...]) -> dict[str, str]:
    return package_versions(names)


@lru_cache(maxsize=2)
def _evaluator(name: str, spec: bytes) -> Evaluator:  # noqa: ARG001 - a short key for the cache
    return Evaluator.of(deserialized(spec))
