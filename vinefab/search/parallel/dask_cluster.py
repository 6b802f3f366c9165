"""Evaluating points on the workers of a dask cluster, on this computer or on many.

The package is loaded only when a cluster is asked for. Every worker makes the run's maps ready
once, from what the run is made of; then it is sent points and poses and sends back what they are
worth. Work on a worker that dies is done again by another. Points do not influence each other, so
results depend neither on the workers nor on how the work was cut.
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
from vinefab.search.evaluation import Evaluations
from vinefab.search.evaluator import Evaluator, EvaluatorSpec
from vinefab.search.parallel.evaluators import Begin, Finish
from vinefab.search.parallel.executor import in_work_units
from vinefab.search.record.identity import plugin_packages
from vinefab.search.record.result import package_versions
from vinefab.search.record.timing import Ledger, Work
from vinefab.tasks.evaluate import Poses


class _Pickler(pickle.Pickler):
    """Packs read-only views of dictionaries as what they show."""

    def reducer_override(self, thing: object) -> Any:  # noqa: ANN401 - pickle's own contract
        """Return how to make a view again; everything else is pickle's business."""
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


def deserialized(data: bytes) -> Any:  # noqa: ANN401 - whatever was packed
    """Return the object of `packed`; only for bytes from a worker or a run of one's own."""
    return pickle.loads(data)  # noqa: S301


TRIP_S = 0.1
"""Work in one piece that is sent: a trip there and back takes some milliseconds."""

PATIENCE_S = 300.0
"""How long a run waits without any worker before it gives up."""

CONNECT_S = 10.0
"""How long a scheduler may take to answer the first call."""

LOOK_S = 2.0
"""How often it looks whether there are workers."""

REHIRE_S = 60.0
"""A process of this computer that dies while it starts is not started again by dask: new ones are
made when there has been none for so long. Under heavy load a start takes ten seconds or more."""

MOST_DEATHS = 20
"""So often work is given out anew after it killed several workers; then it must be the work."""

Sent = tuple[Evaluations, Work]


@dataclass(frozen=True, slots=True, kw_only=True)
class WorkerPayload:
    """What every worker is sent once."""

    name: str  # the same for the same content
    brief: bytes  # what the run is made of, pickled
    versions: Mapping[str, str]  # those that all must have

    @classmethod
    def of(cls, brief: EvaluatorSpec) -> "WorkerPayload":
        """Return the parcel of a run."""
        try:
            data = serialized(brief)
        except (pickle.PicklingError, AttributeError, TypeError) as error:
            allowed = "a penalty that can be pickled"
            raise BadInputError("--cluster", str(error), allowed) from error
        return cls(
            name=sha256_of(data),
            brief=data,
            versions=package_versions(plugin_packages(brief.settings)),
        )


class DaskEvaluator:
    """The workers of a dask scheduler.

    Parameters
    ----------
    address
        ``local:N`` for N processes on this computer, else a scheduler's address
        (``tcp://host:8786``) or its file (``scheduler.json``).
    """

    def __init__(self, address: str, *, patience_s: float = PATIENCE_S) -> None:
        self.address = address
        self.count = self._local_count()
        self._patience_s = patience_s
        self._rehire: Callable[[], object] | None = None
        if importlib.util.find_spec("distributed") is None:
            allowed = "only with the extra: pip install 'vinefab[cluster]'"
            raise BadInputError("--cluster", address, allowed)

    @contextmanager
    def hired(self, trial: Evaluator, ledger: Ledger) -> Iterator[Begin]:
        """Offer a function that has points evaluated by the workers."""
        parcel = WorkerPayload.of(trial.brief)
        with self._client() as client:
            ledger.workers = self.count = self._count_workers(client)
            # As work that can be done again, not as data that dies with the worker that holds it.
            sent = client.submit(_received, parcel, key=f"vinefab-{parcel.name}")
            evaluated = 0

            def begin(x: Floats, poses: Poses) -> Finish:
                usual_s = ledger.worked_s / evaluated if evaluated else 0.0
                pieces = in_work_units(x, self._rows(len(x), usual_s))
                work = [client.submit(_evaluated, sent, p, poses, pure=False) for p in pieces]

                def finish() -> Evaluations:
                    nonlocal evaluated
                    done = self._gathered(client, work)
                    for _, spent in done:
                        ledger.add(spent)
                    evaluated += len(x)
                    return Evaluations.joined([found for found, _ in done])

                return finish

            yield begin

    def _rows(self, count: int, usual_s: float) -> int:
        """Return how many points to send together: worth a trip, but something for everybody."""
        share = math.ceil(count / self.count)
        if usual_s <= 0.0:
            return share
        return min(share, max(math.ceil(TRIP_S / usual_s), math.ceil(share / 4)))

    def _gathered(
        self,
        client: Any,  # noqa: ANN401 - distributed has no types
        futures: Sequence[Any],
    ) -> list[Sent]:
        """Return what pieces of work are worth, whoever dies meanwhile."""
        from distributed import KilledWorker  # noqa: PLC0415 - loaded when it is asked for

        for _ in range(MOST_DEATHS):
            self._await(client, futures)
            try:
                return [deserialized(data) for data in client.gather(futures)]
            except KilledWorker:
                for future in futures:
                    if future.status == "error":
                        future.retry()
        problem = f"work that {MOST_DEATHS} times killed those who did it"
        raise WorkersLostError(f"cluster {self.address}", problem)

    def _await(self, client: Any, futures: Sequence[Any]) -> None:  # noqa: ANN401 - as above
        """Wait until all is done or failed, as long as there are workers."""
        alone_since_s = hired_s = time.monotonic()
        while unfinished := [future for future in futures if not future.done()]:
            now_s = time.monotonic()
            if client.nthreads():
                alone_since_s = hired_s = now_s
            elif now_s - alone_since_s > self._patience_s:
                problem = f"no worker for {self._patience_s:g} s"
                raise WorkersLostError(f"cluster {self.address}", problem)
            elif self._rehire is not None and now_s - hired_s > REHIRE_S:
                hired_s = now_s
                self._rehire()
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
        from distributed import Client, LocalCluster  # noqa: PLC0415

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
                self._rehire = lambda: (cluster.scale(0), cluster.scale(self.count))
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
        """Return how many tasks can be worked on at once, waiting for the first worker."""
        try:
            client.wait_for_workers(1, timeout=self._patience_s)
        except TimeoutError as error:
            problem = f"no worker within {self._patience_s:g} s"
            raise WorkersLostError(f"cluster {self.address}", problem) from error
        return sum(client.nthreads().values())


def _names_scheduler(path: Path) -> bool:
    """Return whether a file is there and says where a scheduler is."""
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return False
    return isinstance(document, dict) and isinstance(document.get("address"), str)


def _wait(unfinished: Sequence[Any]) -> None:
    from distributed import wait  # noqa: PLC0415

    try:
        wait(unfinished, timeout=LOOK_S)  # type: ignore[no-untyped-call]
    except TimeoutError:
        return


def _received(parcel: WorkerPayload) -> WorkerPayload:
    """Stand for a parcel among the workers."""
    return parcel


def _evaluated(parcel: WorkerPayload, x: Floats, poses: Poses) -> bytes:
    """Evaluate points on a worker and pack what they are worth."""
    own = _own_versions(tuple(parcel.versions))
    if own != dict(parcel.versions):
        other = next(name for name in parcel.versions if own.get(name) != parcel.versions[name])
        allowed = f"{other} {parcel.versions[other]}, as the run has"
        raise BadInputError("a worker's version", f"{other} {own.get(other)}", allowed)
    try:
        with _MAKING:
            trial = _trial(parcel.name, parcel.brief)
    except UnknownNameError as error:
        missing = f"without {error.kind} {error.name!r}"
        why = f" ({error.problem})" if error.problem else ""
        raise BadInputError("a worker", missing, f"{_INSTALLED}{why}") from None
    except (ImportError, AttributeError) as error:
        raise BadInputError("a worker", f"without something: {error}", _INSTALLED) from None
    return serialized(trial.evaluate(x, poses))


_INSTALLED = "workers on which the same packages are installed as where the run was begun"
_MAKING = threading.Lock()


@lru_cache(maxsize=2)
def _own_versions(names: tuple[str, ...]) -> dict[str, str]:
    return package_versions(names)


@lru_cache(maxsize=2)
def _trial(name: str, brief: bytes) -> Evaluator:  # noqa: ARG001 - the name is cheaper to compare
    made = deserialized(brief)
    return Evaluator.of(made.settings, made.maps, made.penalty)
