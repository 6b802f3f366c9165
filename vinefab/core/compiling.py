"""How compiled functions are compiled: the only place that knows numba, which takes a second.

Functions that are compiled together must stand in one file, and such a file imports nothing else
of ours: the cache on disk notices edits to a function's own file only. After a change here, the
caches (``__pycache__/*.nbi``) must be deleted by hand.
"""

from collections.abc import Callable
from typing import Any

import numba

# mypy: allow-untyped-calls


def compiled(function: Callable[..., Any]) -> Any:  # noqa: ANN401  a numba dispatcher
    """Compile a function, without the interpreter lock, keeping the code on disk if possible.

    The cache goes beside the function's file or, if that folder is read-only, to the user's cache
    folder. Where neither can be written to, the code is compiled anew in every process.
    """
    return _jit(function, forceinline=False)


def inlined(function: Callable[..., Any]) -> Any:  # noqa: ANN401  as above
    """Compile a function into its callers.

    Without it, every call copies the descriptions of some twenty arrays: most of the time of a
    growth, which is made of many calls that do little.
    """
    return _jit(function, forceinline=True)


def _jit(function: Callable[..., Any], *, forceinline: bool) -> Any:  # noqa: ANN401  as above
    # No compiled function makes an array, so that none needs the run-time that counts references
    # to arrays: atomic additions at every call, and half of the time of a growth (numba 0.68).
    options: dict[str, Any] = {"nogil": True, "error_model": "numpy", "_nrt": False}
    options["forceinline"] = forceinline
    try:
        return numba.njit(cache=True, **options)(function)
    except RuntimeError:
        return numba.njit(**options)(function)
