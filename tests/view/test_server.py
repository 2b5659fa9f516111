"""Who may ask the page's servers for what, and what hostile clients come to."""

from __future__ import annotations

import contextlib
import http.client
import json
import random
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path

import psutil
import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect

from tests.live.patience import until
from tests.view.feed import Live, live
from tests.view.made import Made
from vve_sumo.errors import ConfigError
from vve_sumo.view.guard import MAX_CONNECTIONS
from vve_sumo.view.hub import MAX_CLIENTS, MAX_IN_FLIGHT
from vve_sumo.view.library import Library
from vve_sumo.view.server import PageServer


def ask(
    port: int, path: str, *, method: str = "GET", host: str | None = None, origin: str | None = None
) -> tuple[int, bytes, dict[str, str]]:
    """Return status, content and headers of an answer."""
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=10.0)
    headers = {"Host": host or f"127.0.0.1:{port}"} | ({"Origin": origin} if origin else {})
    connection.request(method, path, headers=headers)
    answer = connection.getresponse()
    content = answer.read()
    connection.close()
    return answer.status, content, {name.lower(): value for name, value in answer.getheaders()}


#: that the clients of a test may cost the process that they and the server share [bytes]
MEMORY = 80e6
#: that an honest page waits for a frame, at most [s]: the test's threads and the server share one interpreter
STALL = 2.0
PATHS = ("", "main.js", "page.css", "uplot.js", "contents.json", "record/0/scene.json", "record/0/frames.bin")


def test_everything_but_stop_needs_the_token(replay: PageServer) -> None:
    port, token = replay.port, replay.token
    for path in PATHS:
        assert ask(port, f"/{token}/{path}")[0] == 200, path
        for wrong in (
            f"/{path}",
            f"/{token[:-1]}x/{path}",
            f"/x{token}/{path}",
            f"/?token={token}&{path}",
            f"//{path}",
        ):
            status, content, _headers = ask(port, wrong)
            assert status == 403, wrong
            assert token.encode() not in content
    assert len(token) >= 20


def test_other_names_and_other_sites_are_refused(replay: PageServer) -> None:
    port, page = replay.port, f"/{replay.token}/"
    for host in ("evil.example", f"evil.example:{port}", "127.0.0.1", f"127.0.0.1:{port + 1}", f"127.0.0.1:{port}."):
        assert ask(port, page, host=host)[0] == 403, host
    for origin in (
        "http://evil.example",
        "null",
        "file://",
        f"http://127.0.0.1:{port + 1}",
        f"http://u@127.0.0.1:{port}",
    ):
        assert ask(port, page, origin=origin)[0] == 403, origin
    assert ask(port, page, host=f"LocalHost:{port}", origin=f"http://localhost:{port}")[0] == 200


def test_a_page_may_load_nothing_from_elsewhere(replay: PageServer) -> None:
    _status, content, headers = ask(replay.port, f"/{replay.token}/")
    policy = dict(part.strip().split(" ", 1) for part in headers["content-security-policy"].split(";"))
    assert policy["default-src"] == "'none'"
    assert {name: value for name, value in policy.items() if name.endswith("-src") and name != "default-src"} == {
        "script-src": "'self'", "style-src": "'self'", "img-src": "'self' data:", "connect-src": "'self'",
    }  # fmt: skip
    assert headers["referrer-policy"] == "no-referrer"
    assert b"http" not in content


def test_no_path_leads_out_of_the_record(made: Made, replay: PageServer) -> None:
    for path in (
        "../scenario.json", "..%2f..%2fetc%2fpasswd", "record/../0/scene.json", "record/..%2f0/frames.bin",
        "record/1/scene.json", "record/0/scenario.json", "templates/page.css", "__init__.py",
    ):  # fmt: skip
        assert ask(replay.port, f"/{replay.token}/{path}")[0] in (403, 404), path
    library = Library([made.sweep])
    for key in ("..", "../sweep", ".", "", "records"):
        assert library.record(key) is None


def test_what_cannot_be_shown_is_one_line(made: Made, tmp_path: Path) -> None:
    for folders in ([], [made.drive, made.sweep], [made.drive] * 3, [tmp_path]):
        with pytest.raises(ConfigError) as refused:
            Library(folders)
        assert "\n" not in str(refused.value)
    taken = socket.create_server(("127.0.0.1", 0))
    with pytest.raises(ConfigError, match="cannot listen"):
        PageServer([], port=taken.getsockname()[1])
    taken.close()


# A live drive's hub.


@pytest.fixture
def fed(made: Made) -> Iterator[Live]:
    with live(made.drive) as one:
        yield one


def watcher(fed: Live) -> ClientConnection:
    return connect(fed.address.replace("http", "ws") + "socket", max_size=None, compression=None, close_timeout=0.2)


def newest(socket_: ClientConnection, count: int) -> list[dict[str, object]]:
    """Take so many frames, acknowledging each, and return their messages."""
    found: list[dict[str, object]] = []
    while len(found) < count:
        message = json.loads(socket_.recv(timeout=10.0))
        if message["type"] == "frame":
            found.append(message)
            socket_.send(str(message["n"]))
    return found


def test_a_stop_needs_no_token_and_is_all_that_needs_none(fed: Live) -> None:
    port = fed.place[1]
    assert ask(port, "/stop", method="POST")[0] == 200
    assert fed.asked == 1
    for method, path in (
        ("GET", "/stop"),
        ("PUT", "/stop"),
        ("POST", "/"),
        ("POST", "/go"),
        ("POST", "/stop/x"),
        ("POST", "//stop"),
    ):
        assert ask(port, path, method=method)[0] == 403, (method, path)
    assert ask(port, "/stop", method="POST", host="evil.example")[0] == 403
    assert ask(port, "/stop", method="POST", origin="http://evil.example")[0] == 403
    assert fed.asked == 1


def test_a_socket_needs_token_and_origin(fed: Live) -> None:
    good = fed.address.replace("http", "ws") + "socket"
    for address, origin in (
        (good.replace(fed.token, "x" * len(fed.token)), None),
        (good.replace(f"{fed.token}/", ""), None),
        (good, "http://evil.example"),
        (good, "null"),
    ):
        with pytest.raises(InvalidStatus) as refused:
            connect(address, origin=origin)  # type: ignore[arg-type]
        assert refused.value.response.status_code == 403
    with watcher(fed) as one:
        assert json.loads(one.recv(timeout=10.0))["type"] == "scene"


@pytest.mark.thorough
def test_a_page_gets_the_newest_frame_and_never_more_than_it_answers(fed: Live) -> None:
    with watcher(fed) as one:
        assert json.loads(one.recv(timeout=10.0))["type"] == "scene"
        numbers = [int(str(message["n"])) for message in newest(one, 20)]
        assert numbers == sorted(set(numbers))
        # Without an answer, only so many are under way; then comes the newest, not the next.
        unanswered = []
        with contextlib.suppress(TimeoutError):
            while True:
                unanswered.append(json.loads(one.recv(timeout=1.0)))
        assert len(unanswered) == MAX_IN_FLIGHT
        before = fed.frames.newest
        assert before is not None
        one.send(str(unanswered[-1]["n"]))
        message = json.loads(one.recv(timeout=5.0))
        assert message["n"] >= before.tick > unanswered[-1]["n"] + 10


def test_actors_are_told_of_before_a_frame_names_them(fed: Live) -> None:
    with watcher(fed) as one:
        known: set[str] = set()
        for _message in range(10):
            message = json.loads(one.recv(timeout=10.0))
            if message["type"] == "scene":
                known |= message["scene"]["actors"].keys()
            elif message["type"] == "actors":
                known |= message["actors"].keys()
            elif message["type"] == "frame":
                assert set(message["frame"]["actors"]["id"]) <= known
                assert message["frame"]["actors"]["id"]
                one.send(str(message["n"]))


@contextmanager
def reading(fed: Live) -> Iterator[list[float]]:
    """A page that reads on and answers until the end of the block; yields the times at which frames came."""
    came: list[float] = []
    over = threading.Event()

    def read() -> None:
        with watcher(fed) as one:
            while not over.is_set():
                newest(one, 1)
                came.append(time.monotonic())

    thread = threading.Thread(target=read, daemon=True)
    thread.start()
    until(lambda: len(came) > 10)
    yield came
    over.set()
    thread.join(10.0)


def abuse(one: ClientConnection, how: int, generator: random.Random) -> None:
    """Send a huge message, a flood, noise, or nothing ever."""
    with contextlib.suppress(ConnectionClosed, OSError):
        match how % 4:
            case 0:
                one.send("0" * 1_000_000)
            case 1:
                for _ in range(2000):
                    one.send("1")
            case 2:
                one.send(generator.randbytes(50))


@pytest.mark.thorough
def test_hostile_clients_are_bounded_and_stop_is_heard(fed: Live) -> None:
    """Silent ones, floods, malformed requests, huge messages, half requests that never end."""
    process, generator = psutil.Process(), random.Random(1)
    with reading(fed) as came, contextlib.ExitStack() as stack:
        before = process.memory_info().rss
        for number in range(2 * MAX_CONNECTIONS):
            one = stack.enter_context(contextlib.closing(socket.create_connection(fed.place)))
            with contextlib.suppress(OSError):
                one.sendall([b"GET / HTTP/1.1\r\nHost: x", generator.randbytes(4000), b"X" * 100_000, b""][number % 4])
        sockets = []
        for _ in range(20):
            with contextlib.suppress(ConnectionClosed, OSError, InvalidStatus, TimeoutError):
                sockets.append(stack.enter_context(watcher(fed)))
        for number, hostile in enumerate(sockets):
            abuse(hostile, number, generator)
        assert fed.hub.clients <= MAX_CLIENTS
        until(lambda: fed.hub.dropped >= 2)
        assert ask(fed.place[1], "/stop", method="POST")[0] == 200
        # Those that never answer are gone in the end; the honest page has its frames all the while.
        until(lambda: fed.hub.clients == 1, patience=15.0)
        assert process.memory_info().rss - before < MEMORY
        so_far = len(came)
        until(lambda: len(came) > so_far + 20)
        assert max(later - earlier for earlier, later in pairwise(came)) < STALL
    assert fed.asked == 1


@pytest.mark.thorough
def test_fuzzed_sockets_never_end_the_server(fed: Live) -> None:
    generator = random.Random(2)
    head = (
        f"GET /{fed.token}/socket HTTP/1.1\r\nHost: 127.0.0.1:{fed.place[1]}\r\nUpgrade: websocket\r\n"
        "Connection: Upgrade\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n\r\n"
    ).encode()
    for _ in range(80):
        with contextlib.closing(socket.create_connection(fed.place, timeout=0.1)) as one:
            spoilt = bytearray(head)
            for _change in range(generator.choice((0, 0, 1, 3))):
                spoilt[generator.randrange(len(spoilt))] = generator.randrange(256)
            with contextlib.suppress(OSError):
                one.sendall(bytes(spoilt) + generator.randbytes(generator.randrange(200)))
                one.recv(100)
    with watcher(fed) as honest:
        assert len(newest(honest, 3)) == 3


def test_the_drive_is_said_to_be_over(made: Made) -> None:
    with live(made.drive) as fed:
        deadline, kinds = time.monotonic() + 10.0, [""]
        with watcher(fed) as one:
            newest(one, 2)
            fed.end()
            with contextlib.suppress(ConnectionClosed):
                while time.monotonic() < deadline and kinds[-1] != "over":
                    kinds.append(json.loads(one.recv(timeout=5.0))["type"])
        assert kinds[-1] == "over"
