"""The CAM: two independent decoders read what was encoded, a receiver reads `rounded`, and other bytes are refused."""

from __future__ import annotations

import math
from dataclasses import fields, replace
from pathlib import Path
from random import Random
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.v2x.packets import frame, spoilt
from tests.v2x.tshark import assert_read, needs_tshark, read
from vve_sumo.v2x import cam
from vve_sumo.v2x.cam import Cam
from vve_sumo.v2x.data_elements import ExteriorLights, StationType
from vve_sumo.v2x.decode_error import MessageDecodeError
from vve_sumo.v2x.pdu_header import MessageId
from vve_sumo.v2x.reference_position import ConfidenceEllipse

NOW = 700_000_000_000
CAR = Cam(
    123_456, StationType.PASSENGER_CAR, NOW, 39.9981234, -83.0123456, ConfidenceEllipse(0.5, 0.3, 1.0), 1.2, 13.33,
    False, -1.2, 0.1, 0.01, 4.9, 1.9, ExteriorLights.LOW_BEAM | ExteriorLights.LEFT_TURN,
)  # fmt: skip


def drawn(random: Random) -> tuple[Cam, dict[str, Any]]:
    """A message and the counts that stand for it on the wire, from which its quantities are made."""

    def count(lowest: int, highest: int, unavailable: int) -> int:
        return random.choice((unavailable, lowest, highest, *(random.randint(lowest, highest) for _ in range(7))))

    def quantity(counted: int, unavailable: int, step: float) -> float | None:
        return None if counted == unavailable else counted * step

    def direction(tenths: int) -> float | None:
        return None if tenths == 3601 else math.radians(90.0 - tenths / 10.0)

    latitude, longitude = random.randint(-900_000_000, 900_000_000), random.randint(-1_799_999_999, 1_800_000_000)
    major, minor = count(1, 4094, 4095), count(1, 4094, 4095)
    axis, heading = count(0, 3599, 3601), count(0, 3599, 3601)
    speed, acceleration = count(0, 16_382, 16_383), count(-160, 160, 161)
    yaw_rate, curvature = count(-32_766, 32_766, 32_767), count(-1023, 1022, 1023)
    length, width = count(1, 1022, 1023), count(1, 61, 62)
    station, kind, direction_of_drive = random.getrandbits(32), random.randrange(15), random.randrange(3)
    lights, time_ms = random.choice((None, random.randrange(256))), random.getrandbits(41)
    message = Cam(
        station, StationType(kind), time_ms, latitude / 1e7, longitude / 1e7,
        ConfidenceEllipse(quantity(major, 4095, 0.01), quantity(minor, 4095, 0.01), direction(axis)),
        direction(heading), quantity(speed, 16_383, 0.01), (False, True, None)[direction_of_drive],
        quantity(acceleration, 161, 0.1), quantity(yaw_rate, 32_767, math.radians(0.01)),
        quantity(curvature, 1023, 1e-4), quantity(length, 1023, 0.1), quantity(width, 62, 0.1),
        None if lights is None else ExteriorLights(lights),
    )  # fmt: skip
    counts = {
        "its.protocolVersion": 2, "its.messageID": 2, "its.stationID": station,
        "cam.generationDeltaTime": time_ms % 65_536, "cam.stationType": kind,
        "its.latitude": latitude, "its.longitude": longitude,
        "its.semiMajorConfidence": major, "its.semiMinorConfidence": minor, "its.semiMajorOrientation": axis,
        "its.altitudeValue": 800_001, "its.altitudeConfidence": 15,
        "its.headingValue": heading, "its.headingConfidence": 127, "its.speedValue": speed, "its.speedConfidence": 127,
        "cam.driveDirection": direction_of_drive, "its.vehicleLengthValue": length,
        "its.vehicleLengthConfidenceIndication": 4, "cam.vehicleWidth": width,
        "its.longitudinalAccelerationValue": acceleration, "its.longitudinalAccelerationConfidence": 102,
        "its.curvatureValue": curvature, "its.curvatureConfidence": 7, "cam.curvatureCalculationMode": 2,
        "its.yawRateValue": yaw_rate, "its.yawRateConfidence": 8,
    }  # fmt: skip
    if lights is not None:
        counts |= {"cam.exteriorLights": f"{lights:02x}", "cam.vehicleRole": 0, "cam.pathHistory": 0}
    return message, counts


@needs_tshark
@pytest.mark.parametrize("messages", [100, pytest.param(1000, marks=pytest.mark.slow)])
def test_tshark_reads_the_counts_of_which_a_message_was_made(messages: int, tmp_path: Path) -> None:
    random = Random(7)
    made = [drawn(random) for _ in range(messages)]
    found = read([frame(MessageId.CAM, cam.encode(message)) for message, _ in made], tmp_path)
    for fields_of_one, (_, counts) in zip(found, made, strict=True):
        assert_read(fields_of_one, counts)
        assert ("cam.exteriorLights" in fields_of_one) == ("cam.exteriorLights" in counts)


@pytest.mark.parametrize("messages", [100, pytest.param(1000, marks=pytest.mark.slow)])
def test_pycrate_makes_the_same_bytes_again(messages: int) -> None:
    """Its modules are those of release 1, EN 302 637-2 V1.4.1."""
    from pycrate_asn1dir.ITS_CAM_2 import CAM_PDU_Descriptions

    theirs, random = CAM_PDU_Descriptions.CAM, Random(8)
    for _ in range(messages):
        data = cam.encode(drawn(random)[0])
        theirs.from_uper(data)
        theirs.set_val(theirs.get_val())
        assert theirs.to_uper() == data


def or_none(strategy: st.SearchStrategy[Any]) -> st.SearchStrategy[Any]:
    return st.none() | strategy


angles, sizes = st.floats(-10.0, 10.0), st.floats(0.0, 200.0)
messages = st.builds(
    Cam,
    st.integers(0, 2**32 - 1),
    st.sampled_from(StationType),
    st.integers(NOW - 30_000, NOW + 30_000),
    st.floats(-90.0, 90.0),
    st.floats(-180.0, 180.0),
    or_none(st.builds(ConfidenceEllipse, or_none(sizes), or_none(sizes), or_none(angles))),
    or_none(angles),
    or_none(sizes),
    or_none(st.booleans()),
    or_none(st.floats(-20.0, 20.0)),
    or_none(angles),
    or_none(st.floats(-1.0, 1.0)),
    or_none(sizes),
    or_none(sizes),
    or_none(st.integers(0, 255).map(ExteriorLights)),
)


@given(messages)
def test_a_receiver_reads_rounded(message: Cam) -> None:
    read_back = cam.rounded(message)
    assert cam.decode(cam.encode(message), NOW) == read_back
    assert cam.rounded(read_back) == read_back


@given(messages)
def test_rounding_keeps_what_is_in_range_within_a_step(message: Cam) -> None:
    read_back = cam.rounded(message)
    steps = {"speed": (0.01, 0.0, 163.82), "acceleration": (0.1, -16.0, 16.0), "length": (0.1, 0.0, 102.2)}
    for name, (step, lowest, highest) in steps.items():
        given_value, value = getattr(message, name), getattr(read_back, name)
        if given_value is not None:
            inside = min(max(given_value, lowest), highest)
            assert inside - 1e-7 <= value <= inside + step + 1e-7
    if message.heading is not None:
        off = math.remainder(read_back.heading - message.heading, math.tau)
        assert abs(off) <= math.radians(0.05) + 1e-9


@pytest.mark.parametrize("at", [-32_768, -1, 0, 1, 32_767])
def test_the_receivers_clock_completes_the_time(at: int) -> None:
    assert cam.decode(cam.encode(replace(CAR, time_ms=NOW + at)), NOW).time_ms == NOW + at


def test_a_roadside_unit_says_where_it_is() -> None:
    unit = Cam(9, StationType.INFRASTRUCTURE, NOW, 40.0, -83.0)
    assert cam.decode(cam.encode(unit), NOW) == unit == cam.rounded(unit)
    assert len(cam.encode(unit)) < len(cam.encode(replace(unit, speed=0.0)))


NUMBERS = [one.name for one in fields(Cam) if isinstance(getattr(CAR, one.name), float)]


@pytest.mark.parametrize("name", NUMBERS)
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("function", [cam.encode, cam.rounded])
def test_what_is_no_number_is_refused(name: str, value: float, function: Any) -> None:
    with pytest.raises(ValueError, match="expected"):
        function(replace(CAR, **{name: value}))


@pytest.mark.parametrize("name", ["semi_major", "semi_minor", "orientation"])
@pytest.mark.parametrize("function", [cam.encode, cam.rounded])
def test_what_is_no_number_of_the_ellipse_is_refused(name: str, function: Any) -> None:
    with pytest.raises(ValueError, match="expected"):
        function(replace(CAR, confidence=replace(ConfidenceEllipse(0.5, 0.3, 1.0), **{name: math.nan})))


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("station", -1), ("station", 2**32), ("time_ms", -1), ("time_ms", 2**42), ("latitude_deg", 90.1),
        ("longitude_deg", -180.1), ("speed", -0.1), ("length", -1.0), ("width", -1.0),
    ],
)  # fmt: skip
@pytest.mark.parametrize("function", [cam.encode, cam.rounded])
def test_what_no_message_can_say_is_refused(name: str, value: float, function: Any) -> None:
    with pytest.raises(ValueError, match="expected"):
        function(replace(CAR, **{name: value}))


@given(spoilt(cam.encode(CAR)))
def test_any_bytes_are_a_message_or_refused(data: bytes) -> None:
    try:
        found = cam.decode(data, NOW)
    except MessageDecodeError:
        return
    assert cam.decode(cam.encode(found), NOW) == cam.rounded(found)


def test_another_message_another_version_and_no_position_are_refused() -> None:
    data = cam.encode(CAR)
    for header in (bytes([2, 1]), bytes([1, 2])):
        with pytest.raises(MessageDecodeError, match="expected 2 of version 2"):
            cam.decode(header + data[2:], NOW)
    nowhere = bytearray(cam.encode(replace(CAR, latitude_deg=90.0)))
    whole = int.from_bytes(nowhere)
    # The latitude's 31 bits follow 64 of header and time, the options and the station's type.
    place = 8 * len(nowhere) - (48 + 16 + 4 + 8 + 31)
    assert whole >> place & 0x7FFF_FFFF == 1_800_000_000
    with pytest.raises(MessageDecodeError, match="position"):
        cam.decode((whole + (1 << place)).to_bytes(len(nowhere)), NOW)
