"""Stable short names for content."""

import hashlib
import json
from pathlib import Path


def sha256_of(data: bytes) -> str:
    """Return the SHA-256 of some bytes as 64 hexadecimal digits."""
    return hashlib.sha256(data).hexdigest()


def sha256_of_file(path: Path) -> str:
    """Return the SHA-256 of a file as 64 hexadecimal digits."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def fingerprint(*parts: object) -> str:
    """Return 12 hexadecimal digits that name a tuple of plain values.

    Round floats before handing them in: a fingerprint that a user keeps in a file must survive
    changes below the precision that matters.

    Examples
    --------
    >>> fingerprint("VF-W01", "0.1") == fingerprint("VF-W01", "0.1")
    True
    """
    return sha256_of(json.dumps(parts, sort_keys=True).encode())[:12]
