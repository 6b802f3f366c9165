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
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from vinefab.core.compiling import imported_later
from vinefab.core.errors import BadInputError, UnknownNameError, WorkersLostError
from vinefab.core.hashing import sha256_of
from vinefab.core.interruption import stops_deferred
from vinefab.core.validation import Floats, Ints, whole
from vinefab.search.evaluator import Evaluations, Evaluator, EvaluatorSpec
from vinefab.search.parallel.executor import in_work_units
from vinefab.search.parallel.point_evaluator import Begin, Finish, ThreadEvaluator
from vinefab.search.parallel.work_placement import HandingOut, PlacedRun
from vinefab.search.record.generations import plugin_packages
from vinefab.search.record.identity import package_versions
from vinefab.search.timing import Ledger, Work
from vinefab.tasks.evaluate import Conditions

if TYPE_CHECKING:
    import dask
    import distributed
else:
    dask = imported_later("dask")
    distributed = imported_later("distributed")


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


LOADING_S = 5.0
"""How long workers take to load compiled code, where it was compiled before."""

ASSUMED_COSTS = HandingOut(round_trip_s=0.02, per_unit_s=0.002, start_s=2.0 * LOADING_S)
"""Of workers of this computer before they are started, which takes as long as loading."""

PROBES = 16
"""Empty work units that are handed out to measure what that costs."""

TOGETHER = 125
"""Designs that a worker evaluates together. They are grown by size, and the large ones of a
thousand take a seventh longer than in eight parts: their branches do not stay in the caches."""

_PATIENCE_S = 300.0
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


NEEDED = ("distributed", "cryptography")
"""What the extra installs: the cluster, and what makes the certificates of a local one."""

TLS_FILES = {
    "DASK_DISTRIBUTED__COMM__TLS__CA_FILE": "tls_ca_file",
    "DASK_DISTRIBUTED__COMM__TLS__CLIENT__CERT": "tls_client_cert",
    "DASK_DISTRIBUTED__COMM__TLS__CLIENT__KEY": "tls_client_key",
}
"""Environment variables of dask that name the files for ``tls://``."""


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
    """The workers of a dask scheduler, and threads here for what is too little to hand out.

    The first designs are evaluated here and timed; then every generation goes where it is done
    sooner by what was measured. Workers of this computer are started only when that pays.

    Parameters
    ----------
    address
        ``local:N`` for N processes on this computer, else a scheduler's address
        (``tcp://host:8786``, ``tls://host:8786``) or its file (``scheduler.json``).
    threads
        How many threads evaluate here; 0: everything is handed out. None: N for ``local:N``, else
        one.
    patience_s
        How long to wait without any worker.
    """

    def __init__(
        self, address: str, *, threads: int | None = None, patience_s: float = _PATIENCE_S
    ) -> None:
        self.address = address
        self.count = self._local_count()
        usual = self.count if self._is_local else 1
        self.threads = whole("workers", usual if threads is None else threads, 0, 1024)
        self.notes: tuple[str, ...] = ()
        self._patience_s = patience_s
        self._restart: Callable[[], object] | None = None
        if any(importlib.util.find_spec(name) is None for name in NEEDED):
            allowed = "only with the extra: pip install 'vinefab[cluster]'"
            raise BadInputError("--cluster", address, allowed)

    @contextmanager
    def started(self, evaluator: Evaluator, ledger: Ledger) -> Iterator[Begin]:
        """Connect to the workers for a run; those of this computer are started when it pays."""
        with ExitStack() as stack:
            here = stack.enter_context(
                ThreadEvaluator(max(1, self.threads)).started(evaluator, ledger)
            )
            remote = _DaskWorkers(self, stack, WorkerPayload.of(evaluator.spec), ledger)
            workers = self.count
            if not self._is_local or self.threads == 0:
                workers = remote.connect(wait_s=0.0 if self.threads else math.inf)
            run = PlacedRun(
                evaluator, ledger, remote, here=here, threads=self.threads, workers=workers
            )
            try:
                yield run.begin
            finally:
                self.notes = (f"cluster {self.address}: {run.decision}",)

    @property
    def _is_local(self) -> bool:
        return self.address.startswith("local:")

    def _gathered(
        self,
        client: Any,  # noqa: ANN401 - distributed has no types
        futures: Sequence[Any],
    ) -> list[Any]:
        """Return the results of futures, also when workers die meanwhile."""
        for _ in range(MOST_RETRIES):
            self._await(client, futures)
            try:
                return list(client.gather(futures))
            except distributed.KilledWorker:
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
            with suppress(TimeoutError):
                distributed.wait(unfinished, timeout=POLL_S)  # type: ignore[no-untyped-call]

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
        if self.address.startswith("local:"):
            with self._local_client() as client:
                yield client
            return
        file = self.address.endswith(".json")
        scheduler = _address_in(Path(self.address)) if file else self.address
        if scheduler is None:
            # dask would wait until it appears, or end in a traceback
            allowed = "a file that a running dask scheduler wrote, tcp://HOST:PORT, or local:N"
            raise BadInputError("--cluster", self.address, allowed)
        if scheduler.startswith("tls:"):
            _check_tls_files(self.address)
        where = {"scheduler_file": self.address} if file else {"address": self.address}
        try:
            client = distributed.Client(**where, timeout=CONNECT_S)  # type: ignore[no-untyped-call]
        except (OSError, ValueError) as error:
            allowed = f"a running dask scheduler ({' '.join(str(error).split())[:80]})"
            raise BadInputError("--cluster", self.address, allowed) from error
        with client:
            yield client

    @contextmanager
    def _local_client(self) -> Iterator[Any]:
        """Start workers on this computer that only this run can use, and connect to them."""
        stack = ExitStack()
        try:
            # Begun and ended undisturbed: a half of a cluster can be neither used nor closed.
            with stops_deferred():
                # Private, because workers import from it: dask's own is shared by all users.
                folder = TemporaryDirectory(prefix="vinefab-", ignore_cleanup_errors=True)
                private = stack.enter_context(folder)
                stack.enter_context(dask.config.set(_without_http()))  # also for later workers
                stack.enter_context(dask.config.set({"temporary-directory": private}))
                cluster = stack.enter_context(self._local_cluster(private))
                client = stack.enter_context(distributed.Client(cluster))  # type: ignore[no-untyped-call]
                self._restart = lambda: (cluster.scale(0), cluster.scale(self.count))
            yield client
        finally:
            with stops_deferred():
                stack.close()

    def _local_cluster(self, folder: str) -> Any:  # noqa: ANN401 - as above
        try:
            return distributed.LocalCluster(  # type: ignore[no-untyped-call]
                n_workers=self.count,
                threads_per_worker=1,
                security=distributed.Security.temporary(),  # type: ignore[no-untyped-call]
                # A fixed port would be taken, and a warning given, beside another cluster.
                scheduler_kwargs={"dashboard": False, "dashboard_address": "127.0.0.1:0"},
                local_directory=folder,
                memory_limit=0,
                silence_logs="CRITICAL",
            )
        except RuntimeError as error:
            problem = f"a worker ended while it started ({error})"
            raise WorkersLostError(f"cluster {self.address}", problem) from error

    def _wait_for_workers(self, client: Any, wait_s: float) -> int:  # noqa: ANN401 - as above
        """Return the number of worker threads, waiting for the first worker; 0: none came."""
        count: int = sum(client.nthreads().values())
        if count == 0 and wait_s > 0.0:
            try:
                client.wait_for_workers(1, timeout=min(wait_s, self._patience_s))
            except TimeoutError as error:
                if wait_s > self._patience_s:
                    problem = f"no worker within {self._patience_s:g} s"
                    raise WorkersLostError(f"cluster {self.address}", problem) from error
            count = sum(client.nthreads().values())
        return count


class _DaskWorkers:
    """The workers of a scheduler during a run; `RemoteWorkers`."""

    def __init__(
        self, cluster: DaskEvaluator, stack: ExitStack, payload: WorkerPayload, ledger: Ledger
    ) -> None:
        self._cluster, self._stack, self._payload = cluster, stack, payload
        self._ledger = ledger
        self._client: Any = None  # distributed has no types
        self._sent: Any = None
        self._costs: HandingOut | None = None
        self._counted_s, self._count = -math.inf, 0

    def connect(self, *, wait_s: float) -> int:
        """Return the number of workers, which may change."""
        if self._client is None:
            self._client = self._stack.enter_context(self._cluster._client())
            # As a task that can be repeated, not as data that is lost with the worker that has it.
            key = f"vinefab-{self._payload.name}"
            self._sent = self._client.submit(_received, self._payload, key=key)
        now_s = time.monotonic()
        if now_s - self._counted_s > POLL_S or (self._count == 0 and wait_s > POLL_S):
            # Where all have gone, work that must be handed out waits for those that are restarted.
            had = self._count if wait_s == math.inf else 0
            self._count = self._cluster._wait_for_workers(self._client, 0.0 if had else wait_s)
            self._count, self._counted_s = self._count or had, now_s
        if self._count and self._costs is None:
            self._costs = self._measured_costs()
        return self._count

    def costs(self) -> HandingOut:
        """Return what handing out costs."""
        return self._costs or ASSUMED_COSTS

    def _measured_costs(self) -> HandingOut:
        """Measure what it costs to hand out work units that do nothing."""
        client, times_s = self._client, []
        for count in (1, PROBES, 1, PROBES):  # the first ones open connections
            began_s = time.perf_counter()
            work = [client.submit(abs, number, pure=False) for number in range(count)]
            self._cluster._gathered(client, work)
            times_s.append(time.perf_counter() - began_s)
        one_s = min(times_s[0::2])
        per_unit_s = max(1e-5, (min(times_s[1::2]) - one_s) / (PROBES - 1))
        return HandingOut(round_trip_s=one_s, per_unit_s=per_unit_s, start_s=LOADING_S)

    def begin(self, x: Floats, conditions: Conditions, units: Sequence[Ints]) -> Finish:
        """Hand out work units."""
        client, sent, data = self._client, self._sent, serialized(conditions)
        work = [client.submit(_evaluated, sent, x[rows], data, pure=False) for rows in units]

        def finish() -> Evaluations:
            done = [deserialized(data) for data in self._cluster._gathered(client, work)]
            for _, spent in done:
                self._ledger.add(spent)
            together = Evaluations.concatenated([evaluations for evaluations, _ in done])
            return together.reordered(np.argsort(np.concatenate(units)))

        return finish


def _address_in(path: Path) -> str | None:
    """Return the address of a scheduler that a file holds, or None."""
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    address = document.get("address") if isinstance(document, dict) else None
    return address if isinstance(address, str) else None


def _check_tls_files(address: str) -> None:
    """Refuse a ``tls://`` address without the files that it needs."""
    allowed = f"tls://HOST:PORT with PEM files named in {', '.join(TLS_FILES)}"
    try:
        security = distributed.Security()  # type: ignore[no-untyped-call]
        given = [(name, getattr(security, field)) for name, field in TLS_FILES.items()]
        for _, file in given:
            if file is not None and "\n" not in file:  # else the content itself
                Path(file).read_bytes()
        security.get_connection_args("client")  # type: ignore[no-untyped-call]
    except (OSError, ValueError, TypeError) as error:  # an SSLError is an OSError
        raise BadInputError("--cluster", address, f"{allowed} ({error})") from error
    for name, file in given[:2]:  # the key may be part of the certificate's file
        if file is None:
            raise BadInputError("--cluster", address, f"{allowed} ({name} is not set)")


def _without_http() -> dict[str, list[str]]:
    """Return settings of dask with which its servers answer only to TLS certificates."""
    settings: dict[str, list[str]] = {}
    for server in ("scheduler", "worker"):
        preload = f"distributed.{server}.preload"
        # Modules whose `dask_setup` is called with every server: the user's and this one.
        settings[preload] = [*dask.config.get(preload), __name__]
        settings[f"distributed.{server}.http.routes"] = []
    return settings


def dask_setup(server: Any) -> None:  # noqa: ANN401 - distributed has no types
    """Close the HTTP server that dask starts also without a dashboard; dask calls this by name."""
    server.http_server.stop()


def _received(payload: WorkerPayload) -> WorkerPayload:
    """Return a payload, as a dask task whose result the workers share."""
    return payload


def _evaluated(payload: WorkerPayload, x: Floats, conditions: bytes) -> bytes:
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
    met = _conditions(conditions)
    if not any(known is met for known, _ in evaluator.ready):
        evaluator.prepare_launches([met])
    parts = [evaluator.evaluate(part, met) for part in in_work_units(x, TOGETHER)]
    evaluations = Evaluations.concatenated([part for part, _ in parts])
    return serialized((evaluations, Work.total([spent for _, spent in parts])))


_INSTALLED = "workers with the same packages installed as where the run began"
_BUILDING = threading.Lock()


@lru_cache(maxsize=2)
def _own_versions(names: tuple[str, ...]) -> dict[str, str]:
    return package_versions(names)


@lru_cache(maxsize=2)
def _evaluator(name: str, spec: bytes) -> Evaluator:  # noqa: ARG001 - a short key for the cache
    return Evaluator.of(deserialized(spec))


@lru_cache(maxsize=2)
def _conditions(data: bytes) -> Conditions:
    """Return the same object for the same conditions: what is prepared for it is found again."""
    conditions: Conditions = deserialized(data)
    return conditions
