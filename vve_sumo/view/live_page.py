"""Reads the page of a live drive as a browser does: the scene, the actors and the newest frame, each acknowledged.

To the drive it is one page more: what it does, or that it does nothing, holds up nobody. Knows the messages of `hub`;
nothing of how frames are drawn.
"""

from __future__ import annotations

import contextlib
import json
import ssl
import threading
from types import TracebackType
from typing import Any, Final, NamedTuple, Self
from urllib.parse import urlsplit

from websockets.exceptions import ConnectionClosed, InvalidHandshake
from websockets.sync.client import ClientConnection, connect

from vve_sumo.errors import ConfigError

#: for the connection and the first message [s]
TIMEOUT: Final = 10.0
#: a message of the page's server is not longer [bytes]: the scene holds a whole street
MAX_MESSAGE: Final = 1 << 26


class LiveFrame(NamedTuple):
    """The newest frame of a live drive."""

    number: int  #: of its tick
    frame: dict[str, Any]  #: as `live_frame` makes it
    actors: dict[str, Any]  #: bodies of actors that came after the frame that was taken before, by name


class LivePage:
    """A reader of a live drive's page, in a thread of its own; a context manager that ends it."""

    def __init__(self, address: str) -> None:
        """Connect to a page by its whole address, with the token; raises ConfigError where that fails."""
        parts = urlsplit(address)
        secure = parts.scheme == "https"
        socket = parts._replace(scheme="wss" if secure else "ws", path=f"{parts.path}socket").geturl()
        self._open = contextlib.ExitStack()
        try:
            connection = connect(
                socket,
                ssl=_unverified() if secure else None,
                compression=None,
                max_size=MAX_MESSAGE,
                open_timeout=TIMEOUT,
                proxy=None,
            )
            self._socket: ClientConnection = self._open.enter_context(connection)
            first = json.loads(self._socket.recv(TIMEOUT))
        except (OSError, InvalidHandshake, ConnectionClosed) as error:
            raise ConfigError(f"the page of the live drive does not answer: {error}") from None
        self.scene: dict[str, Any] = first["scene"]
        self._news = threading.Condition()
        self._newest: tuple[int, dict[str, Any]] | None = None
        self._actors: dict[str, Any] = {}
        self._over = False
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._thread.start()

    def newer(self, number: int) -> LiveFrame | None:
        """Wait for a frame of a later tick than a number, and return the newest; None once the drive is over."""
        with self._news:
            self._news.wait_for(lambda: self._over or (self._newest is not None and self._newest[0] > number))
            if self._over:
                return None
            assert self._newest is not None
            actors, self._actors = self._actors, {}
            return LiveFrame(*self._newest, actors)

    def _listen(self) -> None:
        try:
            for text in self._socket:
                message = json.loads(text)
                if not self._take(message):
                    break
                if message["type"] == "frame":
                    self._socket.send(str(message["n"]))
        except (ConnectionClosed, OSError):
            pass
        with self._news:
            self._over = True
            self._news.notify_all()

    def _take(self, message: dict[str, Any]) -> bool:
        """Keep what a message says; return whether more is to come."""
        with self._news:
            if message["type"] == "frame":
                self._newest = message["n"], message["frame"]
            elif message["type"] == "actors":
                self._actors |= message["actors"]
            self._news.notify_all()
        return bool(message["type"] != "over")

    def close(self) -> None:
        """Leave the page."""
        self._open.close()
        self._thread.join(TIMEOUT)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def _unverified() -> ssl.SSLContext:
    """Return a context for a page of this computer, whose certificate names whom other computers know it as.

    The address comes from a file that its owner alone may read, and the way leaves this computer nowhere.
    """
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.check_hostname = False
    context.verify_mode = ssl.CERT_NONE
    return context
