"""Compilation of kernels: the only module that imports numba, which takes half a second.

Modules with kernels are therefore imported when they are first used: see `front_door`.

Functions that call each other must stand in one file that imports no other module of vinefab: code
is cached by the content of the function's own file, of this one, and of all that its types name
(`vinefab.core.user_cache`).
"""

import heapq
import importlib
import importlib.util
import os
import pickle
import platform
import re
import subprocess
import sys
import threading
import time
import warnings
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cache
from importlib.machinery import SourceFileLoader
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any

from vinefab.core.errors import MissingPackageError, NotCachedWarning
from vinefab.core.hashing import sha256_of
from vinefab.core.helpers import helped
from vinefab.core.helpers import processors as _processors
from vinefab.core.progress import COMPILING, Progress, announce_to_all
from vinefab.core.user_cache import KeptFiles, cache_root

# mypy: allow-untyped-calls

_INTERPRETED = " (interpreted)"
"""Ends the names of modules whose functions are left to the interpreter."""

_PACKAGE = Path(__file__).resolve().parent.parent

# --- How functions are compiled ------------------------------------------------------------------


def compiled(function: Callable[..., Any]) -> Any:  # noqa: ANN401  a numba dispatcher
    """Compile a function, without the interpreter lock, keeping the code in the user's cache.

    If the cache cannot be written to, every process compiles anew.
    """
    if _is_interpreted(function):
        return function
    dispatcher = _jit(function)
    if dispatcher is not function:  # the user's NUMBA_DISABLE_JIT
        _hear_numba()
        dispatcher._cache = _code_cache(dispatcher)
    return dispatcher


def takes(*types: str, seconds: float) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Declare the types that a compiled function is called with: it can be compiled beforehand.

    Parameters
    ----------
    types
        One text for each set of arguments: ``f`` float, ``i`` int, ``j`` 32-bit int, ``b`` bool; a
        digit after it: an array of so many axes; then ``r``: that is read-only. A named tuple is
        ``vinefab.growth.arrays:Rules(f b f f f i f f)``. A function that is called with others is
        compiled then.
    seconds
        That compiling it takes: a weight among others, measured on one computer.
    """

    def declare(function: Callable[..., Any]) -> Callable[..., Any]:
        vars(function)[_TAKES] = (types, seconds)
        return function

    return declare


_TAKES = "takes"


def inlined(function: Callable[..., Any]) -> Any:  # noqa: ANN401  as above
    """Compile a function into its callers; Python itself cannot call it (see `interpreted`).

    Otherwise every call copies the descriptors of some twenty arrays: most of the time of a growth,
    which consists of many short calls. An entry for Python of each would take as long to compile as
    all the rest.
    """
    if _is_interpreted(function):
        return function
    return _jit(function, forceinline=True, no_cpython_wrapper=True, no_cfunc_wrapper=True)


def called(function: Callable[..., Any]) -> Any:  # noqa: ANN401  as above
    """Compile a function that compiled ones call at several places; Python itself cannot call it.

    Each copy of a large function takes as long to compile as the first.
    """
    if _is_interpreted(function):
        return function
    return _jit(function, no_cpython_wrapper=True, no_cfunc_wrapper=True)


@cache
def interpreted(name: str) -> ModuleType:
    """Return a module of compiled functions as one of plain Python functions.

    They do the same operations in the same order: the same results, to the last bit, some hundred
    times slower, but at once. Nothing of numba is loaded.
    """
    found = importlib.util.find_spec(name)
    loader = SourceFileLoader(name + _INTERPRETED, "" if found is None else str(found.origin))
    module = ModuleType(loader.name)
    loader.exec_module(module)
    return module


def rebindable(name: str) -> dict[str, Any]:
    """Return the names of a module as `interpreted` gives it, to be replaced one by one.

    Its functions are new ones, which find each other under these names: replacing one catches
    every call of it, and changes nothing elsewhere.
    """
    source = vars(interpreted(name))
    names: dict[str, Any] = dict(source)
    for key, part in source.items():
        if isinstance(part, FunctionType):
            names[key] = FunctionType(part.__code__, names, key)
    return names


@cache
def _join_conditions() -> None:
    """Let conditions joined with ``|`` and ``&`` take one jump, instead of one each.

    LLVM would take them apart again. Processors foresee few of a growth's conditions, and a wrong
    guess takes as long as a test of a wall: a tenth of the time of a growth. An option of LLVM,
    which may be set but once; it changes the form of code and none of its results.
    """
    from llvmlite import binding  # noqa: PLC0415  as numba

    binding.set_option("", "--jump-is-expensive")


@cache
def is_compiler_installed() -> bool:
    """Tell whether functions can be compiled: few branches are grown without, and all rules run."""
    return importlib.util.find_spec("numba") is not None


def _is_interpreted(function: Callable[..., Any]) -> bool:
    return function.__module__.endswith(_INTERPRETED)


def _jit(function: Callable[..., Any], **options: bool) -> Any:  # noqa: ANN401  a numba dispatcher
    if not is_compiler_installed():
        raise MissingPackageError("numba", "this command grows many branches, which")
    import numba  # noqa: PLC0415  not loaded where code is interpreted

    _join_conditions()
    # No compiled function allocates an array, so none needs the run-time that counts references to
    # arrays: atomic additions at every call, and half of the time of a growth (numba 0.68).
    settings: dict[str, Any] = {"nogil": True, "error_model": "numpy", "_nrt": False, **options}
    return numba.njit(**settings)(function)


# --- Code in the cache ---------------------------------------------------------------------------

_MOST_BYTES = 1 << 26
"""Of code in the cache; all of one version takes a thirtieth."""


def _own_code() -> KeptFiles:
    """Return the code that this computer compiled, for its processor alone."""
    return KeptFiles(cache_root() / "code", ".code", _MOST_BYTES)


def _brought_code() -> KeptFiles:
    """Return the code that the package brings for every processor of its kind."""
    return KeptFiles(_PACKAGE / "_shipped" / "code", ".code", _MOST_BYTES)


_UNREADABLE = (
    pickle.UnpicklingError,
    EOFError,
    ImportError,
    AttributeError,
    LookupError,
    TypeError,
    ValueError,
)
"""Errors that pickle raises where a name is gone."""


def _code_cache(dispatcher: Any) -> Any:  # noqa: ANN401  numba's, both
    """Return a cache of a function's code for numba, by the content of all that it is made from."""
    from numba.core import caching, compiler  # noqa: PLC0415  as numba

    function = dispatcher.py_func
    source = _source(Path(function.__code__.co_filename))

    class CodeCache(caching._Cache):
        @property
        def cache_path(self) -> str:
            return str(_own_code().folder)

        own_only = False
        """Whether code that the package brings is passed over."""

        def places(
            self, types: tuple[Any, ...], *, own_only: bool = False
        ) -> Iterator[tuple[KeptFiles, str]]:
            """Yield where code for some types may be: of this processor, of every processor."""
            _, *processor = dispatcher.targetctx.codegen().magic_tuple()
            if source is None:
                return
            yield _own_code(), _code_name(function, source, types, processor)
            if not own_only:
                yield _brought_code(), _code_name(function, source, types, _ANY_PROCESSOR)

        def load_overload(self, types: tuple[Any, ...], target: Any) -> Any:  # noqa: ANN401
            target.refresh()
            for kept, name in self.places(types, own_only=self.own_only):
                code = kept.read(name)
                if code is not None:
                    with suppress(*_UNREADABLE):
                        parts = pickle.loads(code)  # noqa: S301  as it was written, see `read`
                        return compiler.CompileResult._rebuild(target, *parts)
            return None

        def save_overload(self, types: tuple[Any, ...], result: Any) -> None:  # noqa: ANN401
            from numba.core.serialize import dumps  # noqa: PLC0415  as numba

            for kept, name in self.places(types):
                try:
                    kept.write(name, dumps(result._reduce()))
                except OSError as error:
                    _note_not_cached(kept.folder, error.strerror)
                return

        def enable(self) -> None:
            """Do nothing: it is in use as long as it exists."""

        disable = flush = enable

    return CodeCache()


_ANY_PROCESSOR = ["generic", ""]


@cache
def _note_not_cached(folder: Path, reason: str | None) -> None:
    """Say, once in a process, that code is not kept."""
    words = f"{folder}: compiled code is not cached ({reason}): each command compiles anew"
    warnings.warn(f"{words}; VINEFAB_CACHE_DIR names another folder", NotCachedWarning, 2)


@cache
def _source(path: Path) -> str | None:
    """Return a digest of the text of a function's file and of this one; None if one has no text."""
    try:
        return sha256_of(b"\0".join(one.read_bytes() for one in (path, Path(__file__))))
    except OSError:
        return None


def _code_name(
    function: Callable[..., Any], source: str, types: tuple[Any, ...], processor: list[str]
) -> str:
    """Return the name of a file of code: it changes with everything that the code depends on."""
    import llvmlite  # noqa: PLC0415  as numba
    import numba  # noqa: PLC0415

    settings = [str(getattr(numba.config, name, "")) for name in _SETTINGS]
    python = [str(sys.implementation.cache_tag), sys.platform, platform.machine().lower()]
    versions = [numba.__version__, llvmlite.__version__, *python, str(sys.maxsize)]
    parts = [source, *versions, *settings, *processor, *(_type_text(one) for one in types)]
    name = _name(function)
    return f"{name}-{sha256_of('|'.join([name, *parts]).encode())[:32]}"


_SETTINGS = ("OPT", "BOUNDSCHECK", "DEBUGINFO_DEFAULT", "LOOP_VECTORIZE", "SLP_VECTORIZE")
"""Of numba, which change code."""


def _name(function: Callable[..., Any]) -> str:
    """Return the name of a compiled function: ``growth.kernel.grow_jobs``."""
    name = f"{function.__module__}.{function.__qualname__}".removeprefix("vinefab.")
    return re.sub(r"[^\w.]", "_", name)


def _type_text(one: Any) -> str:  # noqa: ANN401  a type of numba
    """Return all that a type is, names of a named tuple's fields too."""
    if not hasattr(one, "instance_class"):
        return str(one)
    tuple_class = one.instance_class
    fields = zip(tuple_class._fields, one, strict=True)
    inside = ", ".join(f"{name}: {_type_text(part)}" for name, part in fields)
    return f"{tuple_class.__module__}.{tuple_class.__qualname__}({inside})"


_WORD = re.compile(r"(?P<module>[\w.]+):(?P<name>\w+)\(|(?P<kind>[fijb])(?P<axes>\d?)(?P<fixed>r?)")


def _types(text: str) -> tuple[Any, ...]:
    """Return the types that a text of `takes` names."""
    from numba.core import types  # noqa: PLC0415  as numba

    kinds = {"f": types.float64, "i": types.int64, "j": types.int32, "b": types.boolean}
    words = deque(re.findall(r"[^\s()]+\(?|\)", text))

    def read() -> Iterator[Any]:
        while words and (word := words.popleft()) != ")":
            found = _WORD.fullmatch(word)
            if found is None:
                raise ValueError(f"{word!r} not a type")
            if found["module"]:
                named = getattr(importlib.import_module(found["module"]), found["name"])
                yield types.BaseTuple.from_types(tuple(read()), named)
            elif found["axes"]:
                fixed = bool(found["fixed"])
                yield types.Array(kinds[found["kind"]], int(found["axes"]), "C", readonly=fixed)
            else:
                yield kinds[found["kind"]]

    return tuple(read())


# --- Progress of compiling -----------------------------------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True)
class Compiling:
    """The state of compilation in this process."""

    name: str  # of the function: ``growth.kernel.grow_jobs``
    number: int  # of the function, from 1; of one that is done, how many are
    total: int  # of all functions that are known to be compiled
    left_s: float  # until all are compiled: computed from their sizes and this computer's speed
    is_done: bool  # whether the function was just finished


Listener = Callable[[Compiling], None]


class _Compilations:
    """The functions that this process compiles, or lets other processes compile."""

    def __init__(self) -> None:
        self.listeners: list[Listener] = []
        self.processes = 1
        self._lock = threading.RLock()
        self._waiting: dict[str, float] = {}  # seconds declared
        self._running: dict[str, tuple[float, float]] = {}  # begin, seconds declared
        self._finished = 0
        self._took_s = self._declared_s = _PRIOR_S
        self._ticker: threading.Thread | None = None

    def announce(self, functions: Iterable[tuple[str, float]]) -> None:
        """Note functions that will be compiled, with the seconds declared for each."""
        with self._lock:
            if not self._waiting and not self._running:
                self._finished = 0
            self._waiting |= dict(functions)

    @contextmanager
    def compiling(self, name: str, seconds: float) -> Iterator[None]:
        """Note that a function is compiled within the block; a failed one waits again."""
        with self._lock:
            self._waiting.pop(name, None)
            self._running[name] = (time.monotonic(), seconds)
            self._tick()
        self._tell(name)
        try:
            yield
        except BaseException:
            with self._lock:
                del self._running[name]
            raise
        self._end(name)

    def forget(self) -> None:
        """Forget the functions that wait."""
        with self._lock:
            self._waiting.clear()

    def current(self, name: str | None = None, *, is_done: bool = False) -> Compiling | None:
        """Return the state of a function, of the first that is being compiled if None."""
        with self._lock:
            running = list(self._running)
            name = name or next(iter(running), None)
            if name is None or not (is_done or name in running):
                return None
            place = 0 if is_done else running.index(name) + 1
            return Compiling(
                name=name,
                number=self._finished + place,
                total=self._finished + len(running) + len(self._waiting),
                left_s=self._left_s(),
                is_done=is_done,
            )

    def _end(self, name: str) -> None:
        with self._lock:
            begun, seconds = self._running.pop(name)
            self._finished += 1
            self._took_s += time.monotonic() - begun
            self._declared_s += seconds
        self._tell(name, is_done=True)

    def _tell(self, name: str | None = None, *, is_done: bool = False) -> None:
        state = self.current(name, is_done=is_done)
        if state is not None:
            for listener in tuple(self.listeners):
                listener(state)
            announce_to_all(
                Progress(
                    phase=COMPILING,
                    done=state.number if state.is_done else state.number - 1,
                    total=state.total,
                    left_s=state.left_s or None,
                )
            )

    def _left_s(self) -> float:
        """Return the time until all is compiled: the longest first, on so many processes."""
        now, pace = time.monotonic(), self._took_s / self._declared_s
        loads = [
            max(pace * seconds - (now - begun), 0.0) for begun, seconds in self._running.values()
        ]
        loads += [0.0] * (self.processes - len(loads))
        heapq.heapify(loads)
        for seconds in sorted(self._waiting.values(), reverse=True):
            heapq.heapreplace(loads, loads[0] + pace * seconds)
        return max(loads)

    def _tick(self) -> None:
        """Tell listeners every second, as long as anything is compiled."""

        def tick() -> None:
            while True:
                time.sleep(_TICK_S)
                with self._lock:
                    if not self._running:
                        self._ticker = None
                        return
                self._tell()

        if self._ticker is None:
            self._ticker = threading.Thread(target=tick, name="vinefab-compiling", daemon=True)
            self._ticker.start()


_PRIOR_S = 3.0
"""So many seconds of work as declared stand against the first ones that are measured."""

_TICK_S = 1.0
_COMPILATIONS = _Compilations()


@contextmanager
def listening(listener: Listener) -> Iterator[None]:
    """Tell a function of everything that this process compiles within the block, in any thread.

    It is called when a function begins and ends, and every second in between, perhaps from another
    thread: it must be quick and raise nothing.
    """
    _COMPILATIONS.listeners.append(listener)
    try:
        yield
    finally:
        _COMPILATIONS.listeners.remove(listener)


def current() -> Compiling | None:
    """Return the state of compilation; None where nothing is being compiled."""
    return _COMPILATIONS.current()


@cache
def _hear_numba() -> None:
    """Note what numba compiles; functions that are compiled into others are part of them."""
    from numba.core import event  # noqa: PLC0415  as numba

    class Hearing(event.Listener):
        """numba compiles in one thread at a time: `begun` needs no lock."""

        def __init__(self) -> None:
            self.begun: list[Any] = []

        def on_start(self, heard: Any) -> None:  # noqa: ANN401
            function, block = heard.data["dispatcher"].py_func, None
            if not self.begun and function.__module__.startswith("vinefab."):
                _, seconds = vars(function).get(_TAKES, ((), _UNKNOWN_S))
                block = _COMPILATIONS.compiling(_name(function), seconds)
                block.__enter__()
            self.begun.append(block)

        def on_end(self, heard: Any) -> None:  # noqa: ANN401, ARG002
            block = self.begun.pop()
            if block is not None:
                block.__exit__(None, None, None)

    event.register("numba:compile", Hearing())


_UNKNOWN_S = 1.0

# --- Compiling beforehand ------------------------------------------------------------------------


def all_compiled() -> tuple[str, ...]:
    """Return the names of all functions that can be compiled beforehand."""
    return tuple(name for name, function in _dispatchers() if _TAKES in vars(function.py_func))


def lacking(functions: Iterable[str]) -> tuple[str, ...]:
    """Return those functions that would have to be compiled when they are called, longest first.

    Parameters
    ----------
    functions
        Names without the package's: ``growth.kernel.grow_jobs``.
    """
    found = [one for one in dict.fromkeys(functions) if not _is_ready(one)]
    return tuple(sorted(found, key=_seconds, reverse=True))


def precompile(functions: Iterable[str]) -> None:
    """Compile those of some functions that the cache lacks: longest first, in two processes.

    Functions that cannot be are compiled where they are first called, as always.

    Parameters
    ----------
    functions
        As for `lacking`.
    """
    names = lacking(functions)
    if not names:
        return
    waiting = deque(names)
    _COMPILATIONS.announce([(name, _seconds(name)) for name in names])
    try:
        with _helper(waiting):
            while waiting:
                with suppress(IndexError):
                    _compile(waiting.popleft())
        while waiting:  # the helper ended too early
            _compile(waiting.popleft())
    finally:
        _COMPILATIONS.forget()


@contextmanager
def tuned_meanwhile(functions: Iterable[str], after_s: float = 30.0) -> Iterator[None]:
    """Let another process compile for this processor what a wheel brought for all of its kind.

    That is done while a long block lasts, at low priority; code that is ready when the block ends
    is used by later commands, in place of the slower code that was brought. Results are the same.

    Parameters
    ----------
    functions
        As for `lacking`.
    after_s
        A block that ends sooner compiles nothing.
    """
    names, started = tuple(dict.fromkeys(functions)), list[subprocess.Popen[bytes]]()

    def start() -> None:
        line = [sys.executable, "-P", "-c", _TUNER, str(_PACKAGE.parent), *names]
        quiet = subprocess.DEVNULL
        started.append(subprocess.Popen(line, stdin=quiet, stdout=quiet, stderr=quiet))  # noqa: S603

    if not sys.executable or not names or not any(map(_is_brought, names)):
        yield
        return
    timer = threading.Timer(after_s, start)
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()
        timer.join()
        for process in started:
            process.kill()  # every function that is done is kept
            process.wait()


_TUNER = (
    "import sys; sys.path.append(sys.argv[1]); import vinefab.core.compiling as c; "
    "c._tune(sys.argv[2:])"
)


def _is_brought(name: str) -> bool:
    """Tell whether the code of a function is brought by the package, and none is of this one's."""
    function = _function(name)
    if not hasattr(function, "py_func"):
        return False
    for text in _declared(name)[0]:
        places = list(function._cache.places(_types(text)))
        if places and places[0][1] not in places[0][0] and places[-1][1] in places[-1][0]:
            return True
    return False


def _tune(names: Iterable[str]) -> None:
    """Compile functions for this processor, although code for others is there: in a process."""
    for _, function in _dispatchers():  # they call each other
        function._cache.own_only = True
    if hasattr(os, "nice"):
        os.nice(10)
    for name in sorted(names, key=_seconds, reverse=True):
        _compile(name)


_WORTH_S = 4.0
"""Less to compile is done sooner by one process than a second one has loaded numba."""


@contextmanager
def _helper(waiting: deque[str]) -> Iterator[None]:
    """Let another process take from the functions that wait; wait for it at the end."""
    alone = len(waiting) < 2 or sum(map(_seconds, waiting)) < _WORTH_S or _processors() < 2
    if alone or not sys.executable or not _own_code().is_writable():
        yield
        return
    _COMPILATIONS.processes = 2
    try:
        with helped(
            _compile, waiting, 1, lambda name: _COMPILATIONS.compiling(name, _seconds(name))
        ):
            yield
    finally:
        _COMPILATIONS.processes = 1


def _dispatchers() -> Iterator[tuple[str, Any]]:
    """Yield every compiled function after its name."""
    for path in sorted(_PACKAGE.rglob("*kernel.py")):
        module = ".".join(path.relative_to(_PACKAGE).with_suffix("").parts)
        for name, function in vars(importlib.import_module(f"vinefab.{module}")).items():
            if hasattr(function, "py_func"):
                yield f"{module}.{name}", function


def _function(name: str) -> Any:  # noqa: ANN401  a numba dispatcher
    """Return a compiled function by its name."""
    module, _, function = name.rpartition(".")
    return getattr(importlib.import_module(f"vinefab.{module}"), function)


def _declared(name: str) -> tuple[tuple[str, ...], float]:
    """Return the types that a function takes, and the seconds that compiling it takes."""
    function = _function(name)
    declared: tuple[tuple[str, ...], float] = vars(getattr(function, "py_func", function))[_TAKES]
    return declared


def _seconds(name: str) -> float:
    return _declared(name)[1]


def _is_ready(name: str) -> bool:
    """Tell whether a function is compiled for all types that it takes, or needs no compiling."""
    function = _function(name)
    if not hasattr(function, "py_func"):
        return True
    types = [_types(text) for text in _declared(name)[0]]
    places = function._cache.places
    return all(
        one in function.overloads or any(place in kept for kept, place in places(one))
        for one in types
    )


def _compile(name: str) -> None:
    """Load or compile a function for all types that it takes."""
    function = _function(name)
    for text in _declared(name)[0]:
        function.compile(_types(text))
