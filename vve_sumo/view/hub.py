"""The pages that watch a live drive: each gets the newest frame, never an old one, and none can hold up another.

A page acknowledges every frame. No more than MAX_IN_FLIGHT are under way to it, so nothing piles up for a page that is
slow, and one that does not answer is dropped. Knows WebSockets and frames; not where frames come from.
"""

from __future__ import annotations

import asyncio
import json
import math
import secrets
from typing import Any, Final

from starlette.websockets import WebSocket, WebSocketDisconnect

from vve_sumo.view import connection
from vve_sumo.view.connection import ANSWER_TIMEOUT, TRY_AGAIN_LATER, DroppedError, Rate, now
from vve_sumo.view.live_frame import LiveFrames

#: pages that watch at a time
MAX_CLIENTS: Final = 8
#: frames that are under way to a page
MAX_IN_FLIGHT: Final = 2
#: messages of a page in a second; a page sends one a frame
MAX_RATE: Final = 200
#: digits of an acknowledgement, at most
MAX_DIGITS: Final = 18
#: events that wait for a page, at most; older ones are left out
MAX_EVENTS: Final = 100


class Client:
    """One page."""

    def __init__(self) -> None:
        self.wake = asyncio.Event()
        self.in_flight = 0
        self.number = 0  #: of the last frame that was sent
        self.answered_at = 0.0  #: when the page last acknowledged a frame, or the first of those under way was sent [s]
        self.known: set[str] = set()  #: actors that the page has been told the body of
        self.events: list[dict[str, Any]] = []


class Hub:
    """Hands frames to the pages; lives in one event loop."""

    def __init__(self, frames: LiveFrames, scene: dict[str, Any]) -> None:
        self._frames, self._scene = frames, scene
        # A page that stays open is told by it that the next drive is another one at the same address.
        self._drive = secrets.token_urlsafe(9)
        self._clients: set[Client] = set()
        self._encoded: tuple[float, str] = (float("-inf"), "")
        self.dropped = 0  #: pages that were dropped for what they did or did not do
        self.over = False
        self._verdict: dict[str, Any] | None = None

    @property
    def clients(self) -> int:
        """How many pages watch."""
        return len(self._clients)

    def changed(self, events: list[dict[str, Any]]) -> None:
        """Say that the drive has a new sample, with these events."""
        for client in self._clients:
            client.events = [*client.events, *events][-MAX_EVENTS:]
            client.wake.set()

    def end(self, verdict: dict[str, Any] | None = None) -> None:
        """Say that the drive is over, and what it came to as `words.verdict_of` has it; None where nobody knows."""
        self.over, self._verdict = True, verdict
        for client in self._clients:
            client.wake.set()

    async def watch(self, socket: WebSocket) -> None:
        """Serve one page until it leaves or has to."""
        await socket.accept()
        if len(self._clients) >= MAX_CLIENTS:
            await socket.close(TRY_AGAIN_LATER, f"{MAX_CLIENTS} pages watch already")
            return
        client = Client()
        self._clients.add(client)
        try:
            dropped = await connection.run(self._send(socket, client), self._hear(socket, client))
        finally:
            self._clients.discard(client)
        self.dropped += dropped
        await connection.close(socket)

    async def _send(self, socket: WebSocket, client: Client) -> None:
        scene = {"type": "scene", "drive": self._drive, "scene": self._whole_scene(client)}
        await connection.send(socket.send_text(json.dumps(scene, allow_nan=False)))
        while True:
            await self._room(client)
            for message in self._news(client):
                await connection.send(socket.send_text(message))
            if self.over:
                await connection.send(socket.send_text(json.dumps({"type": "over", "verdict": self._verdict})))
                return

    async def _room(self, client: Client) -> None:
        """Wait until there is something new and room for it under way."""
        while True:
            client.wake.clear()
            fresh = self._frames.newest is not None and self._frames.newest.tick > client.number
            if self.over or (fresh and client.in_flight < MAX_IN_FLIGHT):
                return
            left = client.answered_at + ANSWER_TIMEOUT - now() if client.in_flight else None
            try:
                await asyncio.wait_for(client.wake.wait(), left)
            except TimeoutError:
                raise DroppedError from None

    def _news(self, client: Client) -> list[str]:
        newest = self._frames.newest
        found = [json.dumps({"type": "event", "event": event}) for event in client.events]
        client.events = []
        if newest is None or newest.tick <= client.number:
            return found
        unknown = {name: self._frames.bodies[name] for name in newest.actors.ids if name not in client.known}
        if unknown:
            client.known |= unknown.keys()
            found.append(json.dumps({"type": "actors", "actors": unknown}))
        client.number = newest.tick
        client.answered_at = client.answered_at if client.in_flight else now()
        client.in_flight += 1
        return [*found, self._frame()]

    def _frame(self) -> str:
        """Return the newest frame's message, encoded once for all pages."""
        newest = self._frames.newest
        assert newest is not None
        if self._encoded[0] != newest.tick:
            message = {"type": "frame", "n": newest.tick, "wall": newest.wall, "frame": self._frames.frame()}
            self._encoded = newest.tick, json.dumps(message, allow_nan=False)
        return self._encoded[1]

    def _whole_scene(self, client: Client) -> dict[str, Any]:
        client.known = set(self._frames.bodies)
        client.number = -1
        return self._scene | {"actors": self._frames.bodies, "events": list(self._frames.events)}

    async def _hear(self, socket: WebSocket, client: Client) -> None:
        """Take the page's acknowledgements; a page that says anything else is dropped."""
        rate = Rate(MAX_RATE)
        while True:
            try:
                text = await socket.receive_text()
            except (WebSocketDisconnect, KeyError):
                return
            number = int(text) if text.isascii() and text.isdecimal() and len(text) <= MAX_DIGITS else math.inf
            if rate.exceeded(now()) or number > client.number:
                raise DroppedError
            client.answered_at = now()
            client.in_flight = max(client.in_flight - 1, 0)
            client.wake.set()
