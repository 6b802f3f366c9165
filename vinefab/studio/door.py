"""Where the server listens, and the token that opens it."""

import hmac
import os
import secrets
import socket
from dataclasses import dataclass, field
from html import escape
from pathlib import Path
from tempfile import TemporaryDirectory

from vinefab.core.errors import BadInputError

LOOPBACK = "127.0.0.1"
SUBPROTOCOL = "vinefab"
"""What a socket offers before its token: a browser's page can send no other header with it."""


@dataclass(slots=True, kw_only=True)
class Door:
    """Where the server listens, and what opens it."""

    port: int
    token: str = field(default_factory=lambda: secrets.token_urlsafe(32), repr=False)
    _forwarding: TemporaryDirectory[str] | None = None

    @property
    def hosts(self) -> tuple[str, ...]:
        """What a request may name as its host."""
        return f"{LOOPBACK}:{self.port}", f"localhost:{self.port}"

    @property
    def address(self) -> str:
        """What the user opens."""
        return f"http://{LOOPBACK}:{self.port}/?token={self.token}"

    def opens(self, token: object) -> bool:
        """Tell whether a token is the one, in a time that tells nothing of it."""
        given = token.encode(errors="replace") if isinstance(token, str) else b""
        return hmac.compare_digest(given, self.token.encode())

    def write_forwarding(self) -> str:
        """Write a page of the user's own that leads to the address; return its ``file:`` URL.

        A browser gets this URL: every user of the computer can read command lines.
        """
        # A browser in a snap can read neither /tmp nor hidden folders of the home folder.
        home = os.path.expanduser("~")  # noqa: PTH111  Path.home() fails where there is none
        self._forwarding = TemporaryDirectory(  # mode 0700
            prefix="vinefab-studio-",
            dir=home if os.access(home, os.W_OK) else None,
            ignore_cleanup_errors=True,
        )
        path = Path(self._forwarding.name) / "open.html"
        path.touch(0o600)
        address = escape(self.address)
        path.write_text(
            '<!doctype html><meta charset="utf-8"><title>vinefab studio</title>'
            f'<meta http-equiv="refresh" content="0; url={address}">'
            f'<a href="{address}">vinefab studio</a>\n',
            encoding="utf-8",
        )
        return path.as_uri()

    def remove_forwarding(self) -> None:
        """Remove the page that leads to the address: the browser has come, or the server ends."""
        if self._forwarding is not None:
            self._forwarding.cleanup()
            self._forwarding = None


def bound_socket(port: int) -> socket.socket:
    """Return a socket that listens on this computer only; port 0 takes any that is free.

    Raises
    ------
    BadInputError
        If the port cannot be had.
    """
    if not 0 <= port <= 65535:
        raise BadInputError("--port", port, "0 to 65535")
    bound = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    try:
        if os.name == "posix":  # on Windows others could then listen on the same port
            bound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        bound.bind((LOOPBACK, port))
        bound.listen(64)
    except OSError as error:
        bound.close()
        allowed = f"a port that is free ({error.strerror}); 0 takes any"
        raise BadInputError("--port", port, allowed) from error
    return bound
