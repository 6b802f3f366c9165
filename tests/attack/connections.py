"""Connections of other users of the computer: ``python tests/attack/connections.py [KIND ...]``.

A studio with 1,024 file descriptors, as a desktop allows, meets connections that show no token and
come again as soon as they are dropped. Meanwhile its owner opens the page and asks for a growth.
Exits with 1 where an answer takes over 5 s or none comes, where the server takes more memory than
a kind allows, or where anything is written on the owner's terminal. Loopback only.
"""

import argparse
import json
import resource
import socket
import sys
import tempfile
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from threading import Event, Thread
from urllib.request import urlopen

from websockets.exceptions import WebSocketException
from websockets.sync.client import connect

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from tests.studio.conftest import RunningStudio, running_studio
from vinefab.studio.sessions import MOST_MESSAGE_BYTES, MOST_TABS

DESCRIPTORS = 1024
QUESTIONS = 20
MOST_S = 5.0
PATIENCE_S = 20.0

GET = "GET /page/app.js HTTP/1.1\r\nHost: HOST\r\n"
UPGRADE = (
    "GET /socket HTTP/1.1\r\nHost: HOST\r\nOrigin: http://HOST\r\nUpgrade: websocket\r\n"
    "Connection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
    "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Protocol: vinefab, TOKEN\r\n\r\n"
)
PART, PING = b"\x00\x80" + bytes(4), b"\x89\xfd" + bytes(4 + 125)
MESSAGE = b"\x81\xff" + MOST_MESSAGE_BYTES.to_bytes(8, "big") + bytes(3 + MOST_MESSAGE_BYTES)


@dataclass(frozen=True, kw_only=True)
class Kind:
    """What connections do that must not harm the owner."""

    count: int = 1100
    first: str = ""  # sent at once
    then: bytes = b""  # sent after an answer
    again: bytes = b""  # sent again and again
    leaves: bool = False  # before it is answered
    most_mb: float = 50.0  # what the server may grow by


KINDS = {
    "idle": Kind(),
    "slow head": Kind(first=f"{GET}x: ", again=b"x"),
    "broken": Kind(first=f"{GET}Transfer-Encoding: chunked\r\n\r\nzz\r\n"),
    "slow body": Kind(first=f"{GET}Content-Length: 9999\r\n\r\n", again=b"x"),
    "unread": Kind(first=f"{GET}\r\n" * 200),
    "flood": Kind(count=300, first=f"{GET}\r\n", leaves=True),
    "message": Kind(count=100, first=UPGRADE.replace("TOKEN", "x" * 43), then=MESSAGE),
    # The owner's own pages: as many as there may be but for one.
    "token": Kind(count=MOST_TABS - 1, first=UPGRADE, then=MESSAGE, most_mb=400.0),
    "parts": Kind(count=2, first=UPGRADE, then=b"\x01" + PART[1:], again=PART * 50_000),
    "pings": Kind(count=2, first=UPGRADE, again=PING * 5_000),
}


class Crowd(Thread):
    """Connections that come again when they are dropped, until they are stopped."""

    def __init__(self, studio: RunningStudio, kind: Kind) -> None:
        super().__init__(daemon=True)
        self._studio = studio
        self._kind = kind
        self._first = (
            kind.first.replace("HOST", studio.host).replace("TOKEN", studio.token).encode()
        )
        self._open: list[socket.socket] = []
        self._rest: dict[socket.socket, bytes] = {}  # of what is sent again and again
        self.stop = Event()
        self.full = Event()
        self.made = 0

    def run(self) -> None:
        """Keep so many connections open."""
        while not self.stop.is_set():
            self._open = [link for link in self._open if self._is_held(link)]
            while len(self._open) < self._kind.count and not self.stop.is_set():
                with suppress(OSError):
                    self._open.append(self._connected())
            self.full.set()
            if self._kind.leaves:
                for link in self._open:
                    link.close()
                self._open = []
            else:
                self.stop.wait(0.2)
        for link in self._open:
            link.close()

    def _connected(self) -> socket.socket:
        link = socket.create_connection(("127.0.0.1", self._studio.port), timeout=0.5)
        self.made += 1
        link.sendall(self._first)
        if "Upgrade" in self._kind.first:
            link.recv(4096)
            link.sendall(self._kind.then)
        link.settimeout(0.0)
        return link

    def _is_held(self, link: socket.socket) -> bool:
        try:
            if self._kind.again:
                rest = self._rest.get(link) or self._kind.again
                self._rest[link] = rest[link.send(rest) :]
            if link.recv(1, socket.MSG_PEEK):
                return True
        except BlockingIOError:
            return True
        except OSError:
            pass
        link.close()
        return False


def answer_s(studio: RunningStudio, *, warm: bool = False) -> float:
    """Return how long the owner waits for the page and a growth; ``warm``: for the compiler too."""
    before = time.monotonic()
    with urlopen(studio.address, timeout=PATIENCE_S) as page:  # noqa: S310  its own address
        page.read()
    with connect(
        f"ws://{studio.host}/socket",
        origin=studio.origin,
        subprotocols=["vinefab", studio.token],
        open_timeout=PATIENCE_S,
    ) as link:
        while "state" not in (hello := json.loads(link.recv(timeout=PATIENCE_S))):
            pass
        link.send(json.dumps({"panel": "live", "seq": 1, "state": hello["state"]}))
        while (heard := json.loads(link.recv(timeout=300.0))).get("panel") != "live":
            pass
        while warm and heard.get("event") != "engine":
            heard = json.loads(link.recv(timeout=300.0))
    return time.monotonic() - before


def attacked(name: str, studio: RunningStudio) -> bool:
    """Attack a studio and print a line; return whether its owner was served."""
    kind = KINDS[name]
    crowd = Crowd(studio, kind)
    before = most = studio.memory_mb()
    crowd.start()
    crowd.full.wait(30.0)
    waits, refused = [], []
    for _ in range(QUESTIONS):
        try:
            waits.append(answer_s(studio))
        except (OSError, TimeoutError, WebSocketException) as error:
            refused.append(type(error).__name__)
        most = max(most, studio.memory_mb())
    crowd.stop.set()
    crowd.join()
    sys.stdout.write(
        f"{name:10} {kind.count:5} connections held or made again, {crowd.made} in all: "
        f"{len(waits)} of {QUESTIONS} answers, within {max(waits, default=0.0):.2f} s "
        f"{' '.join(refused)}; {before:.0f} MB, then {most:.0f} MB\n"
    )
    sys.stdout.flush()
    served = len(waits) == QUESTIONS and max(waits) < MOST_S
    return served and most - before < kind.most_mb


def main() -> int:
    """Try every kind on one studio, and print a line for each."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("kinds", nargs="*", metavar="KIND", help=f"of {', '.join(KINDS)}")
    kinds = parser.parse_args().kinds or list(KINDS)
    _, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (DESCRIPTORS, most))  # of the studio
    with tempfile.TemporaryDirectory() as folder, running_studio(Path(folder)) as studio:
        resource.setrlimit(resource.RLIMIT_NOFILE, (most, most))  # of this process
        answer_s(studio, warm=True)
        sys.stdout.write(f"alone: answers within {answer_s(studio):.2f} s\n")
        served = [attacked(name, studio) for name in kinds]
        complaints = studio.said().count("\n")
    sys.stdout.write(f"{complaints} lines on the owner's terminal\n")
    return 0 if all(served) and not complaints else 1


if __name__ == "__main__":
    sys.exit(main())
