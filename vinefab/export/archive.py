"""A folder's files in one zip."""

import io
import zipfile
from collections.abc import Mapping

from vinefab.core.jsontext import GENERATOR

_FIRST_DATE = (1980, 1, 1, 0, 0, 0)
_UNIX = 3
_PLAIN_FILE = 0o100644 << 16


def zip_bytes(files: Mapping[str, bytes], folder: str) -> bytes:
    """Return files as a zip whose bytes depend on nothing but them.

    The files are stored, not compressed: compressors differ from one build to the next.

    Parameters
    ----------
    files
        Content by name.
    folder
        Folder in the zip that holds them.
    """
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_STORED) as archive:
        for name, data in files.items():
            entry = zipfile.ZipInfo(f"{folder}/{name}", _FIRST_DATE)
            entry.create_system = _UNIX
            entry.external_attr = _PLAIN_FILE
            archive.writestr(entry, data)
        archive.comment = GENERATOR.encode()
    return stream.getvalue()
