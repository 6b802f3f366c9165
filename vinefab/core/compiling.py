"""Compilation of kernels: the only module that imports numba, which takes a second.

Functions that call each other must stand in one file that imports no other module of vinefab: the
cache on disk notices edits to a function's own file only. After a change here, the caches
(``__pycache__/*.nbi``) must be deleted by hand.
"""

from collections.abc import Callable
from typing import Any

import numba

# mypy: allow-untyped-calls


def compiled(function: Callable[..., Any]) -> Any:  # noqa: ANN401  a numba dispatcher
    """Compile a function, without the interpreter lock, keeping the code on disk if possible.

    The cache lies beside the function's file or, if that folder is read-only, in the user's cache
    folder. If neither is writable, every process compiles anew.
    """
    return _jit(function, forceinline=False)


def inlined(function: Callable[..., Any]) -> Any:  # noqa: ANN401  as above
    """Compile a function into its callers.

    Otherwise every call copies the descriptors of some twenty arrays: most of the time of a growth,
    which consists of many short calls.
    """
    return _jit(function, forceinline=True)


def _jit(function: Callable[..., Any], *, forceinline: bool) -> Any:  # noqa: ANN401  as above
    # No compiled function allocates an array, so none needs the run-time that counts references to
    # arrays: atomic additions at every call, and half of the time of a growth (numba 0.68).
    options: dict[str, Any] = {"nogil": True, "error_model": "numpy", "_nrt": False}
    options["forceinline"] = forceinline
    try:
        return numba.njit(cache=True, **options)(function)
    except RuntimeError:
        return numba.njit(**options)(function)
