"""The pages of the people of a live drive: what each says goes in, what it is to show goes out.

A person's page has to be held by one browser at a time. Knows WebSockets and messages of pages, not where reports go.
"""

from __future__ import annotations

import asyncio
import json
from collections import deque
from collections.abc import Callable, Sequence
from typing import Any, Final, NamedTuple

import msgspec
from starlette.routing import BaseRoute, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect

from vve_sumo.people.consent import TEXT, digest
from vve_sumo.people.geolocation import PageEntered, PageMessage, PageStop, read, report_of
from vve_sumo.people.person_view import PersonView
from vve_sumo.people.reports import PositionReport, Report
from vve_sumo.view import connection
from vve_sumo.view.connection import Rate
from vve_sumo.view.server import NO_FRAMES, page_routes

#: between two messages to a page [s]
PERIOD: Final = 0.1
#: of how many messages to pages it is known when they were sent: of the last minute
MAX_KNOWN: Final = 600
#: a page's message is not longer [bytes]
MAX_MESSAGE: Final = 512
#: messages of a page in a second, at most; a page sends about three
MAX_RATE: Final = 30
#: a page that says nothing for so long is left to itself [s]
TIMEOUT: Final = 5.0


class PagePerson(NamedTuple):
    """A person who has a page."""

    id: str
    kind: str
    phone: bool  #: whether the page's own positions count


class PersonPages:
    """The WebSockets of all pages; lives in one event loop."""

    def __init__(
        self, people: Sequence[PagePerson], clock: Callable[[], float], report: Callable[[float, Report], None]
    ) -> None:
        """`clock` gives the drive time [s]; `report` takes what a person says, with the drive time of its arrival."""
        self._people = {person.id: person for person in people}
        self._clock, self._report = clock, report
        self._views: dict[str, PersonView] = {}
        self._state = ""
        self._sent: deque[tuple[int, float]] = deque(maxlen=MAX_KNOWN)
        self._number = 0
        self._held: dict[str, WebSocket] = {}  # by the person's id

    def routes(self) -> list[BaseRoute]:
        """Return the routes of the page, its files among them."""
        return [WebSocketRoute("/socket", self.watch), *page_routes(NO_FRAMES, "person.html")]

    def show(self, state: str, views: Sequence[PersonView]) -> None:
        """Have this shown: the gateway's arming state, and what each person is told."""
        self._state, self._views = state, {view.person: view for view in views}

    async def watch(self, socket: WebSocket) -> None:
        """Serve one page until it leaves or has to."""
        await socket.accept()
        try:
            await connection.run(self._tell(socket), self._hear(socket))
        finally:
            self._held = {name: holder for name, holder in self._held.items() if holder is not socket}
        await connection.close(socket)

    async def _tell(self, socket: WebSocket) -> None:
        people = [person._asdict() for person in self._people.values()]
        hello = {"type": "hello", "people": people, "consent": TEXT, "digest": digest(TEXT)}
        await _send(socket, hello)
        while True:
            self._number += 1
            self._sent.append((self._number, self._clock()))
            held = next((name for name, holder in self._held.items() if holder is socket), "")
            view = self._views.get(held)
            message = {"type": "status", "n": self._number, "state": self._state}
            await _send(socket, message | {"view": None if view is None else msgspec.to_builtins(view)})
            await asyncio.sleep(PERIOD)

    async def _hear(self, socket: WebSocket) -> None:
        rate = Rate(MAX_RATE)
        while True:
            try:
                text = await asyncio.wait_for(socket.receive_text(), TIMEOUT)
            except (WebSocketDisconnect, KeyError, TimeoutError):
                return
            now, message = self._clock(), read(text)
            if rate.exceeded(now) or message is None or not await self._take(socket, message, now):
                return

    async def _take(self, socket: WebSocket, message: PageMessage, now: float) -> bool:
        """Take a page's message; return false for one that no page of ours sends."""
        person = self._people.get(message.person)
        if person is None:
            return False
        holder = self._held.get(person.id)
        if isinstance(message, PageEntered):
            if holder is not None and holder is not socket:
                await _send(socket, {"type": "taken"})
                return True
            if message.consent != digest(TEXT) or any(
                other is socket for name, other in self._held.items() if name != person.id
            ):
                return False
            self._held[person.id] = socket
        elif holder is not socket and not isinstance(message, PageStop):
            # Nothing of somebody who has not agreed is taken, but a stop is: a page that was connected anew may ask for
            # it before the server has noticed that the old connection is gone.
            return False
        report = report_of(message, now, self._sent_at)
        if report is not None and (person.phone or not isinstance(report, PositionReport)):
            self._report(now, report)
        return True

    def _sent_at(self, number: int) -> float:
        """Return the drive time at which a message to a page was sent [s], by its number; NaN where nobody knows."""
        if not self._sent or not self._sent[0][0] <= number <= self._number:
            return float("nan")
        return self._sent[number - self._sent[0][0]][1]


async def _send(socket: WebSocket, message: dict[str, Any]) -> None:
    await connection.send(socket.send_text(json.dumps(message, allow_nan=False)))
