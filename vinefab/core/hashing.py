"""Stable short names for content, and the list of a folder's files with their hashes."""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path

from vinefab.core.jsontext import GENERATOR, OWN_MARK


def sha256_of(data: bytes) -> str:
    """Return the SHA-256 of some bytes as 64 hexadecimal digits."""
    return hashlib.sha256(data).hexdigest()


def sha256_of_file(path: Path) -> str:
    """Return the SHA-256 of a file as 64 hexadecimal digits."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def fingerprint(*parts: object) -> str:
    """Return 12 hexadecimal digits that identify a tuple of plain values.

    Round floats first: a fingerprint that a user keeps in a file must survive changes below the
    precision that matters.

    Examples
    --------
    >>> fingerprint("VF-W01", "0.1") == fingerprint("VF-W01", "0.1")
    True
    """
    return sha256_of(json.dumps(parts, sort_keys=True).encode())[:12]


MANIFEST_NAME = "MANIFEST.sha256"
_HASH_AND_GAP = 66
_OF_LINES = "# sha256 of the lines below: "


def manifest_text(digests: Mapping[str, str]) -> str:
    """Return a manifest from SHA-256 digests by file name; names keep their order."""
    lines = "".join(f"{digest}  {name}\n" for name, digest in digests.items())
    return f"# {GENERATOR}\n{_OF_LINES}{sha256_of(lines.encode())}\n{lines}"


def is_manifest_as_written(text: str) -> bool:
    """Tell whether a manifest is as vinefab wrote it.

    A manifest without a digest of its lines, as earlier versions wrote it, counts as unchanged.
    """
    mark, _, rest = text.partition("\n")
    own, _, lines = rest.partition("\n")
    if OWN_MARK.decode() not in mark:
        return False
    return not own.startswith(_OF_LINES) or own == _OF_LINES + sha256_of(lines.encode())


def listed_in(text: str) -> list[tuple[str, str]]:
    """Return the file names in a manifest, each with its SHA-256 digest."""
    lines = [line for line in text.splitlines() if not line.startswith("#")]
    return [(line[_HASH_AND_GAP:], line[: _HASH_AND_GAP - 2]) for line in lines]


def digests_in(text: str) -> dict[str, str]:
    """Return the SHA-256 digests in a manifest, by file name."""
    return dict(listed_in(text))
