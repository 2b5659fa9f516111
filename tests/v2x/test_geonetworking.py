"""GeoNetworking and BTP-B: tshark reads every header field, and bytes that are no such packet are refused."""

from __future__ import annotations

import math
from dataclasses import fields, replace
from pathlib import Path
from random import Random
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.v2x.packets import ADDRESS, AROUND, SOURCE, spoilt
from tests.v2x.tshark import assert_read, needs_tshark, read
from vve_sumo.v2x import geonetworking
from vve_sumo.v2x.data_elements import StationType
from vve_sumo.v2x.decode_error import MessageDecodeError
from vve_sumo.v2x.geonetworking import PORTS, Area, AreaShape, Packet, PositionVector

BROADCAST = Packet(SOURCE, 2001, b"\x01\x02\x03", traffic_class=2)
FOR_AREA = Packet(SOURCE, 2002, b"\x04\x05", AROUND, 77, 10, 10, 0.4)
UNITS = (0.05, 1.0, 10.0, 100.0)


def drawn(random: Random) -> tuple[Packet, dict[str, Any]]:
    """A packet and the numbers in its header, of which its quantities are made."""
    latitude, longitude = random.randint(-900_000_000, 900_000_000), random.randint(-1_799_999_999, 1_800_000_000)
    speed, heading, time_ms = random.randint(-16_383, 16_383), random.randrange(3600), random.getrandbits(32)
    multiplier, unit = random.randint(32, 63), random.randrange(4)
    hops, traffic_class, port, info = random.randrange(256), random.randrange(64), 2001, random.getrandbits(16)
    kind, address, mobile = random.randrange(16), random.randbytes(6), random.getrandbits(1)
    manual, accurate = random.getrandbits(1), random.getrandbits(1)
    payload = random.randbytes(random.randrange(40))
    source = PositionVector(
        address, StationType(kind), time_ms, latitude / 1e7, longitude / 1e7, speed / 100.0,
        math.radians(90.0 - heading / 10.0), bool(accurate), bool(manual),
    )  # fmt: skip
    numbers = {
        "geonw.bh.version": 1, "geonw.bh.nh": 1, "geonw.bh.lt.mult": multiplier, "geonw.bh.lt.base": unit,
        "geonw.bh.rhl": hops, "geonw.ch.nh": 2, "geonw.ch.tc.id": traffic_class, "geonw.ch.flags.mob": mobile,
        "geonw.ch.plength": len(payload) + 4, "geonw.ch.mhl": 255 - hops, "geonw.src_pos.addr.manual": manual,
        "geonw.src_pos.addr.type": kind, "geonw.src_pos.addr.mid": address.hex(":"), "geonw.src_pos.tst": time_ms,
        "geonw.src_pos.lat": latitude, "geonw.src_pos.long": longitude, "geonw.src_pos.pai": accurate,
        "geonw.src_pos.speed": speed, "geonw.src_pos.hdg": heading, "btpb.dstport": port,
        "btpb.dstportinf": f"0x{info:04x}",
    }  # fmt: skip
    area, sequence = None, 0
    if random.random() < 0.5:
        area, sequence, of_area = drawn_area(random)
        numbers |= of_area
    else:
        numbers["geonw.ch.htype"] = "0x50"
    packet = Packet(
        source, port, payload, area, sequence, hops, 255 - hops, multiplier * UNITS[unit], traffic_class,
        bool(mobile), info,
    )  # fmt: skip
    return packet, numbers


def drawn_area(random: Random) -> tuple[Area, int, dict[str, Any]]:
    shape, sequence = random.choice(list(AreaShape)), random.getrandbits(16)
    latitude, longitude = random.randint(-900_000_000, 900_000_000), random.randint(-1_799_999_999, 1_800_000_000)
    a, b, angle = random.getrandbits(16), random.getrandbits(16), random.randrange(360)
    area = Area(shape, latitude / 1e7, longitude / 1e7, a, b, math.radians(90.0 - angle))
    numbers = {
        "geonw.ch.htype": f"0x4{shape.value}", "geonw.seq_num": f"0x{sequence:04x}", "geonw.gxc.latitude": latitude,
        "geonw.gxc.longitude": longitude, "geonw.gxc.distanceb": b, "geonw.gxc.angle": angle,
        "geonw.gxc.radius" if shape is AreaShape.CIRCLE else "geonw.gxc.distancea": a,
    }  # fmt: skip
    return area, sequence, numbers


@needs_tshark
@pytest.mark.parametrize("packets", [100, pytest.param(1000, marks=pytest.mark.slow)])
def test_tshark_reads_the_numbers_of_which_a_packet_was_made(packets: int, tmp_path: Path) -> None:
    random = Random(3)
    made = [drawn(random) for _ in range(packets)]
    # The payload is no message: what tshark makes of it is of no concern here.
    frames = [geonetworking.ethernet_frame(geonetworking.encode(packet), ADDRESS) for packet, _ in made]
    for found, (_, numbers) in zip(read(frames, tmp_path), made, strict=True):
        assert_read({name: value for name, value in found.items() if not name.startswith("_ws.")}, numbers)


def test_what_was_drawn_is_decoded() -> None:
    random = Random(4)
    for _ in range(200):
        packet, _ = drawn(random)
        found = geonetworking.decode(geonetworking.encode(packet))
        for name in (one.name for one in fields(Packet) if one.name not in {"source", "area", "lifetime"}):
            assert getattr(found, name) == getattr(packet, name)
        assert found.lifetime == pytest.approx(packet.lifetime)
        assert_near(found.source, packet.source, "heading")
        if packet.area is not None:
            assert_near(found.area, packet.area, "orientation")


def assert_near(found: Any, expected: Any, angle: str) -> None:
    """Fail unless two values are the same but for the rounding of an angle on its way to a count and back."""
    off = math.remainder(getattr(found, angle) - getattr(expected, angle), math.tau)
    assert off == pytest.approx(0.0, abs=1e-9)
    assert replace(found, **{angle: 0.0}) == replace(expected, **{angle: 0.0})


@pytest.mark.parametrize(
    ("lifetime", "code"),
    [(0.0, 0x00), (0.05, 0x04), (0.051, 0x08), (3.15, 0xFC), (3.2, 0x11), (60.0, 0xF1), (64.0, 0x1E), (6300.0, 0xFF)],
)
def test_a_lifetime_is_not_shortened(lifetime: float, code: int) -> None:
    data = geonetworking.encode(replace(BROADCAST, lifetime=lifetime))
    assert data[2] == code
    assert geonetworking.decode(data).lifetime >= lifetime - 1e-9


@given(st.floats(-1e6, 1e6))
def test_a_speed_saturates(speed: float) -> None:
    data = geonetworking.encode(replace(BROADCAST, source=replace(SOURCE, speed=speed)))
    assert geonetworking.decode(data).source.speed == pytest.approx(min(max(speed, -163.83), 163.83), abs=0.005 + 1e-9)


@pytest.mark.parametrize("packet", [BROADCAST, FOR_AREA])
def test_padding_is_not_part_of_the_payload(packet: Packet) -> None:
    frame = geonetworking.ethernet_frame(geonetworking.encode(packet), ADDRESS) + bytes(20)
    assert frame[:14] == b"\xff" * 6 + ADDRESS + b"\x89\x47"
    assert geonetworking.decode(geonetworking.packet_of_frame(frame)).payload == packet.payload


@pytest.mark.parametrize(
    "packet",
    [
        *(replace(BROADCAST, source=replace(SOURCE, **{name: value}))
          for name in ("latitude_deg", "longitude_deg", "speed", "heading") for value in (math.nan, math.inf)),
        *(replace(FOR_AREA, area=replace(AROUND, **{name: math.nan}))
          for name in ("latitude_deg", "longitude_deg", "orientation")),
        replace(BROADCAST, source=replace(SOURCE, address=b"12345")),
        replace(BROADCAST, source=replace(SOURCE, time_ms=2**32)),
        replace(FOR_AREA, area=replace(AROUND, distance_a=65_536)),
        replace(FOR_AREA, area=replace(AROUND, distance_b=-1)),
        replace(FOR_AREA, sequence=65_536),
        replace(BROADCAST, lifetime=math.nan),
        replace(BROADCAST, lifetime=6300.1),
        replace(BROADCAST, lifetime=-1.0),
        replace(BROADCAST, hops=256),
        replace(BROADCAST, max_hops=-1),
        replace(BROADCAST, traffic_class=64),
        replace(BROADCAST, port=65_536),
        replace(BROADCAST, port_info=-1),
        replace(BROADCAST, payload=bytes(1395)),
    ],
)  # fmt: skip
def test_what_a_header_cannot_say_is_refused(packet: Packet) -> None:
    with pytest.raises(ValueError, match=r"expected|bytes"):
        geonetworking.encode(packet)


@pytest.mark.parametrize(
    ("place", "byte", "complaint"),
    [
        (0, 0x12, "a secured packet"),
        (0, 0x01, "version 0"),
        (4, 0x10, "BTP-B"),
        (5, 0x51, "header type 0x51"),
        (5, 0x43, "header type 0x43"),
        (9, 0xFF, "announced"),
        (34, 0xFF, "heading"),
        (24, 0x7F, "place"),
    ],
)
def test_another_packet_is_refused_with_its_reason(place: int, byte: int, complaint: str) -> None:
    data = bytearray(geonetworking.encode(BROADCAST))
    data[place] = byte
    with pytest.raises(MessageDecodeError, match=complaint):
        geonetworking.decode(bytes(data))


def test_an_angle_beyond_a_turn_and_another_frame_are_refused() -> None:
    data = bytearray(geonetworking.encode(FOR_AREA))
    data[52:54] = (360).to_bytes(2)
    with pytest.raises(MessageDecodeError, match="angle"):
        geonetworking.decode(bytes(data))
    for frame in (b"", bytes(13), bytes(12) + b"\x08\x00" + bytes(40)):
        with pytest.raises(MessageDecodeError, match="0x8947"):
            geonetworking.packet_of_frame(frame)


@given(spoilt(geonetworking.encode(BROADCAST)) | spoilt(geonetworking.encode(FOR_AREA)))
def test_any_bytes_are_a_packet_or_refused(data: bytes) -> None:
    try:
        found = geonetworking.decode(data)
    except MessageDecodeError:
        return
    assert geonetworking.decode(geonetworking.encode(found)) == found


def test_every_message_has_the_port_of_ts_103_248() -> None:
    ports = {"CAM": 2001, "DENM": 2002, "MAPEM": 2003, "SPATEM": 2004, "CPM": 2009, "VAM": 2018}
    assert {message.name: port for message, port in PORTS.items()} == ports
