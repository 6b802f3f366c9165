"""Paths that a file or the studio's page names: where they may lead, and what errors about it show.

A user names any file, on the command line, in Python, and in a run file or an observation that is
named there. What anybody else wrote names files in its own folder only.
"""

import os
from collections.abc import Sequence
from pathlib import Path

from vinefab.core.errors import BadInputError
from vinefab.model.files.shipped import path_given

_LONGEST_PATH = 1024
_LONGEST_NAME = 255


def path_inside(
    key: str,
    given: object,
    folders: Sequence[Path],
    source: str | Path,
    base: Path | None = None,
    shipped: Sequence[Path] = (),
) -> Path:
    """Return where a path leads, links followed: into one of some folders, or below it.

    Parameters
    ----------
    key, source
        What names the path, and where.
    base
        Where a relative path begins; the first folder if None.
    shipped
        Further folders, which a refusal does not list.

    Raises
    ------
    BadInputError
        If it leads elsewhere, or is not a path.
    """
    try:
        path = path_given(key, given)
        too_long = any(len(part.encode()) > _LONGEST_NAME for part in path.parts)
    except BadInputError as error:
        raise error.at(source) from error
    except UnicodeEncodeError:  # halves of letters
        too_long = True
    if too_long or len(str(given)) > _LONGEST_PATH:
        raise BadInputError(key, given, "a path of ordinary length", source)
    real = Path(os.path.realpath((base or folders[0]) / path))
    if not is_inside(real, (*folders, *shipped)):
        shown = " or ".join(dict.fromkeys(map(str, folders)))
        raise BadInputError(key, given, f"a path in {shown}", source)
    return real


def is_inside(path: Path, folders: Sequence[Path]) -> bool:
    """Tell whether a path leads, links followed, into one of some folders or below it."""
    real = Path(os.path.realpath(path))
    return any(real.is_relative_to(os.path.realpath(folder)) for folder in folders)
