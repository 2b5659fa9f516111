"""What other sensors than the standard radar measured, from their datagrams to messages, tick by tick.

Knows datagrams and messages; it must not know DDS or sockets. A measurement is shown with the tick with which it went
out, or never.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping
from typing import Any, Final

from vve_sumo.sensors.port import Content
from vve_sumo.wire.ros2 import clouds
from vve_sumo.wire.ros2.messages import unix_nanoseconds
from vve_sumo.wire.senses import SenseDatagram, TurnAssembler, decode_sense
from vve_sumo.wire.signature import without_tag

CLOUD: Final = "sensor_msgs/msg/PointCloud2"
#: topics below a sensor's name, and their types, by what the sensor serves
TOPICS_OF: Final[Mapping[Content, Mapping[str, str]]] = {
    "detections": {"points": CLOUD},
    "points": {"points": CLOUD},
    "objects": {"objects": CLOUD, "detections": "vision_msgs/msg/Detection3DArray"},
    "stations": {"stations": CLOUD},
    "stop_lines": {"stop_lines": CLOUD},
}
#: measurements that wait for their tick: those of a bridge that is some ticks late
MAX_WAITING: Final = 20


def topics_of(name: str, contents: tuple[Content, ...]) -> dict[str, str]:
    """Return topics and types of what a sensor serves."""
    return {f"/{name}/{below}": kind for content in contents for below, kind in TOPICS_OF[content].items()}


class Senses:
    """The measurements that wait for their tick."""

    def __init__(self, names: tuple[str, ...], key: bytes) -> None:
        """`names` of the sensors; `key` signs their datagrams, empty for none."""
        self._assemblers = {name: TurnAssembler() for name in names}
        self._key = key
        self._waiting: deque[tuple[str, SenseDatagram]] = deque(maxlen=MAX_WAITING)
        self.unread = 0  #: datagrams that are none, or not signed with the key

    def take(self, name: str, data: bytes) -> None:
        """Take a datagram of a sensor."""
        body = without_tag(data, self._key)
        got = None if body is None else decode_sense(body)
        if not isinstance(got, SenseDatagram):
            self.unread += 1
            return
        whole = got if got.parts == 1 else self._assemblers[name].take(got)
        if whole is not None:
            self._waiting.append((name, whole))

    def of_tick(self, sequence: int) -> Iterator[tuple[str, Any]]:
        """Give topic and message of what went out with a tick; what went out before it is forgotten."""
        waiting = list(self._waiting)
        self._waiting.clear()
        self._waiting.extend(one for one in waiting if one[1].sequence > sequence)
        for name, one in waiting:
            if one.sequence == sequence:
                yield from _messages(name, one)

    def begin(self, sequence: int) -> None:
        """Forget all but what went out with a tick, which is the first of a drive."""
        kept = [one for one in self._waiting if one[1].sequence == sequence]
        self._waiting.clear()
        self._waiting.extend(kept)


def _messages(name: str, one: SenseDatagram) -> Iterator[tuple[str, Any]]:
    at = unix_nanoseconds(one.time)
    if one.scan is not None:
        columns = one.scan.range, one.scan.azimuth, one.scan.range_rate
        yield f"/{name}/points", clouds.radar_cloud(at, *columns, frame=name)
    if one.turn is not None:
        yield f"/{name}/points", clouds.lidar_cloud(at, one.turn, name)
    if one.objects is not None:
        yield f"/{name}/objects", clouds.table_cloud(at, one.objects, name)
        yield f"/{name}/detections", clouds.detections(at, one.objects, name)
    if one.stations is not None:
        yield f"/{name}/stations", clouds.table_cloud(at, one.stations, name)
    if one.stop_lines is not None:
        yield f"/{name}/stop_lines", clouds.table_cloud(at, one.stop_lines, name)
