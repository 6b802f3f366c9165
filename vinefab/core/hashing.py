"""Digests: fingerprints of content, manifests of folders, and the mark of a file of vinefab's.

The mark is the text ``written by vinefab 0.2.0 [0123456789abcdef]`` wherever the format has room
for a remark: a TOML or DXF comment, the member ``generator`` of JSON, ``<desc>`` or ``<meta>`` of
SVG and HTML, the ``Software`` of PNG, the ``Creator`` of PDF, the comment of GIF and ZIP. In the
brackets stand the first 16 digits of the SHA-256 of the file with zeros in their place.
"""

import hashlib
import json
import re
import zlib
from collections.abc import Mapping
from enum import Enum
from pathlib import Path

from vinefab.core.plain_text import GENERATOR, OWN_MARK


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
_OF_LINES = "# sha256 of the lines below: "


def manifest_text(digests: Mapping[str, str]) -> str:
    """Return a manifest from SHA-256 digests by file name; names keep their order."""
    lines = "".join(f"{digest}  {name}\n" for name, digest in digests.items())
    return f"# {GENERATOR}\n{_OF_LINES}{sha256_of(lines.encode())}\n{lines}"


def is_manifest_as_written(text: str) -> bool:
    """Tell whether a manifest is as vinefab wrote it."""
    mark, _, rest = text.partition("\n")
    own, _, lines = rest.partition("\n")
    if OWN_MARK.decode() not in mark:
        return False
    return own == _OF_LINES + sha256_of(lines.encode())


def listed_in(text: str) -> list[tuple[str, str]]:
    """Return the file names in a manifest, each with its SHA-256 digest."""
    lines = [line for line in text.splitlines() if not line.startswith("#")]
    hash_and_gap = 66
    return [(line[hash_and_gap:], line[: hash_and_gap - 2]) for line in lines]


def digests_in(text: str) -> dict[str, str]:
    """Return the SHA-256 digests in a manifest, by file name."""
    return dict(listed_in(text))


_DIGITS = 16
_BLANK = b" [" + b"0" * _DIGITS + b"]"
ROOMY_GENERATOR = f"{GENERATOR}{_BLANK.decode()}"
"""The mark for binary formats: nothing can be inserted there later."""

_MARK = re.compile(OWN_MARK + rb" [\w.+!-]*\w( \[[0-9a-f]{16}\])?")
_ROOMY_MARK = re.compile(OWN_MARK + rb" [\w.+!-]*\w( \[[0-9a-f]{16}\])")
_LOOK_BYTES = 8192
_PNG = b"\x89PNG\r\n\x1a\n"


class Authorship(Enum):
    """Who wrote a file, by its mark."""

    FOREIGN = "was not written by vinefab"
    OURS = "is as vinefab wrote it"
    CHANGED = "was changed since vinefab wrote it"


def marked(data: bytes) -> bytes:
    """Return a file with its digest in its mark; one without a mark stays as it is.

    >>> marked(b"# written by vinefab 1.0")
    b'# written by vinefab 1.0 [b4d7636c14396eaf]'
    """
    place = _place(data)
    if place is None:
        return data
    blank = _filled(data, place, _BLANK)
    digest = sha256_of(blank)[:_DIGITS]
    return _filled(blank, (place[0], place[0] + len(_BLANK)), f" [{digest}]".encode())


def authorship(data: bytes) -> Authorship:
    """Tell from a file's content who wrote it."""
    if not has_mark(data):
        return Authorship.FOREIGN
    sealed = _place(data) is not None and marked(data) == data
    return Authorship.OURS if sealed else Authorship.CHANGED


def has_mark(data: bytes) -> bool:
    """Tell whether a file's first or last 8 KiB hold the mark, changed since or not."""
    return OWN_MARK in data[:_LOOK_BYTES] or OWN_MARK in data[-_LOOK_BYTES:]


def _place(data: bytes) -> tuple[int, int] | None:
    """Return where the digest stands or belongs: in the first mark of a text.

    Of other files it is the last mark with room: a ZIP may hold marked files before its comment.
    """
    try:
        data.decode()
    except UnicodeDecodeError:
        found = max(_ROOMY_MARK.finditer(data), key=re.Match.start, default=None)
        return found and found.span(1)
    found = _MARK.search(data)
    return found and (found.span(1) if found[1] else (found.end(), found.end()))


def _filled(data: bytes, place: tuple[int, int], text: bytes) -> bytes:
    """Return a file with another text at a place, and of PNG the checksum that belongs to it."""
    data = data[: place[0]] + text + data[place[1] :]
    chunk = data.rfind(b"tEXt", 0, place[0])  # length, kind, content, CRC-32 of kind and content
    if not data.startswith(_PNG) or chunk < len(_PNG):
        return data
    end = chunk + 4 + int.from_bytes(data[chunk - 4 : chunk], "big")
    return data[:end] + zlib.crc32(data[chunk:end]).to_bytes(4, "big") + data[end + 4 :]
