"""What roadside units say of signals and lanes, read back by the codecs, by tshark and beside sumolib's map."""

from __future__ import annotations

import dataclasses
import datetime
import math
from itertools import pairwise
from pathlib import Path
from typing import Any

import pyproj
import pytest
import sumolib

from tests.sensors.scenes import FUSION
from tests.v2x import tshark
from tests.v2x.packets import ADDRESS
from vve_sumo.errors import ConfigError
from vve_sumo.intersections import Intersection, IntersectionLane, IntersectionLink, SignalPhase
from vve_sumo.sensors.roadside_messages import LANE_LENGTH
from vve_sumo.v2x import geonetworking, its_time, mapem, spatem
from vve_sumo.v2x.data_elements import StationType
from vve_sumo.v2x.mapem import Direction, IntersectionGeometry
from vve_sumo.v2x.pdu_header import MessageId
from vve_sumo.v2x.spatem import IntersectionState, Phase
from vve_sumo.values import Actors, Point, Pose
from vve_sumo.wire.outputs import Context, SignalsOutput
from vve_sumo.wire.roadside import RANGE, RoadsideEncoder
from vve_sumo.wire.sample import NO_SCAN, Sample, SampleContent, no_fix
from vve_sumo.world.intersections import intersections
from vve_sumo.world.network import Network, read_network

#: GNSS second of 2026-11-27 09:59:58.25 UTC, with 18 leap seconds
MOMENT = (datetime.datetime(2026, 11, 27, 9, 59, 58, 250_000) - datetime.datetime(1980, 1, 6)).total_seconds() + 18.0
WGS84 = pyproj.Geod(ellps="WGS84")
LINDEN = Path(__file__).parent.parent.parent / "networks" / "linden.net.xml"


@pytest.fixture(scope="module")
def network() -> Network:
    return read_network(LINDEN)


@pytest.fixture(scope="module")
def reference() -> Any:
    return sumolib.net.readNet(str(LINDEN))


@pytest.fixture(scope="module")
def encoder(network: Network) -> RoadsideEncoder:
    return RoadsideEncoder(intersections(LINDEN), network.frame())


def place_of(signal: Any) -> tuple[float, float]:
    """Return where the lanes that a signal of sumolib's controls end in the mean."""
    ends = {start.getID(): start.getShape()[-1][:2] for start, _end, _index in signal.getConnections()}
    x, y = zip(*ends.values(), strict=True)
    return sum(x) / len(x), sum(y) / len(y)


def maps_of(encoder: RoadsideEncoder, reference: Any) -> dict[str, IntersectionGeometry]:
    """Return each signal's map, found by standing at it."""
    found = {}
    for signal in reference.getTrafficLights():
        said = [geonetworking.decode(packet) for packet in encoder.encode_maps(*place_of(signal), MOMENT)]
        distances = {}
        for packet in said:
            assert packet.port == geonetworking.PORTS[MessageId.MAPEM]
            (one,) = mapem.decode(packet.payload).intersections
            longitude, latitude = reference.convertXY2LonLat(*place_of(signal))
            distances[WGS84.inv(longitude, latitude, one.longitude_deg, one.latitude_deg)[2]] = one
        assert min(distances) < 0.02
        found[signal.getID()] = distances[min(distances)]
    return found


def test_a_map_has_the_lanes_where_they_are(encoder: RoadsideEncoder, reference: Any) -> None:
    """By sumolib's shapes and PROJ's geodesics; a node has steps of a centimetre, a reference point likewise."""
    by_id = {one.signal: one for one in intersections(LINDEN)}
    for name, said in maps_of(encoder, reference).items():
        lanes = (*by_id[name].incoming, *by_id[name].outgoing)
        assert len(said.lanes) == len(lanes)
        for lane, known in zip(said.lanes, lanes, strict=True):
            shape = [point[:2] for point in reference.getLane(known.id).getShape()]
            inwards = lane.direction is Direction.INGRESS
            assert inwards is (known in by_id[name].incoming)
            shape = shape[::-1] if inwards else shape
            length = 0.0
            for number, (x, y) in enumerate(lane.nodes):
                azimuth, distance = math.degrees(math.atan2(x, y)), math.hypot(x, y)
                longitude, latitude, _ = WGS84.fwd(said.longitude_deg, said.latitude_deg, azimuth, distance)
                if number + 1 < len(lane.nodes):
                    expected = reference.convertXY2LonLat(*shape[number])
                    assert WGS84.inv(*expected, longitude, latitude)[2] < 0.04
                if number:
                    length += math.hypot(x - lane.nodes[number - 1][0], y - lane.nodes[number - 1][1])
            whole = sum(math.dist(a, b) for a, b in pairwise(shape))
            assert length == pytest.approx(min(whole, LANE_LENGTH), rel=1e-3)


def test_every_way_across_has_its_signal_group(encoder: RoadsideEncoder, reference: Any) -> None:
    for signal in reference.getTrafficLights():
        said = maps_of(encoder, reference)[signal.getID()]
        numbers = {}
        known = next(one for one in intersections(LINDEN) if one.signal == signal.getID())
        for number, lane in enumerate((*known.incoming, *known.outgoing), 1):
            numbers[number] = lane.id
        links = {
            (numbers[lane.id], numbers[connection.lane], connection.signal_group)
            for lane in said.lanes
            for connection in lane.connections
        }
        assert links == {(start.getID(), end.getID(), index + 1) for start, end, index in signal.getConnections()}


def states(packets: Any) -> list[tuple[geonetworking.Packet, IntersectionState]]:
    decoded = [geonetworking.decode(packet) for packet in packets]
    return [(packet, spatem.decode(packet.payload).intersections[0]) for packet in decoded]


def test_a_signal_says_what_sumo_shows_and_until_when(encoder: RoadsideEncoder, reference: Any) -> None:
    signal = reference.getTLS("229685447")
    letters, remaining = "rugGyYsoOrrrrG", 5.33
    (found,) = [
        state
        for _packet, state in states(
            encoder.encode_signals(*place_of(signal), MOMENT, {"229685447": SignalPhase(letters, remaining)})
        )
    ]
    assert [movement.signal_group for movement in found.movements] == list(range(1, 15))
    assert [movement.events[0].phase.value for movement in found.movements] == [
        3, 4, 5, 6, 7, 8, 2, 9, 1, 3, 3, 3, 3, 6
    ]  # fmt: skip
    # 09:59:58.25 and 5.33 s are 10:00:03.58: a tenth less, for it must not end before.
    assert [movement.events[0].min_end for movement in found.movements] == pytest.approx([3.5] * 14)
    new_year = datetime.datetime(2026, 1, 1)
    minutes = (datetime.datetime(2026, 11, 27, 9, 59) - new_year) // datetime.timedelta(minutes=1)
    assert (found.minute_of_year, found.second) == (minutes, pytest.approx(58.25, abs=1e-3))
    geometry = maps_of(encoder, reference)["229685447"]
    assert found.id == geometry.id


def test_a_signal_that_is_off_says_no_end(encoder: RoadsideEncoder, reference: Any) -> None:
    place = place_of(reference.getTLS("229685447"))
    for remaining in (3600.0, math.inf):
        ((_packet, found),) = states(
            encoder.encode_signals(*place, MOMENT, {"229685447": SignalPhase(14 * "o", remaining)})
        )
        assert {movement.events[0] for movement in found.movements} == {spatem.Event(Phase.CAUTION_CONFLICTING_TRAFFIC)}


def test_who_is_far_is_not_told_of(encoder: RoadsideEncoder, reference: Any) -> None:
    signals = reference.getTrafficLights()
    for signal in signals:
        x, y = place_of(signal)
        near = [one for one in signals if math.dist(place_of(one), (x, y)) <= RANGE]
        assert len(encoder.encode_maps(x, y, MOMENT)) == len(near)
    assert not encoder.encode_maps(1e5, 1e5, MOMENT)


def sample(time: float, place: tuple[float, float], signals: dict[str, SignalPhase]) -> Sample:
    pose = Pose(time, Point.REAR_AXLE, *place, 0.0, 5.0, 0.0, 0.0, 0.0, 0.0)
    content = SampleContent(no_fix(MOMENT + time, time), pose, NO_SCAN, math.inf, Actors.none(time), signals=signals)
    return Sample(1, MOMENT + time, time, content)


@tshark.needs_tshark
def test_tshark_reads_the_packets_of_two_seconds(network: Network, reference: Any, tmp_path: Path) -> None:
    frame = network.frame()
    output = SignalsOutput(Context(FUSION, frame.projection, frame.offset, intersections=intersections(LINDEN)))
    place = place_of(reference.getTLS("229685447"))
    packets = []
    for tick in range(100):
        shown = {"229685447": SignalPhase(14 * ("G" if tick < 50 else "r"), 60.0)}
        said = output.step(sample(0.02 * tick, place, shown))
        packets += [(tick, packet) for packet in said]
    read = tshark.read([geonetworking.ethernet_frame(packet, ADDRESS) for _tick, packet in packets], tmp_path)
    maps = [tick for (tick, _packet), fields in zip(packets, read, strict=True) if "dsrc.laneSet" in fields]
    assert len(maps) % 2 == 0
    assert set(maps) == {0, 50}
    phases = [
        (tick, set(fields["dsrc.eventState"]))
        for (tick, _packet), fields in zip(packets, read, strict=True)
        if "dsrc.eventState" in fields
    ]
    assert phases == [(5 * number, {"6"} if number < 10 else {"3"}) for number in range(20)]
    for fields in read:
        assert not [name for name in fields if name.startswith("_ws.")]


def test_while_invalid_nothing_is_sent(network: Network, reference: Any) -> None:
    frame = network.frame()
    output = SignalsOutput(Context(FUSION, frame.projection, frame.offset, intersections=intersections(LINDEN)))
    place = place_of(reference.getTLS("229685447"))
    valid = sample(1.0, place, {"229685447": SignalPhase(14 * "G", 1.0)})
    assert not output.step(dataclasses.replace(valid, measured=None))
    assert output.step(valid)
    rehearsal = SignalsOutput(Context(FUSION, ""))
    assert not rehearsal.step(valid)


def test_the_source_is_a_roadside_unit_that_stands(encoder: RoadsideEncoder, reference: Any) -> None:
    x, y = place_of(reference.getTLS("229685447"))
    for data in encoder.encode_maps(x, y, MOMENT):
        packet = geonetworking.decode(data)
        said = mapem.decode(packet.payload)
        assert (packet.mobile, packet.source.station_type) == (False, StationType.INFRASTRUCTURE)
        assert packet.source.time_ms == its_time.from_gnss(MOMENT) % 2**32
        assert packet.source.address[2:] == said.station.to_bytes(4)
        assert packet.source.latitude_deg == pytest.approx(said.intersections[0].latitude_deg, abs=1e-7)


def test_an_intersection_that_no_message_can_hold_is_one_line(network: Network) -> None:
    def lane(number: int) -> IntersectionLane:
        points = tuple((10.0 * number + 0.1 * k, float(k)) for k in range(60))
        return IntersectionLane(f"e_{number}", "e", "vehicle", points, 3.2)

    lanes = tuple(map(lane, range(40)))
    links = tuple(IntersectionLink(k, one.id, one.id, "s") for k, one in enumerate(lanes))
    big = Intersection("big", lanes, lanes, links)
    with pytest.raises(ConfigError, match="signal big: its lanes do not fit a MAPEM"):
        RoadsideEncoder([big], network.frame())


def test_maps_of_all_sorts_are_read_back(network: Network) -> None:
    for one in intersections(LINDEN):
        (data,) = RoadsideEncoder([one], network.frame()).encode_maps(*one.incoming[0].points[-1], MOMENT)
        (said,) = mapem.decode(geonetworking.decode(data).payload).intersections
        assert {lane.ingress_approach for lane in said.lanes} - {None} == set(
            range(1, 1 + len({lane.edge for lane in one.incoming}))
        )
