"""A receiver that a person carries: sentences over a real socket, without any heading."""

from __future__ import annotations

import math
import socket
import time
from collections.abc import Iterator

import pytest

from tests.live.command_line import free_port
from tests.pose.nmea_sentences import MIDNIGHT_GPS, NOON, gga, gst, rmc, vtg, zda
from vve_sumo.errors import RigError
from vve_sumo.live.rover import Rover, open_rover
from vve_sumo.people.reports import PositionReport
from vve_sumo.people.track import CIRCLE_95
from vve_sumo.pose.nmea import Decoder
from vve_sumo.rig.connections import RigPerson

#: drive time 0 is 100 s before the first epoch of these tests
EPOCH = MIDNIGHT_GPS + NOON - 100.0


def person(port: int) -> RigPerson:
    return RigPerson(
        id="anna", source="nmea_udp", latitude_deg=40.0, longitude_deg=-83.0, heading_deg=0.0, least_distance_m=50.0,
        port=port,
    )  # fmt: skip


@pytest.fixture
def port() -> int:
    return free_port()


@pytest.fixture
def rover(port: int) -> Iterator[Rover]:
    one = open_rover(person(port), time.monotonic() - 100.2, EPOCH)
    yield one
    one.close()


def heard(rover: Rover, port: int, *epochs: bytes) -> list[tuple[float, PositionReport]]:
    found: list[tuple[float, PositionReport]] = []
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        for epoch in epochs:
            sender.sendto(epoch, ("127.0.0.1", port))
            time.sleep(0.1)
            found += rover.receive()
    return found


def epoch(seconds: float, latitude: float = 39.99805, sigma: str = "0.011", speed: float = 1.4) -> bytes:
    return zda(seconds) + gst(seconds, sigma, sigma) + gga(seconds, latitude=latitude) + vtg(90.0, speed)


def test_its_positions_need_no_heading(rover: Rover, port: int) -> None:
    came = heard(rover, port, *(epoch(NOON + 0.1 * k) for k in range(6)))
    assert len(came) >= 4
    received, report = came[-1]
    assert report.person == "anna"
    assert math.degrees(report.latitude) == pytest.approx(39.99805, abs=1e-7)
    assert math.degrees(report.longitude) == pytest.approx(-82.98321, abs=1e-7)
    assert report.measured == pytest.approx(100.5, abs=1e-6)
    assert report.accuracy == pytest.approx(CIRCLE_95 * 0.011)
    assert math.cos(report.heading) == pytest.approx(1.0)  # towards the east
    assert 100.0 < received < 104.0


def test_one_without_accuracies_is_not_believed_and_one_who_stands_has_no_course(rover: Rover, port: int) -> None:
    silent = [zda(NOON + 0.1 * k) + gga(NOON + 0.1 * k) + vtg(None, 0.0) for k in range(6)]
    came = heard(rover, port, *silent)
    assert came
    assert all(math.isnan(report.accuracy) and math.isnan(report.heading) for _, report in came)


def test_a_car_still_waits_for_its_heading() -> None:
    data = b"".join(rmc(NOON + 0.1 * k) + epoch(NOON + 0.1 * k) for k in range(6))
    assert Decoder().feed(data, 1.0) == []


def test_two_programs_cannot_be_the_persons_receiver(rover: Rover, port: int) -> None:
    first = heard(rover, port, epoch(NOON), epoch(NOON + 0.1))
    other = heard(rover, port, epoch(NOON + 0.2, latitude=39.9), epoch(NOON + 0.3, latitude=39.9))
    assert first
    assert other == []


def test_a_port_that_is_taken_is_named(rover: Rover, port: int) -> None:
    with pytest.raises(RigError, match=r"people\.anna\.port"):
        open_rover(person(port), 0.0, 0.0)


@pytest.mark.thorough(witnesses=1)
@pytest.mark.parametrize(("quality", "believable"), [(4, True), (1, True), (6, False), (7, False), (8, False)])
def test_a_place_that_is_estimated_typed_in_or_simulated_has_no_accuracy(
    rover: Rover, port: int, quality: int, believable: bool
) -> None:
    epochs = [
        zda(at) + gst(at, "0.5", "0.5") + gga(at, quality=quality) + vtg(90.0, 1.4)
        for at in (NOON + 0.1 * k for k in range(6))
    ]
    came = heard(rover, port, *epochs)
    assert came or not believable
    assert all(math.isfinite(report.accuracy) is believable for _, report in came)
