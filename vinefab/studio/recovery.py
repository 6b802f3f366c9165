"""Unsaved work: what a tab showed last, kept in a file of the user's until it is saved."""

import json
import re
from collections.abc import Mapping
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from vinefab.core.atomic import write_bytes
from vinefab.core.errors import BadInputError, UnreadableFileError, located
from vinefab.core.jsontext import json_text
from vinefab.core.plain_text import counted
from vinefab.core.validation import check_plain
from vinefab.model.files.shipped import read_text, user_root
from vinefab.studio.edited_map import PAGE

RECOVERY_SCHEMA = "vinefab/recovery-1"
MOST_RECOVERIES = 20
LARGEST_RECOVERY_BYTES = 4 << 20

_KEY = re.compile(r"[a-z0-9]{6,40}")


def recovery_folder() -> Path:
    """Return where unsaved work is kept."""
    return user_root() / "studio"


def keep_unsaved(key: object, state: Mapping[str, Any], file: object) -> Path:
    """Keep what a tab shows; of too many the oldest go.

    Parameters
    ----------
    key
        The tab's own: 6 to 40 small letters and digits.
    file
        What the page knows of the file that is open.
    """
    path = _path(key)
    content = {"kept_at": datetime.now(UTC).isoformat("T", "seconds"), "state": state, "file": file}
    text = json_text(RECOVERY_SCHEMA, content)
    if len(text) > LARGEST_RECOVERY_BYTES:
        allowed = f"at most {LARGEST_RECOVERY_BYTES} bytes for the recovery file"
        raise BadInputError("state", counted(len(text), "byte"), allowed, PAGE)
    write_bytes(path, text.encode(), force=True, private=True)
    for old in _files()[MOST_RECOVERIES:]:
        old.unlink(missing_ok=True)
    return path


def drop_unsaved(key: object) -> None:
    """Remove what was kept of a tab."""
    _path(key).unlink(missing_ok=True)


def read_unsaved(key: object) -> dict[str, Any]:
    """Return what was kept of a tab: ``key``, ``kept_at``, ``state`` and ``file``."""
    path = _path(key)
    try:
        content = json.loads(read_text(path, 2 * LARGEST_RECOVERY_BYTES))
    except (ValueError, RecursionError) as error:
        raise UnreadableFileError(path, f"is not JSON: {error}") from error
    if not isinstance(content, dict) or content.get("schema") != RECOVERY_SCHEMA:
        raise UnreadableFileError(path, f"is no recovery file ({RECOVERY_SCHEMA})")
    with located(path):
        check_plain(content)
    kept = {name: content.get(name) for name in ("kept_at", "state", "file")}
    return {"key": key, **kept}


def list_unsaved() -> list[dict[str, Any]]:
    """Return what is kept, the newest first, each with its design; broken files are left out."""
    found = []
    for path in _files()[:MOST_RECOVERIES]:
        with suppress(UnreadableFileError, BadInputError):
            kept = read_unsaved(path.stem.removeprefix("recovery-"))
            state = kept.pop("state")
            design = state.get("design") if isinstance(state, dict) else None
            name = design.get("name") if isinstance(design, dict) else None
            found.append({**kept, "name": name, "design": design})
    return found


def _path(key: object) -> Path:
    if not isinstance(key, str) or not _KEY.fullmatch(key):
        raise BadInputError("key", key, "6 to 40 small letters and digits", PAGE)
    return recovery_folder() / f"recovery-{key}.json"


def _files() -> list[Path]:
    """Return the recovery files, the newest first."""
    times = []
    for path in recovery_folder().glob("recovery-*.json"):
        with suppress(OSError):  # another server may just have removed it
            times.append((path.stat().st_mtime_ns, path))
    return [path for _, path in sorted(times, reverse=True)]
