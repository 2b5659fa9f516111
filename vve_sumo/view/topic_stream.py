"""Streams topics to viewers such as Foxglove and Lichtblick by Foxglove's WebSocket protocol, and takes nothing in.

A viewer subscribes to topics and gets their messages; whatever else it sends is refused and changes nothing. Messages
wait for a viewer in a queue of its own: where that is full the oldest are left out, and the viewer is told how many. A
viewer that reads nothing for ANSWER_TIMEOUT is dropped. Knows neither drives nor what messages hold.

Protocol: https://github.com/foxglove/ws-protocol/blob/main/docs/spec.md; `foxglove.sdk.v1` is its newer name.
"""

from __future__ import annotations

import asyncio
import base64
import json
import secrets
import struct
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Final, NamedTuple

from starlette.websockets import WebSocket, WebSocketDisconnect

from vve_sumo.view import connection
from vve_sumo.view.connection import POLICY_VIOLATION, TRY_AGAIN_LATER, DroppedError, Rate, now

PROTOCOLS: Final = ("foxglove.websocket.v1", "foxglove.sdk.v1")
#: viewers at a time
MAX_VIEWERS: Final = 4
#: messages that wait for a viewer; of the ten topics of a drive half a second's
MAX_WAITING: Final = 256
#: messages of a viewer in a second; one subscribes and unsubscribes, by hand or when it opens
MAX_RATE: Final = 50
#: a viewer's message is not longer [bytes]: a subscription to a topic takes 30
MAX_MESSAGE: Final = 8192
#: between two reports to a viewer of what was left out [s]
REPORT_PERIOD: Final = 1.0
#: bytes ahead of the content of a message: opcode, subscription, Unix time [ns]
_HEAD: Final = struct.Struct("<BIQ")
_MESSAGE_DATA: Final = 1
WARNING, ERROR = 1, 2  #: levels of a status


class StreamedTopic(NamedTuple):
    """A topic that viewers may subscribe to."""

    name: str
    encoding: str  #: of the messages
    schema_name: str
    schema_encoding: str
    schema: bytes


class StreamedMessage(NamedTuple):
    """A message of a topic."""

    topic: int  #: index of the topic
    time: int  #: Unix time [ns]
    content: bytes


class Viewer:
    """What waits for one viewer."""

    def __init__(self) -> None:
        self.topics: dict[int, int] = {}  #: subscription to each topic, by the topic's index
        self.waiting: deque[StreamedMessage | str] = deque()  #: messages of topics, and those of the protocol as text
        self.wake = asyncio.Event()
        self.left_out = 0  #: messages left out since the last report

    def put(self, message: StreamedMessage | str) -> int:
        """Have a message wait; return how many were left out for it."""
        self.waiting.append(message)
        self.wake.set()
        if len(self.waiting) <= MAX_WAITING:
            return 0
        self.waiting.popleft()
        self.left_out += 1
        return 1


class TopicStream:
    """Hands the messages of a drive's topics to viewers; lives in one event loop."""

    def __init__(
        self, topics: Sequence[StreamedTopic], first: Callable[[int], StreamedMessage | None], about: Mapping[str, str]
    ) -> None:
        """`first` returns what a new subscriber to a topic gets at once; viewers are told `about` the drive."""
        self._topics, self._first, self._about = topics, first, dict(about)
        self._viewers: set[Viewer] = set()
        self._session = secrets.token_urlsafe(9)
        self._over = False
        self.left_out = 0  #: messages left out for viewers that did not keep up
        self.dropped = 0  #: viewers that were dropped for what they did or did not do

    @property
    def wanted(self) -> frozenset[int]:
        """The topics that somebody subscribes to, by index."""
        return frozenset(topic for viewer in self._viewers for topic in viewer.topics)

    def publish(self, messages: Iterable[StreamedMessage]) -> None:
        """Hand messages to those who subscribe to their topics."""
        for message in messages:
            for viewer in self._viewers:
                if message.topic in viewer.topics:
                    self.left_out += viewer.put(message)

    def end(self) -> None:
        """Have viewers leave once they have got what waits."""
        self._over = True
        for viewer in self._viewers:
            viewer.wake.set()

    async def watch(self, socket: WebSocket) -> None:
        """Serve one viewer until it leaves or has to."""
        offered = [name for name in PROTOCOLS if name in socket.scope["subprotocols"]]
        if not offered:
            await socket.close(POLICY_VIOLATION, f"expected a subprotocol of {' and '.join(PROTOCOLS)}")
            return
        await socket.accept(offered[0])
        if len(self._viewers) >= MAX_VIEWERS:
            await socket.close(TRY_AGAIN_LATER, f"{MAX_VIEWERS} viewers watch already")
            return
        viewer = Viewer()
        self._viewers.add(viewer)
        try:
            dropped = await connection.run(self._send(socket, viewer), self._hear(socket, viewer))
        finally:
            self._viewers.discard(viewer)
        self.dropped += dropped
        await connection.close(socket)

    async def _send(self, socket: WebSocket, viewer: Viewer) -> None:
        for text in (self._server_info(), self._advertised()):
            await connection.send(socket.send_text(text))
        reported = now()
        while True:
            while viewer.waiting:
                message = viewer.waiting.popleft()
                if isinstance(message, str):
                    await connection.send(socket.send_text(message))
                elif message.topic in viewer.topics:
                    head = _HEAD.pack(_MESSAGE_DATA, viewer.topics[message.topic], message.time)
                    await connection.send(socket.send_bytes(head + message.content))
                if viewer.left_out and now() - reported >= REPORT_PERIOD:
                    count, viewer.left_out, reported = viewer.left_out, 0, now()
                    await connection.send(
                        socket.send_text(_status(WARNING, f"{count} messages were left out: read faster"))
                    )
            if self._over:
                return
            viewer.wake.clear()
            await viewer.wake.wait()

    async def _hear(self, socket: WebSocket, viewer: Viewer) -> None:
        """Take subscriptions; a viewer that floods is dropped."""
        rate = Rate(MAX_RATE)
        while True:
            try:
                message = await socket.receive()
            except (WebSocketDisconnect, RuntimeError):
                return
            if message["type"] == "websocket.disconnect":
                return
            text = message.get("text")
            if rate.exceeded(now()) or len(text or message.get("bytes") or "") > MAX_MESSAGE:
                raise DroppedError
            self._take(viewer, text)

    def _take(self, viewer: Viewer, text: str | None) -> None:
        """Take a subscription or the end of one; refuse anything else. Binary messages (None) would publish or call."""
        try:
            said = json.loads(text or "{}")
            match said:
                case {"op": "subscribe", "subscriptions": [*wanted]}:
                    for one in wanted:
                        self._subscribe(viewer, one["id"], one["channelId"])
                case {"op": "unsubscribe", "subscriptionIds": [*ended]}:
                    viewer.topics = {topic: own for topic, own in viewer.topics.items() if own not in ended}
                case _:
                    viewer.put(_status(ERROR, "this server takes subscriptions alone"))
        except (ValueError, KeyError, TypeError, RecursionError):
            viewer.put(_status(ERROR, "this message is not understood"))

    def _subscribe(self, viewer: Viewer, own: Any, channel: Any) -> None:
        topic = channel - 1 if type(channel) is int else -1
        if type(own) is not int or not 0 <= own < 1 << 32 or not 0 <= topic < len(self._topics):
            raise ValueError
        if own in viewer.topics.values() or topic in viewer.topics:
            viewer.put(_status(WARNING, f"subscription {own} to channel {channel}: there is one already"))
            return
        viewer.topics[topic] = own
        if (first := self._first(topic)) is not None:
            viewer.put(first)

    def _server_info(self) -> str:
        # No capability: viewers may not publish, call services or set parameters.
        info = {"name": "vve_sumo", "capabilities": [], "metadata": self._about, "sessionId": self._session}
        return json.dumps({"op": "serverInfo", **info})

    def _advertised(self) -> str:
        """Return the channels, which count from 1."""
        channels = [
            {
                "id": 1 + number,
                "topic": topic.name,
                "encoding": topic.encoding,
                "schemaName": topic.schema_name,
                "schemaEncoding": topic.schema_encoding,
                "schema": _schema_text(topic),
            }
            for number, topic in enumerate(self._topics)
        ]
        return json.dumps({"op": "advertise", "channels": channels})


def _schema_text(topic: StreamedTopic) -> str:
    binary = topic.schema_encoding == "protobuf"
    return base64.b64encode(topic.schema).decode() if binary else topic.schema.decode()


def _status(level: int, message: str) -> str:
    return json.dumps({"op": "status", "level": level, "message": message})
