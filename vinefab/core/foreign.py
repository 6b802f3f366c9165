"""The one boundary around foreign code: plug-ins, a user's own objects, readers of other packages.

Whatever such code raises, `SystemExit`, `StopIteration` and `GeneratorExit` included, becomes one
error that names its package, or the file that it read. Ctrl-C stays Ctrl-C.
"""

import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from importlib.metadata import distribution, distributions, packages_distributions
from math import isfinite
from numbers import Real
from pathlib import Path
from traceback import extract_tb, format_exception_only, walk_tb
from typing import Any

from vinefab.core.errors import (
    BadInputError,
    BrokenPluginError,
    MissingPackageError,
    UnknownNameError,
    UnreadableFileError,
)

_HOUSE = __name__.partition(".")[0]
_ON_PURPOSE = (
    BadInputError,
    UnknownNameError,
    UnreadableFileError,
    BrokenPluginError,
    MissingPackageError,
)
"""Errors that a part may raise: they name the value, the file or the package."""


def is_own(part: object) -> bool:
    """Return whether a function, a class or an object is of vinefab itself."""
    return _module_of(part).partition(".")[0] == _HOUSE


@contextmanager
def calling(what: str, part: object, *passing: type[Exception]) -> Iterator[None]:
    """Call a part in the block; if it is foreign and breaks down, its package is named.

    Parameters
    ----------
    what
        Kind and name of the part: ``task 'depth'``.
    part
        The function or object that is called; those of vinefab pass.
    passing
        Further errors that the part may raise on purpose.

    Raises
    ------
    BrokenPluginError
        For everything else that it raises.
    """
    if is_own(part):
        yield
        return
    with boundary(lambda error: broken(what, part, line_of(error)), *_ON_PURPOSE, *passing):
        yield


@contextmanager
def reading(path: str | Path) -> Iterator[None]:
    """Read a file in the block with libraries; whatever they raise names the file and the library.

    Raises
    ------
    UnreadableFileError
        For everything but errors on purpose; a want of memory passes.
    """

    def unreadable(error: BaseException) -> UnreadableFileError:
        return UnreadableFileError(path, f"{_reader(error)} cannot read it ({line_of(error)})")

    with boundary(unreadable, MemoryError, *_ON_PURPOSE):
        yield


@contextmanager
def reading_element(where: str, value: object) -> Iterator[None]:
    """Read an element of a file in the block with libraries, as `reading` does the file.

    Raises
    ------
    BadInputError
        Names the element; `vinefab.core.errors.located` adds the file.
    """

    def unreadable(error: BaseException) -> BadInputError:
        return BadInputError(where, value, f"one that {_reader(error)} can read ({line_of(error)})")

    with boundary(unreadable, MemoryError, RecursionError, *_ON_PURPOSE):
        yield


@contextmanager
def boundary(
    named: Callable[[BaseException], Exception], *passing: type[BaseException]
) -> Iterator[None]:
    """Raise a named error where a block raises anything; Ctrl-C and some others pass.

    What the block prints goes to stderr: the output of a command may be read by a program.
    """
    try:
        with _printing_to_stderr():
            yield
    except passing:
        raise
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        raise named(error) from error


def broken(what: str, part: object, problem: str) -> BrokenPluginError:
    """Return the error of a part that breaks down, or that returns what it must not."""
    return BrokenPluginError(f"{what} {_owner_of(_module_of(part))}", problem)


def ensure_finite(what: str, part: object, name: str, value: object) -> float:
    """Return a number that a foreign part returned.

    Raises
    ------
    BrokenPluginError
        If it is not a finite number.
    """
    if isinstance(value, bool) or not isinstance(value, Real) or not isfinite(value):
        raise broken(what, part, f"its {name} is {value!r:.60}, not a finite number")
    return float(value)


def ensure_numbers(what: str, part: object, name: str, values: object) -> dict[str, float]:
    """Return named numbers that a foreign part returned.

    Raises
    ------
    BrokenPluginError
        If they are not a mapping of texts to finite numbers.
    """
    if not isinstance(values, Mapping) or not all(isinstance(key, str) for key in values):
        found = type(values).__name__
        raise broken(what, part, f"its {name} are of type {found}, not a mapping of names")
    return {key: ensure_finite(what, part, f"{name} {key!r}", one) for key, one in values.items()}


def ensure_type(what: str, part: object, name: str, value: object, kind: type) -> None:
    """Raise `BrokenPluginError` where a foreign part returned something of another type."""
    if not isinstance(value, kind):
        found = f"is of type {type(value).__name__}, not {kind.__name__}"
        raise broken(what, part, f"its {name} {found}")


# --- Who it was -----------------------------------------------------------------------------------


def _module_of(part: object) -> str:
    while isinstance(part, partial):
        part = part.func
    return str(getattr(part, "__module__", ""))


def _owner_of(module: str) -> str:
    """Return the package that a module belongs to, or the module where no package has it."""
    first = module.partition(".")[0]
    for package in distributions():
        for point in package.entry_points:
            if point.group.startswith(f"{_HOUSE}.") and point.module.partition(".")[0] == first:
                return f"of package {package.name}"
    name = _package_of(first, getattr(sys.modules.get(module), "__file__", None))
    return f"of package {name}" if name else f"of module {module or '?'}"


def _package_of(first: str, file: str | None) -> str:
    """Return the package whose file a module is: its name alone may be that of another one's."""
    for name in dict.fromkeys(packages_distributions().get(first, ())) if file else ():
        package = distribution(name)
        there = Path(file or "").resolve()
        files = (one for one in package.files or () if one.name == there.name)
        if any(Path(str(package.locate_file(one))).resolve() == there for one in files):
            return name
    return ""


def line_of(error: BaseException) -> str:
    """Return an error in one line, with its place; also of one that cannot be printed."""
    words = format_exception_only(error)[-1].partition(": ")[2].strip()
    words = str(error) if isinstance(error, SyntaxError) else words
    line = f"{type(error).__name__}: {words}"
    place = extract_tb(error.__traceback__)[-1:] if error.__traceback__ else []
    if place and place[0].filename.endswith(".py") and not isinstance(error, SyntaxError):
        line = f"{line}, at {Path(place[0].filename).name} line {place[0].lineno}"
    return line


def _reader(error: BaseException) -> str:
    """Return the package of the innermost frame that is neither ours nor Python's, if there is."""
    frames = [frame.f_globals for frame, _ in walk_tb(error.__traceback__)]
    for found in reversed(frames):
        first = found.get("__name__", "").partition(".")[0]
        if first not in (_HOUSE, "", "contextlib") and first not in sys.stdlib_module_names:
            return _package_of(first, found.get("__file__")) or first
    return "the reader"


# --- What it prints -------------------------------------------------------------------------------

_PRINTING = threading.Lock()
_PRINTERS: list[Any] = []
"""The output, once for each thread that is inside: the last one to leave puts it back."""


@contextmanager
def _printing_to_stderr() -> Iterator[None]:
    with _PRINTING:
        _PRINTERS.append(sys.stdout if not _PRINTERS else _PRINTERS[0])
        sys.stdout = sys.stderr
    try:
        yield
    finally:
        with _PRINTING:
            before = _PRINTERS.pop()
            if not _PRINTERS:
                sys.stdout = before
