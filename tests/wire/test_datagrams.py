"""Own datagrams: what goes in comes out, and no bytes that are changed are taken for a setpoint."""

from __future__ import annotations

import math
import struct
import zlib
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vve_sumo.wire import datagrams
from vve_sumo.wire.datagrams import RadarDatagram, SetpointDatagram, Target, Wrong

SINGLE = st.floats(-1e6, 1e6, width=32)
TIME = st.floats(0.0, 2e9)
LIFETIME = st.integers(1, 100_000).map(lambda us: us / 1e6)
SEQUENCE = st.integers(0, datagrams.SEQUENCES - 1)
TARGETS = st.builds(
    Target, number=st.integers(0, 0xFFFF), range=SINGLE, azimuth=SINGLE, range_rate=SINGLE, mode=st.integers(0, 1)
)
RADARS = st.builds(
    RadarDatagram,
    sequence=SEQUENCE,
    time=TIME,
    lifetime=LIFETIME,
    measured=TIME,
    speed=SINGLE,
    yaw_rate=SINGLE,
    targets=st.lists(TARGETS, max_size=datagrams.MAX_TARGETS).map(tuple),
)
SETPOINTS = st.builds(
    SetpointDatagram,
    sequence=SEQUENCE,
    answers=SEQUENCE,
    time=TIME,
    lifetime=LIFETIME,
    steering=SINGLE,
    acceleration=SINGLE,
    emergency=st.booleans(),
)


@given(radar=RADARS)
def test_a_radar_datagram_comes_back(radar: RadarDatagram) -> None:
    assert datagrams.decode_radar(datagrams.encode_radar(radar)) == radar


@given(radar=RADARS)
def test_an_invalid_radar_datagram_carries_nothing_to_drive_by(radar: RadarDatagram) -> None:
    back = datagrams.decode_radar(datagrams.encode_radar(replace(radar, valid=False)))
    assert back is not None
    assert not back.valid
    assert back.targets == ()
    assert (back.measured, back.speed, back.yaw_rate) == (0.0, 0.0, 0.0)
    assert (back.sequence, back.time) == (radar.sequence, radar.time)


@given(asked=SETPOINTS)
def test_a_setpoint_comes_back(asked: SetpointDatagram) -> None:
    data = datagrams.encode_setpoint(asked)
    assert len(data) == datagrams.SETPOINT_LENGTH == 44
    assert datagrams.decode_setpoint(data) == asked


def test_places_of_the_fields_as_documented() -> None:
    asked = SetpointDatagram(7, 8, 9.0, 0.05, 0.25, -1.5, emergency=True)
    data = datagrams.encode_setpoint(asked)
    assert struct.unpack("<4s2B1H2I1d2f2I", data[:40]) == (b"VVES", 1, 2, 1, 7, 50_000, 9.0, 0.25, -1.5, 8, 0)
    assert struct.unpack("<I", data[40:])[0] == zlib.crc32(data[:40])
    seen = RadarDatagram(1, 2.0, 0.1, 3.0, 4.0, 0.5, (Target(6, 7.0, 0.25, -8.0, 1),))
    data = datagrams.encode_radar(seen)
    assert struct.unpack("<4s2B1H2I2d2f2I3f1H2B", data[:64]) == (
        b"VVES",
        1,
        1,
        1,
        1,
        100_000,
        2.0,
        3.0,
        4.0,
        0.5,
        1,
        0,
        7.0,
        0.25,
        -8.0,
        6,
        1,
        0,
    )


@given(asked=SETPOINTS, place=st.integers(0, 8 * 44 - 1), more=st.integers(0, 8 * 44 - 1))
def test_flipped_bits_make_no_setpoint(asked: SetpointDatagram, place: int, more: int) -> None:
    data = bytearray(datagrams.encode_setpoint(asked))
    for bit in {place, more}:
        data[bit // 8] ^= 1 << bit % 8
    assert isinstance(datagrams.decode_setpoint(bytes(data)), Wrong)


@given(data=st.binary(max_size=100))
def test_no_bytes_raise(data: bytes) -> None:
    assert isinstance(datagrams.decode_setpoint(data), Wrong)
    assert datagrams.decode_radar(data) is None


def _signed(body: bytes) -> bytes:
    return body + struct.pack("<I", zlib.crc32(body))


@pytest.mark.parametrize(
    ("place", "put", "wrong"),
    [
        (0, b"VVER", Wrong.MAGIC),
        (4, b"\x02", Wrong.VERSION),
        (5, b"\x01", Wrong.KIND),
        (12, struct.pack("<I", 0), Wrong.LIFETIME),
        (12, struct.pack("<I", 100_001), Wrong.LIFETIME),
        (16, struct.pack("<d", math.nan), Wrong.NUMBER),
        (24, struct.pack("<f", math.inf), Wrong.NUMBER),
        (28, struct.pack("<f", math.nan), Wrong.NUMBER),
    ],
)
def test_each_wrong_field_has_its_reason(place: int, put: bytes, wrong: Wrong) -> None:
    body = bytearray(datagrams.encode_setpoint(SetpointDatagram(1, 1, 1.0, 0.1, 0.0, 0.0))[:-4])
    body[place : place + len(put)] = put
    assert datagrams.decode_setpoint(_signed(bytes(body))) is wrong
    assert datagrams.decode_setpoint(_signed(bytes(body)) + b"\0") is Wrong.LENGTH


@given(data=st.data())
def test_a_number_that_is_not_finite_is_never_sent(data: st.DataObject) -> None:
    bad = data.draw(st.sampled_from([math.nan, math.inf, -math.inf]))
    field = data.draw(st.sampled_from(["time", "steering", "acceleration"]))
    with pytest.raises(ValueError, match="finite"):
        datagrams.encode_setpoint(replace(SetpointDatagram(1, 1, 1.0, 0.1, 0.0, 0.0), **{field: bad}))  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="finite"):
        datagrams.encode_radar(RadarDatagram(1, 1.0, 0.1, 1.0, bad, 0.0, ()))


def test_random_bytes_behind_a_right_head_are_refused() -> None:
    generator = np.random.default_rng(5)
    head = datagrams.encode_setpoint(SetpointDatagram(1, 1, 1.0, 0.1, 0.0, 0.0))[:16]
    for _ in range(20_000):
        assert isinstance(datagrams.decode_setpoint(head + generator.bytes(28)), Wrong)
