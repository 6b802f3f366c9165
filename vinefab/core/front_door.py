"""How the nouns reach what is above them, and what public functions call their parameters.

`Design.grow` and ``_repr_svg_`` belong to nouns at the bottom of the house and need rooms at the
top of it. An import there, even one inside a function, would let data climb back, and a saved
design could no longer be cut without the simulator. So the nouns know one module by its name only,
and it is loaded when such a method is first called.
"""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from typing import Any

from vinefab.core.errors import BadInputError, UnknownNameError


def front_door(part: str = "noun_methods") -> Any:  # noqa: ANN401  types this room must not know
    """Return a module at the top of the package, which sees all rooms."""
    return import_module(f"vinefab.{part}")


@contextmanager
def python_words() -> Iterator[None]:
    """Name parameters as they are called here, where a room names the options of its command."""
    try:
        yield
    except BadInputError as error:
        key, allowed = as_parameters(error.key), as_parameters(error.allowed)
        source = _file_of(error)
        if (key, allowed, source) == (error.key, error.allowed, error.source):
            raise
        raise BadInputError(key, error.value, allowed, source) from error
    except UnknownNameError as error:
        if _file_of(error) == error.source:
            raise
        raise UnknownNameError(
            error.kind, error.name, error.known, problem=error.problem
        ) from error


def _file_of(error: BadInputError | UnknownNameError) -> str | None:
    """Return the file that an error names; an option of a command is none."""
    return None if str(error.source).startswith("--") else error.source


def as_parameters(words: str) -> str:
    """Return a text in which ``--allow-empty`` is called ``allow_empty``."""
    return re.sub(r"--([a-z][a-z0-9-]*)", lambda option: option[1].replace("-", "_"), words)
