"""Where the server listens, and the token that opens it."""

import hmac
import secrets
import socket
from dataclasses import dataclass, field

from vinefab.core.errors import BadInputError

LOOPBACK = "127.0.0.1"


@dataclass(frozen=True, slots=True, kw_only=True)
class Door:
    """Where the server listens, and what opens it."""

    port: int
    token: str = field(default_factory=lambda: secrets.token_urlsafe(32), repr=False)

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
        bound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        bound.bind((LOOPBACK, port))
        bound.listen(64)
    except OSError as error:
        bound.close()
        allowed = f"a port that is free ({error.strerror}); 0 takes any"
        raise BadInputError("--port", port, allowed) from error
    return bound
