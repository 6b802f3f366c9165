"""Compilation of kernels: the only module that imports numba, which takes half a second.

Modules with kernels are therefore imported when they are first used: see `front_door`.

Functions that call each other must stand in one file that imports no other module of vinefab: the
cache on disk notices edits to a function's own file only. After a change here, the caches
(``__pycache__/*.nbi``) must be deleted by hand.
"""

import importlib.util
import pickle
from collections.abc import Callable
from functools import cache
from importlib.machinery import SourceFileLoader
from types import FunctionType, ModuleType
from typing import Any

# mypy: allow-untyped-calls

_INTERPRETED = " (interpreted)"
"""Ends the names of modules whose functions are left to the interpreter."""

_UNREADABLE = (
    pickle.UnpicklingError,
    EOFError,
    ImportError,
    AttributeError,
    LookupError,
    TypeError,
    ValueError,
)
"""Errors that pickle raises where a name is gone or bytes are not its own."""


def compiled(function: Callable[..., Any]) -> Any:  # noqa: ANN401  a numba dispatcher
    """Compile a function, without the interpreter lock, keeping the code on disk if possible.

    The cache lies in the file's folder or, if that is read-only, in the user's cache folder. If
    neither is writable, every process compiles anew.
    """
    if _is_interpreted(function):
        return function
    try:
        dispatcher = _jit(function, cache=True)
    except RuntimeError:
        return _jit(function)
    if dispatcher is function:  # the user's NUMBA_DISABLE_JIT
        return function
    index = dispatcher._cache._cache_file
    index._load_index = _lenient(index._load_index)
    return dispatcher


def _lenient(load: Callable[[], dict[Any, str]]) -> Callable[[], dict[Any, str]]:
    """Let an index that cannot be read count as empty: numba looks at its stamp only after it.

    It names types of an earlier version of the file, or was damaged.
    """

    def load_index() -> dict[Any, str]:
        try:
            return load()
        except _UNREADABLE:
            return {}

    return load_index


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


def _is_interpreted(function: Callable[..., Any]) -> bool:
    return function.__module__.endswith(_INTERPRETED)


def _jit(function: Callable[..., Any], **options: bool) -> Any:  # noqa: ANN401  a numba dispatcher
    import numba  # noqa: PLC0415  not loaded where code is interpreted

    _join_conditions()
    # No compiled function allocates an array, so none needs the run-time that counts references to
    # arrays: atomic additions at every call, and half of the time of a growth (numba 0.68).
    settings: dict[str, Any] = {"nogil": True, "error_model": "numpy", "_nrt": False, **options}
    return numba.njit(**settings)(function)
