"""Publishers and subscriptions of ROS 2 over Cyclone DDS alone: names, types and QoS as ROS 2 itself has them.

Everything stays on this machine: see `loopback`. Knows topics, types and bytes; it must not know what stands in a
message.
"""

from __future__ import annotations

import contextlib
import os
from typing import Any, Final, NamedTuple

from vve_sumo.bridges.ros2.loopback import hear_this_machine_alone, udp_sockets
from vve_sumo.errors import ConfigError, RigError
from vve_sumo.wire.ros2.types import encode, store

#: The loopback as the only interface, peers found there by their ports. Fast DDS describes the same types by other
#: hashes; with them its endpoints would never match, so those of its vendor, 1.15, are matched by the types' names.
CONFIGURATION: Final = """<CycloneDDS><Domain id="any">
<General><Interfaces><NetworkInterface address="127.0.0.1"/></Interfaces>
<AllowMulticast>false</AllowMulticast></General>
<Compatibility><IgnoreTypeInformation>1.15</IgnoreTypeInformation></Compatibility>
<Discovery><ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>64</MaxAutoParticipantIndex>
<Peers><Peer address="127.0.0.1"/></Peers></Discovery></Domain></CycloneDDS>"""
DEPTH: Final = 10  #: of a queue of messages


class ReceivedMessage(NamedTuple):
    """A message that has come."""

    topic: str  #: such as `/odom`
    writer: int  #: different for every publisher
    message: Any  #: with the fields of its type; None for bytes that are no such message


class Dds:
    """One participant in one domain, on this machine alone."""

    def __init__(self, domain_id: int) -> None:
        """Join a domain; raises ConfigError without the packages, RigError where DDS cannot begin."""
        store()
        try:
            from cyclonedds import core, domain, idl, pub, qos, sub, topic, util
        except ImportError:
            raise ConfigError("ROS 2 needs rosbags and cyclonedds: pip install 'vve-sumo[ros2]'") from None
        self._idl, self._pub, self._sub, self._topic, self._qos, self._util = idl, pub, sub, topic, qos, util
        self._listener = core.Listener
        self._failure: type[Exception] = core.DDSException
        self._types: dict[str, Any] = {}
        self._writers: dict[str, Any] = {}
        self._readers: list[tuple[str, Any]] = []
        self._listeners: list[Any] = []  # DDS' threads call them, and do not hold them
        self.dropped = 0  #: messages that could not be sent
        before = udp_sockets()
        try:
            self._domain = domain.Domain(domain_id, CONFIGURATION)
            self._participant = domain.DomainParticipant(domain_id)
        except self._failure as error:
            raise RigError(f"ros2: domain {domain_id} cannot be joined ({error})") from None
        # Before the first subscription: nobody else's command is ever heard.
        opened = udp_sockets() - before
        if not opened:
            raise RigError("ros2: the ports of DDS are not found, and cannot be kept to this machine")
        hear_this_machine_alone(opened)
        self._wake, self._awake = os.pipe()
        os.set_blocking(self._wake, False)
        os.set_blocking(self._awake, False)

    def fileno(self) -> int:
        """Return what `select` waits on: it can be read when a message has come."""
        return self._wake

    def advertise(self, name: str, kind: str, *, latched: bool = False) -> None:
        """Make a publisher of a type on a topic such as `/odom`; a `latched` one gives its last to who comes later."""
        topic = self._topic.Topic(self._participant, "rt" + name, self._type(kind))
        self._writers[name] = self._pub.DataWriter(self._participant, topic, qos=self._quality(latched))

    def publish(self, name: str, message: Any) -> None:
        """Send a message on an advertised topic; never waits, and counts what could not be sent."""
        writer = self._writers[name]
        sent = writer.topic.data_type.__new__(writer.topic.data_type)
        sent.cdr = encode(message)
        try:
            writer.write(sent)
        except self._failure:
            self.dropped += 1

    def subscribe(self, name: str, kind: str) -> None:
        """Make a subscription; what comes wakes `fileno` and waits for `heard`."""
        awake = self._awake

        class _Waker(self._listener):  # type: ignore[misc, name-defined]
            def on_data_available(self, _reader: Any) -> None:
                with contextlib.suppress(BlockingIOError):  # it is awake
                    os.write(awake, b"1")

        topic = self._topic.Topic(self._participant, "rt" + name, self._type(kind))
        waker = _Waker()
        reader = self._sub.DataReader(self._participant, topic, qos=self._quality(latched=False), listener=waker)
        self._readers.append((name, reader))
        self._listeners.append(waker)

    def receive(self) -> list[ReceivedMessage]:
        """Return the messages that have come since the last call, in order, topic after topic; never waits."""
        with contextlib.suppress(BlockingIOError):
            while os.read(self._wake, 4096):
                pass
        return [one for name, reader in self._readers for one in self._taken(name, reader)]

    def _taken(self, name: str, reader: Any) -> list[ReceivedMessage]:
        found: list[ReceivedMessage] = []
        # As many messages as a queue holds, and as many notices that a publisher has gone.
        for _ in range(2 * DEPTH):
            try:
                came = reader.take(1)
            except Exception:  # bytes that are no such message
                found.append(ReceivedMessage(name, 0, None))
                continue
            if not came:
                break
            if came[0].sample_info.valid_data:
                found.append(ReceivedMessage(name, came[0].sample_info.publication_handle, came[0]))
        return found

    def has_node(self) -> bool:
        """Whether somebody hears an advertised topic, and somebody publishes on each that is subscribed to."""
        matched = any(writer.get_matched_subscriptions() for writer in self._writers.values())
        return matched and all(reader.get_matched_publications() for _, reader in self._readers)

    def close(self) -> None:
        """Leave the domain."""
        # Returns when no thread of DDS is in a listener: a listener that let the last hold of its reader go would have
        # the reader deleted from within, which waits for the listener's own end.
        for _, reader in self._readers:
            reader.set_listener(None)
        self._writers.clear()
        self._readers.clear()
        del self._participant, self._domain
        os.close(self._wake)
        os.close(self._awake)

    def _quality(self, latched: bool) -> Any:
        policy, now = self._qos.Policy, self._util.duration(seconds=0)
        durability = policy.Durability.TransientLocal if latched else policy.Durability.Volatile
        depth = policy.History.KeepLast(1 if latched else DEPTH)
        return self._qos.Qos(policy.Reliability.Reliable(now), durability, depth)

    def _type(self, name: str) -> Any:
        """Return DDS' class of a ROS 2 type, with the type's fields, made once."""
        if name not in self._types:
            package, _, kind = name.split("/")
            fields = {field: self._of(described) for field, described in store().fielddefs[name][1]}
            made = self._idl.make_idl_struct(f"{kind}_", f"{package}.msg.dds_.{kind}_", fields)
            # What is sent is encoded already.
            made.serialize = lambda self, **_options: self.cdr
            self._types[name] = made
        return self._types[name]

    def _of(self, described: Any) -> Any:
        node, of = described
        types = self._idl.types
        if node.name == "NAME":
            return self._type(of)
        if node.name == "BASE":
            plain = {"bool": bool, "string": str, "byte": types.uint8, "char": types.uint8}
            return plain[of[0]] if of[0] in plain else getattr(types, of[0])
        element, length = self._of(of[0]), of[1]
        if node.name == "ARRAY":
            return types.array[element, length]
        return types.sequence[element, length] if length else types.sequence[element]
