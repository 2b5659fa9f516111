"""A viewer of topics, written by Foxglove's protocol and its published schemas alone: nothing of ours is in it."""

from __future__ import annotations

import base64
import contextlib
import importlib
import json
import socket
import struct
from typing import Any, NamedTuple
from urllib.parse import urlsplit

from google.protobuf.descriptor_pb2 import FileDescriptorSet
from mcap.records import Schema
from mcap_protobuf.decoder import DecoderFactory
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

PROTOCOLS = ("foxglove.websocket.v1", "foxglove.sdk.v1")
#: of every message [s]
PATIENCE = 90.0


class Got(NamedTuple):
    topic: str
    time: int  #: Unix time [ns]
    content: Any  #: a message of the published protobuf schema, or what JSON holds


class Viewer:
    """A connection, its channels by topic, and what came over it."""

    def __init__(
        self, address: str, protocol: str = PROTOCOLS[0], origin: str | None = None, buffer: int = 1 << 14
    ) -> None:
        # With a small buffer who reads nothing soon holds up who sends.
        parts = urlsplit(address)
        lower = socket.socket()
        lower.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, buffer)
        lower.connect((parts.hostname, parts.port))
        made: Any = connect(
            address,
            sock=lower,
            subprotocols=[protocol],
            origin=origin,
            max_size=None,
            compression=None,
            proxy=None,
            close_timeout=1.0,
        )
        self.socket: ClientConnection = made
        self.info = self.text()
        assert self.info["op"] == "serverInfo"
        advertised = self.text()
        assert advertised["op"] == "advertise"
        self.channels: dict[str, dict[str, Any]] = {one["topic"]: one for one in advertised["channels"]}
        self._topics: dict[int, str] = {}
        self.statuses: list[dict[str, Any]] = []

    def text(self) -> Any:
        return json.loads(self.socket.recv(PATIENCE))

    def subscribe(self, *topics: str) -> None:
        """Subscribe; numbers of subscriptions are not those of channels."""
        wanted = []
        for topic in topics:
            own = 1000 + len(self._topics)
            self._topics[own] = topic
            wanted.append({"id": own, "channelId": self.channels[topic]["id"]})
        self.socket.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))

    def unsubscribe(self, topic: str) -> None:
        own = [number for number, name in self._topics.items() if name == topic]
        self.socket.send(json.dumps({"op": "unsubscribe", "subscriptionIds": own}))

    def next(self) -> Got:
        """Return the next message of a topic; statuses are kept aside."""
        while isinstance(came := self.socket.recv(PATIENCE), str):
            self.statuses.append(json.loads(came))
        return self._got(came)

    def rest(self) -> list[Got]:
        """Return all messages until the server ends; they are decoded when all have come."""
        came: list[str | bytes] = []
        with contextlib.suppress(ConnectionClosed):
            while True:
                came.append(self.socket.recv(PATIENCE))
        self.statuses += [json.loads(one) for one in came if isinstance(one, str)]
        return [self._got(one) for one in came if not isinstance(one, str)]

    def _got(self, came: bytes) -> Got:
        opcode, own, time = struct.unpack_from("<BIQ", came)
        assert opcode == 1
        return Got(self._topics[own], time, self.decoded(self._topics[own], came[13:]))

    def decoded(self, topic: str, content: bytes) -> Any:
        """Decode a message by Foxglove's own classes, and once more by the schema that the channel carries."""
        channel = self.channels[topic]
        if channel["encoding"] == "json":
            return json.loads(content)
        name = channel["schemaName"]
        published = getattr(importlib.import_module(f"foxglove_schemas_protobuf.{name.split('.')[1]}_pb2"), name[9:])
        message = published.FromString(content)
        schema = base64.b64decode(channel["schema"])
        assert FileDescriptorSet.FromString(schema).file
        decoder: Any = DecoderFactory().decoder_for("protobuf", Schema(1, schema, "protobuf", name))
        assert decoder(content).SerializeToString(deterministic=True) == message.SerializeToString(deterministic=True)
        return message

    def close(self) -> None:
        self.socket.close()
