"""The studio attacked over the network, and ended: it refuses, lives on, and leaves nothing."""

import asyncio
import http.client
import json
import os
import select
import signal
import socket
import struct
import time
from contextlib import ExitStack, closing, contextmanager, nullcontext, suppress
from pathlib import Path
from types import SimpleNamespace

import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from vinefab.core.errors import BadInputError
from vinefab.studio.server import SUBPROTOCOL, Endpoint, bound_socket
from vinefab.studio.sessions import (
    DROP,
    MOST_PENDING,
    MOST_TABS,
    PATIENCE_S,
    Connections,
    TabSession,
)

MOST_MB = 600  # of the server with the simulator loaded; one such message is a sixth of it

UPGRADE = (
    "GET /socket HTTP/1.1\r\nHost: {host}\r\nOrigin: http://{host}\r\nUpgrade: websocket\r\n"
    "Connection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
    f"Sec-WebSocket-Protocol: {SUBPROTOCOL}, {{token}}\r\n"
    "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n"
)


@pytest.fixture(scope="module")
def studio(tmp_path_factory, start_studio):
    """One server for all attacks."""
    with start_studio(tmp_path_factory.mktemp("attacked")) as started:
        yield started


def response(studio, method="GET", path="/page/app.js", host=None, headers=()):
    """Return status, headers and content of a raw request: nothing in it is put right."""
    asked = http.client.HTTPConnection("127.0.0.1", studio.port, timeout=20)
    try:
        asked.putrequest(method, path, skip_host=True)
        if host != "":
            asked.putheader("Host", host or studio.host)
        for name, value in dict(headers).items():
            asked.putheader(name, value)
        asked.endheaders()
        got = asked.getresponse()
        return got.status, {name.lower(): value for name, value in got.getheaders()}, got.read()
    finally:
        asked.close()


def knock(studio, origin=None, **options):
    """Return a socket to the server."""
    return connect(
        f"ws://{studio.host}/socket",
        origin=studio.origin if origin is None else origin,
        max_size=None,
        close_timeout=1,
        **{"subprotocols": [SUBPROTOCOL, studio.token], **options},
    )


@contextmanager
def tab(studio):
    """Give a socket that has been let in, and the first state."""
    with knock(studio) as link:
        while "state" not in (greeting := json.loads(link.recv(timeout=20))):
            pass  # an event to all tabs came before
        yield link, greeting["state"]


def closed_with(opened, *messages):
    """Return the code with which the server closes a socket after some messages."""
    with opened as link, pytest.raises(ConnectionClosed) as closed:
        exchange(link, messages)
    return closed.value.rcvd.code


def exchange(opened, messages):
    """Send messages and read answers until the socket is closed."""
    link = opened[0] if isinstance(opened, tuple) else opened
    for message in messages:
        link.send(message)
    while True:
        link.recv(timeout=20)


def answer(link, state, seq=1, **parts):
    """Return what the server answers to a question."""
    link.send(json.dumps({"panel": "live", "seq": seq, "state": state, **parts}))
    return replied(link)


def replied(link):
    """Return the next answer or error, past events and progress."""
    while True:
        got = json.loads(link.recv(timeout=60))
        if "event" not in got and "progress" not in got:
            return got


def with_branches(state, *branches):
    """Return a state with a design of so many branches per level."""
    changed = json.loads(json.dumps(state))
    design, count = changed["design"], len(branches)
    design["level"] = [
        {"branches": many, "length": 20.0, "angle_deg": 160.0, "growth_percent": 100.0}
        for many in branches
    ]
    design["build"] |= {"widths_mm": [24.0] + [8.0] * count, "fillet_mm": [2.0] * count}
    design["build"].pop("taper", None)
    return changed


@pytest.fixture(autouse=True)
def lives_on(studio):
    """After every attack the server answers, within its memory, and has met no bug."""
    yield
    with tab(studio) as (_, state):
        assert state["design"]["name"] == "grid_explorer_levels"
    assert studio.memory_mb() < MOST_MB
    assert "Traceback" not in studio.said()


FOREIGN = ("http://evil.example", "null", "http://127.0.0.1:1")


@pytest.mark.parametrize(
    ("status", "request_parts"),
    [
        *((403, {"host": host}) for host in
          ("evil.example", "127.0.0.1", "127.0.0.1:1", "127.0.0.1.evil:80")),
        (400, {"host": ""}),
        *((403, {"headers": {"Origin": origin}}) for origin in FOREIGN),
        *((403, {"path": f"/?{query}"}) for query in
          ("x", "token=", "token=x", "token=%ff%00", "token=%C3%A9")),
        *((403, {"method": method}) for method in ("POST", "PUT", "DELETE", "OPTIONS", "TRACE")),
        *((404, {"path": path}) for path in (
            "/page/../sessions.py", "/page/../../../../../etc/passwd", "/page/%2e%2e/sessions.py",
            "/page/..%2fsessions.py", "/page/..%5csessions.py", "/page//etc/passwd",
            "/page/%2fetc%2fpasswd", "/page/app.js%00.css", "/page/", "/page/" + "a" * 5000,
            "/nothing", "/socket", "http://evil.example/page/../sessions.py",
        )),
    ],
)  # fmt: skip
def test_a_request_of_others_is_refused_in_one_line(studio, status, request_parts):
    got, headers, content = response(studio, **request_parts)
    assert got == status
    assert b"root:" not in content
    if status == 403:
        assert content.count(b"\n") == 1
        assert headers["content-type"].startswith("text/plain")
    if status != 400:  # that one never comes so far
        assert "content-security-policy" in headers
    assert (b"Open the whole address" in content) == ("?" in request_parts.get("path", ""))


@pytest.mark.parametrize("origin", [*FOREIGN, None])
def test_a_socket_comes_from_the_page(studio, origin):
    link = f"ws://{studio.host}/socket"
    with pytest.raises(InvalidStatus) as refused:
        (knock(studio, origin=origin) if origin else connect(link)).__enter__()
    assert refused.value.response.status_code == 403


def test_the_page_opens_by_its_address_and_is_the_same_for_everybody(studio):
    """A reload has no token in its address; nothing of the user's is in the page."""
    status, headers, content = response(studio, path=f"/?token={studio.token}")
    assert status == 200
    assert studio.token.encode() not in content
    assert headers["content-type"].startswith("text/html")
    assert response(studio, path="/")[2] == content


@pytest.mark.parametrize(
    "offered",
    [
        None,
        [SUBPROTOCOL],
        ["TOKEN"],
        [SUBPROTOCOL, "x"],
        [SUBPROTOCOL, Endpoint(port=1).token],  # of another server
        [SUBPROTOCOL, "TOKEN", "x"],
        ["TOKEN", SUBPROTOCOL],
    ],
)
def test_a_socket_without_the_token_is_never_accepted(studio, offered):
    names = offered and [studio.token if name == "TOKEN" else name for name in offered]
    with pytest.raises(InvalidStatus) as refused, knock(studio, subprotocols=names):
        pass
    assert refused.value.response.status_code == 403


HALF_A_HEAD = "GET /page/app.js HTTP/1.1\r\nHost: {host}\r\nx: "


BY_NO_BROWSER = (
    "GET / HTTP/1.1\r\nHost: {host}\r\nTransfer-Encoding: chunked\r\n\r\nzz\r\n",
    UPGRADE + "x: y\r\n" * 200 + "\r\n",
    UPGRADE + "x: " + "y" * 9000 + "\r\n\r\n",
)


@pytest.mark.thorough
def test_crowds_without_the_token_do_not_lock_the_owner_out(studio):
    """Old ones go when one more comes; the owner stays, with a page that is being loaded."""
    loading = http.client.HTTPConnection(studio.host, timeout=20)
    loading.connect()
    loading.auto_open = 0
    with closing(loading), ExitStack() as crowd:
        loading.request("GET", "/page/app.js")
        loading.getresponse().read()
        links = [
            crowd.enter_context(socket.create_connection(("127.0.0.1", studio.port), timeout=10))
            for _ in range(MOST_PENDING + 20)
        ]
        for link in links[::2]:  # the others say nothing
            with suppress(OSError):  # it may have been dropped
                link.sendall(HALF_A_HEAD.format(host=studio.host).encode())
        loading.request("GET", "/page/store.js")
        assert loading.getresponse().status == 200
        with tab(studio) as (owner, state):
            held = left_open(links, MOST_PENDING)
            assert len(held) <= MOST_PENDING
            for sent in BY_NO_BROWSER:
                link = socket.create_connection(("127.0.0.1", studio.port))
                held.append(crowd.enter_context(link))
                link.sendall(sent.format(host=studio.host, token="").encode())
            assert left_open(held, 0) == []
            assert "answer" in answer(owner, state)
    assert studio.said() == ""


def test_one_more_than_may_wait_takes_the_place_of_the_oldest_that_never_asked():
    class Client:
        def __init__(self, name):
            self.name, self.ended = name, False

        def get_extra_info(self, _):
            return self.name

        def abort(self):
            self.ended = True

    async def crowd():
        connections, clients = Connections(), [Client(n) for n in range(MOST_PENDING + 1)]
        for client in clients:
            connections.add(client)
            if client.name == 0:
                with connections.answering({"client": 0}):
                    pass
        return [client.name for client in clients if client.ended]

    assert asyncio.run(crowd()) == [1]


def left_open(links, most):
    """Wait until the server has ended all of some connections but so many, and return these."""
    end_s = time.monotonic() + PATIENCE_S + 20.0
    while len(links) > most and time.monotonic() < end_s:
        ready, _, _ = select.select(links, [], [], 0.5)
        links = [link for link in links if link not in ready or not is_dropped(link)]
    return links


def is_dropped(link):
    """Read what has come, and tell whether it was the end."""
    try:
        return not link.recv(4096)
    except OSError:
        return True


def test_there_are_only_so_many_tabs(studio):
    with ExitStack() as tabs:
        opened = [tabs.enter_context(tab(studio)) for _ in range(MOST_TABS)]
        assert "answer" in answer(*opened[-1])
        with pytest.raises(InvalidStatus), knock(studio):
            pass


def test_the_browser_gets_a_private_page_that_leads_to_the_address(tmp_path, start_studio):
    """Not the token: every user of the computer can read command lines."""
    browser, heard = tmp_path / "browser", tmp_path / "heard"
    browser.write_text(f'#!/bin/sh\necho "$@" > {heard}.part\nmv {heard}.part {heard}\n')
    browser.chmod(0o755)
    for opens in (True, False):
        with start_studio(tmp_path, "--browser", extra={"BROWSER": f"{browser} %s"}) as studio:
            while not heard.exists():
                time.sleep(0.02)
            page = Path(heard.read_text().strip().removeprefix("file://"))
            heard.unlink()
            assert studio.token not in str(page)
            assert (page.stat().st_mode & 0o777, page.parent.stat().st_mode & 0o777) == (
                0o600,
                0o700,
            )
            assert f'content="0; url={studio.address}"' in page.read_text()
            if opens:
                response(studio, path=f"/?token={studio.token}")
                assert not page.parent.exists()
            else:  # ended before a page came
                assert studio.interrupt(signal.SIGTERM) == 0
                assert (studio.left(), studio.said()) == ([], "")
        assert not page.parent.exists()


@pytest.mark.parametrize("path", ["/", "TOKEN", "/page/app.js", "/page/studio.css", "/nothing"])
def test_every_response_is_guarded(studio, path):
    _, headers, _ = response(studio, path=f"/?token={studio.token}" if path == "TOKEN" else path)
    policy = headers["content-security-policy"]
    assert "default-src 'none'" in policy
    assert "unsafe" not in policy
    assert "frame-ancestors 'none'" in policy
    assert headers["x-content-type-options"] == "nosniff"
    assert headers["x-frame-options"] == "DENY"
    assert headers["referrer-policy"] == "no-referrer"
    assert headers["cache-control"] == "no-store"
    assert "server" not in headers


@pytest.mark.parametrize("message", ["{", "[]", "1", "", "[" * 100_000, b"\x00\xff", "1" * 5000])
def test_what_is_no_object_closes_the_socket(studio, message):
    assert closed_with(tab(studio), message) == 1003


def test_a_message_of_100_mb_closes_the_socket(studio):
    """At its announcement: what is still on its way could cost the sender the reason."""
    with tab(studio) as opened:
        opened[0].socket.sendall(struct.pack("!BBQ4s", 0x81, 0xFF, 100 << 20, b"mask"))
        assert closed_with(nullcontext(opened)) == 1009


@pytest.mark.parametrize(
    ("part", "value", "named"),
    [
        ("design", {"schema": "x"}, "the page"),
        ("map", {"source": {"file": "/dev/zero"}}, "map.source.file"),
        ("map", {"source": {"environment": "grid"}, "edits": [["remove"]] * 10_001}, "edits"),
        ("recipe", "/etc/passwd", "recipe"),
    ],
)
def test_a_state_that_cannot_be_is_one_line(studio, part, value, named):
    with tab(studio) as (link, state):
        line = answer(link, {**state, part: value})["error"]["message"]
    assert named in line
    assert "\n" not in line
    assert len(line) < 500
    assert "this should not happen" not in line


@pytest.mark.parametrize(
    "question",
    [
        {"panel": "nothing", "seq": 1},
        {"panel": ["live"], "seq": {}},
        {"panel": "x" * 1_000_000, "seq": 1},
        {"panel": "live", "seq": 1, "state": [1]},
        {"request": "nothing", "seq": 1},
        {"panel": "tip", "seq": 1, "state": {}, "ask": {"branch": [], "to": "x"}},
        {},
    ],
)
def test_a_question_that_nobody_asks_is_one_line(studio, question):
    with tab(studio) as (link, _):
        link.send(json.dumps(question))
        got = replied(link)
    assert "this should not happen" not in got["error"]["message"]
    assert len(json.dumps(got)) < 1000


def test_a_file_outside_of_the_folders_is_not_opened(studio):
    path = studio.folder / "link.toml"
    path.symlink_to("/etc/passwd")
    with tab(studio) as (link, _):
        link.send(json.dumps({"request": "open_design", "seq": 1, "ask": {"design": str(path)}}))
        line = replied(link)["error"]["message"]
    assert str(path)[:40] in line  # long ones are cut
    assert "\n" not in line
    assert "root:" not in line


def test_an_enormous_design_is_a_line_at_once(studio):
    with tab(studio) as (link, state):
        before = time.process_time()
        too_many = answer(link, with_branches(state, 1000, 1000, 1000))
        assert "100000" in too_many["error"]["message"]
        # 99,499 branches are a design; growing it took a minute and 2 GB.
        problems = answer(link, with_branches(state, 46, 46, 46))["answer"]["problems"]
        assert any("vinefab grow" in problem for problem in problems)
        assert time.process_time() - before < 5.0


def test_a_flood_of_questions_is_answered_one_at_a_time(studio):
    with tab(studio) as (link, state):
        for seq in range(200):
            link.send(json.dumps({"panel": "live", "seq": seq, "state": state}))
        got = [replied(link) for _ in range(200)]
    answered = [one for one in got if "answer" in one]
    refused = [one for one in got if "one question" in one.get("error", {}).get("message", "")]
    assert answered
    assert refused
    assert len({one["seq"] for one in answered}) == len(answered)


def test_who_does_not_read_is_asked_nothing_more(studio):
    """Refusals of a million questions would lie in the server's memory."""
    question = masked(b'{"panel":"x","seq":1,"state":[1]}')
    with socket.create_connection(("127.0.0.1", studio.port), timeout=1.0) as link:
        opening = UPGRADE + "\r\n"
        link.sendall(opening.format(host=studio.host, token=studio.token).encode())
        assert link.recv(12) == b"HTTP/1.1 101"
        with pytest.raises(TimeoutError):
            send_many(link, question)


def test_who_reads_no_events_is_dropped():
    """They come without a question, so that asking nothing more does not bound them."""
    dropped = []
    unread = TabSession(
        None, SimpleNamespace(scope={"state": {DROP: lambda: dropped.append(True)}})
    )
    for _ in range(40):
        unread.put({"event": "x" * (1 << 20)})
    assert dropped
    assert unread._out.qsize() < 20


def test_a_message_of_endless_parts_drops_its_connection(studio):
    """Empty ones add nothing to its length."""
    with socket.create_connection(("127.0.0.1", studio.port), timeout=5.0) as link:
        opening = UPGRADE + "\r\n"
        link.sendall(opening.format(host=studio.host, token=studio.token).encode())
        assert link.recv(12) == b"HTTP/1.1 101"
        with pytest.raises(OSError, match=r"reset|Broken pipe"):
            send_many(link, b"\x00\x80" + bytes(4), first=b"\x01\x80" + bytes(4))


def send_many(link, frame, first=b""):
    link.sendall(first)
    for _ in range(500):
        link.sendall(frame * 2000)


def masked(content):
    """Return a text frame of a client, masked with zeros."""
    assert len(content) < 126
    return bytes([0x81, 0x80 | len(content)]) + bytes(4) + content


def test_cancelling_what_nobody_asked_is_nothing(studio):
    with tab(studio) as (link, state):
        for name in ("live", "rules", "x", None, []):
            link.send(json.dumps({"cancel": name}))
        assert "answer" in answer(link, state)


def test_ctrl_c_ends_everything(tmp_path, start_studio):
    """In the middle of long answers, too."""
    with start_studio(tmp_path) as studio, tab(studio) as (link, state):
        answer(link, state)
        link.send(json.dumps({"panel": "rules", "seq": 2, "state": state}))
        large = with_branches(state, 11, 11, 11)
        link.send(json.dumps({"panel": "live", "seq": 3, "state": large}))
        while not studio.family(running="spawn_main"):  # a process of a panel runs
            time.sleep(0.02)
        assert studio.interrupt() == 0
        assert studio.left() == []
        assert "Traceback" not in studio.said()


def test_a_process_that_is_killed_starts_anew(studio):
    with tab(studio) as (link, state):
        others = studio.family(running="spawn_main")
        link.send(json.dumps({"panel": "inflated", "seq": 1, "state": state}))
        while not (workers := set(studio.family(running="spawn_main")) - set(others)):
            time.sleep(0.01)
        for process in workers:
            os.kill(process, signal.SIGKILL)
        got = replied(link)
        assert "ended unexpectedly" in got["error"]["message"]
        pouch = {"panel": "inflated", "seq": 2, "state": {"design": {}}}  # refused at once
        link.send(json.dumps(pouch))
        assert "schema" in replied(link)["error"]["message"]


@pytest.mark.parametrize("port", ["99999", "-1", "taken"])
def test_a_port_that_cannot_be_had_is_one_line(port):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        number = taken.getsockname()[1] if port == "taken" else int(port)
        with pytest.raises(BadInputError, match=r"^--port is [^\n]*$"):
            bound_socket(number)


@pytest.mark.parametrize("place", ["path", "header", "content"])
def test_a_request_without_the_token_has_at_most_16_kb(studio, place):
    """As the documentation says, also where all of it comes in one piece."""
    for count, is_taken in ((15_000, True), (17_000, False), (70_000, False)):
        long = "a" * count
        path = f"/page/app.js?{long}" if place == "path" else "/page/app.js"
        more = f"X-Long: {long}\r\n" if place == "header" else ""
        more += f"Content-Length: {count}\r\n" if place == "content" else ""
        head = f"GET {path} HTTP/1.1\r\nHost: {studio.host}\r\nConnection: close\r\n{more}\r\n"
        text = head + (long if place == "content" else "")
        with socket.create_connection(("127.0.0.1", studio.port), timeout=60) as link:
            link.sendall(text.encode())
            found = b""
            with suppress(ConnectionError):  # closed while the rest was on its way
                while got := link.recv(1 << 16):
                    found += got
        assert found.startswith(b"HTTP/1.1 200") == is_taken, (count, found[:80])
    assert response(studio)[0] == 200
