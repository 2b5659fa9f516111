"""The page's server: a socket on this machine, an address with a token, and the files of the page with their data.

Runs in the thread that calls it. Knows libraries of records and live hubs by what they return, not how they are made.
"""

from __future__ import annotations

import asyncio
import contextlib
import ipaddress
import json
import secrets
import socket
import ssl
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, Final

import uvicorn
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response
from starlette.routing import BaseRoute, Route

from vve_sumo.errors import ConfigError, VveError
from vve_sumo.view.assets import POLICY, file
from vve_sumo.view.guard import BACKLOG, MAX_HEAD, Gate, GuardedConfig, GuardedConnection, GuardedSocket, Listener
from vve_sumo.view.library import Library, ViewedRecord

LOOPBACK: Final = "127.0.0.1"
#: a WebSocket's message from a page is not longer [bytes]: a page only acknowledges frames
MAX_MESSAGE: Final = 64
#: what the kernel holds of a connection's unread bytes: little, so that a slow reader's live data are not old [bytes]
UNREAD: Final = 1 << 18
#: messages of a page that wait to be read, at most
MAX_WAITING: Final = 8
#: pages that may hold the page of a record in a frame: notebooks on this machine
FRAMES: Final = "frame-ancestors 'self' http://127.0.0.1:* http://localhost:*"
NO_FRAMES: Final = "frame-ancestors 'none'"

#: that a browser leaves out of the names it says
_USUAL_PORTS: Final = {"http": 80, "https": 443}

_HEADERS: Final = {
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
    "Cross-Origin-Resource-Policy": "same-origin",
}


class _Quiet(uvicorn.Server):
    """A server that leaves the process's signals as they are."""

    @contextlib.contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Take over no signal: who runs the server decides what ends it."""
        yield


class PageServer:
    """A server of one page; who connects before it serves waits for that."""

    def __init__(
        self,
        routes: Sequence[BaseRoute],
        *,
        address: str = LOOPBACK,
        port: int = 0,
        token: str = "",
        certificate: Sequence[str] = (),
        max_message: int = MAX_MESSAGE,
        foreign: Sequence[str] = (),
        table: str = "view",
    ) -> None:
        """Listen on an address of this machine and a port, 0 for any free one; without a `token` one is made.

        A WebSocket's message from a page is not longer than `max_message` bytes. `foreign` are paths that pages of
        other sites may ask for. `table` names the rig's in errors.

        With a `certificate`, the paths of its file and of its key's, the page is served over HTTPS. Raises ConfigError
        where the address cannot be bound or the certificate cannot be used.
        """
        _check(certificate, table)
        self._scheme = "https" if certificate else "http"
        self.token = token or secrets.token_urlsafe(18)
        self._socket = Listener(socket.AF_INET6 if ":" in address else socket.AF_INET)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, UNREAD)  # its connections inherit it
        try:
            self._socket.bind((address, port))
            self._socket.listen()
        except OSError as error:
            self._socket.close()
            raise ConfigError(f"{table}: cannot listen on {address} port {port}: {error.strerror}") from None
        self.port = int(self._socket.getsockname()[1])
        # As browsers write it: there is one shortest form of an address of version 6.
        self.host = f"[{ipaddress.ip_address(address).compressed}]" if ":" in address else address
        app = Gate(Starlette(routes=list(routes)), self.token, hosts_of(self._scheme, self.host, self.port), foreign)
        config = _config(app, certificate, max_message)
        config.listener = self._socket
        self._uvicorn = _Quiet(config)

    @property
    def address(self) -> str:
        """What a browser opens."""
        return f"{self._scheme}://{self.host}:{self.port}/{self.token}/"

    async def serve(self) -> None:
        """Serve until `close` is called, in an event loop of the caller's."""
        await self._uvicorn.serve([self._socket])

    def run(self) -> None:
        """Serve until `close` is called from another thread, or the keyboard ends it."""
        asyncio.run(self.serve())

    def close(self) -> None:
        """End the server."""
        self._uvicorn.should_exit = True
        self._uvicorn.force_exit = True


def hosts_of(scheme: str, host: str, port: int) -> frozenset[str]:
    """Return the hosts that a browser may say it asks; it leaves out a port that is the usual one."""
    names = frozenset((host, "localhost") if host == LOOPBACK else (host,))
    return frozenset(f"{name}:{port}" for name in names) | (names if port == _USUAL_PORTS[scheme] else frozenset())


def _check(certificate: Sequence[str], table: str) -> None:
    """Raise ConfigError unless a certificate's file and its key's belong together and can be read.

    A key with a password is refused: nobody is there to type it.
    """
    if not certificate:
        return
    try:
        ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER).load_cert_chain(certificate[0], certificate[1], password=lambda: b"")
    except (OSError, ssl.SSLError) as error:
        raise ConfigError(
            f"{table}: {' and '.join(certificate)}: expected a certificate and its key: {error}"
        ) from None


def _config(app: Gate, certificate: Sequence[str], max_message: int) -> GuardedConfig:
    file, key = certificate or (None, None)
    return GuardedConfig(
        app,
        ssl_certfile=file,
        ssl_keyfile=key,
        http=GuardedConnection,
        ws=GuardedSocket,
        backlog=BACKLOG,
        ws_max_size=max_message,
        ws_max_queue=MAX_WAITING,
        ws_per_message_deflate=False,
        lifespan="off",
        log_config=None,
        log_level="critical",
        access_log=False,
        proxy_headers=False,
        server_header=False,
        h11_max_incomplete_event_size=MAX_HEAD,
        timeout_graceful_shutdown=1,
    )


def page_routes(policy: str, page: str = "index.html") -> list[BaseRoute]:
    """Return the routes of a page's own files; `policy` says who may hold the page in a frame."""

    async def send(request: Request) -> Response:
        found = file(request.path_params.get("name") or page)
        if found is None:
            return PlainTextResponse("no such file\n", 404, _HEADERS)
        headers = _HEADERS | {"Content-Security-Policy": f"{POLICY}; {policy}"}
        return Response(found.content, 200, headers, found.kind)

    return [Route("/", send), Route("/{name}", send)]


def json_route(path: str, content: Callable[[Request], Any]) -> BaseRoute:
    """Return the route of a document."""

    async def send(request: Request) -> Response:
        return _document(content(request))

    return Route(path, send)


def library_routes(library: Library) -> list[BaseRoute]:
    """Return the routes of a page that shows records or a sweep."""

    async def send(request: Request) -> Response:
        part = _PARTS.get(request.path_params["part"])
        try:
            record = await run_in_threadpool(library.record, request.path_params["key"])
            if record is None or part is None:
                return PlainTextResponse("no such record\n", 404, _HEADERS)
            return await run_in_threadpool(part, record)
        except VveError as error:
            return PlainTextResponse(f"{error}\n", 409, _HEADERS)

    async def table(request: Request) -> Response:
        content = await run_in_threadpool(library.table)
        return PlainTextResponse("no sweep\n", 404, _HEADERS) if content is None else _binary(content)

    return [
        json_route("/contents.json", lambda request: library.contents(request.query_params.get("run"))),
        Route("/record/{key}/{part}", send),
        Route("/sweep.bin", table),
        *page_routes(FRAMES),
    ]


def _document(content: Any) -> Response:
    # Names may hold half a character, which JSON can say and UTF-8 cannot.
    return Response(json.dumps(content, allow_nan=False), headers=_HEADERS, media_type="application/json")


def _binary(content: bytes) -> Response:
    return Response(content, headers=_HEADERS, media_type="application/octet-stream")


_PARTS: Final[dict[str, Callable[[ViewedRecord], Response]]] = {
    "scene.json": lambda record: _document(record.scene()),
    "frames.bin": lambda record: _binary(record.frames()),
    "details.bin": lambda record: _binary(record.details()),
}


def replay_server(folders: Sequence[Path], port: int = 0) -> PageServer:
    """Return a server of one sweep, or of one or two records; raises ConfigError as `Library` does."""
    return PageServer(library_routes(Library(folders)), port=port)
