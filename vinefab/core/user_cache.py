"""The user's cache: what was computed once and may be deleted at any time, compiled code among it.

A file of the cache is disposable: one that is empty, cut or changed is missing, and is replaced.
"""

import os
import sys
import tempfile
import time
from contextlib import suppress
from pathlib import Path

from vinefab.core.hashing import sha256_of

CACHE_VARIABLES = ("VINEFAB_CACHE_DIR", "NUMBA_CACHE_DIR")
"""Environment variables that name the folder, the first that is set; else the system's."""


def cache_root() -> Path:
    """Return the folder of everything that vinefab caches, whether it exists or not."""
    own, numba = (os.environ.get(variable) for variable in CACHE_VARIABLES)
    if own:
        return _home(own)
    if numba:
        return _home(numba) / "vinefab"
    if sys.platform == "win32":
        return _home(os.environ.get("LOCALAPPDATA") or r"~\AppData\Local") / "vinefab" / "Cache"
    if sys.platform == "darwin":
        return _home("~/Library/Caches/vinefab")
    return _home(os.environ.get("XDG_CACHE_HOME") or "~/.cache") / "vinefab"


def _home(path: str) -> Path:
    with suppress(RuntimeError):  # a user without a home
        return Path(path).expanduser()
    return Path(tempfile.gettempdir()) / "vinefab-cache"


class KeptFiles:
    """The files of one folder of the cache, by name; the ones used longest ago are pruned.

    Parameters
    ----------
    folder
        The folder, in the cache or in the package.
    suffix
        Of all its files.
    most_bytes
        Size of the folder from which on files are pruned.
    """

    def __init__(self, folder: Path, suffix: str, most_bytes: int) -> None:
        self.folder, self.suffix, self.most_bytes = folder, suffix, most_bytes

    def __contains__(self, name: str) -> bool:
        return self.read(name) is not None

    def read(self, name: str) -> bytes | None:
        """Return the content of a file; None if it is missing or not as it was written."""
        path = self.folder / (name + self.suffix)
        try:
            digest, content = _parted(path.read_bytes())
        except OSError:
            return None
        if digest != sha256_of(content):
            return None
        with suppress(OSError):
            if time.time() - path.stat().st_mtime > _DAY_S:
                os.utime(path)
        return content

    def write(self, name: str, content: bytes) -> None:
        """Write or replace a file in one step, with its digest; raise `OSError` if that fails."""
        self.folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        number, temporary = tempfile.mkstemp(suffix=_UNFINISHED, dir=self.folder)
        try:
            with os.fdopen(number, "wb") as stream:
                stream.write(sha256_of(content).encode() + content)
            Path(temporary).replace(self.folder / (name + self.suffix))
        except BaseException:
            Path(temporary).unlink(missing_ok=True)
            raise
        self._prune()

    def is_writable(self) -> bool:
        """Tell whether files can be written there."""
        with suppress(OSError):
            self.folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=self.folder):
                return True
        return False

    def _prune(self) -> None:
        """Delete the files that were used longest ago, and those that killed processes left."""
        found: list[tuple[float, int, Path]] = []
        now_s = time.time()
        for path in self.folder.iterdir():
            with suppress(OSError):
                about = path.stat()
                if path.suffix == _UNFINISHED and now_s - about.st_mtime > _DAY_S:
                    path.unlink()
                elif path.name.endswith(self.suffix):
                    found.append((about.st_mtime, about.st_size, path))
        total = 0
        for _, size, path in sorted(found, reverse=True):
            total += size
            if total > self.most_bytes:
                with suppress(OSError):
                    path.unlink()


_DAY_S = 86_400.0
_UNFINISHED = ".unfinished"
_DIGEST = 64  # hexadecimal digits


def _parted(data: bytes) -> tuple[str, bytes]:
    """Return the digest at the beginning of a file, and the rest."""
    return data[:_DIGEST].decode("ascii", "replace"), data[_DIGEST:]
