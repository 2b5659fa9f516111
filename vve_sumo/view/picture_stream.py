"""Serves the newest picture to every viewer as Motion JPEG: a picture that came too soon for a viewer is left out.

Token, Host and the number of connections are the page's (`server`). Knows nothing of how pictures are drawn.
"""

from __future__ import annotations

import asyncio
import threading
from collections.abc import AsyncIterator
from types import TracebackType
from typing import Final, Self

from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response, StreamingResponse
from starlette.routing import Route

from vve_sumo.view.mjpeg import BOUNDARY, MEDIA_TYPE, part_of
from vve_sumo.view.server import PageServer

#: viewers at a time
MAX_VIEWERS: Final = 8
#: for viewers to get the last part [s]
FAREWELL: Final = 0.2
#: for the server to end [s]
ENDING: Final = 5.0


class PictureStream:
    """A server of pictures on this computer, in a thread of its own; a context manager that ends it."""

    def __init__(self, port: int, token: str) -> None:
        """Listen on a port, 0 for any; who asks needs the token. Raises ConfigError where the port is taken."""
        self._server = PageServer([Route("/", self._watch)], port=port, token=token, table=f"--mjpeg {port}")
        self._newest: tuple[int, bytes] = (0, b"")
        self._viewers = 0
        self._over = False
        self._changed = asyncio.Event()
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    @property
    def url(self) -> str:
        """Where the pictures are, the token included."""
        return self._server.address

    def publish(self, picture: bytes, time: float) -> None:
        """Have viewers get a JPEG picture of a drive time [s]."""
        self._loop.call_soon_threadsafe(self._take, part_of(picture, time))

    def close(self) -> None:
        """End the pictures of all viewers, and the server."""
        self._loop.call_soon_threadsafe(self._end)
        self._thread.join(ENDING)

    def _serve(self) -> None:
        with asyncio.Runner(loop_factory=lambda: self._loop) as runner:
            runner.run(self._server.serve())

    def _take(self, part: bytes) -> None:
        self._newest = self._newest[0] + 1, part
        self._wake()

    def _end(self) -> None:
        self._over = True
        self._wake()
        self._loop.call_later(FAREWELL, self._server.close)

    def _wake(self) -> None:
        changed, self._changed = self._changed, asyncio.Event()
        changed.set()

    async def _watch(self, request: Request) -> Response:
        if self._viewers >= MAX_VIEWERS:
            return PlainTextResponse(f"{MAX_VIEWERS} viewers look already\n", 503)
        headers = {"Cache-Control": "no-store", "X-Content-Type-Options": "nosniff", "Referrer-Policy": "no-referrer"}
        return StreamingResponse(self._parts(), 200, headers, MEDIA_TYPE)

    async def _parts(self) -> AsyncIterator[bytes]:
        self._viewers += 1
        number = 0
        try:
            while not self._over:
                changed = self._changed
                if self._newest[0] > number:
                    number, part = self._newest
                    yield part
                else:
                    await changed.wait()
            yield f"--{BOUNDARY}--\r\n".encode()
        finally:
            self._viewers -= 1

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
