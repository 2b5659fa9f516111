"""The MAPEM: tshark reads the counts of which a message was made, a receiver `rounded`; other bytes are refused."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import accumulate
from pathlib import Path
from random import Random
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.v2x.packets import AROUND, frame, spoilt
from tests.v2x.tshark import assert_read, needs_tshark, read
from vve_sumo.v2x import mapem
from vve_sumo.v2x.decode_error import MessageDecodeError
from vve_sumo.v2x.mapem import Connection, Direction, IntersectionGeometry, Lane, LaneKind, Maneuver, Mapem
from vve_sumo.v2x.pdu_header import MessageId

LANE = Lane(
    1, LaneKind.VEHICLE, Direction.INGRESS, ((3.2, -1.5), (50.0, 0.33), (300.0, -20.0)), 2, 4,
    Maneuver.STRAIGHT | Maneuver.RIGHT, (Connection(5, Maneuver.STRAIGHT, 1, 3), Connection(6)),
)  # fmt: skip
WALK = Lane(2, LaneKind.CROSSWALK, Direction.INGRESS | Direction.EGRESS, ((0.0, 0.0), (10.0, 10.0)))
INTERSECTION = IntersectionGeometry(12, 40.0, -83.0, (LANE, WALK), 3, 5, 3.2)
MESSAGE = Mapem(9, (INTERSECTION,), 4)


class Read:
    """What tshark should read: the counts of each name in their order."""

    def __init__(self) -> None:
        self.counts: dict[str, list[Any]] = {}

    def add(self, name: str, count: Any) -> Any:
        self.counts.setdefault(f"dsrc.{name}", []).append(count)
        return count

    def maybe(self, random: Random, name: str, count: int) -> int | None:
        return self.add(name, count) if random.random() < 0.5 else None


def drawn_lane(random: Random, expected: Read) -> Lane:
    lane = expected.add("laneID", random.randrange(256))
    ingress = expected.maybe(random, "ingressApproach", random.randrange(16))
    egress = expected.maybe(random, "egressApproach", random.randrange(16))
    direction, kind = random.randrange(4), random.randrange(8)
    expected.add("directionalUse", f"{direction << 6:02x}")
    expected.add("laneType", kind)
    maneuvers = random.choice((None, random.randrange(2**12)))
    if maneuvers is not None:
        expected.add("maneuvers", (maneuvers << 4).to_bytes(2).hex(":"))
    steps = []
    for _ in range(random.randint(2, 8)):
        bits = random.choice((10, 11, 12, 13, 14, 16))
        steps.append((random.randrange(-(2 ** (bits - 1)), 2 ** (bits - 1)), random.choice((0, 100, -512))))
    for x, y in steps:
        expected.add("x", x)
        expected.add("y", y)
    places = zip(accumulate(x for x, _ in steps), accumulate(y for _, y in steps), strict=True)
    connections = []
    for _ in range(random.randrange(3)):
        to = expected.add("lane", random.randrange(256))
        by = random.choice((None, random.randrange(2**12)))
        if by is not None:
            expected.add("maneuver", (by << 4).to_bytes(2).hex(":"))
        group = expected.maybe(random, "signalGroup", random.randrange(256))
        number = expected.maybe(random, "connectionID", random.randrange(256))
        connections.append(Connection(to, None if by is None else Maneuver(by), group, number))
    return Lane(
        lane, LaneKind(kind), Direction(direction), tuple((x * 0.01, y * 0.01) for x, y in places), ingress, egress,
        None if maneuvers is None else Maneuver(maneuvers), tuple(connections),
    )  # fmt: skip


def drawn(random: Random) -> tuple[Mapem, dict[str, Any]]:
    """A message, and what tshark should read of it."""
    expected, station = Read(), random.getrandbits(32)
    issue = expected.add("msgIssueRevision", random.randrange(128))
    intersections = []
    for _ in range(random.randint(1, 2)):
        region = expected.maybe(random, "region", random.getrandbits(16))
        number = expected.add("id", random.getrandbits(16))
        revision = expected.add("revision", random.randrange(128))
        latitude = expected.add("lat", random.randint(-900_000_000, 900_000_000))
        longitude = expected.add("long", random.randint(-1_799_999_999, 1_800_000_000))
        width = expected.maybe(random, "laneWidth", random.randrange(32_768))
        lanes = tuple(drawn_lane(random, expected) for _ in range(random.randint(1, 4)))
        intersections.append(
            IntersectionGeometry(
                number,
                latitude / 1e7,
                longitude / 1e7,
                lanes,
                region,
                revision,
                None if width is None else width * 0.01,
            )
        )
    header = {"its.protocolVersion": 2, "its.messageID": 5, "its.stationID": station}
    return Mapem(station, tuple(intersections), issue), header | expected.counts


@needs_tshark
@pytest.mark.parametrize("messages", [100, pytest.param(1000, marks=pytest.mark.slow)])
def test_tshark_reads_the_counts_of_which_a_message_was_made(messages: int, tmp_path: Path) -> None:
    random = Random(51)
    made = [drawn(random) for _ in range(messages)]
    found = read([frame(MessageId.MAPEM, mapem.encode(message), AROUND) for message, _ in made], tmp_path)
    optional = {f"dsrc.{name}" for name in ("region", "laneWidth", "maneuvers", "lane", "maneuver", "signalGroup")}
    for fields_of_one, (_, counts) in zip(found, made, strict=True):
        assert_read(fields_of_one, counts)
        assert optional & fields_of_one.keys() == optional & counts.keys()


def nodes_from(steps: list[tuple[float, float]]) -> tuple[tuple[float, float], ...]:
    return tuple(zip(accumulate(x for x, _ in steps), accumulate(y for _, y in steps), strict=True))


flags = st.none() | st.integers(0, 2**12 - 1).map(Maneuver)
steps = st.tuples(st.floats(-320.0, 320.0), st.floats(-320.0, 320.0))
numbers = st.none() | st.integers(0, 255)
lanes = st.builds(
    Lane, st.integers(0, 255), st.sampled_from(LaneKind), st.integers(0, 3).map(Direction),
    st.lists(steps, min_size=2, max_size=5).map(nodes_from), st.none() | st.integers(0, 15),
    st.none() | st.integers(0, 15), flags,
    st.lists(st.builds(Connection, st.integers(0, 255), flags, numbers, numbers), max_size=3).map(tuple),
)  # fmt: skip
intersections = st.builds(
    IntersectionGeometry, st.integers(0, 0xFFFF), st.floats(-90.0, 90.0), st.floats(-180.0, 180.0),
    st.lists(lanes, min_size=1, max_size=3).map(tuple), st.none() | st.integers(0, 0xFFFF), st.integers(0, 127),
    st.none() | st.floats(0.0, 400.0),
)  # fmt: skip
messages_drawn = st.builds(
    Mapem, st.integers(0, 2**32 - 1), st.lists(intersections, max_size=2).map(tuple), st.integers(0, 127)
)


@given(messages_drawn)
def test_a_receiver_reads_rounded(message: Mapem) -> None:
    read_back = mapem.rounded(message)
    assert mapem.decode(mapem.encode(message)) == read_back
    assert mapem.rounded(read_back) == read_back


@given(st.lists(steps, min_size=63, max_size=63))
def test_roundings_do_not_add_up_from_node_to_node(walked: list[tuple[float, float]]) -> None:
    nodes = nodes_from(walked)
    (one,) = mapem.decode(mapem.encode(with_lane(replace(LANE, nodes=nodes)))).intersections
    for found, given_node in zip(one.lanes[0].nodes, nodes, strict=True):
        assert found == pytest.approx(given_node, abs=0.005 + 1e-9)


def with_lane(lane: Lane) -> Mapem:
    return Mapem(9, (replace(INTERSECTION, lanes=(lane,)),))


@pytest.mark.parametrize("function", [mapem.encode, mapem.rounded])
@pytest.mark.parametrize(
    "message",
    [
        *(with_lane(replace(LANE, **{name: value})) for name, value in (
            ("id", 256), ("ingress_approach", 16), ("egress_approach", -1), ("nodes", ((0.0, 0.0),)),
            ("nodes", ((0.0, 0.0),) * 64), ("nodes", ((0.0, math.nan), (1.0, 1.0))),
            ("nodes", ((0.0, math.inf), (1.0, 1.0))), ("nodes", ((0.0, 0.0), (327.68, 0.0))),
            ("connections", (Connection(1),) * 17), ("connections", (Connection(256),)),
            ("connections", (Connection(1, None, 256),)), ("connections", (Connection(1, None, None, -1),)))),
        *(Mapem(9, (replace(INTERSECTION, **{name: value}),)) for name, value in (
            ("id", -1), ("region", 65_536), ("revision", 128), ("latitude_deg", math.nan), ("longitude_deg", 181.0),
            ("lanes", ()), ("lanes", (LANE,) * 256), ("lane_width", -1.0), ("lane_width", math.nan))),
        Mapem(-1, ()), Mapem(9, (), 128), Mapem(9, (INTERSECTION,) * 33),
    ],
)  # fmt: skip
def test_what_no_message_can_say_is_refused(message: Mapem, function: Any) -> None:
    with pytest.raises(ValueError, match="expected"):
        function(message)


@given(spoilt(mapem.encode(MESSAGE)))
def test_any_bytes_are_a_message_or_refused(data: bytes) -> None:
    try:
        found = mapem.decode(data)
    except MessageDecodeError:
        return
    assert mapem.decode(mapem.encode(found)) == mapem.rounded(found)
