"""What is read of a real on-board unit's datagrams: the station's own words, and no exception for any bytes."""

from __future__ import annotations

import math
from random import Random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.stations.messages import EPOCH, FRAME, ORIGIN, car, packet, walker
from tests.v2x import test_cpm, test_denm
from tests.v2x.packets import nearly, spoilt
from vve_sumo.stations.reports import MAX_DATAGRAM, REASONS, StationReport, read
from vve_sumo.v2x import cpm, denm, geonetworking
from vve_sumo.v2x.data_elements import StationType
from vve_sumo.v2x.pdu_header import MessageId

CAR = car(5.0, 30.0, 4.0, 0.7, 8.0, yaw_rate=0.1)
WALKER = walker(5.0, 30.0, 4.0, 0.7, 1.4)


def said(datagram: bytes, received: float = 5.05) -> StationReport:
    report = read(datagram, received, EPOCH)
    assert isinstance(report, StationReport), report
    return report


def test_a_cam_says_where_its_front_was_and_when() -> None:
    report = said(CAR)
    assert (report.station, report.message, report.kind) == (4711, 2, "car")
    assert report.measured == pytest.approx(5.0, abs=6e-4)
    assert FRAME.to_map(report.latitude, report.longitude) == pytest.approx((30.0, 4.0), abs=0.012)
    assert (report.ahead, report.length, report.width, report.speed) == (2.25, 4.5, 1.8, 8.0)
    assert report.heading == pytest.approx(0.7 - FRAME.convergence(*ORIGIN), abs=math.radians(0.06))
    assert report.yaw_rate == pytest.approx(0.1, abs=2e-4)
    assert report.accuracy == 1.0


def test_a_vam_says_where_its_middle_was() -> None:
    report = said(WALKER)
    assert (report.station, report.message, report.kind, report.ahead) == (12, 16, "pedestrian", 0.0)
    assert FRAME.to_map(report.latitude, report.longitude) == pytest.approx((30.0, 4.0), abs=0.012)


def test_the_front_of_a_car_that_reverses_is_behind_its_motion() -> None:
    assert said(car(5.0, 30.0, reversing=True)).ahead == -2.25


def test_what_is_unavailable_is_no_number() -> None:
    report = said(car(5.0, 30.0, confidence=None, length=None, width=None))
    assert math.isnan(report.accuracy)
    assert (report.length, report.width) == (4.5, 1.8)  # what is usual
    assert math.isnan(said(walker(5.0, 0.0, 0.0, None, 0.0)).heading)


def test_a_message_in_an_ethernet_frame_is_the_same() -> None:
    assert said(geonetworking.ethernet_frame(CAR, b"\x02\x00\x00\x00\x00\x01")) == said(CAR)


def test_the_time_of_a_message_is_the_one_nearest_to_its_arrival() -> None:
    """A CAM has the remainder of 65.536 s alone."""
    assert said(CAR, 5.05 + 65.536).measured == pytest.approx(5.0 + 65.536, abs=6e-4)


@pytest.mark.parametrize(
    ("station_type", "kind"),
    [
        (StationType.UNKNOWN, "car"), (StationType.BUS, "bus"), (StationType.TRAM, "bus"),
        (StationType.HEAVY_TRUCK, "truck"), (StationType.MOPED, "motorcycle"), (StationType.CYCLIST, "bicycle"),
    ],
)  # fmt: skip
def test_what_a_station_is_placed_as(station_type: StationType, kind: str) -> None:
    assert said(car(5.0, 30.0, station_type=station_type)).kind == kind


@pytest.mark.parametrize(
    "datagram",
    [
        packet(MessageId.DENM, denm.encode(test_denm.EVENT)),
        packet(MessageId.CPM, cpm.encode(test_cpm.MESSAGE)),
        car(5.0, 30.0, station_type=StationType.INFRASTRUCTURE),
        car(5.0, 30.0, station_type=StationType.ANIMAL),
    ],
)
def test_what_tells_of_no_body_is_left_out(datagram: bytes) -> None:
    assert read(datagram, 5.05, EPOCH) == "no_body"


@pytest.mark.parametrize(
    "datagram", [b"", b"\x11", CAR[:-1], CAR[:40], b"\x12" + CAR[1:], b"x" * 1000, CAR + b"\x00" * MAX_DATAGRAM]
)
def test_what_is_no_message_is_malformed(datagram: bytes) -> None:
    assert read(datagram, 5.05, EPOCH) == "malformed"


def judged(datagram: bytes, received: float = 5.05) -> None:
    """Fail unless a datagram gives a sound report or a reason, the same each time."""
    found = read(datagram, received, EPOCH)
    assert repr(found) == repr(read(datagram, received, EPOCH))
    if not isinstance(found, StationReport):
        assert found in REASONS
        return
    assert math.isfinite(found.measured + found.latitude + found.longitude + found.ahead + found.yaw_rate)
    assert abs(found.latitude) <= math.pi / 2
    assert abs(found.longitude) <= math.pi
    assert abs(found.measured - received) <= 33.0
    assert found.length > 0.0 < found.width
    assert not found.speed < 0.0
    assert not math.isinf(found.heading + found.speed + found.accuracy)


@settings(max_examples=300)
@given(spoilt(CAR) | spoilt(WALKER), st.floats(0.0, 1e5))
def test_no_bytes_raise_anything(datagram: bytes, received: float) -> None:
    judged(datagram, received)


@pytest.mark.parametrize("genuine", [CAR, WALKER, packet(MessageId.DENM, denm.encode(test_denm.EVENT))])
def test_a_datagram_with_any_bit_flipped_or_cut_anywhere_raises_nothing(genuine: bytes) -> None:
    for datagram in nearly(genuine):
        judged(datagram)


def test_a_thousand_random_payloads_behind_a_sound_header_raise_nothing() -> None:
    random = Random(7)
    for _ in range(1000):
        message = random.choice(list(MessageId))
        judged(packet(message, random.randbytes(random.randrange(1, 200))))
