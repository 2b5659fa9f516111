"""How many connections a server of a page holds, whoever they are of."""

from __future__ import annotations

import contextlib
import http.client
import re
import shutil
import socket
import ssl
import subprocess
import tracemalloc
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest

from tests.live.patience import until
from tests.view.conftest import serving
from tests.view.feed import live
from tests.view.made import Made
from vve_sumo.view.assets import file
from vve_sumo.view.guard import MAX_HEAD, MAX_SOCKETS, MAX_WAITING
from vve_sumo.view.server import NO_FRAMES, PageServer, hosts_of, page_routes

#: of the buffers of a connection, so that little is under way to who reads nothing [bytes]
NARROW = 4096


def held(port: int) -> int:
    """How many connections the server at a port of this process holds."""
    connections = psutil.Process().net_connections("tcp")
    return sum(one.laddr.port == port and one.status != psutil.CONN_LISTEN for one in connections)


@contextlib.contextmanager
def connected(place: tuple[str, int], count: int, said: bytes = b"") -> Iterator[None]:
    """Open connections that say this, and then neither say nor read anything."""
    with contextlib.ExitStack() as stack:
        for _ in range(count):
            one = stack.enter_context(contextlib.closing(socket.socket()))
            one.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, NARROW)
            one.connect(place)
            with contextlib.suppress(OSError):
                one.sendall(said)
        yield


@pytest.mark.thorough
def test_pages_that_read_nothing_do_not_pile_up(made: Made) -> None:
    with live(made.drive, count=300) as fed:
        fed.server._socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, NARROW)
        head = (
            f"GET /{fed.token}/socket HTTP/1.1\r\nHost: 127.0.0.1:{fed.place[1]}\r\nUpgrade: websocket\r\n"
            "Connection: Upgrade\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n\r\n"
        )
        with connected(fed.place, 3 * MAX_SOCKETS, head.encode()):
            until(lambda: 0 < held(fed.place[1]) <= MAX_SOCKETS)
            # All are open at this end, and none is held at the other one.
            until(lambda: held(fed.place[1]) == 0, patience=20.0)


@pytest.mark.thorough
def test_who_never_begins_with_tls_does_not_keep_a_request_out(tmp_path: Path) -> None:
    if shutil.which("openssl") is None:
        pytest.skip("openssl is not installed")
    make = ["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-subj", "/CN=127.0.0.1"]
    files = [str(tmp_path / name) for name in ("cert.pem", "key.pem")]
    make += ["-addext", "subjectAltName=IP:127.0.0.1", "-out", files[0], "-keyout", files[1]]
    subprocess.run(make, check=True, capture_output=True)
    made = PageServer(page_routes(NO_FRAMES), certificate=files)
    with serving(made) as server, connected(("127.0.0.1", server.port), 3 * MAX_WAITING):
        until(lambda: 0 < held(server.port) <= MAX_WAITING)
        trusting = ssl.create_default_context(cafile=files[0])
        one = http.client.HTTPSConnection("127.0.0.1", server.port, timeout=10.0, context=trusting)
        one.request("GET", f"/{server.token}/main.js")
        assert one.getresponse().status == 200
        one.close()


def answers(port: int, said: bytes) -> list[int]:
    """Return the statuses of a server's answers to bytes that are sent at once."""
    with contextlib.closing(socket.create_connection(("127.0.0.1", port), 10.0)) as one:
        one.sendall(said)
        heard = b""
        with contextlib.suppress(ConnectionResetError):
            while part := one.recv(65_536):
                heard += part
    return [int(status) for status in re.findall(rb"HTTP/1\.1 (\d{3}) ", heard)]


def request(server: PageServer, length: int, *, close: bool = True, path: str = "main.js") -> bytes:
    """A request whose head has so many bytes."""
    ends = "Connection: close\r\n" if close else ""
    start = f"GET /{server.token}/{path} HTTP/1.1\r\nHost: 127.0.0.1:{server.port}\r\n{ends}X: "
    return start.encode() + b"x" * (length - len(start) - 4) + b"\r\n\r\n"


@pytest.mark.parametrize(
    ("length", "status"), [(400, 200), (MAX_HEAD, 200), (MAX_HEAD + 2, 400), (2 * MAX_HEAD, 400), (65_536, 400)]
)
def test_a_head_is_no_longer_than_it_may_be_however_it_comes(length: int, status: int) -> None:
    with serving(PageServer(page_routes(NO_FRAMES))) as server:
        assert answers(server.port, request(server, length)) == [status]


def test_behind_a_request_under_way_no_longer_head_is_taken_either() -> None:
    with serving(PageServer(page_routes(NO_FRAMES))) as server:
        asked = request(server, 400, close=False, path="world.min.js")
        assert answers(server.port, asked + request(server, 400)) == [200, 200]
        assert answers(server.port, asked + request(server, 65_536))[1:] in ([], [400])


def test_names_that_are_asked_for_are_not_kept_in_memory() -> None:
    tracemalloc.start()
    try:
        for number in range(1000):
            assert file(f"{number}" + "x" * 7000) is None
        kept, _most = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert kept < 1e6


def test_a_browser_leaves_the_usual_port_out() -> None:
    assert hosts_of("http", "192.168.1.5", 8080) == {"192.168.1.5:8080"}
    assert hosts_of("http", "192.168.1.5", 80) == {"192.168.1.5:80", "192.168.1.5"}
    assert hosts_of("http", "192.168.1.5", 443) == {"192.168.1.5:443"}
    assert hosts_of("https", "127.0.0.1", 443) == {"127.0.0.1:443", "127.0.0.1", "localhost:443", "localhost"}


def test_an_address_of_version_6_is_said_as_browsers_say_it() -> None:
    with contextlib.closing(socket.socket(socket.AF_INET6)) as one, contextlib.suppress(OSError):
        one.bind(("::1", 0))
        assert re.fullmatch(r"http://\[::1\]:\d+/.*/", PageServer([], address="0:0:0:0:0:0:0:1").address)
