"""The list of a folder's files with their hashes, in the form that ``sha256sum -c`` checks."""

from collections.abc import Mapping

from vinefab.core.jsontext import GENERATOR

MANIFEST_NAME = "MANIFEST.sha256"
_HASH_AND_GAP = 66


def manifest_text(digests: Mapping[str, str]) -> str:
    """Return a manifest from SHA-256 digests by file name; names keep their order."""
    lines = [f"# {GENERATOR}", *(f"{digest}  {name}" for name, digest in digests.items())]
    return "\n".join(lines) + "\n"


def names_in(text: str) -> set[str]:
    """Return the file names in a manifest."""
    return set(digests_in(text))


def digests_in(text: str) -> dict[str, str]:
    """Return the SHA-256 digests in a manifest, by file name."""
    lines = [line for line in text.splitlines() if not line.startswith("#")]
    return {line[_HASH_AND_GAP:]: line[: _HASH_AND_GAP - 2] for line in lines}
