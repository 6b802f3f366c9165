"""Evaluation of points on the workers of a dask cluster, on this computer or on many.

Dask is loaded only when a cluster is used. Every worker builds the run's evaluator once, from its
spec; then it gets points and poses and returns evaluations. Work on a worker that dies is repeated
by another. Points do not influence each other, so results depend neither on the workers nor on how
the points are divided.

`PlacedRun` decides by measured times whether a generation goes to the cluster. The simulated
cluster of ``examples/draw_cluster_scaling.py`` divides and places work with the same functions.
"""

import json
import math
import pickle
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from vinefab.core.errors import BadInputError, UnfitInputError, UnknownNameError, WorkersLostError
from vinefab.core.extras import ensure_extra
from vinefab.core.front_door import imported_later
from vinefab.core.hashing import sha256_of
from vinefab.core.interruption import stops_deferred
from vinefab.core.validation import Floats, Ints, whole
from vinefab.model.design import MOST_BRANCHES
from vinefab.model.files.run_context import package_versions
from vinefab.search.evaluator import (
    SHARE_LEFT,
    Begin,
    Evaluations,
    Evaluator,
    EvaluatorSpec,
    Finish,
    Ledger,
    ThreadEvaluator,
    Work,
    in_work_units,
)
from vinefab.search.record.generations import plugin_packages
from vinefab.tasks.evaluate import Conditions

if TYPE_CHECKING:
    import distributed
else:
    distributed = imported_later("distributed")


EFFICIENCY = 0.9
"""Share of their time that workers are assumed to evaluate in, until it is measured."""


@dataclass(frozen=True, slots=True, kw_only=True)
class HandingOut:
    """What it costs to have work done by other processes."""

    round_trip_s: float  # from handing out one empty work unit to its result
    per_unit_s: float  # for each work unit more
    start_s: float = 0.0  # assumed, until workers have started and loaded code; 0: they have

    def overhead_s(self, units: int) -> float:
        """Return the time that a generation of so many work units takes on top of the work."""
        return self.round_trip_s + (units - 1) * self.per_unit_s


def least_unit_s(work_s: float, workers: int, costs: HandingOut) -> float:
    """Return the least work of a unit that is worth handing out.

    Units are handed out one after the other and worked off in parallel. N workers are kept
    busy by units of work N c, if each costs c. With more workers than that leaves units for, n
    units of a work W take n c + W / n on n of them, which is least for units of work sqrt(W c).
    """
    # Largest share of the cost of a unit in its work, as long as there are few workers.
    most_waste = 0.05
    busy_s = max(workers, 1.0 / most_waste) * costs.per_unit_s
    return min(busy_s, math.sqrt(max(0.0, work_s) * costs.per_unit_s))


def unit_rows(weights: Floats, workers: int, least: float) -> list[Ints]:
    """Divide points into work units: the heaviest first, and smaller units towards the end.

    Only points that are heavier than a least unit are sorted. The others stay in their order:
    units of large designs alone, more than fit into a processor's caches, take a seventh longer.

    Parameters
    ----------
    weights
        Work of each point, in any unit, shape (m,), m at least 1; all above 0.
    workers
        How many there are.
    least
        Least work of a unit, the last one excepted.

    Returns
    -------
    list of arrays
        The rows of each unit.
    """
    order = np.argsort(-np.where(weights > least, weights, 0.0), kind="stable")
    until = np.cumsum(weights[order])
    middle = until - 0.5 * weights[order]
    units, first, done = list[Ints](), 0, 0.0
    while first < len(order):
        share = max((until[-1] - done) / (SHARE_LEFT * workers), least)
        last = max(first + 1, int(np.searchsorted(middle, done + share)))
        units.append(order[first:last])
        first, done = last, float(until[last - 1])
    return units


@dataclass(frozen=True, slots=True, kw_only=True)
class Pace:
    """How fast a run is evaluated here and on a cluster, as far as it was measured."""

    threads: int  # here; 0: nothing is to be evaluated here
    workers: int
    costs: HandingOut
    work_s: float  # processor time per weight of points
    here_s: float | None = None  # time per weight in the threads; None: not measured yet
    there_s: float | None = None  # time per weight on the cluster without the overhead

    def units(self, weights: Floats) -> list[Ints]:
        """Return the rows of each work unit for the cluster."""
        weight = float(weights.sum())
        if self.work_s <= 0.0:  # not measured yet: the same for every worker
            return unit_rows(weights, self.workers, weight / self.workers)
        least_s = least_unit_s(self.work_s * weight, self.workers, self.costs)
        return unit_rows(weights, self.workers, least_s / self.work_s)

    def seconds_here(self, weight: float) -> float:
        """Return the time that points take in the threads here."""
        usual_s = self.work_s / (EFFICIENCY * max(1, self.threads))
        return weight * (usual_s if self.here_s is None else self.here_s)

    def seconds_there(self, weights: Floats) -> float:
        """Return the time that points take on the cluster."""
        usual_s = self.work_s / (EFFICIENCY * self.workers)
        working_s = float(weights.sum()) * (usual_s if self.there_s is None else self.there_s)
        return self.costs.overhead_s(len(self.units(weights))) + working_s

    def goes_there(self, weights: Floats, generations: int) -> bool:
        """Return whether to hand points out, with so many generations like them to come."""
        if self.threads == 0:
            return True
        if self.workers == 0:  # not there yet
            return False
        gain_s = self.seconds_here(float(weights.sum())) - self.seconds_there(weights)
        return gain_s * generations > self.costs.start_s

    def after(
        self, weights: Floats, seconds: float | None, work_s: float, *, there: bool
    ) -> "Pace":
        """Return the pace after points took so long, here or there; None: no typical time."""
        if seconds is None:  # with the loading of code in both
            return self
        weight = float(weights.sum())
        measured = replace(self, work_s=work_s / weight)
        if not there:
            return replace(measured, here_s=seconds / weight)
        working_s = max(0.0, seconds - self.costs.overhead_s(len(self.units(weights))))
        return replace(measured, there_s=working_s / weight)

    def text(self, weights: Floats) -> str:
        """Return the times that a decision rests on."""
        weight, costs = float(weights.sum()), self.costs
        trip = f" with a round trip of {1e3 * costs.round_trip_s:.0f} ms (measured)"
        start = f" once they have started, {costs.start_s:.0f} s (assumed)"
        there = "no worker had come"
        if self.workers:
            plural = "" if self.workers == 1 else "s"
            seconds = self.seconds_there(weights)
            there = f"{seconds:.2g} s on {self.workers} worker{plural}"
            there += start if costs.start_s else trip
        return (
            f"{weight * self.work_s:.2g} s of work (measured), expected to take "
            f"{self.seconds_here(weight):.2g} s on {self.threads} "
            f"thread{'' if self.threads == 1 else 's'} here, {there}"
        )


def point_weights(evaluator: Evaluator, x: Floats, conditions: Conditions) -> Floats:
    """Return the work of each point in branches to grow; too large a design grows none."""
    sizes = evaluator.space.batch(x).sizes
    growths = sum(len(places) for places in conditions.poses)
    return np.where(sizes > MOST_BRANCHES, 1.0, 1.0 + sizes) * max(1, growths)


class RemoteWorkers(Protocol):
    """The workers of a cluster."""

    def connect(self, *, wait_s: float) -> int:
        """Return the number of workers, started or waited for at most so long; 0: none yet."""
        ...

    def costs(self) -> HandingOut:
        """Return the costs of handing out; assumed before `connect`, then measured."""
        ...

    def begin(self, x: Floats, conditions: Conditions, units: Sequence[Ints]) -> Finish:
        """Begin to evaluate points in work units of some rows each."""
        ...


class PlacedRun:
    """A run whose generations are evaluated here or by remote workers, where it is done sooner.

    Parameters
    ----------
    here
        Evaluates points in threads.
    threads
        How many; 0: everything is handed out.
    workers
        Number of remote workers that there are or would be started; 0: not known yet.
    """

    def __init__(
        self,
        evaluator: Evaluator,
        ledger: Ledger,
        remote: RemoteWorkers,
        *,
        here: Begin,
        threads: int,
        workers: int,
    ) -> None:
        self._evaluator, self._ledger = evaluator, ledger
        self._remote, self._here = remote, here
        self._left = evaluator.spec.settings.search.generations
        self._has_worked_there, self._most_there = False, 0
        self._heaviest_s, self._last_large = 0.0, ""
        self.pace = Pace(threads=threads, workers=workers, costs=remote.costs(), work_s=0.0)
        self.batches, self.handed_out = 0, 0  # of designs: generations, finalists

    def begin(self, x: Floats, conditions: Conditions) -> Finish:
        """Begin to evaluate points."""
        self.batches += 1
        self._left = max(1, self._left - 1)
        if self.pace.threads == 0 or self.pace.work_s > 0.0:
            return self._placed(x, conditions)
        first = self._sample(x, conditions)
        rest = x[len(first.penalty) :]
        if not len(rest):
            self._decide(point_weights(self._evaluator, x, conditions))
            return lambda: first
        finish = self._placed(rest, conditions)
        return lambda: Evaluations.concatenated([first, finish()])

    @property
    def decision(self) -> str:
        """What was decided and why, for the user."""
        why = f"the last large one had {self._last_large}"
        if self.pace.threads == 0:
            why = "as --workers 0 asks"
        return f"handed out {self.handed_out} of {self.batches} batches of designs; {why}"

    def _sample(self, x: Floats, conditions: Conditions) -> Evaluations:
        """Evaluate the first points here, as many as it takes to time them."""
        parts, done, work_s = [self._here(x[:1], conditions)()], 1, 0.0
        # Work that is evaluated here, at the beginning of a run, to know how much a generation is.
        sample_s = 0.05
        while work_s < sample_s and done < len(x):
            part, work = self._evaluator.evaluate(x[done : 2 * done], conditions)
            self._ledger.add(work)
            parts.append(part)
            done, work_s = min(2 * done, len(x)), work_s + work.worked_s
        if done > 1:  # the first point was evaluated while code was loaded
            weight = float(point_weights(self._evaluator, x[1:done], conditions).sum())
            self.pace = replace(self.pace, work_s=work_s / weight)
        return Evaluations.concatenated(parts)

    def _placed(self, x: Floats, conditions: Conditions) -> Finish:
        """Begin to evaluate points where it is done sooner, and time them."""
        weights = point_weights(self._evaluator, x, conditions)
        there = self._decide(weights)
        pace, began_s, worked_s = self.pace, time.perf_counter(), self._ledger.worked_s
        if there:
            self.handed_out += 1
            finish = self._remote.begin(x, conditions, pace.units(weights))
        else:
            finish = self._here(x, conditions)
        # Workers load compiled code first, which says nothing of the next generation.
        is_typical = not there or self._has_worked_there
        if there and not self._has_worked_there:
            self._has_worked_there = True
            self.pace = replace(pace, costs=replace(pace.costs, start_s=0.0))

        def timed() -> Evaluations:
            evaluations = finish()
            seconds, work_s = time.perf_counter() - began_s, self._ledger.worked_s - worked_s
            self.pace = self.pace.after(
                weights, seconds if is_typical else None, work_s, there=there
            )
            return evaluations

        return timed

    def _decide(self, weights: Floats) -> bool:
        """Return whether to hand out points; connect to the workers where that is worth it."""
        if self.pace.workers == 0 or self.pace.goes_there(weights, self._left):
            wait_s = self.pace.seconds_here(float(weights.sum())) if self.pace.threads else math.inf
            workers = self._remote.connect(wait_s=wait_s)
            costs = self._remote.costs()
            if self._has_worked_there:
                costs = replace(costs, start_s=0.0)
            self.pace = replace(self.pace, workers=workers, costs=costs)
        there = self.pace.goes_there(weights, self._left)
        self._most_there = max(self._most_there, self.pace.workers)
        self._ledger.workers = self._most_there if there else max(1, self.pace.threads)
        work_s = self.pace.work_s * float(weights.sum())
        self._heaviest_s = max(self._heaviest_s, work_s)
        if work_s >= 0.5 * self._heaviest_s:  # finalists are few
            self._last_large = self.pace.text(weights)
        return there


def serialized(thing: object) -> bytes:
    """Return an object as bytes."""
    return pickle.dumps(thing, protocol=pickle.HIGHEST_PROTOCOL)


def deserialized(data: bytes) -> Any:  # noqa: ANN401 - any object
    """Return the object of `serialized`; only for bytes from a worker or the user's own run."""
    return pickle.loads(data)  # noqa: S301


LOADING_S = 5.0
"""How long workers take to load compiled code, where it was compiled before."""

ASSUMED_COSTS = HandingOut(round_trip_s=0.02, per_unit_s=0.002, start_s=2.0 * LOADING_S)
"""Of workers of this computer before they are started, which takes as long as loading."""


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
            problem = f"penalty or task cannot be pickled ({error})"
            raise UnfitInputError("--cluster", problem, "define them in a module") from None
        return cls(
            name=sha256_of(data),
            spec=data,
            versions=package_versions(plugin_packages(spec.settings)),
        )


class DaskEvaluator:
    """The workers of a dask scheduler, and threads here for work too small to hand out.

    The first designs are evaluated here and timed; then every generation goes to the
    place measured as faster. Workers of this computer are started only when that pays.

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
        self.address, self.count = address, 1  # of workers here, for local:N
        kind, _, number = address.partition(":")
        self._is_local = kind == "local" and number.isdecimal() and 1 <= int(number) <= 1024
        if self._is_local:
            self.count = int(number)
        elif kind == "local" or not (":" in address or address.endswith(".json")):
            allowed = "local:N with N from 1 to 1024, tcp://HOST:PORT, or a scheduler's .json file"
            raise BadInputError("--cluster", address, allowed)
        usual = self.count
        self.threads = whole("workers", usual if threads is None else threads, 0, 1024)
        self.notes: tuple[str, ...] = ()
        self._patience_s = patience_s
        self._restart: Callable[[], object] | None = None
        ensure_extra("cluster", f"--cluster {address}")

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

    def _gathered(
        self,
        client: Any,  # noqa: ANN401 - distributed has no types
        futures: Sequence[Any],
    ) -> list[Any]:
        """Return the results of futures, also when workers die meanwhile."""
        most_retries = 20  # retries of work that killed several workers, before the run gives up
        for _ in range(most_retries):
            self._await(client, futures)
            try:
                return list(client.gather(futures))
            except distributed.KilledWorker:
                for future in futures:
                    if future.status == "error":
                        future.retry()
        problem = f"work that {most_retries} times killed its workers"
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

    @contextmanager
    def _client(self) -> Iterator[Any]:
        if self._is_local:
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
            problem = f"no dask scheduler answers at {self.address}"
            problem += f" ({' '.join(str(error).split())[:80]})"
            raise UnfitInputError("--cluster", problem, "start one, or check the address") from None
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
                stack.enter_context(
                    distributed.dask.config.set(_without_http())
                )  # also for later workers
                stack.enter_context(distributed.dask.config.set({"temporary-directory": private}))
                try:
                    local = distributed.LocalCluster(  # type: ignore[no-untyped-call]
                        n_workers=self.count,
                        threads_per_worker=1,
                        security=distributed.Security.temporary(),  # type: ignore[no-untyped-call]
                        # A fixed port would be taken, and a warning given, where another cluster
                        # runs.
                        scheduler_kwargs={
                            "dashboard": False,
                            "dashboard_address": "127.0.0.1:0",
                        },
                        local_directory=private,
                        memory_limit=0,
                        silence_logs="CRITICAL",
                    )
                except RuntimeError as error:
                    problem = f"a worker ended while it started ({error})"
                    raise WorkersLostError(f"cluster {self.address}", problem) from error
                cluster = stack.enter_context(local)
                client = stack.enter_context(distributed.Client(cluster))  # type: ignore[no-untyped-call]
                self._restart = lambda: (cluster.scale(0), cluster.scale(self.count))
            yield client
        finally:
            with stops_deferred():
                stack.close()

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
        """Return the costs of handing out."""
        return self._costs or ASSUMED_COSTS

    def _measured_costs(self) -> HandingOut:
        """Measure what it costs to hand out work units that do nothing."""
        client, times_s = self._client, []
        probes = 16  # empty work units that are handed out to measure what that costs
        for count in (1, probes, 1, probes):  # the first ones open connections
            began_s = time.perf_counter()
            work = [client.submit(abs, number, pure=False) for number in range(count)]
            self._cluster._gathered(client, work)
            times_s.append(time.perf_counter() - began_s)
        one_s = min(times_s[0::2])
        per_unit_s = max(1e-5, (min(times_s[1::2]) - one_s) / (probes - 1))
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
        raise BadInputError("--cluster", address, f"{allowed} ({error})") from None
    for name, file in given[:2]:  # the key may be part of the certificate's file
        if file is None:
            raise BadInputError("--cluster", address, f"{allowed} ({name} is not set)")


def _without_http() -> dict[str, list[str]]:
    """Return settings of dask with which its servers answer only to TLS certificates."""
    settings: dict[str, list[str]] = {}
    # Not dask's own: settings of its servers are there once distributed is loaded.
    present = distributed.dask.config
    for server in ("scheduler", "worker"):
        preload = f"distributed.{server}.preload"
        # Modules whose `dask_setup` is called with every server: the user's and this one.
        settings[preload] = [*present.get(preload), __name__]
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
    own = package_versions(payload.versions)
    if own != dict(payload.versions):
        other = next(name for name in payload.versions if own.get(name) != payload.versions[name])
        problem = f"it has {other} {own.get(other)}, and the run {payload.versions[other]}"
        raise UnfitInputError("a worker", problem, "install the version of the run")
    try:
        with _BUILDING:
            evaluator = _evaluator(payload.name, payload.spec)
    except UnknownNameError as error:
        why = f" ({error.problem})" if error.problem else ""
        problem = f"it has no {error.kind} {error.name!r}{why}"
        raise UnfitInputError("a worker", problem, _INSTALLED) from None
    except (ImportError, AttributeError) as error:
        raise UnfitInputError("a worker", f"it is incomplete: {error}", _INSTALLED) from None
    met = _conditions(conditions)
    if not any(known is met for known, _ in evaluator.ready):
        evaluator.prepare_launches([met])
    parts = [evaluator.evaluate(part, met) for part in in_work_units(x, TOGETHER)]
    evaluations = Evaluations.concatenated([part for part, _ in parts])
    return serialized((evaluations, Work.total([spent for _, spent in parts])))


_INSTALLED = "install the same packages on workers as where the run began"
_BUILDING = threading.Lock()


@lru_cache(maxsize=2)
def _evaluator(name: str, spec: bytes) -> Evaluator:  # noqa: ARG001 - a short key for the cache
    return Evaluator.of(deserialized(spec))


@lru_cache(maxsize=2)
def _conditions(data: bytes) -> Conditions:
    """Return the same object for the same conditions: what is prepared for it is found again."""
    conditions: Conditions = deserialized(data)
    return conditions
