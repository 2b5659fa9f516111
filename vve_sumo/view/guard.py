"""Who may ask the page's server for what: token, Host, Origin; and how many connections, how large, how long.

The token is the first part of every path, so that the page's own links carry it. A request to stop needs none. Knows
nothing of what is served.
"""

from __future__ import annotations

import asyncio
import contextlib
import hmac
import socket
from collections.abc import Collection
from typing import Any, Final
from urllib.parse import urlsplit

import uvicorn
from starlette.types import ASGIApp, Receive, Scope, Send
from uvicorn.protocols.http.h11_impl import H11Protocol
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol

#: the one request without a token
STOP_PATH: Final = "/stop"
#: connections, whoever they are of; with more, the oldest that no WebSocket holds is closed
MAX_CONNECTIONS: Final = 64
#: a connection that has not sent a whole request by then is closed [s]
REQUEST_TIMEOUT: Final = 5.0
#: connections that are taken at a time: so few that one has asked before as many as MAX_CONNECTIONS came after it
BACKLOG: Final = 16
#: connections that were taken and have not come to a request yet, such as those that never begin with TLS
MAX_WAITING: Final = 64
#: WebSockets: of pages that watch, and of those that were told to leave
MAX_SOCKETS: Final = 16
#: a WebSocket that was told to leave is closed after this time, whatever it has not read [s]
FAREWELL: Final = 2.0
#: the head of a request is not longer [bytes]
MAX_HEAD: Final = 8192

_NO_ROOM: Final = b"HTTP/1.1 503 Service Unavailable\r\nConnection: close\r\nContent-Length: 0\r\n\r\n"
_FORBIDDEN: Final = {
    "host": "this server does not answer to that name",
    "origin": "another site may not ask this server",
    "token": "the address lacks its token: take the whole one that was printed",
}


class Gate:
    """Lets a request through to the application, without the token in its path, or refuses it."""

    def __init__(self, app: ASGIApp, token: str, hosts: Collection[str], foreign: Collection[str] = ()) -> None:
        """`hosts` are names and ports as a browser says them, such as 127.0.0.1:8000.

        `foreign` are paths, after the token, that pages of other sites may ask for as well: the token is enough.
        """
        self._app, self._token = app, token.encode()
        self._hosts, self._foreign = frozenset(hosts), frozenset(foreign)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        wrong = self._wrong(scope)
        if wrong is not None:
            await _refuse(scope, send, _FORBIDDEN[wrong])
            return
        path: str = scope["path"]
        if path != STOP_PATH:
            path = "/" + path[1:].partition("/")[2]
        await self._app({**scope, "path": path, "raw_path": path.encode(), "root_path": ""}, receive, send)

    def _wrong(self, scope: Scope) -> str | None:
        headers: list[tuple[bytes, bytes]] = scope["headers"]
        hosts = [value.decode("latin-1").lower() for name, value in headers if name == b"host"]
        if len(hosts) != 1 or hosts[0] not in self._hosts:
            return "host"
        first = str(scope["path"])[1:].partition("/")
        origins = [value.decode("latin-1") for name, value in headers if name == b"origin"]
        if first[2] not in self._foreign and any(urlsplit_host(one) not in self._hosts for one in origins):
            return "origin"
        if scope["type"] == "http" and scope["path"] == STOP_PATH and scope["method"] == "POST":
            return None
        matches = hmac.compare_digest(first[0].encode(), self._token)
        return None if matches and first[1] else "token"


def urlsplit_host(origin: str) -> str:
    """Return host and port of an origin, in small letters; empty for one that is none."""
    try:
        parts = urlsplit(origin)
        return parts.netloc.lower() if parts.scheme in ("http", "https") else ""
    except ValueError:
        return ""


async def _refuse(scope: Scope, send: Send, text: str) -> None:
    if scope["type"] == "websocket":
        await send({"type": "websocket.close", "code": 1008})
        return
    headers = [(b"content-type", b"text/plain; charset=utf-8"), (b"x-content-type-options", b"nosniff")]
    await send({"type": "http.response.start", "status": 403, "headers": headers})
    await send({"type": "http.response.body", "body": f"{text}\n".encode()})


class Listener(socket.socket):
    """A listening socket: when too many of its connections have not been served yet, the oldest of them is ended."""

    def __init__(self, family: socket.AddressFamily) -> None:
        super().__init__(family, socket.SOCK_STREAM)
        self._waiting: list[socket.socket] = []

    def accept(self) -> tuple[socket.socket, Any]:
        """Take a connection, as a socket does."""
        taken, address = super().accept()
        self._waiting = [*(one for one in self._waiting if one.fileno() >= 0), taken]
        if len(self._waiting) > MAX_WAITING:
            # Whoever reads from it sees its end and closes it.
            with contextlib.suppress(OSError):
                self._waiting.pop(0).shutdown(socket.SHUT_RDWR)
        return taken, address

    def served(self, number: int) -> None:
        """Say that the connection with this file descriptor has come to HTTP."""
        self._waiting = [one for one in self._waiting if one.fileno() not in (-1, number)]


class GuardedConfig(uvicorn.Config):
    """A server's configuration that knows the socket it listens on."""

    listener: Listener


class GuardedSocket(WebSocketsSansIOProtocol):
    """A WebSocket whose end does not depend on a page that reads no more."""

    async def run_asgi(self) -> None:
        """Serve the page, and let go of it."""
        await super().run_asgi()
        self.loop.call_later(FAREWELL, self.transport.abort)


class GuardedConnection(H11Protocol):
    """A connection that is closed when it takes too long to ask for something, or when there are too many."""

    _deadline: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Take a new connection, at the cost of the oldest one that idles."""
        super().connection_made(transport)
        assert isinstance(self.config, GuardedConfig)
        self.config.listener.served(transport.get_extra_info("socket").fileno())
        self._deadline = self.loop.call_later(REQUEST_TIMEOUT, self._give_up)
        idle = [one for one in self.connections if isinstance(one, GuardedConnection) and one is not self]
        if len(self.connections) > MAX_CONNECTIONS and idle:
            oldest = min(idle, key=lambda one: one.born)
            oldest.transport.abort()
            self.connections.discard(oldest)

    def data_received(self, data: bytes) -> None:
        """Take what has come, so that no head of a request is longer than MAX_HEAD, even one that comes at once.

        The parser measures a head only while that is incomplete, so it is given no more at a time than a head may have.
        What waits behind a request under way, which no browser sends, is bounded the same way.
        """
        rest = memoryview(data)
        while rest and not self.transport.is_closing() and self.transport.get_protocol() is self:
            waiting = len(self.conn.trailing_data[0])
            if waiting > MAX_HEAD:
                self.transport.abort()
                return
            size = max(MAX_HEAD - waiting, 1)
            super().data_received(bytes(rest[:size]))
            rest = rest[size:]

    @property
    def born(self) -> float:
        """When the connection's deadline falls due, which is how connections are put in order."""
        return self._deadline.when() if self._deadline is not None else 0.0

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget a connection."""
        if self._deadline is not None:
            self._deadline.cancel()
        super().connection_lost(exc)

    def handle_websocket_upgrade(self, event: Any) -> None:
        """Hand the connection on to a WebSocket, which has limits of its own."""
        if self._deadline is not None:
            self._deadline.cancel()
        if sum(isinstance(one, GuardedSocket) for one in self.connections) >= MAX_SOCKETS:
            self.transport.write(_NO_ROOM)
            self.transport.close()
            return
        super().handle_websocket_upgrade(event)

    def _give_up(self) -> None:
        # Before its first request a connection has no cycle.
        if getattr(self.cycle, "response_complete", True):
            self.transport.abort()
