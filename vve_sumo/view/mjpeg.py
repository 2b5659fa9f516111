"""Sends pictures over HTTP one after the other, as a network camera does: Motion JPEG, in real time.

Listens on this computer alone. Who connects gets the pictures from the first one on; one at a time is served.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable
from http.server import BaseHTTPRequestHandler, HTTPServer
from typing import Final

from vve_sumo.errors import ConfigError

ADDRESS: Final = "127.0.0.1"
BOUNDARY: Final = "picture"
MEDIA_TYPE: Final = f"multipart/x-mixed-replace; boundary={BOUNDARY}"
#: a client that takes nothing for so long is given up [s]
PATIENCE: Final = 10.0

Draw = Callable[[float], bytes]


def part_of(picture: bytes, time: float) -> bytes:
    """Return the part of the stream that holds the JPEG picture of a drive time [s]."""
    head = f"--{BOUNDARY}\r\nContent-Type: image/jpeg\r\nContent-Length: {len(picture)}\r\n"
    return f"{head}X-Drive-Time: {time:.6f}\r\n\r\n".encode() + picture + b"\r\n"


class MjpegServer:
    """Serves the pictures of a span of drive time."""

    def __init__(self, port: int, draw: Draw, begin: float, end: float, rate: float) -> None:
        """Listen on a port of this computer, 0 for any; `draw` returns the JPEG picture of a drive time [s].

        Pictures are due `rate` times a second [1/s] from `begin` to `end`; raises ConfigError where the port is taken.
        """
        try:
            self._server = HTTPServer((ADDRESS, port), _handler(draw, begin, end, rate))
        except OSError as error:
            raise ConfigError(f"--mjpeg {port}: cannot listen on {ADDRESS}: {error.strerror}") from None

    @property
    def url(self) -> str:
        """Where the pictures are."""
        return f"http://{ADDRESS}:{self._server.server_port}/"

    def serve_one(self) -> None:
        """Wait for a client and send it the pictures, or until it goes away."""
        self._server.handle_request()

    def close(self) -> None:
        """Stop listening."""
        self._server.server_close()


def _handler(draw: Draw, begin: float, end: float, rate: float) -> type[BaseHTTPRequestHandler]:
    class Handler(BaseHTTPRequestHandler):
        timeout = PATIENCE

        def do_GET(self) -> None:
            self.send_response(200)
            self.send_header("Content-Type", MEDIA_TYPE)
            self.send_header("Cache-Control", "no-store")
            self.end_headers()
            with contextlib.suppress(ConnectionError, TimeoutError):
                self._pictures()

        def _pictures(self) -> None:
            started, last = time.monotonic(), -1
            while True:
                # The newest picture that is due: where drawing takes longer than that, some are left out.
                due = max(int((time.monotonic() - started) * rate), last + 1)
                wait = due / rate - (time.monotonic() - started)
                if wait > 0.0:
                    time.sleep(wait)
                at = begin + due / rate
                if at > end + 1e-9:
                    return
                self.wfile.write(part_of(draw(at), at))
                last = due

        def log_message(self, *_: object) -> None:
            pass

    return Handler
