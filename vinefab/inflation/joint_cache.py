"""Simulated joints in the user's cache: ``~/.cache/vinefab/joints``.

The cache lies under ``XDG_CACHE_HOME`` where that is set, or in the folder that the environment
variable ``VINEFAB_CACHE`` names. There is one small file for each joint, in a folder named by the
fingerprint of the simulation. Whatever cannot be read or written is left out: a cache saves time
and nothing else.
"""

import json
import os
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any

from vinefab.core.atomic import write_bytes
from vinefab.core.errors import VinefabError
from vinefab.core.hashing import fingerprint
from vinefab.inflation.joint import Joint
from vinefab.inflation.table import simulation_fingerprint

CACHE_VARIABLE = "VINEFAB_CACHE"
"""Environment variable that names the folder of vinefab's cache."""

_MOST_BYTES = 1 << 16


def cache_folder() -> Path:
    """Return the folder of joints simulated as now, whether it exists or not."""
    named, home = os.environ.get(CACHE_VARIABLE), os.environ.get("XDG_CACHE_HOME")
    root = Path(home) if home else Path("~/.cache").expanduser()
    cache = Path(named).expanduser() if named else root / "vinefab"
    return cache / "joints" / simulation_fingerprint()


def cached(way: str, joint: Joint) -> dict[str, Any] | None:
    """Return the record of a joint, if it is there and whole.

    Parameters
    ----------
    way
        What was asked of the joint.
    """
    with suppress(OSError, ValueError, LookupError, TypeError, VinefabError):
        path = _path(way, joint)
        if path.stat().st_size <= _MOST_BYTES:
            record = json.loads(path.read_bytes())
            if record["joint"] == _plain(joint) and record["sum"] == _sum(record["found"]):
                return dict(record["found"])
    return None


def keep(way: str, joint: Joint, found: dict[str, Any]) -> None:
    """Keep the record of a joint."""
    with suppress(OSError, VinefabError):
        record = {"joint": _plain(joint), "found": found, "sum": _sum(found)}
        data = json.dumps(record).encode()
        write_bytes(_path(way, joint), data, force=True, sealed=False, private=True)


def _path(way: str, joint: Joint) -> Path:
    return cache_folder() / f"{way}-{fingerprint(_plain(joint))}.json"


def _plain(joint: Joint) -> dict[str, Any]:
    plain: dict[str, Any] = json.loads(json.dumps(asdict(joint)))
    return plain


def _sum(found: dict[str, Any]) -> str:
    return fingerprint(json.loads(json.dumps(found)))
